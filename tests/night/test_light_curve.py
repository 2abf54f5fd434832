"""The light curve of a track: what is in it, and when."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rsoconsole.night import frames_of, light_curve_of, tracks_of
from rsoconsole.records import Measurement, Photometry, Record, TrackState
from tests.makers import T0_UTC_NS
from tests.nights.light_worlds import LightWorld, curve_of, light_records, sinusoid, steady


def changed(records: list[Record], kind: type, change: Any) -> list[Record]:
    return [change(each) if isinstance(each, kind) else each for each in records]


def brightest_s(curve: Any) -> float:
    return float((curve.steps.t_utc_ns[np.argmax(curve.steps.light)] - T0_UTC_NS) / 1e9)


def flash(t_flash_s: float) -> Any:
    """A flash of a magnitude and a half, half a second long."""
    return lambda t_s: 1.0 + 3.0 * np.exp(-0.5 * ((np.asarray(t_s) - t_flash_s) / 0.3) ** 2)


@pytest.mark.parametrize("is_b_first", [False, True])
def test_a_flash_stands_at_its_time_whichever_end_of_the_streak_comes_first(
    is_b_first: bool,
) -> None:
    world = LightWorld(light=flash(63.0), frames=8, jitter_s=0.0, is_b_first=is_b_first)
    records = light_records(world)
    if is_b_first:
        # The record has its steps from end a on, whatever the object did.
        assert brightest_s(curve_of(light_records(replace(world, is_b_first=False)))) == (
            pytest.approx(63.0, abs=0.25)
        )
    one_step_s = 0.25
    assert brightest_s(curve_of(records)) == pytest.approx(63.0, abs=one_step_s)


def test_without_a_known_direction_there_are_points_and_no_steps() -> None:
    records = light_records(LightWorld(light=steady, frames=6))
    slow = changed(records, TrackState, lambda s: replace(s, x=(s.x[0], 1e-7, s.x[2], 0.0)))
    curve = curve_of(slow)
    assert (len(curve.points), len(curve.steps), curve.undirected) == (6, 0, 6)

    endless = changed(records, Measurement, lambda m: replace(m, ends_icrs_deg=None))
    assert len(curve_of(endless).steps) == 0


def test_light_compares_between_frames_of_different_transparency() -> None:
    cloudy = LightWorld(
        light=steady, frames=30, transparency_sigma_mag=0.8, zero_point_sigma_mag=1e-4, snr=500.0
    )
    curve = curve_of(light_records(cloudy))
    a_per_cent = 0.01
    assert float(np.std(curve.points.light)) < a_per_cent
    assert float(np.std(curve.steps.light)) < 10.0 * a_per_cent
    assert curve.points.mag == pytest.approx(11.0, abs=0.02)
    assert curve.unit_mag == pytest.approx(11.0, abs=0.02)


def test_steps_and_points_agree() -> None:
    curve = curve_of(light_records(LightWorld(light=sinusoid(170.0, 1.0), frames=20)))
    for at, frame_id in enumerate(curve.points.frame_ids):
        own = curve.steps.frame_ids == frame_id
        assert curve.steps.light[own].mean() == pytest.approx(curve.points.light[at], rel=1e-3)
        assert curve.steps.t_utc_ns[own].mean() == pytest.approx(curve.points.t_utc_ns[at], abs=1e6)


def test_streaks_of_another_band_and_shared_ones_are_left_out_and_counted() -> None:
    records = light_records(LightWorld(light=steady, frames=8))

    def instrumental(each: Photometry) -> Photometry:
        if each.frame_id != 3:
            return each
        light = replace(each.streaks[0], band="instrumental", mag=-7.0)
        return replace(each, streaks=(light,))

    other = curve_of(changed(records, Photometry, instrumental))
    assert (len(other.points), other.other_band, other.band) == (7, 1, "V")

    shared = changed(
        records, TrackState, lambda s: replace(s, shared_with=2) if s.frame_id == 5 else s
    )
    assert (len(curve_of(shared).points), curve_of(shared).shared) == (7, 1)


def test_no_light_no_curve() -> None:
    records = [
        each
        for each in light_records(LightWorld(light=steady, frames=5))
        if not isinstance(each, Photometry)
    ]
    frames = frames_of(records)
    assert light_curve_of(frames, tracks_of(frames)[1]) is None


def test_light_below_noise_has_no_magnitude_and_stays_in_the_curve() -> None:
    records = light_records(LightWorld(light=steady, frames=8, snr=1.0, steps=20))

    def dark(each: Photometry) -> Photometry:
        if each.frame_id != 4:
            return each
        light = replace(each.streaks[0], mag=None, mag_sigma=None, rate_adu_s=-5.0)
        return replace(each, streaks=(light,))

    curve = curve_of(changed(records, Photometry, dark))
    at = int(np.flatnonzero(curve.points.frame_ids == 4)[0])
    assert np.isnan(curve.points.mag[at])
    assert curve.points.light[at] < 0.0
