"""Everything the operator can do, its keys, and the terms on the screen."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
