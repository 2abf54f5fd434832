"""What a streak's length says of its middle: ends drawn here, middles judged against them."""

import numpy as np
import pytest

from rsoconsole.records import Measurement
from rsoconsole.tracking import Motion, append_length_excess
from rsoconsole.tracking.filters.streak_length import (
    REMEMBERED,
    along_error_arcsec,
    length_excess_arcsec,
)

LENGTH_ARCSEC = 150.0
EXPECTED = Motion(LENGTH_ARCSEC, 0.0)


def streak(west_arcsec: float, east_arcsec: float, sigma: float = 0.3, **more) -> Measurement:
    """Along the equator about RA 10, ends off by so much from where they should be."""
    ends = (-LENGTH_ARCSEC / 2.0 + west_arcsec, LENGTH_ARCSEC / 2.0 + east_arcsec)
    at = [10.0 + each / 3600.0 for each in ends]
    return Measurement(
        measurement_id="1-0",
        frame_id=1,
        t_mid_utc_ns=0,
        ra_icrs_deg=sum(at) / 2.0,
        dec_icrs_deg=0.0,
        cov_sky_arcsec2=(sigma**2, 0.0, 0.04),
        x_px=0.0,
        y_px=0.0,
        confidence=1.0,
        source="network",
        ends_icrs_deg=((at[0], 0.0), (at[1], 0.0)),
        **more,
    )


def night(random: np.random.Generator, sigma_end: float, bias: float = 0.0, frames: int = 40):
    """(middle's error, what is said of it) of each frame: ends err alone, and all by a bias."""
    before: tuple[float, ...] = ()
    for _ in range(frames):
        west, east = random.normal(0.0, sigma_end, 2)
        seen = streak(west - bias / 2.0, east + bias / 2.0)
        said = along_error_arcsec(seen, EXPECTED, before)
        before = append_length_excess(before, seen, EXPECTED)
        yield (west + east) / 2.0, float(np.hypot(said, 0.3))


@pytest.mark.parametrize("bias", [0.0, 12.0, 8.0])
@pytest.mark.parametrize("sigma_end", [1.5, 5.0])
def test_ends_that_err_alone_are_found_out_whatever_all_streaks_share(sigma_end, bias):
    """After ten frames what is said is the middle's error, within a third either way."""
    random = np.random.default_rng(3)
    nights = [list(night(random, sigma_end, bias))[10:] for _ in range(40)]
    error, said = np.concatenate([np.array(each) for each in nights]).T
    assert np.sqrt(np.mean(error**2)) == pytest.approx(sigma_end / np.sqrt(2.0), rel=0.1)
    assert 0.85 < np.sqrt(np.mean((error / said) ** 2)) < 1.33


def test_what_flashes_shows_a_part_of_its_way_somewhere():
    """From the first flash of an exposure to the last: always as long, at a random phase."""
    random, before, squared = np.random.default_rng(5), (), []
    for _ in range(400):
        lost = random.uniform(0.0, 22.0)
        seen = streak(lost, lost - 22.0)
        said = along_error_arcsec(seen, EXPECTED, before)
        before = append_length_excess(before, seen, EXPECTED)
        squared.append(((lost - 11.0) / np.hypot(said, 0.3)) ** 2)
    # Between this and a drift of the stars, which shortens all streaks and moves no middle.
    assert 1.0 < np.sqrt(np.mean(squared[10:])) < 1.7


def flashing(period_s: float, lit_share: float, phase_s: float, frames: int = 40):
    """(arcsec lost at the west, at the east end) in exposures of 10 s every 30 s.

    From the first to the last instant of light, at 15 arcsec/s.
    """
    fine = np.linspace(0.0, 10.0, 2001)
    for number in range(frames):
        is_lit = ((30.0 * number + fine + phase_s) / period_s) % 1.0 < lit_share
        first, last = fine[is_lit][[0, -1]]
        yield 15.0 * first, 15.0 * (10.0 - last)


