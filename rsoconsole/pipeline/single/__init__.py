"""One frame by itself, without a track: what ``detect`` and ``solve`` do."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
