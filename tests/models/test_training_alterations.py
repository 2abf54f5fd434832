"""The alterations that the network's hard fields have: their ranges, and truth that stays true."""

from dataclasses import replace

import numpy as np
import pytest

from models import alterations
from models.batches import _crop
from models.extras import Canvas
from models.field_scene import draw_field, draw_sensor
from models.fields import DIAGONAL_CELLS, FIELD_CELLS, Conditions, Field, TrueStreak
from models.satellites import Satellites
from rsoconsole.simulator import (
    FWHM_PER_SIGMA,
    FieldContent,
    SensorModel,
    frame_rng,
    integrated_snr,
    straight_streak,
)
from rsoconsole.simulator.camera.rendering import expected_electrons

EVEN = SensorModel(width_px=400, height_px=300, vignetting_corner=0, prnu=0, hot_fraction=0)


def canvas(**changes) -> Canvas:
    told = {"width_px": 1536, "height_px": 1536, "fwhm_px": 2.4, "noise_e": 12.0}
    return Canvas(**(told | changes))


def satellites(rng, content=None, **changes) -> Satellites:
    told = {
        "sensor": EVEN,
        "canvas": canvas(),
        "content": content or FieldContent(),
        "mode": "fast",
        "block": 8,
        "conditions": Conditions(streaks=(1, 1)),
        "rng": rng,
    }
    return Satellites(**(told | changes))


def test_a_hard_field_is_the_same_from_the_same_seed():
    def drawn(seed):
        rng = frame_rng(seed)
        sensor = draw_sensor(2, rng)
        return [draw_field(sensor, 2, Conditions(), rng) for _ in range(4)]

    one, again, other = drawn(5), drawn(5), drawn(6)
    assert all(np.array_equal(a.values, b.values) for a, b in zip(one, again, strict=True))
    assert [f.streaks for f in one] == [f.streaks for f in again]
    assert not any(np.array_equal(a.values, b.values) for a, b in zip(one, other, strict=True))


def test_discs_and_rings_are_those_of_a_working_frame():
    rng = frame_rng(1)
    drawn = [alterations.seeing(8, rng) for _ in range(500)]
    discs, rings = np.array(drawn).T
    assert discs.min() >= 1.0
    assert discs.max() <= 5.5
    assert np.count_nonzero(discs > 4.5) > 10
    assert np.count_nonzero(discs < 1.2) > 5
    assert 20 < np.count_nonzero(rings) < 100
    assert rings.max() <= 3.0


def test_no_sky_fills_the_wells():
    rng = frame_rng(2)
    for _ in range(300):
        sensor = draw_sensor(8, rng)
        full_e = (2**sensor.adc_bits - 1 - sensor.offset_adu12) * sensor.e_per_adu12
        assert 5.0 < alterations.sky_electrons(sensor, rng) <= 0.31 * full_e


def test_wind_blurs_no_wider_than_a_working_frame_allows():
    rng, still = frame_rng(3), 0
    for _ in range(200):
        path = alterations.motion(canvas(fwhm_px=3.0), rng)
        if path is None:
            still += 1
            continue
        assert np.abs(path.mean(axis=1)).max() < 1e-9
        is_drift = np.allclose(np.diff(path, 2, axis=1), 0.0, atol=1e-9)
        blurred_px = np.hypot(3.0, FWHM_PER_SIGMA * path.std(axis=1).max())
        assert is_drift or blurred_px < 8.0  # a gust may last
    assert 130 < still < 185


@pytest.mark.parametrize(
    ("fwhm_px", "defocus_px", "sky_e"), [(1.0, 0.0, 60.0), (2.4, 0.0, 132.0), (5.5, 0.0, 600.0),
                                         (2.0, 2.5, 132.0)]
)  # fmt: skip
def test_the_integrated_snr_is_what_the_renderer_gives(fwhm_px, defocus_px, sky_e):
    content = FieldContent(fwhm_px=fwhm_px, defocus_px=defocus_px, sky_electrons_px=sky_e)
    noise_e = np.sqrt(sky_e + EVEN.read_noise_e**2 + EVEN.e_per_adu12**2 / 12)
    at = canvas(fwhm_px=fwhm_px, defocus_px=defocus_px, noise_e=noise_e)
    light = at.line_of_snr(20.0, 150.0)
    streak = straight_streak((100.0, 100.3), (230.0, 175.3), light * 150.0)
    # A tenth: ends that are round, and where the line lies on the pixels.
    assert integrated_snr(EVEN, content, streak) == pytest.approx(20.0, rel=0.1)


def test_faint_ones_reach_down_to_an_integrated_snr_of_12():
    rng = frame_rng(4)
    drawn = [true for _ in range(400) for true in satellites(rng).draw(None)[1]]
    faint = [s for s in drawn if s.integrated_snr < 20.0 and s.length > 10.0]
    assert len(faint) > 15
    asked = [s for s in faint if s.is_asked]
    assert asked
    assert min(s.integrated_snr for s in asked) >= 12.0


