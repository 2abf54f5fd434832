"""Which catalogued object was seen, and how far objects may be from their elements."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
