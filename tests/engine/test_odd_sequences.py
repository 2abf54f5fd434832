"""Whatever comes in whatever order: a mount that moves is never said to rest, and limits hold.

2,000 nights in process and 40 over the wire are ``python -m tests.campaign odd_mounts``; these are
the first of them.
"""

from pathlib import Path

import pytest

from rsoconsole.instruments.motion import Motion, MotionMeter
from tests.rigs.odd_mount import Oddities
from tests.rigs.odd_sequence import OddNight
from tests.rigs.odd_wire_night import ABORT_S, run_wire_night
from tests.tiers import plain_first

BATCH = 10


# Those with the rarest of what happens first.
@pytest.mark.parametrize("first", plain_first(4, (40, 50, 70, 0, 10, 20, 30, 60, 80, 90)))
def test_a_moving_mount_is_never_said_to_rest_and_limits_hold(first: int):
    rests = 0
    for seed in range(first, first + BATCH):
        found = OddNight(seed).run()
        assert found.faults == [], f"seed {seed}"
        rests += found.rests_told
    assert rests > 0


def test_the_judge_finds_a_meter_that_lies(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(MotionMeter, "motion", lambda _self, _t_s: Motion(kind="stands"))
    assert any(OddNight(seed).run().faults for seed in range(3))


def test_the_judge_finds_limits_that_nobody_watches(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("rsoconsole.engine.tasks.watch.Watch.look", lambda _self: None)
    found = [OddNight(seed, Oddities()).run().faults for seed in range(6)]
    assert any("below the horizon" in words for faults in found for words in faults)


@pytest.mark.nightly("random nights in real time")
@pytest.mark.parametrize("seed", range(4))
def test_over_the_wire_too(seed: int, tmp_path: Path):
    found = run_wire_night(seed, tmp_path, acts=6)
    assert found.faults == []
    assert all(sent_s <= ABORT_S for sent_s in found.stops_s)
