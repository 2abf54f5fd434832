"""Limits on slews and on what a mount reports: each rule, and all of them against astropy."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, example, given, settings
from hypothesis import strategies as st

from rsoconsole.config import LimitsConfig, MountConfig
from rsoconsole.records import Site
from rsoconsole.simulator.mount.mount_model import MountModel
from rsoconsole.sky import (
    Limits,
    Pose,
    altaz_to_icrs,
    direction_to_unit,
    horizon_altitude_deg,
    icrs_of_hour_angle,
    iso_to_utc_ns,
    jnow_to_icrs,
    separation_deg,
    sun_altitude_deg,
    sun_icrs,
    unit_to_direction,
)
from rsoconsole.sky.limits import limits as limits_module
from rsoconsole.words import NS_PER_S
from tests.tiers import plain_first
from tests.truth.limits_by_astropy import EDGE_DEG, broken_before_the_sky, margins
from tests.truth.limits_requests import OBSERVATORIES, random_requests

DAYTONA = Site(latitude_deg=29.19, longitude_deg=-81.05, elevation_m=10.0)
NIGHT_NS = iso_to_utc_ns("2023-06-22T05:00:00Z")
NOON_NS = iso_to_utc_ns("2023-06-22T17:26:12Z")
"""The Sun is within half a degree of the meridian, 84 deg high."""
SIDEREAL_DEG_S = 15.041 / 3600.0
BY_DAY = ("twilight",)


def limits_of(mount=None, **changes) -> Limits:
    return Limits(DAYTONA, LimitsConfig(**changes), mount or MountConfig())


def pose(hour_angle_deg, dec_deg, side, t_utc_ns=NIGHT_NS, site=DAYTONA) -> Pose:
    """Hour angle and declination of date."""
    ra, dec = icrs_of_hour_angle(site, float(hour_angle_deg), float(dec_deg), t_utc_ns)
    return Pose(t_utc_ns=t_utc_ns, ra_icrs_deg=ra, dec_icrs_deg=dec, pier_side=side)


def slew(limits, start, target, *, until_s=10.0, lifted=()):
    """``target``: hour angle and declination of date at the start of the slew."""
    ra, dec = icrs_of_hour_angle(DAYTONA, float(target[0]), float(target[1]), start.t_utc_ns)
    return limits.refuse_slew(
        start,
        ra,
        dec,
        t_aim_utc_ns=start.t_utc_ns,
        t_until_utc_ns=start.t_utc_ns + round(until_s * NS_PER_S),
        lifted=lifted,
    )


def limit_of(refused) -> str | None:
    return None if refused is None else refused.limit


def from_sun(hour_angle_deg, dec_deg, side, t_utc_ns=NOON_NS) -> Pose:
    """A pose so far west and north of the Sun, in right ascension and declination."""
    ra, dec = sun_icrs(t_utc_ns)
    return Pose(
        t_utc_ns=t_utc_ns,
        ra_icrs_deg=(ra - hour_angle_deg) % 360.0,
        dec_icrs_deg=dec + dec_deg,
        pier_side=side,
    )


def slew_between(limits, start, end, lifted=BY_DAY):
    return limits.refuse_slew(
        start,
        end.ra_icrs_deg,
        end.dec_icrs_deg,
        t_aim_utc_ns=start.t_utc_ns,
        t_until_utc_ns=start.t_utc_ns + 30 * NS_PER_S,
        lifted=lifted,
    )


# --- the end of a slew


@pytest.mark.parametrize(("altitude_deg", "refused"), [(14.9, "altitude"), (15.1, None)])
def test_a_low_target_is_refused_with_the_figure(altitude_deg, refused):
    ra, dec = altaz_to_icrs(DAYTONA, altitude_deg, 180.0, NIGHT_NS)
    said = limits_of().refuse_slew(
        pose(-10.0, 0.0, "west"), ra, dec, t_aim_utc_ns=NIGHT_NS, t_until_utc_ns=NIGHT_NS
    )
    assert limit_of(said) == refused
    if said is not None:
        assert said.text.startswith("altitude 14.9 deg is 0.1")
        assert "limit of 15.0" in said.text


def test_the_mask_is_straight_between_its_points_and_round_through_north():
    mask = ((10.0, 30.0), (90.0, 10.0), (350.0, 20.0))
    azimuth = np.array([10.0, 50.0, 355.0, 0.0, 220.0])
    assert horizon_altitude_deg(mask, azimuth) == pytest.approx([30.0, 20.0, 22.5, 25.0, 15.0])
    assert horizon_altitude_deg(((77.0, 12.0),), azimuth) == pytest.approx([12.0] * 5)


@pytest.mark.parametrize(
    ("azimuth_deg", "altitude_deg", "refused"),
    [(100.0, 29.0, "horizon"), (100.0, 31.0, None), (100.0, 10.0, "altitude"), (140.0, 29.0, None)],
)
def test_the_higher_of_mask_and_least_altitude_holds(azimuth_deg, altitude_deg, refused):
    limits = limits_of(horizon=((0.0, 0.0), (90.0, 30.0), (110.0, 30.0), (120.0, 0.0)))
    ra, dec = altaz_to_icrs(DAYTONA, altitude_deg, azimuth_deg, NIGHT_NS)
    start = Pose(t_utc_ns=NIGHT_NS, ra_icrs_deg=ra, dec_icrs_deg=dec, pier_side="west")
    said = limits.refuse_slew(start, ra, dec, t_aim_utc_ns=NIGHT_NS, t_until_utc_ns=NIGHT_NS)
    assert limit_of(said) == refused


@pytest.mark.parametrize(("until_s", "refused"), [(30.0, None), (600.0, "altitude")])
def test_a_target_that_sets_during_the_exposure_is_refused(until_s, refused):
    ra, dec = altaz_to_icrs(DAYTONA, 15.5, 270.0, NIGHT_NS)
    start = pose(60.0, 10.0, "east")
    said = limits_of().refuse_slew(
        start,
        ra,
        dec,
        t_aim_utc_ns=NIGHT_NS,
        t_until_utc_ns=NIGHT_NS + round(until_s * NS_PER_S),
    )
    assert limit_of(said) == refused


def test_a_target_that_rises_on_the_way_is_allowed():
    """It is 0.1 deg too low now; the way there takes 45 s at a degree a second."""
    ra, dec = altaz_to_icrs(DAYTONA, 14.9, 90.0, NIGHT_NS)
    far, here = pose(-35.0, 10.0, "west"), altaz_to_icrs(DAYTONA, 15.5, 90.0, NIGHT_NS)
    near = Pose(t_utc_ns=NIGHT_NS, ra_icrs_deg=here[0], dec_icrs_deg=here[1], pier_side="west")
    limits = limits_of(MountConfig(slew_rate_deg_s=1.0))
    times = {"t_aim_utc_ns": NIGHT_NS, "t_until_utc_ns": NIGHT_NS + 60 * NS_PER_S}
    assert limits.refuse_slew(far, ra, dec, **times) is None
    assert limit_of(limits.refuse_slew(near, ra, dec, **times)) == "altitude"


@pytest.mark.parametrize(
    ("hour_angle_deg", "until_s", "refused"),
    [
        (119.9, 10.0, None),
        (119.9, 60.0, "hour angle"),
        (120.1, 10.0, "hour angle"),
        (-119.9, 10.0, None),
        (-120.3, 10.0, "hour angle"),
    ],
)
def test_the_hour_angle_is_held_until_the_end_of_the_exposure(hour_angle_deg, until_s, refused):
    side = "west" if hour_angle_deg < 0 else "east"
    start = pose(math.copysign(115.0, hour_angle_deg), 70.0, side)
    said = slew(limits_of(), start, (hour_angle_deg, 75.0), until_s=until_s)
    assert limit_of(said) == refused


@pytest.mark.parametrize(
    ("side", "hour_angle_deg", "until_s", "arrival", "refused"),
    [
        ("west", 0.3, 60.0, "west", None),
        ("west", 0.3, 2700.0, "west", "pier"),
        ("west", 0.6, 2700.0, "east", None),
        ("east", -0.3, 60.0, "east", None),
        ("east", -0.6, 60.0, "west", None),
        (None, 0.3, 60.0, None, None),
        (None, 0.3, 2700.0, None, "pier"),
        (None, 0.6, 2700.0, "east", None),
    ],
)
def test_a_german_mount_changes_sides_past_the_hysteresis_and_stops_past_the_meridian(
    side, hour_angle_deg, until_s, arrival, refused
):
    limits, start = limits_of(), pose(0.0, 10.0, side)
    ra, dec = icrs_of_hour_angle(DAYTONA, hour_angle_deg, 12.0, NIGHT_NS)
    assert limits.arrival_side(start, ra, dec, NIGHT_NS) == arrival
    assert limit_of(slew(limits, start, (hour_angle_deg, 12.0), until_s=until_s)) == refused


def test_a_fork_knows_no_sides():
    limits, start = limits_of(MountConfig(type="fork")), pose(-5.0, 10.0, None)
    assert limits.arrival_side(start, start.ra_icrs_deg, start.dec_icrs_deg, NIGHT_NS) is None
    assert slew(limits, start, (0.3, 12.0), until_s=2700.0) is None
    assert limits.refuse_pose(pose(50.0, 10.0, None), is_slewing=False) is None


@pytest.mark.parametrize("hour_angle_deg", [-170.0, -60.0, 0.0, 60.0, 150.0])
@pytest.mark.parametrize("side", ["west", "east", None])
def test_a_slew_to_the_pole_and_from_it_is_possible(hour_angle_deg, side):
    """Also at midsummer midnight, with the Sun 37 deg below the pole's horizon."""
    limits = limits_of()
    here, pole = pose(-40.0, 10.0, side), pose(hour_angle_deg, 89.99, side)
    assert slew(limits, here, (hour_angle_deg, 89.99)) is None
    assert slew(limits, pole, (-40.0, 10.0)) is None
    assert slew(limits, pole, (40.0, 10.0)) is None
    assert limits.refuse_pose(pole, is_slewing=False) is None


