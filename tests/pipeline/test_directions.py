"""What people type as a direction is understood, or refused with what may be written."""

import json
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsoconsole.base import OrbitError
from rsoconsole.pipeline import TargetNames, parse_direction
from rsoconsole.records import Site
from rsoconsole.sky import (
    NAMED_STARS,
    StarCatalogue,
    hour_angle_icrs_deg,
    icrs_to_altaz,
    icrs_to_jnow,
    iso_to_utc_ns,
    separation_deg,
)
from rsoconsole.words import format_dec, format_ra

SITE = Site(latitude_deg=29.19, longitude_deg=-81.05, elevation_m=10.0)
NOW = iso_to_utc_ns("2023-03-10T02:00:00Z")
HERE = (83.045833, -4.869444)
"""05 32 11, -4 52 10."""
ARCSEC = 1.0 / 3600.0


@pytest.mark.parametrize(
    "text",
    [
        "05 32 11 -4 52 10",
        "05:32:11 -04:52:10",
        "5h32m11s -4d52m10s",
        "05h32m11.0s, -04°52'10\"",
        "ra 05:32:11 dec -04:52:10",
        "RA=05 32 11 Dec=-04 52 10 J2000",
        "α 05:32:11 δ −04:52:10",
        "83.045833 -4.869444",
        "83.045833, -4.869444 ICRS",
        "5.5363889h -4.869444",
        "dec -04:52:10 ra 05:32:11",
        "dec -4 52 10 ra 5 32 11",
        "5 32 11 dec -4 52 10",
        "05 32 11 –04 52 10",
    ],
)
def test_one_place_in_many_notations(text):
    found = parse_direction(text, SITE, NOW)
    assert separation_deg(found.ra_icrs_deg, found.dec_icrs_deg, *HERE) < ARCSEC
    assert "ICRS" in found.words


def test_of_date_is_precessed():
    found = parse_direction("05:32:11 -04:52:10 of date", SITE, NOW)
    assert "of date" in found.words
    back = icrs_to_jnow(found.ra_icrs_deg, found.dec_icrs_deg, NOW)
    assert separation_deg(*back, *HERE) < ARCSEC
    # 23 years of precession: a good quarter of a degree.
    assert 0.2 < separation_deg(found.ra_icrs_deg, found.dec_icrs_deg, *HERE) < 0.4


@pytest.mark.parametrize(
    "text", ["alt 47 az 201", "az 201 alt 47", "el 47, az 201", "Alt=47 Az=201"]
)
def test_altitude_and_azimuth_are_those_of_now(text):
    found = parse_direction(text, SITE, NOW)
    alt, az = icrs_to_altaz(SITE, found.ra_icrs_deg, found.dec_icrs_deg, NOW)
    assert (alt, az) == pytest.approx((47.0, 201.0), abs=1e-6)


@pytest.mark.parametrize(
    ("text", "degrees"),
    [
        ("ha -2:30 dec -5", -37.5),
        ("ha -2.5 dec -5", -37.5),
        ("ha –2:30 dec -5", -37.5),
        ("dec -5 ha -2:30", -37.5),
        ("ha 20° dec -5", 20.0),
        ("ha .5 dec -5", 7.5),
    ],
)
def test_an_hour_angle_stands_over_the_ground(text, degrees):
    found = parse_direction(text, SITE, NOW)
    ha = hour_angle_icrs_deg(SITE, found.ra_icrs_deg, found.dec_icrs_deg, NOW)
    assert ha == pytest.approx(degrees, abs=0.01)


@pytest.mark.parametrize(
    ("text", "ra", "dec"),
    [
        ("ra 5d dec 4 52 10", 5.0, 4.869444),
        ("5h 4d52m10s", 75.0, 4.869444),
        ("12h 4°52'10\"", 180.0, 4.869444),
        ("5 32 11 dec 4", 83.045833, 4.0),
        ("83.05 .5", 83.05, 0.5),
        ("10°30′ -5°", 10.5, -5.0),
        ("ra 83°03' dec -4°52'", 83.05, -4.866667),
    ],
)
def test_where_the_second_angle_begins_is_seen_by_its_name_or_its_unit(text, ra, dec):
    found = parse_direction(text, SITE, NOW)
    assert separation_deg(found.ra_icrs_deg, found.dec_icrs_deg, ra, dec) < ARCSEC


@pytest.mark.parametrize(
    ("text", "alt", "az"),
    [
        ("alt 4 az 20 10 5", 4.0, 20.168056),
        ("az 201 alt .5", 0.5, 201.0),
        ("alt 47:30 az 201", 47.5, 201.0),
    ],
)
def test_altitude_and_azimuth_with_minutes(text, alt, az):
    found = parse_direction(text, SITE, NOW)
    seen = icrs_to_altaz(SITE, found.ra_icrs_deg, found.dec_icrs_deg, NOW)
    assert seen == pytest.approx((alt, az), abs=1e-5)


