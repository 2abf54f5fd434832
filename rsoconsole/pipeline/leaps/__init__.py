"""Low satellites: where and when to meet them next, and how long a slew takes. Pure."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
