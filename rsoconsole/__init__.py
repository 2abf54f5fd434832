"""Find and follow satellites that nobody told you about.

``import rsoconsole as rso``: what is here for scripts and notebooks is listed in
``__init__.pyi`` and read when it is asked for; the verbs need none of it.
"""

from lazy_loader import attach_stub

__version__ = "0.1.0"
__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
