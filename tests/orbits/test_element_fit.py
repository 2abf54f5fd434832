"""Factors on the assumed errors of elements: found from rows whose truth is known."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from rsoconsole.config import CatalogueConfig
from rsoconsole.orbits import (
    ASSUMED,
    ERROR_REGIMES,
    ElementErrorRow,
    ElementErrors,
    ErrorFactors,
    FittedFactors,
    fit_factors,
    position_sigmas_km,
)
from rsoconsole.orbits.identification.element_errors import (
    MANOEUVRED,
    UNDISTURBED,
    ErrorSpread,
    regime_numbers,
)
from rsoconsole.orbits.identification.element_fit import row_weights
from rsoconsole.orbits.identification.field_crossings import element_spread
from rsoconsole.pipeline import wide_element_errors
from rsoconsole.records import FloatArray
from rsoconsole.words import NS_PER_DAY
from tests.makers import identify
from tests.truth.element_rows_of_truth import HISTORY, geo_pairs, low_rows, row_by, seen_of, times
from tests.truth.fields_of_truth import SITE

NAMES = ("along_at_epoch", "along_by_age", "across")
LOW, LOW_MOVED = UNDISTURBED["LEO"], MANOEUVRED["LEO"]


def values_of(factors: ErrorFactors) -> FloatArray:
    return np.array([getattr(factors, name) for name in NAMES])


def fitted(rows: Sequence[ElementErrorRow]) -> FittedFactors:
    (only,) = fit_factors(rows)
    return only


def row(
    norad_id: int, along_km: float, *, night: int = 0, age_days: float = 2.0, minute: int = 0
) -> ElementErrorRow:
    t = night * NS_PER_DAY + minute * 60_000_000_000
    return ElementErrorRow(
        session=f"night {night}",
        track=f"{norad_id} {minute}",
        norad_id=norad_id,
        name="",
        t_utc_ns=t,
        tle_epoch_utc_ns=t - round(age_days * NS_PER_DAY) - minute,
        age_days=age_days,
        regime="LEO",
        along_s=along_km / 7.5,
        sigma_along_s=0.01,
        along_km=along_km,
        sigma_along_km=0.05,
        across_arcsec=0.0,
        sigma_across_arcsec=1.0,
        across_km=0.1,
        sigma_across_km=0.01,
        along_by=(0.0, 1.0, 0.0),
        across_by=(0.3, 0.0, 0.9),
        observations=6,
        probability=1.0,
    )


def low(
    count: int, seed: int, spread: ErrorSpread = LOW, moved: ErrorSpread = LOW_MOVED
) -> list[ElementErrorRow]:
    return list(low_rows(count, np.random.default_rng(seed), spread, moved))


@pytest.mark.parametrize(
    "worlds", [8, pytest.param(18, marks=pytest.mark.nightly("statistics over many worlds"))]
)
def test_known_factors_are_found_within_their_stated_errors(worlds: int) -> None:
    """40 low objects in each, three in ten of them steered."""
    off = []
    for seed in range(worlds):
        truth = np.exp(np.random.default_rng(1000 + seed).normal(0.0, 0.5, 3))
        found = fitted(low(40, seed, times(LOW, *truth)))
        assert found.objects == 40
        sigmas = values_of(found.sigmas) / values_of(found.factors)
        off.append(np.log(values_of(found.factors) / truth) / sigmas)
    is_within = np.abs(off) < 2.0
    assert is_within.mean() >= 0.9, off
    assert np.mean(np.abs(off) < 1.0) > 0.5
    # Their errors are not so wide that all this would say nothing.
    assert values_of(found.sigmas)[1:].max() < 0.35


def test_few_rows_change_little() -> None:
    (only,) = low(1, 3)
    found = fitted([replace(only, along_km=0.0, across_km=0.0)])
    assert np.all(values_of(found.factors) > 0.6)
    assert np.all(values_of(found.sigmas) / values_of(found.factors) > 0.4)
    ordinary = values_of(fitted(low(3, 3)).factors)
    assert np.all(np.abs(np.log(ordinary)) < 0.5)
    assert fit_factors([]) == ()


def test_one_absurd_row_changes_little() -> None:
    rows = low(40, 5)
    before = values_of(fitted(rows).factors)
    for along_km, across_km in ((50_000.0, 9_000.0), (400.0, 0.3), (0.5, 80.0)):
        wrong = replace(rows[7], along_km=along_km, across_km=across_km, norad_id=99_999)
        after = values_of(fitted([*rows, wrong]).factors)
        assert np.all(np.abs(np.log(after / before)) < 0.15), (along_km, across_km)


def test_many_rows_of_one_object_do_not_pretend_to_be_many_objects() -> None:
    one_night = [row(7, 9.0, minute=n) for n in range(60)]
    assert row_weights(one_night).sum() == pytest.approx(1.0)
    alone, many = fitted(one_night[:1]), fitted(one_night)
    assert values_of(many.factors) == pytest.approx(values_of(alone.factors), rel=0.02)
    by_one_set = [
        replace(row(7, 9.0, night=n), tle_epoch_utc_ns=-NS_PER_DAY, session=f"{n}")
        for n in range(10)
    ]
    assert row_weights(by_one_set).sum() == pytest.approx(1.0)
    nights = [row(7, 9.0, night=n) for n in range(100)]
    assert 3.0 < row_weights(nights).sum() < 3.34
    others = [row(100 + n, 9.0, night=n) for n in range(10)]
    assert row_weights(others).sum() == pytest.approx(10.0)
    assert row_weights([*others, *nights])[:10] == pytest.approx(np.ones(10))


@pytest.mark.parametrize(("truth", "is_wider"), [(3.0, True), (0.35, False)])
def test_gates_hold_the_truth_once_calibrated_and_are_no_wider_than_they_need(
    truth: float, is_wider: bool
) -> None:
    """Three sigma of undisturbed objects that took no part in the calibration."""
    spread = times(LOW, truth, truth, truth)
    found = fitted(low(80, 21, spread))
    measured = ASSUMED.scaled({"LEO": found.factors})
    others = low(150, 22, spread, moved=spread)

    def held(errors: ElementErrors) -> float:
        return float(np.mean([_is_held(each, errors.undisturbed["LEO"]) for each in others]))

    widths = [position_sigmas_km(e.undisturbed["LEO"], 2.0)[1] for e in (ASSUMED, measured)]
    assert held(measured) >= 0.98
    if is_wider:
        assert held(ASSUMED) < 0.85
    else:
        assert widths[1] < 0.55 * widths[0]


def _is_held(each: ElementErrorRow, spread: ErrorSpread) -> bool:
    variances = np.array([float(s) ** 2 for s in position_sigmas_km(spread, each.age_days)])
    along = np.array(each.along_by) ** 2 @ variances + each.sigma_along_km**2
    across = np.array(each.across_by) ** 2 @ variances + each.sigma_across_km**2
    return bool(each.along_km**2 <= 9.0 * along and each.across_km**2 <= 9.0 * across)


@pytest.mark.shared_data
def test_real_elements_of_steered_satellites_widen_what_is_assumed_of_undisturbed_ones() -> None:
    """Six years of three satellites: the first half calibrates, the second judges."""
    assert HISTORY.exists()
    rng = np.random.default_rng(1)
    errors = wide_element_errors(CatalogueConfig())
    rows = []
    for n, (older, newer) in enumerate(geo_pairs()):
        each = row_by(f"night {n}", seen_of(newer, newer.epoch_utc_ns, rng), [older], errors)
        rows += [] if each is None else [each]
    middle = sorted(each.t_utc_ns for each in rows)[len(rows) // 2]
    found = fitted([each for each in rows if each.t_utc_ns < middle])
    after = [each for each in rows if each.t_utc_ns >= middle]
    assert found.objects == 3
    assert found.counted < 10.0
    held = [
        np.mean(
            [
                abs(each.along_km) < 3.0 * float(position_sigmas_km(spread, each.age_days)[1])
                for each in after
            ]
        )
        for spread in (
            UNDISTURBED["GEO"],
            ASSUMED.scaled({"GEO": found.factors}).undisturbed["GEO"],
        )
    ]
    assert held[0] < 0.2
    assert held[1] > 0.95


def test_a_manoeuvre_takes_no_error_away() -> None:
    many = ErrorFactors(along_at_epoch=20.0, along_by_age=20.0, across=20.0)
    few = ErrorFactors(along_at_epoch=0.1, along_by_age=0.1, across=0.1)
    for factors in (many, few):
        errors = ASSUMED.scaled(dict.fromkeys(ERROR_REGIMES, factors))
        for regime in ERROR_REGIMES:
            kept, moved = (errors.spread_for(regime, is_moved=each) for each in (False, True))
            for part in ("along", "across", "shape"):
                assert np.all(np.array(getattr(moved, part)) >= getattr(kept, part))
        assert errors.manoeuvred["GEO"].along[2] == MANOEUVRED["GEO"].along[2]
    assert ASSUMED.scaled({}) is ASSUMED


def test_what_was_measured_reaches_names_and_gates() -> None:
    rng = np.random.default_rng(4)
    measured = ASSUMED.scaled(
        dict.fromkeys(ERROR_REGIMES, ErrorFactors(along_at_epoch=9.0, along_by_age=9.0, across=9.0))
    )
    older, newer = next(geo_pairs())
    seen = seen_of(newer, newer.epoch_utc_ns, rng)
    (assumed,), (wide,) = (
        identify(seen, SITE, [older], errors=each).matches for each in (ASSUMED, measured)
    )
    assert wide.sigma_along_arcsec > 5.0 * assumed.sigma_along_arcsec
    assert wide.undisturbed_sigma < assumed.undisturbed_sigma
    numbers = regime_numbers(np.array([1.0]), np.array([0.0]))
    gates = [
        element_spread(numbers, np.array([0.1]), np.array([3.07]), each).gate_along_km[0]
        for each in (ASSUMED, measured)
    ]
    assert gates[1] > 2.0 * gates[0]
