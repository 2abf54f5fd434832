"""A child process that speaks INDI: JSON lines to it, JSON lines from it, each with a deadline.

The child ends when its stdin closes, so it never outlives this process for long. What it prints
goes to a log file, because libindi writes to the terminal.
"""

import contextlib
import json
import logging
import select
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsoconsole.base import InstrumentError, LongWait

if TYPE_CHECKING:  # the children start without
    from rsoconsole.config import IndiConfig, WaitsConfig

log = logging.getLogger(__name__)

SERVER_LOST = 3
DEVICE_LOST = 4
"""Exit status of a child whose driver came back unconnected, or another client disconnected."""
_START_S = 150.0
"""Default time limit of a start; the configuration's ``waits`` take precedence."""
_END_S = 3.0
_LEAVE_S = 10.0
"""Time for an orderly end, s: a mount's process first stops the mount."""
_STATUS_S = 1.0
_SEND_S = 0.1
_HUNG_S = 3.0
_LOOK_S = 0.5
ARE_YOU_THERE = "are you there"
WAITING = "waiting"
"""Name of the event by which a starting child reports what it waits for."""
AT_ONCE = frozenset(("abort",))
"""Orders that do not wait for a child to finish starting: there is a second path for them."""
END = "end"
"""Order for an orderly end; a parent that crashes sends none."""


def device_settings(
    kind: str, device: str, config: "IndiConfig", waits: "WaitsConfig"
) -> dict[str, Any]:
    """Return the settings that a child starts with: server, device, and how long to wait.

    ``kind``: "mount" or "camera", the key of ``indi`` that names the device.
    """
    return {
        "client": config.client,
        "host": config.host,
        "port": config.port,
        "device": device,
        "setting": f"indi.{kind}",
        "device_s": waits.device_s,
        "quiet_s": waits.quiet_s,
        "answer_s": waits.answer_s,
    }


def drain_messages(messages: deque[str]) -> tuple[str, ...]:
    """Remove and return all messages of a queue to which other threads may add."""
    taken = []
    while messages:
        taken.append(messages.popleft())
    return tuple(taken)


class _LateError(InstrumentError):
    """Raised where no answer came in time."""


