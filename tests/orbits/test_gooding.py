"""Gooding's method and Lambert's problem, against published cases, random truth and Orekit."""

import numpy as np
import pytest

from rsoconsole.orbits import GoodingOrbit, gooding_orbits, propagate
from rsoconsole.orbits.first.lambert import lambert
from tests.truth.orbit_cases import MU, PUBLISHED, REGIMES, Published, Random, random_case
from tests.truth.orekit import ask


@pytest.mark.parametrize("case", PUBLISHED, ids=lambda case: case.name.split(",")[0])
def test_published_cases(case: Published) -> None:
    found = gooding_orbits(case.lines, mu=case.mu)
    best = min(found, key=lambda each: np.linalg.norm(each.r_km - case.r2_km))
    assert np.linalg.norm(best.r_km - case.r2_km) < case.within_km
    for ours, theirs in zip(best.ranges_km, case.ranges_km, strict=True):
        if theirs is not None:
            assert ours == pytest.approx(theirs, abs=1e-3)


@pytest.fixture(
    scope="module", params=[8, pytest.param(40, marks=pytest.mark.nightly("many random orbits"))]
)
def solved(request: pytest.FixtureRequest) -> list[tuple[Random, tuple[GoodingOrbit, ...]]]:
    """Random cases without noise, and what was found through their lines."""
    random = np.random.default_rng(20230622)
    cases = [random_case(regime, random) for regime in REGIMES for _ in range(request.param)]
    return [(case, gooding_orbits(case.lines, mu=MU)) for case in cases]


def test_the_true_orbit_is_among_those_found(solved) -> None:
    """At least 97 times in 100."""
    found = [
        any(np.allclose(orbit.ranges_km, case.ranges_km, rtol=1e-6) for orbit in orbits)
        for case, orbits in solved
    ]
    assert np.mean(found) >= 0.97


def test_every_orbit_found_goes_through_all_three_lines() -> None:
    random = np.random.default_rng(5)
    for regime in REGIMES:
        case = random_case(regime, random)
        for orbit in gooding_orbits(case.lines, mu=MU):
            since = case.lines.t_s - case.lines.t_s[1]
            places, _ = propagate(orbit.r_km, orbit.v_km_s, since, MU)
            seen = places - case.lines.sites_km
            seen /= np.linalg.norm(seen, axis=1, keepdims=True)
            np.testing.assert_allclose(seen, case.lines.directions, atol=1e-8)


def test_gooding_agrees_with_orekit_wherever_orekit_converges(solved) -> None:
    theirs = ask("gooding", [_plain(case) for case, _ in solved])
    compared = 0
    for (case, orbits), ranges_km in zip(solved, theirs, strict=True):
        if ranges_km is None or min(ranges_km) <= 0.0:
            continue
        if not np.allclose(ranges_km, case.ranges_km, rtol=1e-4):
            continue  # another orbit through the same lines
        compared += 1
        assert any(np.allclose(orbit.ranges_km, ranges_km, rtol=1e-6) for orbit in orbits)
    assert compared > 0.75 * len(solved)


def _plain(case) -> dict[str, object]:
    return {
        "t_s": case.lines.t_s.tolist(),
        "sites_km": case.lines.sites_km.tolist(),
        "directions": case.lines.directions.tolist(),
        "guess_km": [float(case.ranges_km[0]) * 1.1, float(case.ranges_km[2]) * 1.1],
        "mu": MU,
    }


def test_lambert_agrees_with_orekit() -> None:
    random = np.random.default_rng(11)
    cases = []
    for _ in range(200):
        r1, r2 = random.normal(size=(2, 3))
        is_retrograde = bool(random.integers(2))
        cases.append(
            {
                "r1_km": (r1 / np.linalg.norm(r1) * random.uniform(6600, 45000)).tolist(),
                "r2_km": (r2 / np.linalg.norm(r2) * random.uniform(6600, 45000)).tolist(),
                "dt_s": float(10 ** random.uniform(3.0, 5.3)),
                "is_retrograde": is_retrograde,
                # Orekit's "posigrade" means the shorter way round.
                "is_short": bool((np.cross(r1, r2)[2] < 0.0) == is_retrograde),
                "mu": MU,
            }
        )
    theirs = ask("lambert", cases)
    for case, answer in zip(cases, theirs, strict=True):
        r1, r2 = np.array(case["r1_km"]), np.array(case["r2_km"])
        v1, v2 = lambert(r1, r2, case["dt_s"], MU, is_retrograde=case["is_retrograde"])
        one_centimetre_km = 1e-5
        np.testing.assert_allclose(
            propagate(r1, v1, case["dt_s"], MU)[0], r2, rtol=0.0, atol=one_centimetre_km
        )
        np.testing.assert_allclose(v1, answer["v1_km_s"], rtol=1e-7, atol=1e-8)
        np.testing.assert_allclose(propagate(r1, v1, case["dt_s"], MU)[1], v2, rtol=0.0, atol=3e-8)


@pytest.mark.parametrize("revolutions", [1, 2, 5])
@pytest.mark.parametrize("is_left", [True, False])
@pytest.mark.parametrize("is_retrograde", [True, False])
def test_transfers_with_whole_revolutions_arrive(revolutions, is_left, is_retrograde) -> None:
    r1, r2 = np.array([7000.0, 1000.0, -500.0]), np.array([-3000.0, 9000.0, 2500.0])
    named = {"is_retrograde": is_retrograde, "revolutions": revolutions, "is_left": is_left}
    v1, v2 = lambert(r1, r2, 90_000.0, MU, **named)
    r, v = propagate(r1, v1, 90_000.0, MU)
    np.testing.assert_allclose(r, r2, atol=1e-3)
    np.testing.assert_allclose(v, v2, atol=1e-6)
    assert (np.cross(r1, v1)[2] < 0.0) == is_retrograde
    a = 1.0 / (2.0 / np.linalg.norm(r1) - v1 @ v1 / MU)
    turns = 90_000.0 / (2.0 * np.pi * np.sqrt(a**3 / MU))
    assert revolutions < turns < revolutions + 1


def test_too_short_a_time_for_a_revolution_gives_none() -> None:
    r1, r2 = np.array([7000.0, 0.0, 0.0]), np.array([0.0, 8000.0, 100.0])
    v1, _ = lambert(r1, r2, 600.0, MU, revolutions=1)
    assert np.all(np.isnan(v1))


def test_places_on_one_line_with_the_centre_give_no_plane() -> None:
    r1 = np.array([7000.0, 0.0, 0.0])
    assert np.all(np.isnan(lambert(r1, 2.0 * r1, 3000.0, MU)[0]))
