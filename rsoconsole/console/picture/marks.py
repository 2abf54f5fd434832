"""Marks over a frame's picture: detections, and tracks' predicted places with their errors."""

import math
from dataclasses import dataclass, replace
from typing import Literal, get_args

from rsoconsole.console.drawing.plot import TrackInk
from rsoconsole.console.drawing.track_marks import (
    CELL_HEIGHT,
    NumberedTrack,
    place_track_numbers,
    track_ink,
)
from rsoconsole.night import FrameTrack, NightFrame, is_measurement_of, uncertainty_ellipse_px
from rsoconsole.records import Detection, Measurement, Solution, TrackState
from rsoconsole.sky import sky_to_pixel
from rsoconsole.words import short_figure, short_name_of

OUTLINE_POINTS = 72
SHOWN_REJECTED = 0.01
"""Confidence from which on a rejected candidate has a mark: lower ones are noise."""

MarkKind = Literal[
    "star",
    "box",
    "rejected",
    "predicted",
    "coasted",
    "candidate",
    "operator",
    "member",
    "followed",
    "now_rejected",
    "now",
    "cursor",
    TrackInk,
]
"""Kind of a mark, in the order in which they are written: the last one stays. ``member``: of
another track than the lead; ``coasted``: of a track that is not in this frame; ``now``,
``now_rejected``: of a frame processed again; ``box``: the network's; ``star``: of a chart;
``TrackInk``: of a track's number."""
_ORDER: tuple[MarkKind, ...] = get_args(MarkKind)

_BRACKETS: dict[MarkKind, tuple[str, str]] = {
    "followed": ("[", "]"),
    "member": ("[", "]"),
    "candidate": ("(", ")"),
    "rejected": ("‹", "›"),
    "operator": ("<", ">"),
    "now": ("{", "}"),
    "now_rejected": ("«", "»"),
}
COASTED = "○"
"""Sign before the number of a track that the frame does not show."""
_SHORT_COLUMNS = 4
"""Columns up to which a streak's signs are in one row; a longer streak has them at its ends."""
FLAT = math.tan(math.radians(22.5))
"""Slope of a streak up to which it is drawn as a level line, or a line upright."""
MAX_STEPS = 2000
"""Most cells that are computed along a streak: no terminal has more."""


Cells = dict[tuple[int, int], tuple[str, str]]
"""Text over a picture: (column, row) -> (character, kind of mark)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """A mark over a picture; places are pixels of the whole frame."""

    x_px: float
    y_px: float
    kind: MarkKind
    ends_px: tuple[tuple[float, float], tuple[float, float]] | None = None
    """Both ends of a streak, the left one first; None: the mark is of no streak."""
    label: str = ""
    outline_px: tuple[tuple[float, float], ...] = ()
    """Points of an outline: the 3-sigma ellipse of a track's prediction, or a box."""
    is_outer: bool = False
    """True where it surrounds another mark of the same streak; its label is then a row below."""
    gap: int = 0
    """Cells between the mark's sign and its label."""
    number_kind: TrackInk | None = None
    """Ink of the label where that is a track's number, which is placed wherever there is room."""

    @property
    def is_numbered(self) -> bool:
        """True where the label is a track's number."""
        return self.number_kind is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """A part of a frame that is drawn into cells, each two squares high."""

    x0_px: float
    """Left edge, pixels; the centre of the frame's first pixel is at 0."""
    y0_px: float
    width_px: float
    height_px: float
    columns: int
    rows: int

    @classmethod
    def at(
        cls, corner_px: tuple[float, float], size_px: tuple[float, float], cells: tuple[int, int]
    ) -> "Window":
        """Return a window by its upper left corner, (width, height), and (columns, rows)."""
        (x0, y0), (width, height), (columns, rows) = corner_px, size_px, cells
        return cls(x0_px=x0, y0_px=y0, width_px=width, height_px=height, columns=columns, rows=rows)

    def cell(self, x_px: float, y_px: float) -> tuple[int, int]:
        """Return (column, row) of the cell of a place, which may be outside the window."""
        column = (x_px - self.x0_px) / self.width_px * self.columns
        row = (y_px - self.y0_px) / self.height_px * self.rows
        return math.floor(column), math.floor(row)

    def has(self, column: int, row: int) -> bool:
        """Return True if a cell is in the window."""
        return 0 <= column < self.columns and 0 <= row < self.rows


