"""A run against the simulated observatory, judged by the truth that only this package reads."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
