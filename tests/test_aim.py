"""Where the telescope looks next, and where it must not."""

import math

import pytest
from skyfield.api import wgs84

from rsoconsole.config import MountConfig, SearchConfig
from rsoconsole.pipeline.aim import SearchBase, needs_recentre, search_base, search_direction
from rsoconsole.records import Site
from rsoconsole.sky.angles import separation_deg
from rsoconsole.sky.belt import belt_declination_deg
from rsoconsole.sky.frames import hour_angle_icrs_deg
from rsoconsole.sky.limits import refusal
from rsoconsole.sky.sun import sun_icrs
from rsoconsole.sky.times import iso_to_utc_ns
from rsoconsole.tracking.pointing import PointingOffset, command_for, observed

DAYTONA = Site(latitude_deg=29.19, longitude_deg=-81.05, elevation_m=10.0)
T_UTC_NS = iso_to_utc_ns("2023-06-22T03:00:00Z")


@pytest.mark.parametrize("longitude_deg", [-45.0, -67.0, -81.0, -120.0])
def test_the_belt_lies_where_a_geostationary_satellite_stands(longitude_deg):
    """Against the topocentric direction of a point fixed to the Earth, by skyfield's WGS84."""
    site = wgs84.latlon(29.19, -81.05, 10.0).itrs_xyz.km
    up = math.radians(longitude_deg)
    satellite = (42164.17 * math.cos(up), 42164.17 * math.sin(up), 0.0)
    x, y, z = (s - o for s, o in zip(satellite, site, strict=True))
    hour_angle_deg = -81.05 - math.degrees(math.atan2(y, x))
    declination_deg = math.degrees(math.atan2(z, math.hypot(x, y)))
    one_arcsecond = 1.0 / 3600.0
    assert belt_declination_deg(DAYTONA, hour_angle_deg) == pytest.approx(
        declination_deg, abs=one_arcsecond
    )


def test_a_search_stands_still_over_the_ground():
    """Half an hour later the same field of the search lies at the same hour angle."""
    base = SearchBase(hour_angle_deg=-40.0, declination_deg=None)
    search = SearchConfig(pattern="stay")
    angles = [
        hour_angle_icrs_deg(
            DAYTONA,
            *search_direction(
                base, search, DAYTONA, field_width_deg=1.6, exposure_number=n, t_utc_ns=t_ns
            ),
            t_ns,
        )
        for n, t_ns in ((0, T_UTC_NS), (60, T_UTC_NS + 1_800_000_000_000))
    ]
    assert angles == pytest.approx([-40.0, -40.0], abs=1e-6)


def test_a_belt_search_visits_every_field_twice_in_a_row_and_both_sides():
    base = SearchBase(hour_angle_deg=-40.0, declination_deg=None)
    search = SearchConfig(belt_fields=5, frames_per_field=2, belt_step_fields=0.75)
    angles = [
        hour_angle_icrs_deg(
            DAYTONA,
            *search_direction(
                base, search, DAYTONA, field_width_deg=1.6, exposure_number=n, t_utc_ns=T_UTC_NS
            ),
            T_UTC_NS,
        )
        for n in range(11)
    ]
    steps = [round((angle + 40.0) / 1.2) for angle in angles]
    assert steps == [0, 0, -1, -1, 1, 1, -2, -2, 2, 2, 0]


def test_an_unset_search_starts_where_the_mount_points():
    base = search_base(SearchConfig(pattern="stay"), DAYTONA, 200.0, -5.0, T_UTC_NS)
    direction = search_direction(
        base,
        SearchConfig(pattern="stay"),
        DAYTONA,
        field_width_deg=1.6,
        exposure_number=0,
        t_utc_ns=T_UTC_NS,
    )
    assert separation_deg(*direction, 200.0, -5.0) * 3600.0 < 0.1


@pytest.mark.parametrize(
    ("recentre", "off_deg", "moves"),
    [("when needed", 0.2, False), ("when needed", 0.4, True), ("every", 0.0, True)],
)
def test_the_telescope_moves_when_it_must(recentre, off_deg, moves):
    search = SearchConfig(recentre=recentre)
    assert needs_recentre(search, (1.63, 1.24), (10.0, 0.0), (10.0 + off_deg, 0.0)) is moves


def test_a_direction_near_the_sun_below_the_horizon_or_not_a_number_is_refused():
    noon_ns = iso_to_utc_ns("2023-06-22T17:30:00Z")
    sun = sun_icrs(noon_ns)
    mount = MountConfig()
    assert "Sun" in (refusal(*sun, noon_ns, DAYTONA, mount) or "")
    assert "altitude" in (refusal((sun[0] + 180.0) % 360.0, -20.0, noon_ns, DAYTONA, mount) or "")
    assert refusal(math.nan, 0.0, noon_ns, DAYTONA, mount) is not None


def test_the_night_sky_overhead_is_allowed():
    from rsoconsole.sky.frames import altaz_to_icrs

    overhead = altaz_to_icrs(DAYTONA, 80.0, 120.0, T_UTC_NS)
    assert refusal(*overhead, T_UTC_NS, DAYTONA, MountConfig()) is None


def test_the_offset_brings_the_telescope_to_the_wanted_place():
    """A mount that always looks 6 arcmin east and 3 south lands within an arcsecond."""
    wrong = (0.1, -0.05)
    offset = PointingOffset()
    commanded = (150.0, -5.0)
    solved = (commanded[0] + wrong[0], commanded[1] + wrong[1])
    offset = observed(
        offset,
        commanded_ra_deg=commanded[0],
        commanded_dec_deg=commanded[1],
        solved_ra_deg=solved[0],
        solved_dec_deg=solved[1],
        pier_side="west",
    )
    ra, dec = command_for(offset, 151.0, -5.0)
    assert separation_deg(ra + wrong[0], dec + wrong[1], 151.0, -5.0) * 3600.0 < 1.0


def test_a_flip_voids_the_offset():
    known = PointingOffset(
        east_arcsec=300.0, samples=5, ra_icrs_deg=150.0, dec_icrs_deg=-5.0, pier_side="west"
    )
    after = observed(
        known,
        commanded_ra_deg=150.0,
        commanded_dec_deg=-5.0,
        solved_ra_deg=150.0,
        solved_dec_deg=-5.0,
        pier_side="east",
    )
    assert (after.samples, after.east_arcsec) == (1, pytest.approx(0.0, abs=1e-6))
