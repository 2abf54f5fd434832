"""Nights to choose from: named scenarios, chosen satellites, worlds drawn at random."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
