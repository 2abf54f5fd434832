"""Frames from files: FITS, TIFF, PNG, with what their headers promise."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
