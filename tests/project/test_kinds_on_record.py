"""What a streak is, and how the frame cuts it, goes on record and is read of older sessions too."""

import json
import sqlite3
from contextlib import closing
from dataclasses import fields, replace

import pytest

from rsoconsole.config import Config
from rsoconsole.reasons import NotAStreak
from rsoconsole.records import Detection, Detections, Rejection
from rsoconsole.session.log.codec import decode, encode
from rsoconsole.session.reading.reader import SessionReader
from rsoconsole.session.writing.writer import SessionWriter
from tests.makers import straight_detection as detection

NEW = {
    "kind",
    "sigma_angle_deg",
    "object_class",
    "class_probability",
    "modulation_period_px",
    "modulation_period_s",
    "modulation_depth",
    "train",
}


def found(*streaks: Detection) -> Detections:
    rejected = tuple(Rejection(detection=s, reason=NotAStreak(kind="no line")) for s in streaks)
    return Detections(
        frame_id=1, width_px=1000, height_px=800, detections=streaks, rejected=rejected
    )


def as_before(body: str) -> str:
    """A record as it was written before streaks had kinds and classes."""
    fields = json.loads(body)
    streaks = [*fields["detections"], *(each["detection"] for each in fields["rejected"])]
    for streak in streaks:
        for name in NEW:
            del streak[name]
    return json.dumps(fields)


def test_what_the_frame_cuts_is_never_called_whole() -> None:
    assert detection(is_clipped=True).kind == "clipped"
    assert detection(is_clipped=True, kind="crossing").kind == "crossing"
    assert detection(kind="crossing").is_clipped
    assert (detection().kind, detection().is_clipped) == ("streak", False)
    assert replace(detection(), is_clipped=True).kind == "clipped"


def test_every_field_comes_back_from_the_record() -> None:
    told = found(
        detection(
            kind="crossing",
            sigma_angle_deg=0.1,
            object_class="aircraft",
            class_probability=0.83,
            modulation_period_px=14.25,
            modulation_period_s=0.5,
            modulation_depth=0.7,
            train=4,
        )
    )
    kind, _, body = encode(told)
    assert decode(kind, body) == told
    assert {field.name for field in fields(Detection)} >= NEW


@pytest.mark.parametrize("is_clipped", [False, True])
def test_an_older_record_says_by_its_flag_what_kind_it_was(is_clipped: bool) -> None:
    kind, _, body = encode(found(detection(is_clipped=is_clipped)))
    read = decode(kind, as_before(body))
    assert isinstance(read, Detections)
    for streak in (*read.detections, *(each.detection for each in read.rejected)):
        assert streak.kind == ("clipped" if is_clipped else "streak")
        assert (streak.object_class, streak.class_probability) == ("undetermined", 1.0)
        assert (streak.modulation_period_px, streak.train) == (None, 0)


def test_an_older_session_shows_the_same_by_sql(tmp_path) -> None:
    writer = SessionWriter.create(tmp_path / "old", Config(), {"title": "old"})
    writer.append(found(detection(), detection(is_clipped=True)), 1)
    writer.close()
    with closing(sqlite3.connect(tmp_path / "old" / "session.db")) as connection, connection:
        ((body,),) = connection.execute("SELECT body FROM log WHERE kind = 'Detections'")
        connection.execute("UPDATE log SET body = ? WHERE kind = 'Detections'", [as_before(body)])
    reader = SessionReader(tmp_path / "old")
    for view in ("detections", "rejections"):
        rows = reader.view(view)
        assert [row["kind"] for row in rows] == ["streak", "clipped"]
        assert {row["object_class"] for row in rows} == {"undetermined"}
        assert {(row["class_probability"], row["train"]) for row in rows} == {(1.0, 0)}
        assert {row["modulation_period_s"] for row in rows} == {None}
