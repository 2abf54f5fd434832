"""How engine and mount stand, what is followed and where a move leads, in words for every seat.

Nothing in the room above may import it.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
