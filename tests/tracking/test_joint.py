"""Several tracks share the streaks of a frame: each takes its own.

Truth is SGP4's with members put beside it here; shutter scatter is one number for a frame, as in a
camera. The judge counts by name.
"""

import math
from collections import Counter

import numpy as np
import pytest

from rsoconsole.records import NotTaken
from rsoconsole.tracking import Following, LiveTrack, follow
from rsoconsole.tracking._gates import track_updates
from rsoconsole.tracking.filters import estimator
from rsoconsole.tracking.initiation.acquisition import track_from_pair
from rsoconsole.tracking.joint import TrackCandidates, assign_measurements
from tests.tiers import plain_first
from tests.tracking.test_rivals import FRAMES, NEAR_ARCSEC, every_day, seen, streak, truth

MISSED = 0.1


def members(spacing_arcsec: float, angle_deg: float) -> dict[str, np.ndarray]:
    """Four in a row."""
    angle = math.radians(angle_deg)
    step = spacing_arcsec * np.array([math.sin(angle), math.cos(angle)])
    return {name: k * step for k, name in enumerate("abcd")}


def night(
    spacing_arcsec: float, angle_deg: float, scatter_s: float, seed: int, swapped_at: int = -1
) -> Counter[str]:
    """Of all track-frames after lock: how many took their own, another's, none of those shown."""
    random = np.random.default_rng(seed)
    places = members(spacing_arcsec, angle_deg)
    frames = []
    for k in range(FRAMES):
        late_s = random.normal(0.0, scatter_s)
        frames.append(
            {
                name: streak(k, name, random, at, truth()[k].rate, late_s)
                for name, at in places.items()
            }
        )
    settings, tracks = every_day(), []
    for number, name in enumerate(places, start=1):
        pair = frames[0][name], frames[1][name]
        track = track_from_pair(*pair, number, seen(1, *pair), settings)
        tracks.append(LiveTrack(track=track, taken=pair[1]))
    following = Following(state="TRACK", tracks=tuple(tracks), last_track_id=len(tracks))
    found: Counter[str] = Counter()
    for k in range(2, FRAMES):
        shown = {n: m for n, m in frames[k].items() if random.uniform() > MISSED}
        if k == swapped_at:
            names = list(shown)
            shown = dict(zip(names, [shown[n] for n in reversed(names)], strict=True))
        following, _ = follow(following, seen(k, *shown.values()), settings)
        for each, name in zip(following.tracks, places, strict=True):
            if name not in shown:
                continue
            taken = each.taken if each.taken and each.taken.frame_id == k else None
            own = taken is not None and taken == shown[name]
            found["own" if own else "none" if taken is None else "swapped"] += 1
    return found


@pytest.mark.parametrize(
    "nights", [1, pytest.param(3, marks=pytest.mark.nightly("statistics over many nights"))]
)
@pytest.mark.parametrize("angle_deg", [0.0, 90.0])
@pytest.mark.parametrize("scatter_s", plain_first(1, [0.2, 0.015, 1.0]))
def test_four_of_a_slot_keep_their_streaks(scatter_s, angle_deg, nights):
    """Across and along the motion; a late shutter shifts all of them along it."""
    found: Counter[str] = Counter()
    for seed in range(nights):
        found += night(NEAR_ARCSEC, angle_deg, scatter_s, seed)
    assert found["swapped"] == 0
    assert found["own"] >= 0.95 * found.total()


def test_the_judge_sees_a_swap():
    found = night(NEAR_ARCSEC, 0.0, 0.015, 1, swapped_at=20)
    assert found["swapped"] > 0


def weighed_of(names: tuple[str, ...], spacing_arcsec: float, shown: dict[str, float]) -> list:
    """Tracks of the first members, and a frame in which streaks lie so far along the row."""
    random, places = np.random.default_rng(2), members(spacing_arcsec, 90.0)
    settings, exact = every_day(), 0.0
    pairs = {
        n: [streak(k, n, random, places[n], truth()[k].rate, exact) for k in (0, 1)] for n in names
    }
    step = places["b"]
    streaks = [
        streak(2, n, random, share * step, truth()[2].rate, exact) for n, share in shown.items()
    ]
    sight, told = seen(2, *streaks), []
    for name in names:
        track = track_from_pair(*pairs[name], 1, sight, settings)
        before = LiveTrack(track=track, taken=pairs[name][1])
        predicted = estimator.predict(track, sight.t_mid_utc_ns, settings.filter, 2)
        updated = track_updates(predicted, sight.measurements, before, sight, settings)
        reasons = {m: NotTaken.by_gate(s.nis, 11.83) for m, s in updated.items() if s.nis > 11.83}
        told.append(TrackCandidates(predicted=predicted, updated=updated, reasons=reasons))
    return told


def names_of(given) -> list[str | None]:
    return [None if m is None else m.measurement_id.split("-")[1] for m in given.taken]


def test_the_whole_frame_decides_where_one_track_alone_would_take_the_wrong_one():
    """Both are late by more than half of their distance: alone ``b`` is nearer to ``a``'s."""
    tracks = weighed_of(("a", "b"), 30.0, {"a": 0.6, "b": 1.6})
    assert min(tracks[1].in_gate, key=lambda m: tracks[1].updated[m].nis).measurement_id == "2-a"
    assert names_of(assign_measurements(tracks)) == ["a", "b"]


def test_one_streak_between_two_tracks_is_nobodys():
    """Half way between both: an answer would be a guess."""
    given = assign_measurements(weighed_of(("a", "b"), 20.0, {"x": 0.5}))
    assert names_of(given) == [None, None]
    assert sorted(given.is_ambiguous) == [False, True]


def test_one_streak_on_a_track_is_that_tracks():
    given = assign_measurements(weighed_of(("a", "b"), 90.0, {"x": 1.0}))
    assert names_of(given) == [None, "x"]
    assert given.is_ambiguous == (False, False)


def test_a_streak_found_twice_is_still_one():
    given = assign_measurements(weighed_of(("a", "b"), 90.0, {"x": 0.0, "y": 0.01, "z": 1.0}))
    assert names_of(given)[1] == "z"
    assert names_of(given)[0] in {"x", "y"}


def test_a_frame_without_anything_gives_nothing():
    given = assign_measurements(weighed_of(("a", "b"), 40.0, {}))
    assert names_of(given) == [None, None]
    assert given.is_ambiguous == (False, False)
