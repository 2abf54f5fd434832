"""What begins a track: pairs of streaks, chains of points, and what a frame between has hidden."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from rsoconsole.pipeline.cycle.track_assignment import TrackAssignment
from rsoconsole.records import Measurement, NotFollowed, TrackState
from rsoconsole.tracking import Following, follow
from rsoconsole.tracking.initiation import chains
from rsoconsole.tracking.initiation.chains import UNPAIRED_COST, pairs_between
from tests.makers import GEO_RATE_DEG_S, geo_measurement
from tests.tracking.test_follow import SETTINGS, seen

QUICK = {"exposure_s": 0.5}
"""In which what moves as a satellite of the belt draws no streak."""


def point(frame_id: int, **other: float) -> Measurement:
    return replace(geo_measurement(frame_id, **other), ends_icrs_deg=None)


def followed(
    frames: dict[int, list[Measurement]],
) -> tuple[Following, list[TrackState], TrackAssignment]:
    following, begun, taken = Following(), [], TrackAssignment()
    for frame_id, shown in frames.items():
        sight = replace(seen(frame_id, *shown), **QUICK)
        following, records = follow(following, sight, SETTINGS)
        for record in (*shown, *records):
            taken.receive(record)
        begun += [r for r in records if isinstance(r, TrackState) and r.kind == "initial"]
    return following, begun, taken


@contextmanager
def by_pairs() -> Iterator[None]:
    """As presets that ask two successive frames alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chains, "uses_window", lambda _: False)
        yield


def false(frame_id: int, number: int) -> Measurement:
    """A point anywhere in the field."""
    east, north = np.random.default_rng([frame_id, number]).uniform(-0.6, 0.6, 2)
    return point(frame_id, ra_deg=150.0 + east, dec_deg=-5.0 + north, rate_deg_s=0.0)


def test_two_points_alone_begin_nothing_and_three_in_a_line_do():
    frames = {n: [point(n), false(n, 1), false(n, 2)] for n in (1, 2, 3)}
    following, begun, _ = followed({n: frames[n] for n in (1, 2)})
    assert (following.state, begun) == ("ACQUIRE", [])
    following, [begin], taken = followed(frames)
    assert following.state == "TRACK"
    ids = [point(n).measurement_id for n in (1, 2, 3)]
    assert begin.begun_with == (ids[0], ids[2])
    assert begin.begun_through == (ids[1],)
    assert [m.measurement_id for m in taken.tracks()[0].measurements] == ids
    assert begin.x[1] == pytest.approx(GEO_RATE_DEG_S, rel=2e-3)


def test_as_pairs_alone_any_two_points_begin_a_track():
    frames = {n: [false(n, 1), false(n, 2)] for n in (1, 2)}
    with by_pairs():
        assert followed(frames)[1]
    assert not followed(frames)[1]


def test_a_frame_that_hides_one_of_the_line_does_not_keep_it_from_beginning():
    frames = {n: [false(n, 1), *([point(n)] if n != 2 else [])] for n in (1, 2, 3, 4)}
    _, [begin], _ = followed(frames)
    assert begin.begun_with == (point(1).measurement_id, point(4).measurement_id)


def test_two_points_that_move_as_what_is_followed_does_begin_beside_it():
    frames = {n: [point(n)] for n in range(1, 6)}
    for n in (4, 5):
        frames[n].append(point(n, dec_deg=-5.1))
    following, begun, _ = followed(frames)
    assert [each.frame_id for each in begun] == [3, 5]
    assert len(following.tracks) == 2


def test_a_streak_that_the_frame_between_did_not_show_begins_beside_a_track():
    def night() -> list[int]:
        following, begun = Following(), []
        for n in range(1, 7):
            shown = [geo_measurement(n)]
            if n in (4, 6):
                shown.append(geo_measurement(n, dec_deg=-5.1))
            following, records = follow(following, seen(n, *shown), SETTINGS)
            begun += [r for r in records if isinstance(r, TrackState) and r.kind == "initial"]
        return [each.frame_id for each in begun]

    assert night() == [2, 6]
    with by_pairs():
        assert night() == [2]


def test_a_neighbour_that_was_seen_beside_the_lead_begins_while_the_lead_is_missed():
    """The lead does not wait for what cannot be it."""

    def night() -> list[int]:
        following, begun = Following(), []
        for n in range(1, 8):
            shown = [geo_measurement(n)] if n not in (6, 7) else []
            if n in (5, 6, 7):
                shown.append(geo_measurement(n, dec_deg=-5.05))
            following, records = follow(following, seen(n, *shown), SETTINGS)
            begun += [r for r in records if isinstance(r, TrackState) and r.kind == "initial"]
        return [each.frame_id for each in begun]

    assert night() == [2, 6]
    with by_pairs():
        assert night() == [2]


def test_two_false_streaks_that_led_lead_no_longer_once_another_track_is_confirmed():
    """Surer than what is there, seen in two frames and never again."""

    def night() -> list[int | None]:
        following, leads = Following(), []
        for n in range(1, 6):
            shown = [replace(geo_measurement(n), confidence=0.6)]
            if n <= 2:
                shown.insert(0, geo_measurement(n, dec_deg=-5.3))
            following, _ = follow(following, seen(n, *shown), SETTINGS)
            leads.append(following.track_id)
        return leads

    with by_pairs():
        assert night() == [None, 1, 1, 1, 1]
    assert night() == [None, 1, 2, 2, 2]


def test_one_right_pair_is_worth_more_than_two_wrong_ones():
    """What is followed says how a slot moves; without it as many as can be have a partner."""
    a, b = geo_measurement(1), geo_measurement(2)
    # Each a sixth of the way beside: as far off as a streak may be.
    off = GEO_RATE_DEG_S * 30.0 / 3.0
    false_first = geo_measurement(1, ra_deg=150.0 + off)
    false_second = geo_measurement(2, ra_deg=150.0 - off)
    firsts, seconds = (a, false_first), (b, false_second)
    rate = 3600.0 * GEO_RATE_DEG_S * np.cos(np.radians(5.0))
    assert len(pairs_between(firsts, seconds, 10.0)) == 2
    told = pairs_between(firsts, seconds, 10.0, [(float(rate), 0.0)], unpaired=UNPAIRED_COST)
    assert told == {b: a}


def test_a_whole_streak_close_beside_a_track_s_own_is_a_track_with_its_second_frame():
    """Their measurements are within each other's gates: which one the track takes is not all."""
    beside = {"dec_deg": -5.0 + 10.0 / 3600.0, "confidence": 0.8}
    following, begun, refused = Following(), [], set()
    for n in range(1, 6):
        shown = (
            [geo_measurement(n)] if n < 4 else [geo_measurement(n), geo_measurement(n, **beside)]
        )
        following, records = follow(following, seen(n, *shown), SETTINGS)
        begun += [
            (r.frame_id, r.track_id)
            for r in records
            if isinstance(r, TrackState) and r.kind == "initial"
        ]
        refused |= {r.reason.kind for r in records if isinstance(r, NotFollowed)}
    assert "another taken" in refused
    assert begun == [(2, 1), (5, 2)]
