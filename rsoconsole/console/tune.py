"""The tuning pane: settings, what each would have made of this night, and the word to apply."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple

from textual.binding import Binding, BindingType
from textual.message import Message

from rsoconsole.console.panes import LinesPane
from rsoconsole.console.plot import Ink, Line
from rsoconsole.console.words import clipped

if TYPE_CHECKING:
    from rsoconsole.pipeline.what_if import TrackFigures

Value = float | int | str
Wanting = Literal["apply", "lend", "undo", "save", "load", "close", "try", "type"]
LAST_FRAMES = 40
LABEL_COLUMNS, VALUE_COLUMNS = 16, 10
CURVE_ROWS, CURVE_LABEL, LEAST_SETTINGS = 2, 17, 6
"""Rows of the curves, columns before them, and settings that must stay in sight beside them."""
LEAST_BESIDE = 3
"""Settings that stay in sight beside what the figures cannot be compared by."""
BARS = "▁▂▃▄▅▆▇█"
UNLIKELY_NIS = 9.21
"""One update in a hundred of a sound filter exceeds it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tunable:
    """One setting and how it steps."""

    name: str
    label: str
    unit: str = ""
    factor: float = 1.25
    """Of one step."""
    low: float = 0.0
    high: float = math.inf
    choices: tuple[str, ...] = ()
    preset: str | None = None
    """Of the filter, which alone asks for it; None: every one does."""

    def stepped(self, value: Value, by: int) -> Value:
        """So many steps from a value, in figures that a person would type."""
        if self.choices:
            at = self.choices.index(str(value)) if value in self.choices else 0
            return self.choices[(at + by) % len(self.choices)]
        stepped = float(value) * self.factor**by
        return float(f"{min(max(stepped, self.low), self.high):.3g}")

    def words(self, value: Value | None) -> str:
        """The value as it is shown."""
        if value is None:
            return "-"
        return f"{value:.4g}{self.unit}" if isinstance(value, float | int) else value


def _multiplier(of: str, label: str) -> Tunable:
    factor = 1.5 if of.startswith("q") else 1.25
    return Tunable(name=f"filter.{of}_multiplier", label=label, factor=factor, low=1e-6, high=1e6)


TUNABLES = (
    Tunable(name="detector.tau", label="τ", low=0.01, high=0.99),
    Tunable(name="filter.preset", label="preset", choices=("adaptive", "tuned", "paper")),
    Tunable(name="filter.sigma_arcsec", label="σ", unit="″", low=0.05, high=600.0, preset="paper"),
    Tunable(
        name="filter.q_arcsec2_s3",
        label="q",
        unit=" ″²/s³",
        factor=2.0,
        low=1e-9,
        high=1e3,
        preset="tuned",
    ),
    _multiplier("q", "Q ×"),
    _multiplier("q_ra", "Q α ×"),
    _multiplier("q_ra_rate", "Q α rate ×"),
    _multiplier("q_dec", "Q δ ×"),
    _multiplier("q_dec_rate", "Q δ rate ×"),
    _multiplier("r", "R ×"),
    _multiplier("r_ra", "R α ×"),
    _multiplier("r_dec", "R δ ×"),
    Tunable(name="filter.gate_nis", label="gate NIS", low=1.0, high=1e6),
    Tunable(name="filter.max_coast_s", label="lost after", unit=" s", low=10.0, high=86400.0),
    Tunable(name="filter.max_3sigma_arcmin", label="lost at 3σ", unit="′", low=0.1, high=600.0),
)
NAMES = tuple(tunable.name for tunable in TUNABLES)
PRESET = "filter.preset"


