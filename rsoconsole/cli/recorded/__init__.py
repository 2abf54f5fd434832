"""Verbs for what was recorded: sessions, frames, orbits, names, catalogues."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
