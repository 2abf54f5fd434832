"""The comparison of two moments of a night, A and B, and what was recorded between them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, Literal

from textual.app import ComposeResult
from textual.binding import Binding, BindingType

from rsoconsole.console.commands.keymap import first_key
from rsoconsole.console.dialogs.dialogs import Dialog, dialog_box
from rsoconsole.console.drawing.plot import Line
from rsoconsole.console.panes.panes import LinesPane
from rsoconsole.console.screens._review_moves import ReviewNavigation
from rsoconsole.console.timeline.lines import SIGNS, recorded_controller
from rsoconsole.console.timeline.moments import Moment
from rsoconsole.console.timeline.timeline import KINDS, Timeline, TimelineEventKind
from rsoconsole.console.words.words import cos_deg, cut_to_width
from rsoconsole.night import FrameRow, predicted_sigma_arcsec
from rsoconsole.records import Solution
from rsoconsole.words import (
    NS_PER_S,
    angle,
    duration_words,
    format_dec,
    format_ra,
    short_figure,
    signed_angle,
    utc_text,
)

ABSENT = "-"
LABEL_COLUMNS, MIN_VALUE_COLUMNS = 12, 12
WITH_DIFFERENCE_COLUMNS = 66
KIND_WORDS: dict[TimelineEventKind, tuple[str, str]] = {
    "miss": ("miss", "misses"),
    "rejection": ("rejection", "rejections"),
    "loss": ("loss", "losses"),
    "operator": ("operator's action", "operator's actions"),
    "note": ("note", "notes"),
    "alarm": ("alarm", "alarms"),
}
Choice = Literal["blink", "keep"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedRow:
    """One row of the comparison: a figure at both moments, in words."""

    label: str
    a: str
    b: str
    difference: str = ""
    """B minus A, in words; empty where a difference has no meaning."""


def compared_figures(a: Moment, b: Moment) -> list[ComparedRow]:
    """Return the rows of the comparison: every figure that is known at A or at B."""
    rows = [*_course(a, b), *_sky(a, b), *_measured(a, b)]
    return [row for row in rows if (row.a, row.b) != (ABSENT, ABSENT)]


def _course(a: Moment, b: Moment) -> list[ComparedRow]:
    t_a, t_b = a.view.last_utc_ns, b.view.last_utc_ns
    since = ""
    if t_a and t_b:
        sign = "-" if t_b < t_a else "+"
        since = sign + duration_words(abs(t_b - t_a) / NS_PER_S)
    ids = [None if m.view.frame is None else m.view.frame.frame_id for m in (a, b)]
    frames = "" if ids[0] is None or ids[1] is None else f"{ids[1] - ids[0]:+d}"
    return [
        ComparedRow(label="time", a=utc_text(t_a), b=utc_text(t_b), difference=since),
        ComparedRow(label="frame", a=_number(ids[0]), b=_number(ids[1]), difference=frames),
        _both("state", a, b, lambda m: m.view.state),
        _both("mount", a, b, lambda m: recorded_controller(m.view)),
        _both("τ", a, b, lambda m: short_figure(m.view.tau)),
        _both("filter", a, b, _filter_words),
        _both("Q, R", a, b, _multiplier_words),
    ]


def _sky(a: Moment, b: Moment) -> list[ComparedRow]:
    points = [_pointing(m) for m in (a, b)]
    tracks = [_position(m) for m in (a, b)]
    rates = [_rates(m) for m in (a, b)]
    sigmas = [_three_sigma(m) for m in (a, b)]
    grown = "" if None in sigmas else f"×{(sigmas[1] or 0) / max(sigmas[0] or 0, 1e-9):.2g}"
    three_sigma = replace(_numbers("3σ", sigmas, angle), difference=grown)
    return [
        *_direction("pointing", points),
        *_direction("track", tracks),
        _numbers("rate α", [r and r[0] for r in rates], lambda v: f"{v:+.3f}″/s"),
        _numbers("rate δ", [r and r[1] for r in rates], lambda v: f"{v:+.3f}″/s"),
        three_sigma,
    ]


def _measured(a: Moment, b: Moment) -> list[ComparedRow]:
    rows = [_row(m) for m in (a, b)]
    residuals = [None if row is None else row.residual_arcsec for row in rows]

    def unsigned(
        label: str, value: Callable[[FrameRow], float | None], words: Callable[[float], str]
    ) -> ComparedRow:
        values = [None if row is None else value(row) for row in rows]
        return _numbers(label, values, words, is_signed=False)

    matched = [_matched(m) for m in (a, b)]
    return [
        _numbers("residual α", [r and r[0] for r in residuals], signed_angle),
        _numbers("residual δ", [r and r[1] for r in residuals], signed_angle),
        unsigned("NIS", lambda row: row.nis, lambda v: f"{v:.2f}"),
        unsigned("confidence", lambda row: row.confidence, short_figure),
        _both("not taken", a, b, _refusal),
        unsigned("star width", lambda row: row.fwhm_px, lambda v: f"{v:.2f} px"),
        _numbers("stars", matched, lambda v: f"{v:.0f}", is_signed=False),
    ]


def interval_words(a: Moment, b: Moment, timeline: Timeline) -> list[str]:
    """Return what is recorded between the moments, in lines: counts, then changed settings."""
    low, high = sorted((a.seq, b.seq))
    first, last = timeline.frame_index(low), timeline.frame_index(high)
    frames = (-1 if last is None else last) - (-1 if first is None else first)
    counts = {
        kind: sum(low < h.seq <= high for h in timeline.events if h.kind == kind) for kind in KINDS
    }
    parts = [f"{frames} frame{'' if frames == 1 else 's'}"]
    parts += [
        f"{SIGNS[kind]} {count} {KIND_WORDS[kind][count != 1]}"
        for kind, count in counts.items()
        if count
    ]
    names = sorted({*a.view.changed, *b.view.changed})
    changes = [(name, a.view.setting(name), b.view.setting(name)) for name in names]
    return [
        " · ".join(parts),
        *(f"{name}: {old} → {new}" for name, old, new in changes if old != new),
    ]


def compare_lines(rows: list[ComparedRow], ends: list[str], width: int, height: int) -> list[Line]:
    """Return the comparison as a table; narrow tables leave the differences out.

    ``ends``: the lines below the table on what is recorded between the moments.
    """
    has_difference = width >= WITH_DIFFERENCE_COLUMNS
    columns = max((width - LABEL_COLUMNS) // (3 if has_difference else 2), MIN_VALUE_COLUMNS)
    head: Line = [(" " * LABEL_COLUMNS, ""), ("A".ljust(columns), "title")]
    head += [("B".ljust(columns), "title"), ("B - A" if has_difference else "", "dim")]
    lines = [cut_to_width(head, width)]
    for row in rows:
        is_same = row.a == row.b
        line: Line = [
            (f"{row.label:<{LABEL_COLUMNS}}", "dim"),
            (row.a.ljust(columns), ""),
            (row.b.ljust(columns), "" if is_same else "title"),
        ]
        if has_difference:
            line.append((row.difference, "dim"))
        lines.append(cut_to_width(line, width))
    lines.append([("", "")])
    lines += [
        cut_to_width([("between     " if not n else " " * 12, "dim"), (text, "")], width)
        for n, text in enumerate(ends)
    ]
    return lines[:height]


class CompareDialog(Dialog[Choice | None]):
    """Dialog that compares moments A and B.

    Result: "blink" to show the other moment, "keep" to make B the new A, or None.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("B", "choose('blink')", "Blink", show=False),
        Binding("K", "choose('keep')", "Keep B as A", show=False),
        Binding("q", "put_away", "Back", show=False),
    ]
    DEFAULT_CSS = """
    CompareDialog > VerticalScroll { width: 100; }
    CompareDialog LinesPane { height: auto; }
    """

    def __init__(self, a: Moment, b: Moment, timeline: Timeline) -> None:
        super().__init__()
        self._rows, self._ends = compared_figures(a, b), interval_words(a, b, timeline)

    def compose(self) -> ComposeResult:
        """Make the pane of the table."""
        with dialog_box("compare A with B, this moment", "B blinks · K keeps B as A · esc back"):
            table = LinesPane(id="compared")
            table.styles.height = len(self._rows) + len(self._ends) + 2
            yield table

    def on_mount(self) -> None:
        """Fill the pane with the table."""
        lines = partial(compare_lines, self._rows, self._ends)
        self.query_one("#compared", LinesPane).show(lines)

    def action_choose(self, choice: Choice) -> None:
        """Close with the choice whose letter was typed."""
        self.dismiss(choice)


