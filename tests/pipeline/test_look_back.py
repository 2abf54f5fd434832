"""Stars in a row and flashes against the frame before: fields of Gaussians, two pointings."""

from dataclasses import replace

import numpy as np
import pytest

from rsoconsole.pipeline.comparison.look_back import FramePair, SolvedField, StreakComparison
from rsoconsole.records import Frame, Wcs
from rsoconsole.vision import find_stars
from tests.drawn.drawn_lines import line_of_light
from tests.drawn.drawn_skies import (
    CADENCE_S,
    EXPOSURE_S,
    NOISE_ADU,
    SIZE_PX,
    DrawnSky,
    Ends,
    flashes,
    on_line,
    plate,
    solved,
    streak_at,
)

ENDS: Ends = (240.0, 250.0, 330.0, 285.0)
SIX_IN_A_ROW = np.array([0.0, 0.18, 0.42, 0.55, 0.81, 1.0])
UNLIKE = np.array([1.0, 0.6, 0.9, 1.2, 0.7, 1.0])
SHIFTS = [(6.3, -4.7), (40.2, 13.4), (-3.1, 55.6)]
SHAPE = (SIZE_PX, SIZE_PX)


def field_of(frame: Frame, wcs: Wcs) -> SolvedField:
    return SolvedField(frame=frame, stars=find_stars(frame.pixels), solution=solved(frame, wcs))


def sky_with(seed: int, chain_adu: float = 0.0) -> DrawnSky:
    """A field with nothing near the line but, where they are wanted, six stars on it."""
    sky = DrawnSky.with_field(seed)
    sky.clear_about(ENDS)
    if chain_adu:
        sky.add(*on_line(ENDS, SIX_IN_A_ROW), chain_adu * UNLIKE)
    return sky


def snr_of(flux_adu: float) -> float:
    """Matched, of so much light spread along the line."""
    length_px, sigma_px = 96.6, 1.2
    return flux_adu / NOISE_ADU / np.sqrt(length_px * 2.0 * np.sqrt(np.pi) * sigma_px)


def word(
    before: tuple[Frame, Wcs], now: tuple[Frame, Wcs], flux_adu: float
) -> StreakComparison | None:
    back = FramePair.of(field_of(*now), field_of(*before))
    assert back is not None
    return back.compare(streak_at(ENDS, now[0], snr_of(flux_adu)))


def comparison(found: StreakComparison | None) -> str | None:
    return None if found is None else found.comparison


@pytest.mark.parametrize("shift_px", SHIFTS)
@pytest.mark.parametrize("flux_adu", [2000.0, 8000.0, 60000.0])
def test_stars_in_a_row_were_there_before(shift_px, flux_adu):
    sky = sky_with(3, flux_adu)
    then, now = plate(shift_px), plate()
    found = word((sky.frame(1, then), then), (sky.frame(2, now), now), 5.4 * flux_adu)
    assert found is not None
    assert found.reason is not None
    assert (found.comparison, found.reason.kind) == ("same light", "fixed in the sky")


@pytest.mark.parametrize("shift_px", SHIFTS)
@pytest.mark.parametrize("flux_adu", [2000.0, 8000.0, 60000.0])
def test_flashes_were_not(shift_px, flux_adu):
    sky = sky_with(4)
    then, now = plate(shift_px), plate()
    light = flashes(ENDS, 6, flux_adu)
    found = word((sky.frame(1, then), then), (sky.frame(2, now, light), now), 6.0 * flux_adu)
    assert found == StreakComparison(comparison="new light")


@pytest.mark.parametrize(("transparency", "sigma_px"), [(0.6, 1.2), (1.0, 1.8), (0.7, 0.9)])
def test_thin_cloud_and_another_seeing_change_nothing(transparency, sigma_px):
    chain, bare = sky_with(5, 8000.0), sky_with(5)
    then, now = plate((21.0, -9.0)), plate()
    sights = {"transparency": transparency, "sigma_px": sigma_px}
    of_chain = word(
        (chain.frame(1, then, **sights), then), (chain.frame(2, now), now), 5.4 * 8000.0
    )
    lit = bare.frame(2, now, flashes(ENDS, 6, 8000.0))
    of_flashes = word((bare.frame(1, then, **sights), then), (lit, now), 6.0 * 8000.0)
    assert (comparison(of_chain), comparison(of_flashes)) == ("same light", "new light")


