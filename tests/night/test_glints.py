"""Glints: found at their time and height, and none in noise, slow changes and regular turns."""

from typing import Any

import numpy as np
import pytest

from rsoconsole.night import Glint, glints_of
from tests.makers import T0_UTC_NS
from tests.nights.light_worlds import LightWorld, curve_of, light_records, sinusoid, steady, trend


def glints(world: LightWorld) -> tuple[Glint, ...]:
    return glints_of(curve_of(light_records(world)))


def flash(t_flash_s: float, height_mag: float, sigma_s: float) -> Any:
    """A flash above a light that turns a little, which is at its mean then."""
    high = 10.0 ** (0.4 * height_mag) - 1.0

    def light(t_s: Any) -> Any:
        lit = high * np.exp(-0.5 * ((np.asarray(t_s) - t_flash_s) / sigma_s) ** 2)
        return sinusoid(80.0, 0.2)(np.asarray(t_s) - t_flash_s) * (1.0 + lit)

    return light


@pytest.mark.parametrize("seed", range(6))
def test_a_flash_within_an_exposure_has_time_height_and_duration(seed: int) -> None:
    random = np.random.default_rng(seed)
    t_s = 20.0 * int(random.integers(1, 38)) + float(random.uniform(-3.0, 3.0))
    (found,) = glints(LightWorld(light=flash(t_s, 2.5, 0.4), seed=seed))
    assert (found.t_utc_ns - T0_UTC_NS) / 1e9 == pytest.approx(t_s, abs=0.6)
    assert found.height_mag == pytest.approx(2.5, abs=0.3)
    assert found.duration_s == pytest.approx(2.35 * 0.4, abs=0.4)
    assert found.is_within_frame


def test_a_flash_of_streaks_without_steps_is_seen_in_the_frame() -> None:
    (found,) = glints(LightWorld(light=flash(200.0, 1.5, 6.0), steps=0))
    assert (found.frame_id, found.is_within_frame, found.duration_s) == (11, False, 10.0)
    assert 0.8 < found.height_mag < 1.5


@pytest.mark.parametrize(
    "light",
    [steady, sinusoid(7.0, 1.0), sinusoid(120.0, 1.0), trend(2.0, 1.0, 800.0)],
    ids=["steady", "fast", "slow", "trend"],
)
def test_noise_turns_and_slow_changes_are_no_glints(light: Any) -> None:
    found = [glints(LightWorld(light=light, seed=seed, snr=80.0)) for seed in range(8)]
    assert sum(map(bool, found)) <= 1


def test_a_curve_of_few_points_has_none() -> None:
    assert glints(LightWorld(light=flash(20.0, 3.0, 8.0), frames=3, steps=0)) == ()
