"""What crosses a simulated field: satellites, stars, clouds, other traffic."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
