"""The files of a session, their hashes, and what was done to it later."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