def frame_marks(detail: NightFrame) -> tuple[Mark, ...]:
    """Return all marks of one frame: streaks, marks by hand, predicted places."""
    found = detail.detections
    if found is None or found.width_px <= 0 or found.height_px <= 0:
        return ()
    several = detail.tracks if len(detail.tracks) > 1 else ()
    taken = ((m, detail.track_of(m)) for m in detail.all_measurements if several)
    members = [(m, track) for m, track in taken if track is not None]
    marks = [
        _numbered(streak_mark(d, "candidate", detail.accepted_measurement), d, members)
        for d in found.detections
    ]
    marks += [
        _numbered(streak_mark(each.detection, "rejected"), each.detection, members)
        for each in found.rejected
        if each.detection.confidence >= SHOWN_REJECTED
    ]
    marks += [
        Mark(x_px=m.x_px, y_px=m.y_px, kind="operator", label="you")
        for m in detail.measurements
        if m.source == "operator"
    ]
    coasted = [track for track in several if track.updated is None]
    unseen = [_coasted_mark(detail, track) for track in coasted]
    if detail.predicted is not None and not any(track.is_lead for track in coasted):
        unseen.append(_mark_at(detail.predicted, detail, "predicted"))
    return (*marks, *(mark for mark in unseen if mark is not None))


def _numbered(
    mark: Mark, detection: Detection, members: list[tuple[Measurement, FrameTrack]]
) -> Mark:
    """Return the mark with the number of the track that took the streak; unchanged if none did."""
    for measured, track in members:
        if is_measurement_of(detection, measured):
            kind: MarkKind = "followed" if track.is_lead else "member"
            ink = track_ink(track.track_id)
            return replace(mark, kind=kind, label=track.number_text, number_kind=ink)
    return mark


def _coasted_mark(detail: NightFrame, track: FrameTrack) -> Mark | None:
    """Return the mark of a coasted track's predicted place; None where the frame is not solved."""
    mark = None if track.predicted is None else _mark_at(track.predicted, detail, "coasted")
    label = f"{COASTED}{track.number_text}"
    ink = track_ink(track.track_id)
    return None if mark is None else replace(mark, label=label, number_kind=ink)


def streak_mark(detection: Detection, kind: MarkKind, followed: Measurement | None = None) -> Mark:
    """Return a streak's mark: its ends, and as the label its confidence and class.

    ``followed``: the lead's measurement; if it is of this streak, the mark's kind is "followed".
    """
    is_followed = is_measurement_of(detection, followed)
    ends = (detection.x_a_px, detection.y_a_px), (detection.x_b_px, detection.y_b_px)
    return Mark(
        x_px=detection.x_px,
        y_px=detection.y_px,
        ends_px=(min(ends), max(ends)),
        kind="followed" if is_followed else kind,
        label=f"{short_figure(detection.confidence)} {short_name_of(detection)}".rstrip(),
    )


def _mark_at(track: TrackState, detail: NightFrame, kind: MarkKind) -> Mark | None:
    """Return the mark of a track's state with its 3-sigma ellipse; None: frame not solved."""
    if not isinstance(detail.solution, Solution):
        return None
    ra, _, dec, _ = track.x
    x_px, y_px = (float(v) for v in sky_to_pixel(detail.solution.wcs, ra, dec))
    if not (math.isfinite(x_px) and math.isfinite(y_px)):
        return None
    outline = uncertainty_ellipse_px(track, detail.solution, OUTLINE_POINTS)
    return Mark(x_px=x_px, y_px=y_px, kind=kind, outline_px=outline)


def mark_characters(
    marks: tuple[Mark, ...],
    window: Window,
    *,
    has_rejected: bool = False,
    has_lines: bool = False,
) -> Cells:
    """Return the characters that the marks write over a picture.

    Signs stand beside the streaks, whose own cells stay free. ``has_rejected``: True where rejected
    candidates have signs too. ``has_lines``: True where the streaks are drawn as lines.
    """
    shown = [mark for mark in marks if mark.kind != "rejected" or has_rejected]
    streaks = _streak_cells(shown, window)
    cells: Cells = {}
    for mark in sorted(shown, key=lambda m: _ORDER.index(m.kind)):
        if has_lines:
            line = _line_sign(mark, window), mark.kind
            cells |= dict.fromkeys(filter(lambda at: window.has(*at), _line(mark, window)), line)
        centre = window.cell(mark.x_px, mark.y_px)
        for point in mark.outline_px:
            at = window.cell(*point)
            if window.has(*at) and at != centre and at not in streaks:
                cells[at] = "·", mark.kind
        for column, row, text in _signs(mark, centre, window, streaks):
            for offset, character in enumerate(text):
                if window.has(column + offset, row):
                    cells[column + offset, row] = character, mark.kind
    numbers = [_number_of(mark, window) for mark in shown if mark.is_numbered]
    return cells | place_track_numbers(numbers, (window.columns, window.rows), cells, streaks)


def _number_of(mark: Mark, window: Window) -> NumberedTrack:
    """Return a track's number and the cells of its streak, or of its predicted place."""
    left = right = window.cell(mark.x_px, mark.y_px)
    if mark.ends_px is not None:
        left, right = (window.cell(*end) for end in mark.ends_px)
    return NumberedTrack(
        text=mark.label, left=left, right=right, kind=mark.number_kind or mark.kind
    )


def _streak_cells(marks: list[Mark], window: Window) -> dict[tuple[int, int], bool]:
    """Return the cells along each streak -> whether the streak runs rather across than down."""
    return {at: is_across for mark in marks for at, is_across in _line(mark, window).items()}


