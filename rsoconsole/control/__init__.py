"""The operator's wire: commands go up to the engine as JSON lines, each is answered.

The socket lies in a folder that only its owner can enter; nothing listens on a network. May use
sky, config and errors below; never instruments or a session.
"""

from lazy_loader import attach_stub

from rsoconsole.control import commands, frame_commands

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
VERBS = (commands, frame_commands)
"""Modules of commands, loaded at once: a command is registered when its class is defined."""