def _both(label: str, a: Moment, b: Moment, words: Callable[[Moment], str | None]) -> ComparedRow:
    return ComparedRow(label=label, a=words(a) or ABSENT, b=words(b) or ABSENT)


def _numbers(
    label: str, values: list[float | None], words: Callable[[float], str], *, is_signed: bool = True
) -> ComparedRow:
    a, b = values
    difference = ""
    if a is not None and b is not None:
        difference = f"{'' if is_signed or b <= a else '+'}{words(b - a)}"
    texts = [ABSENT if value is None else words(value) for value in values]
    return ComparedRow(label=label, a=texts[0], b=texts[1], difference=difference)


def _direction(label: str, places: list[tuple[float, float] | None]) -> list[ComparedRow]:
    texts = [
        (ABSENT, ABSENT) if p is None else (format_ra(p[0], 1), format_dec(p[1], 0)) for p in places
    ]
    east = north = ""
    a, b = places
    if a is not None and b is not None:
        dra_deg = (b[0] - a[0] + 180.0) % 360.0 - 180.0
        middle_deg = (a[1] + b[1]) / 2.0
        east, north = (
            signed_angle(3600.0 * deg) for deg in (dra_deg * cos_deg(middle_deg), b[1] - a[1])
        )
    return [
        ComparedRow(label=f"{label} α", a=texts[0][0], b=texts[1][0], difference=east),
        ComparedRow(label=f"{label} δ", a=texts[0][1], b=texts[1][1], difference=north),
    ]


