"""How a track begins: two streaks that agree on one motion, or a chain of points."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
