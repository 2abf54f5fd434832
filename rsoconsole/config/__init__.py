"""The configuration: settings with limits and descriptions, its files, changes to it."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
