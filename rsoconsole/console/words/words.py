"""Lines of text made to fit: first lines, titles, captions, and cutting of lines.

A line is a list of (text, ink).
"""

import bisect
import math
import textwrap
from collections.abc import Iterable, Sequence
from functools import lru_cache

from rsoconsole.console.drawing.plot import Ink, Line
from rsoconsole.console.night.engine_view import EngineView
from rsoconsole.console.picture.picture import DrawnPicture, Picture
from rsoconsole.control import STILL_STOPS, fault_words, hold_words, mount_holder_words
from rsoconsole.night import NightView, is_measurement_of
from rsoconsole.records import Detection, NotSolved, Solution
from rsoconsole.words import (
    NS_PER_S,
    direction,
    duration_words,
    magnitude_words,
    short_figure,
    streak_size_words,
    utc_text,
)

HELD = "AUTO watches, moves nothing"
Item = tuple[str, Ink]
ARROWS = "→↘↓↙←↖↑↗"
BADGE_COLUMNS = 100
STATE_INKS: dict[str, Ink] = {"TRACK": "good", "COAST": "warn", "LOST": "warn", "FAULT": "alarm"}


def frame_clock_utc_ns(night: NightView, engine: EngineView) -> int | None:
    """Return the frame clock, UTC ns: the engine's, else its last known time; None: unknown."""
    if engine.is_attached and engine.now_utc_ns:
        return engine.now_utc_ns
    return max(engine.since_utc_ns or 0, night.last_utc_ns or 0) or None


def top_lines(
    night: NightView,
    engine: EngineView,
    only_looks: bool,
    width: int,
    rows: int,
    *,
    found: tuple[str, str, str] = ("", "", ""),
    kept: Sequence[str] = (),
    is_stopping: bool = False,
) -> list[Line]:
    """Build the first lines: state and its duration, who has control, target, frame clock.

    ``only_looks``: True where this console may send only STOP.
    ``found``: the target's name, its orbit's size, and "by prior" if that size was assumed, each
        empty if not known.
    ``kept``: wordings on the kept track, the longest first.
    ``is_stopping``: True where STOP was given after the engine's last status.
    """
    now = frame_clock_utc_ns(night, engine)
    state_words, holder = _state_words(night, engine, now)
    if is_stopping:
        state_words, holder = ("STOP given", "alarm"), ("", "")
    target = engine.target or ""
    state = engine.state if engine.is_attached else night.state
    is_followed = state in {"TRACK", "COAST"} and engine.reach in {"attached", "recorded"}
    if not target and is_followed:
        target = "unidentified"
    target_words = (f"target {target}" if target else "no target", "" if target else "dim")
    if engine.reach in {"gone", "silent"}:
        target_words, is_followed = ("", ""), False
    brief, dated = f"{utc_text(now)} ", f"{utc_text(now, 'dated')} "
    gap = ("  ", "")
    badge = demo_badge(night, width, engine)
    if only_looks and engine.is_attached:
        holder = (f"{holder[0]} (read only)", holder[1])

    def with_target(line: Line, room: int) -> Line:
        if kept and not is_followed:
            left = room - _columns(line)
            said = next((each for each in kept if len(each) <= left), kept[-1])
            return [*line, (said, "warn")]
        if not any(found) or not is_followed:
            return [*line, target_words]  # type: ignore[list-item]
        parts = [part for part in (found[0] or target_words[0], *found[1:]) if part]
        return [*line, (join_fitting_parts(parts, room - _columns(line), " "), "")]

    if rows <= 1:
        left: Line = [*badge, (" ", ""), state_words, gap, holder, gap]  # type: ignore[list-item]
        # The date gives way to what is known of the target.
        whole, apart = with_target(left, width), 1
        shown = dated if _columns(whole) + apart + len(dated) <= width else brief
        return [add_right_text(with_target(left, width - len(shown) - apart), shown, width)]
    first: Line = [*badge, (" ", ""), state_words]
    second: Line = [(" ", ""), holder, gap]  # type: ignore[list-item]
    shown = dated if _columns(first) + len(dated) <= width else brief
    return [add_right_text(first, shown, width), cut_to_width(with_target(second, width), width)]


def demo_badge(night: NightView, width: int, engine: EngineView | None = None) -> Line:
    """Return a badge for a simulated night, with its pace; empty for a real night."""
    if not night.is_simulated:
        return []
    speed = engine.simulated_speed if engine is not None and engine.is_attached else None
    # At 0 there is no figure: as fast as the machine goes.
    fast = "" if not speed or speed == 1.0 else f"×{speed:g} "
    return [(f" DEMO {fast}SIMULATED " if width >= BADGE_COLUMNS else f" DEMO {fast}", "here")]