def _number(frame_id: int | None) -> str:
    return ABSENT if frame_id is None else f"{frame_id:04d}"


def _filter_words(m: Moment) -> str | None:
    preset, sigma = m.view.setting("filter.preset"), m.view.setting("filter.sigma_arcsec")
    return None if preset is None else f"{preset} σ {sigma:g}″"


def _multiplier_words(m: Moment) -> str | None:
    q, r = m.view.setting("filter.q_multiplier"), m.view.setting("filter.r_multiplier")
    return None if q is None or r is None else f"×{q:.3g}  ×{r:.3g}"


def _pointing(m: Moment) -> tuple[float, float] | None:
    p = m.view.pointing
    return None if p is None else (p.ra_icrs_deg, p.dec_icrs_deg)


def _position(m: Moment) -> tuple[float, float] | None:
    track = m.view.track
    return None if track is None else (track.x[0] % 360.0, track.x[2])


def _rates(m: Moment) -> tuple[float, float] | None:
    """Return the track's rates (d alpha cos delta, d delta), arcsec/s; None: no track."""
    track = m.view.track
    if track is None:
        return None
    return track.x[1] * cos_deg(track.x[2]) * 3600.0, track.x[3] * 3600.0


def _three_sigma(m: Moment) -> float | None:
    track = m.view.track
    return None if track is None else 3.0 * max(predicted_sigma_arcsec(track))


def _row(m: Moment) -> FrameRow | None:
    rows, frame = m.view.rows, m.view.frame
    if frame is None:
        return None
    return next((row for row in reversed(rows) if row.frame_id == frame.frame_id), None)


def _refusal(m: Moment) -> str | None:
    row = _row(m)
    if row is None:
        return None
    if row.miss is not None:
        return row.miss
    return None if row.refused is None or row.is_followed else row.refused[1]


def _matched(m: Moment) -> float | None:
    solution = m.detail.solution
    return float(solution.matched) if isinstance(solution, Solution) else None


class ReviewComparison(ReviewNavigation):
    """Review that keeps a moment A, to compare and to alternate with the shown moment B."""

    _other_seq: int | None = None
    """Place of B in the log, while A is shown instead; else None."""
    _is_asked_early = False
    """True where the comparison is to open as soon as the requested moment has been read."""

    def forget_moment_a(self) -> None:
        """Drop moment A because another session is shown."""
        self.kept = self._other_seq = None

    def action_compare(self) -> None:
        """Keep the shown moment as A; with A kept already, compare the shown moment with A."""
        moment = self.moment
        self._is_asked_early = moment is None or moment.seq != self.seq
        if moment is None or self._is_asked_early:
            self.say("the moment is being fetched …")
        elif self.kept is None:
            self._keep(moment)
        elif self.kept.seq == moment.seq and self._other_seq is None:
            self.say("this is A: go to another moment, then compare")
        else:
            self._compare(self.kept, moment)

    def compare_when_ready(self) -> None:
        """Do the comparison that was requested before its moment had been read, if there is one."""
        if self._is_asked_early and self.moment is not None and self.moment.seq == self.seq:
            self.action_compare()

    def _compare(self, kept: Moment, moment: Moment) -> None:
        if kept.seq == moment.seq:
            self.action_blink()  # A is shown in B's place: back to B, which is what is compared
            self.say("B: compare it with A from here")
            return

        def decided(choice: Choice | None) -> None:
            if choice == "blink":
                self.action_blink()
            elif choice == "keep":
                self._keep(moment)

        self.app.push_screen(CompareDialog(kept, moment, self.timeline), decided)

    def _keep(self, moment: Moment) -> None:
        self.kept, self._other_seq = moment, None
        self.show_timeline()
        key = first_key("compare", self.keymap)
        self.say(f"A is kept: go to another moment, {key} compares", "good")

    def action_blink(self) -> None:
        """Switch between the moments A and B."""
        if self.kept is None:
            self.say(f"{first_key('compare', self.keymap)} keeps a moment to blink with")
        elif self.seq != self.kept.seq:
            other = self.seq
            self.go(self.kept.seq)
            self._other_seq = other
            self.say("A")
        elif self._other_seq is None:
            self.say("this is A: go to another moment to blink with")
        else:
            self.go(self._other_seq)
            self.say("B")

    def action_forget_moment(self) -> None:
        """Drop moment A."""
        had_one, self.kept, self._other_seq = self.kept is not None, None, None
        self.show_timeline()
        self.say("A is forgotten" if had_one else "no moment is kept")
