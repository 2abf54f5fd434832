"""Characters and colours: blocks, plots, the disc of the sky, and where panes lie."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
