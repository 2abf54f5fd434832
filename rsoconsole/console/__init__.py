"""The operator's console in a terminal: shows the session, sends the operator's commands.

Imports packages of lower layers, but never the engine, an instrument or the simulator.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
