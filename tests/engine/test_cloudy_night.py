"""A night by hand, in a real terminal: take over, point, mark, start a track, hand back, name.

The demo's own engine and observatory; what is followed in the end was marked by the operator.
"""

import time
from pathlib import Path
from typing import Any

import pytest

from rsoconsole.control import AskStatus, ControlClient, Sender
from rsoconsole.records import Identified, OperatorAction, Ruling, StateChange, TrackState
from rsoconsole.session import SessionReader
from tests.engine.test_scripted_night import house, wait_for
from tests.rigs.terminal import READS_S, Terminal
from tests.rigs.whole_engine import COMMAND

__all__ = ["house"]
SIZE = (120, 40)
SPEED = "8"
FAR_LEFT, FAR_RIGHT = "\x1b[1;2D", "\x1b[1;2C"
pytestmark = [
    pytest.mark.timeout(240),
    pytest.mark.nightly("a night by hand in a terminal, on a quiet machine"),
]


def test_a_track_is_started_by_hand_and_handed_over(tmp_path: Path, house: dict[str, str]):
    session = tmp_path / "night"
    socket = tmp_path / "run" / "rsoconsole" / "engine.sock"

    def status() -> dict[str, Any]:
        return dict(ControlClient(socket, sender=Sender(name="test")).send(AskStatus()).data)

    def records(kind: type[Any]) -> list[Any]:
        return [record for _, _, record in SessionReader(session).records(kinds=(kind,))]

    def mark(seat: Terminal) -> None:
        """In the close-up, whose middle the streak is: 20 squares of 3 px to either end."""
        known = len(seat.text)
        seat.press("m")
        wait_for(lambda: seat.shows("mark the first end", since=known), "a mark begun", seat)
        _slowly(seat, FAR_LEFT, 4)
        seat.press("\r")
        wait_for(lambda: seat.shows("mark the second end", since=known), "its first end", seat)
        _slowly(seat, FAR_RIGHT, 8)
        seat.press("\r")

    demo = [*COMMAND, "demo", "--scenario", "intelsat-14", "--speed", SPEED]
    with Terminal([*demo, "--session", str(session)], house, SIZE) as seat:
        wait_for(lambda: status()["holder"] == "autonomy", "an armed engine", seat)
        wait_for(lambda: seat.shows("x STOP"), "a seat", seat)
        # Take over, and point.
        seat.press("g")
        wait_for(lambda: seat.shows("go to"), "the go-to dialog", seat)
        seat.press("INTELSAT 14")
        wait_for(lambda: seat.shows("way "), "the way there", seat)
        seat.press("\r")
        wait_for(
            lambda: status()["holder"] == "operator", "the mount in the operator's hands", seat
        )
        arrived = wait_for(lambda: _arrived_in(records), "an arrival", seat)
        # See it: the close-up of a frame taken there.
        wait_for(lambda: seat.shows(f"close-up {arrived + 1:04d}"), "its close-up", seat)
        seat.press("z")
        wait_for(lambda: seat.shows("picture: close-up"), "the close-up in the large pane", seat)
        # Mark it, in two frames.
        mark(seat)
        first = wait_for(lambda: records(Ruling), "the first mark")[0]
        wait_for(lambda: seat.shows("refined on the light beneath it"), "how good it is", seat)
        later = first.frame_id + 1
        wait_for(lambda: seat.shows(f"frame {later:04d} · 10 s · close-up"), "a later frame", seat)
        mark(seat)
        wait_for(lambda: status()["kept"], "a track by hand", seat)
        # Hand it back.
        seat.press("h")
        wait_for(lambda: status()["state"] == "TRACK", "the track that the marks began", seat)
        wait_for(lambda: [i for i in records(Identified) if i.matches], "a name", seat)
        # Look at a frame at full resolution: the demo keeps the last ones.
        seat.press("\r")
        wait_for(lambda: seat.shows("px a square"), "a frame at full resolution", seat)
        seat.press("\x1b")
        time.sleep(0.3)
        seat.press("q")
        wait_for(lambda: seat.shows("leave the console"), "what leaving would do", seat)
        time.sleep(READS_S)
        seat.press("s")
        wait_for(lambda: seat.process.poll() is not None, "the console's end", seat)
    marks = [decision.taken for decision in records(Ruling)]
    assert [each.source for each in marks] == ["operator", "operator"]
    # Refined: as good as the detector's own measurements, not as a hand's.
    assert all(max(each.cov_sky_arcsec2) < 4.0 for each in marks)
    (begun,) = [state for state in records(TrackState) if state.kind == "initial"]
    assert begun.begun_with == tuple(each.measurement_id for each in marks)
    assert "INTELSAT 14" in records(Identified)[-1].matches[0].name
    assert next(c.after for c in records(StateChange) if c.before == "MANUAL") == "COAST"
    verbs = [action.verb for action in records(OperatorAction)]
    for verb in ("goto", "mark", "resume", "shutdown"):
        assert verb in verbs, verb


def _slowly(seat: Terminal, key: str, times: int) -> None:
    for _ in range(times):
        seat.press(key)
        time.sleep(0.03)


def _arrived_in(records: Any) -> int | None:
    """The frame after which the telescope stood where it was sent."""
    from rsoconsole.records import Event

    found = [e.frame_id for e in records(Event) if "has arrived" in e.text]
    return found[-1] if found else None
