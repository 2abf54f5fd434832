"""The orbit pane: what can be said of an orbit at one instant, in lines."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