def filter_errors(*, is_widened: bool, seed: int = 6, nights: int = 60) -> np.ndarray:
    """(nights, frames) errors of the place over what filterpy's filter of constant rate states."""
    from filterpy.kalman import KalmanFilter

    random, all_errors = np.random.default_rng(seed), []
    for _ in range(nights):
        kept: tuple[float, ...] = ()
        motion = KalmanFilter(dim_x=2, dim_z=1)
        motion.F, motion.H = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1.0, 0.0]])
        motion.x, motion.P = np.zeros((2, 1)), np.diag([60.0**2, 30.0**2])
        motion.Q = np.diag([0.01, 0.01])
        errors = []
        period_s, lit = random.uniform(9.85, 10.15), random.uniform(0.5, 0.7)
        for west, east in flashing(period_s, lit, random.uniform(0.0, 10.0)):
            seen = streak(west, -east)
            said = along_error_arcsec(seen, EXPECTED, kept) if is_widened else 0.0
            kept = append_length_excess(kept, seen, EXPECTED)
            motion.predict()
            motion.update((west - east) / 2.0, R=said**2 + 0.3**2)
            errors.append(float(motion.x[0, 0] / np.sqrt(motion.P[0, 0])))
        all_errors.append(errors)
    return np.array(all_errors)


def test_parts_that_creep_from_frame_to_frame_have_one_error():
    """A satellite that flashes about as often as the shutter opens."""
    one, as_measured = filter_errors(is_widened=True), filter_errors(is_widened=False)
    after = slice(10, None)
    assert np.sqrt(np.mean(one[:, after] ** 2)) < 1.0
    assert np.mean(np.abs(one[:, after]) < 3.0) > 0.99
    # As they are measured they would be averaged away, and what is stated would be too small.
    assert np.mean(np.abs(as_measured[:, after]) < 3.0) < 0.95


def test_among_parts_a_streak_of_full_length_counts_whole():
    before = (-60.0, -58.0, -61.0, -59.0, -60.0)
    whole, part = streak(0.0, 0.0), streak(30.0, -30.0)
    assert along_error_arcsec(whole, EXPECTED, before) == 0.0
    shared = along_error_arcsec(part, EXPECTED, before)
    # The sixth in a row of an even chance over what is dark: 57 arcsec, less two in a hundred.
    assert shared == pytest.approx(np.sqrt(6.0 / 12.0) * 57.0, rel=0.01)


def test_what_all_streaks_lack_at_both_ends_alike_is_no_error():
    """Light that fades into the sky: two in a hundred of the length."""
    before = (-2.0, -2.2, -1.9, -2.1, -2.0)
    assert along_error_arcsec(streak(1.0, -1.0), EXPECTED, before) == 0.0


def test_streaks_that_are_as_good_as_they_say_get_nothing_added():
    random = np.random.default_rng(4)
    said = [s for _ in range(20) for _, s in night(random, 0.3 * np.sqrt(2.0))]
    assert np.median(said) < 0.35


@pytest.mark.parametrize("lost", [20.0, -30.0])
def test_one_end_far_off_widens_by_half_of_it(lost):
    before = (0.1, -0.2, 0.3, 0.0, 0.2)
    assert along_error_arcsec(streak(0.0, lost), EXPECTED, before) == pytest.approx(
        abs(lost) / 2.0, rel=0.05
    )


def test_what_the_frame_cuts_has_no_length():
    cut = streak(0.0, -60.0, is_clipped=True)
    assert length_excess_arcsec(cut, EXPECTED) is None
    assert along_error_arcsec(cut, EXPECTED) == 0.0
    assert append_length_excess((1.0,), cut, EXPECTED) == (1.0,)


def test_it_remembers_the_last_ones():
    kept: tuple[float, ...] = ()
    for number in range(40):
        kept = append_length_excess(kept, streak(0.0, float(number)), EXPECTED)
    assert len(kept) == REMEMBERED
    assert kept[-1] == pytest.approx(39.0, abs=1e-6)
