"""Points among star trails, against frames that are drawn by another law."""

import numpy as np
import pytest

from rsoconsole.sky import line_angle_deg
from rsoconsole.vision import PointList, find_stars, local_background
from rsoconsole.vision.points.points import find_points
from tests.drawn.drawn_moffat import MoffatSky, streak_points
from tests.drawn.drawn_trails import FWHM_PX, SHAPE, TrailedSky, point_flux, spread_points

SNRS = np.array([10.0] * 4 + [20.0] * 4 + [60.0] * 4 + [300.0] * 2)


def found_in(pixels: np.ndarray) -> PointList:
    sky = local_background(pixels)
    found = find_points(pixels, sky, find_stars(pixels, sky))
    assert found is not None
    return found


def nearest(found: PointList, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance to the nearest point found, px, and its number, for each point drawn."""
    away = np.hypot(
        points[:, 0][:, None] - found.x_px[None, :], points[:, 1][:, None] - found.y_px[None, :]
    )
    return away.min(axis=1), away.argmin(axis=1)


@pytest.mark.parametrize("angle_deg", [0.0, 31.0, 90.0, 140.0])
def test_points_are_found_among_trails_of_any_direction(angle_deg):
    rng = np.random.default_rng(int(angle_deg) + 1)
    points = spread_points(rng, SNRS)
    found = found_in(TrailedSky(rng, angle_deg=angle_deg).frame(points))
    assert found.trail.length_px == pytest.approx(100.0, rel=0.03)
    assert line_angle_deg(found.trail.angle_deg, angle_deg) < 0.3
    # Of a line of Moffat's law across, 8 % wider than a point.
    assert found.fwhm_px == pytest.approx(1.08 * FWHM_PX, rel=0.05)
    away, number = nearest(found, points)
    is_found = away < 1.0
    assert is_found[SNRS >= 20.0].mean() >= 0.8
    assert is_found[SNRS < 20.0].mean() >= 0.5
    bright = is_found & (SNRS >= 60.0)
    assert np.median(away[bright]) < 0.1
    # Four points, some on trails; the bound of the noise alone is 0.1 px.
    assert np.median(away[is_found & (SNRS == 20.0)]) < 0.4
    ratio = found.flux_adu[number] / points[:, 2]
    # A Moffat's far wings, and what a sum of Gaussians makes of the near ones: 3 to 10 % less.
    assert np.median(ratio[bright]) == pytest.approx(0.94, abs=0.06)
    away_from_all = np.hypot(
        found.x_px[:, None] - points[:, 0], found.y_px[:, None] - points[:, 1]
    ).min(axis=1)
    false = (away_from_all > 3.0) & ~found.is_trail_end
    assert (found.snr[false] > 6.0).sum() <= 5


def test_stars_of_long_trails_are_where_they_were_at_mid_exposure():
    """In a field of blends; by moments alone half are off by 0.5 px and more."""
    rng = np.random.default_rng(21)
    sky = TrailedSky(rng, angle_deg=20.0)
    stars = find_stars(sky.frame(np.zeros((0, 3))))
    assert stars.trail is not None
    assert len(stars) > 12
    places = sky.star_places
    away = np.hypot(stars.x_px[:, None] - places[:, 0], stars.y_px[:, None] - places[:, 1])
    assert np.median(away.min(axis=1)) < 0.35
    assert np.mean(away.min(axis=1) < 1.0) > 0.8


def test_errors_are_what_they_are_said_to_be():
    """Places and light of points without trails near them, over what their errors say."""
    rng = np.random.default_rng(5)
    sky = TrailedSky(rng, stars=50)
    off, light = [], []
    for _ in range(3):
        points = spread_points(rng, np.array([15.0, 25.0, 40.0] * 8))
        found = found_in(sky.frame(points))
        away, number = nearest(found, points)
        good = away < 1.5
        number, points = number[good], points[good]
        dx, dy = found.x_px[number] - points[:, 0], found.y_px[number] - points[:, 1]
        off.append(np.concatenate([dx, dy]) / np.tile(found.sigma_px[number], 2))
        light.append((found.flux_adu[number] - 0.97 * points[:, 2]) / found.flux_sigma_adu[number])
    spread = 1.4826 * np.median(np.abs(np.concatenate(off)))
    assert 0.75 < spread < 1.35
    assert 0.6 < 1.4826 * np.median(np.abs(np.concatenate(light))) < 1.5


def test_hot_pixels_are_no_points():
    rng = np.random.default_rng(8)
    sky = TrailedSky(rng, hot_pixels=400)
    found = found_in(sky.frame(np.zeros((0, 3))))
    assert found.is_shape_known
    assert found.lone_pixels > 150
    away, number = nearest(found, sky.hot)
    on_hot = away < 1.0
    assert (found.snr[number[on_hot]] > 6.0).sum() <= 1


def test_bad_pixels_side_by_side_are_no_points():
    rng = np.random.default_rng(9)
    frame = TrailedSky(rng, hot_pixels=0).frame(np.zeros((0, 3)))
    places = np.array([(x, y) for x in range(60, 760, 130) for y in range(60, 600, 140)])
    clear = [(x, y) for x, y in places if frame[y - 6 : y + 7, x - 25 : x + 26].mean() < 612.0]
    assert len(clear) > 5
    for x, y in clear:
        frame[y, x : x + 2] += 900
    found = found_in(frame)
    away, _ = nearest(found, np.array(clear, float))
    assert (away < 1.5).mean() < 0.1


def test_ends_of_two_trails_that_meet_are_said_to_be_that():
    rng = np.random.default_rng(3)
    sky = TrailedSky(rng, stars=50, hot_pixels=0)
    frame = sky.frame(np.zeros((0, 3))).astype(np.int64)
    pair = [
        streak_points((300.0 - 100.0, 322.3, 300.0, 322.3), 3e4),
        streak_points((297.0, 322.3, 397.0, 322.3), 5e4),
    ]
    alone = MoffatSky(
        shape=SHAPE,
        fwhm_px=FWHM_PX,
        beta=4.0,
        places_px=np.zeros((0, 2)),
        flux_adu=np.zeros(0),
    )
    frame += alone.drawn(rng, *pair).astype(np.int64) - 600
    found = found_in(np.clip(frame, 0, 65535).astype(np.uint16))
    near = np.hypot(found.x_px - 298.5, found.y_px - 322.3) < 3.0
    assert found.is_trail_end[near].all()


def test_frames_without_trails_have_no_points_of_this_kind():
    rng = np.random.default_rng(2)
    pixels = MoffatSky.of(rng).drawn(rng)
    sky = local_background(pixels)
    stars = find_stars(pixels, sky)
    assert stars.trail is None
    assert find_points(pixels, sky, stars) is None


def test_a_point_brighter_than_the_trails_gives_no_others_beside_it():
    rng = np.random.default_rng(4)
    points = np.array([[400.0, 300.0, point_flux(900.0)]])
    found = found_in(TrailedSky(rng, stars=50, hot_pixels=0).frame(points))
    near = np.hypot(found.x_px - 400.0, found.y_px - 300.0) < 19.0
    assert (near & (found.snr > 6.0)).sum() == 1
