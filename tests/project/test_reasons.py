"""Reasons are kinds with figures: what they are worded as decides nothing."""

import ast
import dataclasses
import functools
import itertools
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from rsoconsole import words as said_by
from rsoconsole.console.night.engine_view import EngineView, alerts_between
from rsoconsole.console.timeline.timeline import TimelineBuilder
from rsoconsole.night import Night, frames_of
from rsoconsole.pipeline import replay, what_if
from rsoconsole.records import (
    Cause,
    CommandResult,
    Event,
    FrameTaken,
    HiddenBy,
    Miss,
    Missed,
    NotFollowed,
    NotTaken,
    OperatorAction,
    SlewCommand,
    SlewRefusal,
    StateChange,
    TrackLost,
    TrackState,
)
from rsoconsole.session import SessionReader, SessionWriter, decode, encode
from tests.nights.engine_nights import CONFIG, busy, ruled
from tests.rigs.engine_rig import rig
from tests.rigs.rewritten import rewrite_log

PACKAGE = Path(said_by.__file__).parents[1]
TRIED: tuple[dict[str, float | str], ...] = (
    {},
    {"detector.tau": 0.01},
    {"filter.gate_nis": 3.0},
    {"exposure.header_latency_s": 0.7},
)


OUTCOMES = (
    CommandResult.refused("altitude 3.0 deg, 20 at least"),
    CommandResult(kind="dropped", dropped_by="STOP"),
    CommandResult(kind="failed", detail="no answer"),
    CommandResult(kind="answered", stop_ms=3.0, stop_path="mount"),
    CommandResult(kind="measured", stop_outcome="moves", stop_ms=3000.0, rate_deg_s=4.0),
)
"""What the recorded nights have not."""
OF_FOLD = {"waiting", "two frames agree", "faint frames agree", "measured again", "missed"}
"""Causes that the fold itself finds: a replay finds them again, detail and all."""


REFUSAL = SlewRefusal(kind="clock", detail="1970-01-01")
"""A refusal of which some is free words."""


