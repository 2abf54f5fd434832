"""The log in the operator's words: one line for what happened, none for what is routine."""

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
    command_words,
    counted,
    one_line,
)
from rsoconsole.records import (
    DONE,
    Cause,
    CauseKind,
    CommandResult,
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
    called,
    clock,
    off_words,
    remarkable,
    ruled_text,
    short,
    text,
    tracks_words,
)

Level = Literal["info", "good", "warning", "alarm"]

OF_ALARMS: frozenset[CauseKind] = frozenset(
    ("instrument", "not pointing", "limit met", "too many limits", "night ended", "clock set")
)
"""Causes that are said as an alarm before the state changes."""
SHOWN_BY_CHANGE: Mapping[str, CauseKind] = {
    Arm.verb: "armed",
    Disarm.verb: "disarmed",
    Resume.verb: "resumed",
    Seek.verb: "looked for again",
}
_CONSOLE = re.compile(r"\bconsole (?=\S+@)")


@dataclass(frozen=True, slots=True, kw_only=True)
class LogLine:
    """One line of the log."""

    t_utc_ns: int
    frame_id: int | None
    level: Level
    text: str
    kind: str = ""
    """The record's."""
    seq: int = 0
    """The record's number in the session, counted from 1."""
    times: int = 1
    """How many records it stands for."""
    turns: int = 1
    """How often it has turned out otherwise and back, this time among them."""
    since_utc_ns: int | None = None
    """When the first of those turns was; None where there is one."""
    asked: str = ""
    """What an operator wanted, without what came of it."""
    topic: Topic = ""
    """What an event is about."""
    missed: Missed | None = None
    """Why a frame had no measurement."""
    not_taken: str = ""
    """The kind of reason for which a measurement was not taken."""
    is_of_miss: bool = False
    """True for a change of state that a miss led to."""
    is_wanted: bool = False
    """True for a change of state by the operator's word, to look for it again or on a streak."""
    is_accepted: bool = False
    """True for a command that waits for its outcome."""
    is_of_alarm: bool = False
    """True for a miss or a change of state that an alarm just before it tells."""
    change: tuple[str, ...] = ()
    """Of a change of state: both states and why, by the kinds of its reasons."""
    cause: CauseKind | Literal[""] = ""
    """Of a change of state; of a command that is done, that of the change that says it all."""
    refused_by: str = ""
    """Whose command was refused; empty: nobody's."""
    marked_by: str = ""
    """Whose mark by hand is used; empty: nobody's."""
    setting: str = ""
    """Which setting was changed, or wanted to be."""
    tracks: tuple[int, ...] = ()
    """Whose it is, where several are followed."""
    words: str = ""
    """Its text without whose it is, who wanted it and how grave it is."""

    @property
    def whole(self) -> str:
        """Its text, and how often it is so."""
        return f"{self.text} ({self.times} times)" if self.times > 1 else self.text

    def of(self, tracks: tuple[int, ...]) -> "LogLine":
        """The same of these tracks, by their numbers."""
        return replace(self, tracks=tracks, text=f"{tracks_words(tracks)}: {self.words}")


def without_console(text: str) -> str:
    """The same, with a seat's name for the seat: everybody knows that it is a console."""
    return _CONSOLE.sub("", text)


def left_out(found: Detections | None, tau: float) -> str:
    """The likeliest streak that was seen in a frame and is no detection, and why; empty: none."""
    rejected = () if found is None else found.rejected
    likely = [each for each in rejected if each.detection.confidence >= tau]
    if not likely:
        return ""
    best = max(likely, key=lambda each: each.detection.confidence)
    confidence = short(best.detection.confidence)
    return f"a streak of confidence {confidence} was left out: {text(best.reason)}"


