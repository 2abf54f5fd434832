"""Where a leap goes: in time, in the field, and never where the telescope must not look."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from rsoconsole.config import Config, LimitsConfig, MountConfig
from rsoconsole.orbits import PredictedPosition
from rsoconsole.orbits.motion.ahead import sky_path_through
from rsoconsole.pipeline import (
    Leap,
    LeapParameters,
    MeasuredSlew,
    MountMotion,
    NoLeap,
    PassPlan,
    Telescope,
    leap_exposure_s,
    leap_parameters,
    learned_motion,
    next_leap,
    open_shutter_share,
    plan_pass,
)
from rsoconsole.pipeline.leaps import leaps as mount_motion
from rsoconsole.pipeline.leaps.awaited_passes import StarePoint
from rsoconsole.pipeline.leaps.leaps import LENGTH_PX, LONGEST_S, SHORTEST_S, both_ends_probability
from rsoconsole.sky import (
    Limits,
    Pose,
    hour_angle_icrs_deg,
    icrs_to_altaz,
    pier_side,
    separation_deg,
    site_gcrs,
)
from rsoconsole.words import NS_PER_S
from tests.rigs.leap_rig import travel_s
from tests.tiers import plain_first
from tests.truth.leap_requests import random_leaps
from tests.truth.limits_by_astropy import EDGE_DEG, margins
from tests.truth.limits_requests import OBSERVATORIES
from tests.truth.low_passes import SITE, are_there, low_passes

TERMS = LeapParameters(
    field_deg=(1.63, 1.24), scale_arcsec_px=1.26, settle_s=2.0, latency_s=0.3, readout_s=1.0
)
FAST_MOUNT = MountMotion(
    rate_deg_s=4.0, acceleration_deg_s2=2.0, fixed_s=0.3, scatter_s=0.05, slews=30
)


# --- 100,000 requests, against the limits by astropy


def worst(observatory, count, seed, judge=None):
    """Answers by kind, and each leap that goes beyond a limit."""
    asked = list(random_leaps(observatory, count, seed, judge))
    met = [each for each in asked if isinstance(each.answer, Leap)]
    said = Counter(a.answer.kind if isinstance(a.answer, NoLeap) else "leap" for a in asked)
    by_astropy = margins([each.request(each.answer) for each in met], *OBSERVATORIES[observatory])
    least = np.min(np.stack(list(by_astropy.left_deg.values())), axis=0)
    beyond = (least < -EDGE_DEG) & ~by_astropy.is_edge
    return said, [each for each, is_beyond in zip(met, beyond, strict=True) if is_beyond], met


def expect_sound(observatory, count, seed):
    said, beyond, met = worst(observatory, count, seed)
    print(f"\n{observatory}: {dict(said)}")
    assert beyond == []
    assert said["leap"] > count / 10
    assert said["limit"] > 0
    for each in met:
        leap, terms, motion = each.answer, each.telescope.terms, each.telescope.motion
        way = each.telescope.limits.travel_deg(each.start, *leap.place.direction_deg)
        axes_s = max(travel_s(a, motion.rate_deg_s, motion.acceleration_deg_s2) for a in way)
        arrival_s = motion.fixed_s + axes_s + terms.settle_s
        assert (leap.t_expose_utc_ns - leap.t_order_utc_ns) / NS_PER_S >= arrival_s - 1e-6
        opens_s = terms.latency_s + leap.exposure_s / 2.0
        assert leap.t_mid_utc_ns - leap.t_expose_utc_ns == pytest.approx(opens_s * NS_PER_S, abs=2)
        assert SHORTEST_S <= leap.exposure_s <= LONGEST_S
        assert leap.length_arcsec <= 2 * 3600 * terms.field_radius_deg
        there = each.path.at(leap.t_mid_utc_ns)
        assert separation_deg(*there.direction_deg, *leap.place.direction_deg) < 1e-9


@pytest.mark.parametrize("observatory", plain_first(1, OBSERVATORIES))
def test_no_leap_goes_where_the_telescope_must_not_look(observatory) -> None:
    """1,000 requests here."""
    expect_sound(observatory, 200, seed=0)


@pytest.mark.nights
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
@pytest.mark.parametrize("observatory", OBSERVATORIES)
def test_of_100_000_leaps_none_goes_where_the_telescope_must_not_look(observatory, seed) -> None:
    expect_sound(observatory, 5000, seed)


def test_the_comparison_sees_a_limit_that_is_not_held() -> None:
    """A planner that asks looser limits is found out."""
    name = "in the south, walled, no grace at the meridian"
    site, limits, mount = OBSERVATORIES[name]
    loose = limits.model_copy(update={"horizon": (), "min_altitude_deg": 0.0})
    _, beyond, _ = worst(name, 150, 3, Limits(site, loose, mount))
    assert beyond


# --- one leap


def straight(speed_deg_s, sigma_arcsec=20.0, *, ra=180.0, dec=10.0, t0=0, seconds=60):
    """Along the equator's parallel, eastward, a place every two seconds."""
    places = []
    for n in range(0, seconds + 1, 2):
        places.append(
            PredictedPosition(
                t_utc_ns=t0 + n * NS_PER_S,
                ra_icrs_deg=(ra + speed_deg_s * n / np.cos(np.radians(dec))) % 360.0,
                dec_icrs_deg=dec,
                rate_arcsec_s=np.array([3600.0 * speed_deg_s, 0.0]),
                covariance_arcsec2=np.eye(2) * sigma_arcsec**2,
            )
        )
    return sky_path_through(places)