@pytest.fixture(scope="module", params=["busy", "ruled", "busy, refused", "ruled, refused"])
def night(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session; "refused": as it would have been with every slew to a track refused."""
    tmp_path = tmp_path_factory.mktemp("night")
    name, _, refused = request.param.partition(", ")
    log = {"busy": busy, "ruled": ruled}[name]().log
    if refused:
        blocked = [(t_utc_ns, with_refusal(record, REFUSAL)) for t_utc_ns, record in log]
        log = list(rewrite_log(blocked, CONFIG, changes={}).log)
    writer = SessionWriter.create(tmp_path / "night", CONFIG, {})
    for t_utc_ns, record in log:
        writer.append(record, t_utc_ns)
    for outcome in OUTCOMES:
        action = OperatorAction(verb="goto", arguments={}, outcome=outcome, by="console a@b")
        writer.append(action, t_utc_ns)
    writer.close()
    assert writer.faults == ()
    return tmp_path / "night"


def with_refusal(record: Any, refusal: SlewRefusal | None) -> Any:
    return (
        dataclasses.replace(record, blocked=refusal) if isinstance(record, FrameTaken) else record
    )


@pytest.fixture
def nonsense(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every reason is worded as something else, each time it is asked for."""
    numbers = itertools.count()

    def said(_: Any) -> str:
        return f"gibberish {next(numbers)}"

    for name in ("text", "decision_text"):
        for module in _modules_that_word(name):
            monkeypatch.setattr(module, name, said)


def _modules_that_word(name: str) -> list[Any]:
    import sys

    ours = [module for known, module in sys.modules.items() if known.startswith("rsoconsole.")]
    word = getattr(said_by, name)
    return [module for module in ours if getattr(module, name, None) is word]


def records_of(folder: Path) -> list[Any]:
    return [record for _, _, record in SessionReader(folder).records()]


def decided(folder: Path) -> dict[str, Any]:
    """All that a program makes of a session by looking at why things came to pass."""
    log = [(t_utc_ns, record) for _, t_utc_ns, record in SessionReader(folder).records()]
    records = [record for _, record in log]
    return {
        "replay": [
            (f.taken.frame_id, f.after.state, f.after, f.is_as_recorded)
            for f in replay(records, CONFIG)
        ],
        "recorded": [
            (f.frame_id, f.fold.state_after, len(f.fold.records))
            for f in frames_of(records)
            if f.fold
        ],
        "what-if": [what_if(records, CONFIG, changes) for changes in TRIED],
        "retold": [
            [type(record).__name__ for _, record in rewrite_log(log, CONFIG, changes=changes).log]
            for changes in TRIED
        ],
        "alarms": alarms(folder, log),
        "log": log_lines(folder, log),
        "time line": time_line(log),
        "kinds of outcomes": [r.outcome.kind for r in records if isinstance(r, OperatorAction)],
    }


decided_once = functools.cache(decided)
"""Of a night that no test changes, with the program's own words."""


def log_lines(folder: Path, log: list[tuple[int, Any]]) -> list[tuple[Any, ...]]:
    """What the seat's log makes of every line, without its words."""
    night = Night(folder, {}, CONFIG)
    for seq, (t_utc_ns, record) in enumerate(log, start=1):
        night.fold_record(t_utc_ns, record, seq)
    return [
        (line.seq, line.kind, line.level, line.times, line.asked, line.is_accepted, line.topic)
        for line in night.view().log
    ]


def time_line(log: list[tuple[int, Any]]) -> Any:
    """What is worth a jump, and the states."""
    fold = TimelineBuilder()
    for seq, (t_utc_ns, record) in enumerate(log, start=1):
        frame_id = getattr(record, "frame_id", None)
        fold.receive(seq, t_utc_ns, type(record).__name__, frame_id, record)
    line = fold.build_timeline(len(log), is_closed=True)
    return line.events, line.states


def alarms(folder: Path, log: list[tuple[int, Any]]) -> list[tuple[int, str]]:
    """(place in the log, alert): after every record the seat looks."""
    night = Night(folder, {}, CONFIG)
    night.mark_past_read()
    engine = EngineView(reach="attached")
    rung: list[tuple[int, str]] = []
    before = night.view()
    for seq, (t_utc_ns, record) in enumerate(log, start=1):
        night.fold_record(t_utc_ns, record, seq)
        if isinstance(record, StateChange | Event):
            after = night.view()
            found = alerts_between((before, engine), (after, engine))
            rung += [(seq, alert) for alert, _ in found]
            before = after
    return rung


def garbled(record: Any) -> Any:  # noqa: PLR0911 -- one case a kind
    """The record with other words wherever words are free."""
    match record:
        case FrameTaken(blocked=SlewRefusal() as refusal):
            return with_refusal(record, dataclasses.replace(refusal, detail="zuio"))
        case Event():
            return dataclasses.replace(record, text="qwertz")
        case StateChange(reason=Cause() as cause) if cause.kind not in OF_FOLD:
            other = dataclasses.replace(cause, by="yxcv", detail="asdf")
            return dataclasses.replace(record, reason=other)
        case OperatorAction(outcome=CommandResult() as result) if result.detail:
            return dataclasses.replace(record, outcome=dataclasses.replace(result, detail="fgh"))
        case OperatorAction(outcome=CommandResult(kind="answered") as result):
            other_way = dataclasses.replace(result, stop_path="vbnm", stop_ms=9.0)
            return dataclasses.replace(record, outcome=other_way)
        case Miss(reason=Missed(kind="instrument") as missed):
            return dataclasses.replace(
                record,
                reason=dataclasses.replace(
                    missed, detail="uiop", hidden_by=(HiddenBy(kind="shadow"),)
                ),
            )
        case Miss(reason=Missed() as missed):
            return dataclasses.replace(record, reason=garbled_miss(missed))
        case StateChange(reason=Cause(missed=Missed() as missed) as cause):
            cause = dataclasses.replace(cause, missed=garbled_miss(missed))
            return dataclasses.replace(record, reason=cause)
    return record


def garbled_miss(missed: Missed) -> Missed:
    """As the fold finds it where the refusal before the frame was garbled."""
    hidden_by = tuple(
        dataclasses.replace(each, refusal=dataclasses.replace(each.refusal, detail="zuio"))
        if isinstance(each, HiddenBy) and isinstance(each.refusal, SlewRefusal)
        else each
        for each in missed.hidden_by
    )
    return dataclasses.replace(missed, hidden_by=hidden_by)


def test_other_words_change_no_replay_no_alarm_and_no_what_if(
    night: Path, nonsense: None, request: pytest.FixtureRequest
) -> None:
    with_nonsense = decided(night)
    request.getfixturevalue("monkeypatch").undo()
    assert with_nonsense == decided_once(night)


WALL = SlewRefusal.beyond("altitude", 3.0, 15.0)


def walled_night() -> list[Any]:
    """What the engine puts on record where slews are refused from the seventh frame on."""
    r = rig(set(range(1, 8)), CONFIG)
    r.engine.arm()
    r.engine.run(frames=6)
    r.engine.slews.refusal = lambda *_, **__: WALL  # type: ignore[method-assign]
    r.engine.run(frames=12)
    return [decode(*encode(record)[::2]) for record in r.memory.records]


def test_a_refused_slew_is_on_record_as_a_kind_and_replayed_bit_for_bit() -> None:
    records = walled_night()
    blocked = [r.blocked for r in records if isinstance(r, FrameTaken) and r.blocked is not None]
    assert blocked == [WALL] * 5
    hidden = [r.reason.hidden_by for r in records if isinstance(r, Miss)]  # type: ignore[union-attr]
    assert hidden == [(HiddenBy(kind="slew refused", refusal=WALL),)] * 5
    assert all(frame.is_as_recorded for frame in replay(records, CONFIG))


def test_the_engine_does_the_same_whatever_a_refusal_is_worded_as(
    nonsense: None, request: pytest.FixtureRequest
) -> None:
    with_nonsense = walled_night()
    request.getfixturevalue("monkeypatch").undo()
    plain = walled_night()
    assert [type(record) for record in with_nonsense] == [type(record) for record in plain]
    kept = Miss, FrameTaken, SlewCommand, StateChange, TrackState
    assert [r for r in with_nonsense if isinstance(r, kept)] == [
        r for r in plain if isinstance(r, kept)
    ]


def test_what_was_said_beside_the_kinds_changes_nothing_either(night: Path, tmp_path: Path) -> None:
    as_it_was = decided_once(night)
    writer = SessionWriter.create(tmp_path / "garbled", CONFIG, {})
    for _, t_utc_ns, record in SessionReader(night).records():
        writer.append(garbled(record), t_utc_ns)
    writer.close()
    assert decided(tmp_path / "garbled") == as_it_was


def test_a_night_of_today_comes_again_bit_for_bit(night: Path) -> None:
    frames = list(replay(records_of(night), CONFIG))
    assert len(frames) > 20
    assert all(frame.is_as_recorded for frame in frames)
    assert any(rung for rung in decided_once(night)["alarms"])


def test_the_nights_hold_the_reasons_that_are_worded_as_nonsense() -> None:
    """Else the tests above would show nothing of them."""
    log = [(t_utc_ns, with_refusal(r, REFUSAL)) for t_utc_ns, r in busy().log]
    misses = [r.reason for _, r in rewrite_log(log, CONFIG, changes={}).log if isinstance(r, Miss)]
    told = [each for each in misses if isinstance(each, Missed)]
    assert any(each.lost == TrackLost(kind="coasted", coasted_min=2.0) for each in told)
    hidden = [by for each in told for by in each.hidden_by]
    assert HiddenBy(kind="slew refused", refusal=REFUSAL) in hidden
    assert HiddenBy(kind="fewer stars", stars=12, usual_stars=207) in hidden


def test_the_text_in_the_log_is_for_people_and_is_not_read_back() -> None:
    gate = NotTaken.by_gate(18.234, 11.83)
    hidden_by = (HiddenBy(kind="few stars", stars=3), HiddenBy(kind="shadow"))
    miss = Miss(frame_id=1, reason=Missed(kind="no detection", hidden_by=hidden_by))
    kind, _, body = encode(miss)
    said = "only 3 stars, cloud?; eclipse: in the Earth's shadow; no detection"
    assert f'"text":"{said}"' in body
    assert decode(kind, body.replace(said, "asdf").replace("only 3 stars", "asdf")) == miss
    assert (gate.nis, gate.limit) == (18.2, 11.8)


def test_the_view_says_reasons_as_text(night: Path) -> None:
    reader = SessionReader(night)
    for view, kind in (("misses", Miss), ("not_followed", NotFollowed), ("states", StateChange)):
        said = [row["reason"] for row in reader.view_rows(view)]
        told = [said_by.text(r.reason) for _, _, r in reader.records(kinds=(kind,))]  # type: ignore[union-attr]
        assert said == told
        assert len(said) > 3


@pytest.mark.parametrize(
    ("excess_deg", "told"),
    [(0.0004, "less than 0.001"), (0.0234, "0.023"), (0.0996, "0.100"), (0.14, "0.1")],
)
def test_a_distance_from_a_limit_is_told_with_the_digits_it_takes(
    excess_deg: float, told: str
) -> None:
    refusal = SlewRefusal.beyond("altitude", 20.0 - excess_deg, 20.0)
    words = said_by.text(refusal)
    assert f" is {told} below the limit of 20.0" in words


def test_an_outcome_of_today_is_a_sentence_and_a_kind_in_sql(night: Path) -> None:
    reader = SessionReader(night)
    actions = [r for _, _, r in reader.records() if isinstance(r, OperatorAction)]
    with closing(reader.connect()) as connection:
        told = connection.execute("SELECT outcome, outcome_kind FROM actions").fetchall()
    assert told == [(said_by.text(each.outcome), each.outcome.kind) for each in actions]
    assert actions


REASONS = {
    "reason",
    "outcome",
    "detail",
    "missed",
    "hidden_by",
    "lost",
    "refusal",
    "blocked",
    "refused",
}
BY_WORDS = {"startswith", "endswith", "removeprefix", "removesuffix", "partition", "find", "index"}


def test_no_reason_is_compared_with_a_string() -> None:
    """A member of that name, or what words it, beside a literal: equal, in it, beginning so."""
    found = {
        str(path.relative_to(PACKAGE)): read
        for path in sorted(PACKAGE.rglob("*.py"))
        if (read := sentences_read(path.read_text(encoding="utf-8")))
    }
    assert found == {}, "compare the kind, not the words"


def sentences_read(source: str) -> list[str]:
    found: list[ast.AST] = []
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Compare(left=left, comparators=others):
                both = [left, *others]
                if any(map(_is_words, both)) and any(map(_is_reason, both)):
                    found.append(node)
            case ast.Call(func=ast.Attribute(value=value, attr=attr)) if attr in BY_WORDS:
                if _is_reason(value):
                    found.append(node)
            case ast.Match(subject=subject, cases=cases) if _is_reason(subject):
                patterns = (each for case in cases for each in ast.walk(case.pattern))
                if any(isinstance(p, ast.MatchValue) and _is_words(p.value) for p in patterns):
                    found.append(subject)
    return [ast.unparse(node) for node in found]


def _is_reason(node: ast.expr) -> bool:
    match node:
        case ast.Call(func=ast.Name(id="text") | ast.Attribute(attr="text")):
            return True
        case ast.Attribute(attr=name) | ast.Name(id=name):
            return name in REASONS
    return False


def _is_words(node: ast.expr) -> bool:
    if isinstance(node, ast.Tuple | ast.List | ast.Set):
        return any(map(_is_words, node.elts))
    return isinstance(node, ast.Constant | ast.JoinedStr) and not (
        isinstance(node, ast.Constant) and (not isinstance(node.value, str) or not node.value)
    )


@pytest.mark.parametrize(
    "source",
    [
        'record.outcome == "accepted"',
        'record.outcome in ("accepted", "done")',
        '"limit" in change.reason',
        'record.outcome.startswith("refused")',
        'text(record.reason).startswith("limit met")',
        "match miss.reason:\n    case 'cloud':\n        pass",
    ],
)
def test_the_search_for_sentences_finds_one(source: str) -> None:
    assert sentences_read(source)
    assert not sentences_read('record.outcome.kind == "refused" and not record.detail == ""')
