"""The client's end of the operator's wire, for a console or a command."""

import contextlib
import json
import socket
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rsoconsole.base import ControlError
from rsoconsole.control.command import Command
from rsoconsole.control.commands import AskStatus
from rsoconsole.control.record_lock import (
    default_socket_path,
    engine_pid,
    running_engine_at,
    running_engines,
    socket_address,
)
from rsoconsole.control.status import Status, read_status
from rsoconsole.control.wire import DEFAULT_TIMEOUT_S, Outcome, Sender, read_outcome, receive_line

STILL_STOPS = "'rsoconsole stop' works without it"

CROWDED_S = 0.01
"""Pause before connecting again to an engine that has no connection free, s."""
GRACE_S = 0.5
MADE_AGAIN_S = 2.0
"""Wait for an engine to make its removed socket again, s."""
OPERATOR = Sender()


class ControlClient:
    """Client of the operator's wire; each command has a connection of its own."""

    def __init__(self, path: Path | None = None, sender: Sender = OPERATOR) -> None:
        self._path = path if path is not None else default_socket_path()
        self._sender = sender

    def send(self, command: Command, *, timeout_s: float = DEFAULT_TIMEOUT_S) -> Outcome:
        """Send a command to the engine and wait for its outcome.

        Raises ControlError when no engine runs, when it does not answer within ``timeout_s``, and
        for arguments that can never be carried out; nothing is sent then.
        """
        verb = command.verb
        try:
            command.check()
        except ValueError as error:
            raise ControlError(str(error)) from error
        message: dict[str, Any] = {
            "id": 1,
            "verb": verb,
            "arguments": command.arguments(),
            "by": self._sender.words,
            "sender": self._sender.kind,
            "timeout_s": timeout_s,
        }
        try:
            json.dumps(message, allow_nan=False)
        except (TypeError, ValueError) as error:
            raise ControlError(f"{verb}: an argument cannot be sent: {error}") from error
        # The engine drops what has waited longer than timeout_s; it is outwaited, so that what
        # the sender gave up while it waited is never carried out.
        deadline = time.monotonic() + timeout_s + GRACE_S
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as wire:
                self._connect_patiently(wire, deadline - GRACE_S)
                message["timeout_s"] = max(deadline - GRACE_S - time.monotonic(), CROWDED_S)
                line = json.dumps(message).encode() + b"\n"
                wire.settimeout(deadline - time.monotonic())
                # An engine that turns this user away closes at once, its refusal unread.
                with contextlib.suppress(BrokenPipeError, ConnectionResetError):
                    wire.sendall(line)
                reply = receive_line(wire, deadline)
        except (FileNotFoundError, ConnectionRefusedError) as error:
            pid = engine_pid(self._path)
            if pid is not None:
                raise ControlError(
                    f"the engine is starting (process {pid}) and does not listen yet: try again "
                    f"in a moment; {STILL_STOPS}"
                ) from error
            raise ControlError(_no_engine(self._path)) from error
        except TimeoutError as error:
            raise ControlError(
                f"the engine did not answer {verb!r} within {timeout_s:g} s: it may hang, or "
                f"still be at it; {STILL_STOPS}"
            ) from error
        except OSError as error:
            raise ControlError(f"the engine cannot be reached: {error}") from error
        return read_outcome(reply)

    def _connect_patiently(self, wire: socket.socket, deadline: float) -> None:
        """Connect; an engine that starts, or whose socket was just removed, soon has one."""
        address = str(socket_address(self._path))
        until = min(deadline, time.monotonic() + MADE_AGAIN_S)
        may_come = False
        while True:
            try:
                _connect(wire, address, deadline)
                return
            except (FileNotFoundError, ConnectionRefusedError):
                # A folder that is not even there was emptied by somebody: the engine, if there is
                # one, makes it again.
                may_come = may_come or not Path(address).parent.exists()
                if time.monotonic() > until or not (may_come or running_engine_at(self._path)):
                    raise
                time.sleep(0.1)


def ask_engine(wire: ControlClient, question: Command) -> Mapping[str, Any]:
    """Return the data of the engine's answer to a question.

    Raises ControlError when no engine answers, or when it refuses.
    """
    outcome = wire.send(question)
    if not outcome.ok:
        raise ControlError(outcome.message)
    return outcome.data


def ask_status(wire: ControlClient) -> Status:
    """Return the engine's status.

    Raises ControlError when no engine answers, or when it refuses.
    """
    return read_status(ask_engine(wire, AskStatus()))


def _no_engine(path: Path) -> str:
    """Return the message that no engine listens there, and where one does."""
    behind = running_engine_at(path)
    if behind is not None:
        return (
            f"the engine (process {behind.pid}) runs and its socket is gone; it makes a new one"
            f" within a second: try again; {STILL_STOPS}"
        )
    others = running_engines()
    if not others:
        return "no engine is running: 'rsoconsole engine' starts one"
    places = ", ".join(f"process {each.pid} at {each.socket}" for each in others)
    return f"no engine listens at {path}; one is running as {places}: '--socket' reaches it"


def _connect(wire: socket.socket, address: str, deadline: float) -> None:
    """Connect, also where the queue is full and the system turns the next connection away.

    Raises TimeoutError when that has not ended at the deadline, OSError for everything else.
    """
    while True:
        wire.settimeout(max(deadline - time.monotonic(), CROWDED_S))
        try:
            wire.connect(address)
            return
        except BlockingIOError as error:
            if time.monotonic() > deadline:
                raise TimeoutError from error
            time.sleep(CROWDED_S)
