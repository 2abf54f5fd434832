"""What recorded nights say of the shutter's timing and of published elements."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
