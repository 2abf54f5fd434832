"""What reads, asks and computes for the screens, each on a thread of its own."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
