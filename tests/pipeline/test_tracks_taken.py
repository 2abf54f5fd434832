"""Which measurements a track took is told frame by frame as it is told at the end of the night."""

import random
from dataclasses import replace

from rsoconsole.pipeline.cycle.track_assignment import WHOLE, TrackAssignment
from rsoconsole.records import FollowedAgain, Measurement, Record, TrackState
from tests.makers import NS, T0_UTC_NS, geo_measurement

FRAMES = 120


def state(kind: str, frame_id: int, track_id: int, taken: Measurement | None) -> TrackState:
    first = geo_measurement(max(frame_id - 1, 1)) if kind == "initial" else None
    begun = None if first is None or taken is None else (first.measurement_id, taken.measurement_id)
    return TrackState(
        track_id=track_id,
        kind=kind,  # type: ignore[arg-type]
        frame_id=frame_id,
        t_utc_ns=T0_UTC_NS + frame_id * NS,
        x=(1.0, 0.0, 2.0, 0.0),
        P=((1.0,) * 4,) * 4,
        measurement_id=None if taken is None else taken.measurement_id,
        begun_with=begun,
        memory=object(),
    )


def night() -> list[Record]:
    """Two tracks, frames that took nothing, and words that have frames followed again."""
    chance = random.Random(4)
    records: list[Record] = []
    for frame_id in range(1, FRAMES):
        taken = geo_measurement(frame_id)
        records.append(taken)
        track_id = 1 if frame_id < 70 else 2
        if frame_id == 1:
            continue
        kind = "initial" if frame_id in (2, 70) else "updated"
        records.append(state("predicted", frame_id, track_id, None))
        if chance.random() < 0.8 or kind == "initial":
            records.append(state(kind, frame_id, track_id, taken))
        if frame_id % 25 == 0:
            for again in (frame_id - 1, frame_id):
                records.append(FollowedAgain(frame_id=again))
                records.append(state("predicted", again, track_id, None))
                if again == frame_id:
                    records.append(state("updated", again, track_id, taken))
    return records


def test_asked_after_every_record_it_tells_the_same_as_asked_once():
    often, once = TrackAssignment(), TrackAssignment()
    for record in night():
        often.receive(record)
        often.live_tracks()
        once.receive(record)
    assert often.tracks() == once.tracks()
    assert [track.track_id for track in often.live_tracks()] == [2]
    first, second = once.tracks()
    assert 24 not in {m.frame_id for m in first.measurements}
    assert [m.frame_id for m in second.measurements][:1] == [69]
    assert second.last.memory is not None


def test_what_filters_know_does_not_stay_in_memory_for_a_whole_night():
    taken = TrackAssignment()
    for frame_id in range(1, 10 * WHOLE):
        measured = geo_measurement(frame_id)
        taken.receive(measured)
        taken.receive(state("predicted", frame_id, 1, None))
        taken.receive(state("initial" if frame_id == 1 else "updated", frame_id, 1, measured))
    steps = [frame[1] for frame in taken._frames.values()]
    assert sum(each.predicted is not None for each in steps) == WHOLE
    whole = [each.corrected for each in steps if each.corrected and each.corrected.memory]
    assert len(whole) == WHOLE
    (track,) = taken.tracks()
    assert len(track.measurements) >= 10 * WHOLE - 1
    assert replace(track.last, memory=None).frame_id == 10 * WHOLE - 1
