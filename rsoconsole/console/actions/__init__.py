"""What the keys of the seat do: each is one command, or one question."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
