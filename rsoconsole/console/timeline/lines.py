"""The time line drawn in cells: the loop's states, signs of events, and the shown place.

Meaning is never by colour alone: every state has a sign and, where there is room, its name; every
kind of event has a sign that ``plain`` keeps distinct.
"""

from bisect import bisect_right
from collections import Counter
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby

from rsoconsole.console.drawing.plot import Ink, Line, join_cells_by_key
from rsoconsole.console.night.engine_view import EngineView
from rsoconsole.console.timeline.timeline import Timeline, TimelineEventKind
from rsoconsole.console.words.words import (
    STATE_INKS,
    add_right_text,
    cut_to_width,
    join_fitting_parts,
)
from rsoconsole.control import mount_holder_words
from rsoconsole.night import NightView
from rsoconsole.records import LoopState
from rsoconsole.words import NS_PER_S, duration_words, utc_text

SIGNS: dict[TimelineEventKind, str] = {
    "loss": "▼",
    "alarm": "!",
    "note": "✎",
    "operator": "▲",
    "rejection": "×",
    "miss": "○",
}
"""Sign of each kind of event; of several kinds in a cell, the first listed here is shown."""
KIND_INKS: dict[TimelineEventKind, Ink] = {
    "loss": "alarm",
    "alarm": "alarm",
    "note": "title",
    "operator": "title",
    "rejection": "warn",
    "miss": "warn",
}
FREQUENT: frozenset[TimelineEventKind] = frozenset(("miss", "rejection"))
FOUND, HERE, KEPT, UNREAD, PIXELS = "/", "┃", "A", "░", "▫"
SHARE = 0.25
"""Fraction of a cell's frames from which on misses and rejections show among other kinds."""
FILLS: dict[LoopState | None, tuple[str, Ink]] = {
    "TRACK": ("━", "good"),
    "COAST": ("╍", "warn"),
    "ACQUIRE": (":", ""),
    "SEARCH": ("·", ""),
    "LOST": ("·", "alarm"),
    "MANUAL": ("═", "title"),
    "FAULT": ("!", "alarm"),
    "IDLE": (" ", "dim"),
    None: (" ", "dim"),
}
GRAVE: tuple[LoopState, ...] = ("FAULT", "LOST", "MANUAL")
"""States that a cell shows however short they were."""
LONG_RUN_COLUMNS = 24
END_COLUMNS = 7
MIN_STRIP_COLUMNS = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class TimelineMarks:
    """What the time line marks: the shown place of the log, moment A, and events."""

    seq: int = 0
    words: tuple[str, ...] = ()
    """Words on the shown place, the most important first."""
    kept_seq: int | None = None
    """Place of moment A, kept to compare with; None: none is kept."""
    kinds: tuple[TimelineEventKind, ...] = tuple(SIGNS)
    found: tuple[int, ...] = ()
    """Places of lines that a search found; where there are any, their signs alone are shown."""


def timeline_lines(timeline: Timeline, place: TimelineMarks, width: int, height: int) -> list[Line]:
    """Build the time line's rows for a pane of that size.

    One row: words and strip.
    Two rows: strip, words.
    Three rows: events, strip, words.
    """
    if height <= 0 or width <= 0:
        return []
    words = f" {join_fitting_parts(place.words, width - 1)}"
    if height == 1:
        head = f" {join_fitting_parts(place.words[:2], max(width - MIN_STRIP_COLUMNS, 0))} "
        room = width - len(head) - 1
        if room < MIN_STRIP_COLUMNS // 2:
            return [[(words[:width], "title")]]
        strip, _ = _strip(timeline, place, room, is_one_row=True)
        return [[(head, "title"), *strip]]
    x, columns = strip_columns(width)
    strip, events = _strip(timeline, place, columns, is_one_row=height < 3)
    ends = ("", "")
    if x:
        first, last = timeline.first_utc_ns, timeline.last_utc_ns
        ends = (f"{utc_text(first, 'minute', ''):>{x - 1}} ", f" {utc_text(last, 'minute')}")
    line: Line = [(ends[0], "dim"), *strip, (ends[1], "dim")]
    rows = [cut_to_width(line, width), cut_to_width([(words, "title")], width)]
    return rows if height == 2 else [cut_to_width([(" " * x, ""), *events], width), *rows]


def strip_columns(width: int) -> tuple[int, int]:
    """Return (first column, columns) of the strip, the row of states, in a pane of that width."""
    if width < MIN_STRIP_COLUMNS + 2 * END_COLUMNS:
        return 0, width
    return END_COLUMNS, width - 2 * END_COLUMNS - 1


def cell_end_utc_ns(timeline: Timeline, column: int, columns: int) -> int | None:
    """Return the last instant of a cell of the strip, UTC ns; None for a night without frames."""
    first, last = timeline.first_utc_ns, timeline.last_utc_ns
    if first is None or last is None or columns <= 0:
        return None
    share = (min(max(column, 0), columns - 1) + 1) / columns
    return first + round((last - first) * share)


