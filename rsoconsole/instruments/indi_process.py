"""A child process that speaks INDI: JSON lines in, JSON lines out, a deadline on everything.

The child ends when its stdin closes, so it never outlives this process. What it prints goes to
a log file, because libindi writes to the terminal.
"""

import contextlib
import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rsoconsole.errors import InstrumentError

SERVER_LOST = 3
"""Exit status of a child whose INDI server went away."""
_START_S = 20.0
_END_S = 3.0


class IndiProcess:
    """One child, restarted on the next request after it died; safe for several threads."""

    def __init__(
        self,
        *,
        name: str,
        module: str,
        settings: Mapping[str, Any],
        log_path: Path,
        on_event: Callable[[dict[str, Any]], None],
        descriptors: tuple[int, ...] = (),
    ) -> None:
        """Describe the child (``python -m module``); ``start`` makes it.

        ``on_event`` gets every line that answers no request, on the reader's thread.
        """
        self.name, self._module, self._settings = name, module, dict(settings)
        self._log_path, self._on_event, self._descriptors = log_path, on_event, descriptors
        self._process: subprocess.Popen[bytes] | None = None
        self._answers: dict[int, dict[str, Any]] = {}
        self._changed = threading.Condition()
        self._starting = threading.RLock()
        self._writing = threading.Lock()
        self._next_id = 0
        self._is_closed = False

    @property
    def pid(self) -> int | None:
        """Process number of the living child."""
        process = self._process
        return process.pid if process is not None and process.poll() is None else None

    def start(self) -> None:
        """Make the child and wait for its greeting. Raises InstrumentError."""
        with self._starting:
            if self.pid is not None:
                return
            if self._is_closed:
                raise InstrumentError(f"the {self.name} has been closed: connect again")
            if self._process is not None:
                self._end(self._process)
            self._log_path.parent.mkdir(parents=True, exist_ok=True)
            with self._log_path.open("ab") as log:
                process = subprocess.Popen(
                    [sys.executable, "-m", self._module],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=log,
                    pass_fds=self._descriptors,
                    # Ctrl+C is the engine's to handle: it stops the mount through this child.
                    start_new_session=True,
                )
            self._process = process
            threading.Thread(
                target=self._read, args=(process,), daemon=True, name=f"{self.name} reader"
            ).start()
            try:
                self._ask(process, "start", _START_S, self._settings)
            except InstrumentError:
                self._end(process)
                raise

    def restart(self) -> None:
        """A fresh child in place of this one, dead or alive. Raises InstrumentError."""
        with self._starting:
            if self._process is not None:
                self._process.kill()
                self._end(self._process)
            self.start()

    def request(self, verb: str, timeout_s: float, **arguments: Any) -> dict[str, Any]:
        """Have the child do something and return its answer.

        Starts the child first where it has died since the last request. Raises InstrumentError
        when the child refuses, dies or does not answer in time.
        """
        if self.pid is None:
            self.start()
        process = self._process
        assert process is not None
        return self._ask(process, verb, timeout_s, arguments)

    def wait(
        self, is_done: Callable[[], bool], timeout_s: float, *, starts_again: bool = True
    ) -> bool:
        """Wait for something that ``on_event`` brings about; False when it did not.

        A child that is dead already is started again, unless what is waited for died with it.
        Raises InstrumentError when the child dies meanwhile.
        """
        if starts_again and self.pid is None:
            self.start()
        process = self._process
        if process is None:
            raise InstrumentError(f"the {self.name} is not connected: start it first")
        deadline_s = time.monotonic() + timeout_s
        with self._changed:
            while not is_done():
                if process.poll() is not None:
                    raise self._died(process)
                left_s = deadline_s - time.monotonic()
                if left_s <= 0:
                    return False
                self._changed.wait(min(left_s, 0.5))
        return True

    def close(self) -> None:
        """End the child by closing its stdin; kill it where that does not help."""
        with self._starting:
            self._is_closed = True
            if self._process is not None:
                self._end(self._process)

    def _ask(
        self,
        process: "subprocess.Popen[bytes]",
        verb: str,
        timeout_s: float,
        arguments: Mapping[str, Any],
    ) -> dict[str, Any]:
        with self._writing:
            self._next_id += 1
            number = self._next_id
            line = json.dumps({"id": number, "verb": verb, **arguments}).encode() + b"\n"
            try:
                assert process.stdin is not None
                process.stdin.write(line)
                process.stdin.flush()
            except (OSError, ValueError) as error:
                raise self._died(process) from error
        deadline_s = time.monotonic() + timeout_s
        with self._changed:
            while number not in self._answers:
                left_s = deadline_s - time.monotonic()
                if process.poll() is not None and process.stdout is None:
                    raise self._died(process)
                if left_s <= 0:
                    raise InstrumentError(
                        f"the {self.name} did not answer '{verb}' in {timeout_s:.1f} s: "
                        f"see {self._log_path}"
                    )
                self._changed.wait(min(left_s, 0.5))
            answer = self._answers.pop(number)
        if "error" in answer:
            raise InstrumentError(answer["error"])
        return answer

    def _read(self, process: "subprocess.Popen[bytes]") -> None:
        assert process.stdout is not None
        for line in process.stdout:
            message = json.loads(line)
            with self._changed:
                if "id" in message:
                    self._answers[message["id"]] = message
                else:
                    self._on_event(message)
                self._changed.notify_all()
        process.wait()
        with self._changed:
            process.stdout.close()
            process.stdout = None
            self._changed.notify_all()

    def _end(self, process: "subprocess.Popen[bytes]") -> None:
        with contextlib.suppress(OSError, ValueError):
            assert process.stdin is not None
            process.stdin.close()
        try:
            process.wait(_END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def _died(self, process: "subprocess.Popen[bytes]") -> InstrumentError:
        if process.poll() == SERVER_LOST:
            return InstrumentError(
                f"the INDI server went away under the {self.name}: start indiserver again"
            )
        return InstrumentError(
            f"the {self.name}'s process ended (status {process.poll()}): it is started again "
            f"with the next order; its last words are in {self._log_path}"
        )
