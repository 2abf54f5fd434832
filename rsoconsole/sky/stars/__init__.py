"""The Tycho-2 catalogue: where its stars are at an epoch, and how bright."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
