"""What the stars of successive frames say of the mount: a drift is told, its own errors are not."""

import math
from dataclasses import replace

import pytest

from rsoconsole.engine.aim.star_drift import StarDrift
from rsoconsole.records import Solution
from tests.makers import NS, T0_UTC_NS
from tests.nights.made_up_night import solution_of

CADENCE_S, DEC_DEG = 20.0, 40.0


def plates(rate_arcsec_s: tuple[float, float], count: int) -> list[tuple[Solution, int]]:
    """Plates of a telescope that drifts by so much in RA (on the sky) and Dec."""
    east, north = rate_arcsec_s
    cos_dec = math.cos(math.radians(DEC_DEG))
    made = []
    for n in range(count):
        t_s = n * CADENCE_S
        ra_deg = (359.999 + east * t_s / 3600.0 / cos_dec) % 360.0
        plate = solution_of(n + 1, ra_deg, DEC_DEG + north * t_s / 3600.0)
        plate = replace(plate, frame_id=n + 1)
        made.append((plate, T0_UTC_NS + round(t_s * NS)))
    return made


def told(rate_arcsec_s: tuple[float, float], count: int = 4, *, moves: bool = False) -> list[str]:
    watch, said = StarDrift(), []
    for plate, t_utc_ns in plates(rate_arcsec_s, count):
        if moves:
            watch.note_move()
        watch.note_frame(plate.frame_id, t_utc_ns)
        said.append(watch.drift_words(plate))
    return [words for words in said if words is not None]


@pytest.mark.parametrize("rate", [(10.0, 0.0), (0.0, -3.0), (-1.5, 1.5)])
def test_a_drift_is_told_once_with_its_rate_and_the_frames(rate: tuple[float, float]):
    [words] = told(rate)
    assert f"drifts by {math.hypot(*rate):.1f}″/s against the stars" in words
    assert f"({rate[0]:+.1f}″/s RA·cosδ, {rate[1]:+.1f}″/s δ)" in words
    assert "by frames 1 and 2" in words


@pytest.mark.parametrize("rate", [(0.0, 0.0), (0.5, -0.5), (0.9, 0.0)])
def test_what_worm_gears_and_polar_axes_do_is_no_drift(rate: tuple[float, float]):
    assert told(rate) == []


def test_frames_with_a_slew_between_them_are_not_compared():
    assert told((10.0, 0.0), moves=True) == []


def test_another_rate_is_told_again_and_one_that_has_ended_and_come_back():
    watch, said = StarDrift(), []
    rates = [10.0, 10.0, 30.0, 30.0, 0.0, 10.0]
    ra_deg, t_utc_ns = 100.0, T0_UTC_NS
    for number, rate in enumerate([0.0, *rates], 1):
        ra_deg += rate * CADENCE_S / 3600.0 / math.cos(math.radians(DEC_DEG))
        t_utc_ns += round(CADENCE_S * NS)
        watch.note_frame(number, t_utc_ns)
        plate = replace(solution_of(number, ra_deg, DEC_DEG), frame_id=number)
        said.append(watch.drift_words(plate) is not None)
    assert said == [False, True, False, True, False, False, True]


def test_a_frame_that_was_not_solved_is_bridged_and_a_long_gap_is_not():
    for gap_s, is_told in ((60.0, True), (600.0, False)):
        watch = StarDrift()
        for number, t_s in ((1, 0.0), (2, gap_s)):
            watch.note_frame(number, T0_UTC_NS + round(t_s * NS))
            ra_deg = 100.0 + 5.0 * t_s / 3600.0
            words = watch.drift_words(replace(solution_of(number, ra_deg, 0.0), frame_id=number))
        assert (words is not None) is is_told