def test_beside_the_pole_the_hour_angle_is_held_again():
    for dec_deg, refused in ((89.4, "hour angle"), (89.6, None)):
        beside = pose(-170.0, dec_deg, "west")
        assert limit_of(limits_of().refuse_pose(beside, is_slewing=False)) == refused


def test_twilight_refuses_a_slew_unless_lifted():
    dusk_ns = next(
        t
        for t in range(iso_to_utc_ns("2023-06-22T00:30:00Z"), NIGHT_NS, 10 * NS_PER_S)
        if sun_altitude_deg(DAYTONA, t) < -11.9
    )
    limits = limits_of()
    early = pose(-20.0, 0.0, "west", dusk_ns)
    said = slew(limits, early, (-25.0, 0.0))
    assert limit_of(said) == "twilight"
    assert "-11.9" in said.text
    assert slew(limits, early, (-25.0, 0.0), lifted=["twilight"]) is None
    assert slew(limits, pose(-20.0, 0.0, "west", dusk_ns + 60 * NS_PER_S), (-25.0, 0.0)) is None


# --- what cannot be meant


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 360.0, -0.001])
def test_what_is_no_direction_is_refused_whatever_is_lifted(bad):
    limits, start = limits_of(), pose(-20.0, 0.0, "west")
    times = {"t_aim_utc_ns": NIGHT_NS, "t_until_utc_ns": NIGHT_NS, "lifted": ("direction",)}
    assert limit_of(limits.refuse_slew(start, bad, 0.0, **times)) == "direction"
    assert limit_of(limits.refuse_slew(start, 10.0, bad - 90.0, **times)) == "direction"
    broken = replace(start, ra_icrs_deg=bad)
    assert limit_of(limits.refuse_slew(broken, 200.0, 0.0, **times)) == "direction"
    assert limit_of(limits.refuse_pose(broken, is_slewing=True)) == "direction"
    assert limits.next_limit(broken)[0] == NIGHT_NS
    assert limits.arrival_side(start, bad, 0.0, NIGHT_NS) is None


