"""What a review says of the moment it shows and of the night it lies in."""

from rsoconsole.console.drawing import Ink, Line
from rsoconsole.console.night import EngineView
from rsoconsole.console.timeline.night_line import Timeline
from rsoconsole.console.words import (
    STATE_INKS,
    clipped,
    fitted,
    justified,
)
from rsoconsole.control.words import holder_words
from rsoconsole.night import NightView
from rsoconsole.sky import NS_PER_S
from rsoconsole.words import clock, span

UNHELD = frozenset(("IDLE", "FAULT"))


def holder_then(night: NightView) -> str | None:
    """Who had the mount by the state on record; None where none is."""
    if night.state is None or night.state in UNHELD:
        return None if night.state is None else "nobody"
    return "operator" if night.state == "MANUAL" else "autonomy"


def engine_then(night: NightView) -> EngineView:
    """The engine as the record has it at that moment."""
    return EngineView(
        reach="recorded",
        state=night.state,
        holder=holder_then(night),
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
    """That this is the past; state and holder then, the night's name, the live state, the clock.

    ``live``: what is known of the night that goes on behind, None where there is none; ``found``:
    the target's name and its orbit's size, as much of it as there is room for.
    """
    state = f"{night.state or 'no state yet'}"
    if night.state and night.state_since_utc_ns and night.last_utc_ns:
        since_s = (night.last_utc_ns - night.state_since_utc_ns) / NS_PER_S
        state = f"{state} {span(since_s)}"
    holder = holder_words(engine.holder, "past")
    name = night.folder.name if night.folder is not None else ""
    at = f"{clock(night.last_utc_ns)} "
    first: Line = [
        (" REVIEW ", "here"),
        ("  ", ""),
        (state, STATE_INKS.get(night.state or "", "title")),
    ]
    then: Line = [(holder, "title"), ("  " if holder else "", ""), (name, "dim")]
    present = _live_words(live)
    if rows <= 1:
        line: Line = [*first, *([("  ", ""), present] if present else []), ("  ", ""), *then]
        return [justified(_with_target(line, found, width - len(at)), at, width)]
    second: Line = [(" ", ""), *([present, ("  ", "")] if present else []), *then]
    return [justified(first, at, width), clipped(_with_target(second, found, width), width)]


def _with_target(line: Line, found: tuple[str, str, str], width: int) -> Line:
    room = width - sum(len(text) for text, _ in line) - 2
    parts = [part for part in found if part]
    return [*line, ("  ", ""), (fitted(parts, room, " "), "")] if parts and room > 0 else line


def _live_words(live: tuple[NightView, EngineView] | None) -> tuple[str, Ink] | None:
    if live is None:
        return None
    night, engine = live
    if engine.reach in {"gone", "silent"}:
        return f"live: ENGINE {engine.reach.upper()}", "alarm"
    state = engine.state or night.state
    return None if state is None else (f"live: {state}", STATE_INKS.get(state, "title"))


def place_words(timeline: Timeline, seq: int, t_utc_ns: int | None) -> list[str]:
    """Which frame of how many, and when."""
    count = len(timeline.frames)
    if not count:
        return ["no frames", clock(t_utc_ns)]
    index = timeline.index_of(seq)
    if index is None:
        return [f"before the first of {count} frames", clock(t_utc_ns)]
    frame_id = timeline.frames[index].frame_id
    which = f"frame {frame_id:04d}" if frame_id != index + 1 else f"frame {frame_id}"
    number = f" ({index + 1} of {count})" if frame_id != index + 1 else f" of {count}"
    pixels = []
    if timeline.with_pixels:
        pixels = ["enter opens it" if frame_id in timeline.with_pixels else "pixels not kept"]
    return [which + number, clock(t_utc_ns), *pixels]


def reading_words(timeline: Timeline) -> str:
    """How far the log has been read; empty when it is."""
    if timeline.is_whole or not timeline.last_seq:
        return ""
    return f"reading {timeline.read_seq / timeline.last_seq:.0%}"