def test_long_ones_reach_from_corner_to_corner_with_both_ends_in_the_field():
    rng = frame_rng(6)
    drawn = satellites(rng)
    for length in np.linspace(80.0, DIAGONAL_CELLS, 40):
        x, y, _, angle = drawn._long_segment(float(length))
        half = 0.5 * length * np.array([np.cos(angle), np.sin(angle)])
        ends = np.array([x, y]) + half * np.array([[-1.0], [1.0]])
        assert ends.min() >= -1e-6
        assert ends.max() <= FIELD_CELLS + 1e-6
    longest = max(s.length for _ in range(300) for s in satellites(rng).draw(None)[1])
    assert longest > 1.1 * FIELD_CELLS


@pytest.mark.parametrize("kind", ["drift", "wind"])
def test_the_ends_are_where_the_shutter_opened_and_closed_on_a_moving_image(kind):
    rng = frame_rng(7)
    path = np.stack([np.linspace(-6.0, 6.0, 129), np.linspace(4.0, -4.0, 129)])
    if kind == "wind":
        path = np.cumsum(rng.normal(0.0, 0.2, size=(2, 129)), axis=1)
        path -= path.mean(axis=1, keepdims=True)
    sensor = replace(EVEN, width_px=FIELD_CELLS * 2, height_px=FIELD_CELLS * 2)
    at = canvas(width_px=384, height_px=384, unit_px=2.0)
    wanted = Conditions(
        streaks=(1, 1), peak_snr=(30.0, 30.0), streak_cells=(40.0, 40.0), is_hard=False
    )
    drawn = satellites(
        rng, canvas=at, sensor=sensor, block=2, conditions=wanted, motion_px=path
    )  # fmt: skip
    trails, truth = drawn.draw(None)
    dark = FieldContent(fwhm_px=2.4, stands=alterations.stands(path, at))
    light = expected_electrons(sensor, replace(dark, streaks=tuple(trails)))
    light -= expected_electrons(sensor, dark)
    (true,) = truth
    ends = np.array([[true.x_a, true.y_a], [true.x_b, true.y_b]]) * 2.0 - 0.5
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    for end, outwards in ((ends[0], -along), (ends[1], along)):
        inside, outside = (_near(light, end + far * outwards) for far in (-4.0, 4.0))
        # Half of the disc's light has passed by at the end itself.
        assert inside > 8.0 * outside


def _near(light, place_px):
    column, row = np.rint(place_px).astype(int)
    return float(light[row - 1 : row + 2, column - 1 : column + 2].sum())


def test_a_satellite_that_is_hardly_longer_than_the_images_way_is_not_asked_for():
    path = np.stack([np.linspace(-12.0, 12.0, 129), np.zeros(129)])
    wanted = Conditions(
        streaks=(1, 1), peak_snr=(20.0, 20.0), streak_cells=(5.0, 5.0), is_hard=False
    )
    sensor = replace(EVEN, width_px=1536, height_px=1536)
    for seed in range(10):
        told = {"sensor": sensor, "conditions": wanted}
        (moved,) = satellites(frame_rng(seed), motion_px=path, **told).draw(None)[1]
        (still,) = satellites(frame_rng(seed), **told).draw(None)[1]
        assert still.is_asked
        assert not moved.is_asked


def test_covered_trails_leave_the_faint_ones_and_a_rest():
    path = np.stack([np.linspace(-20.0, 20.0, 41), np.zeros(41)])
    electrons = np.geomspace(30.0, 3e6, 400)
    place = np.zeros(400)
    _, _, left = alterations.covered((place, place, electrons), path, canvas(), frame_rng(8))
    is_whole = left == electrons
    assert is_whole[:50].all()
    assert not is_whole[-100:].any()
    assert (left[~is_whole] <= 0.1 * electrons[~is_whole]).all()


def test_a_trail_right_through_is_neither_asked_for_nor_a_fault():
    for seed in range(60):
        rng = frame_rng(9, seed)
        passing = alterations.crossings(canvas(), rng)
        for streak in passing:
            reach = np.hypot(*(np.ptp(axis) for axis in (streak.x_px, streak.y_px)))
            assert reach > 1.9 * np.hypot(1536, 1536)
    rng = frame_rng(10)
    sensor = draw_sensor(2, rng)
    fields = [draw_field(sensor, 2, Conditions(kind="empty"), rng) for _ in range(40)]
    through = [streak for field in fields for streak in field.streaks]
    assert through
    assert not any(streak.is_asked for streak in through)


def test_a_crop_shows_a_long_streak_whole_where_it_fits():
    streak = TrueStreak(
        x_a=40.0,
        y_a=100.0,
        x_b=150.0,
        y_b=110.0,
        peak_snr=9.0,
        integrated_snr=99.0,
        is_asked=True,
    )
    values = np.zeros((FIELD_CELLS, FIELD_CELLS), dtype=np.uint8)
    field = Field(values=values, kind="ordinary", mode="fast", block=8, streaks=(streak,))
    rng, whole = np.random.default_rng(1), 0
    for _ in range(200):
        cut = _crop(field, 128, rng)
        assert cut.values.shape == (128, 128)
        (seen,) = cut.streaks
        whole += min(seen.x_a, seen.y_a) >= 0 and max(seen.x_b, seen.y_b) <= 128
    assert whole > 100