@pytest.mark.parametrize(
    ("aim_s", "until_s", "refused"),
    [
        (-299.0, 1.0, None),
        (-301.0, 1.0, "time"),
        (7199.0, 7200.0, None),
        (7201.0, 7210.0, "time"),
        (10.0, 9.0, "time"),
        (-200.0, -100.0, "time"),
        (10.0, 14401.0, "time"),
        (1e9, 2e9, "time"),
        (-1.7e9, 10.0, "time"),
        (3e9, 3e9, "time"),
    ],
)
def test_stale_and_impossible_times_are_refused_whatever_is_lifted(aim_s, until_s, refused):
    start = pose(-100.0, 75.0, "west")
    said = limits_of().refuse_slew(
        start,
        start.ra_icrs_deg,
        start.dec_icrs_deg,
        t_aim_utc_ns=NIGHT_NS + round(aim_s * NS_PER_S),
        t_until_utc_ns=NIGHT_NS + round(until_s * NS_PER_S),
        lifted=("time", "twilight"),
    )
    assert limit_of(said) == refused


def test_a_clock_that_was_never_set_refuses_everything():
    lost = replace(pose(-20.0, 0.0, "west"), t_utc_ns=1_000 * NS_PER_S)
    assert "1970" in slew(limits_of(), lost, (-20.0, 0.0)).text
    assert limit_of(limits_of().refuse_pose(lost, is_slewing=False)) == "time"


