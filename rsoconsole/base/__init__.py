"""The lowest package: errors with their remedies, durable files, foreign text."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
