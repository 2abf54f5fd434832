"""Points of several frames confirmed: by place, by one slow motion, and never by chance alone."""

import numpy as np
import pytest

from rsoconsole.pipeline import points_report
from rsoconsole.pipeline.points.confirm import PointTrack, confirm_points
from rsoconsole.pipeline.points.frame_points import FramePoints, compare_by_plates
from rsoconsole.sky import icrs_to_jnow, jnow_to_icrs, sky_to_pixel, tan_wcs
from rsoconsole.sky.epoch import SIDEREAL_DEG_S
from rsoconsole.vision import PointList, find_stars, local_background
from rsoconsole.vision.points.points import find_points
from rsoconsole.vision.stars.star_list import StarTrail
from tests.drawn.drawn_trails import SHAPE, TrailedSky, spread_points
from tests.makers import T0_UTC_NS

SIZE_PX = (2048, 2048)
CADENCE_NS = 25_000_000_000
EXPOSURE_S = 10.0


def listed(
    places: list[tuple[float, float]] | np.ndarray,
    snr: float | np.ndarray = 12.0,
    *,
    is_trail_end: bool = False,
    is_shape_known: bool = True,
) -> PointList:
    x, y = np.asarray(places, float).reshape(-1, 2).T
    snrs = np.broadcast_to(np.asarray(snr, float), x.shape)
    return PointList(
        x_px=x,
        y_px=y,
        snr=snrs,
        flux_adu=100.0 * snrs,
        flux_sigma_adu=np.full(x.size, 100.0),
        sigma_px=1.6 / snrs,
        is_trail_end=np.full(x.size, is_trail_end),
        is_shape_known=is_shape_known,
        fwhm_px=2.7,
        trail=StarTrail(length_px=119.0, angle_deg=0.0, fwhm_px=2.7),
        lone_pixels=0,
    )


def sequence(*lists: PointList) -> list[FramePoints]:
    return [
        FramePoints.by_pixels(each, T0_UTC_NS + k * CADENCE_NS, SIZE_PX)
        for k, each in enumerate(lists)
    ]


def states(tracks: tuple[PointTrack, ...]) -> list[str]:
    return [each.state for each in tracks]


def test_three_of_five_frames_confirm_a_place():
    here, nothing = listed([(500.0, 700.0)]), listed([])
    tracks = confirm_points(sequence(here, nothing, here, nothing, here), EXPOSURE_S)
    assert states(tracks) == ["confirmed"]
    assert tracks[0].numbers == (0, None, 0, None, 0)
    assert tracks[0].rate_px_s == (0.0, 0.0)
    assert tracks[0].snr == pytest.approx(12.0 * 3**0.5)


def test_two_frames_do_not():
    here, nothing = listed([(500.0, 700.0)]), listed([])
    assert states(confirm_points(sequence(here, nothing, nothing, nothing, here), EXPOSURE_S)) == [
        "two frames"
    ]
    assert confirm_points(sequence(here, nothing), EXPOSURE_S) == ()
    assert confirm_points(sequence(here), EXPOSURE_S) == ()


def test_only_the_last_five_frames_count():
    here, nothing = listed([(500.0, 700.0)]), listed([])
    lists = [here, here, here, nothing, nothing, nothing, nothing]
    assert confirm_points(sequence(*lists), EXPOSURE_S) == ()
    assert states(confirm_points(sequence(*lists[:6]), EXPOSURE_S)) == ["two frames"]


def test_a_slow_motion_is_confirmed_with_its_rate():
    moving = [listed([(500.0 + 2.5 * k, 700.0 - 5.0 * k)], 30.0) for k in range(5)]
    (track,) = confirm_points(sequence(*moving), EXPOSURE_S)
    assert track.state == "confirmed"
    assert track.rate_px_s == pytest.approx((0.1, -0.2), abs=1e-6)
    assert (track.x_px, track.y_px, track.t_s) == pytest.approx((505.0, 690.0, 50.0))


def test_what_is_too_fast_to_be_a_point_is_none():
    """It would move by eight pixels during the exposure, and be a streak."""
    moving = [listed([(500.0 + 20.0 * k, 700.0)], 30.0) for k in range(5)]
    assert confirm_points(sequence(*moving), EXPOSURE_S) == ()


def test_trails_ends_that_meet_in_each_frame_are_doubted():
    here = listed([(500.0, 700.0)], is_trail_end=True)
    assert states(confirm_points(sequence(*[here] * 5), EXPOSURE_S)) == ["trail ends"]