# --- the Sun


@pytest.mark.parametrize(("sun_deg", "refused"), [(-5.9, "Sun"), (-6.1, None)])
def test_the_sun_is_not_looked_at_before_it_is_deep_below_the_horizon(sun_deg, refused):
    """A clock may be some minutes wrong; but a flip by night may swing through where it is."""
    dusk_ns = next(
        t
        for t in range(NIGHT_NS - 9 * 3600 * NS_PER_S, NIGHT_NS, 5 * NS_PER_S)
        if sun_altitude_deg(DAYTONA, t) < sun_deg
    )
    ra, dec = sun_icrs(dusk_ns)
    said = limits_of().refuse_slew(
        pose(-20.0, 10.0, "west", t_utc_ns=dusk_ns),
        ra,
        dec,
        t_aim_utc_ns=dusk_ns,
        t_until_utc_ns=dusk_ns,
        lifted=("altitude", "hour angle", "pier", "twilight"),
    )
    assert limit_of(said) == refused
    if said is not None:
        assert "40.0 inside its cone of 40.0" in said.text


def test_a_fork_must_not_cross_the_sun_where_a_german_mount_flips_past_the_pole():
    """Both ends are 45 deg from the Sun, one on either side of the meridian."""
    east_of_it, west_of_it = from_sun(-50.0, 0.0, "west"), from_sun(50.0, 0.0, "east")
    for end in (east_of_it, west_of_it):
        sun = sun_icrs(NOON_NS)
        assert separation_deg(end.ra_icrs_deg, end.dec_icrs_deg, *sun) > 44.0
    assert slew_between(limits_of(), east_of_it, west_of_it) is None
    fork = limits_of(MountConfig(type="fork"))
    said = slew_between(fork, replace(east_of_it, pier_side=None), west_of_it)
    assert limit_of(said) == "Sun"
    assert "the way there passes" in said.text
    assert slew_between(fork, east_of_it, west_of_it, lifted=("Sun", "twilight")) is None


def test_with_an_unknown_side_either_way_past_the_sun_refuses():
    """From the west side the flip leads past the pole; from the east side straight across."""
    unknown, end = from_sun(-50.0, 0.0, None), from_sun(50.0, 0.0, None)
    assert limit_of(slew_between(limits_of(), unknown, end)) == "Sun"
    assert slew_between(limits_of(), replace(unknown, pier_side="west"), end) is None


@pytest.mark.parametrize(
    ("start", "end", "great_circle_deg", "refused"),
    [((-75.0, 20.0), (70.0, 0.0), 42.3, "Sun"), ((70.0, 0.0), (-40.0, -40.0), 21.2, None)],
)
def test_the_axes_do_not_go_a_great_circle(start, end, great_circle_deg, refused):
    """One great circle is clear of the cone and the axes are not; one other way round."""
    fork = limits_of(MountConfig(type="fork"), min_altitude_deg=-5.0)
    here, there = from_sun(*start, None), from_sun(*end, None)
    a = direction_to_unit(here.ra_icrs_deg, here.dec_icrs_deg)
    b = direction_to_unit(there.ra_icrs_deg, there.dec_icrs_deg)
    share = np.linspace(0.0, 1.0, 1000)[:, None]
    ra, dec = unit_to_direction(a * (1.0 - share) + b * share)
    closest_deg = np.min(separation_deg(ra, dec, *sun_icrs(NOON_NS)))
    assert closest_deg == pytest.approx(great_circle_deg, abs=0.1)
    assert limit_of(slew_between(fork, here, there)) == refused