def line_of(
    record: Record, t_utc_ns: int, beside: str = "", *, is_one_of_several: bool = False
) -> LogLine | None:
    """The record's line; None for what is routine. ``beside``: more that is known of it.

    ``is_one_of_several``: whether more than one track is followed, so that it says whose it is.
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
        not_taken=_not_taken(record),
        topic=record.topic if isinstance(record, Event) else "",
        is_of_miss=kind in {"missed", "instrument"},
        is_wanted=kind in {"looked for again", "operator's word"},
        asked=f"{action.by} {command_words(action.verb, action.arguments)}" if action else "",
        is_accepted=action is not None and action.outcome.kind == "accepted",
        is_of_alarm=_is_of_alarm(record),
        change=_change_of(record),
        cause=_cause_of(action) if action else kind,
        refused_by=action.by if action and action.outcome.kind == "refused" else "",
        marked_by=action.by if action is not None and _is_used_mark(action) else "",
        setting=_setting_of(record),
    )
    track_id = record.track_id if isinstance(record, Miss | NotFollowed | Identified) else None
    return line if track_id is None or not is_one_of_several else line.of((track_id,))


def _change_of(record: Record) -> tuple[str, ...]:
    if not isinstance(record, StateChange):
        return ()
    missed = record.reason.missed
    why = missed.kind if missed is not None else ""
    return record.before, record.after, record.reason.kind, why


def _is_used_mark(action: OperatorAction) -> bool:
    return action.verb == MarkByHand.verb and action.outcome.sigma_arcsec is not None


def _not_taken(record: Record) -> str:
    return record.reason.kind if isinstance(record, NotFollowed) else ""


def _cause_of(action: OperatorAction) -> CauseKind | Literal[""]:
    """The cause of the change of state that says as much as the command itself."""
    if action.outcome.kind != "done" or action.arguments.get("override"):
        return ""
    return SHOWN_BY_CHANGE.get(action.verb, "")


def _is_of_alarm(record: Record) -> bool:
    match record:
        case StateChange(reason=Cause(kind=kind)):
            return kind in OF_ALARMS
        case Miss(reason=Missed(kind="instrument")):
            return True
    return False


def _setting_of(record: Record) -> str:
    match record:
        case ParameterChange():
            return record.name
        case OperatorAction(verb=Set.verb, outcome=CommandResult(kind="done")):
            lent = record.arguments.get("frames")
            return "" if lent else str(record.arguments.get("name", ""))
    return ""


def _words(record: Record) -> tuple[Level, str, str] | None:  # noqa: PLR0911 -- one case a kind
    """Level, what stands before the words, words; None for kinds that are routine."""
    match record:
        case StateChange():
            return _of_state(record)
        case Miss():
            return "warning", "", f"miss: {text(record.reason)}"
        case NotSolved():
            return "warning", "", f"not plate-solved: {record.reason}"
        case NotFollowed():
            said = text(record.reason)
            is_set_aside = _not_taken(record) == "not chosen"
            return "info", "", f"{'automatic measurement' if is_set_aside else 'not taken:'} {said}"
        case Event():
            prefix = {"info": "", "warning": "warning: ", "alarm": "ALARM: "}[record.level]
            # A turn between two that promise the same is no news.
            is_news = record.topic != "close predictor"
            return (record.level, prefix, record.text) if is_news else None
        case Identified():
            return _of_identified(record)
        case Detections():
            said = remarkable(record.detections)
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
        said = f"identified: {called(best.name, best.norad_id)}, {off_words(best)} off"
        if others:
            said += f"; then {others[0].name or others[0].norad_id} at {off_words(others[0])}"
    if record.hint:
        return "warning", "", f"{said}; {record.hint}"
    return "good" if record.verdict == "identified" else "info", "", said


def _of_action(record: OperatorAction) -> tuple[Level, str, str]:
    if record.verb == Note.verb:
        return "good", "NOTE: ", str(record.arguments.get("text", ""))
    by, result = f"{without_console(record.by)}: ", record.outcome
    if record.verb == Stop.verb:
        said = counted(text(result), result.stop_ordered_ms, IN_ENGINE)
        is_at_rest = result.stop_outcome in ("stands", "tracks")
        return "good" if is_at_rest else "alarm", by, f"STOP: {said}"
    if _is_used_mark(record):
        return "good", by, f"mark in frame {result.frame_id} is {ruled_text(result)}"
    wanted = command_words(record.verb, record.arguments)
    return "warning" if result.kind == "refused" else "info", by, f"{wanted}{_came_of(record)}"


def _came_of(record: OperatorAction) -> str:
    result = record.outcome
    if result == DONE:
        return ""
    if result.kind == "ruled" and result.frame_id == record.arguments.get("frame"):
        return f": {ruled_text(result)}"
    return f": {text(result)}"


LOOK_BACK_LINES = 6
FOLLOWED_AGAIN_LINES = 100
"""Last lines among which are those of the frames that can be followed again."""


def append_line(log: list[LogLine], line: LogLine) -> None:
    """Add a line, or make one of it and of those before that say the same.

    What a frame refused several times over is one line, and so are misses in a row for one
    reason, frames in a row that were not plate-solved or lay in cloud, and a neighbour that is
    not taken frame after frame, of several tracks with all their numbers; a miss that changed the
    state is told by that change, which has the words of the alarm that led to it; a command is told
    by what came of it; that the telescope aims by the orbit, by the filter and so on is one line
    with the last of them; a change of state that a frame came to before, and comes to once more
    where it is followed again, is told once.
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
        tracks = tuple(sorted({*last.tracks, *line.tracks}))
        more = replace(last, times=last.times + 1)
        log[-1] = more.of(tracks) if tracks else more
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
    """Whether the last change of state of its frame says the same."""
    if line.frame_id is None:
        return False
    for before in reversed(log[-FOLLOWED_AGAIN_LINES:]):
        if before.kind == "StateChange" and before.frame_id == line.frame_id:
            return before.change == line.change
    return False


