"""Tracking: measurements in, tracks out. Pure: no input or output, no clock, no threads."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
