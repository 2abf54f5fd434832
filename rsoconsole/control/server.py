"""The engine's end of the operator's wire.

Immediate commands (``stop``, ``status``) are handled at once, on the thread of their connection.
All others wait in one queue for one thread; a command is dropped once its sender has stopped
waiting for the answer. An answer that waits for the mount has a short thread of its own, so that
later commands need not wait.
"""

import contextlib
import queue
import socket
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from rsoconsole.base import ControlError
from rsoconsole.control.commands import Stop
from rsoconsole.control.record_lock import EngineLock, RecordLock, remove_socket, socket_address
from rsoconsole.control.wire import (
    Connection,
    NotACommand,
    Outcome,
    PendingOutcome,
    Request,
    WaitingRequest,
    is_same_user,
    read_request,
)

KEEP_S = 0.5
"""Interval at which socket and locks are checked, s."""
MAX_CONNECTIONS = 32
SPARE = 8
"""Number of connections reserved for a STOP, so that other clients cannot keep it out."""
MAX_WAITING = 64
MAX_LATER = 16
"""Greatest number of answers that may wait for the mount at once; further ones do not wait."""
BACKLOG = 128
"""Number of connections that may wait to be accepted before the system turns one away."""


Handler = Callable[[Request], Outcome | PendingOutcome]


