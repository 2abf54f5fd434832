"""One frame at full resolution: any pixel of it, and what other settings would say."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
