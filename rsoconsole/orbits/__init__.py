"""Orbit computation: element sets and directions in, orbits and places out. Pure."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
