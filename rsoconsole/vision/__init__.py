"""Pure: pixels in, stars and streaks out. No input or output beyond loading the network."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
