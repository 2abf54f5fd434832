"""Clock, mount and camera as the engine uses them, whichever driver is behind them."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