class ControlServer:
    """The engine's end of the wire; runs on threads of its own.

    ``handler`` is called on one thread for all commands but the immediate ones. These may come at
    any moment on another thread, even while the handler is busy. An exception of the handler
    becomes an outcome that is not ok. A line that is no command never reaches the handler.
    """

    def __init__(
        self,
        path: Path,
        handler: Handler,
        *,
        lock: EngineLock | None = None,
        stamp: Callable[[], int | None] = lambda: None,
        locks: Sequence[RecordLock] = (),
        on_found: Callable[[str], None] = lambda _words: None,
    ) -> None:
        """``stamp``: returns the number of STOPs so far; each request carries it from then on.

        ``locks``: further locks, made again where somebody removes them; ``on_found`` is called
        then.
        """
        self._handler = handler
        self._stamp = stamp
        self._address = socket_address(path)
        self._own_lock = EngineLock(path) if lock is None else None
        self._locks = (lock or self._own_lock, *locks)
        self._on_found = on_found
        self._closing = threading.Event()
        self._waiting: queue.Queue[WaitingRequest | None] = queue.Queue(MAX_WAITING)
        self._connections: set[Connection] = set()
        self._later = threading.BoundedSemaphore(MAX_LATER)
        self._spare: list[Connection] = []
        self._lock = threading.Lock()
        self._is_closing = False
        self._listener: socket.socket | None = None
        self._inode = 0
        self._threads: list[threading.Thread] = []

    def start(self) -> None:
        """Start listening, in place of the socket of an engine that died.

        Raises ControlError when an engine runs already, and where no socket can be made.
        """
        if self._own_lock is not None:
            self._own_lock.acquire()
        try:
            listener = self._listening()
        except (OSError, ControlError) as error:
            if self._own_lock is not None:
                self._own_lock.release()
            raise ControlError(
                f"the engine cannot listen at {self._address}: {error}; remove what lies there"
            ) from error
        self._listener = listener
        for name, target in (
            ("control-accept", partial(self._accept, listener)),
            ("control-work", self._work),
            ("control-keep", self._keep),
        ):
            thread = threading.Thread(target=target, name=name, daemon=True)
            thread.start()
            self._threads.append(thread)

    def _listening(self) -> socket.socket:
        """Return a new socket at the engine's place. Raises OSError or ControlError."""
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._address.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            aside = remove_socket(self._address)
            listener.bind(str(self._address))
            self._address.chmod(0o600)
            listener.listen(BACKLOG)
        except (OSError, ControlError):
            listener.close()
            raise
        self._inode = self._address.lstat().st_ino
        if aside is not None:
            self._on_found(f"{self._address} was no socket: what lay there is now {aside}")
        return listener

    def _keep(self) -> None:
        """Make socket and locks again where somebody removes them: a logout, a cleaning job.

        Without its socket the engine can be reached by signals alone, without its lock a second one
        starts on the same mount.
        """
        said = ""
        while not self._closing.wait(KEEP_S):
            try:
                words = self._kept()
            except Exception as error:  # the thread that keeps STOP reachable must not end
                words = f"the engine's socket or lock was removed and cannot be made again: {error}"
            if words and words != said:
                self._on_found(words)
            said = words if "cannot" in words else ""

    def _kept(self) -> str:
        """Put back socket and locks; return what was missing, in words, else empty."""
        again, failed = [], ""
        for lock in self._locks:
            try:
                again.append(lock is not None and lock.keep())
            except (OSError, ControlError) as error:
                failed = f"the engine's lock cannot be made again: {error}"
        if not self._is_reachable():
            with self._lock:
                if self._is_closing:
                    return ""
                old, self._listener = self._listener, self._listening()
                thread = threading.Thread(
                    target=self._accept, args=(self._listener,), name="control-accept", daemon=True
                )
                thread.start()
                self._threads.append(thread)
            if old is not None:
                _shut(old)
            return f"the engine's socket was removed: it listens at {self._address} again"
        return failed or ("the engine's lock was removed: it holds a new one" if any(again) else "")

    def _is_reachable(self) -> bool:
        try:
            return self._address.lstat().st_ino == self._inode
        except OSError:
            return False

    def close(self, timeout_s: float = 2.0) -> None:
        """Stop listening, drop the connections and remove the socket."""
        with self._lock:
            if self._is_closing or self._listener is None:
                return
            self._is_closing = True
            connections = [*self._connections, *self._spare]
        self._closing.set()
        _shut(self._listener)
        for connection in connections:
            connection.close()
        with contextlib.suppress(queue.Full):
            self._waiting.put_nowait(None)
        for thread in self._threads:
            if thread is not threading.current_thread():  # a handler may close the wire itself
                thread.join(timeout_s)
        if self._is_reachable():
            remove_socket(self._address)
        if self._own_lock is not None:
            self._own_lock.release()

    def __enter__(self) -> "ControlServer":
        self.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _accept(self, listener: socket.socket) -> None:
        while True:
            try:
                peer, _ = listener.accept()
            except OSError:
                if self._is_closing or listener is not self._listener:
                    return
                time.sleep(0.1)  # out of file handles: some come back when a console leaves
                continue
            connection = Connection(peer)
            if not is_same_user(peer):
                message = "this engine belongs to another user"
                connection.answer(None, Outcome(ok=False, message=message))
                connection.close()
                continue
            with self._lock:
                if self._is_closing:
                    connection.close()
                    return
                is_spare = len(self._connections) >= MAX_CONNECTIONS
                # Who has said nothing yet makes room for who may want to say STOP.
                is_full = is_spare and len(self._spare) >= SPARE
                crowded_out = self._spare.pop(0) if is_full else None
                (self._spare.append if is_spare else self._connections.add)(connection)
            if crowded_out is not None:
                crowded_out.close()
            serve = self._serve_spare if is_spare else self._serve
            try:
                threading.Thread(
                    target=serve, args=(connection,), name="control-peer", daemon=True
                ).start()
            except RuntimeError:  # no more threads: some end when a console leaves
                self._drop(connection)

    def _drop(self, connection: "Connection") -> None:
        with self._lock:
            self._connections.discard(connection)
            if connection in self._spare:
                self._spare.remove(connection)
        connection.close()

    def _serve(self, connection: "Connection") -> None:
        try:
            for line in connection.lines():
                self._take(connection, line)
        except (OSError, ValueError):
            pass  # the peer went away, or sent a line without end: it was told so
        finally:
            self._drop(connection)

    def _serve_spare(self, connection: "Connection") -> None:
        """Serve one command of a peer beyond the usual places: STOP, or it is sent away."""
        try:
            line = next(connection.lines(), None)
            with self._lock:
                # What has spoken is not crowded out.
                if connection in self._spare:
                    self._spare.remove(connection)
            if line is not None and self._is_stop(connection, line):
                self._take(connection, line)
            elif line is not None:
                crowded = f"{MAX_CONNECTIONS} consoles are connected already: close one"
                connection.answer(None, Outcome(ok=False, message=crowded))
        except (OSError, ValueError):
            pass
        finally:
            self._drop(connection)

    @staticmethod
    def _is_stop(connection: "Connection", line: bytes) -> bool:
        try:
            return isinstance(read_request(connection, line).request.command, Stop)
        except ControlError:
            return False

    def _take(self, connection: "Connection", line: bytes) -> None:
        stamp = self._stamp()
        try:
            read = read_request(connection, line)
        except ControlError as error:
            request_id = error.request_id if isinstance(error, NotACommand) else None
            connection.answer(request_id, Outcome(ok=False, message=str(error)))
            return
        waiting = replace(read, request=replace(read.request, stamp=stamp))
        if waiting.request.command.is_immediate:
            self._answer(waiting, self._carry_out(waiting.request))
            return
        try:
            self._waiting.put_nowait(waiting)
        except queue.Full:
            busy = f"{MAX_WAITING} commands wait already: try again"
            connection.answer(waiting.id, Outcome(ok=False, message=busy))

    def _work(self) -> None:
        while not self._is_closing:
            waiting = self._waiting.get()
            if waiting is None:
                return
            if time.monotonic() > waiting.deadline:
                late = Outcome(ok=False, message="the engine was busy for too long: not done")
                waiting.connection.answer(waiting.id, late)
            else:
                self._answer(waiting, self._carry_out(waiting.request))

    def _answer(self, waiting: WaitingRequest, outcome: Outcome | PendingOutcome) -> None:
        if isinstance(outcome, Outcome):
            waiting.connection.answer(waiting.id, outcome)
            return
        later = outcome

        def answer(deadline: float) -> None:
            waiting.connection.answer(waiting.id, later.outcome(deadline))

        def wait() -> None:
            try:
                answer(waiting.deadline)
            finally:
                self._later.release()

        if not self._later.acquire(blocking=False):
            answer(0.0)
            return
        try:
            threading.Thread(target=wait, name="control-later", daemon=True).start()
        except RuntimeError:  # no more threads
            self._later.release()
            answer(0.0)

    def _carry_out(self, request: Request) -> Outcome | PendingOutcome:
        try:
            return self._handler(request)
        except Exception as error:  # whatever one command breaks, the wire stays
            words = f"{request.command.verb}: {error or type(error).__name__}"
            return Outcome(ok=False, message=words)


def _shut(listener: socket.socket) -> None:
    with contextlib.suppress(OSError):
        listener.shutdown(socket.SHUT_RDWR)
    listener.close()
