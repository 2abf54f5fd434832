"""Every satellite in the field has a track: a slot of real element sets, SGP4 its truth."""

import functools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.orbits import Satellite, parse_elements
from rsoconsole.records import FoldRecord, Measurement, Missed, NotFollowed, TrackState
from rsoconsole.simulator import elements_path
from rsoconsole.sky import SkyPlaces
from rsoconsole.tracking import Following, FollowSettings, FrameInput, follow
from rsoconsole.tracking.association.pattern import NO_PATTERN, TrackPlace, pattern_after
from tests.nights.slot_of_twelve import streak
from tests.tracking.test_rivals import every_day
from tests.truth.seen_satellites import DAYTONA

SLOT = ("AMAZONAS 2", "AMAZONAS 3", "AMAZONAS 5")
"""At 61 degrees west, three within a tenth of a degree."""
T0_UTC_NS = 1_687_406_400_000_000_000
CADENCE_S, EXPOSURE_S = 30.0, 10.0


def settings(most_tracks: int = 12) -> FollowSettings:
    plain = every_day()
    return replace(plain, filter=plain.filter.model_copy(update={"most_tracks": most_tracks}))


@functools.cache
def places(late_s: tuple[float, ...]) -> dict[str, SkyPlaces]:
    """Where each was when the shutter really opened."""
    t = T0_UTC_NS + np.arange(len(late_s)) * round(CADENCE_S * 1e9)
    t = t + np.round(np.array(late_s) * 1e9).astype(np.int64)
    text = Path(elements_path()).read_text(encoding="utf-8")
    known = {each.name: each for each in parse_elements(text) if each.name in SLOT}
    return {name: Satellite(known[name]).astrometric_place(DAYTONA, t) for name in SLOT}


def seen(k: int, shown: list[Measurement]) -> FrameInput:
    return FrameInput(
        frame_id=k,
        t_mid_utc_ns=T0_UTC_NS + k * round(CADENCE_S * 1e9),
        exposure_s=EXPOSURE_S,
        measurements=tuple(shown),
        absence=Missed(kind="no detection"),
    )


def owners(following: Following, k: int) -> dict[int, str]:
    """Whose streak each track took in a frame."""
    return {
        each.track.track_id: each.taken.measurement_id.partition("-")[2]
        for each in following.tracks
        if each.taken is not None and each.taken.frame_id == k
    }


@pytest.mark.parametrize("scatter_s", [0.015, 0.2, 1.0])
def test_each_of_a_slot_keeps_its_own_track(scatter_s: float) -> None:
    frames, shown_after_lock, taken, swaps = 40, 0, 0, 0
    random = np.random.default_rng(round(1000 * scatter_s))
    late_s = tuple(random.normal(0.0, scatter_s, frames).tolist())
    following, owner = Following(), dict[int, str]()
    for k in range(frames):
        shown = [
            streak(k, name, at, random, leads=name == SLOT[0])
            for name, at in places(late_s).items()
            if k < 2 or random.random() < 0.9
        ]
        following, _ = follow(following, seen(k, shown), settings())
        found = owners(following, k)
        swaps += sum(owner.setdefault(track, name) != name for track, name in found.items())
        if k >= 2:
            shown_after_lock += len(shown)
            taken += len(set(found.values()))
    assert swaps == 0
    assert set(owner.values()) == set(SLOT)
    assert taken / shown_after_lock >= 0.95


def night_of(shown: dict[int, str], frames: int, most_tracks: int = 12):
    """(frame, what is followed, records) where only the named ones are seen; else all."""
    random = np.random.default_rng(5)
    following = Following()
    for k in range(frames):
        names = [name for name in SLOT if name[-1] in shown.get(k, "235")]
        streaks = [
            streak(k, name, places((0.0,) * frames)[name], random, leads=name == SLOT[0])
            for name in names
        ]
        following, records = follow(following, seen(k, streaks), settings(most_tracks))
        yield k, following, records


def test_one_that_comes_later_begins_its_own_track_beside_the_others() -> None:
    told: dict[int, tuple[FoldRecord, ...]] = {}
    for k, following, records in night_of(dict.fromkeys(range(5), "23"), 9):
        told[k] = records
        assert len(following.tracks) == (0 if k < 1 else 2 if k < 6 else 3)
    begun = [r for r in told[6] if isinstance(r, TrackState) and r.kind == "initial"]
    assert [r.track_id for r in begun] == [3]
    assert not begun[0].is_lead
    # What begins a track is refused by none in the same frame.
    assert not [r for r in told[6] if isinstance(r, NotFollowed)]
    assert sorted(owners(following, 8).values()) == sorted(SLOT)


def test_with_one_track_alone_nothing_begins_beside_it() -> None:
    for k, following, _ in night_of({}, 6, most_tracks=1):
        assert len(following.tracks) == (1 if k else 0)


def test_there_is_room_for_so_many_and_no_more() -> None:
    for k, following, _ in night_of({}, 6, most_tracks=2):
        assert len(following.tracks) == (2 if k else 0)


def test_the_way_from_one_to_another_knows_nothing_of_what_both_share() -> None:
    """Both are beside their places by the same minute of arc, another one in each frame."""
    random = np.random.default_rng(8)
    pattern, cov = NO_PATTERN, 0.3**2 * np.eye(2)
    for k in range(20):
        shared = random.normal(0.0, 60.0, 2) / 3600.0
        shown = {}
        for track, east_arcsec in ((1, 0.0), (2, 100.0 + 0.02 * k * CADENCE_S)):
            own = random.normal(0.0, 0.3, 2) / 3600.0
            at = (10.0 + east_arcsec / 3600.0 + shared[0] + own[0], shared[1] + own[1])
            shown[track] = TrackPlace(
                ra_icrs_deg=at[0], dec_icrs_deg=at[1], covariance=cov, rate_arcsec_s=np.zeros(2)
            )
        pattern = pattern_after(pattern, (1, 2), shown, k * round(CADENCE_S * 1e9) + 1)
    later_ns = 30 * round(CADENCE_S * 1e9) + 1
    known, ways, covariances = pattern.relative_positions_at((1, 2, 3), later_ns)
    assert known.tolist() == [[False, True, False], [True, False, False], [False, False, False]]
    np.testing.assert_array_equal(ways[1, 0], -ways[0, 1])
    way, covariance = ways[0, 1], covariances[0, 1]
    true = np.array([100.0 + 0.02 * 30 * CADENCE_S, 0.0])
    assert np.all(np.abs(way - true) < 4.0 * np.sqrt(np.diag(covariance)))
    assert np.sqrt(covariance[0, 0]) < 1.0
