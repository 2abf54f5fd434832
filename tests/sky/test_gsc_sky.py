"""The stand-in for gsc says what INDI's CCD simulator reads, and puts satellites where they are."""

import ctypes
import dataclasses
import json
import math
import os
import subprocess
import time

import numpy as np
import pytest

from rsoconsole.orbits import Satellite
from rsoconsole.sky import (
    StarCatalogue,
    icrs_to_altaz,
    iso_to_utc_ns,
    julian_year,
    separation_deg,
    sky_to_pixel,
    sun_altitude_deg,
    tan_wcs,
)
from tests.real_sky.gsc_sky import NS, Sky, serving, streaks, tell
from tests.real_sky.real_sky_rig import HOUR_ANGLE_DEG, geostationary, site_at_midnight
from tests.truth.ccd_law import CcdLaw

T0_UTC_NS = iso_to_utc_ns("2026-11-23T00:00:00Z")
PATTERN = b"%10s %f %f %f %f %f %d %d %4s %2s %f %d"
"""The simulator's own."""
ARCSEC = 1 / 3600


@pytest.fixture
def sky(tmp_path):
    site = site_at_midnight(T0_UTC_NS)
    one = geostationary(site, T0_UTC_NS, HOUR_ANGLE_DEG, 80001)
    elements = tmp_path / "elements.tle"
    elements.write_text(f"{one.name}\n{one.line_1}\n{one.line_2}\n", encoding="ascii")
    return Sky(
        site=site, elements=elements, magnitudes={80001: 11.6}, truth=tmp_path / "truth.jsonl"
    )


def place(sky, after_s=0.0):
    """RA, Dec of the satellite, by its own account."""
    t_utc_ns = np.array([T0_UTC_NS + round(after_s * NS)], np.int64)
    at = sky.satellites()[0].astrometric_place(sky.site, t_utc_ns)
    return float(at.ra_icrs_deg[0]), float(at.dec_icrs_deg[0])


def asked(sky, centre_deg=None, faintest=17.0, lines=3000):
    """The command as the simulator writes it."""
    ra_deg, dec_deg = centre_deg or place(sky)
    text = "-c {:8.6f} {:+8.6f} -r {:4.1f} -m 0 {:4.2f} -n {}"
    return text.format(ra_deg, dec_deg, sky.law.radius_arcmin, faintest, lines).split()


def read(line):
    """(fields read, identifier, RA, Dec, magnitude) as the simulator's C reads them."""
    texts = [ctypes.create_string_buffer(32) for _ in range(3)]
    floats = [ctypes.c_float() for _ in range(6)]
    whole = [ctypes.c_int() for _ in range(3)]
    ra, dec, error, mag, mag_error, apart = floats
    into = (texts[0], ra, dec, error, mag, mag_error, whole[0], whole[1], *texts[1:], apart)
    into = [each if isinstance(each, ctypes.Array) else ctypes.byref(each) for each in into]
    count = ctypes.CDLL(None).sscanf(line.encode(), PATTERN, *into, ctypes.byref(whole[2]))
    return count, texts[0].value.decode(), ra.value, dec.value, mag.value


def test_the_simulator_reads_all_twelve_fields_of_every_line_and_loses_no_tenth_of_an_arcsec(sky):
    said = tell(sky, asked(sky), T0_UTC_NS)
    assert len(said) > 100
    assert max(len(line) for line in said) < 256
    rows = [read(line) for line in said]
    assert {row[0] for row in rows} == {12}
    for line, (_, name, ra_deg, dec_deg, magnitude) in zip(said, rows, strict=True):
        words = line.split()
        assert name == words[0]
        assert ra_deg == pytest.approx(float(words[1]), abs=0.1 * ARCSEC)
        assert dec_deg == pytest.approx(float(words[2]), abs=0.1 * ARCSEC)
        assert magnitude == pytest.approx(float(words[4]), abs=1e-3)


def test_the_pattern_refuses_a_line_that_lacks_a_field():
    assert read("S1 10.0 5.0 0.2 9.0 0.3 0 0 0000 F 0.1\n")[0] == 11


def test_the_stars_are_the_catalogues_on_that_day_and_end_where_they_were_asked_to(sky):
    centre_deg = place(sky)
    said = [line.split() for line in tell(sky, asked(sky, faintest=10.0), T0_UTC_NS)]
    told = {(row[1], row[2]) for row in said if row[0].startswith("S")}
    radius_deg, today = round(sky.law.radius_arcmin, 1) / 60.0, julian_year(T0_UTC_NS)
    stars = StarCatalogue.load().cone(*centre_deg, radius_deg, epoch_jyear=today)
    places = zip(stars.ra_icrs_deg, stars.dec_icrs_deg, stars.magnitude, strict=True)
    assert told == {(f"{ra:.6f}", f"{dec:+.6f}") for ra, dec, mag in places if mag <= 10.0}
    assert len(tell(sky, asked(sky, lines=80), T0_UTC_NS)) == 80


