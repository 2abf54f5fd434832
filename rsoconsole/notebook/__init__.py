"""A session looked at afterwards or as it grows: tables, figures, a panel on the engine.

Nothing here is read by the verbs but the figures; ``LivePanel`` needs ``rsoconsole[notebook]``.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
