"""A proposal of Q and R from recorded innovations, with its evidence."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
