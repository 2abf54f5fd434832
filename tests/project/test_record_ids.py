"""Ids of measurements and tracks: unique, stable when a night is told again, one lead a frame."""

from pathlib import Path
from typing import Any

from rsoconsole.config import Config
from rsoconsole.night import Night
from rsoconsole.pipeline import replay
from rsoconsole.pipeline.cycle.track_assignment import TrackAssignment
from rsoconsole.records import Measurement, Ruling, SlewCommand, TrackState
from rsoconsole.tracking import Following, follow
from tests.makers import geo_measurement
from tests.nights.made_up_night import state_of, taken
from tests.pipeline.test_rulings import CONFIG, night, replayed, say
from tests.tracking.test_follow import SETTINGS, seen


def two_tracks() -> list[Any]:
    """Frames in which a second track is followed beside the lead."""
    records: list[Any] = []
    for n in range(1, 5):
        for track_id, dec in ((1, -5.0), (2, -5.2)):
            measured = geo_measurement(n, dec_deg=dec)
            kind = "initial" if n == 2 else "updated"
            state = state_of(n, measured.ra_icrs_deg, dec, kind, measured.measurement_id)
            records.append(measured)
            if n > 1:
                first = geo_measurement(1, dec_deg=dec).measurement_id
                begun = (first, measured.measurement_id) if n == 2 else None
                records.append(
                    TrackState(
                        track_id=track_id,
                        kind=state.kind,
                        frame_id=n,
                        t_utc_ns=state.t_utc_ns,
                        x=state.x,
                        P=state.P,
                        measurement_id=measured.measurement_id,
                        begun_with=begun,
                        is_lead=track_id == 1,
                    )
                )
    return records


def test_a_frame_may_hold_several_tracks_each_with_its_own_measurements() -> None:
    tracks = TrackAssignment()
    for record in two_tracks():
        tracks.receive(record)
    found = tracks.tracks()
    assert [track.track_id for track in found] == [1, 2]
    for track, dec in zip(found, (-5.0, -5.2), strict=True):
        assert [m.frame_id for m in track.measurements] == [1, 2, 3, 4]
        assert {m.dec_icrs_deg for m in track.measurements} == {dec}


def test_the_console_shows_the_lead_of_several_tracks() -> None:
    shown = Night(Path("night"), {}, Config())
    for n in range(1, 5):
        shown.fold_record(1, taken(n, 150.0, -5.0))
        for record in (r for r in two_tracks() if r.frame_id == n):
            shown.fold_record(1, record)
    track = shown.view().track
    assert track is not None
    assert track.track_id == 1
    followed = shown.frame(4).accepted_measurement
    assert followed is not None
    assert followed.dec_icrs_deg == -5.0


def test_each_track_gets_the_next_id_also_after_a_loss() -> None:
    following, ids = Following(), []
    for n in range(1, 9):
        if n == 5:
            following = following.without_track("LOST")
        following, _ = follow(following, seen(n, geo_measurement(n)), SETTINGS)
        ids.append(following.track_id)
    assert ids == [None, 1, 1, 1, None, 2, 2, 2]


def test_an_update_names_what_it_took_and_the_first_state_both() -> None:
    following = Following()
    for n in (1, 2, 3):
        following, records = follow(following, seen(n, geo_measurement(n)), SETTINGS)
        states = [r for r in records if isinstance(r, TrackState)]
        named = [state.measurement_id for state in states]
        own = geo_measurement(n).measurement_id
        assert named == [[], [own], [None, own]][n - 1]
        if n == 2:
            assert states[0].begun_with == (geo_measurement(1).measurement_id, own)


def test_what_the_operator_marks_has_an_id_of_its_own_each_time() -> None:
    r = night({*range(1, 9), *range(10, 14)})
    r.engine.run(frames=10)
    mark = {"x_a": 10.0, "y_a": 10.0, "x_b": 40.0, "y_b": 10.0, "replaces": True}
    for verb, arguments in (("mark", mark), ("choose", {"x": 2.0, "y": 1.0}), ("mark", mark)):
        assert say(r, verb, frame=9, **arguments).ok
    made = [r.measurement_id for r in r.memory.of(Measurement)]
    assert len(set(made)) == len(made)
    taken_ = [decision.taken.measurement_id for decision in r.memory.of(Ruling)]
    assert taken_ == ["9-m0", "9-0", "9-m2"]
    assert all(frame.is_as_recorded for frame in replayed(r))


def test_a_candidate_has_one_id_whichever_lets_it_in() -> None:
    """By the operator's choice, or by another tau: it is the same place in the same list."""
    r = night(set(range(1, 12)))
    r.engine.run(frames=8)
    assert say(r, "choose", x=2.0, y=1.0).ok
    chosen = r.memory.of(Ruling)[-1].taken
    assert chosen.measurement_id == "8-1"
    records = [each for each in r.memory.records if not isinstance(each, Ruling)]
    changes = list(replay(records, CONFIG, changes={"detector.tau": 0.01}))
    (frame,) = [f for f in changes if f.taken.frame_id == 8][:1]
    ids = [m.measurement_id for m in frame.observations.measurements]
    assert "8-1" in ids
    assert len(set(ids)) == len(ids)


def test_an_order_names_the_track_that_it_leads_to() -> None:
    r = night(set(range(1, 9)))
    r.engine.run(frames=8)
    orders = r.memory.of(SlewCommand)
    assert {o.track_id for o in orders if o.reason == "filter"} == {1}
    assert {o.track_id for o in orders if o.reason != "filter"} == {None}
