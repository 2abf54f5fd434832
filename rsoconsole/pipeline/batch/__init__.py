"""Work over many sessions, on the cores there are or on Dask."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
