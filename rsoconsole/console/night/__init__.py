"""What a session says of its night: a fold over its records, and what is known of the engine."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
