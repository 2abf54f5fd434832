"""Where the telescope looks next: patterns of a search, recentring, the meridian."""

import math

import pytest
from skyfield.api import wgs84

from rsoconsole.config import MountConfig, SearchConfig, TargetConfig
from rsoconsole.pipeline import (
    SearchBase,
    flip_refusal,
    needs_recentre,
    pier_side_after_slew,
    search_base,
    search_direction,
)
from rsoconsole.pipeline.aim.aim import target_direction
from rsoconsole.records import Site
from rsoconsole.sky import (
    geo_belt_declination_deg,
    geo_slot_direction_deg,
    hour_angle_icrs_deg,
    icrs_of_hour_angle,
    iso_to_utc_ns,
    separation_deg,
)
from rsoconsole.words import text

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
    assert geo_belt_declination_deg(DAYTONA, hour_angle_deg) == pytest.approx(
        declination_deg, abs=one_arcsecond
    )
    assert geo_slot_direction_deg(DAYTONA, longitude_deg) == pytest.approx(
        (hour_angle_deg, declination_deg), abs=one_arcsecond
    )


def test_a_search_stands_still_over_the_ground():
    """Half an hour later the same field of the search lies at the same hour angle."""
    base = SearchBase(hour_angle_deg=-40.0, declination_deg=None)
    search = SearchConfig(pattern="stay")
    angles = [
        hour_angle_icrs_deg(
            DAYTONA,
            *search_direction(
                base, search, DAYTONA, field_deg=(1.6, 1.6), exposure_number=n, t_utc_ns=t_ns
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
                base, search, DAYTONA, field_deg=(1.6, 1.6), exposure_number=n, t_utc_ns=T_UTC_NS
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
        field_deg=(1.6, 1.6),
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


def test_a_slot_that_the_earth_hides_points_below_the_horizon():
    from rsoconsole.sky import altaz_of_hour_angle

    altitude_deg, _ = altaz_of_hour_angle(DAYTONA, *geo_slot_direction_deg(DAYTONA, 100.0))
    assert altitude_deg < -10.0


def test_intelsat_14_stands_where_its_slot_is():
    """Published for slot 45 W and this site: azimuth 124, altitude 38, hour angle -2.7 h."""
    hour_angle_deg, _ = geo_slot_direction_deg(DAYTONA, -45.0)
    assert hour_angle_deg / 15.0 == pytest.approx(-2.7, abs=0.05)
    assert geo_slot_direction_deg(DAYTONA, 315.0) == pytest.approx(
        geo_slot_direction_deg(DAYTONA, -45.0)
    )


@pytest.mark.parametrize(
    ("target", "expected"),
    [
        ({"slot_longitude_deg": -45.0}, "slot"),
        ({"slot_longitude_deg": -45.0, "declination_deg": 3.0}, "slot, own declination"),
        ({"hour_angle_deg": -30.0}, "belt"),
        ({"hour_angle_deg": -30.0, "declination_deg": 12.0}, "of date"),
        ({"ra_icrs_deg": 200.0, "declination_deg": 12.0}, "as it says"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_target_is_where_it_says(target, expected):
    slot_hour_angle_deg, slot_dec_deg = geo_slot_direction_deg(DAYTONA, -45.0)
    places = {
        "slot": (slot_hour_angle_deg, slot_dec_deg),
        "slot, own declination": (slot_hour_angle_deg, 3.0),
        "belt": (-30.0, geo_belt_declination_deg(DAYTONA, -30.0)),
        "of date": (-30.0, 12.0),
    }
    found = target_direction(TargetConfig(name="it", **target), DAYTONA, T_UTC_NS)
    wanted = (200.0, 12.0)
    if expected in places:
        wanted = icrs_of_hour_angle(DAYTONA, *places[expected], T_UTC_NS)
    assert separation_deg(*found, *wanted) * 3600.0 < 0.01


def test_a_list_of_targets_is_visited_in_turn_with_so_many_frames_each():
    targets = tuple(TargetConfig(name=f"{h}", hour_angle_deg=float(h)) for h in (-30, 5, 20))
    search = SearchConfig(pattern="targets", targets=targets, frames_per_field=2)

    def visited(base: SearchBase) -> list[float]:
        where = {"field_deg": (1.6, 1.6), "t_utc_ns": T_UTC_NS}
        return [
            round(
                hour_angle_icrs_deg(
                    DAYTONA,
                    *search_direction(base, search, DAYTONA, exposure_number=n, **where),
                    T_UTC_NS,
                ),
                3,
            )
            for n in range(8)
        ]

    base = SearchBase(hour_angle_deg=-40.0, declination_deg=None)
    assert visited(base) == [-30, -30, 5, 5, 20, 20, -30, -30]
    lost = SearchBase(hour_angle_deg=-40.0, declination_deg=-5.0, comes_before_targets=True)
    assert visited(lost) == [-40, -40, -30, -30, 5, 5, 20, 20]


@pytest.mark.parametrize(
    ("hour_angle_deg", "present", "mount_type", "after"),
    [
        (-20.0, "west", "german", "west"),
        (-20.0, "east", "german", "west"),
        (20.0, "west", "german", "east"),
        (0.4, "west", "german", "west"),
        (-0.4, "east", "german", "east"),
        (0.6, "west", "german", "east"),
        (20.0, None, "german", None),
        (20.0, "west", "fork", "west"),
    ],
)
def test_the_side_changes_past_the_meridian_and_its_hysteresis(
    hour_angle_deg, present, mount_type, after
):
    direction = icrs_of_hour_angle(DAYTONA, hour_angle_deg, -5.0, T_UTC_NS)
    mount = MountConfig(type=mount_type, flip_hysteresis_deg=0.5)
    assert pier_side_after_slew(DAYTONA, mount, direction, T_UTC_NS, present) == after
    holds = mount.model_copy(update={"meridian": "hold"})
    refused = flip_refusal(DAYTONA, holds, direction, T_UTC_NS, present)
    assert (refused is not None) is (after != present)
    assert flip_refusal(DAYTONA, mount, direction, T_UTC_NS, present) is None
    if refused is not None:
        assert f"{hour_angle_deg:+.1f} deg" in text(refused)
        assert f"{after} side" in text(refused)
