"""One cycle, frame to command, as the engine, `process`, what-if and batch all run it."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
