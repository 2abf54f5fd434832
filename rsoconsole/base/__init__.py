"""The bottom of all rooms: faults with their remedies, files that are whole, text of others."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
