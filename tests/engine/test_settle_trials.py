"""How long a mount is given to settle: mounts swing as the test says, stars are as wide."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from rsoconsole.engine.leaps._leap_times import LONGEST, SHORTEST_S, SettleTrials

WIDTH_PX, EXPOSURE_S = 2.6, 0.2
Smear = Callable[[float], float]
"""By how much stars are smeared so long after an arrival, px."""


def swinging(arcsec: float, tau_s: float) -> Smear:
    """A damped swing: what is left at the shutter's opening less what is left as it closes."""

    def smear(since_s: float) -> float:
        over = math.exp(-since_s / tau_s) - math.exp(-(since_s + EXPOSURE_S) / tau_s)
        return arcsec * over / 1.26

    return smear


def still(_since_s: float) -> float:
    return 0.0


def after(trials: SettleTrials, smear: Smear, noise: float, leaps: int, seed: int) -> list[float]:
    """What each leap was given; seeing changes slowly, wind from frame to frame."""
    random, given = np.random.default_rng(seed), []
    for leap in range(leaps):
        given.append(trials.next_settle_s)
        trials.begin_next_leap()
        seeing = WIDTH_PX * (1.0 + 0.3 * math.sin(leap / 40.0))
        trials.add_star_width(
            math.hypot(seeing, smear(given[-1])) * math.exp(random.normal(0.0, noise))
        )
    return given


def wider(smear: Smear, seconds: float) -> float:
    return math.hypot(WIDTH_PX, smear(seconds)) / WIDTH_PX


@pytest.mark.parametrize("noise", [0.03, 0.1])
@pytest.mark.parametrize(
    "smear",
    [swinging(20.0, 0.35), swinging(60.0, 0.5), swinging(20.0, 1.0)],
    ids=["as the demo's", "far", "slow"],
)
def test_time_that_costs_no_sharpness_is_saved(smear, noise):
    kept = []
    for seed in range(30):
        trials = SettleTrials(2.0)
        after(trials, smear, noise, 200, seed)
        kept.append(trials.settle_in_use_s)
    assert np.median(kept) < 1.7
    assert np.percentile([wider(smear, each) for each in kept], 90) < 1.25


def test_a_mount_that_stands_still_is_given_the_least():
    trials = SettleTrials(2.0)
    given = after(trials, still, 0.03, 200, 1)
    assert trials.settle_in_use_s == SHORTEST_S
    assert min(given) == SHORTEST_S


def test_one_that_swings_longer_than_configured_is_given_more():
    smear, kept = swinging(60.0, 0.8), []
    for seed in range(20):
        trials = SettleTrials(1.0)
        after(trials, smear, 0.03, 200, seed)
        kept.append(trials.settle_in_use_s)
    assert np.median(kept) > 1.5
    assert np.median([wider(smear, each) for each in kept]) < 1.3 < wider(smear, 1.0)


@pytest.mark.parametrize("seed", range(10))
def test_in_any_wind_it_stays_between_its_bounds(seed):
    trials = SettleTrials(2.0)
    given = after(trials, swinging(20.0, 0.35), 0.6, 400, seed)
    assert SHORTEST_S <= min(given) <= max(given) <= LONGEST * 2.0


def test_a_leap_has_what_it_was_planned_with():
    """The next one is planned while the last is examined: news of it wait for the one after."""
    trials = SettleTrials(2.0)
    for _ in range(200):
        planned_s = trials.next_settle_s
        trials.add_star_width(WIDTH_PX)
        assert trials.next_settle_s == planned_s
        trials.begin_next_leap()


def test_where_no_star_can_be_measured_it_has_what_is_configured():
    trials = SettleTrials(2.0)
    for width in (None, math.nan, 0.0) * 40:
        trials.begin_next_leap()
        assert trials.add_star_width(width) is None
    assert trials.settle_in_use_s == 2.0


def test_a_trial_that_leaves_no_stars_is_refused_like_one_that_smears_them():
    trials, given = SettleTrials(2.0), []
    for _ in range(400):
        given.append(trials.next_settle_s)
        trials.begin_next_leap()
        trials.add_star_width(None if given[-1] < 1.5 else WIDTH_PX)
    assert trials.settle_in_use_s == pytest.approx(1.6)
    assert sum(each < 1.5 for each in given[100:]) < 60  # one now and then


def test_time_is_given_back_where_the_stars_have_gone():
    trials = SettleTrials(2.0)
    after(trials, still, 0.03, 200, 1)
    assert trials.settle_in_use_s == SHORTEST_S
    for _ in range(400):
        seconds = trials.next_settle_s
        trials.begin_next_leap()
        trials.add_star_width(WIDTH_PX if seconds >= 1.9 else None)
    assert trials.settle_in_use_s > 1.5


def test_a_frame_that_is_of_no_leap_counts_for_none():
    trials = SettleTrials(2.0)
    for _ in range(100):
        trials.begin_next_leap()
        trials.forget_leap()
        assert trials.add_star_width(WIDTH_PX) is None
    assert trials.settle_in_use_s == 2.0


def test_what_is_configured_as_nothing_stays_nothing():
    trials = SettleTrials(0.0)
    assert set(after(trials, still, 0.03, 50, 1)) == {0.0}


def test_what_is_kept_is_said_once():
    trials, said = SettleTrials(2.0), []
    for _ in range(8):
        trials.begin_next_leap()
        said.append(trials.add_star_width(WIDTH_PX))
    assert [each for each in said if each] == [
        "the mount is given 1.6 s to settle: stars are as sharp as after 2.0 s (2.6 px, 2.6 px)"
    ]
