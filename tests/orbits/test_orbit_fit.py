"""Orbits from directions with known truth: how good they are, and whether they know it.

Truth is moved by other code (`tests/truth/orbit_truth.py`). Larger samples:
`tests/bench/bench_orbit.py`.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsoconsole.orbits import (
    MeasuredDirections,
    Orbit,
    PerturbedPropagator,
    TwoBodyPropagator,
    determine_orbit,
    osculating_elements,
    predict,
    reduce_directions,
)
from rsoconsole.orbits.determination.regimes import FREE_SIGMA_A_KM
from rsoconsole.records import Site
from rsoconsole.sky import iso_to_utc_ns, site_gcrs
from rsoconsole.words import NS_PER_S
from tests.truth.orbit_cases import state_of
from tests.truth.orbit_truth import DAYTONA, Flight, geostationary, off_arcsec, seen_with_noise

T0 = iso_to_utc_ns("2023-06-22T03:00:00Z")
HOUR_S, DAY_S = 3600.0, 86400.0
TEN_MINUTES_S = np.arange(0.0, 601.0, 30.0)
THREE_SIGMA = 11.83
ONE_MORE = pytest.mark.nightly("one more satellite")


def one_geo(
    seed: int = 1, *, e: float = 3e-4, i_deg: float = 2.0, a_km: float = 42_180.0
) -> Flight:
    random = np.random.default_rng(seed)
    return geostationary(random, 1, t0_utc_ns=T0, i_deg=i_deg, e=np.array([e]), a_km=(a_km, 0.0))


def seen_at(
    flight: Flight, since_s: np.ndarray, sigma: float = 1.0, seed: int = 2
) -> MeasuredDirections:
    random = np.random.default_rng(seed)
    return seen_with_noise(random, flight.site, flight.places(since_s)[0], sigma)


def surprise(orbit: Orbit, flight: Flight, since_s: float) -> tuple[float, float]:
    """Error of a prediction in arcsec, and squared in units of its own covariance."""
    truth = flight.places(np.array([since_s]))[0]
    ahead = predict(orbit, flight.site, truth.t_utc_ns)
    ee, en, nn = ahead.cov_sky_arcsec2[0]
    off = off_arcsec(ahead.places, truth)[0]
    return float(np.hypot(*off)), float(off @ np.linalg.solve([[ee, en], [en, nn]], off))


def test_the_forces_are_those_of_an_independent_integration() -> None:
    since_s = np.array([0.0, 7200.0, DAY_S, 2.0 * DAY_S])
    for i_deg, seed in ((0.05, 1), (60.0, 2)):
        flight = one_geo(seed, i_deg=i_deg)
        truth = flight.states(since_s)[:, 0, :3]
        ours, _ = PerturbedPropagator(epoch_utc_ns=T0).states(
            flight.start[0, :3], flight.start[0, 3:], since_s
        )
        one_metre_km = 1e-3
        np.testing.assert_allclose(ours, truth, atol=one_metre_km)
        # Each of them counts: about a point mass it is kilometres.
        plain, _ = TwoBodyPropagator().states(flight.start[0, :3], flight.start[0, 3:], since_s)
        assert np.linalg.norm(plain[-1] - truth[-1]) > 3.0


@pytest.mark.parametrize(("arc_min", "sigma", "median_arcsec"), [(10, 4.0, 32.0), (60, 1.0, 4.0)])
def test_short_arcs_foretell_an_hour_and_say_how_well(arc_min, sigma, median_arcsec) -> None:
    random = np.random.default_rng(7)
    flight = geostationary(random, 24, t0_utc_ns=T0, i_deg=3.0, e=np.full(24, 3e-4))
    end_s = arc_min * 60.0
    arc_s = np.arange(0.0, end_s + 1.0, 30.0)
    errors, inside = [], []
    for places in flight.places(np.append(arc_s, end_s + HOUR_S)):
        rows = {name: getattr(places, name) for name in type(places).__dataclass_fields__}
        arc = type(places)(**{name: row[:-1] for name, row in rows.items()})
        later = type(places)(**{name: row[-1:] for name, row in rows.items()})
        orbit = determine_orbit(seen_with_noise(random, flight.site, arc, sigma), prior="geo")
        assert orbit is not None
        assert orbit.label == "constrained by prior"
        ahead = predict(orbit, flight.site, later.t_utc_ns)
        ee, en, nn = ahead.cov_sky_arcsec2[0]
        off = off_arcsec(ahead.places, later)[0]
        errors.append(float(np.hypot(*off)))
        inside.append(off @ np.linalg.solve([[ee, en], [en, nn]], off) < THREE_SIGMA)
    assert np.median(errors) < median_arcsec
    assert np.mean(inside) > 0.95


def test_four_hours_need_no_prior_and_half_an_hour_needs_one() -> None:
    flight = one_geo()
    long = determine_orbit(seen_at(flight, np.arange(0.0, 4.0 * HOUR_S, 60.0)))
    short = determine_orbit(seen_at(flight, np.arange(0.0, 1801.0, 60.0)))
    assert long is not None
    assert short is not None
    assert (long.label, long.prior) == ("free", "none")
    assert long.sigma_a_km < FREE_SIGMA_A_KM
    assert (short.label, short.prior) == ("constrained by prior", "geo")
    error, squared = surprise(long, flight, 4.0 * HOUR_S + DAY_S)
    assert error < 300.0
    assert squared < THREE_SIGMA


@pytest.mark.parametrize("i_deg", [pytest.param(0.05, marks=ONE_MORE), 7.0])
def test_two_nights_of_ten_minutes_foretell_the_third_to_five_arcsec(i_deg: float) -> None:
    flight = one_geo(i_deg=i_deg)
    orbit = determine_orbit(seen_at(flight, np.concatenate([TEN_MINUTES_S, DAY_S + TEN_MINUTES_S])))
    assert orbit is not None
    error, squared = surprise(orbit, flight, 2.0 * DAY_S + 600.0)
    assert error < 5.0
    assert squared < THREE_SIGMA


def medium(seed: int) -> tuple[Flight, np.ndarray]:
    """A navigation satellite, and when it is high in a day and a half."""
    random = np.random.default_rng(seed)
    state = state_of(26_560.0, 0.004, np.radians(55.0), tuple(random.uniform(0.0, 6.28, 3)))
    return when_high(state, np.arange(0.0, 1.5 * DAY_S, 60.0))


def when_high(state, since_s: np.ndarray) -> tuple[Flight, np.ndarray]:
    """A satellite, and at which of the times it stands 15 degrees high or more."""
    flight = Flight(t0_utc_ns=T0, start=np.concatenate(state)[None])
    line = flight.states(since_s)[:, 0, :3] - site_gcrs(DAYTONA, flight.instants(since_s))[0]
    up = site_gcrs(DAYTONA, flight.instants(since_s))[0]
    height = np.sum(line * up, 1) / np.linalg.norm(line, axis=1) / np.linalg.norm(up, axis=1)
    return flight, since_s[height > np.sin(np.radians(15.0))]


@pytest.mark.nightly("many nights")
@pytest.mark.parametrize("seed", [3, pytest.param(4, marks=ONE_MORE)])
def test_the_turns_between_two_nights_of_a_navigation_satellite_are_counted(seed: int) -> None:
    flight, high_s = medium(seed)
    begun = high_s[0]
    again = high_s[high_s > begun + 0.9 * DAY_S][0]
    part_s = np.arange(0.0, 601.0, 30.0)
    orbit = determine_orbit(seen_at(flight, np.concatenate([begun + part_s, again + part_s])))
    assert orbit is not None
    true = osculating_elements(flight.start[0, :3], flight.start[0, 3:]).a_km
    assert osculating_elements(orbit.r_km, orbit.v_km_s).a_km == pytest.approx(true, abs=10.0)
    _, squared = surprise(orbit, flight, float(again) + 1800.0)
    assert squared < THREE_SIGMA


def test_two_passes_of_a_low_satellite_are_one_orbit() -> None:
    low = state_of(7_378.0, 0.008, np.radians(70.0), (2.0, 2.0, 3.0))
    flight, high_s = when_high(low, np.arange(0.0, 0.25 * DAY_S, 10.0))
    assert len(np.flatnonzero(np.diff(high_s) > 3000.0)) >= 1
    orbit = determine_orbit(seen_at(flight, high_s, 2.0))
    assert orbit is not None
    assert (orbit.label, orbit.prior) == ("free", "none")
    assert orbit.rms_arcsec < 3.0
    r, _ = orbit.states(np.array([T0 + int(high_s[-1]) * NS_PER_S]))
    hundred_metres_km = 0.1
    truth = flight.states(high_s[-1:])[0, 0, :3]
    assert np.linalg.norm(r[0] - truth) < hundred_metres_km


def test_refining_from_an_earlier_orbit_finds_what_a_search_finds() -> None:
    flight = one_geo()
    since_s = np.arange(0.0, 3.0 * HOUR_S, 60.0)
    earlier = determine_orbit(seen_at(flight, since_s[:150]))
    all_ = seen_at(flight, since_s)
    assert earlier is not None
    r, v = earlier.states(np.array([all_.epoch_utc_ns]))
    refined, searched = determine_orbit(all_, start=(r[0], v[0])), determine_orbit(all_)
    assert refined is not None
    assert searched is not None
    sigma = np.sqrt(np.diag(searched.covariance))
    assert np.all(np.abs(refined.r_km - searched.r_km) < 0.01 * sigma[:3])
    assert refined.label == searched.label


def test_a_start_that_leads_nowhere_does_no_harm() -> None:
    flight = one_geo()
    seen = seen_at(flight, np.arange(0.0, HOUR_S, 60.0))
    wrong = state_of(7_000.0, 0.01, 1.0, (1.0, 2.0, 3.0))
    from_wrong, searched = determine_orbit(seen, start=wrong), determine_orbit(seen)
    assert from_wrong is not None
    assert searched is not None
    np.testing.assert_allclose(from_wrong.r_km, searched.r_km, rtol=1e-4)


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(n, marks=ONE_MORE) for n in (2, 3))])
def test_one_wild_direction_in_ten_moves_the_orbit_by_no_sigma(seed: int) -> None:
    flight = one_geo()
    since_s = np.arange(0.0, 2.0 * HOUR_S, 60.0)
    clean = seen_at(flight, since_s)
    random = np.random.default_rng(seed)
    wild = random.random(len(clean)) < 0.1
    wild[[0, -1]] = True  # the worst place: seeds are made of them
    dec = clean.dec_icrs_deg + wild * random.uniform(-0.3, 0.3, len(clean))
    ra = clean.ra_icrs_deg + wild * random.uniform(-0.3, 0.3, len(clean))
    spoilt = reduce_directions(
        DAYTONA, clean.t_utc_ns, ra, dec, np.tile([1.0, 0.0, 1.0], (len(ra), 1))
    )
    with_them, without = determine_orbit(spoilt), determine_orbit(clean)
    assert with_them is not None
    assert without is not None
    assert abs(with_them.outliers - int(wild.sum())) <= 2
    off = np.concatenate([with_them.r_km - without.r_km, with_them.v_km_s - without.v_km_s])
    assert off @ np.linalg.solve(without.covariance, off) < 6.0  # of six unknowns, together


def test_directions_that_scatter_more_than_they_claim_widen_the_covariance() -> None:
    flight = one_geo()
    since_s = np.arange(0.0, HOUR_S, 30.0)
    places = flight.places(since_s)[0]
    claimed = np.tile([1.0, 0.0, 1.0], (len(since_s), 1))
    noisy = seen_with_noise(np.random.default_rng(3), DAYTONA, places, 3.0)
    seen = reduce_directions(
        DAYTONA, noisy.t_utc_ns, noisy.ra_icrs_deg, noisy.dec_icrs_deg, claimed
    )
    honest, boasting = determine_orbit(noisy, prior="geo"), determine_orbit(seen, prior="geo")
    assert honest is not None
    assert boasting is not None
    assert boasting.outliers == 0
    ratio = np.sqrt(np.trace(boasting.covariance[3:, 3:]) / np.trace(honest.covariance[3:, 3:]))
    assert 0.5 < ratio < 5.0


def test_a_held_satellite_is_as_predicted_for_a_day_by_what_the_catalogue_knows() -> None:
    held = one_geo(i_deg=0.05, a_km=42_165.9)
    orbit = determine_orbit(seen_at(held, TEN_MINUTES_S))
    assert orbit is not None
    assert (orbit.label, orbit.prior) == ("constrained by prior", "slot")
    error, squared = surprise(orbit, held, 600.0 + DAY_S)
    assert error < 300.0
    assert squared < THREE_SIGMA
    inclined = determine_orbit(seen_at(one_geo(i_deg=3.0, a_km=42_165.9), TEN_MINUTES_S))
    assert inclined is not None
    assert inclined.prior == "geo"


def test_a_days_error_is_bent_and_the_stated_ellipse_holds_it_all_the_same() -> None:
    """Orbits drawn from the covariance itself, moved exactly: a long error leaves its tangent."""
    flight = one_geo(i_deg=7.0)
    orbit = determine_orbit(seen_at(flight, np.arange(0.0, HOUR_S, 60.0)), prior="geo")
    assert orbit is not None
    orbit = replace(orbit, forces=TwoBodyPropagator())
    random = np.random.default_rng(1)
    drawn = random.multivariate_normal(np.zeros(6), orbit.covariance, 200, method="eigh")
    t = orbit.epoch_utc_ns + np.array([int(DAY_S * 1.1)]) * NS_PER_S
    ahead = predict(orbit, DAYTONA, t)
    ee, en, nn = ahead.cov_sky_arcsec2[0]
    squared = []
    for step in drawn:
        other = replace(orbit, r_km=orbit.r_km + step[:3], v_km_s=orbit.v_km_s + step[3:])
        off = off_arcsec(predict(other, DAYTONA, t).places, ahead.places)[0]
        squared.append(off @ np.linalg.solve([[ee, en], [en, nn]], off))
    assert np.mean(np.array(squared) < THREE_SIGMA) > 0.97
    assert np.mean(np.array(squared) < 2.3) > 0.5  # and is not much too wide: 0.68 of a normal one


def test_a_prior_that_the_directions_contradict_is_not_believed() -> None:
    eccentric = one_geo(e=0.05)
    seen = seen_at(eccentric, np.arange(0.0, 4.0 * HOUR_S, 60.0))
    forced, free = determine_orbit(seen, prior="geo"), determine_orbit(seen)
    assert forced is not None
    assert free is not None
    assert forced.label == "weak geometry"
    assert (free.label, free.prior) == ("free", "none")
    assert osculating_elements(free.r_km, free.v_km_s).e == pytest.approx(0.05, abs=2e-3)


def test_three_directions_are_checked_by_nothing() -> None:
    flight = one_geo()
    orbit = determine_orbit(seen_at(flight, np.array([0.0, 300.0, 600.0])))
    assert orbit is not None
    assert orbit.label in {"weak geometry", "not observable"}


@pytest.mark.parametrize("since_s", [[], [0.0], [0.0, 60.0], [5.0, 5.0, 5.0, 5.0]])
def test_too_little_to_tell_an_orbit_gives_none(since_s: list[float]) -> None:
    flight = one_geo()
    assert determine_orbit(seen_at(flight, np.array(since_s))) is None


def test_a_direction_that_is_no_number_is_refused() -> None:
    rows = np.array([10.0, np.nan])
    with pytest.raises(ValueError, match="not a number"):
        reduce_directions(
            DAYTONA, np.array([T0, T0 + NS_PER_S]), rows, rows, np.tile([1.0, 0, 1.0], (2, 1))
        )


@pytest.mark.slow("an orbit is fitted to each of the drawn arcs")
@settings(max_examples=10, deadline=None)
@given(
    begun_deg=st.tuples(st.floats(0.0, 359.99), st.floats(-89.0, 89.0)),
    rates=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)),
    bend=st.floats(-1e-5, 1e-5),
    gaps_s=st.lists(
        st.sampled_from([0.0, 0.5, 10.0, 30.0, 600.0, 40_000.0]), min_size=1, max_size=9
    ),
    sigma=st.sampled_from([0.3, 4.0, 60.0]),
)
def test_whatever_is_seen_gives_numbers_and_an_honest_label(
    begun_deg, rates, bend, gaps_s, sigma
) -> None:
    """Ways across the sky that no satellite need take: never an exception, never a boast."""
    since_s = np.concatenate([[0.0], np.cumsum(gaps_s)])
    ra = (begun_deg[0] + rates[0] * since_s + bend * since_s**2) % 360.0
    dec = np.clip(begun_deg[1] + rates[1] * since_s, -89.9, 89.9)
    t = T0 + (since_s * NS_PER_S).astype(np.int64)
    covariance = np.tile([sigma**2, 0.0, sigma**2], (len(t), 1))
    site = Site(latitude_deg=-33.0, longitude_deg=18.0, elevation_m=100.0)
    orbit = determine_orbit(reduce_directions(site, t, ra, dec, covariance))
    if orbit is None:
        return
    assert np.all(np.isfinite(np.concatenate([orbit.r_km, orbit.v_km_s])))
    assert np.all(np.isfinite(orbit.covariance))
    assert np.all(np.linalg.eigvalsh(orbit.covariance) > -1e-9 * np.trace(orbit.covariance))
    assert np.isfinite(orbit.rms_arcsec)
    assert np.isfinite(orbit.sigma_a_km)
    assert orbit.reason
    if orbit.label == "free":
        assert orbit.sigma_a_km <= FREE_SIGMA_A_KM
        assert orbit.prior == "none"
        assert orbit.fit.degrees_of_freedom > 0
    if orbit.label == "constrained by prior":
        assert orbit.prior != "none"


@pytest.mark.parametrize("arc_s", [120.0, 300.0, 1200.0])
@pytest.mark.parametrize("prior", ["auto", "none"])
def test_no_short_arc_is_called_free(arc_s: float, prior) -> None:
    for seed in range(2):
        flight = one_geo(seed, e=0.002 * seed)
        orbit = determine_orbit(
            seen_at(flight, np.arange(0.0, arc_s + 1.0, 30.0), 4.0), prior=prior
        )
        assert orbit is None or orbit.label != "free"
