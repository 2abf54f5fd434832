"""What the simulated telescope sees agrees with its truth, the catalogue and skyfield."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.config import OpticsConfig
from rsoconsole.simulator import CloudDeck, Scene, scenario_named
from rsoconsole.simulator.camera.sensor import catalogue_errors_arcsec
from rsoconsole.simulator.nights.scenarios import CLEAR, STEADY
from rsoconsole.simulator.scene import scene as scene_module
from rsoconsole.simulator.sky.star_background import faint_stars, galactic_latitude_deg
from rsoconsole.sky import (
    icrs_of_hour_angle,
    pixel_to_sky,
    separation_deg,
    sky_to_pixel,
    wcs_from_cards,
)
from tests.truth.frame_truth import truth_from_json

NS = 1_000_000_000
SMALL = OpticsConfig(width_px=900, height_px=700)
TARGET_HOUR_ANGLE_DEG = {"intelsat-14": -41.0, "ses-10": -16.17, "intelsat-21": -26.4, "empty": -36}


def aim(name, seconds):
    """Direction of the scenario's target so long after its start."""
    scenario = scenario_named(name)
    t = scenario.t_start_utc_ns + round(seconds * NS)
    declination = scenario.start_declination_deg
    return icrs_of_hour_angle(scenario.site, TARGET_HOUR_ANGLE_DEG[name], declination, t), t


def exposed(
    name, seconds=60.0, *, seed=1, scenario=None, optics=SMALL, rotation=1.7, flipped=False
):
    (ra, dec), t = aim(name, seconds)
    scene = Scene(scenario or scenario_named(name), seed, optics=optics)
    return scene, *scene.expose(ra, dec, rotation, flipped, t, 10.0)


@pytest.fixture(scope="module")
def night():
    return exposed("intelsat-14")


def profile_along(pixels, start, end, margin=25.0):
    """Mean light within 2 px of the line through the ends, at each half pixel along it."""
    from scipy.ndimage import map_coordinates

    length = np.hypot(end[0] - start[0], end[1] - start[1])
    ux, uy = (end[0] - start[0]) / length, (end[1] - start[1]) / length
    along = np.arange(-margin, length + margin, 0.5)
    across = np.arange(-2.0, 2.1, 0.5)
    x = start[0] + ux * along[:, None] - uy * across
    y = start[1] + uy * along[:, None] + ux * across
    light = map_coordinates(pixels.astype(float), [y, x], order=1).mean(axis=1)
    return along, light - np.median(pixels), length


def test_the_frame_is_what_the_camera_gives(night):
    _, pixels, truth = night
    assert pixels.shape == (700, 900)
    assert pixels.dtype == np.uint16
    assert truth.t_mid_utc_ns - truth.t_start_utc_ns == 5 * NS


def test_catalogue_stars_lie_where_the_plate_of_the_truth_says():
    wide = OpticsConfig(width_px=2400, height_px=1600)
    scene, pixels, truth = exposed("intelsat-14", optics=wide)
    wcs = wcs_from_cards(truth.wcs_cards)
    stars = scene.catalogue.cone(truth.boresight_ra_icrs_deg, truth.boresight_dec_icrs_deg, 0.5)
    x, y = sky_to_pixel(wcs, stars.ra_icrs_deg, stars.dec_icrs_deg)
    residuals = []
    level = np.median(pixels)
    for each_x, each_y, magnitude in zip(x, y, stars.magnitude, strict=True):
        if not (20 < each_x < 2380 and 20 < each_y < 1580 and 9.5 < magnitude < 11.8):
            continue
        column, row = round(float(each_x)), round(float(each_y))
        box = pixels[row - 4 : row + 5, column - 4 : column + 5].astype(float) - level
        box[box < 150] = 0.0
        rows, columns = np.indices(box.shape)
        residuals.append(
            (
                (box * columns).sum() / box.sum() - 4 + column - each_x,
                (box * rows).sum() / box.sum() - 4 + row - each_y,
            )
        )
    assert len(residuals) >= 4
    a_fifth_of_a_pixel = 0.2
    assert np.all(np.abs(np.median(residuals, axis=0)) < a_fifth_of_a_pixel)


