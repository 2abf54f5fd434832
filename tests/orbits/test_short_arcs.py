"""Orbits of short arcs of low satellites: within what they state, and nearly always one.

Truth is another integration (`tests/truth/short_arcs.py`); the arcs go the way of others' files.
The program was tuned on other seeds.
"""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.library import ReadOptions, read_observations
from rsoconsole.orbits import MeasuredDirections, osculating_elements, predict
from rsoconsole.pipeline import FoundOrbit, find_orbit
from rsoconsole.pipeline.words.orbit_json import element_sigmas
from rsoconsole.records import Site
from rsoconsole.sky import direction_to_unit, iso_to_utc_ns
from rsoconsole.words import NS_PER_S
from tests.truth.orbit_cases import EARTH_KM
from tests.truth.short_arcs import ShortArc, short_arc

FIRST_SEED = 50_000
PREDICTED = ("1 min", "10 min")
LEIDEN = Site(latitude_deg=52.154, longitude_deg=4.491, elevation_m=0.0)
TWO_SECONDS = 2.0


@dataclass(frozen=True, kw_only=True)
class Judged:
    """How far an orbit is off, in units of its stated sigmas; None: there is no orbit."""

    off: dict[str, float] | None
    sigma_a_km: float = float("nan")
    took_s: float = 0.0


def found_in(text: str, path: Path, site: Site | None = None) -> FoundOrbit:
    path.write_text(text)
    groups = read_observations(path, ReadOptions(site=site))
    return find_orbit([each[0] for each in groups])


def judged(arc: ShortArc, path: Path) -> Judged:
    begun = time.process_time()
    found = found_in(arc.as_csv(), path)
    took_s = time.process_time() - begun
    if found.orbit is None:
        return Judged(off=None, took_s=took_s)
    orbit, last = found.orbit, int(arc.t_utc_ns[-1])
    t = np.array([orbit.epoch_utc_ns, last + 60 * NS_PER_S, last + 600 * NS_PER_S])
    state = arc.states(t)[0]
    true, own = (osculating_elements(*each) for each in (np.split(state, 2), found_state(found)))
    sigmas = element_sigmas(orbit)
    places, ahead = arc.places(t), predict(orbit, arc.site, t[1:])
    lines = (
        direction_to_unit(each.ra_icrs_deg, each.dec_icrs_deg) for each in (ahead.places, places)
    )
    seen, wanted = lines
    off_arcsec = 206_265.0 * np.linalg.norm(seen - wanted[1:], axis=-1)
    off = {
        "a": abs(own.a_km - true.a_km) / orbit.sigma_a_km,
        "e": abs(own.e - true.e) / (sigmas["e"] or 1.0),
        "i": abs(own.i_deg - true.i_deg) / (sigmas["i_deg"] or 180.0),
        **dict(zip(PREDICTED, (off_arcsec / ahead.sigma_arcsec).tolist(), strict=True)),
    }
    return Judged(off=off, sigma_a_km=orbit.sigma_a_km, took_s=took_s)


def found_state(found: FoundOrbit) -> tuple[np.ndarray, np.ndarray]:
    assert found.orbit is not None
    return found.orbit.r_km, found.orbit.v_km_s


def expect_honest(count: int, path: Path) -> None:
    """Of so many arcs 95 in 100 are within three stated sigmas, and 99 have an orbit."""
    results = [judged(short_arc(seed), path) for seed in range(FIRST_SEED, FIRST_SEED + count)]
    orbits = [each for each in results if each.off is not None]
    assert len(orbits) >= 0.99 * count
    for what in ("a", "e", "i", *PREDICTED):
        inside = np.mean([(each.off or {})[what] <= 3.0 for each in orbits])
        assert inside >= 0.95, (what, inside)
    # A prior of e 0.02 leaves the axis to some 1.6 %: stated, and not more than that.
    assert np.median([each.sigma_a_km for each in orbits]) < 130.0
    assert np.median([each.took_s for each in results]) < TWO_SECONDS


@pytest.mark.slow("30 orbits, each determined twice")
def test_short_arcs_have_an_orbit_within_what_it_states(tmp_path: Path) -> None:
    expect_honest(30, tmp_path / "arc.csv")


@pytest.mark.nightly("statistics over 500 arcs")
@pytest.mark.timeout(900)
def test_of_500_short_arcs_95_in_100_are_within_what_they_state(tmp_path: Path) -> None:
    expect_honest(500, tmp_path / "arc.csv")


