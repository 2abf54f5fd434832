"""The parent's side of the solver process: start, ask with a deadline, kill, start again."""

import logging
import threading
import time
from multiprocessing.connection import Connection

from rsoconsole.base import ChildProcess, LongWait, SolverError, said_as
from rsoconsole.config import WaitsConfig
from rsoconsole.instruments.solver._solver_process import MatchReply, MatchRequest, Ready

log = logging.getLogger(__name__)

_MODULE = "rsoconsole.instruments.solver._solver_process"
_GRACE_S = 1.0
_LOOK_S = 0.5


class SolverDied(Exception):  # noqa: N818 - an outcome the solver turns into a value
    """The process ended in the middle of a search."""


class SolverTimeout(Exception):  # noqa: N818 - an outcome the solver turns into a value
    """The deadline passed; the process was killed and another one is starting."""


class SolverChild:
    """One solver process at a time; thread-safe; replaced whenever it dies or overruns."""

    def __init__(self, start_s: float = WaitsConfig().process_s) -> None:
        """``start_s``: how long a process is waited for until it can search."""
        self._start_s = start_s
        self._lock = threading.Lock()
        self._child: ChildProcess | None = None
        self._is_ready = False

    @property
    def pid(self) -> int | None:
        """Of the running process."""
        return None if self._child is None else self._child.pid

    def start(self) -> None:
        """Start the process unless it runs; returns before it is ready.

        Raises SolverError when the system cannot start one.
        """
        with self._lock:
            self._ensure()

    def ask(self, request: MatchRequest, deadline_s: float) -> MatchReply:
        """The reply within ``deadline_s`` seconds of wall time.

        The deadline runs from the moment the process is ready: one that is only just being
        replaced is waited for, or short deadlines would kill it again and again. Raises
        SolverTimeout or SolverDied, in both cases with a fresh process already starting, and
        SolverError when no process can be brought to work.
        """
        with self._lock:
            connection = self._send(request)
            ends = time.monotonic() + deadline_s
            while True:
                reply = self._receive(connection, ends)
                if isinstance(reply, MatchReply) and reply.request_id == request.request_id:
                    return reply

    def close(self) -> None:
        """End the process."""
        with self._lock:
            self._end(_GRACE_S)

    def _send(self, request: MatchRequest) -> Connection:
        """Hand the request over to a process that is ready; one that died idle is replaced."""
        for _ in range(2):
            connection = self._ensure()
            try:
                if not self._is_ready:
                    self._await_ready(connection)
                connection.send(request)
                return connection
            except (EOFError, OSError):
                self._bury()
        raise SolverError("the solver process dies as soon as it starts: reinstall rsoconsole")

    def _await_ready(self, connection: Connection) -> None:
        wait = LongWait("the plate solver's process to start")
        while not connection.poll(_LOOK_S):
            wait.look()
            if wait.waited_s >= self._start_s:
                self._end()
                raise SolverError(
                    f"the plate solver's process was not ready in {self._start_s:g} s: on a "
                    "machine that slow raise waits.process_s"
                )
        word = connection.recv()
        if not isinstance(word, Ready) or word.error:
            self._end()
            why = word.error if isinstance(word, Ready) else "it speaks nonsense"
            raise SolverError(f"the solver process cannot work ({why}): reinstall rsoconsole")
        self._is_ready = True

    def _receive(self, connection: Connection, ends: float) -> object:
        try:
            if connection.poll(max(0.0, ends - time.monotonic())):
                return connection.recv()
        except (EOFError, OSError) as error:
            self._bury()
            self._ensure()
            raise SolverDied from error
        self._end()
        self._ensure()
        raise SolverTimeout

    def _ensure(self) -> Connection:
        if self._child is not None:
            if self._child.pid is not None:
                return self._child.connection
            self._bury()
        with said_as(SolverError, "the solver process cannot start: "):
            self._child = ChildProcess(_MODULE)
        self._is_ready = False
        return self._child.connection

    def _bury(self) -> None:
        """Clear away a process that ended without being told to, and say so."""
        status = self._end()
        log.warning("the plate solver's process ended (status %s): another one starts", status)

    def _end(self, grace_s: float = 0.0) -> int | None:
        child, self._child = self._child, None
        return None if child is None else child.end(grace_s)
