"""A session looked at afterwards or as it grows: tables, figures, a panel on the engine.

Nothing here is read by the verbs but the figures; ``LivePanel`` needs ``rsoconsole[notebook]``.
"""
