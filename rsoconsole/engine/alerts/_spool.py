"""Queue of unsent messages on disk: a message can wait through a night without a network.

The queue is limited in number and age. A service is listed by the digest of its address, because
addresses are secrets. The file belongs to one process at a time; another process keeps its messages
in memory until the file is free, and then adds them.
"""

import contextlib
import hashlib
import json
import os
import threading
import time
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from rsoconsole.base import lock_file, parse_json, read_foreign_text, write_durably

MOST = 200
MAX_SESSIONS = 8
OLDEST_NS = 24 * 3600 * 10**9
CLAIM_AGAIN_S = 2.0
SPOOL, LOCK = "spool.json", "spool.lock"


@dataclass(slots=True, kw_only=True)
class QueuedMessage:
    """One message, and the services that it has not been sent to yet."""

    number: int = 0
    kind: str
    title: str
    body: str
    t_utc_ns: int
    pending: list[str] = field(default_factory=list)


def digest_of(url: str) -> str:
    """Return the digest that stands for a service's address in the queue's file."""
    return hashlib.sha256(url.encode()).hexdigest()[:16]


class Spool:
    """The queue of messages in its file; may be used from several threads.

    Where the file cannot be written, the queue stays in memory.
    """

    def __init__(self, folder: Path, *, claim_again_s: float = CLAIM_AGAIN_S) -> None:
        """``claim_again_s``: interval of attempts to own a file that another process owns, s."""
        self._folder, self._path = folder, folder / SPOOL
        self._lock = threading.Lock()
        self._waiting: list[QueuedMessage] = []
        self._next = 1
        self._seen: dict[str, int] = {}
        self.fault: str | None = None
        """Reason why the messages are in memory only; None where they are on the disk."""
        self._claim_again_s, self._claimed_s = claim_again_s, time.monotonic()
        self._is_closed = False
        self._owns: int | None = None
        self._claim_and_merge()

    def add(self, waiting: QueuedMessage, seen: tuple[str, int] = ("", 0)) -> None:
        """Queue a message and give it its number; the oldest is dropped where there are too many.

        ``seen``: the session, and the number of the record that the message is about.
        """
        with self._lock:
            self._claim_if_due()
            self._note_seen({seen[0]: seen[1]})
            waiting.number, self._next = self._next, self._next + 1
            self._waiting = [*self._waiting, waiting][-MOST:]
            self._write()

    def last_alerted_record(self, session: str) -> int | None:
        """Return the number of a session's last record that gave a message; 0 without one.

        None where another process owns the file.
        """
        if self._owns is None:
            return None
        return self._seen.get(session, 0)

    def oldest_unsent(self, service: str) -> QueuedMessage | None:
        """Return the oldest message not yet sent to a service; None where there is none."""
        with self._lock:
            self._claim_if_due()
            return next((each for each in self._waiting if service in each.pending), None)

    def sent(self, number: int, service: str) -> None:
        """Note that message ``number`` has been sent to a service."""
        with self._lock:
            for each in self._waiting:
                if each.number == number and service in each.pending:
                    each.pending.remove(service)
            self._waiting = [each for each in self._waiting if each.pending]
            self._write()

    def drop_old(self, now_utc_ns: int, known: Collection[str]) -> None:
        """Drop messages that are too old, and those for services that are no longer configured.

        ``known``: digests of the configured services.
        """
        with self._lock:
            before = [list(each.pending) for each in self._waiting]
            for each in self._waiting:
                each.pending = [one for one in each.pending if one in known]
            self._waiting = [
                each
                for each in self._waiting
                if each.pending and now_utc_ns - each.t_utc_ns < OLDEST_NS
            ]
            if before != [each.pending for each in self._waiting]:
                self._write()

    def __len__(self) -> int:
        with self._lock:
            return len(self._waiting)

    def close(self) -> None:
        """Release the file, so that another process can own it."""
        with self._lock:
            self._is_closed = True
            if self._owns is not None:
                os.close(self._owns)
                self._owns = None

    def _note_seen(self, seen: Mapping[str, int]) -> None:
        for session, seq in seen.items():
            if session:
                self._seen[session] = max(seq, self._seen.pop(session, 0))
        self._seen = dict(list(self._seen.items())[-MAX_SESSIONS:])

    def _claim_if_due(self) -> None:
        """Take over the file and messages of a process that has ended."""
        now_s = time.monotonic()
        is_due = now_s - self._claimed_s >= self._claim_again_s
        if self._owns is None and not self._is_closed and is_due:
            self._claimed_s = now_s
            self._claim_and_merge()

    def _claim_and_merge(self) -> None:
        self._owns = self._claim()
        if self._owns is None:
            return
        self.fault = None
        there, seen = _read(self._path)
        own, own_seen = self._waiting, self._seen
        # What has no number on the disk yet goes behind what has.
        self._next = max([each.number for each in there] + [self._next - 1]) + 1
        for each in own:
            each.number, self._next = self._next, self._next + 1
        self._waiting = sorted([*there, *own], key=lambda each: each.t_utc_ns)[-MOST:]
        self._seen = {}
        self._note_seen(seen)
        self._note_seen(own_seen)
        if own:
            self._write()

    def _claim(self) -> int | None:
        try:
            self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            return lock_file(self._folder / LOCK)
        except BlockingIOError:
            self.fault = "another engine's messages are kept there"
        except OSError as error:
            self.fault = f"{self._folder} cannot be used ({error.strerror})"
        return None

    def _write(self) -> None:
        if self._owns is None:
            return
        fields_ = {
            "format": 2,
            "seen": list(self._seen.items()),
            "waiting": [asdict(each) for each in self._waiting],
        }
        try:
            write_durably(self._path, json.dumps(fields_).encode(), mode=0o600)
            self.fault = None
        except OSError as error:
            self.fault = f"{self._path} cannot be written ({error.strerror})"


_WAITING = TypeAdapter(QueuedMessage)


def _read(path: Path) -> tuple[list[QueuedMessage], dict[str, int]]:
    """Read the messages of an earlier run; empty where the file is damaged."""
    found: list[QueuedMessage] = []
    seen: dict[str, int] = {}
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError, UnicodeDecodeError):
        fields_: dict[str, Any] = parse_json(read_foreign_text(path))
        for row in fields_["waiting"][-MOST:]:
            with contextlib.suppress(ValueError):  # the others are told all the same
                found.append(_WAITING.validate_python(row))
        # Format 1 knew of one session alone.
        pairs = fields_["seen"] if fields_.get("format") != 1 else [fields_["seen"]]
        seen = {str(session): int(seq) for session, seq in pairs}
    return found, seen