def _line(mark: Mark, window: Window) -> dict[tuple[int, int], bool]:
    """Return the cells along a mark's streak, as ``_streak_cells``; empty where it has none."""
    if mark.ends_px is None:
        return {}
    (xa, ya), (xb, yb) = mark.ends_px
    (column_a, row_a), (column_b, row_b) = window.cell(xa, ya), window.cell(xb, yb)
    is_across = abs(column_b - column_a) >= abs(row_b - row_a)
    count = min(max(abs(column_b - column_a), abs(row_b - row_a)), MAX_STEPS) * 2 + 1
    shares = (step / count for step in range(count + 1))
    return {
        window.cell(xa + share * (xb - xa), ya + share * (yb - ya)): is_across for share in shares
    }


def _line_sign(mark: Mark, window: Window) -> str:
    """Return the sign of a streak's line by its direction on the screen."""
    if mark.ends_px is None:
        return ""
    (xa, ya), (xb, yb) = mark.ends_px
    across = (xb - xa) / window.width_px * window.columns
    down = (yb - ya) / window.height_px * window.rows * CELL_HEIGHT
    if abs(down) <= abs(across) * FLAT:
        return "─"
    if abs(across) <= abs(down) * FLAT:
        return "│"
    return "╲" if (across > 0) == (down > 0) else "╱"


def _signs(
    mark: Mark, centre: tuple[int, int], window: Window, streaks: dict[tuple[int, int], bool]
) -> list[tuple[int, int, str]]:
    """Return the signs of a mark: (column, row, text) of each."""
    column, row = centre
    match mark.kind:
        case "predicted":
            return _predicted_signs(column, row, streaks)
        case "cursor":
            own = [(column, row, mark.label)]
            return own if mark.label else _cursor_signs(column, row, streaks)
        case "coasted":
            return [(column, row, "+")] if centre not in streaks else []
        case "box":
            return []
        case "star":
            return [(column, row, mark.label)]
    return _streak_signs(mark, centre, window)


def _streak_signs(
    mark: Mark, centre: tuple[int, int], window: Window
) -> list[tuple[int, int, str]]:
    """Return a streak's brackets and its label; a track's number is placed elsewhere."""
    row = centre[1]
    opening, closing = _BRACKETS[mark.kind]
    left = right = centre
    if mark.ends_px is not None:
        end_a, end_b = mark.ends_px
        left, right = window.cell(*end_a), window.cell(*end_b)
    if right[0] - left[0] <= _SHORT_COLUMNS:
        left, right = (left[0], row), (right[0], row)
        if mark.kind == "member":
            return []  # the number alone: brackets about each of a slot would hide them all
    beside = 2 if mark.is_outer else 1
    left = (_edged(left[0], -beside, window), left[1])
    right = (_edged(right[0], beside, window), right[1])
    if mark.is_numbered:
        return [(*left, opening), (*right, closing)]
    label, label_at, is_right = _label_of(mark, left[0], right[0], window)
    label_row = (right[1] if is_right else left[1]) + mark.is_outer
    return [(*left, opening), (*right, closing), (label_at, label_row, label)]


def _label_of(mark: Mark, left: int, right: int, window: Window) -> tuple[str, int, bool]:
    """Return the label, its first column, and whether it is right of the streak."""
    first = mark.label.split(" ")[0]
    for label in (mark.label, first):
        columns = mark.gap + len(label)
        if right + 1 + columns <= window.columns:
            return label, right + 1 + mark.gap, True
        if left - columns >= 0:
            return label, left - columns, False
    return first, right + 1 + mark.gap, True


def _edged(column: int, beside: int, window: Window) -> int:
    """Return the column beside a streak's end; at the picture's edge the outermost column."""
    if not 0 <= column < window.columns:
        return column + beside
    return min(max(column + beside, 0), window.columns - 1)


def _predicted_signs(
    column: int, row: int, streaks: dict[tuple[int, int], bool]
) -> list[tuple[int, int, str]]:
    """Return a cross; where it would lie on a streak, two signs that point at it from beside."""
    is_across = streaks.get((column, row))
    if is_across is None:
        return [(column, row, "+")]
    if is_across:
        return _above_and_below(column, row)
    return [(column - 1, row, "▸"), (column + 1, row, "◂")]


def _cursor_signs(
    column: int, row: int, streaks: dict[tuple[int, int], bool]
) -> list[tuple[int, int, str]]:
    """Return a cross that is open in its middle, so that the pixel stays visible."""
    if (column, row) in streaks:
        return _predicted_signs(column, row, streaks)
    return [(column - 1, row, "╴"), (column + 1, row, "╶"), *_above_and_below(column, row)]


def _above_and_below(column: int, row: int) -> list[tuple[int, int, str]]:
    return [(column, row - 1, "▾"), (column, row + 1, "▴")]
