"""Lines of light: proposed by a matched filter, turned into strips, told from stars in a row."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
