"""Orbits, names and relative motion of what is followed, frame by frame, as they go on record."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
