"""Stars of a frame: where, how wide, and the plate that is fitted to them."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
