"""Angles, times, reference frames and places. Imports nothing above the records."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
