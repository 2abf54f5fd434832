"""Pure: measurements in, tracks out. No input or output, no clock, no threads."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
