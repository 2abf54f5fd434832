"""What is kept across nights: tracks that no catalogue explains, and what elements were off."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
