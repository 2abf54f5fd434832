"""The machine itself: its heat, time, disk and name, and systemd's word on it."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