def test_a_frame_that_is_not_deep_enough_excludes_nothing():
    sky = sky_with(6)
    then, now = plate((21.0, -9.0)), plate()
    cloudy = sky.frame(1, then, transparency=0.05)
    bright = sky.frame(2, now, flashes(ENDS, 6, 700.0))
    back = FramePair.of(field_of(bright, now), field_of(cloudy, then))
    # Either no star is found in both, or the light would not have shown.
    assert back is None or back.compare(streak_at(ENDS, bright, snr_of(6.0 * 700.0))) is None


@pytest.mark.parametrize("seed", range(8))
def test_a_faint_streak_along_bright_stars_is_not_taken_for_them(seed):
    """Of two stars on it that have ten times its light."""
    sky = sky_with(10 + seed)
    sky.add(*on_line(ENDS, np.array([0.3, 0.75])), np.array([20000.0, 14000.0]))
    then, now = plate((21.0, -9.0)), plate()
    streak_adu = 3400.0
    light = streak_adu / 96.6 * line_of_light(SHAPE, ENDS, 1.2)
    found = word((sky.frame(1, then), then), (sky.frame(2, now, light), now), streak_adu)
    assert comparison(found) != "same light"


def test_a_neighbour_that_was_half_a_streak_ahead_is_not_the_same_light():
    sky = sky_with(7)
    then, now = plate((21.0, -9.0)), plate()
    x_a, y_a, x_b, y_b = ENDS
    half = 0.5 * (x_b - x_a), 0.5 * (y_b - y_a)
    # The plate then had everything further by its shift.
    ahead = (x_a + half[0] + 21.0, y_a + half[1] - 9.0, x_b + half[0] + 21.0, y_b + half[1] - 9.0)
    lights = [60.0 * line_of_light(SHAPE, ends, 1.2) for ends in (ahead, ENDS)]
    frames = sky.frame(1, then, lights[0]), sky.frame(2, now, lights[1])
    assert comparison(word((frames[0], then), (frames[1], now), 5800.0)) != "same light"


def trailing(seed: int, gap: float, *, leaves_heir: bool) -> StreakComparison | None:
    """Two satellites, the second behind the first by so many of the ways between two frames."""
    sky = sky_with(seed)
    then, now = plate((3.0, -2.0)), plate()
    pace = CADENCE_S / EXPOSURE_S
    x_a, y_a, x_b, y_b = ENDS
    way = pace * (x_b - x_a), pace * (y_b - y_a)

    def moved(ways: float, shift: tuple[float, float] = (0.0, 0.0)) -> Ends:
        dx, dy = ways * way[0] + shift[0], ways * way[1] + shift[1]
        return x_a + dx, y_a + dy, x_b + dx, y_b + dy

    first_then, second_then = moved(gap - 1.0, (3.0, -2.0)), moved(-1.0, (3.0, -2.0))
    first_now, second_now = moved(gap), moved(0.0)
    lit = [60.0 * line_of_light(SHAPE, ends, 1.2) for ends in (first_then, second_then)]
    lit_now = [60.0 * line_of_light(SHAPE, ends, 1.2) for ends in (first_now, second_now)]
    frames = sky.frame(1, then, lit[0] + lit[1]), sky.frame(2, now, lit_now[0] + lit_now[1])
    streaks = tuple(streak_at(ends, frames[0]) for ends in (first_then, second_then))
    here = tuple(streak_at(ends, frames[1]) for ends in (first_now, second_now))
    before = replace(field_of(frames[0], then), streaks=streaks)
    after = replace(field_of(frames[1], now), streaks=here if leaves_heir else here[1:])
    back = FramePair.of(after, before)
    assert back is not None
    return back.compare(here[1])


@pytest.mark.parametrize("gap", [1.0, 0.98, 1.03])
def test_one_of_a_slot_where_another_was_a_frame_ago_is_no_star(gap):
    """As they follow each other by the way of one cadence; what lay there lies further on."""
    assert comparison(trailing(20, gap, leaves_heir=True)) != "same light"
    # Unless it does not: stars in a row have no streak like it further on.
    assert comparison(trailing(20, gap, leaves_heir=False)) == "same light"