@pytest.mark.parametrize(
    ("from_deg", "to_deg", "refused"),
    [
        (-20.0, -60.0, None),  # out, the short way
        (-20.0, -30.0, "Sun"),  # away, but not out
        (-20.0, 60.0, "Sun"),  # out, across the Sun
        (-50.0, -60.0, None),
        (-60.0, -47.0, None),
        (-60.0, -40.0, "Sun"),
    ],
)
def test_a_way_that_begins_in_the_cone_may_only_lead_out(from_deg, to_deg, refused):
    fork = limits_of(MountConfig(type="fork"))
    start, end = from_sun(from_deg, 0.0, None), from_sun(to_deg, 0.0, None)
    assert limit_of(slew_between(fork, start, end)) == refused


def test_a_narrow_cone_does_not_slip_through_between_two_samples():
    fork = limits_of(MountConfig(type="fork", slew_rate_deg_s=8.0), sun_cone_deg=0.2)
    assert limit_of(slew_between(fork, from_sun(-60, 0, None), from_sun(55, 0, None))) == "Sun"
    assert slew_between(fork, from_sun(-60, -20, None), from_sun(55, -20, None)) is None


def test_no_cone_is_no_limit():
    fork = limits_of(MountConfig(type="fork"), sun_cone_deg=0.0)
    assert slew_between(fork, from_sun(-30, 0, None), from_sun(0, 0, None)) is None


# Many slews are refused, and those are not what this is about.
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.filter_too_much])
@given(
    start=st.tuples(st.floats(-100, 100), st.floats(-30, 85)),
    end=st.tuples(st.floats(-100, 100), st.floats(-30, 85)),
    acceleration=st.floats(2.0, 20.0),
)
def test_a_slew_that_was_allowed_never_enters_the_cone_in_the_simulated_mount(
    start, end, acceleration
):
    """The simulated mount has ramps, which the limits know only as a lag."""
    t_ns = NOON_NS
    at = pose(start[0], start[1], None, t_ns)
    model = _model_at(*start, acceleration, t_ns)
    at = replace(at, pier_side=model.instant(t_ns).pier_side)
    others = ("twilight", "altitude", "horizon", "hour angle", "pier")
    sun = sun_icrs(t_ns)
    assume(separation_deg(at.ra_icrs_deg, at.dec_icrs_deg, *sun) >= 40.0)
    assume(slew(limits_of(), at, end, lifted=others) is None)
    ra, dec = _of_date(*end, t_ns)
    duration_s = model.slew(ra, dec, t_ns)
    for s in np.arange(0.0, duration_s + 0.2, 0.2):
        t = t_ns + round(s * NS_PER_S)
        now = model.instant(t)
        there = jnow_to_icrs(now.ra_date_deg, now.dec_date_deg, t)
        assert separation_deg(*there, *sun) > 40.0 - EDGE_DEG
    arrived = model.instant(t_ns + round((duration_s + 1.0) * NS_PER_S))
    ra_icrs, dec_icrs = icrs_of_hour_angle(DAYTONA, *end, t_ns)
    assert limits_of().arrival_side(at, ra_icrs, dec_icrs, t_ns) == arrived.pier_side


