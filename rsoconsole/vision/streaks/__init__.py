"""A streak measured on the raw frame, and what kind of thing drew it."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
