"""Requests and outcomes on the operator's wire, line by line."""

import contextlib
import getpass
import json
import math
import os
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

from rsoconsole.base import ControlError, parse_json
from rsoconsole.control.command import Command, is_always_executed, make_command
from rsoconsole.records import CommandResult

SenderKind: TypeAlias = Literal["console", "script"]
_CONSOLE = "console "


@dataclass(frozen=True, slots=True, kw_only=True)
class Sender:
    """Sender of a command: its name, and whether it is a console."""

    name: str = "operator"
    kind: SenderKind = "script"
    """Kind of sender; "script": a shell or program, which may act without having control."""

    @classmethod
    def console(cls, name: str) -> "Sender":
        """Return the sender for a console, or for a notebook's panel, which counts as a console."""
        return cls(name=name, kind="console")

    @classmethod
    def at(cls, place: str) -> "Sender":
        """Return the sender for a console of this user; ``place``: its terminal or notebook."""
        try:
            user = getpass.getuser()
        except (KeyError, OSError):
            user = str(os.getuid())
        return cls.console(f"{user}@{place}")

    @property
    def words(self) -> str:
        """The sender as text, as it is written on the wire and on record."""
        return f"{_CONSOLE}{self.name}" if self.kind == "console" else self.name


def parse_sender(by: str, kind: Any = None) -> Sender:
    """Return the sender that a request names.

    ``kind``: None if the request states no kind: a console is then known by its name's prefix.
    """
    if kind == "script" or not by.startswith(_CONSOLE):
        return Sender(name=by, kind="console" if kind == "console" else "script")
    return Sender.console(by.removeprefix(_CONSOLE))


def to_printable(text: str) -> str:
    """Return the text with unprintable characters replaced by blanks; line breaks stay.

    Texts from elsewhere could otherwise control the terminal.
    """
    return "".join(c if c.isprintable() or c == "\n" else " " for c in text)


def one_line(text: str) -> str:
    """Return the text with line breaks and unprintable characters replaced by blanks.

    A line break in a text from elsewhere could pass for the end of one of the program's own
    lines.
    """
    return to_printable(text).replace("\n", " ")


MAX_LINE_BYTES = 65536
DEFAULT_TIMEOUT_S = 5.0
_SEND_TIMEOUT_S = 2.0


class RequestProgress:
    """Progress of a request: set by the loop, read by the thread that waits to answer it."""

    def __init__(self) -> None:
        self.is_begun = False
        self._result: CommandResult | None = None
        self._is_settled = threading.Event()

    def settle(self, result: CommandResult) -> None:
        """Set the request's result; may be called from any thread, and never waits."""
        self._result = result
        self._is_settled.set()

    def wait(self, timeout_s: float) -> CommandResult | None:
        """Wait for the request's result; None where it does not come within ``timeout_s``."""
        self._is_settled.wait(timeout_s)
        return self._result


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """Command with its sender."""

    command: Command
    sender: Sender = field(default_factory=Sender)
    stamp: int | None = None
    """Number of STOPs given before the command was read; None: not known."""
    came_s: float = field(default_factory=time.monotonic, compare=False)
    """Monotonic time at which the command was read, s."""
    course: RequestProgress = field(default_factory=RequestProgress, compare=False, repr=False)

    @property
    def by(self) -> str:
        """The sender as text, as it is written on record."""
        return self.sender.words


ON_RECORD = "on_record"
"""Key in a refusal's data: true where the session's record has the refusal too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Outcome of a command, as it is sent in the answer."""

    ok: bool
    message: str = ""
    """Message to the operator; the reason where ``ok`` is False."""
    data: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class PendingOutcome:
    """Outcome that is not known yet and comes within a limited time."""

    until_s: float
    """Monotonic time after which the outcome known by then is used, s."""
    wait: Callable[[float], Outcome]
    """Waits for the outcome, the given number of seconds at most, and returns it."""

    def outcome(self, deadline: float = math.inf) -> Outcome:
        """Wait for the outcome, at most until the monotonic time ``deadline``, s, and return it.

        The wait ends at ``until_s`` if that is earlier.
        """
        return self.wait(max(0.0, min(self.until_s, deadline) - time.monotonic()))


class NotACommand(ControlError):  # noqa: N818 -- an answer to the sender, no failure of the engine
    """A line on the wire that is no command; ``request_id``: the number that its sender gave it."""

    def __init__(self, message: str, request_id: int | str | None) -> None:
        super().__init__(message)
        self.request_id = request_id


@dataclass(frozen=True, slots=True, kw_only=True)
class WaitingRequest:
    """Request that waits for its outcome, with the connection for the answer."""

    id: int | str | None
    request: Request
    deadline: float
    """Monotonic time after which the sender no longer waits, s."""
    connection: "Connection"


