"""What moves the image, measured in the pixels: drift, worm, wind, air, a restless mount."""

import numpy as np
import pytest

from rsoconsole.simulator.mount.mount_model import MountCreepAndJumps, MountModel
from rsoconsole.sky import pixel_to_sky, sky_to_pixel, wcs_from_cards
from tests.rigs.world_rig import (
    FOUR_STARS,
    NS,
    SCALE_ARCSEC_PX,
    centre_and_spread,
    expose,
    grid_px,
    mean_centre,
    mean_spread,
    stamps,
    streak_ends,
)

T0_UTC_NS = 1_687_500_000 * NS


@pytest.fixture(scope="module")
def still():
    with pytest.MonkeyPatch.context() as patch:
        yield expose(patch)


def mount(**unrest):
    return MountModel(
        latitude_deg=29.19,
        longitude_deg=-81.05,
        seed=1,
        t_utc_ns=T0_UTC_NS,
        ra_date_deg=200.0,
        dec_date_deg=-5.0,
        unrest=MountCreepAndJumps(1, T0_UTC_NS, **unrest),
    )


def test_a_drift_of_12_px_is_12_px_along_its_direction(monkeypatch, still):
    for angle_deg in (90.0, 30.0):
        world = {"stars": {"drift_px": 12.0, "drift_angle_deg": angle_deg}}
        more = mean_spread(expose(monkeypatch, world)) - mean_spread(still)
        values, vectors = np.linalg.eigh(more)
        # A uniform trail of length L has a variance of L^2 / 12.
        assert np.sqrt(12.0 * values[1]) == pytest.approx(12.0, abs=0.4)
        assert abs(values[0]) < 0.2
        along = np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])) % 180.0
        assert along == pytest.approx(angle_deg, abs=2.0)


def test_a_drift_is_a_rate_and_the_satellite_shares_it(monkeypatch):
    plain = np.diff(streak_ends(expose(monkeypatch, stars=False, satellite_mag=9.0)))
    world = {"stars": {"drift_px": 12.0, "drift_angle_deg": 0.0}}
    drifting = expose(monkeypatch, world, stars=False, satellite_mag=9.0)
    half_as_long = expose(monkeypatch, world, stars=False, satellite_mag=8.0, exposure_s=5.0)
    still_half = expose(monkeypatch, stars=False, satellite_mag=8.0, exposure_s=5.0)
    # The satellite moves towards smaller columns: against a drift to the right.
    assert plain - np.diff(streak_ends(drifting)) == pytest.approx(12.0, abs=0.5)
    shorter = np.diff(streak_ends(still_half)) - np.diff(streak_ends(half_as_long))
    assert shorter == pytest.approx(6.0, abs=0.5)


def test_periodic_error_is_a_sine_of_its_amplitude_and_period_in_right_ascension(monkeypatch):
    world = {"stars": {"periodic_arcsec": 10.0, "periodic_s": 400.0}}
    seconds = np.arange(0.0, 400.0, 40.0)
    places = np.array(
        [
            mean_centre(
                expose(
                    monkeypatch, world, second=s, exposure_s=2.0, star_mag=10.0, optics=FOUR_STARS
                )
            )
            for s in seconds
        ]
    )
    phase = 2.0 * np.pi * (seconds + 1.0) / 400.0
    design = np.stack([np.sin(phase), np.cos(phase), np.ones(len(phase))], axis=1)
    (a, b, _), *_ = np.linalg.lstsq(design, places[:, 0], rcond=None)
    assert np.hypot(a, b) * SCALE_ARCSEC_PX == pytest.approx(10.0, rel=0.05)
    assert np.std(places[:, 1]) < 0.15
    assert np.std(places[:, 0] - design @ [a, b, 0.0]) < 0.15


def test_wind_of_2_px_is_2_px_rms_on_each_axis(monkeypatch, still):
    base = np.diag(mean_spread(still)).mean()
    total = []
    for second in range(0, 240, 15):
        frame = expose(
            monkeypatch, {"wind": {"rms_px": 2.0}}, second=float(second), optics=FOUR_STARS
        )
        total.append(np.diag(mean_spread(frame)) + mean_centre(frame) ** 2)
    rms_px = np.sqrt(np.mean(total, axis=0) - base)
    assert rms_px == pytest.approx([2.0, 2.0], rel=0.15)


def test_wind_shakes_the_satellite_as_it_shakes_the_stars(monkeypatch):
    def rows(world):
        frame = expose(monkeypatch, world, stars=False, satellite_mag=8.0)
        middle = (len(frame.light) - 1) // 2
        band = np.clip(frame.light[middle - 12 : middle + 14, 110:210], 0.0, None)
        return (band * np.arange(len(band))[:, None]).sum(axis=0) / band.sum(axis=0)

    assert np.std(rows({})) < 0.3
    # Columns are instants: what is seen is the path itself, smoothed by the disc.
    assert np.std(rows({"wind": {"rms_px": 2.0}})) > 0.9