def test_a_bare_number_below_24_is_shown_both_ways_and_taken_neither():
    with pytest.raises(ValueError, match=r"hours \(α 20:54:00\) or degrees \(α 01:23:36\)"):
        parse_direction("20.9 -4.8", SITE, NOW)
    hours, degrees = (parse_direction(f"20.9{unit} -4.8", SITE, NOW) for unit in "hd")
    assert hours.ra_icrs_deg == pytest.approx(313.5)
    assert degrees.ra_icrs_deg == pytest.approx(20.9)
    # 24 and more can be degrees alone, 0 is the same in both.
    assert parse_direction("24.5 -4.8", SITE, NOW).ra_icrs_deg == 24.5
    assert parse_direction("0 -4.8", SITE, NOW).ra_icrs_deg == 0.0


@pytest.mark.parametrize("text", ["M31", "m 31", "Messier 31", "M031"])
def test_messiers_objects_are_found_by_number(text):
    found = parse_direction(text, SITE, NOW)
    one_arcmin = 1.0 / 60.0
    andromeda = (10.6847, 41.2688)
    assert separation_deg(found.ra_icrs_deg, found.dec_icrs_deg, *andromeda) < one_arcmin


def test_there_is_no_messier_111():
    with pytest.raises(ValueError, match="no star known here"):
        parse_direction("M111", SITE, NOW)


@pytest.mark.parametrize(
    "name", ["Moon", "Mercury", "Venus", "Mars", "Jupiter", "Saturn", "Neptune"]
)
def test_moon_and_planets_stand_where_an_ephemeris_has_them(name):
    import skyfield_data
    from skyfield.api import load, load_file, wgs84

    ephemeris = load_file(str(Path(skyfield_data.__file__).parent / "data" / "de421.bsp"))
    site = wgs84.latlon(SITE.latitude_deg, SITE.longitude_deg, SITE.elevation_m)
    body = "JUPITER BARYCENTER" if name == "Jupiter" else name.upper()
    body = f"{name.upper()} BARYCENTER" if name in {"Mars", "Saturn", "Neptune"} else body
    seconds = NOW / 1e9
    instant = load.timescale(builtin=True).utc(1970, 1, 1, 0, 0, seconds)
    ra, dec, _ = (ephemeris["earth"] + site).at(instant).observe(ephemeris[body]).radec()
    ephemeris.close()
    found = parse_direction(name, SITE, NOW)
    two_arcmin = 2.0 / 60.0
    place = (ra._degrees, dec.degrees)
    assert separation_deg(found.ra_icrs_deg, found.dec_icrs_deg, *place) < two_arcmin


def test_a_name_may_have_digits_and_begin_with_any_letter():
    for text in ("SDS 2-1", "D 5", "h 12 3"):
        with pytest.raises(ValueError, match="no star known here"):
            parse_direction(text, SITE, NOW)
    assert parse_direction("Deneb", SITE, NOW).words == "Deneb, a star"


@given(st.floats(0.0, 359.99), st.floats(-89.9, 89.9))
def test_what_the_console_writes_it_understands(ra, dec):
    found = parse_direction(f"{format_ra(ra, 2)} {format_dec(dec, 1)}", SITE, NOW)
    assert separation_deg(found.ra_icrs_deg, found.dec_icrs_deg, ra, dec) < 0.2 * ARCSEC
    plain = parse_direction(f"{ra:.6f}d {dec:+.6f}", SITE, NOW)
    assert separation_deg(plain.ra_icrs_deg, plain.dec_icrs_deg, ra, dec) < 0.01 * ARCSEC


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "write it like"),
        ("12.5", "two angles"),
        ("1 2 3 4 5", "two angles"),
        ("25:00:00 +10:00:00", "between 0 and 24 h"),
        ("05:32:11 +95:00:00", "between -90 and"),
        ("05:75:11 +10:00:00", "below 60"),
        ("alt -3 az 10", "below the horizon"),
        ("83,05", "point for decimals"),
        ("ha 2:75 dec -5", "below 60"),
        ("ha 20 dec -5", "within 12 h"),
        ("alt 47 az 400", "full turn"),
        ("alt 47 dec 5", "do not go together"),
        ("ra 5 ra 6", "more than two"),
        ("ra 5 dec", "no value"),
        ("20.9 -4.8", "write 20.9h or 20.9d"),
        ("ra 5 dec -5", "write 5h or 5d"),
        ("the Sun", "no telescope is sent to the Sun"),
        ("Rigle", "no star known here"),
        ("NOSAT 1", "catalogue.tle_files"),
    ],
)
def test_what_is_none_is_refused_with_what_may_be_written(text, words):
    with pytest.raises(ValueError, match=words):
        parse_direction(text, SITE, NOW)