def test_bad_pixels_need_a_second_pointing_where_shape_does_not_tell():
    here = listed([(500.0, 700.0)], is_shape_known=False)
    frames = sequence(*[here] * 5)
    assert states(confirm_points(frames, EXPOSURE_S)) == ["same pixels"]
    wcs = [tan_wcs_at(10.0, t) for t in range(5)]
    assert states(confirm_points(compare_by_plates(frames, wcs), EXPOSURE_S)) == ["same pixels"]
    moved = [wcs[0], *(tan_wcs_at(10.0, t, shift_px=8.0) for t in range(1, 5))]
    # Fixed pixels are elsewhere on the moved sky: four frames agree, by one pointing still.
    assert "confirmed" not in states(confirm_points(compare_by_plates(frames, moved), EXPOSURE_S))
    followed = [
        here,
        *(listed([(508.0, 700.0)], is_shape_known=False) for _ in range(4)),
    ]
    tracks = confirm_points(compare_by_plates(sequence(*followed), moved), EXPOSURE_S)
    assert states(tracks) == ["confirmed"]
    assert tracks[0].numbers == (0,) * 5


def tan_wcs_at(dec_deg: float, number: int, shift_px: float = 0.0):
    """Plate of a telescope at rest, ``number`` frames on, its image moved along the rows."""
    ra, dec = icrs_to_jnow(200.0, dec_deg, T0_UTC_NS)
    t_ns = T0_UTC_NS + number * CADENCE_NS
    ra_deg, dec_deg = jnow_to_icrs(ra + SIDEREAL_DEG_S * number * 25.0, dec, t_ns)
    wcs = tan_wcs(
        float(ra_deg),
        float(dec_deg),
        scale_arcsec_px=1.264,
        rotation_deg=0.0,
        is_flipped=False,
        width_px=SIZE_PX[0],
        height_px=SIZE_PX[1],
    )
    return type(wcs)(
        crpix_x_px=wcs.crpix_x_px + shift_px,
        crpix_y_px=wcs.crpix_y_px,
        crval_ra_deg=wcs.crval_ra_deg,
        crval_dec_deg=wcs.crval_dec_deg,
        cd=wcs.cd,
    )


def test_plates_bring_what_rests_at_its_hour_angle_to_one_place():
    ra, dec = icrs_to_jnow(200.2, 10.1, T0_UTC_NS)
    frames, wcs = [], [tan_wcs_at(10.0, number) for number in range(5)]
    for number in range(5):
        t_ns = T0_UTC_NS + number * CADENCE_NS
        here = jnow_to_icrs(ra + SIDEREAL_DEG_S * 25.0 * number, dec, t_ns)
        x, y = sky_to_pixel(wcs[number], *here)
        frames.append(FramePoints.by_pixels(listed([(float(x), float(y))]), t_ns, SIZE_PX))
    moved = compare_by_plates(frames, wcs)
    places = np.array([(each.x_px[0], each.y_px[0]) for each in moved])
    # A tenth of an arcsecond: rotation of the field about the pole of date.
    assert np.ptp(places, axis=0).max() < 0.1


@pytest.mark.parametrize("count", [60, 300])
def test_points_by_chance_confirm_nothing(count):
    rng = np.random.default_rng(count)
    false = 0
    for _ in range(10):
        lists = [
            listed(
                rng.uniform(0.0, 2048.0, (count, 2)),
                np.sort(3.7 + rng.exponential(0.4, count))[::-1],
            )
            for _ in range(5)
        ]
        false += states(confirm_points(sequence(*lists), EXPOSURE_S)).count("confirmed")
    assert false == 0


def test_drawn_frames_from_pixels_to_confirmed_objects():
    """Satellites at rest and one that drifts, among trails and hot pixels that stay in place."""
    rng = np.random.default_rng(11)
    sky = TrailedSky(rng)
    points = spread_points(rng, np.array([12.0] * 5 + [25.0] * 4 + [80.0] * 4))
    drift = np.zeros((len(points), 3))
    drift[5, :2] = 2.0, 1.0
    frames = []
    for number in range(5):
        pixels = sky.frame(points + number * drift, drift_px=250.0 * number)
        background = local_background(pixels)
        found = find_points(pixels, background, find_stars(pixels, background))
        assert found is not None
        t_ns = T0_UTC_NS + number * CADENCE_NS
        frames.append(FramePoints.by_pixels(found, t_ns, (SHAPE[1], SHAPE[0])))
    tracks = [each for each in confirm_points(frames, EXPOSURE_S) if each.state == "confirmed"]
    where = points + 2.0 * drift
    away = np.array(
        [
            [
                np.hypot(
                    each.x_px + each.rate_px_s[0] * (50.0 - each.t_s) - x,
                    each.y_px + each.rate_px_s[1] * (50.0 - each.t_s) - y,
                )
                for each in tracks
            ]
            for x, y, _ in where
        ]
    )
    assert (away.min(axis=1) < 1.0).sum() >= len(points) - 1
    assert (away.min(axis=0) > 2.0).sum() == 0
    drifting = tracks[int(away[5].argmin())]
    assert drifting.rate_px_s == pytest.approx((0.08, 0.04), abs=0.01)


def test_one_frames_sure_points_are_reported():
    points = listed([(500.0, 700.0), (90.0, 80.0)], np.array([12.0, 4.0]))
    (sure,) = points_report(points)
    assert (sure["x"], sure["y"], sure["snr"]) == (500.0, 700.0, 12.0)
    assert points_report(None) == []
