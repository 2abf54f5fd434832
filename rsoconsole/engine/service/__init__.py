"""The engine put together as a process, and the operator's wire answered."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
