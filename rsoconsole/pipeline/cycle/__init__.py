"""One cycle, frame to records, as the engine and every replay run it."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
