"""Facts, reasons and figures of a night in words, in forms by width: worded here alone.

Pure functions of records and plain values: no ink, no fitting to a width, no JSON. Nothing is
ever decided by the words.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
