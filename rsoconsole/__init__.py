"""Find and follow satellites that nobody told you about.

``import rsoconsole as rso``: ``__init__.pyi`` lists the names for scripts and notebooks, each
imported on first use; the command line needs none of them.
"""

from lazy_loader import attach_stub

__version__ = "0.1.0"
__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
