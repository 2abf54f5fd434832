"""A session's night, from one fold over its records: frames, tracks, log lines, figures."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