def test_the_plate_agrees_with_astropy(monkeypatch):
    from astropy.io.fits import Header
    from astropy.wcs import WCS

    monkeypatch.setattr(scene_module, "SHUTTER_SIGMA_S", 0.0)
    monkeypatch.setattr(scene_module, "atmospheric_shift_sigma_arcsec", lambda _exposure_s: 0.0)
    _, _, truth = exposed("intelsat-14")
    theirs = WCS(Header(truth.wcs_cards))
    for satellite in truth.satellites:
        x, y = theirs.all_world2pix(satellite.ra_icrs_deg, satellite.dec_icrs_deg, 0)
        assert (float(x), float(y)) == pytest.approx((satellite.x_px, satellite.y_px), abs=1e-3)


@pytest.mark.parametrize(("rotation", "flipped"), [(1.7, False), (181.7, False), (-30.0, True)])
def test_the_streak_ends_where_the_truth_says(rotation, flipped):
    _, pixels, truth = exposed("intelsat-14", rotation=rotation, flipped=flipped)
    [target] = [each for each in truth.satellites if each.norad_id == 36097]
    assert target.is_in_frame
    assert target.is_whole
    start, end = (target.x_start_px, target.y_start_px), (target.x_end_px, target.y_end_px)
    along, light, length = profile_along(pixels, start, end)
    plateau = np.median(light[(along > 10) & (along < length - 10)])
    smooth = np.convolve(light, np.ones(5) / 5, "same")
    is_bright = along[smooth > plateau / 2]
    core = is_bright[(is_bright > -15) & (is_bright < length + 15)]
    one_and_a_half_px = 1.5
    assert abs(core.min()) < one_and_a_half_px
    assert abs(core.max() - length) < one_and_a_half_px
    # 14.98 arcsec/s on the sky over 10 s.
    assert length * 1.26420 == pytest.approx(149.8, abs=1.0)


def test_a_normal_night_shows_its_target_with_confidence(night):
    _, _, truth = night
    [target] = [each for each in truth.satellites if each.norad_id == 36097]
    assert target.snr_peak_pixel >= 4.0
    assert target.snr_matched > 50.0
    assert target.lit_fraction == 1.0
    assert target.transmission == 1.0


def test_the_told_signal_to_noise_is_that_of_the_pixels(night):
    _, pixels, truth = night
    [target] = [each for each in truth.satellites if each.norad_id == 36097]
    start, end = (target.x_start_px, target.y_start_px), (target.x_end_px, target.y_end_px)
    length = np.hypot(end[0] - start[0], end[1] - start[1])
    steps = np.arange(10, length - 10)
    x = start[0] + (end[0] - start[0]) * steps / length
    y = start[1] + (end[1] - start[1]) * steps / length
    columns, rows = np.rint(x).astype(int), np.rint(y).astype(int)
    crest = np.max([pixels[rows + shift, columns] for shift in (-1, 0, 1)], axis=0).astype(float)
    dark = pixels[np.abs(pixels.astype(float) - np.median(pixels)) < 180].astype(float)
    measured = (np.median(crest) - dark.mean()) / dark.std()
    a_quarter = 0.25
    assert measured == pytest.approx(target.snr_peak_pixel, rel=a_quarter)


