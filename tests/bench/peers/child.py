"""A child process that runs one peer frame by frame, so that time-out and memory are its own.

``python -m tests.bench.peers.child NAME SETTINGS_JSON``: paths of pickled frames come in, one a
line; for each a JSON object goes out. Memory is the highest resident size of this process; one that
asks for more than ``MAX_MEMORY_GIB`` or ``MAX_CPU_S`` gets an error instead, not the machine.
"""

import contextlib
import json
import os
import pickle
import resource
import select
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Mapping
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any

from tests.bench.peers.roster import PEERS

CORES = "2"
MAX_MEMORY_GIB = 10
MAX_CPU_S = 300.0
"""Of the processor a frame: other work on the machine must not decide what is found."""


def main() -> None:
    """Serve until the input ends."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY_GIB << 30, resource.RLIM_INFINITY))
    signal.signal(signal.SIGPROF, _give_up)
    find = PEERS[sys.argv[1]].open(json.loads(sys.argv[2]))
    for row in sys.stdin:
        frame = pickle.loads(Path(row.strip()).read_bytes())
        _forget_peak()
        before_mb = _peak_mb()
        began, began_cpu = time.perf_counter(), _cpu_s()
        signal.setitimer(signal.ITIMER_PROF, MAX_CPU_S)
        try:
            candidates = find(frame)
        except Exception:
            answer: dict[str, Any] = {"error": traceback.format_exc(limit=-3)}
        else:
            answer = {
                "wall_s": time.perf_counter() - began,
                "cpu_s": _cpu_s() - began_cpu,
                "peak_mb": _peak_mb(),
                "extra_mb": _peak_mb() - before_mb,
                "candidates": [
                    [c.line.x_a_px, c.line.y_a_px, c.line.x_b_px, c.line.y_b_px, c.score]
                    for c in candidates
                ],
            }
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


def _give_up(_number: int, _stack: FrameType | None) -> None:
    raise TimeoutError(f"no answer in {MAX_CPU_S:g} s of the processor")


def _forget_peak() -> None:
    """Let the kernel count this process's highest memory again (Linux)."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _peak_mb() -> float:
    for row in Path("/proc/self/status").read_text().splitlines():
        if row.startswith("VmHWM"):
            return float(row.split()[1]) / 1024
    return float("nan")


def _cpu_s() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


class Child:
    """The parent's end of one such process; started when first needed, and after a time-out."""

    def __init__(self, name: str, settings: Mapping[str, Any], log: Path) -> None:
        module = "tests.bench.peers.child"
        self._command = [PEERS[name].python(), "-m", module, name, json.dumps(dict(settings))]
        self._log = log
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> "Child":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._end()

    def ask(self, frame_path: Path, timeout_s: float) -> dict[str, Any]:
        """The child's answer, or {"error": why} after a time-out or a crash."""
        process = self._process or self._start()
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(f"{frame_path}\n")
        process.stdin.flush()
        if not select.select([process.stdout], [], [], timeout_s)[0]:
            self._end()
            return {"error": f"no answer in {timeout_s:g} s"}
        row = process.stdout.readline()
        if not row:
            self._end()
            return {"error": f"the process ended: see {self._log}"}
        answer: dict[str, Any] = json.loads(row)
        return answer

    def _start(self) -> "subprocess.Popen[str]":
        threads = {f"{library}_NUM_THREADS": CORES for library in ("OMP", "OPENBLAS", "MKL")}
        with self._log.open("a") as log:
            self._process = subprocess.Popen(
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
                env=os.environ | threads,
                start_new_session=True,
            )
        return self._process

    def _end(self) -> None:
        if self._process is None:
            return
        # Its own children too: it leads a process group of its own.
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._process = None


if __name__ == "__main__":
    main()
