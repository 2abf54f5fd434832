"""What the engine programs to: clock, mount and camera, no matter who stands behind them."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
