"""Tells systemd how the engine is, where systemd has started it.

Source of the protocol: sd_notify(3): one datagram of NAME=VALUE lines to ``$NOTIFY_SOCKET``.
"""

import contextlib
import os
import socket

_VARIABLE = "NOTIFY_SOCKET"
_kept: list[str] = []
"""The address, once it is kept from the children."""


def keep_from_children() -> None:
    """Take the address out of the environment: a program that the engine runs is not the engine.

    Those of systemd itself (``timedatectl``) report their own failures to it otherwise.
    """
    address = os.environ.pop(_VARIABLE, None)
    if address is not None:
        _kept[:] = [address]


def notify(state: str) -> bool:
    """Send e.g. "READY=1", "WATCHDOG=1", "STATUS=..."; True when it was sent.

    Never raises and never waits: where nobody listens nothing happens.
    """
    address = os.environ.get(_VARIABLE) or "".join(_kept)
    if not address.startswith(("/", "@")):
        return False
    if address.startswith("@"):
        address = "\0" + address[1:]  # a name without a file
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as wire:
        wire.setblocking(False)
        wire.sendto(state.encode(), address)
        return True
    return False