def test_the_test_finds_orbits_that_claim_too_much(tmp_path: Path) -> None:
    """Declinations 3 % too small make an orbit that is off by more than it states."""
    arc = short_arc(FIRST_SEED + 7)
    honest = judged(arc, tmp_path / "arc.csv").off
    assert honest is not None
    assert max(honest.values()) < 3.0
    shifted = arc.as_csv().splitlines()
    head, rows = shifted[0], [each.split(",") for each in shifted[1:]]
    for row in rows:
        row[2] = f"{float(row[2]) * 0.97:.6f}"
    wrong = found_in("\n".join([head, *(",".join(row) for row in rows)]), tmp_path / "wrong.csv")
    if wrong.orbit is not None:
        true = osculating_elements(
            *np.split(arc.states(np.array([wrong.orbit.epoch_utc_ns]))[0], 2)
        )
        own = osculating_elements(*found_state(wrong))
        sigma = element_sigmas(wrong.orbit)["i_deg"] or 180.0
        assert abs(own.i_deg - true.i_deg) > 3.0 * sigma


NOSS = """\
23908 96 029C   4171 E 20200316192205771 17 25 1216033+260570 37 S
23908 96 029C   4171 E 20200316192214555 17 25 1215845+244475 37 S
23908 96 029C   4171 E 20200316192224550 17 25 1215643+231538 37 S
23908 96 029C   4171 E 20200316192234570 17 25 1215526+214895 37 S
23908 96 029C   4171 E 20200316192244562 17 25 1215429+202551 37 S
23908 96 029C   4171 E 20200316192254551 17 25 1215408+190446 37 S
23908 96 029C   4171 E 20200316192304558 17 25 1215386+174612 37 S
23908 96 029C   4171 E 20200316192314562 17 25 1215418+163036 37 S
23908 96 029C   4171 E 20200316192320016 17 25 1215460+154989 37 S
"""
"""A made arc of 74 s: an orbit of a 7,480 km with 6 arcsec of noise."""
ISS = """\
25544 98 067A   4353 F 20160720013132250 17 25 1918175+113996 56 S
25544 98 067A   4353 F 20160720013142250 17 25 1940023+141332 56 S
25544 98 067A   4353 F 20160720013232250 17 25 2228023+262214 56 S
25544 98 067A   4353 F 20160720013322250 17 25 0118728+244644 56 S
25544 98 067A   4353 F 20160720013332250 17 25 0140828+233084 56 S
25544 98 067A   4353 F 20160720013342250 17 25 0159500+221470 56 S
"""
"""The space station of July 2016 (15.55 revolutions a day, a 6,780 km), times good to 0.1 s."""


def test_a_minimum_underground_is_no_reason_for_no_orbit(tmp_path: Path) -> None:
    site = Site(latitude_deg=52.8, longitude_deg=6.4, elevation_m=10.0)
    found = found_in(NOSS, tmp_path / "noss.iod", site)
    orbit = found.orbit
    assert orbit is not None
    assert (orbit.label, orbit.prior) == ("constrained by prior", "leo")
    assert "leo" in found.reason
    a_km = osculating_elements(*found_state(found)).a_km
    assert abs(a_km - 7_480.0) < 3.0 * orbit.sigma_a_km
    assert orbit.sigma_a_km < 150.0
    read = read_observations(tmp_path / "noss.iod", ReadOptions(site=site))
    free = find_orbit([each[0] for each in read], prior="none")
    assert free.orbit is None
    asked = find_orbit([each[0] for each in read], prior="leo")
    assert asked.orbit is not None
    assert asked.orbit.prior == "leo"


def test_errors_of_time_are_in_the_sigma(tmp_path: Path) -> None:
    found = found_in(ISS, tmp_path / "iss.iod", LEIDEN)
    assert found.orbit is not None
    a_km = osculating_elements(*found_state(found)).a_km
    assert abs(a_km - 6_780.0) < 3.0 * found.orbit.sigma_a_km
    # 0.1 s at half a degree a second is 200 arcsec: six lines do not give the axis to 14 km.
    assert found.orbit.sigma_a_km > 25.0


def test_errors_of_time_are_along_the_orbits_own_motion() -> None:
    """A path that turns: by chords between far neighbours the error leaks across it."""
    arc = short_arc(FIRST_SEED + 11)
    seen = reduced(arc)
    rates = seen.rates_arcsec_s(*np.split(arc.states(arc.t_utc_ns), 2, axis=-1))
    told = seen.with_rates(rates)
    cov = np.linalg.inv(np.swapaxes(told.whitening, -1, -2) @ told.whitening)
    along = rates / np.linalg.norm(rates, axis=-1, keepdims=True)
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    across_sigma = np.sqrt(np.einsum("ni,nij,nj->n", across, cov, across))
    np.testing.assert_allclose(across_sigma, arc.sigma_arcsec, rtol=1e-6)
    along_sigma = np.sqrt(np.einsum("ni,nij,nj->n", along, cov, along))
    late = 0.1 * np.linalg.norm(rates, axis=-1)
    np.testing.assert_allclose(along_sigma, np.hypot(arc.sigma_arcsec, late), rtol=1e-6)


