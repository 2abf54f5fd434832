"""All of a frame: its sky, its bins, its map, what the sensor adds to it."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