class IndiProcess:
    """One child process; a dead one is replaced with the next request. Thread-safe."""

    def __init__(
        self,
        *,
        name: str,
        module: str,
        settings: Mapping[str, Any],
        log_path: Path,
        on_event: Callable[[dict[str, Any]], None],
        descriptors: tuple[int, ...] = (),
        start_s: float = _START_S,
        on_start: Callable[[], Mapping[str, Any]] = dict,
    ) -> None:
        """Describe the child (``python -m module``); ``start`` makes it and waits ``start_s``.

        ``on_event`` gets every line that answers no request, on the reader's thread. ``on_start``
        returns further settings for a child that is started now.
        """
        self._start_s, self._on_start = start_s, on_start
        self._awaits = ""
        self.name, self._module, self._settings = name, module, dict(settings)
        self._log_path, self._on_event, self._descriptors = log_path, on_event, descriptors
        self._process: subprocess.Popen[bytes] | None = None
        self._open: set[int] = set()
        """Numbers of the requests with a waiting caller; an answer to any other is dropped."""
        self._answers: dict[int, dict[str, Any]] = {}
        self._changed = threading.Condition()
        self._starting = threading.RLock()
        self._writing = threading.Lock()
        self._next_id = 0
        self._is_closed = False

    @property
    def pid(self) -> int | None:
        """Process id of the living child; None where no child lives."""
        process = self._process
        return process.pid if process is not None and process.poll() is None else None

    def start(self) -> None:
        """Start the child and wait until it is connected. Raises InstrumentError."""
        with self._starting:
            if self.pid is not None:
                return
            if self._is_closed:
                raise InstrumentError(f"the {self.name} has been closed: connect again")
            dead = self._process
            if dead is not None:
                self._end(dead)
            self._log_path.parent.mkdir(parents=True, exist_ok=True)
            with self._log_path.open("ab") as printed:
                process = subprocess.Popen(
                    [sys.executable, "-m", self._module],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=printed,
                    pass_fds=self._descriptors,
                    # Ctrl+C is the engine's to handle: it stops the mount through this child.
                    start_new_session=True,
                )
            self._process = process
            threading.Thread(
                target=self._read, args=(process,), daemon=True, name=f"{self.name} reader"
            ).start()
            try:
                self._await_start(process)
            except InstrumentError:
                self._end(process)
                raise
            if dead is not None:
                words = "the %s's process had ended (status %s): another one is at work"
                log.warning(words, self.name, dead.returncode)

    def _await_start(self, process: "subprocess.Popen[bytes]") -> None:
        self._awaits = f"the {self.name}'s process to start"
        wait = LongWait(self._awaits)
        try:
            settings = {**self._settings, **self._on_start()}
            answer = self._ask(process, "start", self._start_s, settings, wait)
        except _LateError as error:
            raise InstrumentError(
                f"waited {wait.waited_s:.0f} s for {self._awaits}: on a machine that slow raise "
                f"waits.process_s or waits.device_s; {self._log_path} may tell more"
            ) from error
        if "client" in answer:
            log.info("the %s speaks INDI by %s", self.name, answer["client"])

    def restart(self) -> None:
        """End the child, dead or alive, and start a new one. Raises InstrumentError."""
        with self._starting:
            if self._process is not None:
                self._process.kill()
                self._end(self._process)
                self._process = None
            self.start()

    def request(self, verb: str, timeout_s: float, **arguments: Any) -> dict[str, Any]:
        """Send a request to the child and return its answer.

        Starts the child first where it has died since the last request. Raises InstrumentError
        when the child refuses, dies, is still being started or does not answer in time.
        """
        if self.pid is None:
            self.start()
        elif verb not in AT_ONCE:
            # Somebody else may have it started at this moment.
            if not self._starting.acquire(timeout=timeout_s):
                raise InstrumentError(f"the {self.name} is being connected: {self._awaits}")
            self._starting.release()
        process = self._process
        assert process is not None
        try:
            return self._ask(process, verb, timeout_s, arguments)
        except _LateError:
            self.end_if_hung(process)
            raise

    def end_if_hung(self, process: "subprocess.Popen[bytes] | None" = None) -> None:
        """Kill the child if it no longer responds; the next request starts a new one.

        ``process``: which child to ask; None: the present one.
        """
        process = process or self._process
        if process is None:
            return
        try:
            # Whatever it answers, it does so at once, beside all its other work.
            self._ask(process, ARE_YOU_THERE, _HUNG_S, {})
        except _LateError:
            log.warning("the %s's process hangs: it is ended", self.name)
            process.kill()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(_STATUS_S)
        except InstrumentError:
            return

    def send(self, verb: str, **arguments: Any) -> bool:
        """Send an order without waiting; return False where it cannot be sent at once.

        Waits for no answer, starts no child, and does not hang on a child that reads nothing.
        """
        process = self._process
        if process is None or process.stdin is None or process.poll() is not None:
            return False
        if not self._writing.acquire(timeout=_SEND_S):
            return False
        try:
            _, line = self._line(verb, arguments)
            poll = select.poll()
            poll.register(process.stdin.fileno(), select.POLLOUT)
            # A pipe with any room takes a short line whole.
            if not any(event == select.POLLOUT for _, event in poll.poll(0)):
                return False
            process.stdin.write(line)
            process.stdin.flush()
        except (OSError, ValueError):
            return False
        finally:
            self._writing.release()
        return True

    def wait(
        self, is_done: Callable[[], bool], timeout_s: float, *, starts_again: bool = True
    ) -> bool:
        """Wait until ``is_done`` returns True; return False where it has not within ``timeout_s``.

        ``is_done`` is called after each message of the child. ``starts_again``: whether a child
        that has died is started first; False where a new child could not fulfil the condition.
        Raises InstrumentError when the child dies during the wait.
        """
        if starts_again and self.pid is None:
            self.start()
        process = self._process
        if process is None:
            raise InstrumentError(f"the {self.name} is not connected: start it first")
        deadline_s = time.monotonic() + timeout_s
        with self._changed:
            while not is_done():
                if process.stdout is None:
                    raise self._died(process)
                left_s = deadline_s - time.monotonic()
                if left_s <= 0:
                    return False
                self._changed.wait(min(left_s, _LOOK_S))
        return True

    def close(self) -> None:
        """Order the child to end and close its stdin; kill it where it does not end."""
        with self._starting:
            self._is_closed = True
            if self._process is not None:
                self.send(END)
                self._end(self._process, _LEAVE_S)

    def _ask(
        self,
        process: "subprocess.Popen[bytes]",
        verb: str,
        timeout_s: float,
        arguments: Mapping[str, Any],
        wait: LongWait | None = None,
    ) -> dict[str, Any]:
        """Answer of the child. Raises _LateError, and InstrumentError when it refuses or dies
        first.

        ``wait`` states the reason of the wait, as the child reports it.
        """
        number = self._send(process, verb, arguments)
        deadline_s = time.monotonic() + timeout_s
        with self._changed:
            try:
                while number not in self._answers:
                    left_s = deadline_s - time.monotonic()
                    if process.stdout is None:
                        raise self._died(process)
                    if left_s <= 0:
                        raise _LateError(
                            f"the {self.name} did not answer '{verb}' in {timeout_s:.1f} s: "
                            f"see {self._log_path}"
                        )
                    if wait is not None:
                        wait.what = self._awaits
                        wait.log_if_due()
                    self._changed.wait(min(left_s, _LOOK_S))
                answer = self._answers[number]
            finally:
                self._open.discard(number)
                self._answers.pop(number, None)
        if "error" in answer:
            raise InstrumentError(str(answer["error"]))
        return answer

    def _send(
        self, process: "subprocess.Popen[bytes]", verb: str, arguments: Mapping[str, Any]
    ) -> int:
        """Send a request; return its number."""
        with self._writing:
            number, line = self._line(verb, arguments)
            self._open.add(number)
            try:
                assert process.stdin is not None
                process.stdin.write(line)
                process.stdin.flush()
            except (OSError, ValueError) as error:
                self._open.discard(number)
                raise self._died(process) from error
        return number

    def _line(self, verb: str, arguments: Mapping[str, Any]) -> tuple[int, bytes]:
        """Number and line of a request; under the lock of writing."""
        self._next_id += 1
        order = {"id": self._next_id, "verb": verb, **arguments}
        return self._next_id, json.dumps(order).encode() + b"\n"

    def _read(self, process: "subprocess.Popen[bytes]") -> None:
        """Distribute the child's lines until it can send no more; then it counts as dead."""
        stdout = process.stdout
        assert stdout is not None
        try:
            for line in stdout:
                self._take(line)
        finally:
            # A child that lives on without its voice is of no use and must not be waited for.
            _reap(process, _END_S)
            with self._changed:
                stdout.close()
                process.stdout = None
                self._changed.notify_all()

    def _take(self, line: bytes) -> None:
        """Handle one line of the child; an invalid one (a killed child's last) is skipped."""
        try:
            message = json.loads(line)
            if not isinstance(message, dict):
                raise ValueError("not an object")
        except ValueError as error:
            log.warning("the %s said %r: %s", self.name, line[:200], error)
            return
        with self._changed:
            if message.get("event") == WAITING:
                self._awaits = str(message["what"])
            elif "id" not in message:
                self._dispatch(message)
            elif message["id"] in self._open:
                self._answers[message["id"]] = message
            self._changed.notify_all()

    def _dispatch(self, message: dict[str, Any]) -> None:
        try:
            self._on_event(message)
        except Exception:  # what one message breaks must not silence all later ones
            log.exception("the %s said something that cannot be used: %s", self.name, message)

    def _end(self, process: "subprocess.Popen[bytes]", patience_s: float = _END_S) -> None:
        with contextlib.suppress(OSError, ValueError):
            assert process.stdin is not None
            process.stdin.close()
        _reap(process, patience_s)

    def _died(self, process: "subprocess.Popen[bytes]") -> InstrumentError:
        # Its pipe may break a moment before its status is there.
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(_STATUS_S)
        if process.poll() == SERVER_LOST:
            return InstrumentError(
                f"the INDI server went away under the {self.name}: start indiserver again"
            )
        if process.poll() == DEVICE_LOST:
            return InstrumentError(
                f"the {self.name} is no longer connected: its driver was started again, or another"
                " program disconnected it; the next order connects it again"
            )
        return InstrumentError(
            f"the {self.name}'s process ended (status {process.poll()}): it is started again "
            f"with the next order; its last words are in {self._log_path}"
        )


def _reap(process: "subprocess.Popen[bytes]", patience_s: float) -> None:
    """Wait for a process to end; kill it where it takes longer."""
    try:
        process.wait(patience_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
