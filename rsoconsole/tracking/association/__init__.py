"""What is followed, where its neighbours stand, and how they move against each other."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
