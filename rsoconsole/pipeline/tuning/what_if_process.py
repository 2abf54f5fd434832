"""What-if computed in a separate process, so that the console stays small and responsive.

Filter and orbits load libraries of tens of megabytes. The process starts with the first question or
before, and keeps the records that it has read. It ends after some time without a question, and when
its parent ends, which closes the socket.
"""

import contextlib
import logging
import os
import threading
import traceback
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsoconsole.base import ChildProcess, RsoconsoleError, SessionError
from rsoconsole.config import Config, FilterConfig
from rsoconsole.records import Record
from rsoconsole.session import SessionReader
from rsoconsole.words import NO_EFFECT

if TYPE_CHECKING:
    from rsoconsole.night import TrackFigures
    from rsoconsole.pipeline.tuning.propose_inquiry import Proposal

log = logging.getLogger(__name__)

IDLE_S = 60.0
MAX_KEPT = 60_000
"""Largest number of records kept for the next question: a night of some 8,000 frames, 100 MB."""
STEP_BACK = 10
"""Increment of the process's niceness, so that an engine on the same computer comes first."""
_MODULE = "rsoconsole.pipeline.tuning.what_if_process"


@dataclass(frozen=True, slots=True, kw_only=True)
class WhatIfQuestion:
    """Question for the process: which settings to change for which part of a session."""

    folder: Path
    config: Config
    changes: Mapping[str, float | str]
    until_seq: int | None = None
    """Last sequence number of the log that is included; None: the whole log."""
    last: int | None = None
    """Number of last frames that count in the figures; None: all."""
    of_lead: bool = False
    proposes: bool = False
    """True: the answer is the Q and R with which the session's innovations are likeliest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UnexpectedFailure:
    """Unexpected error in the what-if process, for the parent's log."""

    words: str
    traceback: str


class SessionLogCache:
    """Cache of the last requested session's records, so that only new ones are read.

    Of a long session only the first ``most_kept`` records are kept, to save memory; the others are
    read again for each question.
    """

    def __init__(self, most_kept: int = MAX_KEPT) -> None:
        self._most_kept = most_kept
        self._folder: Path | None = None
        self._records: list[Record] = []
        self._seqs: list[int] = []

    def records_until(self, folder: Path, seq: int | None) -> Iterator[Record]:
        """Yield the records up to a sequence number, or all with None. Raises SessionError."""
        if folder != self._folder:
            self._folder, self._records, self._seqs = folder, [], []
        yield from self._records if seq is None else self._records[: bisect_right(self._seqs, seq)]
        since = self._seqs[-1] if self._seqs else 0
        if seq is not None and since >= seq:
            return
        for at, _, record in SessionReader(folder).records(since_seq=since):
            if seq is not None and at > seq:
                return
            if len(self._records) < self._most_kept:
                self._records.append(record)
                self._seqs.append(at)
            yield record


class WhatIfProcess:
    """Parent's end of the what-if process. One thread may ask; any thread may close."""

    def __init__(self, idle_s: float = IDLE_S) -> None:
        """``idle_s``: time after the last question until the process ends; a new one starts it."""
        self._idle_s = idle_s
        self._child = ChildProcess(_MODULE, is_group_of_its_own=True)
        self._idle: threading.Timer | None = None
        self._lock = threading.Lock()
        self._is_closed = False

    @property
    def pid(self) -> int | None:
        """Process id while there is one, else None."""
        return self._child.pid

    def start(self) -> None:
        """Start the process before the first question; a failure is reported by ``ask``."""
        with self._lock, contextlib.suppress(SessionError, OSError):
            self._started()
            self._end_when_idle()

    def ask(self, question: WhatIfQuestion) -> "TrackFigures":
        """Return the track figures of the what-if. Raises RsoconsoleError where there are none."""
        figures: TrackFigures = self._answer_to(question)
        return figures

    def propose(self, question: WhatIfQuestion) -> "Proposal":
        """Return the proposal of Q and R for a session. Raises RsoconsoleError as ``ask``."""
        proposal: Proposal = self._answer_to(replace(question, proposes=True))
        return proposal

    def _answer_to(self, question: WhatIfQuestion) -> Any:
        with self._lock:
            if self._idle is not None:
                self._idle.cancel()
                self._idle = None
            connection = self._started()
        try:
            connection.send(question)
            answer = connection.recv()
        except (EOFError, OSError) as error:
            with self._lock:
                self._end()
            reason = "the process that computes the effect has ended: try once more"
            raise SessionError(reason) from error
        with self._lock:
            self._end_when_idle()
        if isinstance(answer, RsoconsoleError):
            raise answer
        if isinstance(answer, UnexpectedFailure):
            log.error("%s:\n%s", NO_EFFECT, answer.traceback)
            raise SessionError(f"{NO_EFFECT} ({answer.words}): see the log")
        return answer

    def close(self) -> None:
        """End the process; an ``ask`` that is waiting for its answer fails."""
        with self._lock:
            self._is_closed = True
            self._end()

    def _started(self) -> Connection:
        if self._is_closed:
            raise SessionError("no effect is computed any more: the console closes")
        return self._child.start()

    def _end_when_idle(self) -> None:
        if self._idle is not None:
            self._idle.cancel()
        self._idle = threading.Timer(self._idle_s, self._end_if_idle)
        self._idle.daemon = True
        self._idle.start()

    def _end_if_idle(self) -> None:
        with self._lock:
            if self._idle is threading.current_thread():
                self._end()

    def _end(self) -> None:
        if self._idle is not None:
            self._idle.cancel()
            self._idle = None
        self._child.end()


def main(socket_fd: int) -> None:
    """Answer questions one after the other, until the parent's end of the socket closes."""
    from rsoconsole.pipeline.replays.what_if_log import what_if
    from rsoconsole.pipeline.tuning.proposal import propose
    from rsoconsole.tracking.filters import estimator

    os.nice(STEP_BACK)
    estimator.preload_modules(FilterConfig())
    connection, session = Connection(socket_fd), SessionLogCache()
    while True:
        try:
            asked: WhatIfQuestion = connection.recv()
        except (EOFError, OSError):
            return
        answer: TrackFigures | Proposal | RsoconsoleError | UnexpectedFailure
        try:
            if asked.proposes:
                answer = propose([asked.folder])
            else:
                records = session.records_until(asked.folder, asked.until_seq)
                answer = what_if(
                    records, asked.config, asked.changes, asked.last, of_lead=asked.of_lead
                )
        except RsoconsoleError as error:
            answer = error
        except Exception as error:  # the seat must hear of it, whatever it is
            answer = UnexpectedFailure(words=repr(error), traceback=traceback.format_exc())
        try:
            connection.send(answer)
        except OSError:
            return
