"""Where the telescope looks next, with one satellite followed or with several. Pure."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