@dataclass(slots=True)
class Tuning:
    """What is in force, what is tried, and what was in force before that was applied."""

    present: dict[str, Value | None] = field(default_factory=dict)
    tried: dict[str, Value] = field(default_factory=dict)
    before: list[dict[str, Value]] = field(default_factory=list)
    """What each application changed, the last one at the end."""
    steps: dict[str, int] = field(default_factory=dict)
    """How many each is away from what is in force, or from what a preset said."""
    loaded: dict[str, Value] = field(default_factory=dict)
    """What a loaded preset said."""
    row: int = 0
    sent: dict[str, Value] = field(default_factory=dict)
    """What the engine has been given and the record does not show yet."""

    @property
    def tunables(self) -> tuple[Tunable, ...]:
        """Those that have a part with the preset that is tried, or in force."""
        preset = self.tried.get(PRESET, self.present.get(PRESET))
        return tuple(t for t in TUNABLES if t.preset is None or preset in (None, t.preset))

    def see(self, present: Mapping[str, Value | None]) -> None:
        """What is in force now; what is tried and has become so is no trial any more."""
        self.present = dict(present)
        self.row = min(self.row, len(self.tunables) - 1)
        self.tried = {n: v for n, v in self.tried.items() if self.present.get(n) != v}
        self.steps = {n: k for n, k in self.steps.items() if n in self.tried}
        self.loaded = {n: v for n, v in self.loaded.items() if n in self.tried}
        self.sent = {n: v for n, v in self.sent.items() if self.tried.get(n) == v}

    def step(self, by: int) -> None:
        """Change the chosen one."""
        tunable = self.tunables[self.row]
        present = self.present.get(tunable.name)
        if present is None:
            return
        before = self.steps.get(tunable.name, 0)
        steps = before + by
        from_preset = self.loaded.get(tunable.name)
        stepped = tunable.stepped(present if from_preset is None else from_preset, steps)
        if before and stepped == self.tried.get(tunable.name):
            return  # at its bound: no step that would have to be gone back
        if (steps == 0 and from_preset is None) or stepped == present:
            self.tried.pop(tunable.name, None)
            self.steps.pop(tunable.name, None)
        else:
            self.tried[tunable.name], self.steps[tunable.name] = stepped, steps
        if tunable.name == PRESET:
            names = {each.name for each in self.tunables}
            self.tried = {n: v for n, v in self.tried.items() if n in names}

    def type(self, text: str) -> str:
        """Try the number that was typed for the chosen one; what is wrong with it, else nothing."""
        tunable = self.tunables[self.row]
        if tunable.choices:
            if text not in tunable.choices:
                return f"{tunable.label} is one of {', '.join(tunable.choices)}"
            value: Value = text
        else:
            try:
                value = float(text.replace("−", "-").replace(",", "."))
            except ValueError:
                return f"{text!r} is no number"
            if not tunable.low <= value <= tunable.high:
                return f"{tunable.label} lies between {tunable.low:g} and {tunable.high:g}"
        if self.present.get(tunable.name) == value:
            self.tried.pop(tunable.name, None)
        else:
            self.tried[tunable.name] = value
        self.steps.pop(tunable.name, None)
        # The steps go on from here.
        self.loaded[tunable.name] = value
        return ""

    def load(self, preset: Mapping[str, Value]) -> None:
        """Try what a preset says."""
        self.tried = {n: v for n, v in preset.items() if self.present.get(n) != v}
        self.loaded, self.steps = dict(self.tried), {}

    def apply(self) -> dict[str, Value]:
        """What is to be set; it can be undone."""
        wanted = dict(self.tried)
        present = {name: self.present.get(name) for name in wanted}
        if wanted:
            self.before.append({n: value for n, value in present.items() if value is not None})
        self.sent = dict(wanted)
        return wanted

    def undo(self) -> dict[str, Value]:
        """What is to be set so that it is as it was before the last application."""
        wanted = self.before.pop() if self.before else {}
        self.tried.clear()
        self.steps.clear()
        return wanted