@pytest.mark.parametrize("speed_deg_s", [0.05, 0.2, 0.5, 0.9])
def test_a_streak_is_as_long_as_is_measured_well(speed_deg_s) -> None:
    place = straight(speed_deg_s).at(NS_PER_S)
    exposure_s = leap_exposure_s(place, TERMS)
    length_px = 3600 * speed_deg_s * exposure_s / TERMS.scale_arcsec_px
    assert length_px == pytest.approx(
        min(LENGTH_PX, 3600 * speed_deg_s * LONGEST_S / 1.26), rel=1e-3
    )
    assert both_ends_probability(place, exposure_s, TERMS) > 0.999


def test_an_unsure_place_gets_a_short_exposure_and_one_too_unsure_none() -> None:
    sure, unsure = (straight(0.9, sigma).at(NS_PER_S) for sigma in (20.0, 690.0))
    assert leap_exposure_s(unsure, TERMS) < leap_exposure_s(sure, TERMS)
    limits = Limits(SITE, Config().limits, Config().mount)
    t0 = low_noon()
    path = straight(0.5, 3 * 3600.0, t0=t0, ra=culminating(t0))
    start = Pose(t_utc_ns=t0, ra_icrs_deg=culminating(t0), dec_icrs_deg=10.0, pier_side="east")
    telescope = Telescope(motion=FAST_MOUNT, terms=TERMS, limits=limits, lifted=("twilight", "Sun"))
    found = next_leap(path, start, t0, telescope)
    assert isinstance(found, NoLeap)
    assert found.kind == "too unsure"


@pytest.mark.parametrize(
    ("sigma_arcsec", "flips", "share", "fits"),
    [
        (20.0, False, 0.5, True),
        (20.0, True, 0.5, False),  # where the mount looks on the other side nobody knows
        (300.0, False, 0.5, False),
        (300.0, False, 0.9, True),
        (20.0, False, 0.3, False),  # a plate wants more stars
    ],
)
def test_a_part_of_the_sensor_is_enough_where_both_ends_are_surely_in_it(
    sigma_arcsec, flips, share, fits
) -> None:
    place = straight(0.5, sigma_arcsec).at(NS_PER_S)
    leap = Leap(
        t_order_utc_ns=0,
        t_expose_utc_ns=0,
        t_mid_utc_ns=NS_PER_S,
        exposure_s=0.2,
        place=place,
        side=None,
        slew_s=1.0,
        within=1.0,
        flips=flips,
    )
    assert leap.fits_in(share, TERMS) == fits


def low_noon() -> int:
    return 1_687_400_000 * NS_PER_S


def culminating(t_utc_ns) -> float:
    """A right ascension some degrees west of the meridian."""
    return float(hour_angle_icrs_deg(SITE, 0.0, 10.0, t_utc_ns) - 5.0) % 360.0


def test_both_ends_in_the_field_are_as_probable_as_is_said() -> None:
    """10,000 places drawn by the stated errors, in a field whose turn is not known."""
    place = straight(0.6, 900.0).at(NS_PER_S)
    exposure_s, random = 0.4, np.random.default_rng(0)
    off = random.normal(0.0, 0.25, (10_000, 2))
    half = 0.6 * exposure_s / 2.0
    is_in = (np.abs(off[:, 0]) + half < TERMS.field_radius_deg) & (
        np.abs(off[:, 1]) < TERMS.field_radius_deg
    )
    assert both_ends_probability(place, exposure_s, TERMS) == pytest.approx(
        np.mean(is_in), abs=0.01
    )


