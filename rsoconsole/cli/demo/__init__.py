"""The demo: a simulated observatory with the real program behind it, and the bench."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
