"""What the verbs print: JSON for scripts, lines of at most 80 columns for people."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
