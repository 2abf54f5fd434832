"""One line of the log for one thing: what the record says twice and thrice is said once.

Which records belong together is told by their kinds and their order, never by their words.
"""

from dataclasses import replace

from rsoconsole.night.log_lines import LogLine
from rsoconsole.reasons import Missed
from rsoconsole.words import clock

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
