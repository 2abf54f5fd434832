"""The mount, by a process of its own, with a watch and a second way to STOP."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
