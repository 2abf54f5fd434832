"""The machine's clock: somebody sets it, or only draws it in."""

import time

import pytest

from rsoconsole.instruments.clock import SystemClock

NS = 1_000_000_000


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """What is added to the machine's time."""
    added = {"ns": 0}
    plain = time.time_ns
    monkeypatch.setattr(time, "time_ns", lambda: plain() + added["ns"])
    return added


@pytest.mark.parametrize("step_s", [3600.0, -3600.0, 1.0, -0.5])
def test_a_clock_that_is_set_says_so_once(wall, step_s: float):
    clock = SystemClock()
    assert clock.take_step_s() == 0.0
    wall["ns"] += round(step_s * NS)
    assert clock.take_step_s() == pytest.approx(step_s, abs=0.05)
    assert clock.take_step_s() == 0.0


def test_a_clock_that_is_drawn_in_is_not_set(wall):
    clock = SystemClock()
    for _ in range(1000):
        wall["ns"] += NS // 1000
        assert clock.take_step_s() == 0.0
