"""What a filter's innovations say of its Q and R, on innovations of known making."""

from dataclasses import replace

import numpy as np
import pytest

from rsoconsole.night import FrameRow, since_last_change
from rsoconsole.tracking import consistency, mean_nis_band
from rsoconsole.tracking.filters.innovations import ENOUGH, MIN_UPDATES, SETTLING


def innovations(scale: float, count: int, seed: int, correlation: float = 0.0):
    """(NIS, residuals) of a filter that believes in 1 arcsec where the truth is ``scale``."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(0.0, scale, (count, 2))
    for n in range(1, count):
        noise[n] = correlation * noise[n - 1] + np.sqrt(1 - correlation**2) * noise[n]
    return [float(each @ each) for each in noise], [(float(e), float(n)) for e, n in noise]


def test_the_band_is_that_of_the_tables():
    """Chi-square with 50 degrees of freedom: 32.36 and 71.42 (Bar-Shalom et al. 2001, table)."""
    low, high = mean_nis_band(25)
    assert low * 25 == pytest.approx(32.36, abs=0.01)
    assert high * 25 == pytest.approx(71.42, abs=0.01)


def test_a_sound_filter_is_blamed_as_seldom_as_the_band_says():
    verdicts = [consistency(*innovations(1.0, 80, seed)).verdict for seed in range(4000)]
    assert 0.997 < verdicts.count("sound") / len(verdicts) < 1.0


def test_a_filter_that_is_too_wide_is_blamed_after_enough_evidence_alone():
    def verdicts(count):
        return [consistency(*innovations(0.6, count, seed)).verdict for seed in range(200)]

    assert set(verdicts(SETTLING + ENOUGH - 1)) == {"sound"}
    assert verdicts(SETTLING + 60).count("under-confident") > 190
    # What the filter was at first does not count.
    wide, _ = innovations(0.3, SETTLING, 1)
    sound, _ = innovations(1.0, ENOUGH, 2)
    assert consistency([*wide, *sound]).verdict == "sound"


@pytest.mark.parametrize(
    ("scale", "correlation", "verdict", "name"),
    [
        (2.5, 0.0, "over-confident", "R looks too small"),
        (2.5, 0.95, "over-confident", "Q looks too small"),
        (0.3, 0.0, "under-confident", "R looks too large"),
    ],
)
def test_what_is_wrong_is_named(scale, correlation, verdict, name):
    found = [consistency(*innovations(scale, 60, seed, correlation)) for seed in range(200)]
    named = [each for each in found if each.verdict == verdict and each.words.startswith(name)]
    assert len(named) / len(found) > 0.8


def test_the_words_count_what_lies_above_the_band():
    nis = [1.0, 9.0, 8.0, 12.0, 0.5, 9.5, 11.0, 2.0, 8.2, 10.0, 9.1, 7.5]
    assert consistency(nis).words == "R looks too small: 9 of the last 12 NIS above 7.4"


def test_a_few_updates_say_nothing():
    judged = consistency([30.0] * (MIN_UPDATES - 1))
    assert judged.verdict == "too few"
    assert judged.mean == 30.0
    assert consistency([]).mean is None


@pytest.mark.parametrize("count", [1, 2, 5, 12, 60, 333, 5000])
def test_the_band_of_a_mean_is_that_of_the_chi_square_law(count):
    from scipy.stats import chi2

    expected = chi2.ppf([0.025, 0.975], 2 * count) / count
    assert mean_nis_band(count) == pytest.approx(tuple(expected), rel=1e-10)


def test_what_came_before_the_last_change_of_a_setting_does_not_count():
    def row(frame_id, **settings):
        return FrameRow(frame_id=frame_id, settings=settings)

    rows = [row(1), row(2, **{"filter.r_multiplier": 4.0}), row(3, **{"filter.r_multiplier": 1.0})]
    rows += [replace(rows[-1], frame_id=4), row(5, **rows[-1].settings, **{"detector.tau": 0.3})]
    assert [each.frame_id for each in since_last_change(rows)] == [3, 4, 5]
    assert since_last_change([]) == []
