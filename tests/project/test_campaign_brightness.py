"""The campaign of brightness draws lights of the magnitudes that it states; its table is right."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest

from models.telescopes import QUARTER
from rsoconsole.records import StreakLight
from rsoconsole.simulator import frame_rng, vignetting
from rsoconsole.sky import StarCatalogue, Stars, tan_wcs
from tests.campaign import brightness, brightness_worlds
from tests.campaign.brightness_worlds import (
    FAMILIES,
    exposed,
    satellites,
    star_cores,
    star_lights,
    world_of,
)


@pytest.fixture(scope="module")
def drawn():
    rng = frame_rng(5)
    world = world_of(FAMILIES["worlds"], rng)
    return world, *satellites(world, rng)


def beside_line(ends, reach_px):
    """Rows and columns of the pixels within a distance of a line."""
    a, b = np.array(ends[:2]), np.array(ends[2:])
    low = np.floor(np.minimum(a, b) - reach_px).astype(int)
    high = np.ceil(np.maximum(a, b) + reach_px).astype(int)
    y, x = np.mgrid[low[1] : high[1], low[0] : high[0]]
    along = ((x - a[0]) * (b - a)[0] + (y - a[1]) * (b - a)[1]) / np.sum((b - a) ** 2)
    along = np.clip(along, 0.0, 1.0)
    is_near = np.hypot(x - a[0] - along * (b - a)[0], y - a[1] - along * (b - a)[1]) < reach_px
    return y[is_near], x[is_near]


def test_a_streak_has_the_light_of_its_magnitude(drawn):
    """By the sum of the pixels about it, with the streak and without."""
    world, lights, streaks = drawn
    sensor, exposure_s = world.scene.sensor, world.scene.content.exposure_s
    with_all, without = (
        exposed(world, shown, np.zeros(2), frame_rng(6, len(shown))).astype(float)
        / 2.0**sensor.stored_shift_bits
        * sensor.e_per_adu12
        for shown in (streaks, ())
    )
    judged = 0
    for light in lights:
        about = beside_line(light.ends, 7.0 * world.scene.content.fwhm_px)
        found_e = float(np.sum((with_all - without)[about]))
        noise_e = math.sqrt(float(np.sum((with_all + without)[about])))
        middle = (np.array([0.5 * sum(light.ends[i::2])]) for i in (0, 1))
        wanted_e = exposure_s * 10 ** (0.4 * (sensor.zero_point_mag - light.sun_mag))
        wanted_e *= float(vignetting(sensor, *middle)[0])
        per_adu = sensor.e_per_adu12 / 2.0**sensor.stored_shift_bits
        assert light.flux_adu * per_adu == pytest.approx(wanted_e, rel=0.02)
        judged += noise_e < 0.05 * wanted_e
        two_percent_and_noise = 0.02 * wanted_e + 3.0 * noise_e
        assert found_e == pytest.approx(wanted_e, abs=two_percent_and_noise)
    assert judged >= 2


def test_a_frame_has_the_light_of_its_stars(drawn):
    world, _, _ = drawn
    content, sensor = world.scene.content, world.scene.sensor
    light = brightness_worlds.with_wings(star_cores(world, np.zeros(2)), 1.0)
    inside = (content.star_x_px > 0) & (content.star_x_px < sensor.width_px - 1)
    inside &= (content.star_y_px > 0) & (content.star_y_px < sensor.height_px - 1)
    two_percent = 0.02
    assert light.sum() == pytest.approx(content.star_electrons[inside].sum(), rel=two_percent)


@pytest.mark.parametrize(("name", "sigma_mag"), [("clear", 0.02), ("errors", 0.11)])
def test_stars_are_off_their_catalogue_magnitude_by_what_is_said(name, sigma_mag):
    """Against VT and BT - VT by the catalogue, with a colour term of a tenth."""
    wcs = tan_wcs(
        80.0, 2.0, scale_arcsec_px=4.0, rotation_deg=10.0, is_flipped=False,
        width_px=2000, height_px=2000,
    )  # fmt: skip
    known = StarCatalogue.load().cone(80.0, 2.0, 0.9)
    known = Stars(*(getattr(known, f.name)[~np.isnan(known.colour_mag)] for f in fields(Stars)))
    sensor = replace(QUARTER, width_px=2000, height_px=2000)
    none = Stars.without_proper_motion(np.zeros(0), np.zeros(0), np.zeros(0))
    x, _, electrons = star_lights(
        sensor, 1.0, wcs, (known, none), 0.1, FAMILIES[name], np.random.default_rng(3)
    )
    assert len(x) == len(known) > 80
    wanted = known.magnitude + 0.1 * (known.colour_mag - 0.73)
    off = sensor.zero_point_mag - 2.5 * np.log10(electrons) - wanted
    assert np.sqrt(np.mean(off**2)) == pytest.approx(sigma_mag, rel=0.35)
    assert abs(np.mean(off)) < 3.0 * sigma_mag / math.sqrt(len(off))


def test_wings_are_those_of_the_renderer():
    from rsoconsole.simulator import FWHM_PER_SIGMA, add_sources
    from rsoconsole.simulator.camera.psf import add_points

    theirs, core = np.zeros((301, 301), np.float32), np.zeros((301, 301), np.float32)
    at = np.array([150.3]), np.array([149.8]), np.array([1e8])
    add_sources(theirs, *at, fwhm_px=3.0)
    add_points(core, *at, sigma_px=3.0 / FWHM_PER_SIGMA)
    ours = brightness_worlds.with_wings(core, 3.0 / FWHM_PER_SIGMA)
    for reach in (1, 3, 6, 12, 30, 80):
        about = np.s_[150 - reach : 151 + reach, 150 - reach : 151 + reach]
        assert ours[about].sum() == pytest.approx(theirs[about].sum(), rel=0.003)


def test_slow_curves_have_a_mean_of_one():
    for number in range(20):
        curve = brightness_worlds.slow_curve(frame_rng(number))
        t = np.linspace(0.0, 1.0, len(curve))
        assert np.trapezoid(curve, t) == pytest.approx(1.0)
        assert curve.min() > 0.2


def test_streaks_lie_in_the_frame_and_apart(drawn):
    world, lights, _ = drawn
    sensor = world.scene.sensor
    assert len(lights) == brightness_worlds.STREAKS
    for light in lights:
        x, y = light.ends[::2], light.ends[1::2]
        assert 0.0 < min(x) <= max(x) < sensor.width_px
        assert 0.0 < min(y) <= max(y) < sensor.height_px
        assert 19.0 < light.snr < 255.0


def test_the_frame_before_has_no_satellite_and_other_noise():
    some = brightness_worlds.draw("worlds", 1)
    frame, plate = some.frame
    before, other = some.before
    assert frame.pixels.shape == before.pixels.shape
    assert not np.array_equal(frame.pixels, before.pixels)
    assert frame.t_start_utc_ns is not None
    assert frame.t_start_utc_ns > (before.t_start_utc_ns or 0)
    shift_x = plate.wcs.crpix_x_px - other.wcs.crpix_x_px
    shift_y = plate.wcs.crpix_y_px - other.wcs.crpix_y_px
    assert 0.5 < math.hypot(shift_x, shift_y) < 22.0


def row(error: float, sigma: float, snr: float = 50.0, **other: object) -> dict:
    streak = {
        "snr": snr,
        "is_found": True,
        "error_mag": error,
        "sigma_mag": sigma,
        "colour_error_mag": 2.0 * error,
        "colour_sigma_mag": sigma,
        "is_saturated": False,
    }
    return {"number": 0, "streaks": [streak | other]}


def test_a_line_of_the_table_has_shares_of_what_was_measured():
    rows = [row(0.04, 0.05), row(-0.12, 0.05), row(0.2, 0.05), row(0.0, 0.1, is_saturated=True)]
    rows += [row(0.0, 0.1, error_mag=None), row(0.0, 0.1, is_found=False, error_mag=None)]
    line = brightness.line_of("some", rows, (40.0, 80.0))
    cells = [each.strip() for each in line.strip().strip("|").split("|")]
    assert cells[:3] == ["some", "40 to 80", "3 of 5 of 6"]
    assert cells[3:9] == ["+0.040", "0.120", "0.333", "0.333", "0.667", "1.000"]
    assert cells[9] == "0.33 / 0.33 / 0.67"
    assert brightness.line_of("some", rows, (80.0, math.inf)).count(" - ") == 8


def test_an_error_is_what_was_measured_less_the_truth():
    light = brightness_worlds.TrueLight(
        ends=(0.0, 0.0, 9.0, 0.0), snr=50.0, sun_mag=12.0, mag=12.1, flux_adu=98.0, is_steady=True
    )
    found = StreakLight(
        measurement_id="m", flux_adu=100.0, flux_sigma_adu=2.0, rate_adu_s=10.0,
        rate_sigma_adu_s=0.2, band="V", mag=12.05, mag_sigma=0.03, mag_sigma_colour=0.04,
    )  # fmt: skip
    judged = brightness.light_row(found, light)
    assert judged["flux_error_share"] == pytest.approx(0.02, abs=0.001)
    assert judged["error_mag"] == pytest.approx(0.05)
    assert judged["colour_error_mag"] == pytest.approx(-0.05)
    assert judged["colour_sigma_mag"] == pytest.approx(0.05)
    of_no_band = replace(found, band="instrumental")
    assert brightness.light_row(of_no_band, light)["error_mag"] is None
