"""The session's database: how it is laid out, written to and read without SQLite."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
