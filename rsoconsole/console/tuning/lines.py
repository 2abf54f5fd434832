"""The tuning pane's lines: settings, figures as recorded and with changes, comparison. Pure."""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from rsoconsole.console.drawing.plot import Ink, Line
from rsoconsole.console.tuning.tuning_pane import LAST_FRAMES, Tuning
from rsoconsole.console.words.tunable import Tunable
from rsoconsole.console.words.words import cut_to_width, draw_rule, wrap_to_rows
from rsoconsole.night import merit

if TYPE_CHECKING:
    from rsoconsole.night import TrackFigures

LABEL_COLUMNS, VALUE_COLUMNS = 16, 10
CURVE_ROWS, CURVE_LABEL, MIN_SETTINGS = 2, 17, 6
"""Rows of the curves, columns before them, and least settings in view beside the curves."""
MIN_BESIDE = 3
"""Least settings in view beside the cautions."""
BARS = "▁▂▃▄▅▆▇█"
ALIKE_LOG_L = 2.0
"""Least difference of log L over all frames for one of the settings to be called better."""
UNLIKELY_NIS = 9.21
"""NIS that a sound filter exceeds in one update of a hundred."""


class TuneWords(NamedTuple):
    """Texts of the tuning pane that differ between the live screen and a review."""

    frames: str = "last {count} frames"
    """Which frames the figures cover; ``{count}`` stands for their number."""
    of_present: int | None = None
    """How many of those frames ran with the settings in force now; None: not known."""
    keys: str = "0-9 type  enter apply  u undo  w save  o load"


def tune_lines(
    tuning: Tuning,
    now: "TrackFigures | None",
    then: "TrackFigures | None",
    *,
    words: TuneWords = TuneWords(),  # noqa: B008 -- it cannot be changed
) -> Callable[[int, int], list[Line]]:
    """Return the function that builds the pane's lines: settings, then two columns of figures.

    ``now``: figures as recorded; ``then``: with the changed settings; None: not computed yet.
    """

    def build(width: int, height: int) -> list[Line]:
        waiting = sum(tuning.sent.get(name) == value for name, value in tuning.changes.items())
        changed = f"{len(tuning.changes) - waiting} tried" if tuning.changes else "nothing tried"
        if not tuning.changes and tuning.last_applied_words:
            changed = f"nothing tried, {tuning.last_applied_words}"
        if waiting:
            changed = f"{waiting} sent, in force from the next frame"
        then_now = then if tuning.changes else None
        lines: list[Line] = [draw_rule(f"tune · {changed}", "", width)]
        frames = words.frames.format(count=LAST_FRAMES if now is None else now.frames)
        figures = _figures(now, then_now, frames, has_changes=bool(tuning.changes))
        cautions = _comparison(tuning, now, then_now, words.of_present, width)
        cautions += _cautions(now, then_now, words.of_present)
        figures += cautions[: max(height - 2 - len(figures) - MIN_BESIDE, 0)]
        keys: Line = [(f" {words.keys}", "dim")]
        if height - 2 - len(figures) - CURVE_ROWS >= MIN_SETTINGS:
            figures += _curves(now, then_now, width)
        room = max(height - 2 - len(figures), 1)
        lines += _settings(tuning, room)
        spare = max(height - len(lines) - len(figures) - 1, 0)
        lines += [[("", "")]] * spare
        lines += figures
        return [cut_to_width(line, width) for line in (*lines[: max(height - 1, 0)], keys)][:height]

    return build


def _settings(tuning: Tuning, room: int) -> list[Line]:
    """Return as many settings as there is room for, the chosen one among them; a sign for more."""
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
    """Return a line with a sign that more settings follow."""
    (text, ink), *rest = line
    return [(f" {sign}", "dim"), (text[2:], ink), *rest]


