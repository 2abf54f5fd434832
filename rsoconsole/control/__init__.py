"""The operator's wire: commands go up to the engine as JSON lines, each is answered.

The socket lies in a folder that only its owner can enter; nothing listens on a network.
May touch sky, config and errors below; never instruments or a session.
"""

from rsoconsole.control import commands, frame_commands
from rsoconsole.control.client import ControlClient, Wire
from rsoconsole.control.command import COMMANDS, Command, command_of, command_words
from rsoconsole.control.place import EngineLock, default_socket_path
from rsoconsole.control.preview import MovePreview, preview_json, read_preview
from rsoconsole.control.sender import Sender, sender_of
from rsoconsole.control.server import ControlServer, Handler
from rsoconsole.control.status import (
    Health,
    LastStop,
    Machine,
    NextAim,
    Status,
    TrackNow,
    read_status,
    status_json,
)
from rsoconsole.control.text import one_line, printable
from rsoconsole.control.wire import ON_RECORD, Outcome, Request

__all__ = [
    "COMMANDS",
    "ON_RECORD",
    "Command",
    "ControlClient",
    "ControlServer",
    "EngineLock",
    "Handler",
    "Health",
    "LastStop",
    "Machine",
    "MovePreview",
    "NextAim",
    "Outcome",
    "Request",
    "Sender",
    "Status",
    "TrackNow",
    "Wire",
    "command_of",
    "command_words",
    "commands",
    "default_socket_path",
    "frame_commands",
    "one_line",
    "preview_json",
    "printable",
    "read_preview",
    "read_status",
    "sender_of",
    "status_json",
]