def _state_words(
    night: NightView, engine: EngineView, now: int | None
) -> tuple[tuple[str, Ink], tuple[str, Ink]]:
    if engine.reach == "unknown":
        return ("waiting for the engine to start", "title"), ("", "")
    if engine.reach == "gone" and night.has_ended:
        ended = utc_text(engine.since_utc_ns or now)
        return (f"ENGINE ENDED {ended}", "title"), ("it was asked to", "dim")
    if engine.reach in {"gone", "silent"}:
        word = "ENGINE GONE" if engine.reach == "gone" else "ENGINE SILENT"
        last = engine.state or night.state
        was = f"was {last}" if last else "nothing seen of it"
        return (f"{word} since {utc_text(engine.since_utc_ns or now)}", "alarm"), (was, "title")
    if engine.reach == "recorded":
        kind = "RECORDED" if night.is_closed else "NO ENGINE ASKED"
        return (f"{kind}: {night.state or 'no state'}", "title"), ("read only", "dim")
    state = engine.state or night.state or "?"
    since = ""
    began_ns = night.state_since_utc_ns
    if state == "COAST":
        # Whatever was followed again since: it coasts from where it was seen last.
        began_ns = night.last_measured_utc_ns or began_ns
    if night.state == state and began_ns and now:
        since = " " + duration_words((now - began_ns) / NS_PER_S)
    holder = mount_holder_words(engine.holder, "seat")
    ink: Ink = "warn" if engine.holder == "operator" else "title"
    if engine.is_held:
        watches = HELD if engine.holder == "autonomy" else holder
        return (f"{state}{since} {hold_words(engine)}", "warn"), (watches, ink)
    return (state + since, STATE_INKS.get(state, "title")), (holder, ink)


def alert_text(night: NightView, engine: EngineView) -> str:
    """Return the alert: faults of engine and session with their remedies; empty: no fault."""
    parts: list[str] = []
    if engine.reach == "gone" and night.has_ended:
        parts.append("the engine has ended: 'rsoconsole engine' starts one")
    elif engine.reach == "gone":
        parts.append("'rsoconsole stop' stops the mount without it; 'rsoconsole engine' starts one")
    elif engine.reach == "silent":
        parts.append(f"the engine does not answer: {STILL_STOPS}")
    if engine.is_attached:
        parts += fault_words(engine)
    if night.fault is not None:
        parts.append(night.fault)
    if engine.is_attached and engine.session is None:
        parts.append("this engine does not say where its session lies: update it")
    return " · ".join(parts)


