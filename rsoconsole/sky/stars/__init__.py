"""Tycho-2 catalogue: places of its stars at an epoch, and magnitudes."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
