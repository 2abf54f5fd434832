"""Orbit computation: from element sets and directions to orbits and places on the sky. Pure."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
