"""The system clock under libfaketime (apt install faketime): steps, half and twice the speed.

The clock alone: a whole engine does not run there, because libfaketime 0.9.10 fails Python's
``time.sleep`` with EINVAL as soon as monotonic time is left as it is. What the engine makes of each
fault is held with an injected clock (test_interruptions.py).
"""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

LIBRARIES = [
    path
    for folder in ("/usr/lib", "/usr/local/lib")
    for path in Path(folder).glob("**/faketime/libfaketimeMT.so.1")
]
WATCHER = """
import sys
from rsoconsole.instruments import clock_watch
clock_watch.STEADY_S = 1.0
from rsoconsole.instruments.observatory.clock import SystemClock
clock = SystemClock()
print("ready", flush=True)
while True:
    clock.wait_until(clock.now_utc_ns() + 10**8)
    for fault in clock.take_faults():
        print(fault.kind, round(fault.seconds), round(fault.rate, 1), flush=True)
"""
PATIENCE_S = 30.0


class Faked:
    """A process that watches its clock, and the clock."""

    def __init__(self, folder: Path) -> None:
        self._time = folder / "time"
        self.set("+0 x1")
        self._said = folder / "said.txt"
        with self._said.open("w", encoding="utf-8") as said:
            self.process = subprocess.Popen(
                [sys.executable, "-c", WATCHER],
                stdout=said,
                env={
                    **os.environ,
                    "LD_PRELOAD": str(LIBRARIES[0]),
                    "FAKETIME_TIMESTAMP_FILE": str(self._time),
                    "FAKETIME_NO_CACHE": "1",
                    "FAKETIME_DONT_FAKE_MONOTONIC": "1",
                },
            )
        self.hears("ready")

    def set(self, words: str) -> None:
        """In one go: half a file would be another time."""
        beside = self._time.with_suffix(".new")
        beside.write_text(words + "\n", encoding="utf-8")
        beside.replace(self._time)

    def hears(self, words: str) -> None:
        """Wait until that has been said."""
        ends_s = time.monotonic() + PATIENCE_S
        while words not in self.said():
            assert time.monotonic() < ends_s, f"no {words!r} in {self.said()}"
            time.sleep(0.05)

    def said(self) -> list[str]:
        return self._said.read_text(encoding="utf-8").splitlines()

    def close(self) -> None:
        self.process.kill()
        self.process.wait()


@pytest.fixture
def faked(tmp_path: Path) -> Iterator[Faked]:
    if not LIBRARIES:
        pytest.skip("needs libfaketime: apt install faketime")
    with closing(Faked(tmp_path)) as running:
        yield running


def test_steps_of_a_second_and_of_an_hour_are_each_named(faked: Faked):
    faked.set("+1 x1")
    faked.hears("set 1 1.0")
    faked.set("+0 x1")
    faked.hears("set -1 1.0")
    faked.set("+3600 x1")
    faked.hears("set 3600 1.0")
    faked.set("+0 x1")
    faked.hears("set -3600 1.0")
    assert not [words for words in faked.said() if words.startswith("runs wrong")]


@pytest.mark.parametrize("rate", ["2.0", "0.5"])
def test_a_clock_at_half_or_twice_the_speed_is_named_and_recovers(faked: Faked, rate: str):
    faked.set(f"+0 x{rate}")
    ends_s = time.monotonic() + PATIENCE_S
    while not (wrong := [w for w in faked.said() if w.startswith("runs wrong")]):
        assert time.monotonic() < ends_s, faked.said()
        time.sleep(0.05)
    measured = float(wrong[0].split()[-1])
    half_of_it = abs(float(rate) - 1.0) / 2.0
    assert measured == pytest.approx(float(rate), abs=half_of_it)
    faked.set("+0 x1")
    ends_s = time.monotonic() + PATIENCE_S
    while not any(words.startswith("runs right") for words in faked.said()):
        assert time.monotonic() < ends_s, faked.said()
        time.sleep(0.05)
