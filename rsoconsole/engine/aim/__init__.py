"""Where the telescope goes next, who is in charge, and when the night is dark."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