@settings(max_examples=40, deadline=None)
@given(
    start=st.tuples(st.floats(-75, 75), st.floats(-10, 80)),
    end=st.tuples(st.floats(-75, 75), st.floats(-10, 80)),
)
def test_the_watch_lets_the_simulated_mount_do_every_slew_that_was_allowed(start, end):
    """Flips among them: looked at once a second, nothing on the way is refused."""
    model = _model_at(*start, 2.0, NIGHT_NS)
    at = pose(*start, model.instant(NIGHT_NS).pier_side)
    limits = limits_of()
    assume(slew(limits, at, end) is None)
    duration_s = model.slew(*_of_date(*end, NIGHT_NS), NIGHT_NS)
    for second in range(int(duration_s) + 2):
        t = NIGHT_NS + second * NS_PER_S
        now = model.instant(t)
        ra, dec = jnow_to_icrs(now.ra_date_deg, now.dec_date_deg, t)
        seen = Pose(t_utc_ns=t, ra_icrs_deg=ra, dec_icrs_deg=dec, pier_side=now.pier_side)
        assert limits.refuse_pose(seen, is_slewing=now.is_slewing) is None


def _of_date(hour_angle_deg, dec_deg, t_ns):
    from rsoconsole.sky import lst_deg

    return (lst_deg(DAYTONA.longitude_deg, t_ns) - hour_angle_deg) % 360.0, dec_deg


def _model_at(hour_angle_deg, dec_deg, acceleration, t_ns) -> MountModel:
    from rsoconsole.simulator.mount.mount_model import MountTraits

    ra, dec = _of_date(hour_angle_deg, dec_deg, t_ns)
    return MountModel(
        latitude_deg=DAYTONA.latitude_deg,
        longitude_deg=DAYTONA.longitude_deg,
        seed=1,
        t_utc_ns=t_ns,
        ra_date_deg=ra,
        dec_date_deg=dec,
        traits=MountTraits(acceleration_deg_s2=acceleration),
    )


# --- the watch


@pytest.mark.parametrize(
    ("hour_angle_deg", "dec_deg", "side", "slewing", "standing"),
    [
        (-40.0, 10.0, "west", None, None),
        (-40.0, -50.0, "west", None, "altitude"),
        (10.5, 10.0, "west", "pier", "pier"),
        (9.5, 10.0, "west", None, None),
        (-10.5, 10.0, "east", "pier", "pier"),
        (10.5, 10.0, None, None, None),
        # In the midst of a flip: over the pole, the polar axis hardly turned yet.
        (175.0, 80.0, "east", None, "hour angle"),
    ],
)
def test_the_watch_lets_a_slew_dip_and_flip_but_not_turn_too_far(
    hour_angle_deg, dec_deg, side, slewing, standing
):
    there = pose(hour_angle_deg, dec_deg, side)
    limits = limits_of()
    assert limit_of(limits.refuse_pose(there, is_slewing=True)) == slewing
    assert limit_of(limits.refuse_pose(there, is_slewing=False)) == standing


def test_the_watch_stops_a_slew_in_the_cone_unless_it_leads_out():
    limits = limits_of(MountConfig(type="fork"))
    second_ns = NOON_NS + NS_PER_S
    now = from_sun(-20.0, 0.0, None, second_ns)
    assert limit_of(limits.refuse_pose(now, is_slewing=True)) == "Sun"
    for was_deg, refused in ((-16.0, None), (-20.0, None), (-20.1, "Sun"), (-60.0, "Sun")):
        before = from_sun(was_deg, 0.0, None)
        said = limits.refuse_pose(now, is_slewing=True, before=before)
        assert limit_of(said) == refused
    nearest = from_sun(-16.0, 0.0, None)
    assert limit_of(limits.refuse_pose(now, is_slewing=False, before=nearest)) == "Sun"


def test_the_watch_lets_a_mount_come_back_from_beyond_the_meridian():
    limits, now = limits_of(), pose(14.0, 10.0, "west", NIGHT_NS + NS_PER_S)
    farther, nearer = pose(16.0, 10.0, "west"), pose(12.0, 10.0, "west")
    assert limits.refuse_pose(now, is_slewing=True, before=farther) is None
    assert limit_of(limits.refuse_pose(now, is_slewing=True, before=nearer)) == "pier"


def test_a_limit_that_is_lifted_is_not_watched():
    low = pose(-40.0, -50.0, "west")
    assert limits_of().refuse_pose(low, is_slewing=False, lifted={"altitude"}) is None
    assert limits_of().next_limit(low, 60.0, lifted={"altitude"}) is None


# --- the next limit


