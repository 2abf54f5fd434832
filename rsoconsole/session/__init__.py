"""The record of a night: one writer, any number of readers.

May use records, config and errors, SQLite and the session's folder; never instruments.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
