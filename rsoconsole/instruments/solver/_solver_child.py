"""The parent's side of the solver process: start, request with a deadline, kill, start again."""

import logging
import threading
import time
from multiprocessing.connection import Connection

from rsoconsole.base import ChildProcess, LongWait, SolverError, system_errors_as
from rsoconsole.config import WaitsConfig
from rsoconsole.instruments.solver._solver_process import MatchReply, MatchRequest

log = logging.getLogger(__name__)

_GRACE_S = 1.0
_LOOK_S = 0.5


class SolverChild:
    """One solver process at a time, replaced when it dies or exceeds a deadline. Thread-safe."""

    def __init__(self, start_s: float = WaitsConfig().process_s) -> None:
        """``start_s``: longest time that a process may take until it can search."""
        self._start_s = start_s
        self._lock = threading.Lock()
        self._child = ChildProcess("rsoconsole.instruments.solver._solver_process")
        self._is_ready = False

    @property
    def pid(self) -> int | None:
        """Process id of the running process; None where none runs."""
        return self._child.pid

    def start(self) -> None:
        """Start the process unless it runs; returns before it is ready.

        Raises SolverError when the system cannot start it.
        """
        with self._lock:
            self._running()

    def request_match(self, request: MatchRequest, deadline_s: float) -> MatchReply:
        """Send a request; return the reply, or a reply whose ``error`` says what went wrong.

        ``deadline_s`` (wall time) counts from when the process is ready: a process that is still
        starting is waited for, or short deadlines would kill it again and again. Where the deadline
        passes or the process dies, a new process is starting on return. Raises SolverError when no
        process can be started.
        """
        with self._lock:
            connection = self._send(request)
            ends = time.monotonic() + deadline_s
            try:
                while connection.poll(max(0.0, ends - time.monotonic())):
                    reply = connection.recv()
                    if isinstance(reply, MatchReply) and reply.request_id == request.request_id:
                        return reply
                error = f"no match within {deadline_s:g} s; the solver was restarted"
                self._child.end()
            except (EOFError, OSError):
                error = "the solver process died; it was restarted"
                self._end_dead()
            self._running()
            return MatchReply(request_id=request.request_id, error=error)

    def close(self) -> None:
        """End the process."""
        with self._lock:
            self._child.end(_GRACE_S)

    def _send(self, request: MatchRequest) -> Connection:
        """Send the request to a process that is ready; one that died idle is replaced."""
        for _ in range(2):
            connection = self._running()
            try:
                if not self._is_ready:
                    self._await_ready(connection)
                connection.send(request)
                return connection
            except (EOFError, OSError):
                self._end_dead()
        raise SolverError("the solver process dies as soon as it starts: reinstall rsoconsole")

    def _await_ready(self, connection: Connection) -> None:
        wait = LongWait("the plate solver's process to start")
        while not connection.poll(_LOOK_S):
            wait.log_if_due()
            if wait.waited_s >= self._start_s:
                self._child.end()
                raise SolverError(
                    f"the plate solver's process was not ready in {self._start_s:g} s: on a "
                    "machine that slow raise waits.process_s"
                )
        if fault := connection.recv():
            self._child.end()
            raise SolverError(f"the solver process cannot work ({fault}): reinstall rsoconsole")
        self._is_ready = True

    def _running(self) -> Connection:
        if self._child.pid is not None:
            return self._child.start()
        if self._child.has_died:
            self._end_dead()
        self._is_ready = False
        with system_errors_as(SolverError, "the solver process cannot start: "):
            return self._child.start()

    def _end_dead(self) -> None:
        """Clear away a process that ended without an order to, and log that."""
        status = self._child.end()
        log.warning("the plate solver's process ended (status %s): another one starts", status)
