"""The lowest package: errors with remedies, durable writing, limited reading of files."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
