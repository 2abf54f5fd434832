"""Kalman filters: one, or a bank of motions and scatters, with their consistency."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
