"""Mounts as real drivers have them: what the operator is told, and what reaches the mount.

Each oddity was met in one of Debian's INDI drivers, or is one that a driver may have. The mount's
own motion is the judge; nothing that is told may rest on the driver's word alone.

In process, with a clock of its own, the same mounts are in ``instruments/test_odd_drivers.py``.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from rsoconsole.engine.tasks import parking
from tests.rigs.odd_engine import OddEngine, odd_engine
from tests.rigs.odd_mount import COORDINATES, PARK, TRACKING, Oddities
from tests.tiers import plain_first

Make = Callable[..., OddEngine]
EASILY_PARKED = "ha_deg=50"
"""On the side of the pier that its park position is on."""
SLEWING_S = 2.5
"""Into a slew: the mount is at full speed."""


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Make]:
    """An engine at a mount with these oddities."""
    with ExitStack() as stack:

        def made(oddities: str = "", **settings: Any) -> OddEngine:
            return stack.enter_context(odd_engine(Oddities.parse(oddities), tmp_path, **settings))

        yield made


def slewing(seat: OddEngine) -> OddEngine:
    """In the middle of a slew by hand."""
    assert seat.goto(50.0, 130.0).ok
    time.sleep(SLEWING_S)
    assert seat.moves()
    return seat


# ---- STOP ------------------------------------------------------------------------------------


@pytest.mark.nightly("a real engine at a mount in real time")
def test_a_mount_that_obeys_is_told_to_track_because_it_was_measured(make: Make):
    seat = slewing(make())
    last = seat.stop()
    assert (last.motion, seat.moves()) == ("tracks", False)
    assert last.answered_ms is not None
    assert last.measured_ms is not None
    assert last.answered_ms < 800 < last.measured_ms < 6000
    answer = dict(seat.orders)["stop"]
    assert (answer.ok, answer.data["motion"]) == (True, None)
    assert seat.alarms == [each for each in seat.alarms if each.startswith("STOP: ABORT sent")]
    assert seat.status().state == "IDLE"


@pytest.mark.nightly("a real engine at a mount in real time")
def test_with_stand_still_it_is_measured_to_stand(make: Make):
    seat = slewing(make(mount={"after_stop": "stand still"}))
    assert seat.stop().motion == "stands"


@pytest.mark.slow("a real engine at a mount in real time")
def test_a_driver_that_says_idle_and_moves_on_is_not_believed(make: Make):
    seat = slewing(make("lieabort"))
    answer = seat.ask("stop")
    assert answer.ok  # the driver has taken it
    last = seat.until(lambda: (each := seat.status().last_stop) and each.motion and each, "verdict")
    assert (last.motion, seat.moves()) == ("moves", True)
    assert last.rate_deg_s == pytest.approx(4.0, abs=1.0)
    assert "STILL MOVES at 4." in last.text
    assert "cut the mount's power" in last.text
    seat.until(lambda: seat.status().state == "FAULT", "fault")
    assert seat.aborts >= 4
    assert not any("stands" in words or "confirmed" in words for words in seat.said)


@pytest.mark.slow("a real engine at a mount in real time")
@pytest.mark.parametrize("oddity", plain_first(1, ["abortalert", "abortignored", "noabort"]))
def test_a_mount_that_does_not_obey_is_said_to_move_until_it_rests(make: Make, oddity: str):
    seat = slewing(make(oddity))
    answer = seat.ask("stop")
    assert not answer.ok
    assert "not answered in 0.8 s" in answer.message
    last = seat.until(lambda: (each := seat.status().last_stop) and each.motion and each, "verdict")
    assert (last.motion, last.answered_ms, seat.moves()) == ("moves", None, True)
    reasons = {
        "abortalert": "answers ABORT with Alert: [ERROR] Abort failed: serial timeout",
        "abortignored": "says that it still moves after 4 aborts",
        "noabort": "its driver has no ABORT",
    }
    # The reason comes with the answer of the way that failed last.
    seat.until(
        lambda: any(
            reasons[oddity] in each.outcome.detail
            for each in seat.memory.records
            if hasattr(each, "outcome")
        ),
        reasons[oddity],
        5.0,
    )
    assert seat.status().state == "FAULT"
    # It arrives where it was going: that is rest, and the fault is over.
    seat.until(lambda: not seat.moves(), "arrival", 60.0)
    seat.until(lambda: seat.status().state == "IDLE", "the end of the fault", 40.0)
    assert any("measured: STOP is over" in words for words in seat.said)


@pytest.mark.nightly("a real engine at a mount in real time")
def test_a_driver_that_is_never_busy_is_seen_to_slew_and_to_stop(make: Make):
    seat = make("noidle")
    seat.wait_for_rest()
    assert seat.goto(50.0, 130.0).ok
    seat.until(lambda: seat.status().is_slewing, "a slew", 5.0)
    assert seat.stop().motion == "tracks"


@pytest.mark.nightly("a real engine at a mount in real time")
def test_a_driver_that_stays_busy_is_seen_to_rest(make: Make):
    seat = slewing(make("busyforever"))
    last = seat.stop()
    assert last.motion in ("stands", "tracks")
    assert last.answered_ms is None
    seat.until(lambda: seat.status().is_slewing is False, "the end of the slew", 30.0)


@pytest.mark.nightly("a real engine at a mount in real time")
def test_a_slow_driver_is_not_known_until_it_has_told_enough(make: Make):
    seat = slewing(make("slowreport=5 nopollingperiod"))
    last = seat.stop()
    assert last.motion == "unknown"
    assert last.measured_ms == pytest.approx(10_000.0, abs=1500.0)
    assert "NOT KNOWN whether the mount moves" in last.text


@pytest.mark.nightly("a real engine at a mount in real time")
def test_words_that_are_no_utf8_do_not_cut_the_line_to_a_mount(make: Make):
    seat = slewing(make("badutf8"))
    assert seat.stop().motion == "tracks"


@pytest.mark.nightly("a real engine at a mount in real time")
def test_a_second_stop_acts_at_once(make: Make):
    seat = slewing(make("aborts_ignored=2"))
    seat.ask("stop")
    before = seat.aborts
    begun_s = time.monotonic()
    seat.ask("stop")
    # The first one's answer may still have been on its way: it is not waited for.
    seat.until(
        lambda: any(begun_s <= at_s for at_s, _ in seat.received("TELESCOPE_ABORT_MOTION")),
        "second ABORT",
        0.2,
    )
    assert seat.aborts > before
    seat.until(lambda: (each := seat.status().last_stop) and each.motion == "tracks", "rest")


@pytest.mark.slow("a real engine at a mount in real time")
def test_a_driver_that_dies_in_a_slew_is_told_to_stop_when_it_is_back(make: Make):
    """TheSkyX went on behind Paramount's driver, and nobody sent ABORT."""
    seat = slewing(make())
    aborts = seat.aborts
    seat.server.kill_driver(restart_s=1.0)
    seat.until(lambda: seat.aborts > aborts, "an ABORT to the driver that came back", 30.0)
    seat.until(lambda: not seat.moves(), "rest", 10.0)
    seat.wait_for_rest()
    assert any("ABORT was sent first" in words for words in seat.mount_messages())


