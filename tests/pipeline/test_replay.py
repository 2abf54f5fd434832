"""A session replayed: the same fold over what is on record gives the same track, bit for bit."""

import dataclasses
from collections.abc import Callable
from typing import Any

import pytest

from rsoconsole.base import ConfigError
from rsoconsole.config import Config, with_setting
from rsoconsole.night import frames_of, recorded_figures
from rsoconsole.pipeline import ReplayedFrame, replay
from rsoconsole.pipeline.replays.what_if_log import track_figures
from rsoconsole.records import (
    BelowTau,
    Cause,
    Detection,
    Detections,
    FrameTaken,
    Miss,
    NotFollowed,
    ParameterChange,
    Rejection,
    StateChange,
    TrackState,
)
from rsoconsole.session import SessionReader
from rsoconsole.words import text
from tests.cli.test_demo import night
from tests.makers import NS, geo_measurement, straight_detection
from tests.nights import engine_nights
from tests.nights.engine_nights import Night
from tests.rigs.engine_rig import solution_at

CONFIG = Config.model_validate({"search": {"recentre": "every"}})
"""With it every frame orders a slew."""


@pytest.fixture(scope="module")
def busy_night() -> Night:
    return engine_nights.busy(CONFIG)


@pytest.mark.slow("makes the night that its file replays")
def test_the_night_has_seen_it_all(busy_night):
    reasons = " | ".join(text(change.reason) for change in busy_night.of(StateChange))
    for word in ("armed", "moves the mount", "resumed", "limit met", "STOP", "camera", "coasted"):
        assert word in reasons, word
    misses = " | ".join(text(miss.reason) for miss in busy_night.of(Miss))
    for word in ("cloud: 12 stars", "no frame in 30 s", "reduction broke", "did not take"):
        assert word in misses, word
    reduced = {found.frame_id for found in busy_night.of(Detections)}
    assert {taken.frame_id for taken in busy_night.of(FrameTaken)} - reduced == {13, 15}
    assert [change.name for change in busy_night.of(ParameterChange)][:2] == [
        "filter.r_multiplier",
        "detector.tau",
    ]


def test_a_night_in_which_everything_happens_is_replayed_bit_for_bit(busy_night):
    replayed = list(replay(busy_night.records, CONFIG))
    assert all(frame.is_as_recorded for frame in replayed)
    states = [r for frame in replayed for r in frame.records if isinstance(r, TrackState)]
    assert states == busy_night.of(TrackState)
    told = [r for frame in replayed for r in frame.records if isinstance(r, NotFollowed)]
    assert told == busy_night.of(NotFollowed)
    assert len(states) > 60
    assert recorded_figures(busy_night.records) == track_figures(replayed)


def test_wherever_a_session_is_cut_off_only_its_last_frame_lacks_anything(busy_night):
    records = busy_night.records
    lacking = 0
    for end in range(1, len(records), 53):
        *whole, last = list(replay(records[:end], CONFIG)) or [None]
        kept = {f.frame_id: f.fold for f in frames_of(records[:end]) if f.fold}
        for each in whole:
            fold = kept[each.taken.frame_id]
            is_again = any(
                f.taken.frame_id == each.taken.frame_id for f in (*whole, last) if f is not each
            )
            is_again = is_again or each.taken.frame_id == last.taken.frame_id
            assert is_again or (fold.records, fold.state_after) == (each.recorded, each.after.state)
        assert all(frame.is_as_recorded for frame in whole)
        if last is not None:
            assert last.records[: len(last.recorded)] == last.recorded
            lacking += not last.is_as_recorded
    assert lacking > 2


def test_after_every_frame_the_replay_follows_what_the_engine_followed(busy_night):
    after = {frame.taken.frame_id: frame.after for frame in replay(busy_night.records, CONFIG)}
    assert {n: after[n] for n in busy_night.followed} == busy_night.followed
    assert any(following.tracks and following.tracks[0].neighbours for following in after.values())


def test_frames_while_the_operator_has_the_mount_and_unreduced_ones_are_not_folded(busy_night):
    folded = {frame.taken.frame_id for frame in replay(busy_night.records, CONFIG)}
    assert folded.isdisjoint({12, 13, 15, 23, 24, 25, 26})
    assert {11, 14, 16, 22, 27} <= folded


def without(records: list[Any], left_out: Callable[[Any], bool]) -> list[Any]:
    return [record for record in records if not left_out(record)]


def passage(record: Any) -> tuple[str, ...]:
    return (record.before, record.after) if isinstance(record, StateChange) else ()


def is_limit(record: Any) -> bool:
    cause = record.reason if isinstance(record, StateChange) else None
    return isinstance(cause, Cause) and cause.kind == "limit met"


def falsified(records: list[Any]) -> list[Any]:
    """One measurement in the last digit."""
    number = next(n for n, r in enumerate(records) if isinstance(r, TrackState) and r.nis) - 3
    while type(records[number]).__name__ != "Measurement":
        number -= 1
    wrong = records[number]
    changed = dataclasses.replace(wrong, dec_icrs_deg=wrong.dec_icrs_deg + 1e-13)
    return [*records[:number], changed, *records[number + 1 :]]