@pytest.mark.parametrize(
    ("hour_angle_deg", "dec_deg", "side", "at_deg", "limit"),
    [
        (9.0, 10.0, "west", 10.0, "pier"),
        (-30.0, 10.0, None, 10.0, "pier"),
        (9.0, 10.0, None, 10.0, "pier"),
        (100.0, 75.0, "east", 120.0, "hour angle"),
        (11.0, 75.0, None, 120.0, "hour angle"),
    ],
)
def test_the_next_limit_comes_when_the_sky_has_turned_so_far(
    hour_angle_deg, dec_deg, side, at_deg, limit
):
    start = pose(hour_angle_deg, dec_deg, side)
    t_ns, said = limits_of().next_limit(start, 9 * 3600.0)
    assert said.limit == limit
    expected_s = (at_deg - hour_angle_deg) / SIDEREAL_DEG_S
    half_a_second = 0.5
    assert (t_ns - NIGHT_NS) / NS_PER_S == pytest.approx(expected_s, abs=half_a_second)


def test_nothing_ahead_is_said_and_what_is_violated_already_too():
    assert limits_of().next_limit(pose(-100.0, 75.0, "west"), 3600.0) is None
    t_ns, said = limits_of().next_limit(pose(-40.0, -50.0, "west"))
    assert (t_ns, said.limit) == (NIGHT_NS, "altitude")


def is_beside_the_sun_s_cone(limits, where) -> bool:
    """Whether its edge is an arcsecond away: the Sun needs half a minute for that."""
    an_arcsecond = 1.0 / 3600.0
    return abs(dict(limits.margins_deg(where)).get("Sun", 90.0)) < an_arcsecond


@settings(max_examples=150, deadline=None)
@given(
    hour_angle_deg=st.floats(-120, 120),
    dec_deg=st.floats(-60, 89),
    side=st.sampled_from(["west", "east"]),
    t_s=st.integers(1_400_000_000, 1_780_000_000),
    is_walled=st.booleans(),
)
@example(hour_angle_deg=-43.0, dec_deg=0.0, side="west", t_s=1_400_000_000, is_walled=False)
def test_the_next_limit_agrees_with_the_watch_just_before_and_after(
    hour_angle_deg, dec_deg, side, t_s, is_walled
):
    walls = ((0.0, 20.0), (120.0, 35.0), (200.0, 10.0), (300.0, 40.0)) if is_walled else ()
    limits, start = limits_of(horizon=walls), pose(hour_angle_deg, dec_deg, side, t_s * NS_PER_S)
    found = limits.next_limit(start)
    end_ns = start.t_utc_ns + 6 * 3600 * NS_PER_S if found is None else found[0]
    # As far on the sky everywhere: near the pole nothing gets on.
    moment_ns = round(0.2 * NS_PER_S / math.cos(math.radians(dec_deg)))
    if found is not None:
        after = replace(start, t_utc_ns=end_ns + moment_ns)
        is_refused = limits.refuse_pose(after, is_slewing=False) is not None
        assert is_refused or is_beside_the_sun_s_cone(limits, after)
    if end_ns <= start.t_utc_ns + moment_ns:
        return
    for share in (0.0, 0.3, 0.7, 0.95, 1.0):
        t_ns = start.t_utc_ns + round((end_ns - start.t_utc_ns - moment_ns) * share)
        before = replace(start, t_utc_ns=t_ns)
        is_free = limits.refuse_pose(before, is_slewing=False) is None
        assert is_free or is_beside_the_sun_s_cone(limits, before)


# --- all of them at once, against astropy


def answers(limits, requests):
    return [
        limits.refuse_slew(
            Pose(
                t_utc_ns=r.now_ns,
                ra_icrs_deg=r.start[0],
                dec_icrs_deg=r.start[1],
                pier_side=r.side,
            ),
            *r.target,
            t_aim_utc_ns=r.aim_ns,
            t_until_utc_ns=r.until_ns,
            lifted=r.lifted,
        )
        for r in requests
    ]