def test_the_true_place_agrees_with_skyfield(night):
    import skyfield_data
    from skyfield.api import EarthSatellite, load, load_file, wgs84

    scene, _, truth = night
    ephemeris = load_file(str(Path(skyfield_data.__file__).parent / "data" / "de421.bsp"))
    try:
        earth = ephemeris["earth"]
        timescale = load.timescale(builtin=True)
        seconds = (truth.t_mid_utc_ns - scene.scenario.t_start_utc_ns) / NS
        instant = timescale.utc(2023, 6, 23, 5, 30, seconds)
        [target] = [each for each in truth.satellites if each.norad_id == 36097]
        elements = scene.satellites[0].element_set
        there = EarthSatellite(elements.line_1, elements.line_2, "", timescale)
        site = scene.site
        ground = wgs84.latlon(site.latitude_deg, site.longitude_deg, site.elevation_m)
        ra, dec, _ = (earth + ground).at(instant).observe(earth + there).radec()
        off = separation_deg(target.ra_icrs_deg, target.dec_icrs_deg, ra._degrees, dec.degrees)
    finally:
        ephemeris.close()
    # Without a shared table of UT1 and polar motion: a few hundredths of an arcsecond.
    a_tenth_arcsec = 0.1
    assert off * 3600 < a_tenth_arcsec


def test_the_same_night_gives_the_same_frame_whatever_was_asked_before(night):
    scene, pixels, truth = night
    (ra, dec), t = aim("intelsat-14", 300.0)
    scene.expose(ra, dec, 1.7, False, t, 10.0)
    _, again, truth_again = exposed("intelsat-14")
    assert np.array_equal(pixels, again)
    assert truth.to_json() == truth_again.to_json()


def test_another_seed_changes_the_noise_and_not_the_sky(night):
    _, pixels, truth = night
    _, other, other_truth = exposed("intelsat-14", seed=2)
    assert not np.array_equal(pixels, other)
    assert other_truth.stars == truth.stars
    assert other_truth.satellites[0].ra_icrs_deg == truth.satellites[0].ra_icrs_deg


def test_air_and_shutter_move_the_streak_by_what_they_are_said_to():
    """Against its place on the plate: 0.125 arcsec of air on each axis, 0.23 of shutter along."""
    offsets_arcsec = []
    for second in range(60):
        (ra, dec), t = aim("intelsat-14", float(second))
        tiny = OpticsConfig(width_px=64, height_px=64)
        _, truth = Scene(scenario_named("intelsat-14"), 3, optics=tiny).expose(
            ra, dec, 0.0, False, t, 10.0
        )
        plate = wcs_from_cards(truth.wcs_cards)
        for satellite in truth.satellites:
            x, y = sky_to_pixel(plate, satellite.ra_icrs_deg, satellite.dec_icrs_deg)
            offsets_arcsec.append((satellite.x_px - float(x), satellite.y_px - float(y)))
    along, across = np.std(offsets_arcsec, axis=0) * 1.264
    assert len(offsets_arcsec) == 60
    assert along == pytest.approx(np.hypot(0.125, 0.225), rel=0.3)
    assert across == pytest.approx(0.125, rel=0.3)


def test_stars_miss_their_places_always_by_the_same():
    stars = Scene(scenario_named("intelsat-14"), 1).catalogue.cone(150.0, -5.0, 1.5)
    east, north = catalogue_errors_arcsec(stars.ra_icrs_deg, stars.dec_icrs_deg)
    again, _ = catalogue_errors_arcsec(stars.ra_icrs_deg[::-1], stars.dec_icrs_deg[::-1])
    assert np.array_equal(again[::-1], east)
    assert [np.std(east), np.std(north)] == pytest.approx([0.45, 0.45], rel=0.1)
    assert abs(np.corrcoef(east, north)[0, 1]) < 0.15


def test_truth_travels_as_one_line_of_json(night):
    _, _, truth = night
    text = truth.to_json()
    assert "\n" not in text
    assert truth_from_json(text) == truth
    assert json.loads(text)["satellites"][0]["name"] == "INTELSAT 14"


def test_two_satellites_share_the_field_of_ses_10():
    optics = OpticsConfig(width_px=1400, height_px=500)
    _, _, truth = exposed("ses-10", optics=optics)
    assert {each.norad_id for each in truth.satellites if each.is_in_frame} == {42432, 49332}
    brightest = max(truth.satellites, key=lambda each: each.snr_matched)
    assert brightest.norad_id == 42432


