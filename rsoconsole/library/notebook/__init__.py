"""A session in Python, recorded or live: tables, figures, a panel on the engine.

Nothing here is read by the verbs but the figures; ``LivePanel`` needs ``rsoconsole[notebook]``.
"""