@pytest.mark.parametrize(
    "harm",
    [
        lambda rs: without(rs, lambda r: isinstance(r, ParameterChange)),
        lambda rs: without(rs, lambda r: "MANUAL" in passage(r)),
        lambda rs: without(rs, lambda r: "IDLE" in passage(r) and r.frame_id > 0),
        lambda rs: without(rs, is_limit),
        lambda rs: without(rs, lambda r: isinstance(r, Detections) and r.frame_id == 4),
        falsified,
    ],
    ids=["no changes", "no move by hand", "no STOP", "no limit", "a frame less", "a false digit"],
)
def test_whatever_shaped_the_track_is_missed_when_it_is_not_there(busy_night, harm):
    replayed = list(replay(harm(busy_night.records), CONFIG))
    assert not all(frame.is_as_recorded for frame in replayed)


def misses(replayed: list[ReplayedFrame]) -> int:
    return sum(isinstance(r, Miss) for frame in replayed for r in frame.records)


def test_what_is_tried_holds_from_the_start_whatever_was_set_later(busy_night):
    changes = list(replay(busy_night.records, CONFIG, changes={"filter.r_multiplier": 9.0}))
    assert {frame.config.filter.r_multiplier for frame in changes} == {9.0}
    assert changes[-1].config.detector.tau == 0.2
    assert not all(frame.is_as_recorded for frame in changes)
    same = with_setting(CONFIG, "filter.r_multiplier", 9.0)
    assert changes[3].records == next(
        f.records for n, f in enumerate(replay(busy_night.records, same)) if n == 3
    )


def test_a_higher_tau_leaves_out_what_was_less_confident(busy_night):
    changes = list(replay(busy_night.records, CONFIG, changes={"detector.tau": 0.8}))
    assert {m.confidence for frame in changes for m in frame.observations.measurements} == {0.9}
    assert misses(list(replay(busy_night.records, CONFIG, changes={"detector.tau": 0.95}))) == 0


def test_another_header_latency_moves_every_instant_of_the_track(busy_night):
    as_it_was = list(replay(busy_night.records, CONFIG))
    changes = list(replay(busy_night.records, CONFIG, changes={"exposure.header_latency_s": 0.25}))
    track, later = as_it_was[5].after.track, changes[5].after.track
    assert track is not None
    assert later is not None
    assert later.t_utc_ns - track.t_utc_ns == NS // 4
    assert later.x == pytest.approx(track.x, rel=1e-9)


def test_a_lower_tau_measures_what_lay_below_it():
    """A candidate below tau is on record with its place: the plate makes a measurement of it."""
    faint = straight_detection(frame_id=1, confidence=0.08)
    far = straight_detection(frame_id=1, confidence=0.05)
    records = [taken(1), detections(1, faint, far), solution_at(150.0, -5.0)]
    (as_it_was,) = replay(records, CONFIG)
    (changes,) = replay(records, CONFIG, changes={"detector.tau": 0.06})
    assert as_it_was.after.state == "SEARCH"
    assert changes.after.state == "ACQUIRE"
    assert [m.confidence for m in changes.observations.measurements] == [0.08]


def taken(frame_id: int) -> FrameTaken:
    return FrameTaken(
        frame_id=frame_id,
        name=f"frame {frame_id}",
        t_start_utc_ns=geo_measurement(frame_id).t_mid_utc_ns,
        exposure_s=10.0,
        width_px=4656,
        height_px=3520,
        pointing_ra_icrs_deg=150.0,
        pointing_dec_icrs_deg=-5.0,
    )


def detections(frame_id: int, *faint: Detection) -> Detections:
    return Detections(
        frame_id=frame_id,
        width_px=4656,
        height_px=3520,
        detections=(),
        rejected=tuple(
            Rejection(detection=d, reason=BelowTau(confidence=d.confidence, tau=0.1)) for d in faint
        ),
    )


def test_a_setting_that_there_is_not_is_refused_with_the_remedy():
    with pytest.raises(ConfigError, match=r"did you mean filter\.sigma_arcsec"):
        list(replay([], CONFIG, changes={"filter.sigma": 1.0}))
    with pytest.raises(ConfigError, match="must be above 0"):
        list(replay([], CONFIG, changes={"filter.q_multiplier": -1.0}))


@pytest.mark.nights
@pytest.mark.timeout(900)
def test_a_night_among_neighbours_is_replayed_bit_for_bit(tmp_path):
    summary = night(tmp_path / "one", "--scenario", "ses-10", "--seed", "1", frames=40)
    reader = SessionReader(summary["session"])
    replayed = list(replay((r for _, _, r in reader.records()), reader.config()))
    assert all(frame.is_as_recorded for frame in replayed)
    assert any(frame.after.tracks and frame.after.tracks[0].neighbours for frame in replayed)
    assert len(replayed) == 40
