"""Of several tracks the operator makes another one the lead: none ends, and a replay agrees."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from rsoconsole.config import Config
from rsoconsole.night import recorded_figures
from rsoconsole.pipeline import Reduction, replay
from rsoconsole.pipeline.replays.what_if_log import track_figures
from rsoconsole.records import Frame, OperatorAction, SlewCommand, StateChange, TrackState
from rsoconsole.session import decode, encode
from rsoconsole.tracking import Following, follow
from rsoconsole.words import text
from tests.makers import straight_detection
from tests.nights.slot_of_twelve import streak
from tests.rigs.engine_rig import Rig, ScriptedReducer, command_handler_of, rig, told
from tests.tracking.test_company import SLOT, owners, places, seen, settings

FRAMES = 8


def shown(k: int) -> list[Any]:
    random = np.random.default_rng(k)
    return [
        streak(k, name, places((0.0,) * 24)[name], random, leads=name == SLOT[0]) for name in SLOT
    ]


def locked() -> Following:
    following = Following()
    for k in range(FRAMES):
        following, _ = follow(following, seen(k, shown(k)), settings())
    assert len(following.tracks) == len(SLOT)
    return following


@pytest.mark.parametrize("number", range(len(SLOT)))
def test_what_another_track_takes_makes_it_the_lead_and_changes_nothing_else(number: int):
    before = locked()
    frame = seen(FRAMES, shown(FRAMES))
    plain, _ = follow(before, frame, settings())
    wanted = plain.tracks[number]
    # The word has a copy of the measurement, as read back from the record.
    copied = dataclasses.replace(wanted.taken)
    after, records = follow(before, dataclasses.replace(frame, chosen=copied), settings())
    assert after.track_id == wanted.track.track_id
    assert after.state == "TRACK"
    assert owners(after, FRAMES) == owners(plain, FRAMES)
    assert {t.track.track_id: t.track.x for t in after.tracks} == {
        t.track.track_id: t.track.x for t in plain.tracks
    }
    states = [r for r in records if isinstance(r, TrackState)]
    assert [s.track_id for s in states if s.is_lead] == [wanted.track.track_id] * 2
    assert states[0].is_lead
    assert not [r for r in records if isinstance(r, StateChange)]
    # From now on, without another word.
    later, _ = follow(after, seen(FRAMES + 1, shown(FRAMES + 1)), settings())
    assert later.track_id == wanted.track.track_id
    assert len(later.tracks) == len(SLOT)


def test_what_no_track_takes_is_chosen_as_ever():
    before = locked()
    stranger = dataclasses.replace(
        shown(FRAMES)[0],
        measurement_id="stranger",
        dec_icrs_deg=shown(FRAMES)[0].dec_icrs_deg + 0.3,
    )
    frame = seen(FRAMES, [*shown(FRAMES), stranger])
    after, _ = follow(before, dataclasses.replace(frame, chosen=stranger), settings())
    assert after.state == "ACQUIRE"
    assert after.candidates == (stranger,)


class Two(ScriptedReducer):
    """A second satellite north of the first, each at a place of its own in every frame."""

    def reduce(self, frame: Frame) -> Reduction:
        plain = super().reduce(frame)
        measured = tuple(
            dataclasses.replace(
                m,
                measurement_id=f"{frame.frame_id}-{number}",
                dec_icrs_deg=m.dec_icrs_deg + number * 0.05,
                x_px=10.0 + 30.0 * number,
                y_px=30.0,
                confidence=0.9 - 0.1 * number,
            )
            for m in plain.measurements
            for number in (0, 1)
        )
        found = tuple(
            straight_detection(
                frame_id=frame.frame_id, x_px=m.x_px, y_px=m.y_px, confidence=m.confidence
            )
            for m in measured
        )
        detections = dataclasses.replace(plain.detections, detections=found)
        return dataclasses.replace(plain, detections=detections, measurements=measured)


SEVERAL = Config.model_validate({"search": {"recentre": "every"}, "filter": {"most_tracks": 4}})


def night_of_two() -> Rig:
    r = rig(set(range(1, 20)), SEVERAL)
    r.reducer.__class__ = Two
    r.engine.arm()
    r.engine.run(frames=FRAMES)
    assert len(r.engine.following.tracks) == 2
    return r


def aims(r: Rig, frames: int) -> float:
    """The declination that the last slew went to, after so many frames more."""
    r.engine.run(frames=r.engine.following.track.frame_id + frames)
    return r.memory.of(SlewCommand)[-1].dec_icrs_deg


def test_the_telescope_follows_the_one_that_was_made_the_lead_and_a_replay_agrees():
    r = night_of_two()
    lead, other = (each.track.track_id for each in r.engine.following.tracks)
    before = aims(r, 1)
    last = r.engine.following.track.frame_id
    outcome = told(command_handler_of(r), "choose", {"frame": last - 1, "x": 40.0, "y": 30.0})
    assert outcome.ok
    r.engine.commands.execute_waiting()
    assert r.engine.following.track_id == other
    assert {t.track.track_id for t in r.engine.following.tracks} == {lead, other}
    (said,) = [a for a in r.memory.of(OperatorAction) if a.outcome.kind == "ruled"]
    assert text(said.outcome) == f"frame {last - 1}: its track leads now"
    assert aims(r, 2) - before == pytest.approx(0.05, abs=0.01)
    assert r.engine.following.track_id == other
    records = [decode(*encode(record)[::2]) for record in r.memory.records]
    frames = list(replay(records, SEVERAL))
    assert recorded_figures(records) == track_figures(frames)
    assert all(frame.is_as_recorded for frame in frames)
    again, live = frames[-1].after, r.engine.following
    assert again.tracks == live.tracks
    assert (again.pattern.ways == live.pattern.ways).all()
