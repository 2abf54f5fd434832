"""Lines of the log for the operator: one for each event, none for routine records."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

from rsoconsole.control import (
    IN_ENGINE,
    Arm,
    BeginMark,
    Disarm,
    MarkByHand,
    Note,
    Resume,
    Seek,
    Set,
    Stop,
    add_time_origin,
    command_words,
    one_line,
)
from rsoconsole.records import (
    DONE,
    CauseKind,
    Detections,
    Event,
    Identified,
    Miss,
    Missed,
    NotFollowed,
    NotSolved,
    OperatorAction,
    ParameterChange,
    Record,
    StateChange,
    Topic,
)
from rsoconsole.words import (
    catalogued_name,
    decision_text,
    match_separation_words,
    notable_streaks_words,
    short_figure,
    text,
    tracks_words,
    utc_text,
)

Level = Literal["info", "good", "warning", "alarm"]

OF_ALARMS: frozenset[CauseKind] = frozenset(
    ("instrument", "not pointing", "limit met", "too many limits", "night ended", "clock set")
)
"""Causes of a change of state that an alarm has already named before the change."""
SHOWN_BY_CHANGE: Mapping[str, CauseKind] = {
    Arm.verb: "armed",
    Disarm.verb: "disarmed",
    Resume.verb: "resumed",
    Seek.verb: "looked for again",
}
"""Cause of the change of state that shows a command's success, by the command's verb."""
_CONSOLE = re.compile(r"\bconsole (?=\S+@)")


@dataclass(frozen=True, slots=True, kw_only=True)
class LogLine:
    """One line of the log; fields that do not apply to its record are empty."""

    t_utc_ns: int
    frame_id: int | None
    level: Level
    text: str
    kind: str = ""
    """Name of the class of its record."""
    seq: int = 0
    """Place of its record in the log, counted from 1."""
    times: int = 1
    """Number of records that the line stands for."""
    turns: int = 1
    """Number of switches of the aim between filter and orbit that the line stands for."""
    since_utc_ns: int | None = None
    """Time of the first of these switches, UTC nanoseconds; None where there is only one."""
    asked: str = ""
    """Sender and text of a command, without its outcome; empty: the record is no command."""
    topic: Topic = ""
    """Topic of an event; empty: the record is no event."""
    missed: Missed | None = None
    """Reason of a miss; None: the record is no miss."""
    not_taken: str = ""
    """Kind of the reason why a measurement was not accepted; empty: no such record."""
    is_of_miss: bool = False
    is_wanted: bool = False
    """True for a change of state that the operator caused: to search again, or by a decision."""
    is_accepted: bool = False
    """True for a command that was accepted and whose outcome is still to come."""
    is_of_alarm: bool = False
    """True for a miss or a change of state whose cause an alarm has named just before."""
    change: tuple[str, ...] = ()
    """State before, state after, kind of the cause, kind of the miss; empty: no change of state."""
    cause: CauseKind | Literal[""] = ""
    """Cause of a change of state; for a command, the cause of the change that shows its success."""
    refused_by: str = ""
    """Operator whose command was refused; empty: the record is no refusal."""
    marked_by: str = ""
    """Operator whose mark by hand is used as a measurement; empty: the record is no such mark."""
    setting: str = ""
    """Setting that a record or a command changes, by dotted name; empty: none."""
    tracks: tuple[int, ...] = ()
    """Ids of the tracks that the line is about, where several are followed."""
    words: str = ""
    """Text of the line without the tracks, operator and level that precede it."""

    @property
    def text_with_count(self) -> str:
        """Text of the line, with the number of records where it stands for several."""
        return f"{self.text} ({self.times} times)" if self.times > 1 else self.text

    def with_tracks(self, tracks: tuple[int, ...]) -> "LogLine":
        """Return the line with the names of these tracks in front of its words."""
        return replace(self, tracks=tracks, text=f"{tracks_words(tracks)}: {self.words}")


def without_console(text: str) -> str:
    """Remove the word "console" before an operator's name."""
    return _CONSOLE.sub("", text)


