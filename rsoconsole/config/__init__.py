"""The configuration: every setting with its limits and words, files of them, changes to them."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
