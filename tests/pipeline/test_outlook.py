"""What the next hours bring, held against other people's computations and against itself."""

import numpy as np
import pytest

from rsoconsole.config import Config, with_setting
from rsoconsole.pipeline import sky_outlook
from rsoconsole.records import Site, TrackState
from rsoconsole.sky import (
    geo_slot_direction_deg,
    icrs_of_hour_angle,
    icrs_to_altaz,
    iso_to_utc_ns,
    moon_icrs,
    moon_lit_fraction,
    separation_deg,
)
from rsoconsole.words import NS_PER_S, utc_ns_to_iso

SIDEREAL_DEG_S = 15.0410686 / 3600.0
NIGHT = iso_to_utc_ns("2026-03-10T03:00:00Z")


def track(ra: float, dec: float, ra_rate_deg_s: float, t_utc_ns: int) -> TrackState:
    covariance = tuple(tuple(float(v) for v in row) for row in np.eye(4) * 1e-8)
    return TrackState(
        track_id=1,
        kind="updated",
        frame_id=1,
        t_utc_ns=t_utc_ns,
        x=(ra, ra_rate_deg_s, dec, 0.0),
        P=covariance,
    )


@pytest.mark.parametrize(
    "when", ["2000-01-01T00:00:00Z", "2023-09-14T06:30:00Z", "2026-03-10T03:00:00Z"]
)
def test_the_moon_stands_where_astropy_has_it(when):
    from astropy import units
    from astropy.coordinates import EarthLocation, get_body
    from astropy.time import Time

    where = Site(latitude_deg=29.19, longitude_deg=-81.05, elevation_m=10.0)
    place = EarthLocation.from_geodetic(
        where.longitude_deg * units.deg, where.latitude_deg * units.deg, where.elevation_m * units.m
    )
    moon = get_body("moon", Time(when[:-1]), place, ephemeris="builtin")
    mine = moon_icrs(where, iso_to_utc_ns(when))
    # Astropy's is apparent in GCRS; the site's velocity shifts it by less than an arcsecond.
    theirs = moon.spherical.lon.deg, moon.spherical.lat.deg
    assert separation_deg(*mine, *theirs) * 3600.0 < 30.0


@pytest.mark.parametrize(
    ("when", "lit"),
    [
        ("2026-03-03T11:38:00Z", 1.0),  # full, by the Astronomical Almanac
        ("2026-03-11T09:39:00Z", 0.5),  # last quarter
        ("2026-03-19T01:23:00Z", 0.0),  # new
    ],
)
def test_the_moons_phases_come_when_the_almanac_has_them(when, lit):
    assert moon_lit_fraction(iso_to_utc_ns(when)) == pytest.approx(lit, abs=0.012)


def test_a_star_is_told_when_it_meets_the_altitude_limit():
    config = Config()
    where = config.site.to_site()
    ra, dec = icrs_of_hour_angle(where, 60.0, 10.0, NIGHT)
    seen = sky_outlook(config, NIGHT, (ra, dec), track(ra, dec, 0.0, NIGHT))
    assert seen.target_limit is not None
    at, refusal = seen.target_limit
    assert refusal.limit == "altitude"
    for offset_s, is_above in ((-30, True), (30, False)):
        altitude, _ = icrs_to_altaz(where, ra, dec, at + offset_s * NS_PER_S)
        assert (altitude > config.limits.min_altitude_deg) is is_above


def test_a_geostationary_one_never_sets_but_is_eclipsed_in_march():
    config = Config()
    where = config.site.to_site()
    ra, dec = icrs_of_hour_angle(
        where, *geo_slot_direction_deg(where, where.longitude_deg + 20.0), NIGHT
    )
    seen = sky_outlook(config, NIGHT, (ra, dec), track(ra, dec, SIDEREAL_DEG_S, NIGHT))
    assert seen.target_limit is None
    assert seen.eclipse_utc_ns is not None
    # About local midnight at its own longitude, 61 deg west: 04:05 UT; eclipses last 70 min.
    assert "2026-03-10T03:2" < utc_ns_to_iso(seen.eclipse_utc_ns, 0) < "2026-03-10T04:1"


def test_margins_are_told_nearest_first_and_are_those_of_the_limits():
    config = with_setting(Config(), "limits.min_altitude_deg", 20.0)
    where = config.site.to_site()
    ra, dec = icrs_of_hour_angle(where, -30.0, 0.0, NIGHT)
    altitude, _ = icrs_to_altaz(where, ra, dec, NIGHT)
    margins = sky_outlook(config, NIGHT, (ra, dec)).margins_deg
    assert dict(margins)["altitude"] == pytest.approx(altitude - 20.0, abs=0.05)
    assert dict(margins)["hour angle"] == pytest.approx(90.0, abs=0.05)
    assert [value for _, value in margins] == sorted(value for _, value in margins)


def test_without_a_track_nothing_is_said_of_one():
    seen = sky_outlook(Config(), NIGHT)
    assert seen.target_limit is None
    assert seen.eclipse_utc_ns is None
    assert seen.margins_deg == ()
    assert seen.moon_away_deg is None
