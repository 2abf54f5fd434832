"""The quick median is numpy's own, to the last bit, and the quick percentile to rounding."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from rsoconsole.vision.frame.median import median_of, quantiles_of

NUMBERS = st.floats(allow_nan=True, allow_infinity=True, width=32)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@given(values=arrays.arrays(np.float32, st.integers(1, 40), elements=NUMBERS))
def test_it_is_the_median_of_numpy(kind, values):
    given_values = values.astype(kind)
    before = given_values.copy()
    with np.errstate(all="ignore"):
        expected = float(np.median(given_values))
        found = median_of(given_values)
    assert found == expected or (math.isnan(found) and math.isnan(expected))
    assert np.array_equal(given_values, before, equal_nan=True), "what was given stays in order"


@pytest.mark.parametrize("count", [4000, 4001])
def test_that_of_many_values_too(count):
    values = np.random.default_rng(count).normal(size=count).astype(np.float32)
    assert median_of(values) == float(np.median(values))
    values[17] = np.nan
    assert math.isnan(median_of(values))


@given(values=arrays.arrays(np.float64, st.integers(1, 40), elements=st.floats(-1e6, 1e6)))
def test_quantiles_are_those_of_numpy(values):
    expected = np.quantile(values, [0.25, 0.5, 0.84])
    assert quantiles_of(values, (0.25, 0.5, 0.84)) == pytest.approx(expected, abs=1e-9)


def test_whole_numbers_and_rows_are_taken_too():
    assert median_of(np.array([[1, 2], [3, 5]], np.uint16)) == 2.5
    assert median_of([3.0, 1.0, 2.0]) == 2.0
    assert math.isnan(median_of(np.array([])))
