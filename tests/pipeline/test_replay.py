"""A session replayed: the same fold over what is on record gives the same track, bit for bit."""

import dataclasses
from collections.abc import Callable
from typing import Any

import pytest

from rsoconsole.config import Config, with_setting
from rsoconsole.engine.aim.states import LimitMet
from rsoconsole.errors import ConfigError, InstrumentError
from rsoconsole.night import as_recorded, frames_of
from rsoconsole.pipeline.frame.reduce import Reduction
from rsoconsole.pipeline.replay.refold import ReplayedFrame, replay
from rsoconsole.pipeline.replay.what_if_figures import figures_of
from rsoconsole.reason_text import text
from rsoconsole.reasons import BelowTau, Cause
from rsoconsole.records import (
    Detection,
    Detections,
    Frame,
    FrameTaken,
    Miss,
    NotFollowed,
    ParameterChange,
    Rejection,
    StateChange,
    TrackState,
    measurement_id_of,
)
from rsoconsole.session.log.codec import decode, encode
from rsoconsole.session.reading.reader import SessionReader
from rsoconsole.tracking.association.following import Following
from tests.cli.test_demo import night
from tests.makers import NS, geo_measurement, straight_detection
from tests.rigs.engine_rig import Rig, ScriptedReducer, asked, command_handler_of, rig, solution_at

CONFIG = Config.model_validate({"search": {"recentre": "every"}})
"""With it every frame orders a slew."""
AN_ARCSEC = 1.0 / 3600.0
CLOUDS = {9, 10}


class BusyReducer(ScriptedReducer):
    """Counts stars, sees a neighbour beside the satellite, and breaks where it is told to."""

    breaks: frozenset[int] = frozenset()

    def reduce(self, frame: Frame) -> Reduction:
        if frame.frame_id in self.breaks:
            raise InstrumentError("the reduction broke")
        plain = super().reduce(frame)
        measured = plain.measurements
        beside = tuple(
            dataclasses.replace(
                m,
                measurement_id=measurement_id_of(m.frame_id, 1),
                ra_icrs_deg=m.ra_icrs_deg + 90.0 * AN_ARCSEC,
                confidence=0.7,
                cov_sky_arcsec2=(0.09, 0.01, 0.05),
                ends_icrs_deg=tuple((ra + 90.0 * AN_ARCSEC, dec) for ra, dec in m.ends_icrs_deg),
            )
            for m in measured
        )
        # A little off its place in every frame: the innovations are not nothing.
        shaken = tuple(
            dataclasses.replace(m, dec_icrs_deg=m.dec_icrs_deg + frame.frame_id % 3 * AN_ARCSEC / 3)
            for m in measured
        )
        is_cloudy = frame.frame_id in CLOUDS
        detections = dataclasses.replace(
            plain.detections,
            detections=tuple(
                straight_detection(frame_id=frame.frame_id) for _ in (*shaken, *beside)
            ),
            star_count=12 if is_cloudy else 200 + frame.frame_id,
            star_flux_adu=1000.0 + frame.frame_id / 7.0,
        )
        return dataclasses.replace(plain, detections=detections, measurements=(*shaken, *beside))


@dataclasses.dataclass
class Night:
    """What was recorded, what it began with, and what the engine followed after each cycle."""

    records: list[Any]
    followed: dict[int, Following]

    def of(self, kind: type[Any]) -> list[Any]:
        return [record for record in self.records if isinstance(record, kind)]


def busy_rig(frames: set[int]) -> tuple[Rig, dict[int, Following]]:
    r = rig(frames, CONFIG)
    r.reducer.__class__ = BusyReducer
    followed: dict[int, Following] = {}
    r.engine.frames._on_cycle = lambda _: followed.__setitem__(
        r.engine.frame_id, r.engine.following
    )
    return r, followed


def at_frame(r: Rig, frame_id: int, act: Callable[[], object]) -> None:
    """Do something while the camera reads out this frame."""
    wait = r.camera.wait_frame

    def acting(timeout_s: float) -> Frame:
        frame = wait(timeout_s)
        if frame.frame_id == frame_id:
            act()
        return frame

    r.camera.wait_frame = acting  # type: ignore[method-assign]


def refuse_one_slew(r: Rig) -> None:
    slew = r.mount.slew

    def fail_once(*_: float) -> None:
        r.mount.slew = slew  # type: ignore[method-assign]
        raise InstrumentError("the mount did not take the order")

    r.mount.slew = fail_once  # type: ignore[method-assign]


@pytest.fixture(scope="module")
def busy_night() -> Night:
    """Everything that may come between two frames, in one night of 60."""
    r, followed = busy_rig(set(range(1, 61)) - {7, *CLOUDS, *range(48, 54)})
    command_handler, engine = command_handler_of(r), r.engine
    r.reducer.breaks = frozenset({13})
    at_frame(r, 15, lambda: command_handler.handle(asked("hold")))
    engine.arm()
    engine.run(frames=11)  # lock, a miss, two frames of cloud
    r.camera.broken_for = 1
    engine.run(frames=16)  # a lost frame, one whose reduction breaks, one cut short by 'hold'
    command_handler.handle(asked("resume"))
    r.queue.put(asked("set", arguments={"name": "filter.r_multiplier", "value": 3.0}))
    r.queue.put(asked("set", arguments={"name": "detector.tau", "value": 0.2}))
    engine.run(frames=20)
    refuse_one_slew(r)
    engine.run(frames=22)
    away = {"ra_icrs_deg": r.mount.at_deg[0] + 5.0, "dec_icrs_deg": r.mount.at_deg[1]}
    command_handler.handle(asked("goto", arguments=away))
    engine.run(frames=24)
    command_handler.handle(asked("nudge", arguments={"east_arcmin": 10.0, "north_arcmin": 0.0}))
    engine.run(frames=26)
    command_handler.handle(asked("resume"))
    engine.run(frames=30)
    r.queue.interrupt(LimitMet(words="altitude 14.9 deg, 15 at least"))
    engine.run(frames=35)
    command_handler.handle(asked("stop"))
    r.queue.put(asked("arm"))
    r.queue.put(asked("set", arguments={"name": "search.follow", "value": "nearest"}))
    engine.run(frames=40)
    r.camera.broken_for = 3
    with pytest.raises(InstrumentError, match="FAULT"):
        engine.run(frames=45)
    r.queue.put(asked("arm"))
    r.queue.put(asked("set", arguments={"name": "filter.max_coast_s", "value": 80.0}))
    engine.run(frames=60)  # and lost, and found
    # As a session would give them back.
    return Night([decode(*encode(record)[::2]) for record in r.memory.records], followed)


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
    assert as_recorded(busy_night.records) == figures_of(replayed)


def test_wherever_a_session_is_cut_off_only_its_last_frame_lacks_anything(busy_night):
    records = busy_night.records
    lacking = 0
    for end in range(1, len(records), 53):
        *whole, last = list(replay(records[:end], CONFIG)) or [None]
        kept = {f.frame_id: f.fold for f in frames_of(records[:end]) if f.fold and f.fold.is_closed}
        for each in whole:
            fold = kept[each.taken.frame_id]
            is_again = any(
                f.taken.frame_id == each.taken.frame_id for f in (*whole, last) if f is not each
            )
            is_again = is_again or each.taken.frame_id == last.taken.frame_id
            assert is_again or (fold.records, fold.state) == (each.recorded, each.state)
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
    assert {m.confidence for frame in changes for m in frame.shown.measurements} == {0.9}
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
    assert [m.confidence for m in changes.shown.measurements] == [0.08]


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