def test_image_motion_averages_out_in_long_exposures(monkeypatch):
    world = {"seeing": {"image_motion_arcsec": 3.0}}

    def scatter_arcsec(exposure_s, star_mag):
        centres = [
            mean_centre(
                expose(
                    monkeypatch,
                    world,
                    second=s,
                    exposure_s=exposure_s,
                    star_mag=star_mag,
                    optics=FOUR_STARS,
                )
            )
            for s in np.arange(0.0, 60.0, 2.0)
        ]
        return np.std(centres, axis=0).mean() * SCALE_ARCSEC_PX

    short, long = scatter_arcsec(0.1, 6.5), scatter_arcsec(5.0, 10.5)
    # Of a process that forgets itself after 0.05 s: 0.75 of it are left in 0.1 s, 0.14 in 5 s.
    assert short == pytest.approx(3.0 * 0.75, rel=0.3)
    assert long == pytest.approx(3.0 * 0.14, rel=0.4)


def test_a_field_that_rotates_trails_its_corners_and_not_its_middle(monkeypatch):
    still = expose(monkeypatch, {}, exposure_s=60.0, star_mag=13.0)
    turned = expose(
        monkeypatch, {"optics": {"rotation_deg_h": 60.0}}, exposure_s=60.0, star_mag=13.0
    )
    trails = []
    for box, before in zip(stamps(turned), stamps(still), strict=True):
        more = centre_and_spread(box, 40.0)[1] - centre_and_spread(before, 40.0)[1]
        trails.append(np.sqrt(12.0 * max(0.0, np.trace(more))))
    # 60 s of 60 deg/h are one degree, 2.96 px at the corner star (120 px, 120 px) off the middle.
    a_degree = np.radians(1.0)
    corner = np.hypot(119.5, 119.5) * a_degree
    assert np.mean([trails[0], trails[3], trails[12], trails[15]]) == pytest.approx(corner, rel=0.2)
    inner = np.mean([trails[5], trails[6], trails[9], trails[10]])
    assert inner < 0.6 * corner


def test_a_mount_that_settles_trails_the_beginning_of_an_exposure(monkeypatch, still):
    slewing = mount(settle_s=6.0, settle_arcsec=20.0)
    arrived_s = slewing.slew(210.0, -5.0, T0_UTC_NS)
    arrival = T0_UTC_NS + round(arrived_s * NS)
    assert not slewing.instant(arrival + 1).is_slewing
    path = slewing.creep_and_jump_path_arcsec(arrival, arrival + 10 * NS)
    # It still lacks 20 arcsec of its way east, and gets there within six of the ten seconds.
    assert path[0, 0] - path[0, -1] == pytest.approx(-20.0, abs=0.1)
    more = mean_spread(expose(monkeypatch, mount_path_arcsec=path)) - mean_spread(still)
    length_px = 20.0 / SCALE_ARCSEC_PX
    # Six tenths of the light lie along the trail, four tenths in its end.
    variance = 0.6 * length_px**2 / 3.0 - (0.6 * length_px / 2.0) ** 2
    assert more[0, 0] == pytest.approx(variance, rel=0.12)
    assert abs(more[1, 1]) < 0.2
    later = slewing.creep_and_jump_path_arcsec(arrival + 7 * NS, arrival + 17 * NS)
    assert not np.any(later)


def test_jumps_come_at_their_rate_and_split_the_stars(monkeypatch):
    jumping = mount(jump_arcsec=25.0, jump_every_s=300.0)
    offsets = np.array([jumping.boresight_date_deg(T0_UTC_NS + s * NS) for s in range(0, 6000, 10)])
    steps = np.diff(offsets, axis=0) * [np.cos(np.radians(5.0)), 1.0] * 3600.0
    sizes = np.hypot(*(steps - np.median(steps, axis=0)).T)
    jumped = np.flatnonzero(sizes > 5.0)
    assert len(jumped) in range(17, 22)
    assert np.median(sizes[jumped]) == pytest.approx(25.0, rel=0.05)
    # An exposure with a jump in its middle shows every star twice.
    begin = T0_UTC_NS + (10 * int(jumped[0])) * NS
    path = jumping.creep_and_jump_path_arcsec(begin, begin + 10 * NS)
    frame = expose(monkeypatch, mount_path_arcsec=path)
    share = np.mean(np.all(np.isclose(path, path[:, [0]]), axis=0))
    variance = share * (1.0 - share) * (25.0 / SCALE_ARCSEC_PX) ** 2
    assert np.trace(mean_spread(frame)) > 0.7 * variance


def test_the_truth_says_where_a_moving_image_stood_in_the_mean(monkeypatch, still):
    world = {"wind": {"rms_px": 3.0}, "stars": {"periodic_arcsec": 20.0, "drift_px": 8.0}}
    frame = expose(monkeypatch, world)
    sky = pixel_to_sky(wcs_from_cards(still.truth.wcs_cards), *grid_px())
    x, y = sky_to_pixel(wcs_from_cards(frame.truth.wcs_cards), *sky)
    told = np.array([np.mean(x - grid_px()[0]), np.mean(y - grid_px()[1])])
    assert np.hypot(*told) > 2.0
    assert mean_centre(frame) == pytest.approx(told, abs=0.15)