def compute(requests, observatory):
    """Margins by astropy of the requests that are sound, by their place in the list."""
    from astropy.utils import iers

    places = [i for i, request in enumerate(requests) if broken_before_the_sky(request) is None]
    with iers.conf.set_temp("auto_download", False):
        computed = margins([requests[i] for i in places], *OBSERVATORIES[observatory])
    return {
        i: (
            {name: float(values[row]) for name, values in computed.left_deg.items()},
            bool(computed.is_edge[row]),
        )
        for row, i in enumerate(places)
    }


def compare(requests, answered, computed):
    """What the limits and the second computation disagree on, and how many lie on an edge."""
    wrong, on_edge = [], 0
    for i, (request, said) in enumerate(zip(requests, answered, strict=True)):
        if i not in computed:
            if limit_of(said) != broken_before_the_sky(request):
                wrong.append((request, said))
            continue
        left_deg, is_edge = computed[i]
        least_deg = min(left_deg.values())
        names_a_violated_one = said is not None and left_deg[said.limit] < EDGE_DEG
        if is_edge or abs(least_deg) < EDGE_DEG:
            on_edge += 1
        elif not (said is None if least_deg > 0.0 else names_a_violated_one):
            wrong.append((request, said, left_deg))
    return wrong, on_edge


def agree(observatory, count, seed):
    requests = random_requests(observatory, count, seed)
    answered = answers(Limits(*OBSERVATORIES[observatory]), requests)
    wrong, on_edge = compare(requests, answered, compute(requests, observatory))
    said = Counter(limit_of(one) or "allowed" for one in answered)
    print(f"\n{observatory}: {dict(said)}, {on_edge} on an edge, {len(wrong)} wrong")
    assert wrong[:3] == []
    assert on_edge < count / 50
    assert said["allowed"] > count / 10
    return said


@pytest.mark.parametrize("observatory", plain_first(3, OBSERVATORIES))
def test_no_unsafe_slew_passes_and_no_safe_one_is_refused(observatory):
    """2,500 requests; a hundredth of a degree from a bound either answer is right."""
    said = agree(observatory, 500, seed=0)
    assert {"Sun", "altitude", "twilight", "direction", "time"} <= said.keys()


@pytest.mark.nights
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
@pytest.mark.parametrize("observatory", OBSERVATORIES)
def test_of_100_000_slews_no_unsafe_one_passes_and_no_safe_one_is_refused(observatory, seed):
    agree(observatory, 5000, seed)


@pytest.fixture(scope="module")
def trouble():
    """Requests for one observatory, with their margins."""
    requests = random_requests("Daytona, German", 700, seed=5)
    return requests, compute(requests, "Daytona, German")


@pytest.mark.parametrize(
    "loosened",
    plain_first(
        3,
        [
            {"min_altitude_deg": 11.0},
            {"sun_cone_deg": 43.0},
            {"max_hour_angle_deg": 124.0},
            {"past_meridian_deg": 15.0},
            {"twilight_deg": -9.0},
            {"min_altitude_deg": 19.0},
            {"sun_cone_deg": 37.0},
        ],
    ),
)
def test_the_comparison_sees_a_limit_that_is_not_as_configured(trouble, loosened):
    requests, computed = trouble
    site, limits, mount = OBSERVATORIES["Daytona, German"]
    other = Limits(site, LimitsConfig(**{**limits.model_dump(), **loosened}), mount)
    assert compare(requests, answers(other, requests), computed)[0] != []


def test_the_comparison_sees_that_only_the_ends_are_held_against_the_sun(trouble, monkeypatch):
    monkeypatch.setattr(limits_module, "sun_passage", lambda *_: None)
    requests, computed = trouble
    answered = answers(Limits(*OBSERVATORIES["Daytona, German"]), requests)
    assert compare(requests, answered, computed)[0] != []


@pytest.mark.parametrize("observatory", plain_first(2, OBSERVATORIES))
def test_every_refusal_says_the_figure_and_the_bound(observatory):
    requests = random_requests(observatory, 150, seed=7)
    for said in answers(Limits(*OBSERVATORIES[observatory]), requests):
        if said is None or said.limit in ("direction", "time"):
            continue
        assert said.value_deg is not None
        assert f"{said.value_deg:.1f}" in said.text
        assert f"{said.bound_deg:.1f}" in said.text