def _strip(
    timeline: Timeline, place: TimelineMarks, columns: int, *, is_one_row: bool
) -> tuple[Line, Line]:
    """Return the row of states, with the events where it is the only row, and the row of events."""
    cells = list(_states(timeline, columns))
    events = _events(timeline, place.kinds, place.found, columns)
    row: list[tuple[str, Ink]] = [events.get(column, (" ", "")) for column in range(columns)]
    for column in () if is_one_row else _with_pixels(timeline, columns):
        if row[column][0] == " ":
            row[column] = (PIXELS, "dim")
    if is_one_row:
        cells = [events.get(column, cell) for column, cell in enumerate(cells)]
    for seq, sign in ((place.kept_seq, KEPT), (place.seq, HERE)):
        t = None if seq is None else timeline.frame_start_utc_ns(seq)
        if t is not None and columns > 0:
            column = _column(timeline, t, columns)
            cells[column] = (sign, "here")
            if not is_one_row and row[column][0] in {" ", PIXELS}:
                row[column] = (sign, "title")
    return join_cells_by_key(cells), join_cells_by_key(row)


@lru_cache(maxsize=8)
def _with_pixels(timeline: Timeline, columns: int) -> frozenset[int]:
    """Return the cells that have a frame whose pixels are kept."""
    kept = timeline.with_pixels
    if not kept or columns <= 0:
        return frozenset()
    return frozenset(
        _column(timeline, mark.t_utc_ns, columns)
        for mark in timeline.frames
        if mark.frame_id in kept
    )


def _column(timeline: Timeline, t_utc_ns: int, columns: int) -> int:
    first, last = timeline.first_utc_ns or 0, timeline.last_utc_ns or 0
    share = (t_utc_ns - first) / max(last - first, 1)
    return min(max(int(share * columns), 0), columns - 1)


@lru_cache(maxsize=8)
def _states(timeline: Timeline, columns: int) -> tuple[tuple[str, Ink], ...]:
    """Return the state shown in each cell: the longest one in its time, or a grave one."""
    first, last = timeline.first_utc_ns, timeline.last_utc_ns
    if first is None or last is None:
        return ((" ", "dim"),) * columns
    shares: list[Counter[LoopState]] = [Counter() for _ in range(columns)]
    ends = [mark.t_utc_ns for mark in timeline.states[1:]] + [last]
    for mark, end in zip(timeline.states, ends, strict=False):
        a = (mark.t_utc_ns - first) / max(last - first, 1) * columns
        b = max((end - first) / max(last - first, 1) * columns, a + 1e-6)
        for column in range(min(int(a), columns - 1), min(int(b), columns - 1) + 1):
            shares[column][mark.state] += min(b, column + 1) - max(a, column)  # type: ignore[assignment]
    states = [_of(share) for share in shares]
    cells: list[tuple[str, Ink]] = []
    named: LoopState | None = None
    for state, group in groupby(states):
        length = len(list(group))
        fill, ink = FILLS[state]
        # A state that is left for a moment only needs no second word.
        is_known = state == named and length < LONG_RUN_COLUMNS
        word = "" if is_known else _word(f"{state or ''}", length)
        named = state if word else named
        cells += [(character, ink) for character in word.ljust(length, fill)]
    read = timeline.frame_start_utc_ns(timeline.read_seq)
    if not timeline.is_whole and read is not None:
        unread = _column(timeline, read, columns)
        cells[unread:] = [
            (UNREAD if text in "━╍:·═ !" else text, "dim") for text, _ in cells[unread:]
        ]
    return tuple(cells)


def _word(name: str, columns: int) -> str:
    """Return a state's name, or its first letter, as a run of that many columns has room for."""
    if columns > len(name) + 1:
        return name
    return name[:1] if columns > 2 else ""


def _of(share: Counter[LoopState]) -> LoopState | None:
    ((longest, _),) = share.most_common(1) or ((None, 0),)
    return next((state for state in GRAVE if state in share), longest)


@lru_cache(maxsize=8)
def _events(
    timeline: Timeline, kinds: tuple[TimelineEventKind, ...], found: tuple[int, ...], columns: int
) -> dict[int, tuple[str, Ink]]:
    """Return the sign of each cell that has an event, by column."""
    if columns <= 0:
        return {}
    if found:
        times = (timeline.frame_start_utc_ns(seq) for seq in found)
        return {_column(timeline, t, columns): (FOUND, "title") for t in times if t is not None}
    counts: dict[int, Counter[TimelineEventKind]] = {}
    for each in timeline.events:
        if each.kind in kinds:
            column = _column(timeline, each.t_utc_ns, columns)
            counts.setdefault(column, Counter())[each.kind] += 1
    cells: dict[int, tuple[str, Ink]] = {}
    for column, count in counts.items():
        frames = _frames_in(timeline, column, columns)
        for kind, sign in SIGNS.items():
            is_shown = kind not in FREQUENT or len(kinds) == 1 or count[kind] >= SHARE * frames
            if count[kind] and is_shown:
                cells[column] = (sign, KIND_INKS[kind])
                break
    return cells