# ---- parked ----------------------------------------------------------------------------------


@pytest.mark.nightly("a real engine at a mount in real time")
def test_a_mount_that_says_parked_and_tracks_is_an_alarm_and_is_stopped(make: Make):
    seat = make(f"trackwhileparked {EASILY_PARKED}")
    assert seat.ask("park").ok
    seat.until(
        lambda: any("parked and tracks (measured)" in each for each in seat.alarms), "alarm", 90
    )
    assert seat.aborts >= 1
    assert seat.received(TRACKING)[-1][1].get("TRACK_OFF") == "On"


@pytest.mark.nightly("a real engine at a mount in real time")
@pytest.mark.parametrize("oddity", ["parklies", "parkok_instant"])
def test_a_mount_that_says_parked_on_its_way_there_is_not_said_to_be_parked(
    make: Make, oddity: str
):
    seat = make(f"{oddity} {EASILY_PARKED}")
    seat.wait_for_rest()
    assert seat.ask("park").ok
    time.sleep(SLEWING_S)
    assert seat.moves()
    assert seat.status().is_parked is False
    seat.until(lambda: seat.status().is_parked, "the park position", 60.0)
    assert not seat.moves()


@pytest.mark.nightly("a real engine at a mount in real time")
def test_a_park_that_fails_is_told_with_its_own_reason(make: Make):
    answer = make("parkfails").ask("park")
    assert not answer.ok
    assert "Parking failed" in answer.message


@pytest.mark.nightly("a real engine at a mount in real time")
def test_a_park_position_that_is_not_there_is_refused_at_once(make: Make):
    seat = make("nopark")
    begun_s = time.monotonic()
    answer = seat.ask("park")
    assert time.monotonic() - begun_s < 2.0
    assert not answer.ok
    assert "no park position" in answer.message
    assert seat.received(PARK) == []


@pytest.mark.nightly("a real engine at a mount in real time")
def test_unpark_ends_the_wish_to_park(make: Make, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(parking, "RETRY_NS", 3_000_000_000)
    seat = make(EASILY_PARKED)
    seat.ask("park")
    seat.until(lambda: seat.status().is_parked, "the park position", 60.0)
    assert seat.ask("unpark").ok
    orders = len(seat.received(PARK))
    time.sleep(6.0)
    assert len(seat.received(PARK)) == orders
    assert seat.status().is_parked is False


# ---- limits, and refusals ---------------------------------------------------------------------


@pytest.mark.nightly("a real engine at a mount in real time")
def test_another_client_s_slew_below_the_horizon_is_stopped_before_it(make: Make):
    seat = make("ha_deg=0 dec_deg=-15")
    seat.goto(40.0, 180.0)
    seat.until(lambda: not seat.moves(), "arrival", 60.0)
    seat.wait_for_rest()
    seat.foreign(-20.0, 180.0)
    seat.until(seat.moves, "motion", 5.0)
    seat.until(lambda: not seat.moves(), "rest", 60.0)
    # Four degrees a second, two a second a second: it needs four degrees and a look at it.
    assert seat.altitude_deg() > 0.0
    assert any("limit" in words for words in seat.alarms)


@pytest.mark.slow("a real engine at a mount in real time")
def test_a_mount_without_tracking_state_is_measured_all_the_same(make: Make):
    seat = slewing(make("notrackstate"))
    last = seat.stop()
    assert last.motion == "stands"  # what its ABORT leaves, whatever is configured


@pytest.mark.nightly("a real engine at a mount in real time")
def test_a_refusal_to_slew_is_told_with_its_own_reason(make: Make):
    seat = make("startparked")
    answer = seat.goto(50.0, 130.0)
    assert not answer.ok
    assert "parked" in answer.message
    assert seat.received(COORDINATES) == []
