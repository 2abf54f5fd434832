"""An observatory that speaks INDI. Only cli, tests and the training under models/ import it."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
