"""Functions of ``import rsoconsole``: from frames and observations to orbits and names.

Each function does the same as the command of its name, by the same code, with tables, units, times
and directions of astropy. ``README.md`` in this folder describes them.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