class TunePane(LinesPane, can_focus=False):
    """Shows a tuning; its keys change it, and say what is wanted. Open, it may have the focus."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "row(-1)", "Setting above"),
        Binding("down", "row(1)", "Setting below"),
        Binding("left", "step(-1)", "Less"),
        Binding("right", "step(1)", "More"),
        Binding("enter", "say('apply')", "Apply"),
        Binding("f", "say('lend')", "Apply for so many frames"),
        Binding("u", "say('undo')", "Undo"),
        Binding("w", "say('save')", "Save as preset"),
        Binding("o", "say('load')", "Load a preset"),
        Binding("t,escape", "say('close')", "Close"),
        *(Binding(key, f"type('{key}')", show=False) for key in "0123456789"),
        Binding("full_stop", "type('.')", show=False),
    ]
    DEFAULT_CSS = """
    TunePane { background: $surface; border: none; }
    """

    class Wanted(Message):
        """Something is to be done with the tuning."""

        def __init__(self, what: Wanting, begun: str = "") -> None:
            """``begun``: what has been typed of a number."""
            super().__init__()
            self.what, self.begun = what, begun

    tuning: Tuning | None = None

    def action_row(self, by: int) -> None:
        """Another setting."""
        if self.tuning is not None:
            self.tuning.row = (self.tuning.row + by) % len(self.tuning.tunables)
            self.post_message(self.Wanted("try"))

    def action_step(self, by: int) -> None:
        """More or less of it."""
        if self.tuning is not None:
            self.tuning.step(by)
            self.post_message(self.Wanted("try"))

    def action_type(self, begun: str) -> None:
        """The first figure of a number for the chosen setting."""
        self.post_message(self.Wanted("type", begun))

    def action_say(self, what: Wanting) -> None:
        """What is wanted."""
        self.post_message(self.Wanted(what))


class TuneWords(NamedTuple):
    """What the pane says that depends on the screen it is on."""

    frames: str = "last {count} frames"
    """Over which its figures are; how many there are is put in."""
    since_change: int | None = None
    """Frames since a setting of these was changed; None: none was."""
    keys: str = "0-9 type  enter apply  u undo  w save  o load"


def tune_lines(
    tuning: Tuning,
    now: "TrackFigures | None",
    then: "TrackFigures | None",
    *,
    words: TuneWords = TuneWords(),  # noqa: B008 -- it cannot be changed
) -> Callable[[int, int], list[Line]]:
    """What builds the pane's lines: settings, then figures now and with what is tried."""

    def build(width: int, height: int) -> list[Line]:
        waiting = sum(tuning.sent.get(name) == value for name, value in tuning.tried.items())
        changed = f"{len(tuning.tried) - waiting} tried" if tuning.tried else "nothing tried"
        if waiting:
            changed = f"{waiting} sent, in force from the next frame"
        then_now = then if tuning.tried else None
        lines: list[Line] = [_rule(f"tune · {changed}", width)]
        frames = words.frames.format(count=LAST_FRAMES if now is None else now.frames)
        figures = _figures(now, then_now, frames, is_tried=bool(tuning.tried))
        cautions = _cautions(now, then_now, words.since_change)
        figures += cautions[: max(height - 2 - len(figures) - LEAST_BESIDE, 0)]
        keys: Line = [(f" {words.keys}", "dim")]
        if height - 2 - len(figures) - CURVE_ROWS >= LEAST_SETTINGS:
            figures += _curves(now, then_now, width)
        room = max(height - 2 - len(figures), 1)
        lines += _settings(tuning, room)
        spare = max(height - len(lines) - len(figures) - 1, 0)
        lines += [[("", "")]] * spare
        lines += figures
        return [clipped(line, width) for line in (*lines[: max(height - 1, 0)], keys)][:height]

    return build