def rejected_words(found: Detections | None, tau: float) -> str:
    """Describe the likeliest rejected streak with confidence tau or more; empty: there is none."""
    rejected = () if found is None else found.rejected
    likely = [each for each in rejected if each.detection.confidence >= tau]
    if not likely:
        return ""
    best = max(likely, key=lambda each: each.detection.confidence)
    confidence = short_figure(best.detection.confidence)
    return f"a streak of confidence {confidence} was left out: {text(best.reason)}"


def line_of(
    record: Record, t_utc_ns: int, beside: str = "", *, is_one_of_several: bool = False
) -> LogLine | None:
    """Return the log line of a record; None for a routine record.

    ``beside``: words to append; ``is_one_of_several``: True where several tracks are followed, so
    that the line names its track.
    """
    words = _words(record)
    if words is None:
        return None
    # Control characters would reach the terminal, no matter who wrote them.
    before = one_line(words[1])
    said = one_line(f"{words[2]}; {beside}" if beside else words[2])
    cause = record.reason if isinstance(record, StateChange) else None
    kind: CauseKind | Literal[""] = cause.kind if cause is not None else ""
    frame_id = getattr(record, "frame_id", None) or None
    action = record if isinstance(record, OperatorAction) else None
    line = LogLine(
        t_utc_ns=t_utc_ns,
        frame_id=frame_id,
        level=words[0],
        text=before + said,
        words=said,
        kind=type(record).__name__,
        missed=record.reason if isinstance(record, Miss) else None,
        not_taken=record.reason.kind if isinstance(record, NotFollowed) else "",
        topic=record.topic if isinstance(record, Event) else "",
        is_of_miss=kind in {"missed", "instrument"},
        is_wanted=kind in {"looked for again", "operator's word"},
        asked=f"{action.by} {command_words(action.verb, action.arguments)}" if action else "",
        is_accepted=action is not None and action.outcome.kind == "accepted",
        is_of_alarm=_is_of_alarm(record),
        change=_change_of(record),
        cause=_cause_of(action) if action else kind,
        refused_by=action.by if action and action.outcome.kind == "refused" else "",
        marked_by=action.by if action and _is_used_mark(action) else "",
        setting=record.name if isinstance(record, ParameterChange) else _setting_of(action),
    )
    track_id = record.track_id if isinstance(record, Miss | NotFollowed | Identified) else None
    return line if track_id is None or not is_one_of_several else line.with_tracks((track_id,))


def _change_of(record: Record) -> tuple[str, ...]:
    if not isinstance(record, StateChange):
        return ()
    missed = record.reason.missed
    why = missed.kind if missed is not None else ""
    return record.before, record.after, record.reason.kind, why


def _is_used_mark(action: OperatorAction) -> bool:
    return action.verb == MarkByHand.verb and action.outcome.sigma_arcsec is not None


def _cause_of(action: OperatorAction) -> CauseKind | Literal[""]:
    """Return the cause of the change of state that says as much as the command itself."""
    if action.outcome.kind != "done" or action.arguments.get("override"):
        return ""
    return SHOWN_BY_CHANGE.get(action.verb, "")


def _is_of_alarm(record: Record) -> bool:
    is_miss = isinstance(record, Miss) and record.reason.kind == "instrument"
    return is_miss or (isinstance(record, StateChange) and record.reason.kind in OF_ALARMS)


def _setting_of(action: OperatorAction | None) -> str:
    """Return the setting that a command has changed for good; empty: none."""
    if action is None or action.verb != Set.verb or action.outcome.kind != "done":
        return ""
    return "" if action.arguments.get("frames") else str(action.arguments.get("name", ""))