def test_a_mount_that_cannot_keep_up_is_said_to_be_too_slow() -> None:
    limits = Limits(SITE, Config().limits, Config().mount)
    t0 = low_noon()
    path = straight(0.8, t0=t0, ra=culminating(t0), seconds=200)
    slow = replace(FAST_MOUNT, rate_deg_s=0.4, acceleration_deg_s2=0.2)
    start = Pose(t_utc_ns=t0, ra_icrs_deg=culminating(t0), dec_icrs_deg=10.0, pier_side="east")
    telescope = Telescope(motion=slow, terms=TERMS, limits=limits, lifted=("twilight", "Sun"))
    found = next_leap(path, start, t0, telescope)
    assert isinstance(found, NoLeap)
    assert found.kind in ("too fast", "it sets")


# --- the mount, learned


def test_slews_of_the_night_teach_the_law_of_a_mount() -> None:
    """2.5 deg/s, 1.2 deg/s2, 0.8 s beside; configured are 4 deg/s."""
    random = np.random.default_rng(2)
    seen = []
    for _ in range(40):
        way = (float(random.exponential(4.0)), float(random.exponential(4.0)))
        took = 0.8 + travel_s(max(way), 2.5, 1.2) + float(random.normal(0.0, 0.05))
        seen.append(MeasuredSlew(travel_deg=way, seconds=took))
    seen[7] = replace(seen[7], seconds=seen[7].seconds + 15.0)  # sent twice
    motion = learned_motion(MountConfig(), seen)
    for way_deg in (0.5, 2.0, 5.0, 15.0):
        true_s = 0.8 + travel_s(way_deg, 2.5, 1.2)
        assert motion.slew_s((way_deg, 0.0)) == pytest.approx(true_s, abs=0.15)
    assert 0.03 < motion.scatter_s < 0.2
    before = mount_motion.configured_motion(MountConfig())
    assert before.slew_s((15.0, 0.0)) < 8.0 < true_s + 0.8  # what was configured was far off


WAYS_DEG = (
    *(3.24, 3.62, 3.19, 3.49, 3.81, 4.08, 4.33, 4.67, 4.95, 5.12, 5.17, 5.17, 5.07, 4.85, 4.55),
    *(4.26, 3.93, 3.57, 157.73, 2.2, 2.05, 2.82, 2.58, 2.36, 2.18, 1.97, 1.81, 1.72),
)
TOOK_S = (
    *(2.6, 2.7, 2.6, 2.7, 2.8, 2.9, 3.0, 3.1, 3.2, 3.3, 3.3, 3.3, 3.2, 3.2, 3.1),
    *(3.0, 2.9, 2.7, 41.4, 2.1, 2.0, 2.4, 2.3, 2.2, 2.1, 2.0, 2.0, 1.9),
)
"""Of a simulated mount that reports its rest within a tenth of a second."""


def test_a_mount_that_reports_at_once_is_learned_slew_after_slew() -> None:
    """Its fixed part is all but nothing: a law that bounced off zero was half a second too slow."""
    seen = []
    for n, (way, took_s) in enumerate(zip(WAYS_DEG, TOOK_S, strict=True)):
        if n > 5:
            law = learned_motion(MountConfig(), seen)
            assert law.slew_s((way, 0.0)) == pytest.approx(took_s, abs=0.15, rel=0.02)
            assert law.scatter_s < 0.15
        seen.append(MeasuredSlew(travel_deg=(way, 0.0), seconds=took_s))


def test_a_slew_is_surely_over_in_98_of_100() -> None:
    random = np.random.default_rng(3)
    ways = random.exponential(4.0, 400)
    took = [0.4 + travel_s(way, 4.0, 2.0) + float(random.normal(0.0, 0.15)) for way in ways]
    seen = [MeasuredSlew(travel_deg=(w, 0.0), seconds=s) for w, s in zip(ways, took, strict=True)]
    motion = learned_motion(MountConfig(), seen[:60])
    late = [each.seconds > motion.slew_98_percent_s(each.travel_deg) for each in seen[60:]]
    assert np.mean(late) < 0.04


# --- whole passes of real satellites