def _setting(tuning: Tuning, number: int, tunable: Tunable) -> Line:
    present = tunable.words(tuning.present.get(tunable.name))
    is_chosen = number == tuning.row
    sign = "▸" if is_chosen else " "
    line: Line = [
        (f" {sign} {tunable.label:<{LABEL_COLUMNS - 4}}", "title" if is_chosen else ""),
        (f"{present:>{VALUE_COLUMNS}}", "dim" if tunable.name in tuning.changes else ""),
    ]
    if tunable.name in tuning.changes:
        value = tuning.changes[tunable.name]
        is_sent = tuning.sent.get(tunable.name) == value
        # In force when the record shows it: from the next frame.
        line.append((f"  → {tunable.words(value)}", "good" if is_sent else "warn"))
        if is_sent:
            line.append((" sent", "good"))
    return line


def _figures(
    now: "TrackFigures | None", then: "TrackFigures | None", frames: str, *, has_changes: bool
) -> list[Line]:
    head = f" {frames}".ljust(LABEL_COLUMNS + 4)
    lines: list[Line] = [
        [(f"{head}{'as it was':>{VALUE_COLUMNS}}{'if tried':>{VALUE_COLUMNS}}", "dim")]
    ]
    inks: dict[bool | None, Ink] = {True: "good", False: "warn", None: ""}
    for each in merit.TUNED:
        line: Line = [(f"  {each.label:<{LABEL_COLUMNS + 2}}", "")]
        for figures, is_coming in ((now, True), (then, has_changes)):
            text = ("…" if is_coming else "-") if figures is None else each.words(figures)
            is_sound = figures.is_nis_sound if figures and each is merit.NIS_MEAN else None
            line.append((f"{text:>{VALUE_COLUMNS}}", "dim" if figures is None else inks[is_sound]))
        lines.append(line)
    return lines


def _comparison(
    tuning: Tuning,
    now: "TrackFigures | None",
    then: "TrackFigures | None",
    of_present: int | None,
    width: int,
) -> list[Line]:
    """Return which settings the same frames favour, by their log L; empty: not known.

    Source: two models whose log likelihoods differ by less than 2 (Burnham & Anderson 2002, 2.6).
    """
    if now is None or then is None or now.updates != then.updates:
        return []
    if now.log_likelihood_mean is None or then.log_likelihood_mean is None:
        return []
    more = then.log_likelihood_mean - now.log_likelihood_mean
    total = more * now.updates
    comparison: tuple[str, Ink] = ("no difference", "")
    if abs(total) >= ALIKE_LOG_L:
        comparison = ("better", "good") if total > 0.0 else ("worse", "warn")
    what = tuning.trial_words
    if of_present is not None and of_present < now.frames:
        what = f"{what.partition(' against ')[0]} against as it was"
    said = f"{what}: {comparison[0]} (Δ log L {more:+.2f} over {now.frames} frames)"
    return [
        [(f" {line[0][0].strip()}", comparison[1])] for line in wrap_to_rows(said, width - 1, 2)
    ]


def _cautions(
    now: "TrackFigures | None", then: "TrackFigures | None", of_present: int | None
) -> list[Line]:
    """Return the reasons why the figures cannot be compared; usually none."""
    lines: list[Line] = []
    if now is not None and then is not None and then.updates != now.updates:
        fewer = now.updates - then.updates
        what = f"{abs(fewer)} {'fewer' if fewer > 0 else 'more'} measured"
        lines.append([(f" {what}: rms, NIS not comparable", "warn")])
    if now is not None and of_present is not None and of_present < now.frames:
        said = f" as it was: {of_present} of {now.frames} by what is in force now,"
        lines.append([(said, "warn")])
        rest = now.frames - of_present
        lines.append([(f" {rest} by older settings: log L moves as they go", "warn")])
    for label, figures in (("as it was", now), ("if tried", then)):
        if figures is not None and figures.is_nis_sound is False and figures.nis_band:
            low, high = figures.nis_band
            lines.append([(f" NIS mean {label}: ✓ from {low:.2f} to {high:.2f}", "warn")])
            break
    return lines


def _curves(now: "TrackFigures | None", then: "TrackFigures | None", width: int) -> list[Line]:
    """Return the NIS frame by frame as two rows of bars: as recorded, and with the changes."""
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
    """Return a bar of eight heights up to ``UNLIKELY_NIS``; a dot for a miss."""
    if nis is None:
        return "·"
    return BARS[min(int(nis / UNLIKELY_NIS * (len(BARS) - 1)), len(BARS) - 1)]