def first_visible_index(chosen: int, count: int, room: int) -> int:
    """Return the index of the first visible row of a list, so that the chosen row is in view.

    ``room``: number of rows that are visible.
    """
    return min(max(chosen - room // 2, 0), max(count - room, 0))


def join_fitting_parts(parts: Sequence[str], width: int, gap: str = " · ") -> str:
    """Join the first parts that fit into ``width``; a first part that is too long is cut."""
    kept = ""
    for part in parts:
        longer = f"{kept}{gap}{part}" if kept else part
        if kept and len(longer) > width:
            break
        kept = longer
    return kept[: max(width, 0)]


def is_past_unread(night: NightView, engine: EngineView) -> bool:
    """Return True if there is a session and its records have not all been read once."""
    return not night.is_read and (night.folder is not None or engine.session is not None)


def frame_title(
    night: NightView, picture: Picture | None, *, is_reading: bool = False
) -> list[str]:
    """Return the parts of the picture's title: frame, exposure, whether it was not solved.

    ``is_reading``: True where the session's past is still being read.
    """
    if picture is None:
        frame = night.frame
        if frame is None and is_reading:
            return ["reading the night so far …"]
        return ["no frame yet" if frame is None else f"frame {frame.frame_id:04d}, picture to come"]
    parts = [f"frame {picture.frame_id:04d}"]
    taken = picture.detail.taken
    if taken is not None and taken.exposure_s is not None:
        parts.append(f"{taken.exposure_s:g} s")
    if isinstance(picture.detail.solution, NotSolved):
        parts.append("not solved")
    return parts


def closeup_title(picture: Picture | None, drawing: DrawnPicture | None) -> list[str]:
    """Return the parts of the close-up's title: frame, scale, SNR, magnitude, size of the streak.

    Where the magnitude is not on record, nothing stands for it.
    """
    if picture is None or drawing is None:
        return ["close-up"]
    n = round(drawing.px_per_square)
    scale = "pixel by pixel" if n == 1 else f"1:{n}"
    parts = [f"close-up {picture.frame_id:04d}", scale]
    found, followed = _followed_detection(picture), picture.detail.accepted_measurement
    if found is not None:
        parts.append(f"SNR {found.snr:.0f}")
    if followed is not None:
        magnitude = magnitude_words(picture.detail.light_of(followed.measurement_id))
        parts += [magnitude] if magnitude else []
    if found is not None:
        parts.append(streak_size_words(found))
    elif followed is None and picture.detail.predicted is not None:
        parts.append("predicted place")
    return parts


def closeup_caption(picture: Picture | None, width: int = BADGE_COLUMNS) -> list[str]:
    """Return the followed measurement's position and its sigmas; empty: none was followed.

    ``width``: most columns of the position.
    """
    followed = picture.detail.accepted_measurement if picture is not None else None
    if followed is None:
        return []
    east, _, north = followed.cov_sky_arcsec2
    place = direction(followed.ra_icrs_deg, followed.dec_icrs_deg, "measured")
    close = place.replace("α ", "α").replace("δ ", "δ")
    at = utc_text(followed.t_mid_utc_ns, zone="")
    ways = (f"measured {at} {place}", f"measured {place}", f"meas {close}", place)
    said = next((each for each in ways if len(each) <= width), close)
    return [said, f"1σ ±{short_figure(math.sqrt(east))}″ ±{short_figure(math.sqrt(north))}″"]


def _followed_detection(picture: Picture) -> Detection | None:
    found, followed = picture.detail.detections, picture.detail.accepted_measurement
    if found is None or followed is None:
        return None
    return next((each for each in found.detections if is_measurement_of(each, followed)), None)


def frame_caption(picture: Picture | None) -> list[str]:
    """Return the plate's orientation, field of view, matched stars and RMS; empty: not solved."""
    frame = picture.detail.taken if picture is not None else None
    solution = picture.detail.solution if picture is not None else None
    if frame is None or not isinstance(solution, Solution):
        return []
    wide, high = (n * solution.scale_arcsec_px / 60 for n in (frame.width_px, frame.height_px))
    # Row 0 is at the top: +y is down, and lies at the plate's rotation east of north.
    turn, sign = math.radians(solution.rotation_deg), -1.0 if solution.is_flipped else 1.0
    north = _arrow(sign * math.sin(turn), math.cos(turn))
    east = _arrow(-sign * math.cos(turn), math.sin(turn))
    compass = f"N{north}E{east} {wide:.0f}′×{high:.0f}′"
    stars = f"{solution.matched} {'matched' if solution.path != 'shift' else 'left by cloud'}"
    return [compass, stars, f"RMS {short_figure(solution.rms_arcsec)}″"]


def _arrow(x: float, y: float) -> str:
    return ARROWS[round(math.degrees(math.atan2(y, x)) / 45.0) % 8]


def add_right_text(left: Line, right: str, width: int) -> Line:
    """Return the line with ``right`` at its right edge; ``left`` is cut to leave room for it."""
    room = width - len(right)
    cut = cut_to_width(left, max(room, 0))
    pad = max(room - _columns(cut), 0)
    return [*cut, (" " * pad, ""), (right, "title")]


def cut_to_width(line: Line, width: int) -> Line:
    """Cut a line to a width, with "…" at the cut."""
    if _columns(line) <= width:
        return line
    kept: Line = []
    left = width - 1
    for text, ink in line:
        if left <= 0:
            break
        kept.append((text[:left], ink))
        left -= len(text[:left])
    return [*kept, ("…", "dim")] if width > 0 else []


def draw_rule(left: str | Line, right: str, width: int) -> Line:
    """Draw a horizontal rule with a title in it, and with ``right`` if there is room."""
    title: Line = [(left.strip(), "title")] if isinstance(left, str) else left
    used = 3 + _columns(title)
    tail = f" {right} ─" if right and used + len(right) + 3 <= width else ""
    fill = "─" * max(width - used - len(tail), 0)
    return cut_to_width([("─ ", "dim"), *title, (f" {fill}{tail}", "dim")], width)


def items_in_rows(
    items: Iterable[Item], width: int, rows: int | None = None, gap: str = "  "
) -> list[Line]:
    """Spread (text, ink) items over rows; items without room are left out.

    ``rows``: most rows, None: any number; ``gap``: text between two items of a row.
    """
    lines: list[Line] = []
    for text, ink in items:
        if lines and _columns(lines[-1]) + len(gap) + len(text) <= width:
            lines[-1].append((gap + text, ink))
        elif len(lines) == rows:
            break
        else:
            lines.append([(" ", ""), (text, ink)])
    return [cut_to_width(line, width) for line in lines]


def _columns(line: Line) -> int:
    return sum(len(text) for text, _ in line)


def cos_deg(angle_deg: float) -> float:
    return math.cos(math.radians(angle_deg))


def wrap_to_rows(text: str, width: int, rows: int, cut: str = "…") -> list[Line]:
    """Break text between words into at most ``rows`` lines; a longer text loses its middle.

    The fact comes first and the remedy last, so both stay. ``cut``: sign for the missing middle.
    """
    return [[(line, "")] for line in _broken(text, max(width, 1), rows, cut)]


@lru_cache(maxsize=256)
def _broken(text: str, width: int, rows: int, cut: str) -> tuple[str, ...]:
    lines = textwrap.wrap(text, width) or [""]
    if len(lines) <= rows:
        return tuple(lines)
    indent = text[: len(text) - len(text.lstrip())]
    words = text.split()

    def without(count: int) -> list[str]:
        first = (len(words) - count + 1) // 2
        return textwrap.wrap(
            indent + " ".join([*words[:first], cut, *words[first + count :]]), width
        )

    fewest = bisect.bisect_left(
        range(1, len(words)), True, key=lambda count: len(without(count)) <= rows
    )
    kept = without(fewest + 1)
    if len(words) > 2 and len(kept) <= rows:
        return tuple(kept)
    return *lines[: rows - 1], lines[rows - 1][: width - 1] + "…"
