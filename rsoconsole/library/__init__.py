"""Functions of ``import rsoconsole``: from frames and observations to orbits and names.

Each function does what the verb of its name does, by the same code, and speaks astropy: tables
with units, times and directions. ``README.md`` here is its page.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
