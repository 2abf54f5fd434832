"""Is this machine ready for a night: one check for each thing that has ended nights before."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