def _with_turns_before(log: list[LogLine], line: LogLine) -> LogLine:
    """The newest turn, for itself and for one of just before it, which is taken out."""
    for index in range(max(len(log) - LOOK_BACK_LINES, 0), len(log)):
        if log[index].topic == "predictor":
            before = log.pop(index)
            turns = before.turns + 1
            since = before.since_utc_ns or before.t_utc_ns
            said = f"{line.words} ({turns} turns since {clock(since, 'minute', '')})"
            return replace(line, text=said, turns=turns, since_utc_ns=since)
    return line


def _both(last: LogLine, line: LogLine) -> LogLine:
    """One line of two that say the same: of one track in another frame, or of another track."""
    tracks = tuple(sorted({*last.tracks, *line.tracks}))
    is_another_frame = last.frame_id != line.frame_id or not line.tracks
    both = replace(line, times=last.times + is_another_frame)
    return both.of(tracks) if tracks else both


def _goes_on(last: LogLine, line: LogLine) -> bool:
    """Whether frame after frame is not solved, missed, or refuses something for one reason."""
    if line.kind == "NotSolved":
        return last.kind == line.kind
    if line.missed is not None:
        return _why(last.missed) == _why(line.missed)
    return bool(line.not_taken) and last.not_taken == line.not_taken


def _explains(line: LogLine, last: LogLine) -> bool:
    """Whether a miss in cloud says of a frame what its not being plate-solved said."""
    is_of_it = last.kind == "NotSolved" and last.frame_id == line.frame_id and last.times == 1
    is_hidden = line.missed is not None and bool(line.missed.hidden_by)
    return is_of_it and is_hidden


def _why(missed: Missed | None) -> object:
    """A reason by its kinds: cloud of few stars is cloud, however many there are."""
    if missed is None:
        return None
    hidden = tuple(each.kind for each in missed.hidden_by)
    return missed.kind, missed.detail, hidden, missed.lost


def _is_alarm(line: LogLine | None) -> bool:
    return line is not None and line.kind == "Event" and line.level == "alarm"


def _forget_acceptance(log: list[LogLine], line: LogLine) -> None:
    """What came of a command says that it was accepted, too."""
    for index in range(max(len(log) - LOOK_BACK_LINES, 0), len(log)):
        if log[index].is_accepted and log[index].asked == line.asked:
            del log[index]
            return


def _is_implied(log: list[LogLine], line: LogLine) -> bool:
    """Whether a command is told by the change that it led to: of a setting, or of the state."""
    return any(
        (before.kind == "ParameterChange" and line.setting and before.setting == line.setting)
        or (before.kind == "StateChange" and line.cause and before.cause == line.cause)
        for before in log[-2:]
    )
