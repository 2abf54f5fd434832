"""INDI: by PyIndi or indipyclient in child processes, by plain TCP for STOP, weather and dome."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