def _frames_in(timeline: Timeline, column: int, columns: int) -> int:
    first, last = timeline.first_utc_ns or 0, timeline.last_utc_ns or 0
    edges = (first + (last - first) * edge // columns for edge in (column, column + 1))
    a, b = (bisect_right(timeline.frames, t, key=lambda mark: mark.t_utc_ns) for t in edges)
    return b - a


def recorded_controller(night: NightView) -> str | None:
    """Return who had control, by the recorded state; None where no state is on record."""
    if night.state is None:
        return None
    holders = {"IDLE": "nobody", "FAULT": "nobody", "MANUAL": "operator"}
    return holders.get(night.state, "autonomy")


def recorded_engine_view(night: NightView) -> EngineView:
    """Return the engine's status at the night's moment, as far as it follows from the record."""
    return EngineView(
        reach="recorded",
        state=night.state,
        holder=recorded_controller(night),
        now_utc_ns=night.last_utc_ns,
        session=night.folder,
    )


def review_top_lines(
    night: NightView,
    engine: EngineView,
    live: tuple[NightView, EngineView] | None,
    width: int,
    rows: int,
    *,
    found: tuple[str, str, str] = ("", "", ""),
) -> list[Line]:
    """Build a review's first lines: state and control then, night's name, live state, clock.

    ``live``: night and engine of the live screen behind; None: there is none.
    ``found``: the target's name, its orbit's size, and whether that was assumed.
    """
    state = f"{night.state or 'no state yet'}"
    if night.state and night.state_since_utc_ns and night.last_utc_ns:
        since_s = (night.last_utc_ns - night.state_since_utc_ns) / NS_PER_S
        state = f"{state} {duration_words(since_s)}"
    holder = mount_holder_words(engine.holder, "past")
    name = night.folder.name if night.folder is not None else ""
    at = f"{utc_text(night.last_utc_ns)} "
    first: Line = [
        (" REVIEW ", "here"),
        ("  ", ""),
        (state, STATE_INKS.get(night.state or "", "title")),
    ]
    then: Line = [(holder, "title"), ("  " if holder else "", ""), (name, "dim")]
    present = _live_words(live)
    if rows <= 1:
        line: Line = [*first, *([("  ", ""), present] if present else []), ("  ", ""), *then]
        return [add_right_text(_with_target(line, found, width - len(at)), at, width)]
    second: Line = [(" ", ""), *([present, ("  ", "")] if present else []), *then]
    return [
        add_right_text(first, at, width),
        cut_to_width(_with_target(second, found, width), width),
    ]


def _with_target(line: Line, found: tuple[str, str, str], width: int) -> Line:
    room = width - sum(len(text) for text, _ in line) - 2
    parts = [part for part in found if part]
    return (
        [*line, ("  ", ""), (join_fitting_parts(parts, room, " "), "")]
        if parts and room > 0
        else line
    )


def _live_words(live: tuple[NightView, EngineView] | None) -> tuple[str, Ink] | None:
    if live is None:
        return None
    night, engine = live
    if engine.reach in {"gone", "silent"}:
        return f"live: ENGINE {engine.reach.upper()}", "alarm"
    state = engine.state or night.state
    return None if state is None else (f"live: {state}", STATE_INKS.get(state, "title"))


def place_words(timeline: Timeline, seq: int, t_utc_ns: int | None) -> list[str]:
    """Return words on a place: frame, number of frames, time, whether pixels are kept."""
    count = len(timeline.frames)
    if not count:
        return ["no frames", utc_text(t_utc_ns)]
    index = timeline.frame_index(seq)
    if index is None:
        return [f"before the first of {count} frames", utc_text(t_utc_ns)]
    frame_id = timeline.frames[index].frame_id
    which = f"frame {frame_id:04d}" if frame_id != index + 1 else f"frame {frame_id}"
    number = f" ({index + 1} of {count})" if frame_id != index + 1 else f" of {count}"
    pixels = []
    if timeline.with_pixels:
        pixels = ["enter opens it" if frame_id in timeline.with_pixels else "pixels not kept"]
    return [which + number, utc_text(t_utc_ns), *pixels]


def reading_progress_words(timeline: Timeline) -> str:
    """Return in words how much of the log has been read; empty: all of it."""
    if timeline.is_whole or not timeline.last_seq:
        return ""
    return f"reading {timeline.read_seq / timeline.last_seq:.0%}"