def plan_of(one, mount=None, limits=None, **terms) -> PassPlan:
    config = Config()
    limits = Limits(SITE, limits or LimitsConfig(max_hour_angle_deg=180.0), mount or config.mount)
    t = np.arange(one.rise_utc_ns, one.set_utc_ns, 2 * NS_PER_S)
    seen = one.satellite.astrometric_place(SITE, t)
    rates = np.stack(
        [seen.ra_rate_deg_s * np.cos(np.radians(seen.dec_icrs_deg)), seen.dec_rate_deg_s]
    )
    path = sky_path_through(
        [
            PredictedPosition(
                t_utc_ns=int(t[n]),
                ra_icrs_deg=float(seen.ra_icrs_deg[n]),
                dec_icrs_deg=float(seen.dec_icrs_deg[n]),
                rate_arcsec_s=3600.0 * rates[:, n],
                covariance_arcsec2=np.eye(2) * 20.0**2,
            )
            for n in range(len(t))
        ]
    )
    ra, dec = path.at(int(t[0])).direction_deg
    side = pier_side(hour_angle_icrs_deg(SITE, ra, dec, int(t[0])))
    start = Pose(t_utc_ns=int(t[0]), ra_icrs_deg=ra, dec_icrs_deg=dec, pier_side=side)
    telescope = Telescope(
        motion=replace(FAST_MOUNT, fixed_s=0.0, scatter_s=0.0),
        terms=replace(leap_parameters(config), latency_s=0.0, **terms),
        limits=limits,
        lifted=("twilight", "Sun"),
    )
    return plan_pass(path, start, int(t[0]), telescope)


needs_passes = pytest.mark.skipif(not are_there(), reason="no element sets beside the project")


@pytest.mark.shared_data
@needs_passes
def test_a_pass_is_as_many_leaps_as_the_mount_allows() -> None:
    """At 500 km and 45 deg, 267 s up: 67 leaps at no overhead, 43 at 1.8 s."""
    fork = MountConfig(type="fork")
    one = max(low_passes(30), key=lambda each: each.fastest_arcsec_s)
    up_s = (one.set_utc_ns - one.rise_utc_ns) / NS_PER_S
    quick, slow = (plan_of(one, fork, readout_s=s) for s in (0.0, 1.8))
    assert up_s / len(quick.leaps) < 6.0
    assert up_s / len(slow.leaps) < 8.0
    assert len(quick.leaps) > 1.2 * len(slow.leaps)
    assert quick.flip_count == 0


@pytest.mark.shared_data
@needs_passes
def test_a_german_mount_loses_the_time_of_its_flip_and_no_more() -> None:
    for one in low_passes(12):
        german = plan_of(one)
        assert len(german.leaps) > 5
        if german.flip_count:
            assert 25.0 < german.longest_gap_s < 70.0
        else:
            assert german.longest_gap_s < 25.0
        for leap in german.leaps:
            altitude, _ = icrs_to_altaz(SITE, *leap.place.direction_deg, leap.t_mid_utc_ns)
            assert altitude >= 15.0 - 0.01


@pytest.mark.shared_data
@needs_passes
def test_a_wall_in_the_way_is_leapt_over() -> None:
    one = low_passes(30)[6]
    free = plan_of(one, MountConfig(type="fork"))
    middle = free.leaps[len(free.leaps) // 2]
    _, azimuth = icrs_to_altaz(SITE, *middle.place.direction_deg, middle.t_mid_utc_ns)
    left, right = (azimuth - 12.0) % 360.0, (azimuth + 12.0) % 360.0
    points = sorted(
        [(left, 15.0), ((left + 0.5) % 360, 85.0), ((right - 0.5) % 360, 85.0), (right, 15.0)]
    )
    walled = plan_of(
        one,
        MountConfig(type="fork"),
        LimitsConfig(max_hour_angle_deg=180.0, horizon=tuple(points)),
    )
    assert 2 < len(walled.leaps) < len(free.leaps)
    assert walled.leaps[-1].t_mid_utc_ns > middle.t_mid_utc_ns
    assert walled.longest_gap_s > free.longest_gap_s + 5.0


# --- where to wait


@pytest.mark.shared_data
@needs_passes
def test_early_or_late_it_comes_through_the_field_that_is_stared_at() -> None:
    """By 20 s, in which the site turns 6 km on: half a degree beside the place among the stars."""
    one = low_passes(30)[4]
    t = one.rise_utc_ns
    r, _ = one.satellite.position_gcrs(np.array([t]))
    x, y, z = r[0].tolist()
    stare = StarePoint(
        t_through_utc_ns=t,
        from_utc_ns=t - 21 * NS_PER_S,
        until_utc_ns=t + 21 * NS_PER_S,
        point_gcrs_km=(x, y, z),
    )
    for late_s in (-20.0, 0.0, 20.0):
        at = stare.t_through_utc_ns + round(late_s * NS_PER_S)
        place = r[0] - site_gcrs(SITE, np.array([at]))[0][0]
        dec = float(np.degrees(np.arcsin(place[2] / np.linalg.norm(place))))
        ra = float(np.degrees(np.arctan2(place[1], place[0])) % 360.0)
        assert separation_deg(ra, dec, *stare.direction_deg(SITE, at)) < 0.02


def test_the_duty_of_a_stare_is_the_share_of_open_shutter() -> None:
    assert open_shutter_share(0.2, 0.3, 0.5) == pytest.approx(0.2)
