"""A session's night, read from its records: frames, tracks, log lines, figures of merit."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
