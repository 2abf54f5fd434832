"""A night at the console from the first command to the last key: real processes, a real terminal.

The demo's own engine and observatory by their defaults, with clouds that come and go. What the
console was asked to be is seen: the live picture, detection confidence, residuals in their 3-sigma
bounds; keys arm autonomous acquisition, override slews, and tune tau, Q and R live. The operator
arms, marks a streak by hand, tunes, nudges, hands back, loses the line, comes back, stops, parks
and leaves.
"""

import contextlib
import os
import re
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from rsoconsole.base import ControlError, SessionError
from rsoconsole.console.words.tunable import NAMES
from rsoconsole.control import AskStatus, ControlClient, Sender
from rsoconsole.records import Measurement, OperatorAction, ParameterChange, Ruling, StateChange
from rsoconsole.session import SessionReader
from tests.rigs.terminal import READS_S, Terminal
from tests.rigs.whole_engine import COMMAND

SIZE = (120, 40)
SPEED = "12"
PATIENCE_S = 90.0
pytestmark = [pytest.mark.nights, pytest.mark.timeout(600)]


@pytest.fixture
def house(tmp_path: Path) -> Iterator[dict[str, str]]:
    """An environment of its own; whatever is left in it at the end is ended."""
    run = tmp_path / "run"
    run.mkdir(mode=0o700)
    homes = {f"XDG_{name}_HOME": str(tmp_path / name) for name in ("DATA", "STATE", "CACHE")}
    environment = {
        **os.environ,
        **homes,
        "XDG_RUNTIME_DIR": str(run),
        "RSOCONSOLE_CONFIG": str(tmp_path / "config.toml"),
    }
    yield environment
    mark = f"XDG_RUNTIME_DIR={run}".encode()
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and int(entry.name) != os.getpid():
            with contextlib.suppress(OSError):
                if mark in (entry / "environ").read_bytes().split(b"\0"):
                    os.kill(int(entry.name), signal.SIGKILL)


def wait_for(is_so: Callable[[], Any], what: str, seat: Terminal | None = None) -> Any:
    ends_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            found = is_so()
        except (ControlError, SessionError, FileNotFoundError):
            found = None
        if found:
            return found
        seen = "" if seat is None else seat.text[-9000:]
        assert time.monotonic() < ends_s, f"there was no sign of: {what}; {seen}"
        time.sleep(0.05)


def test_a_night_at_the_console(tmp_path: Path, house: dict[str, str]):
    session = tmp_path / "night"
    socket = tmp_path / "run" / "rsoconsole" / "engine.sock"

    def status() -> dict[str, Any]:
        return dict(ControlClient(socket, sender=Sender(name="test")).send(AskStatus()).data)

    def records(kind: type[Any]) -> list[Any]:
        return [record for _, _, record in SessionReader(session).records(kinds=(kind,))]

    demo = [*COMMAND, "demo", "--scenario", "cloud-bank", "--speed", SPEED]
    with Terminal([*demo, "--session", str(session)], house, SIZE) as seat:
        # Cold start; the demo arms itself: take it back, and arm by hand.
        wait_for(lambda: seat.shows("AUTO has the mount"), "an armed engine", seat)
        seat.press("a")
        wait_for(lambda: seat.shows("nobody has the mount"), "a disarmed engine", seat)
        time.sleep(1.0)  # a press right behind a disarming arms nothing
        seat.press("a")
        wait_for(lambda: status()["holder"] == "autonomy", "an armed engine again", seat)
        # Acquire.
        wait_for(lambda: status()["state"] == "TRACK", "a track", seat)
        seen = ("field", "close-up", "confidence", "residual", "bounds 3σ", "NIS")
        wait_for(lambda: seat.shows(*seen), "picture, confidence, residuals and bounds", seat)
        # A mark by hand in the middle of the close-up, where the satellite is.
        seat.press("zz")
        time.sleep(0.5)
        seat.press("m")
        time.sleep(0.3)
        for _ in range(5):
            seat.press("\x1b[D")
        seat.press("\r")
        for _ in range(10):
            seat.press("\x1b[C")
        seat.press("\r")
        decision = wait_for(lambda: records(Ruling), "the operator's mark")[0]
        assert decision.taken.source == "operator"
        assert any(m.source == "operator" for m in records(Measurement))
        # Tune tau, Q and R, with their effect shown first; each number comes in one read.
        seat.press("t")
        wait_for(lambda: seat.shows("as it was"), "the tuning pane", seat)
        wait_for(lambda: seat.shows("settles at", "gain RA δ"), "where the filter settles", seat)
        tuned = {"detector.tau": 0.12, "filter.q_multiplier": 100.0, "filter.r_multiplier": 1.25}
        assert list(tuned) == list(NAMES[:3])
        for after in tuned.values():
            seat.press(f"{after:g}\r")
            wait_for(lambda now=after: seat.shows(f"→ {now:g}"), "what is tried", seat)
            seat.press("\x1b[B")
        seat.press("\r")
        for name, after in tuned.items():
            change = wait_for(
                lambda of=name: [c for c in records(ParameterChange) if c.name == of],
                f"{name} on record",
            )[0]
            assert change.after == after
        wait_for(lambda: seat.shows("Q×100"), "the change in the plots", seat)
        seat.press("t")
        time.sleep(0.3)
        # Nudge, and hand back.
        seat.press("\x1b[A")
        wait_for(lambda: seat.shows("takes the mount from AUTO"), "what an arrow would do", seat)
        time.sleep(0.3)
        seat.press("\x1b[A")
        wait_for(
            lambda: seat.shows("YOU have the mount"), "the mount in the operator's hands", seat
        )
        seat.press("h")
        wait_for(
            lambda: status()["holder"] == "autonomy", "the mount back in autonomy's hands", seat
        )
        wait_for(lambda: "cloud" in _misses(records), "a cloud", seat)
        frames = status()["frame"]
        # The line is lost.
        seat.hang_up()
        wait_for(lambda: seat.process.poll() is not None, "the console's end", seat)
    wait_for(lambda: status()["frame"] > frames, "frames without a console")
    with Terminal([*COMMAND, "console"], house, SIZE) as seat:
        wait_for(lambda: seat.shows("the mount", "STOP"), "the seat again", seat)
        wait_for(lambda: re.search(r"frame 0*\d+", seat.text), "a picture", seat)
        seat.press("x")
        wait_for(lambda: seat.shows("motion ended"), "a stop", seat)
        wait_for(lambda: status()["holder"] == "nobody", "a disarmed engine", seat)
        seat.press("\x1b")
        time.sleep(0.3)
        seat.press("p")
        time.sleep(READS_S)
        seat.press("y")
        wait_for(lambda: status()["is_parked"], "a parked mount", seat)
        seat.press("q")
        wait_for(lambda: seat.shows("leave the console"), "what leaving would do", seat)
        time.sleep(READS_S)
        seat.press("s")
        wait_for(lambda: seat.process.poll() is not None, "the console's end", seat)
    wait_for(
        lambda: SessionReader(session).read_meta().get("is_closed") is True, "a closed session"
    )
    verbs = [action.verb for action in records(OperatorAction)]
    for verb in ("disarm", "arm", "mark", "set", "nudge", "resume", "stop", "park", "shutdown"):
        assert verb in verbs, verb
    assert [c.after for c in records(StateChange)].count("TRACK") >= 1


def _misses(records: Callable[[type[Any]], list[Any]]) -> str:
    from rsoconsole.records import Miss
    from rsoconsole.words import text

    return " ".join(text(miss.reason) for miss in records(Miss))