def test_a_clipped_streak_is_told():
    (ra, dec), t = aim("intelsat-14", 60.0)
    scene = Scene(scenario_named("intelsat-14"), 1, optics=SMALL)
    _, truth = scene.expose(ra, dec, 1.7, False, t, 10.0)
    wcs = wcs_from_cards(truth.wcs_cards)
    x_past = truth.satellites[0].x_px - 449.5
    shifted_ra, shifted_dec = pixel_to_sky(wcs, 449.5 + x_past + 440.0, truth.satellites[0].y_px)
    _, truth = scene.expose(float(shifted_ra), float(shifted_dec), 1.7, False, t, 10.0)
    target = truth.satellites[0]
    assert target.is_in_frame
    assert not target.is_whole


def test_the_empty_scenario_has_stars_and_no_satellite():
    _, _, truth = exposed("empty")
    assert truth.satellites == ()
    assert truth.stars > 300


def test_a_fading_satellite_is_as_faint_as_its_history_says(monkeypatch):
    monkeypatch.setattr(scene_module, "render", lambda *_: np.zeros((1, 1), np.uint16))
    fading = scenario_named("intelsat-14")
    [target] = [each for each in fading.satellites if each.element_set.norad_id == 36097]
    steady = replace(fading, satellites=(replace(target, brightness=STEADY),))
    lost_mag, told_mag = [], []
    for seconds in np.arange(0.0, 1171.0, 90.0):
        found = []
        for scenario in (fading, steady):
            _, _, truth = exposed("intelsat-14", float(seconds), seed=2, scenario=scenario)
            found += [each.magnitude for each in truth.satellites if each.norad_id == 36097]
        lost_mag.append(found[0] - found[1])
        told_mag.append(target.brightness.extra_mag(np.array([seconds + 5.0]), 2)[0])
    # Over ten seconds a fade is not quite straight.
    assert lost_mag == pytest.approx(told_mag, abs=0.1)
    assert max(lost_mag) > 4.0


def test_one_cloud_of_intelsat_21_hides_it_and_the_others_only_dim_it(monkeypatch):
    monkeypatch.setattr(scene_module, "render", lambda *_: np.zeros((1, 1), np.uint16))
    for seed in (1, 2, 3):
        transmission = []
        for seconds in np.arange(0.0, 1201.0, 30.0):
            _, _, truth = exposed("intelsat-21", float(seconds), seed=seed)
            [target] = [each for each in truth.satellites if each.norad_id == 38749]
            transmission.append(target.transmission)
        hidden = np.flatnonzero(np.array(transmission) < 0.1)
        assert list(hidden) == [9], (seed, transmission)
        dimmed = np.array(transmission)
        assert np.sum((dimmed > 0.1) & (dimmed < 0.6)) >= 4
        assert np.sum(dimmed > 0.7) >= 8


def test_a_cloud_moves_with_the_wind_and_does_not_jump():
    deck = CloudDeck(schedule=((0.0, 0.5), (1000.0, 0.5)))
    west, north = np.meshgrid(np.linspace(-40, -39, 20), np.linspace(-5, -4, 20))
    then = deck.extinction_mag(west, north, 100.0, seed=3)
    drift = np.array(deck.wind_deg_s) * 60.0
    later = deck.extinction_mag(west + drift[0], north + drift[1], 160.0, seed=3)
    assert later == pytest.approx(then, rel=1e-9)
    assert np.std(then) > 0.02
    a_moment_later = deck.extinction_mag(west, north, 100.1, seed=3)
    assert a_moment_later == pytest.approx(then, rel=0.05)