def _words(record: Record) -> tuple[Level, str, str] | None:  # noqa: PLR0911 -- one case a kind
    """Return level, prefix of the words, and words; None for routine kinds."""
    match record:
        case StateChange():
            return _of_state(record)
        case Miss():
            return "warning", "", f"miss: {text(record.reason)}"
        case NotSolved():
            return "warning", "", f"not plate-solved: {record.reason}"
        case NotFollowed():
            said = text(record.reason)
            is_set_aside = record.reason.kind == "not chosen"
            return "info", "", f"{'automatic measurement' if is_set_aside else 'not taken:'} {said}"
        case Event():
            prefix = {"info": "", "warning": "warning: ", "alarm": "ALARM: "}[record.level]
            # A turn between two that promise the same is no news.
            is_news = record.topic != "close predictor"
            return (record.level, prefix, record.text) if is_news else None
        case Identified():
            return _of_identified(record)
        case Detections():
            said = notable_streaks_words(record.detections)
            return ("info", "", f"detected: {said}") if said else None
        case OperatorAction(verb=BeginMark.verb) if record.outcome.kind == "done":
            return None
        case OperatorAction():
            return _of_action(record)
        case ParameterChange():
            by = f"{without_console(record.by)}: "
            return "info", by, f"{record.name} {record.before} → {record.after}"
        case _:
            return None


def _of_state(record: StateChange) -> tuple[Level, str, str]:
    levels: dict[str, Level] = {
        "TRACK": "good",
        "COAST": "warning",
        "LOST": "warning",
        "FAULT": "alarm",
    }
    why = without_console(text(record.reason))
    return levels.get(record.after, "info"), "", f"{record.before} → {record.after}: {why}"


def _of_identified(record: Identified) -> tuple[Level, str, str]:
    said = f"{record.verdict}: {record.reason}"
    if record.verdict == "identified" and record.matches:
        best, *others = record.matches
        name = catalogued_name(best.name, best.norad_id)
        said = f"identified: {name}, {match_separation_words(best)} off"
        if others:
            then = others[0]
            said += f"; then {then.name or then.norad_id} at {match_separation_words(then)}"
    if record.hint:
        return "warning", "", f"{said}; {record.hint}"
    return "good" if record.verdict == "identified" else "info", "", said


def _of_action(record: OperatorAction) -> tuple[Level, str, str]:
    if record.verb == Note.verb:
        return "good", "NOTE: ", str(record.arguments.get("text", ""))
    by, result = f"{without_console(record.by)}: ", record.outcome
    if record.verb == Stop.verb:
        said = add_time_origin(text(result), result.stop_ordered_ms, IN_ENGINE)
        is_at_rest = result.stop_outcome in ("stands", "tracks")
        return "good" if is_at_rest else "alarm", by, f"STOP: {said}"
    if _is_used_mark(record):
        return "good", by, f"mark in frame {result.frame_id} is {decision_text(result)}"
    wanted = command_words(record.verb, record.arguments)
    return "warning" if result.kind == "refused" else "info", by, f"{wanted}{_came_of(record)}"


def _came_of(record: OperatorAction) -> str:
    result = record.outcome
    if result == DONE:
        return ""
    if result.kind == "ruled" and result.frame_id == record.arguments.get("frame"):
        return f": {decision_text(result)}"
    return f": {text(result)}"


LOOK_BACK_LINES = 6
"""Number of last lines searched for an accepted command or an earlier switch of the aim."""
FOLLOWED_AGAIN_LINES = 100
"""Number of last lines searched for changes of state of a frame that is processed again."""


def append_line(log: list[LogLine], line: LogLine) -> None:
    """Add a line to the log, or merge it with earlier lines that say the same.

    Merged into one line are:

    - refusals of measurements in one frame;
    - successive misses for the same reason;
    - successive frames that were not plate-solved, or lay in cloud;
    - successive refusals of measurements for the same reason, with the numbers of all tracks;
    - switches of the aim between orbit and filter.

    A change of state replaces the miss and the alarm that led to it, and a command's outcome
    replaces its acceptance. A change of state that repeats when its frame is processed again is
    left out.
    """
    if line.kind != "StateChange" or not _is_repeated(log, line):
        _append_news(log, line)
    elif line.is_of_miss and log[-1].kind == "Miss" and log[-1].frame_id == line.frame_id:
        del log[-1]


