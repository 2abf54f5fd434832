"""The operator's seat in a terminal: shows what the session says, sends what the operator wants.

May touch session, control, sky, tracking, records and config below; never the engine, an
instrument or the simulator.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
