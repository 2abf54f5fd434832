"""Element sets: read, checked, propagated by SGP4, and made of an orbit that was found."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
