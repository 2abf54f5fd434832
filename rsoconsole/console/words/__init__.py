"""The seat's lines of text, made to fit, and its plots' contents. Pure."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
