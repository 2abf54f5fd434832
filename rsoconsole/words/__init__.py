"""Wording of a night's facts, reasons and figures, in forms of several widths.

All other packages take their wording from here. Pure functions of records and plain values: no
colours, no fitting to a width, no JSON. No decision depends on the words.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
