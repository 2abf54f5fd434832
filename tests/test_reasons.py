"""Reasons are kinds with figures: what they are worded as decides nothing."""

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rsoconsole import reason_text
from rsoconsole.console.alerts import alerts_between
from rsoconsole.console.engine_view import EngineView
from rsoconsole.console.night import Night
from rsoconsole.pipeline.recorded_frames import recorded_frames
from rsoconsole.pipeline.replay import replay
from rsoconsole.pipeline.retell import retell
from rsoconsole.pipeline.what_if import what_if
from rsoconsole.reasons import Cause, Missed, NotTaken, Told
from rsoconsole.records import Event, Miss, NotFollowed, StateChange
from rsoconsole.session import old_reasons
from rsoconsole.session.codec import decode, encode
from rsoconsole.session.reader import SessionReader
from rsoconsole.session.writer import SessionWriter
from tests.old_nights import CONFIG, old_session

TRIED: tuple[dict[str, float | str], ...] = (
    {},
    {"detector.tau": 0.01},
    {"filter.gate_nis": 3.0},
    {"exposure.header_latency_s": 0.7},
)


OF_FOLD = {"waiting", "two frames agree", "measured again", "missed"}
"""Causes that the fold itself finds: a replay finds them again, detail and all."""


@pytest.fixture(params=["busy", "ruled"])
def night(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A session of today, with all that was recorded in an old one."""
    old = SessionReader(old_session(tmp_path / "old", request.param))
    writer = SessionWriter.create(tmp_path / "night", CONFIG, {})
    for _, t_utc_ns, record in old.records():
        writer.append(record, t_utc_ns)
    writer.close()
    assert writer.faults == ()
    return tmp_path / "night"


@pytest.fixture
def nonsense(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every reason is worded as something else, each time it is asked for."""
    numbers = itertools.count()

    def said(_: Any) -> str:
        return f"gibberish {next(numbers)}"

    monkeypatch.setattr(reason_text, "text", said)
    for module in _modules_that_word():
        monkeypatch.setattr(module, "text", said)


def _modules_that_word() -> Iterator[Any]:
    import sys

    for name, module in list(sys.modules.items()):
        if name.startswith("rsoconsole.") and getattr(module, "text", None) is reason_text.text:
            yield module


def records_of(folder: Path) -> list[Any]:
    return [record for _, _, record in SessionReader(folder).records()]


def decided(folder: Path) -> dict[str, Any]:
    """All that a program makes of a session by looking at why things came to pass."""
    log = [(t_utc_ns, record) for _, t_utc_ns, record in SessionReader(folder).records()]
    records = [record for _, record in log]
    return {
        "replay": [
            (f.taken.frame_id, f.state, f.after, f.is_as_recorded) for f in replay(records, CONFIG)
        ],
        "recorded": [(f.taken.frame_id, f.state, len(f.records)) for f in recorded_frames(records)],
        "what-if": [what_if(records, CONFIG, tried) for tried in TRIED],
        "retold": [
            [type(record).__name__ for _, record in retell(log, CONFIG, tried=tried).log]
            for tried in TRIED
        ],
        "alarms": alarms(folder, log),
    }


def alarms(folder: Path, log: list[tuple[int, Any]]) -> list[tuple[int, str]]:
    """(place in the log, alert): after every record the seat looks."""
    night = Night(folder, {}, CONFIG)
    night.has_been_read()
    engine = EngineView(reach="attached")
    rung: list[tuple[int, str]] = []
    before = night.view()
    for seq, (t_utc_ns, record) in enumerate(log, start=1):
        night.take(t_utc_ns, record, seq)
        if isinstance(record, StateChange | Event):
            after = night.view()
            found = alerts_between((before, engine), (after, engine))
            rung += [(seq, alert) for alert, _ in found]
            before = after
    return rung


def garbled(record: Any) -> Any:
    """The record with other words wherever words are free."""
    import dataclasses

    match record:
        case Event():
            return dataclasses.replace(record, text="qwertz")
        case StateChange(reason=Cause() as cause) if cause.kind not in OF_FOLD:
            other = dataclasses.replace(cause, by="yxcv", detail="asdf")
            return dataclasses.replace(record, reason=other)
        case Miss(reason=Missed(kind="instrument") as missed):
            return dataclasses.replace(
                record, reason=dataclasses.replace(missed, detail="uiop", hidden_by="jkl")
            )
    return record


def test_other_words_change_no_replay_no_alarm_and_no_what_if(
    night: Path, nonsense: None, request: pytest.FixtureRequest
) -> None:
    with_nonsense = decided(night)
    request.getfixturevalue("monkeypatch").undo()
    assert with_nonsense == decided(night)


def test_what_was_said_beside_the_kinds_changes_nothing_either(night: Path, tmp_path: Path) -> None:
    as_it_was = decided(night)
    writer = SessionWriter.create(tmp_path / "garbled", CONFIG, {})
    for _, t_utc_ns, record in SessionReader(night).records():
        writer.append(garbled(record), t_utc_ns)
    writer.close()
    assert decided(tmp_path / "garbled") == as_it_was


def test_a_night_of_today_comes_again_bit_for_bit(night: Path) -> None:
    frames = list(replay(records_of(night), CONFIG))
    assert len(frames) > 20
    assert all(frame.is_as_recorded for frame in frames)
    assert any(rung for rung in decided(night)["alarms"])


def test_the_text_in_the_log_is_for_people_and_is_not_read_back() -> None:
    gate = NotTaken.by_gate(18.234, 11.83)
    miss = Miss(frame_id=1, reason=Missed(kind="no detection", hidden_by="cloud"))
    kind, _, body = encode(miss)
    assert '"text":"cloud; no detection"' in body
    assert decode(kind, body.replace("cloud; no detection", "asdf")) == miss
    assert (gate.nis, gate.limit) == (18.2, 11.8)


def test_the_view_says_reasons_as_text(night: Path) -> None:
    reader = SessionReader(night)
    for view, kind in (("misses", Miss), ("not_followed", NotFollowed), ("states", StateChange)):
        said = [row["reason"] for row in reader.view(view)]
        told = [reason_text.text(r.reason) for _, _, r in reader.records(kinds=(kind,))]  # type: ignore[union-attr]
        assert said == told
        assert len(said) > 3


def test_every_old_sentence_of_the_fold_is_understood(tmp_path: Path) -> None:
    """What it means is told again in the very words it was told in."""
    understood = 0
    for name in ("busy", "ruled"):
        for record in records_of(old_session(tmp_path / name, name)):
            if isinstance(record, StateChange | Miss):
                assert not isinstance(record.reason, Told), record
                understood += 1
    assert understood > 60


@pytest.mark.parametrize(
    ("words", "read"),
    [
        ("NIS 18.2 above the gate 11.8", old_reasons.not_taken),
        ("another one leads", old_reasons.not_taken),
        ("cloud: 12 stars where 200 were; no detection", old_reasons.missed),
        ("slew refused: a; b; nothing fits the prediction; coasted for 5 min", old_reasons.missed),
        ("detected, but not solved: 7 stars; 8 needed", old_reasons.missed),
        ("confidence 0.05 below tau 0.10", old_reasons.rejected),
        ("limit met: altitude 14.9 deg, 15 at least", old_reasons.cause),
        ("looked for again by console a@b", old_reasons.cause),
        ("the clock was set by -3.5 s", old_reasons.cause),
        ("2 detections, waiting for a second frame", old_reasons.cause),
        ("console a@b moves the mount", old_reasons.cause),
        ("altitude 3 deg; move away by hand or park, then arm again", old_reasons.cause),
        ("the night ends: dawn", old_reasons.cause),
        ("no detection; 3 sigma of 70 arcmin no longer fits the field", old_reasons.cause),
    ],
)
def test_an_old_sentence_becomes_a_kind_that_says_the_same(words: str, read: Any) -> None:
    reason = read(words)
    assert not isinstance(reason, Told)
    assert reason_text.text(reason) == words


def test_what_no_version_has_written_stays_as_it_was() -> None:
    readers = (old_reasons.not_taken, old_reasons.missed, old_reasons.rejected, old_reasons.cause)
    assert {read("so") for read in readers} == {Told(words="so")}