def test_a_star_is_found_by_its_name_however_written():
    for text in ("Rigel", " rigel ", "RIGEL"):
        found = parse_direction(text, SITE, NOW)
        assert separation_deg(found.ra_icrs_deg, found.dec_icrs_deg, *NAMED_STARS["Rigel"]) == 0.0


def test_the_named_stars_of_the_belt_are_where_the_catalogue_has_bright_ones():
    """Tycho-2 holds all but the very brightest; those of the belt serve for the whole table."""
    stars = StarCatalogue.load()
    checked = 0
    for name, (ra, dec) in NAMED_STARS.items():
        if abs(dec) > 11.5:
            continue
        bright = stars.magnitude < 4.0
        away = separation_deg(ra, dec, stars.ra_icrs_deg[bright], stars.dec_icrs_deg[bright])
        is_there = away.min() < 1.0 * ARCSEC
        assert is_there is not (name in MISSING_IN_TYCHO), name
        checked += is_there
    assert checked >= 12


MISSING_IN_TYCHO = {"Enif", "Porrima", "Sadalsuud", "Unukalhai", "Zubeneschamali"}
"""In the shipped cut; bright ones are in a supplement."""


OMM = """{"OBJECT_NAME": "SES-10", "NORAD_CAT_ID": 42432, "EPOCH": "2023-03-09T12:00:00",
 "MEAN_MOTION": 1.0027, "ECCENTRICITY": 0.0002, "INCLINATION": 0.02, "RA_OF_ASC_NODE": 90.0,
 "ARG_OF_PERICENTER": 0.0, "MEAN_ANOMALY": 10.0, "BSTAR": 0, "MEAN_MOTION_DOT": 0}"""


def element_file(tmp_path, *names_and_numbers):
    """Made-up geostationary element sets with right checksums."""
    from rsoconsole.orbits.elements.elements import checksum

    lines = []
    for name, number, anomaly in names_and_numbers:
        one = f"1 {number:05d}U 17017A   23068.50000000  .00000000  00000-0  00000-0 0  999"
        two = f"2 {number:05d}   0.0200  90.0000 0002000   0.0000 {anomaly:8.4f}  1.00270000 2000"
        lines += [name, *(f"{line}{checksum(line + '0')}" for line in (one, two))]
    path = tmp_path / "geo.tle"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_a_satellite_is_found_by_name_number_and_beginning(tmp_path):
    path = element_file(tmp_path, ("SES-10", 42432, 10.0), ("INTELSAT 14", 36097, 60.0))
    names = TargetNames.load([path])
    places = {
        parse_direction(text, SITE, NOW, names).words[:14] for text in ("SES-10", "ses 10", "42432")
    }
    assert places == {"SES-10 (42432)"}
    found = parse_direction("Intelsat", SITE, NOW, names)
    assert found.words.startswith("INTELSAT 14 (36097), elements 0.6 d old")
    assert found.caution == ""
    # On the belt it stands some degrees south of the equator as seen from the north.
    assert -8.0 < found.dec_icrs_deg < -3.0
    assert math.isfinite(found.ra_icrs_deg)
    later = parse_direction("42432", SITE, NOW + 30 * 86400 * 10**9, names)
    assert later.caution == "elements 30.6 d old"


def test_a_name_is_found_in_a_catalogue_of_messages_too(tmp_path):
    lines = element_file(tmp_path, ("SES-10", 42432, 10.0))
    fields = json.loads(OMM)
    (tmp_path / "geo.json").write_text(json.dumps([fields]))
    by_lines = parse_direction("SES-10", SITE, NOW, TargetNames.load([lines]))
    by_message = parse_direction("42432", SITE, NOW, TargetNames.load([tmp_path / "geo.json"]))
    assert by_message.words == by_lines.words
    assert by_message.ra_icrs_deg == pytest.approx(by_lines.ra_icrs_deg, abs=1e-3)
    assert by_message.dec_icrs_deg == pytest.approx(by_lines.dec_icrs_deg, abs=1e-3)


def test_a_name_that_may_be_several_asks_for_more(tmp_path):
    path = element_file(tmp_path, ("SES-10", 42432, 10.0), ("SES-11", 42967, 60.0))
    with pytest.raises(ValueError, match="may be SES-10, SES-11: write more of it"):
        parse_direction("ses", SITE, NOW, TargetNames.load([path]))
    with pytest.raises(ValueError, match="nor in 2 satellites"):
        parse_direction("nimiq", SITE, NOW, TargetNames.load([path]))


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(OrbitError, match=r"missing\.tle does not exist"):
        TargetNames.load([tmp_path / "missing.tle"])