def _settings(tuning: Tuning, room: int) -> list[Line]:
    """As many as there is room for, the chosen one among them; a sign where there are more."""
    every = tuning.tunables
    first = min(max(tuning.row - room // 2, 0), max(len(every) - room, 0))
    shown = range(first, min(first + room, len(every)))
    lines = [_setting(tuning, number, every[number]) for number in shown]
    if lines and first > 0:
        lines[0] = _with_sign("▲", lines[0])
    if lines and shown.stop < len(every):
        lines[-1] = _with_sign("▼", lines[-1])
    return lines


def _with_sign(sign: str, line: Line) -> Line:
    """There are more beyond this one, which is never the chosen one then."""
    (text, ink), *rest = line
    return [(f" {sign}", "dim"), (text[2:], ink), *rest]


def _setting(tuning: Tuning, number: int, tunable: Tunable) -> Line:
    present = tunable.words(tuning.present.get(tunable.name))
    is_chosen = number == tuning.row
    sign = "▸" if is_chosen else " "
    line: Line = [
        (f" {sign} {tunable.label:<{LABEL_COLUMNS - 4}}", "title" if is_chosen else ""),
        (f"{present:>{VALUE_COLUMNS}}", "dim" if tunable.name in tuning.tried else ""),
    ]
    if tunable.name in tuning.tried:
        value = tuning.tried[tunable.name]
        is_sent = tuning.sent.get(tunable.name) == value
        # In force when the record shows it: from the next frame.
        line.append((f"  → {tunable.words(value)}", "good" if is_sent else "warn"))
        if is_sent:
            line.append((" sent", "good"))
    return line


def _figures(
    now: "TrackFigures | None", then: "TrackFigures | None", frames: str, *, is_tried: bool
) -> list[Line]:
    head = f" {frames}".ljust(LABEL_COLUMNS + 4)
    lines: list[Line] = [
        [(f"{head}{'as it was':>{VALUE_COLUMNS}}{'if tried':>{VALUE_COLUMNS}}", "dim")]
    ]
    rows: tuple[tuple[str, Callable[[TrackFigures], tuple[str, Ink]]], ...] = (
        ("residual rms", lambda f: (_text(f.residual_rms_arcsec, ".2f", "″"), "")),
        ("NIS mean (2)", _nis),
        ("log L ↑ is better", lambda f: (_text(f.log_likelihood_mean, "+.2f"), "")),
        ("3σ holds", lambda f: (_percent(f.inside_3sigma), "")),
        ("misses", lambda f: (f"{f.misses}", "")),
        ("state", lambda f: (f.state or "-", "")),
    )
    for label, words in rows:
        line: Line = [(f"  {label:<{LABEL_COLUMNS + 2}}", "")]
        for figures, is_coming in ((now, True), (then, is_tried)):
            absent: tuple[str, Ink] = ("…" if is_coming else "-", "dim")
            text, ink = absent if figures is None else words(figures)
            line.append((f"{text:>{VALUE_COLUMNS}}", ink))
        lines.append(line)
    return lines


def _cautions(
    now: "TrackFigures | None", then: "TrackFigures | None", since_change: int | None
) -> list[Line]:
    """What the figures cannot be compared by; none as a rule."""
    lines: list[Line] = []
    if now is not None and then is not None and then.updates != now.updates:
        fewer = now.updates - then.updates
        what = f"{abs(fewer)} {'fewer' if fewer > 0 else 'more'} measured"
        lines.append([(f" {what}: rms, NIS not comparable", "warn")])
    if now is not None and since_change is not None and since_change < now.frames:
        said = f" as it was: {since_change} of {now.frames} by what is in force now"
        lines.append([(said, "warn")])
    for label, figures in (("as it was", now), ("if tried", then)):
        if figures is not None and figures.is_nis_sound is False and figures.nis_band:
            low, high = figures.nis_band
            lines.append([(f" NIS mean {label}: ✓ from {low:.2f} to {high:.2f}", "warn")])
            break
    return lines


def _curves(now: "TrackFigures | None", then: "TrackFigures | None", width: int) -> list[Line]:
    """NIS frame by frame, as it was and with what is tried, one over the other."""
    room = max(width - CURVE_LABEL, 1)
    lines: list[Line] = []
    for label, figures in (("NIS as it was", now), ("NIS if tried", then)):
        line: Line = [(f"  {label:<{CURVE_LABEL - 2}}", "dim")]
        for nis in () if figures is None else figures.nis_curve[-room:]:
            is_out = nis is not None and nis > UNLIKELY_NIS
            line.append((_bar(nis), "warn" if is_out else ""))
        lines.append(line)
    return lines


def _bar(nis: float | None) -> str:
    """Of eight heights; the last is what one update in a hundred exceeds, a dot is a miss."""
    if nis is None:
        return "·"
    return BARS[min(int(nis / UNLIKELY_NIS * (len(BARS) - 1)), len(BARS) - 1)]


def _nis(figures: "TrackFigures") -> tuple[str, Ink]:
    sound = figures.is_nis_sound
    sign = {True: " ✓", False: " ✗", None: ""}[sound]
    ink: Ink = {True: "good", False: "warn", None: ""}[sound]  # type: ignore[assignment]
    return f"{_text(figures.nis_mean, '.2f')}{sign}", ink


def _text(value: float | None, form: str, unit: str = "") -> str:
    return "-" if value is None else f"{value:{form}}{unit}"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{value:.0%}"


def _rule(words: str, width: int) -> Line:
    return [("─ ", "dim"), (words, "title"), (" " + "─" * max(width - len(words) - 3, 0), "dim")]
