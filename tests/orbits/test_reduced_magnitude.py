"""Magnitudes reduced by a Lambert sphere: cases worked out by hand, and what must hold of any."""

import math

import numpy as np
import pytest

from rsoconsole.orbits import (
    apparent_magnitude,
    magnitude_at_range,
    reduced_magnitude,
    standard_magnitude,
)
from rsoconsole.orbits.brightness import lambert_phase_function

CASES = [
    (12.400, 36738.37, 30.0, 5.680, 12.356),
    (12.400, 36738.37, 90.0, 4.574, 12.356),
    (14.000, 40000.0, 110.0, 5.284, 13.771),
    (5.600, 1500.0, 60.0, 5.424, None),
]
"""Magnitude, range, phase; at 1000 km and 90 deg, and at 36,000 km and the same phase."""


@pytest.mark.parametrize(("mag", "range_km", "phase_deg", "reduced", "geo"), CASES)
def test_the_cases_agree_to_a_thousandth(mag, range_km, phase_deg, reduced, geo):
    assert reduced_magnitude(mag, range_km, phase_deg) == pytest.approx(reduced, abs=1e-3)
    if geo is not None:
        assert magnitude_at_range(mag, range_km) == pytest.approx(geo, abs=1e-3)


def test_at_the_reference_nothing_changes():
    assert reduced_magnitude(7.25, 1000.0, 90.0) == pytest.approx(7.25)
    assert magnitude_at_range(7.25, 36_000.0) == pytest.approx(7.25)


def test_the_sphere_is_brightest_full_and_dark_from_behind():
    light = [lambert_phase_function(phase) for phase in range(0, 181, 5)]
    assert light[0] == pytest.approx(math.pi)
    assert light[18] == pytest.approx(1.0)
    assert light == sorted(light, reverse=True)
    assert light[-1] == 0.0
    assert reduced_magnitude(10.0, 1000.0, 180.0) is None
    assert reduced_magnitude(10.0, 1000.0, 179.0) is not None


@pytest.mark.parametrize(("mag", "range_km", "phase_deg", "reduced", "_"), CASES)
def test_an_apparent_magnitude_is_back_from_the_reduced_one(mag, range_km, phase_deg, reduced, _):
    assert apparent_magnitude(reduced, range_km, phase_deg) == pytest.approx(mag, abs=1e-3)
    assert apparent_magnitude(reduced, range_km, 180.0) is None


def test_a_standard_magnitude_is_a_median_whose_sigma_is_no_chance():
    assert standard_magnitude([], []) is None
    agreeing = standard_magnitude([5.0, 5.001], [0.1, 0.1])
    assert agreeing is not None
    assert agreeing.sigma_mag == 0.1
    drawn = np.random.default_rng(3).normal(7.0, 0.4, 2000)
    drawn[:200] = 2.0
    found = standard_magnitude(list(drawn), [0.05] * len(drawn))
    assert found is not None
    assert found.mag == pytest.approx(7.0, abs=0.1)
    assert found.sigma_mag == pytest.approx(0.4, rel=0.25)
