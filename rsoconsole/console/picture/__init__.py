"""A frame's picture in a terminal, and what is pointed at in it."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
