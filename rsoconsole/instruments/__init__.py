"""Clock, mount and camera, with the same interface for every driver."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