def _append_news(log: list[LogLine], line: LogLine) -> None:
    if line.topic == "predictor":
        line = _with_turns_before(log, line)
    if log and _explains(line, log[-1]):
        del log[-1]
    if log and _goes_on(log[-1], line):
        log[-1] = _both(log[-1], line)
        return
    last = log[-1] if log and log[-1].frame_id == line.frame_id else None
    if line.kind == "OperatorAction":
        _forget_acceptance(log, line)
        if _is_implied(log, line):
            return
    elif last is not None and last.kind == line.kind == "NotFollowed":
        log[-1] = _of_both(replace(last, times=last.times + 1), line)
        return
    elif line.kind == "Miss" and line.is_of_alarm and _is_alarm(last):
        return
    elif line.kind == "StateChange" and line.is_of_alarm and _is_alarm(last):
        assert last is not None
        said = f"{line.change[0]} → {line.change[1]}: {last.words}"
        log[-1] = replace(line, text=said, words=said, level="alarm", topic=last.topic)
        return
    elif (
        last is not None
        and (last.kind, line.kind) == ("Miss", "StateChange")
        and line.is_of_miss
        and len(last.tracks) < 2  # the state is the lead's alone
    ):
        log[-1] = line
        return
    log.append(line)


def _is_repeated(log: list[LogLine], line: LogLine) -> bool:
    """Return True if the last change of state of its frame says the same."""
    if line.frame_id is None:
        return False
    for before in reversed(log[-FOLLOWED_AGAIN_LINES:]):
        if before.kind == "StateChange" and before.frame_id == line.frame_id:
            return before.change == line.change
    return False


def _with_turns_before(log: list[LogLine], line: LogLine) -> LogLine:
    """Return the newest change of the aim merged with one just before it, which is removed."""
    for index in range(max(len(log) - LOOK_BACK_LINES, 0), len(log)):
        if log[index].topic == "predictor":
            before = log.pop(index)
            turns = before.turns + 1
            since = before.since_utc_ns or before.t_utc_ns
            said = f"{line.words} ({turns} turns since {utc_text(since, 'minute', '')})"
            return replace(line, text=said, turns=turns, since_utc_ns=since)
    return line


def _both(last: LogLine, line: LogLine) -> LogLine:
    """Merge two lines that say the same: of one track in another frame, or of another track."""
    is_another_frame = last.frame_id != line.frame_id or not line.tracks
    return _of_both(replace(line, times=last.times + is_another_frame), last)


def _of_both(line: LogLine, other: LogLine) -> LogLine:
    """Return the line with the tracks of both."""
    tracks = tuple(sorted({*line.tracks, *other.tracks}))
    return line.with_tracks(tracks) if tracks else line


def _goes_on(last: LogLine, line: LogLine) -> bool:
    """Return True if a line repeats the last one for a further frame or track, for one reason."""
    if line.kind == "NotSolved":
        return last.kind == line.kind
    if line.missed is not None:
        return _why(last.missed) == _why(line.missed)
    return bool(line.not_taken) and last.not_taken == line.not_taken


def _explains(line: LogLine, last: LogLine) -> bool:
    """Return True if a miss in cloud replaces the last line: its frame was not plate-solved."""
    is_of_it = last.kind == "NotSolved" and last.frame_id == line.frame_id and last.times == 1
    return is_of_it and line.missed is not None and bool(line.missed.hidden_by)


def _why(missed: Missed | None) -> object:
    """Return a miss's reason without figures, for comparison."""
    if missed is None:
        return None
    hidden = tuple(each.kind for each in missed.hidden_by)
    return missed.kind, missed.detail, hidden, missed.lost


def _is_alarm(line: LogLine | None) -> bool:
    return line is not None and line.kind == "Event" and line.level == "alarm"


def _forget_acceptance(log: list[LogLine], line: LogLine) -> None:
    """Drop the line of a command's acceptance: its outcome says so."""
    for index in range(max(len(log) - LOOK_BACK_LINES, 0), len(log)):
        if log[index].is_accepted and log[index].asked == line.asked:
            del log[index]
            return


def _is_implied(log: list[LogLine], line: LogLine) -> bool:
    """Return True if one of the last lines shows a command's effect: on a setting, or the state."""
    return any(
        (before.kind == "ParameterChange" and line.setting and before.setting == line.setting)
        or (before.kind == "StateChange" and line.cause and before.cause == line.cause)
        for before in log[-2:]
    )