def test_a_satellite_in_the_umbra_leaves_no_streak(monkeypatch):
    from rsoconsole.orbits.elements import catalogue as satellite
    from rsoconsole.simulator.sky import passes

    def unlit(position_gcrs_km, t_utc_ns):
        return np.zeros(len(position_gcrs_km))

    monkeypatch.setattr(satellite, "lit_fraction", unlit)
    monkeypatch.setattr(passes, "lit_fraction", unlit)
    _, pixels, truth = exposed("intelsat-14")
    target = truth.satellites[0]
    assert target.magnitude is None
    assert target.electrons == 0.0
    along, light, length = profile_along(
        pixels, (target.x_start_px, target.y_start_px), (target.x_end_px, target.y_end_px)
    )
    assert np.median(light[(along > 10) & (along < length - 10)]) < 16.0
    assert truth_from_json(truth.to_json()) == truth


def test_a_satellite_entering_the_shadow_fades_along_its_streak():
    """Near the March equinox a geostationary satellite crosses the penumbra within two minutes."""
    from rsoconsole.orbits import Satellite
    from rsoconsole.sky import iso_to_utc_ns, lit_fraction

    scenario = scenario_named("intelsat-14")
    satellite = Satellite(scenario.satellites[0].element_set)
    t = iso_to_utc_ns("2023-09-22T00:00:00Z") + np.arange(0, 86_400, 5) * NS
    lit = lit_fraction(satellite.position_gcrs(t)[0], t)
    entering = int(t[np.flatnonzero((lit[:-1] > 0.5) & (lit[1:] <= 0.5))[0]])
    place = satellite.astrometric_place(scenario.site, np.array([entering]))
    scene = Scene(replace(scenario, t_start_utc_ns=entering, clouds=CLEAR), 1, optics=SMALL)
    ra, dec = float(place.ra_icrs_deg[0]), float(place.dec_icrs_deg[0])
    pixels, truth = scene.expose(ra, dec, 0.0, False, entering, 40.0)
    target = truth.satellites[0]
    assert 0.0 < target.lit_fraction < 0.9
    start, end = (target.x_start_px, target.y_start_px), (target.x_end_px, target.y_end_px)
    along, light, length = profile_along(pixels, start, end)
    first = np.median(light[(along > 10) & (along < length / 4)])
    last = np.median(light[(along > length * 3 / 4) & (along < length - 10)])
    assert last < 0.6 * first


def test_overlapping_fields_hold_the_same_faint_stars():
    one = faint_stars(310.0, -4.8, 0.6, 17.0)
    other = faint_stars(310.4, -4.7, 0.6, 17.0)
    shared = set(zip(one.ra_icrs_deg, one.dec_icrs_deg, strict=True)) & set(
        zip(other.ra_icrs_deg, other.dec_icrs_deg, strict=True)
    )
    near = separation_deg(310.2, -4.75, one.ra_icrs_deg, one.dec_icrs_deg) < 0.3
    assert near.sum() > 50
    inside = set(zip(one.ra_icrs_deg[near], one.dec_icrs_deg[near], strict=True))
    assert inside <= shared


def test_the_milky_way_is_crowded_and_the_pole_is_not():
    assert galactic_latitude_deg(192.85948, 27.12825) == pytest.approx(90.0, abs=1e-3)
    # Sagittarius A*: the plane's centre.
    assert galactic_latitude_deg(266.41684, -29.00781) == pytest.approx(-0.05, abs=0.02)

    def stars_a_square_degree(ra, dec):
        found = faint_stars(ra, dec, 1.0, 17.0)
        near = separation_deg(ra, dec, found.ra_icrs_deg, found.dec_icrs_deg) < 1.0
        return near.sum() / np.pi

    plane, high = stars_a_square_degree(284.0, 0.0), stars_a_square_degree(192.9, 11.0)
    assert 6000 < plane < 16_000
    assert 500 < high < 2000


def test_beyond_the_shipped_stars_the_sky_is_empty_and_says_so():
    scene = Scene(scenario_named("empty"), 1, optics=SMALL)
    assert scene.empty_sky_message(-4.8) is None
    assert "stars end at +12 deg" in scene.empty_sky_message(40.0)
    _, t = aim("empty", 0.0)
    _, truth = scene.expose(100.0, 40.0, 0.0, False, t, 10.0)
    assert truth.stars == 0