def reduced(arc: ShortArc) -> MeasuredDirections:
    from rsoconsole.orbits import reduce_directions

    covariance = np.tile([arc.sigma_arcsec**2, 0.0, arc.sigma_arcsec**2], (len(arc.t_utc_ns), 1))
    order = np.argsort(arc.t_utc_ns)
    late_s = np.full(len(order), 0.1)
    t, ra, dec = arc.t_utc_ns[order], arc.ra_deg[order], arc.dec_deg[order]
    return reduce_directions(arc.site, t, ra, dec, covariance, time_sigma_s=late_s)


@pytest.mark.parametrize("seed", [3000, 3004, 3007, 3015])
def test_two_passes_need_no_prior(seed: int, tmp_path: Path) -> None:
    """The second pass is found by the first one's constrained orbit, to whole revolutions."""
    arc = short_arc(seed)
    el = osculating_elements(*np.split(arc.start, 2))
    period_s = 2.0 * np.pi * np.sqrt(el.a_km**3 / 398_600.44)
    since_s = period_s + np.arange(-60.0, 61.0, 20.0)
    t = arc.start_utc_ns + np.rint(since_s * NS_PER_S).astype(np.int64)
    places = arc.places(t)
    rows = arc.as_csv().splitlines()
    place = rows[1].split(",", 3)[3]
    for n, at in enumerate(t):
        rows.append(f"{iso(at)},{places.ra_icrs_deg[n]:.6f},{places.dec_icrs_deg[n]:.6f},{place}")
    found = found_in("\n".join(rows), tmp_path / "two.csv")
    assert found.orbit is not None
    assert found.orbit.prior == "none"
    t0 = np.array([found.orbit.epoch_utc_ns])
    true = osculating_elements(*np.split(arc.states(t0)[0], 2))
    # J3, the equator's shape and radiation, which the truth lacks, are some 50 m.
    assert abs(osculating_elements(*found_state(found)).a_km - true.a_km) < 1.0


def iso(t_utc_ns: int) -> str:
    from rsoconsole.words import utc_ns_to_iso

    return utc_ns_to_iso(int(t_utc_ns), 6)


@pytest.mark.parametrize("seed", [1018, 1057])
def test_errors_stated_much_too_small_do_not_leave_it_without_orbit(
    seed: int, tmp_path: Path
) -> None:
    """Times off by 0.1 s of which the file says nothing: 1018 has no orbit within 12 arcsec."""
    arc = short_arc(seed)
    found = found_in(arc.as_csv().replace(",0.1,", ",0.0,"), tmp_path / "arc.csv")
    assert found.orbit is not None
    true = osculating_elements(*np.split(arc.states(np.array([found.orbit.epoch_utc_ns]))[0], 2))
    off_km = abs(osculating_elements(*found_state(found)).a_km - true.a_km)
    assert off_km < 3.0 * found.orbit.sigma_a_km
    if seed == 1018:
        assert "times as wide as stated" in found.reason


@pytest.mark.parametrize("count", [3, 4])
def test_three_or_four_lines_are_weak_or_constrained_but_not_none(
    count: int, tmp_path: Path
) -> None:
    arc = short_arc(FIRST_SEED + 3)
    head, *rows = arc.as_csv().splitlines()
    few = [rows[n] for n in np.unique(np.linspace(0, len(rows) - 1, count).astype(int))]
    found = found_in("\n".join([head, *few]), tmp_path / "few.csv")
    assert found.orbit is not None
    assert found.orbit.label in {"weak geometry", "constrained by prior"}


def test_low_orbits_feel_the_bulge_within_minutes(tmp_path: Path) -> None:
    """Good directions over three minutes do not scatter, as they would about a point mass."""
    arc = max((short_arc(seed) for seed in range(8)), key=lambda each: each.span_s)
    t = arc.t_utc_ns[0] + np.arange(0, 180, 10) * NS_PER_S
    places = arc.places(t)
    place = arc.as_csv().splitlines()[1].split(",", 5)[5]
    rows = [
        f"{iso(at)},{ra:.8f},{dec:.8f},1.0,{place}"
        for at, ra, dec in zip(t, places.ra_icrs_deg, places.dec_icrs_deg, strict=True)
    ]
    head = "time,ra_deg,dec_deg,sigma_arcsec,lat_deg,lon_deg,alt_m"
    found = found_in("\n".join([head, *rows]), tmp_path / "good.csv")
    assert found.orbit is not None
    assert found.orbit.rms_arcsec < 0.2
    assert EARTH_KM + 200.0 < osculating_elements(*found_state(found)).a_km < EARTH_KM + 1_700.0


def test_the_stated_instants_are_of_the_arc() -> None:
    arc = short_arc(FIRST_SEED)
    assert 29.0 < arc.span_s < 181.0
    assert arc.t_utc_ns[0] > iso_to_utc_ns("2026-01-01T00:00:00Z")
