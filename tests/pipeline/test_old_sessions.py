"""Sessions of schema 1 to 3: opened, replayed and exported as before, under the ids of today."""

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rsoconsole.export.night import read_night
from rsoconsole.instruments.frames.frame_files import read_frame
from rsoconsole.pipeline.cycle.track_assignment import TracksTaken
from rsoconsole.pipeline.replay.refold import replay
from rsoconsole.pipeline.replay.rewrite_log import rewrite_log
from rsoconsole.records import (
    Detections,
    FollowedAgain,
    Measurement,
    NotFollowed,
    OrbitEstimate,
    Ruling,
    SlewCommand,
    TrackState,
)
from rsoconsole.session.reading.reader import SessionReader
from rsoconsole.vision.detector.confidence import ConfidenceCurve
from rsoconsole.vision.detector.detector import StreakDetector
from rsoconsole.vision.detector.network import Network
from tests.nights.old_nights import old_session
from tests.nights.samples import SCHEMA_1

EXPORTED = {
    "sample": "bdb56fdc2414f35eb29f450c312bb7e5c0b351216b2e90b12dd67cba7f84abd9",
    "busy": "c44c9fea822a0d5a7f3564f1a5f84d05f17f9f85c99b4512c761ba802697e064",
}
"""SHA-256 of the rows that the last version of schema 3 exported."""
AS_EVER = (("is_crossing", False), ("object_class", "undetermined"))


@pytest.fixture(params=["sample", "busy", "ruled"])
def old(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    if request.param == "sample":
        return SCHEMA_1
    return old_session(tmp_path / request.param, request.param)


def log_of(folder: Path) -> list[tuple[int, Any]]:
    return [(t_utc_ns, record) for _, t_utc_ns, record in SessionReader(folder).records()]


def records_of(folder: Path) -> list[Any]:
    return [record for _, record in log_of(folder)]


def test_every_record_of_the_fold_comes_again_but_for_another_processors_rounding(
    old: Path,
) -> None:
    frames = list(replay(records_of(old), SessionReader(old).config()))
    assert len(frames) > 20
    assert all(frame.is_alike for frame in frames)


def test_told_again_with_nothing_tried_it_is_the_log_itself(old: Path) -> None:
    log = log_of(old)
    told = rewrite_log(log, SessionReader(old).config()).log
    assert [record for _, record in told] == [record for _, record in log]


@pytest.mark.parametrize("name", EXPORTED)
def test_what_it_exports_is_what_it_exported_before(name: str, tmp_path: Path) -> None:
    folder = SCHEMA_1 if name == "sample" else old_session(tmp_path / name, name)
    found = read_night(folder).rows
    # Columns that are new since are as of a whole streak of which nobody said what it is.
    assert {row.beside for row in found} == {AS_EVER}
    rows = repr(tuple(replace(row, beside=()) for row in found)).replace(", beside=()", "")
    assert hashlib.sha256(rows.encode()).hexdigest() == EXPORTED[name]


@pytest.mark.parametrize("schema", [1, 2])
def test_all_old_schemas_are_read_alike(schema: int, tmp_path: Path) -> None:
    third = old_session(tmp_path / "third", "ruled")
    earlier = old_session(tmp_path / "earlier", "ruled", schema)
    assert records_of(earlier) == records_of(third)


def test_every_measurement_has_an_id_of_its_own_and_every_update_names_one(old: Path) -> None:
    records = records_of(old)
    made = [r for r in records if isinstance(r, Measurement)]
    ids = {m.measurement_id for m in made}
    assert len(ids) == len(made)
    for record in records:
        match record:
            case TrackState(kind="predicted"):
                assert record.measurement_id is None
            case TrackState():
                assert record.measurement_id in ids
                assert (record.begun_with is not None) == (record.kind == "initial")
                assert set(record.begun_with or ()) <= ids
            case NotFollowed():
                assert record.measurement in made
            case Ruling():
                assert all(m.measurement_id in ids for m in record.refused)


def test_tracks_are_numbered_in_the_order_in_which_they_began(old: Path) -> None:
    tracks = TracksTaken()
    for record in records_of(old):
        tracks.receive(record)
    found = tracks.tracks()
    assert [track.track_id for track in found] == list(range(1, len(found) + 1))
    assert all(len(track.measurements) > 1 for track in found)


def test_what_was_taken_was_not_refused_in_the_same_breath(old: Path) -> None:
    refused: set[str] = set()
    for record in records_of(old):
        match record:
            case FollowedAgain():
                refused.clear()
            case NotFollowed():
                refused.add(record.measurement.measurement_id)
            case TrackState():
                refused.clear()
                assert record.measurement_id not in refused


def test_orders_and_orbits_name_the_track_they_are_of() -> None:
    records = records_of(SCHEMA_1)
    followed = [r for r in records if isinstance(r, SlewCommand) and r.reason == "prediction"]
    assert followed
    assert {r.track_id for r in followed} == {1}
    assert {r.track_id for r in records if isinstance(r, OrbitEstimate)} <= {1}


def test_one_frame_alone_is_read_under_the_same_ids(old: Path) -> None:
    reader = SessionReader(old)
    whole = [r for _, _, r in reader.records() if getattr(r, "frame_id", None) == 12]
    assert [r for _, _, r in SessionReader(old).records(frame_id=12)] == whole
    only = [r for _, _, r in SessionReader(old).records(kinds=(TrackState,), frame_id=12)]
    assert only == [r for r in whole if isinstance(r, TrackState)]


def test_the_kept_frame_of_schema_1_shows_what_was_recorded_of_it() -> None:
    reader = SessionReader(SCHEMA_1)
    kept = [n for n in range(1, 23) if reader.frame_path(n) is not None]
    assert kept == [9]
    path = reader.frame_path(9)
    assert path is not None
    (recorded,) = [r for r in records_of(SCHEMA_1) if isinstance(r, Detections) and r.frame_id == 9]
    settings = reader.config().detector
    network = Network.load(settings.model, settings.threads)
    curve = ConfidenceCurve.from_card(network.card)
    (found,) = StreakDetector(network, settings, curve).detect(read_frame(path, 9)).detections
    (before,) = recorded.detections
    assert (found.x_px, found.y_px) == pytest.approx((before.x_px, before.y_px), abs=0.01)


def test_the_track_of_schema_1_is_followed_again_on_any_processor() -> None:
    records = records_of(SCHEMA_1)
    frames = list(replay(records, SessionReader(SCHEMA_1).config()))
    assert len(frames) == 22
    assert all(frame.is_alike for frame in frames)
    assert frames[-1].after.state == "TRACK"
    assert sum(isinstance(r, Measurement) for r in records) >= 18
