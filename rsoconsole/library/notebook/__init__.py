"""A session in Python, recorded or live: tables, figures, a panel on the engine.

The command line uses the figures and the report; ``LivePanel`` needs ``rsoconsole[notebook]``.
"""
