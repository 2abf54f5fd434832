"""The operator's wire: intentions go up to the engine as JSON lines, each is acknowledged.

The socket lies in a folder that only its owner can enter; nothing listens on a network.
May touch config and errors below; never instruments or a session.
"""

from rsoconsole.control.client import ControlClient, Wire
from rsoconsole.control.place import EngineLock, default_socket_path
from rsoconsole.control.server import FAST_VERBS, ControlServer, Handler
from rsoconsole.control.wire import Intention, Outcome, printable

__all__ = [
    "FAST_VERBS",
    "ControlClient",
    "ControlServer",
    "EngineLock",
    "Handler",
    "Intention",
    "Outcome",
    "Wire",
    "default_socket_path",
    "printable",
]
