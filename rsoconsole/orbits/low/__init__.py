"""Orbits of low satellites from single streaks, and their next pass."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
