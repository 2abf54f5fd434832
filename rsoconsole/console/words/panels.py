"""The panes of the plots: confidence, residuals and NIS for a window of frames, with titles."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

from rsoconsole.console.drawing.plot import (
    AXIS_COLUMNS,
    REFUSED,
    Ink,
    Line,
    PlotColumn,
    cells_per_frame,
    confidence_plot,
    confidence_strip,
    nis_plot,
    residual_plot,
    residual_strip,
    sparkline,
)
from rsoconsole.console.drawing.track_marks import track_ink
from rsoconsole.console.picture.marks import SHOWN_REJECTED
from rsoconsole.console.words.tunable import change_words
from rsoconsole.console.words.words import cut_to_width, draw_rule
from rsoconsole.night import FrameRow, NightView, since_last_change
from rsoconsole.pipeline import usual_timing_sigma_s
from rsoconsole.tracking import NIS_BAND, consistency, filter_summary_words
from rsoconsole.words import angle, short_figure, signed_angle, utc_text

MAX_FRAMES_A_MARK = 64
LABEL_COLUMNS = 12
LIVE_STEP = 12
"""Marks that one key press moves the window by."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlotWindow:
    """Window of frames that the plots show; by default the newest, one frame to a mark."""

    back: int = 0
    """Number of the night's frames after the window's right edge."""
    frames_a_mark: int = 1

    def moved(self, marks: int, count: int, room: int = 1) -> "PlotWindow":
        """Return the window moved on by some marks, below 0 back.

        ``count``: number of frames of the night.
        ``room``: marks that the plot has room for; the window stops where the oldest frames fill
            it.
        """
        n = self.frames_a_mark
        back = self.back - marks * n
        # In whole marks: they are counted from the night's beginning.
        most = max(count - max(room, 1) * n, 0)
        return replace(self, back=min(max(back, 0), most))

    def zoomed(self, factor: float) -> "PlotWindow":
        """Return the window with ``factor`` (2 or 0.5) times as many frames to a mark."""
        frames = min(max(round(self.frames_a_mark * factor), 1), MAX_FRAMES_A_MARK)
        return replace(self, frames_a_mark=frames)

    def seen(self, rows: Sequence[FrameRow]) -> Sequence[FrameRow]:
        """Return the night's frames up to the window's right edge."""
        return rows[: len(rows) - self.back] if self.back else rows

    def visible_rows(self, rows: Sequence[FrameRow], width: int) -> Sequence[FrameRow]:
        """Return the frames shown in a plot of ``width`` columns, its axis included."""
        seen, n = self.seen(rows), self.frames_a_mark
        marks = -(-len(seen) // n)
        return seen[max(marks - max(width - AXIS_COLUMNS, 0), 0) * n :]

    def frames_words(self, rows: Sequence[FrameRow], width: int) -> str:
        """Return in words which of the night's frames a plot of ``width`` columns shows."""
        visible = self.visible_rows(rows, width)
        if self.back and visible:
            return f"{visible[0].frame_id:04d}-{visible[-1].frame_id:04d} of {len(rows)}"
        is_all = len(visible) == len(rows)
        return f"{len(rows)} frames" if is_all else f"last {len(visible)} of {len(rows)}"

    def rows(self, rows: Sequence[FrameRow], width: int | None = None) -> tuple[FrameRow, ...]:
        """Return one frame for each mark, oldest first: of several the one with the worst fit.

        ``width``: columns of the plot, whose marks alone are returned; None: all marks.
        """
        seen = self.seen(rows) if width is None else self.visible_rows(rows, width)
        n = self.frames_a_mark
        if n == 1:
            return tuple(seen)
        # Counted from the night's beginning, so that a mark keeps its frames as the night goes on.
        return tuple(max(seen[at : at + n], key=_misfit) for at in range(0, len(seen), n))

    def words(self, rows: Sequence[FrameRow]) -> str:
        """Return the window in words; empty for the newest frames, one to a mark."""
        parts = []
        if self.frames_a_mark > 1:
            parts.append(f"a mark is {self.frames_a_mark} frames, the worst shown")
        if 0 < self.back < len(rows):
            last = rows[len(rows) - 1 - self.back]
            parts.append(f"to frame {last.frame_id:04d}, {utc_text(last.t_utc_ns, 'minute')}")
        return " · ".join(parts)


def time_axis_lines(
    shown: Sequence[FrameRow], width: int, height: int, words: str = ""
) -> list[Line]:
    """Return the line of times below the frames' marks, after ``words``; none without room."""
    if height < 1:
        return []
    room = max(width - AXIS_COLUMNS, 0)
    visible = list(shown)[-room:] if room else []
    cells = cells_per_frame(room, len(visible))
    start = room - len(visible) * cells
    line = [" "] * room
    free = 0
    for number, row in enumerate(visible):
        at = start + number * cells
        label = f"╵{utc_text(row.t_utc_ns, 'minute', '')}"
        if row.t_utc_ns and at >= free and at + len(label) <= room:
            line[at : at + len(label)] = label
            free = at + LABEL_COLUMNS
    text = " " * AXIS_COLUMNS + "".join(line)
    if words:
        text = f"{words}  {text[len(words) + 2 :]}" if len(words) + 2 < width else words
    return [cut_to_width([(text, "dim")], width)]


def _misfit(row: FrameRow) -> tuple[int, float]:
    """Return a key for the worst fit: the largest residual in sigmas, then a miss, then nothing."""
    if row.residual_arcsec is None or row.sigma_arcsec is None:
        return (1 if row.miss is not None else 0), 0.0
    pairs = zip(row.residual_arcsec, row.sigma_arcsec, strict=True)
    return 2, max(abs(value) / sigma if sigma > 0.0 else math.inf for value, sigma in pairs)


NEWEST = PlotWindow()
MISS = "○"
STRIP_LABEL_COLUMNS = 22
NIS_FRAMES, MAX_JUDGED = 10, 200
WIDE_TITLE = 46
"""Columns of a plot from which on its title has whole words."""
AXES = {"east": (0, "RA·cosδ", "RA"), "north": (1, "δ", "δ ")}
"""Of each axis: its index in a residual, its name, its name where there is one row."""


def confidence_lines(
    night: NightView, width: int, height: int, *, window: PlotWindow = NEWEST
) -> list[Line]:
    """Plot the confidence of each frame's best detection, misses at 0, tau as a line."""
    rows = window.rows(night.rows, width)
    columns = [_confidence_column(night, row) for row in rows]
    columns = _with_changes(columns, rows, TAUS)
    last = next((row for row in reversed(window.seen(night.rows)) if row.is_reduced), None)
    now = _confidence_words(last)
    if height <= 1:
        label = f" conf {now} τ {short_figure(night.tau)}"
        return [_strip(label, width, confidence_strip(columns, night.tau, _strip_room(width)))]
    title = draw_rule(
        f"confidence {now}", f"{MISS} miss {REFUSED} refused  τ {short_figure(night.tau)}", width
    )
    return [title, *confidence_plot(columns, night.tau, width, height - 1)]


def residual_lines(
    night: NightView,
    axis: str,
    width: int,
    height: int,
    *,
    window: PlotWindow = NEWEST,
    of: str = "",
    on_trial: Mapping[int, tuple[float, float]] = MappingProxyType({}),
) -> list[Line]:
    """Plot the residuals of one axis, measured minus predicted, within 3-sigma bounds.

    Coasted frames have a sign at 0. The title is of the newest frame up to the right edge, however
    many frames a mark stands for. ``of``: the track's name where it is not the lead.
    ``on_trial``: one sigma (east, north), arcsec, by frame with the settings on trial. Where there
    are several tracks, the values have the track's colour.
    """
    place, name, strip_name = AXES[axis]
    rows = window.rows(night.rows, width)
    columns = _with_changes([_column(row, place, on_trial) for row in rows], rows, FILTERS)
    newest_first = reversed(window.visible_rows(night.rows, width))
    newest = next((row for row in newest_first if row.sigma_arcsec is not None), None)
    last = None if newest is None else _column(newest, place)
    value = "" if last is None or last.value is None else signed_angle(last.value)
    if last is not None and last.value is None:
        value = f"{MISS} coasted"
    elif newest is not None and newest.is_by_orbit and value:
        value += " by the orbit"
    bound = "3σ -" if last is None or last.bound is None else f"3σ {angle(last.bound)}"
    if height <= 1:
        label = f" {_of(of.removeprefix('track '), ':')}{strip_name} {value or '-'} {bound}"
        return [_strip(label, width, residual_strip(columns, _strip_room(width)))]
    said = f"{name} residual" if width >= WIDE_TITLE and not of else strip_name.strip()
    return [
        draw_rule(f"{_of(of)}{said} {value}", f"bounds {bound}", width),
        *residual_plot(columns, width, height - 1, _value_ink(night)),
    ]


def _value_ink(night: NightView) -> Ink:
    if len(night.tracks) < 2 or night.track is None:
        return "good"
    return track_ink(night.track.track_id)


def _of(of: str, gap: str = ": ") -> str:
    return f"{of}{gap}" if of else ""


def nis_lines(
    night: NightView, width: int, height: int, *, window: PlotWindow = NEWEST, of: str = ""
) -> list[Line]:
    """Plot the normalised innovation squared (NIS) with its 95 % band.

    ``of``: the track's name where it is not the lead.
    """
    updates = [row for row in window.seen(night.rows) if row.nis is not None]
    # Of the present track alone, where the window shows any of it.
    updates = [row for row in updates if row.frame_id >= night.track_frame_id] or updates
    judged_rows = since_last_change(updates)[-MAX_JUDGED:]
    values = [row.nis for row in judged_rows if row.nis is not None]
    if not values:
        return [draw_rule(f"{_of(of)}NIS: no update yet", "", width)]
    judged = consistency(values, [r.residual_arcsec for r in judged_rows if r.residual_arcsec])
    frames = window.frames_words(night.rows, width)
    mean = f"{_of(of)}NIS {judged.mean:.1f} /{judged.count} (ideal 2)"
    if height <= 1:
        spark = sparkline(values[-NIS_FRAMES:], 12.0, NIS_FRAMES)
        words = {"over-confident": "TOO LARGE", "under-confident": "too small", "too few": ""}
        brief = words.get(judged.verdict, judged.words.partition(" the ")[0])
        return [draw_rule(f"{mean} {spark} {brief}", frames, width)]
    columns = [
        PlotColumn(value=row.nis, mark=MISS if row.miss is not None and row.sigma_arcsec else "")
        for row in window.rows(night.rows, width)
    ]
    band = f"95% {NIS_BAND[0]:.2f}-{NIS_BAND[1]:.1f}"
    title = draw_rule(f"{mean} · {frames}", band, width)
    ink: Ink = "" if judged.verdict in {"sound", "too few"} else "warn"
    known_s = 0.0 if night.config is None else usual_timing_sigma_s(night.config.exposure)
    learnt = filter_summary_words(night.track, known_s)
    figures = " · ".join(each for each in (judged.words, learnt) if each)
    said = cut_to_width([(f" {figures}", ink or "dim")], width)
    return [title, *nis_plot(columns, NIS_BAND, width, height - 2), said]


TAUS, FILTERS = "detector.", "filter."
"""Beginnings of the names of the settings whose changes the two kinds of plots show."""


def _with_changes(
    columns: Sequence[PlotColumn], rows: Sequence[FrameRow], names: str
) -> list[PlotColumn]:
    """Return the columns with the settings that were changed before each, by their names' begin."""
    marked, before = list(columns), None
    for at, row in enumerate(rows):
        if not row.is_reduced:  # nothing was processed by any settings
            continue
        if before is not None and before.settings is not row.settings:
            words = change_words(before.settings, row.settings, names)
            marked[at] = replace(marked[at], change=words)
        before = row
    return marked


def _column(
    row: FrameRow, axis: int, on_trial: Mapping[int, tuple[float, float]] = MappingProxyType({})
) -> PlotColumn:
    bound = None if row.sigma_arcsec is None else 3.0 * row.sigma_arcsec[axis]
    ghost = 3.0 * on_trial[row.frame_id][axis] if row.frame_id in on_trial else None
    if row.residual_arcsec is not None:
        return PlotColumn(value=row.residual_arcsec[axis], bound=bound, ghost=ghost)
    mark = MISS if row.miss is not None and bound is not None else ""
    return PlotColumn(bound=bound, ghost=ghost, mark=mark)


def _confidence_column(night: NightView, row: FrameRow) -> PlotColumn:
    refused = likeliest_refused_streak(row)
    value = row.confidence if refused is None else None
    is_miss = row.is_reduced and value is None and row.was_sought
    return PlotColumn(
        value=value,
        mark=MISS if is_miss else "",
        refused=None if refused is None else refused[0],
        limit=night.setting("detector.tau", row.settings),
    )


def likeliest_refused_streak(row: FrameRow) -> tuple[float, str] | None:
    """Return (confidence, reason) of the likeliest refused streak; None: there is none.

    Also None if a streak of the frame was accepted, if a detection is likelier, or if the
    confidence is below ``SHOWN_REJECTED``.
    """
    if row.is_followed or row.refused is None or row.refused[0] < SHOWN_REJECTED:
        return None
    return row.refused if row.refused[0] >= (row.confidence or 0.0) else None


def _confidence_words(row: FrameRow | None) -> str:
    if row is None:
        return ""
    refused = likeliest_refused_streak(row)
    if refused is not None:
        return f"{REFUSED} {short_figure(refused[0])} {refused[1]}"
    if row.confidence is not None:
        return short_figure(row.confidence)
    return "no detection"


def _strip_room(width: int) -> int:
    return max(width - STRIP_LABEL_COLUMNS - 1, 0)


def _strip(label: str, width: int, strip: Line) -> Line:
    columns = min(STRIP_LABEL_COLUMNS, width)
    return cut_to_width([(f"{label[:columns]:<{columns}}", ""), *strip], width)
