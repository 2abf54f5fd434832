"""What the loop and its watch do to the world, and what they put on record."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
