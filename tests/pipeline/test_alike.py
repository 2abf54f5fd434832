"""A night replayed on another processor is the same night; with other settings it is not."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rsoconsole.pipeline import replay
from rsoconsole.pipeline.replays.record_equality import are_nearly_equal, is_nearly_equal
from rsoconsole.records import Cause, Miss, Missed, Mixture, StateChange, TrackState
from rsoconsole.session import SessionReader
from tests.nights.samples import SAMPLE


@pytest.fixture(scope="module")
def records() -> list[Any]:
    return [record for _, _, record in SessionReader(SAMPLE).records()]


@pytest.fixture(scope="module")
def track(records: list[Any]) -> TrackState:
    return [r for r in records if isinstance(r, TrackState) and r.kind == "updated"][-1]


def rounded(track: TrackState, relative: float, seed: int = 1) -> TrackState:
    """The same track with every number off by up to so much of what it is made of."""
    random = np.random.default_rng(seed)
    sigma = np.sqrt(np.diag(np.array(track.P)))
    noise = random.uniform(-relative, relative, (4, 4))
    covariance = np.array(track.P) + (noise + noise.T) / 2.0 * np.outer(sigma, sigma)
    x = np.array(track.x) + random.uniform(-relative, relative, 4) * sigma
    return replace(
        track,
        x=tuple(x.tolist()),
        P=tuple(map(tuple, covariance.tolist())),
        nis=track.nis * (1.0 + relative),
    )


def test_the_last_digits_make_no_other_track(track: TrackState) -> None:
    assert is_nearly_equal(track, track)
    for seed in range(20):
        assert is_nearly_equal(track, rounded(track, 1e-10, seed))


def test_an_acceleration_near_nothing_is_judged_by_its_sigma() -> None:
    """On two processors that of a young track of the sample night differs by 1.2e-7 of itself."""
    mixture = Mixture(
        motion_probabilities=(("steady", 1.0),),
        acceleration_arcsec_s2=4e-7,
        acceleration_sigma_arcsec_s2=0.1,
        turn=0.0,
        turn_sigma=0.1,
        scatter_s=0.01,
        scatter_low_s=0.005,
        scatter_high_s=0.02,
    )
    for more, is_same in ((1e-9, True), (1e-7, False)):
        other = replace(mixture, acceleration_arcsec_s2=4e-7 + more)
        assert is_nearly_equal(mixture, other) is is_same


def test_what_a_person_could_see_makes_one(track: TrackState) -> None:
    assert not is_nearly_equal(track, rounded(track, 1e-3))
    assert not is_nearly_equal(track, replace(track, frame_id=track.frame_id + 1))
    assert not is_nearly_equal(track, replace(track, nis=None))
    x = (track.x[0] + 1e-8, *track.x[1:])
    assert not is_nearly_equal(track, replace(track, x=x))
    covariance = (track.P[0], track.P[1], track.P[2], (*track.P[3][:3], track.P[3][3] * 1.001))
    assert not is_nearly_equal(track, replace(track, P=covariance))


def test_records_that_say_something_else_are_not_alike() -> None:
    missed = Missed(kind="no time")
    miss = Miss(frame_id=3, reason=missed)
    change = StateChange(
        frame_id=3, before="TRACK", after="COAST", reason=Cause(kind="missed", missed=missed)
    )
    assert are_nearly_equal((miss, change), (miss, change))
    assert not are_nearly_equal((miss, change), (change, miss))
    assert not are_nearly_equal((miss,), (miss, change))
    assert not is_nearly_equal(miss, replace(miss, reason=Missed(kind="no detection")))


def test_a_small_change_of_a_setting_is_no_rounding(records: list[Any]) -> None:
    config = SessionReader(SAMPLE).config()
    q = config.filter.q_multiplier * 1.0001
    changes = list(replay(records, config, changes={"filter.q_multiplier": q}))
    assert not all(frame.is_alike for frame in changes)
    assert all(frame.is_alike for frame in replay(records, config))
