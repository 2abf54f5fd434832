"""The session that is shipped: whole, small, and of nobody's machine."""

import re
from pathlib import Path

import pytest

from rsoconsole.instruments.frame_files import read_frame
from rsoconsole.pipeline.replay import replay
from rsoconsole.records import Detections, FrameTaken, Measurement
from rsoconsole.session.reader import SessionReader
from rsoconsole.vision.confidence import ConfidenceCurve
from rsoconsole.vision.detector import StreakDetector
from rsoconsole.vision.network import Network

SAMPLE = Path(__file__).parent.parent / "sessions" / "intelsat-14"
MOST_BYTES = 10_000_000
SAME_PX = 0.01


@pytest.fixture(scope="module")
def reader() -> SessionReader:
    return SessionReader(SAMPLE)


def test_it_is_small_and_names_no_machine():
    paths = [path for path in SAMPLE.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in paths) <= MOST_BYTES
    named = re.compile(rb"/(home|root|tmp|work|Users)/")
    for path in (SAMPLE / "session.db", SAMPLE / "config.toml"):
        assert not named.search(path.read_bytes()), path


def test_every_frame_has_its_picture_and_one_has_all_its_pixels(reader: SessionReader):
    frames = [r.frame_id for _, _, r in reader.records(kinds=(FrameTaken,))]
    assert frames == list(range(1, 23))
    assert all(reader.preview_path(number) is not None for number in frames)
    kept = [number for number in frames if reader.frame_path(number) is not None]
    assert kept == [9]
    missing = [row for row in reader.view("frames") if row["file"] is None]
    assert {row["not_kept_because"] for row in missing} == {"left out of the sample"}


def test_the_kept_frame_shows_what_was_recorded_of_it(reader: SessionReader):
    path = reader.frame_path(9)
    assert path is not None
    frame = read_frame(path, 9)
    (recorded,) = [
        r.detections for _, _, r in reader.records(kinds=(Detections,)) if r.frame_id == 9
    ]
    settings = reader.config().detector
    network = Network.load(settings.model, settings.threads)
    curve = ConfidenceCurve.from_card(network.card)
    found = StreakDetector(network, settings, curve).detect(frame).detections
    assert len(found) == len(recorded) == 1
    assert (found[0].x_px, found[0].y_px) == pytest.approx(
        (recorded[0].x_px, recorded[0].y_px), abs=SAME_PX
    )


def test_its_track_is_followed_again_on_any_processor(reader: SessionReader):
    records = [record for _, _, record in reader.records()]
    frames = list(replay(records, reader.config()))
    assert len(frames) == 22
    assert all(frame.is_alike for frame in frames)
    assert frames[-1].after.state == "TRACK"
    assert sum(isinstance(r, Measurement) for r in records) >= 18