def test_stars_in_a_row_stay_stars_beside_a_satellite_of_the_same_length():
    """A satellite that is elsewhere is no heir of theirs."""
    sky = sky_with(21, 8000.0)
    then, now = plate((6.3, -4.7)), plate()
    x_a, y_a, x_b, y_b = ENDS
    beside: Ends = (x_a + 40.0, y_a + 120.0, x_b + 40.0, y_b + 120.0)
    light = 60.0 * line_of_light(SHAPE, beside, 1.2)
    frames = sky.frame(1, then), sky.frame(2, now, light)
    then_ends: Ends = (x_a + 6.3, y_a - 4.7, x_b + 6.3, y_b - 4.7)
    before = replace(field_of(frames[0], then), streaks=(streak_at(then_ends, frames[0]),))
    chain = streak_at(ENDS, frames[1], snr_of(5.4 * 8000.0))
    after = replace(field_of(frames[1], now), streaks=(chain, streak_at(beside, frames[1])))
    back = FramePair.of(after, before)
    assert back is not None
    assert comparison(back.compare(chain)) == "same light"


# -- the sensor --------------------------------------------------------------------------------


def test_light_at_the_same_pixels_under_another_sky_is_the_sensors():
    sky = sky_with(8)
    then, now = plate((3.0, -30.0)), plate()
    glow = 60.0 * line_of_light(SHAPE, ENDS, 1.2)
    found = word((sky.frame(1, then, glow), then), (sky.frame(2, now, glow), now), 5800.0)
    assert found is not None
    assert found.reason is not None
    assert (found.comparison, found.reason.kind) == (None, "fixed on the sensor")


def test_a_satellite_that_the_telescope_keeps_pace_with_is_not_the_sensors():
    """A geostationary one before a telescope at rest: the sky moves by its streak's direction."""
    sky = sky_with(9)
    x_a, y_a, x_b, y_b = ENDS
    pace = CADENCE_S / EXPOSURE_S
    # The stars move against the streak: the satellite moves with it before them.
    shift = pace * (x_b - x_a), pace * (y_b - y_a)
    then, now = plate(shift), plate()
    light = 60.0 * line_of_light(SHAPE, ENDS, 1.2)
    frames = sky.frame(1, then, light), sky.frame(2, now, light)
    found = word((frames[0], then), (frames[1], now), 5800.0)
    assert found is None or found.reason is None


# -- when frames can be compared ---------------------------------------------------------------


def test_frames_that_cannot_be_compared_are_not():
    sky = sky_with(2)
    then, now = plate((21.0, -9.0)), plate()
    before, here = field_of(sky.frame(1, then), then), field_of(sky.frame(2, now), now)
    assert FramePair.of(here, before) is not None

    def changed(**changes: object) -> SolvedField:
        return replace(before, frame=replace(before.frame, **changes))

    late_ns = here.frame.t_start_utc_ns
    assert FramePair.of(here, changed(t_start_utc_ns=late_ns)) is None
    assert FramePair.of(here, changed(t_start_utc_ns=late_ns - 700 * 10**9)) is None
    assert FramePair.of(here, changed(t_start_utc_ns=None)) is None
    assert FramePair.of(here, changed(exposure_s=31.0)) is None
    assert FramePair.of(here, changed(pixels=before.frame.pixels[:500])) is None
    wrong = replace(before, solution=solved(before.frame, plate((24.0, -9.0))))
    assert FramePair.of(here, wrong) is None


def test_a_line_that_the_earlier_frame_did_not_hold_is_not_judged():
    sky = sky_with(2, 8000.0)
    then, now = plate((0.0, -300.0)), plate()
    assert word((sky.frame(1, then), then), (sky.frame(2, now), now), 5.4 * 8000.0) is None


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("flux_adu", [700.0, 2000.0, 14000.0])
def test_in_a_crowded_field_no_streak_is_taken_for_stars_nor_stars_for_a_streak(seed, flux_adu):
    """A star of 1500 ADU or more in each square of 40 px; the streak has six times ``flux_adu``."""
    streak, chain = (DrawnSky.with_field(100 + seed, 250) for _ in range(2))
    chain.add(*on_line(ENDS, SIX_IN_A_ROW), flux_adu * UNLIKE)
    then, now = plate((-31.0, 17.0)), plate()
    lit = streak.frame(2, now, flashes(ENDS, 6, flux_adu))
    of_streak = word((streak.frame(1, then), then), (lit, now), 6.0 * flux_adu)
    of_chain = word((chain.frame(1, then), then), (chain.frame(2, now), now), 5.4 * flux_adu)
    assert of_streak is None or of_streak.reason is None
    assert comparison(of_chain) != "new light"