def test_the_streak_runs_from_the_place_of_the_call_to_that_of_the_exposures_end(sky):
    (streak,) = streaks(sky, place(sky), T0_UTC_NS, 0.0)
    ra_deg, dec_deg = streak.ra_icrs_deg, streak.dec_icrs_deg
    points = len(ra_deg)
    half_a_pixel_deg = 0.5 * sky.law.scale_arcsec_px * ARCSEC
    for index in (0, points // 3, points - 1):
        true = place(sky, (index + 0.5) / points * sky.exposure_s)
        assert separation_deg(ra_deg[index], dec_deg[index], *true) <= half_a_pixel_deg
    a_twentieth_arcsec = 0.05 * ARCSEC
    middle = float(ra_deg.mean()), float(dec_deg.mean())
    assert separation_deg(*middle, *place(sky, 5.0)) < a_twentieth_arcsec
    told = streak.truth["ra_icrs_deg"], streak.truth["dec_icrs_deg"]
    assert separation_deg(*told, *place(sky, 5.0)) < 1e-9
    # Closer than the disc is wide, and over the length that a sidereal sky leaves behind.
    steps = np.diff(ra_deg) * math.cos(math.radians(dec_deg[0])) / ARCSEC
    assert steps.max() < sky.law.seeing_arcsec
    assert steps.sum() == pytest.approx(15.0 * sky.exposure_s, rel=0.03)


def test_the_points_together_shine_as_brightly_as_the_satellite(sky):
    (streak,) = streaks(sky, place(sky), T0_UTC_NS, 0.0)
    law, exposure_s = sky.law, sky.exposure_s
    points = len(streak.ra_icrs_deg)
    whole = law.flux_adu(streak.truth["magnitude"], exposure_s)
    assert points * law.flux_adu(streak.point_magnitude, exposure_s) == pytest.approx(whole)
    # What is drawn has lost the fraction of every pixel of every point, and no more than that.
    disc = (law.seeing_arcsec / law.scale_arcsec_px) ** 2 * math.pi / (4 * math.log(2))
    peak = 1 / (law.seeing_arcsec / 2.3548 * math.sqrt(2 * math.pi))
    ideal = whole * peak * disc
    lost = ideal - streak.truth["light_adu"]
    assert 0 < lost < points * 4 * disc
    bright = law.disc_adu(1e7)
    assert bright.sum() == pytest.approx(1e7 * peak * disc, rel=1e-3)


def test_a_streak_is_even_along_its_path(sky):
    (streak,) = streaks(sky, place(sky), T0_UTC_NS, 0.0)
    x, y = sky.law.pixel(streak.ra_icrs_deg, streak.dec_icrs_deg, place(sky))
    rows = sky.law.drawn_adu(x, y, 1e6).sum(axis=1)
    reach = 12
    inner = rows[reach:-reach]
    assert len(inner) > 80
    # Whole pixels make steps of one and two where the spacing is none.
    assert inner.std() / inner.mean() < 0.15


def test_scatter_is_drawn_from_the_seed_and_moves_the_streak_along_its_path(sky):
    scattered = dataclasses.replace(sky, scatter_s=0.2)
    drawn = [scattered.scatter_of_call_s(call) for call in range(400)]
    three_sigma = 3 * 0.2 / math.sqrt(400)
    assert abs(np.mean(drawn)) < three_sigma
    assert np.std(drawn) == pytest.approx(0.2, abs=three_sigma / math.sqrt(2))
    assert drawn == [scattered.scatter_of_call_s(call) for call in range(400)]
    other = dataclasses.replace(scattered, seed=2)
    assert drawn[:5] != [other.scatter_of_call_s(call) for call in range(5)]
    (streak,) = streaks(scattered, place(sky), T0_UTC_NS, 0.2)
    told = streak.truth["ra_drawn_icrs_deg"], streak.truth["dec_drawn_icrs_deg"]
    a_hundredth_arcsec = 0.01 * ARCSEC
    assert separation_deg(*told, *place(sky, 5.2)) < a_hundredth_arcsec
    still = streak.truth["ra_icrs_deg"], streak.truth["dec_icrs_deg"]
    assert separation_deg(*still, *place(sky, 5.0)) < 1e-9


def test_each_call_adds_a_line_of_truth_and_draws_its_own_scatter(sky):
    scattered = dataclasses.replace(sky, scatter_s=0.2)
    for call in range(3):
        tell(scattered, asked(sky), T0_UTC_NS + 30 * call * NS)
    lines = [json.loads(line) for line in sky.truth.read_text().splitlines()]
    assert [line["call"] for line in lines] == [0, 1, 2]
    assert [line["scatter_s"] for line in lines] == [
        scattered.scatter_of_call_s(call) for call in range(3)
    ]
    assert lines[0]["satellites"][0]["snr_matched"] > 20


def test_a_satellite_outside_the_cone_is_not_drawn(sky):
    ra_deg, dec_deg = place(sky)
    assert streaks(sky, (ra_deg + 3.0, dec_deg), T0_UTC_NS, 0.0) == []


@pytest.mark.parametrize("is_pier_east", [False, True])
def test_the_simulators_projection_is_a_gnomonic_one(is_pier_east):
    law = CcdLaw(rotation_deg=12.0)
    centre_deg = (98.0, -4.6)
    ra_deg, dec_deg = np.array([98.0, 98.3, 97.6]), np.array([-4.6, -4.4, -5.0])
    x, y = law.pixel(ra_deg, dec_deg, centre_deg, is_pier_east)
    found = []
    for rotation_deg in np.arange(0.0, 360.0, 1.0):
        for is_flipped in (False, True):
            wcs = tan_wcs(
                *centre_deg,
                scale_arcsec_px=206.264806 * law.pixel_um / law.focal_length_mm,
                rotation_deg=float(rotation_deg),
                is_flipped=is_flipped,
                width_px=law.width_px,
                height_px=law.height_px,
            )
            # Its centre is half a pixel beside ours, whose pixels are whole at their centres.
            at = sky_to_pixel(wcs, ra_deg, dec_deg)
            off = np.hypot(x - at[0] - 0.5, y - at[1] - 0.5).max()
            found += [(rotation_deg, is_flipped)] * bool(off < 0.01)
    assert len(found) == 1


def test_the_light_of_a_star_lands_on_whole_pixels():
    law = CcdLaw()
    one = law.drawn_adu(np.array([100.1]), np.array([50.9]), 1e5)
    other = law.drawn_adu(np.array([100.9]), np.array([50.0]), 1e5)
    assert np.array_equal(one, other)
    peak = np.unravel_index(np.argmax(one), one.shape)
    assert peak == (one.shape[0] // 2, one.shape[1] // 2)


def test_the_noise_is_that_of_whole_numbers_from_nothing_to_the_limit():
    law = CcdLaw(noise_adu=10)
    assert law.noise_sigma_adu == pytest.approx(np.std(np.arange(10)))


def test_a_sky_is_read_as_it_was_written(sky, tmp_path):
    sky.save(tmp_path / "sky.json")
    assert Sky.load(tmp_path / "sky.json") == sky


def test_the_command_is_found_by_its_name_and_tells_when_it_was_called(sky, tmp_path):
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    spans_ns = []
    with serving(sky, tmp_path):
        for _ in range(2):
            before_ns = time.time_ns()
            done = subprocess.run(
                ["sh", "-c", " ".join(["gsc", *asked(sky)])],
                env=environment,
                capture_output=True,
                text=True,
                check=True,
            )
            spans_ns.append((before_ns, time.time_ns()))
            assert {read(line)[0] for line in done.stdout.splitlines()} == {12}
    lines = sky.truth.read_text().splitlines()
    for line, (before_ns, after_ns) in zip(lines, spans_ns, strict=True):
        # Bash tells microseconds.
        assert before_ns - 1000 <= json.loads(line)["t_start_utc_ns"] <= after_ns


def test_the_site_of_the_night_lies_in_the_dark_with_the_satellite_high_and_lit():
    for t_utc_ns in range(T0_UTC_NS, T0_UTC_NS + 365 * 86400 * NS, 29 * 86400 * NS + 7 * 3600 * NS):
        site = site_at_midnight(t_utc_ns)
        one = Satellite(geostationary(site, t_utc_ns, HOUR_ANGLE_DEG, 80001), 11.6)
        at = one.astrometric_place(site, np.array([t_utc_ns], np.int64))
        altitude_deg, _ = icrs_to_altaz(
            site, float(at.ra_icrs_deg[0]), float(at.dec_icrs_deg[0]), t_utc_ns
        )
        assert altitude_deg > 30.0
        assert sun_altitude_deg(site, t_utc_ns) < -18.0
        assert 11.5 < float(one.magnitude(at)[0]) < 12.5
