"""Motion about the Earth: closed or by forces, and where it puts an object on the sky."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