class Connection:
    """Connection to one client of the engine; answers may be sent from any thread."""

    def __init__(self, peer: socket.socket) -> None:
        self._peer = peer
        self._writing = threading.Lock()
        peer.setsockopt(
            socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("ll", int(_SEND_TIMEOUT_S), 0)
        )

    def lines(self) -> Iterator[bytes]:
        """Yield the received lines; answer a line that is too long, and raise ValueError."""
        received = b""
        while True:
            while b"\n" not in received:
                if len(received) > MAX_LINE_BYTES:
                    text = f"a line of more than {MAX_LINE_BYTES} bytes: the connection is closed"
                    self.answer(None, Outcome(ok=False, message=text))
                    raise ValueError(text)
                chunk = self._peer.recv(4096)
                if not chunk:
                    return
                received += chunk
            line, _, received = received.partition(b"\n")
            yield line

    def answer(self, request_id: int | str | None, outcome: Outcome) -> None:
        """Send an outcome; a client that is gone or does not read is disconnected."""
        reply = {"id": request_id, "ok": outcome.ok, "message": outcome.message}
        try:
            line = json.dumps({**reply, "data": dict(outcome.data)}, allow_nan=False)
        except (TypeError, ValueError) as error:
            reply |= {"ok": False, "message": f"the answer cannot be sent: {error}"}
            line = json.dumps({**reply, "data": {}})
        try:
            with self._writing:
                self._peer.sendall(line.encode() + b"\n")
        except OSError:
            self.close()

    def close(self) -> None:
        """Close the connection; a thread that is reading from it returns."""
        with contextlib.suppress(OSError):
            self._peer.shutdown(socket.SHUT_RDWR)
        self._peer.close()


def read_request(connection: Connection, line: bytes) -> WaitingRequest:
    """Parse a line into a request that waits for its answer.

    Raises NotACommand or ControlError with the reason.
    """
    try:
        message = parse_json(line)
    except ValueError as error:
        raise ControlError(f"not a line of JSON: {error}") from error
    if not isinstance(message, dict):
        raise ControlError("a command is a JSON object")
    verb, arguments = message.get("verb"), message.get("arguments", {})
    by, timeout_s = message.get("by", "operator"), message.get("timeout_s", DEFAULT_TIMEOUT_S)
    request_id = message.get("id")
    if not isinstance(verb, str) or not verb:
        raise ControlError("a command needs a 'verb'")
    if is_always_executed(verb):
        arguments = arguments if isinstance(arguments, dict) else {}
        by = by if isinstance(by, str) else "operator"
        request_id = request_id if isinstance(request_id, int | str | None) else None
        is_good = isinstance(timeout_s, int | float) and 0 < timeout_s <= 3600
        timeout_s = timeout_s if is_good else DEFAULT_TIMEOUT_S
    if not isinstance(arguments, dict):
        raise ControlError("'arguments' is a JSON object")
    if not isinstance(by, str) or not isinstance(request_id, int | str | None):
        raise ControlError("'by' is text, 'id' a whole number or text")
    if not isinstance(timeout_s, int | float) or not 0 < timeout_s <= 3600:
        raise ControlError("'timeout_s' lies between 0 and 3600")
    try:
        command = make_command(verb, arguments)
    except ValueError as error:
        raise NotACommand(str(error), request_id) from error
    return WaitingRequest(
        id=request_id,
        request=Request(command=command, sender=parse_sender(by, message.get("sender"))),
        deadline=time.monotonic() + timeout_s,
        connection=connection,
    )


def receive_line(wire: socket.socket, deadline: float) -> bytes:
    """Return one line, received before the monotonic time ``deadline``, s.

    Raises OSError, or its subclass TimeoutError after the deadline.
    """
    received = bytearray()
    while b"\n" not in received:
        left_s = deadline - time.monotonic()
        if left_s <= 0:
            raise TimeoutError
        wire.settimeout(left_s)
        chunk = wire.recv(65536)
        if not chunk:
            raise ConnectionResetError("it closed the connection without an answer")
        received += chunk
    return bytes(received.partition(b"\n")[0])


def read_outcome(reply: bytes) -> Outcome:
    """Return the outcome in a reply line. Raises ControlError for a line that is no outcome."""
    try:
        message = parse_json(reply)
        text = to_printable(str(message["message"]))
        return Outcome(ok=bool(message["ok"]), message=text, data=dict(message["data"]))
    except (ValueError, KeyError, TypeError) as error:
        raise ControlError(f"the engine's answer cannot be read: {error}") from error


def is_same_user(peer: socket.socket) -> bool:
    """True where the process at the other end belongs to this process's user."""
    if not hasattr(socket, "SO_PEERCRED"):
        return True  # the folder, which only its owner can enter, protects it
    credentials = peer.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
    _, uid, _ = struct.unpack("3i", credentials)
    return bool(uid == os.getuid())
