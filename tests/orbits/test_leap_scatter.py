"""A shutter that is late at random by far more than the settings say, judged by SGP4 passes."""

from dataclasses import dataclass

import numpy as np
import pytest

from rsoconsole.orbits import (
    LeapTrack,
    PredictedPosition,
    TimingErrors,
    begin_leap_track,
    update_leap_track,
)
from rsoconsole.sky import wrap_180
from rsoconsole.words import NS_PER_S
from tests.truth.low_passes import (
    SITE,
    LowPass,
    are_there,
    low_passes,
    streak_of,
)

STATED = TimingErrors(scatter_s=0.015, bias_sigma_s=0.1, scatter_frames=2.0)
MEASURED = TimingErrors(scatter_s=0.015, bias_sigma_s=0.1)
LEAP_S, LEAPS, PASSES = 6.0, 20, 12
FEW = 4
"""Of the passes, where the statistics wait for the night."""
MANY = pytest.mark.nightly("statistics over many passes")

pytestmark = [
    pytest.mark.shared_data,
    pytest.mark.skipif(not are_there(), reason="no element sets of low satellites beside it"),
]


def sigmas_along(one: LowPass, place: PredictedPosition, late_s: float) -> float:
    """How far along the way the light was when the shutter opened so late."""
    true = one.satellite.astrometric_place(
        SITE, np.array([place.t_utc_ns + round(late_s * NS_PER_S)])
    )
    east = wrap_180(float(true.ra_icrs_deg[0]) - place.ra_icrs_deg)
    off = 3600.0 * np.array(
        [
            east * np.cos(np.radians(place.dec_icrs_deg)),
            float(true.dec_icrs_deg[0]) - place.dec_icrs_deg,
        ]
    )
    ahead = place.rate_arcsec_s / place.speed_arcsec_s
    return abs(float(off @ ahead)) / float(np.sqrt(ahead @ place.covariance_arcsec2 @ ahead))


@dataclass
class Course:
    """What became of one pass."""

    one: LowPass
    track: LeapTrack
    refused: int
    sigmas: list[float]
    """Of where the next shutter found it along its way, from the sixth leap on."""


def course(
    one: LowPass,
    scatter_s: float,
    timing: TimingErrors,
    random: np.random.Generator,
    *,
    shake_arcsec: float = 0.0,
    hidden: float = 0.0,
) -> Course:
    """Leaps through the middle of the pass; ``hidden`` of every fourth streak's light."""
    middle = (one.rise_utc_ns + one.set_utc_ns) // 2
    half_s = min(0.5 * LEAPS * LEAP_S, (one.set_utc_ns - one.rise_utc_ns) / 2e9 - 5.0)
    t = (middle + NS_PER_S * np.linspace(-half_s, half_s, LEAPS)).astype(np.int64).tolist()
    track = begin_leap_track(SITE, streak_of(one, t[0], random, scatter_s=scatter_s), timing)
    assert track is not None
    refused, sigmas = 0, []
    for n, at in enumerate(t[1:]):
        late_s = float(random.normal(0.0, scatter_s))
        streak = streak_of(
            one,
            at,
            random,
            bias_s=late_s,
            scatter_s=0.0,
            shake_arcsec=shake_arcsec,
            hidden=hidden if n % 4 == 3 else 0.0,
        )
        path = track.predicted_path(at - NS_PER_S, 4.0, step_s=1.0)
        after = update_leap_track(track, streak)
        if after is None:
            refused += 1
            continue
        if n >= 6 and path is not None:
            place = path.at(at)
            sigmas.append(sigmas_along(one, place, late_s))
        track = after
    return Course(one=one, track=track, refused=refused, sigmas=sigmas)


@pytest.fixture(
    scope="module",
    params=[(0.24, FEW), *(pytest.param((each, PASSES), marks=MANY) for each in (0.06, 0.24, 0.8))],
)
def courses(request: pytest.FixtureRequest) -> tuple[float, list[Course]]:
    random, (scatter_s, passes) = np.random.default_rng(6), request.param
    return scatter_s, [course(one, scatter_s, STATED, random) for one in low_passes(passes)]


def test_no_streak_is_refused_for_its_time(courses) -> None:
    _, of_all = courses
    assert sum(each.refused for each in of_all) == 0


def test_the_scatter_is_learned(courses) -> None:
    scatter_s, of_all = courses
    learned = [each.track.best_hypothesis.scatter_s / scatter_s for each in of_all]
    assert 0.75 < np.median(learned) < 1.3
    assert min(learned) > 0.4
    assert max(learned) < 1.7


def test_the_next_shutter_finds_it_within_what_is_stated(courses) -> None:
    _, of_all = courses
    sigmas = np.concatenate([each.sigmas for each in of_all])
    assert np.mean(sigmas < 3.0) > 0.95
    assert np.median(sigmas) > 0.25


def test_a_steady_shutter_is_learned_to_be_steady() -> None:
    """Stated ten times too wide, where nobody has measured it."""
    random, wide = np.random.default_rng(7), TimingErrors(scatter_s=0.15, scatter_frames=2.0)
    for one in low_passes(2):
        found = course(one, 0.01, wide, random)
        assert found.track.best_hypothesis.scatter_s < 0.06


def test_a_measured_shutter_is_believed() -> None:
    """A quarter of a second off is then another satellite on the same way, or a fault."""
    random = np.random.default_rng(8)
    found = [course(one, 0.24, MEASURED, random) for one in low_passes(4)]
    assert sum(each.refused for each in found) > 3
    assert all(each.track.best_hypothesis.scatter_s == MEASURED.scatter_s for each in found)


@pytest.fixture(scope="module", params=[FEW, pytest.param(PASSES, marks=MANY)])
def rough(request: pytest.FixtureRequest) -> list[Course]:
    """Late by 0.24 s, ends off by 3", three tenths of every fourth streak not to be seen."""
    random = np.random.default_rng(9)
    return [
        course(one, 0.24, STATED, random, shake_arcsec=3.0, hidden=0.3)
        for one in low_passes(request.param)
    ]


def test_wind_and_hidden_ends_cost_no_streak(rough) -> None:
    assert sum(each.refused for each in rough) == 0
    sigmas = np.concatenate([each.sigmas for each in rough])
    assert np.mean(sigmas < 3.0) > 0.95


def test_what_shakes_the_ends_is_learned(rough) -> None:
    learned = [each.track.best_hypothesis.shake_arcsec for each in rough]
    assert 2.4 < np.median(learned) < 3.6
    assert max(learned) < 4.5
    random = np.random.default_rng(10)
    still = [course(one, 0.06, STATED, random) for one in low_passes(1)]
    assert max(each.track.best_hypothesis.shake_arcsec for each in still) < 0.4


def test_the_orbit_is_as_good_as_it_says(rough) -> None:
    """Six numbers, late by what all frames are late together: 99.9 in 100 below 22.5."""
    off = []
    for each in rough:
        orbit, one = each.track.best_hypothesis.orbit, each.one
        t = np.array([orbit.epoch_utc_ns])
        true = np.concatenate([part[0] for part in one.satellite.position_gcrs(t)])
        error = np.concatenate([orbit.r_km, orbit.v_km_s]) - true
        off.append(float(error @ np.linalg.solve(orbit.covariance, error)))
    assert np.median(off) < 9.0
    assert sum(each > 22.5 for each in off) <= 1
