"""The place of a frame by its header, against astropy where it is geocentric."""

import pytest
from astropy import units as u
from astropy.coordinates import EarthLocation

from rsoconsole.instruments import header_site
from rsoconsole.records import UNITS_KEY

HERE = EarthLocation.from_geodetic(-81.05 * u.deg, 29.19 * u.deg, 10.0 * u.m)
GEOCENTRIC = dict(
    zip(
        ("OBSGEO-X", "OBSGEO-Y", "OBSGEO-Z"),
        (float(c.to_value("m")) for c in HERE.geocentric),
        strict=True,
    )
)
ONE_METRE_DEG = 1e-5
FEET = {"SITEELEV": "ft"}


@pytest.mark.parametrize(
    ("header", "elevation_m"),
    [
        ({"SITELAT": 29.19, "SITELONG": -81.05, "SITEELEV": 10.0}, 10.0),
        ({"SITELAT": "+29 11 24", "SITELONG": "-81 03 00"}, 0.0),
        ({"SITELAT": "29:11:24 N", "SITELONG": "81:03:00 W"}, 0.0),
        ({"SITELAT": "29d11m24s", "SITELONG": "278.95"}, 0.0),
        ({"SITELAT": "N29.19", "SITELONG": "W 81.05"}, 0.0),
        ({"LAT-OBS": "29,19", "LONG-OBS": "-81,05", "ALT-OBS": "10 m"}, 10.0),
        ({"OBSLAT": 29.19, "OBSLONG": -81.05}, 0.0),
        ({"OBSGEO-B": 29.19, "OBSGEO-L": 278.95, "OBSGEO-H": 10.0}, 10.0),
        ({"OBS-LAT": 29.19, "OBS-LONG": "81.05 W"}, 0.0),
        ({"LATITUDE": 29.19, "LONGITUD": -81.05}, 0.0),
        ({"SITELAT": "29.19 deg", "SITELONG": "-81.05 degrees"}, 0.0),
        ({"SITELAT": "29.19,N", "SITELONG": "81.05 West"}, 0.0),
        ({"SITELAT": "29°11′24″N", "SITELONG": "81°03′00″W"}, 0.0),
        # What FITS leaves of the same, by UTF-8 and by Latin-1.
        ({"SITELAT": "29??11???24???N", "SITELONG": "81?03'00\"W"}, 0.0),
        ({"SITE-LAT": 29.19, "SITE-LON": -81.05}, 0.0),
        ({"SITELAT": 29.19, "SITELONG": 81.05, UNITS_KEY: {"SITELONG": "W"}}, 0.0),
        ({"SITELAT": 29.19, "SITELONG": -81.05, "SITEELEV": 32.8084, UNITS_KEY: FEET}, 10.0),
        ({"ESO TEL GEOLAT": 29.19, "ESO TEL GEOLON": -81.05, "ESO TEL GEOELEV": 10.0}, 10.0),
        (GEOCENTRIC, 10.0),
    ],
)
def test_places_are_read_in_the_forms_of_others(header, elevation_m):
    found = header_site(header)
    assert found.site is not None
    assert found.notes == ()
    assert found.site.latitude_deg == pytest.approx(29.19, abs=ONE_METRE_DEG)
    assert found.site.longitude_deg == pytest.approx(-81.05, abs=ONE_METRE_DEG)
    assert found.site.elevation_m == pytest.approx(elevation_m, abs=0.01)
    assert ("no elevation" in found.words) == (elevation_m == 0.0)


def test_the_south_is_below_zero():
    found = header_site({"SITELAT": "30 10 15 S", "SITELONG": "149 4 E"})
    assert found.site is not None
    assert found.site.latitude_deg == pytest.approx(-30.170833, abs=ONE_METRE_DEG)
    assert found.site.longitude_deg == pytest.approx(149.066667, abs=ONE_METRE_DEG)


@pytest.mark.parametrize(
    ("header", "why"),
    [
        ({"SITELAT": 0.0, "SITELONG": 0.0}, "are both 0"),
        ({"SITELAT": 95.0, "SITELONG": 10.0}, "SITELAT 95.0 is not used: it is not a latitude"),
        ({"SITELAT": 45.0}, "there is no SITELONG"),
        ({"LONG-OBS": 45.0}, "there is no LAT-OBS"),
        ({"SITELAT": "45 S", "SITELONG": "-80.5 E"}, "SITELONG '-80.5 E' is not used"),
        ({"SITELAT": "45 E", "SITELONG": "80.5"}, "SITELAT '45 E' is not used"),
        ({"SITELAT": 45.0, "SITELONG": "5h24m"}, "SITELONG '5h24m' is not used"),
        ({"SITELAT": "unknown", "SITELONG": 5.0}, "SITELAT 'unknown' is not used"),
        ({"OBS-LAT": -30.16606, "OBS-LONG": 70.81489}, "OBS-LONG 70.81489 is not used"),
        ({"OBSGEO-X": 0.0, "OBSGEO-Y": 0.0, "OBSGEO-Z": 0.0}, "no place on the ground"),
        ({"OBSGEO-X": 1e7, "OBSGEO-Y": 0.0, "OBSGEO-Z": 0.0}, "no place on the ground"),
        ({"OBSGEO-X": 6.4e6, "OBSGEO-Y": 0.0}, "OBSGEO-Y not used: there is no OBSGEO-Z"),
        ({"SITELAT": "5?.3", "SITELONG": 5.0}, "SITELAT '5?.3' is not used"),
        (
            {"SITELAT": 0.5, "SITELONG": 5.0, UNITS_KEY: {"SITELAT": "gon"}},
            "SITELAT 0.5 is not used: its comment has the unit [gon]",
        ),
    ],
)
def test_impossible_places_are_not_taken_and_named(header, why):
    found = header_site(header)
    assert found.site is None
    (note,) = found.notes
    assert why in note


def test_two_places_in_one_header_are_named():
    both = {"SITELAT": 29.19, "SITELONG": -81.05, "OBSLAT": 30.19, "OBSLONG": -81.05}
    found = header_site(both)
    assert found.site is not None
    assert found.site.latitude_deg == 29.19
    (note,) = found.notes
    # A degree of latitude has 111 km.
    assert "are 111 km from SITELAT and SITELONG" in note


def test_an_altitude_is_no_elevation():
    found = header_site({"SITELAT": 29.19, "SITELONG": -81.05, "OBJCTALT": 45.0, "ELEVATIO": 45.0})
    assert found.site is not None
    assert found.site.elevation_m == 0.0
    assert header_site({}).site is None


def test_of_mirrored_longitudes_that_of_the_standard_is_used():
    mirrored = {"SITELAT": 29.19, "SITELONG": 81.05, "OBSGEO-B": 29.19, "OBSGEO-L": -81.05}
    found = header_site(mirrored)
    assert found.site is not None
    assert found.site.longitude_deg == -81.05
    assert found.words.startswith("OBSGEO-B and OBSGEO-L")
    (note,) = found.notes
    assert "one longitude has the opposite sign of the other" in note
    assert note.endswith("OBSGEO-B and OBSGEO-L are used")
