"""The tuning pane's lines: settings, figures as recorded and with changes, comparison. Pure."""

from collections.abc import Callable
from typing import NamedTuple

from rsoconsole.console.drawing.plot import Ink, Line
from rsoconsole.console.tuning.tuning_pane import LAST_FRAMES, TuneFigures, Tuning
from rsoconsole.console.words.tunable import LEARNING, Tunable
from rsoconsole.console.words.words import cut_to_width, draw_rule, wrap_to_rows
from rsoconsole.night import merit
from rsoconsole.tracking import Settled
from rsoconsole.words import count_words, short_figure

LABEL_COLUMNS, VALUE_COLUMNS = 14, 11
MIN_SETTINGS = 5
"""Least settings in view beside the figures."""
ALIKE_LOG_L = 2.0
"""Least difference of log L over all frames for one of the settings to be called better."""


class TuneWords(NamedTuple):
    """Texts of the tuning pane that differ between the live screen and a review."""

    frames: str = "last {count} frames"
    """Which frames the figures cover; ``{count}`` stands for their number."""
    of_present: int | None = None
    """How many of those frames ran with the settings in force now; None: not known."""
    aims_by_orbit: bool = False
    """True where the orbit aims the telescope: Q then moves the bounds alone."""
    learnt: str = ""
    """What the filter has learnt of the night's noise."""
    keys: str = "0-9 u undo l learn p propose"


def tune_lines(
    tuning: Tuning,
    figures: TuneFigures,
    *,
    words: TuneWords = TuneWords(),  # noqa: B008 -- it cannot be changed
) -> Callable[[int, int], list[Line]]:
    """Return the function that builds the pane's lines: settings, then two columns of figures."""

    def build(width: int, height: int) -> list[Line]:
        waiting = sum(tuning.sent.get(name) == value for name, value in tuning.changes.items())
        changed = f"{len(tuning.changes) - waiting} tried" if tuning.changes else "nothing tried"
        if not tuning.changes and tuning.last_applied_words:
            changed = tuning.last_applied_words
        if waiting:
            changed = f"{waiting} sent, from the next frame"
        shown = figures if tuning.changes else figures._replace(then=None, settled_then=None)
        below = _settled(shown, tuning, words)
        below += _comparison(tuning, shown, words.of_present, width)
        below += _figures(shown, words.frames, has_changes=bool(tuning.changes))
        below += _cautions(shown, words.of_present, width)
        room = max(height - 2, 0)
        below = below[: max(room - MIN_SETTINGS, 0)]
        settings = _settings(tuning, max(room - len(below), 1))
        spare: list[Line] = [[("", "")]] * max(room - len(settings) - len(below), 0)
        title = draw_rule(f"tune · {changed}", "", width)
        lines: list[Line] = [title, *settings, *spare, *below]
        lines = [*lines[: max(height - 1, 0)], [(f" {words.keys}", "dim")]]
        return [cut_to_width(line, width) for line in lines][:height]

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
        (f" {sign} {tunable.label:<{LABEL_COLUMNS - 3}}", "title" if is_chosen else ""),
        (f"{present:>{VALUE_COLUMNS}}", "dim" if tunable.name in tuning.changes else ""),
    ]
    if tunable.name in tuning.changes:
        value = tuning.changes[tunable.name]
        is_sent = tuning.sent.get(tunable.name) == value
        # In force when the record shows it: from the next frame.
        words = f" → {tunable.words(value)}{' sent' if is_sent else ''}"
        line.append((words, "good" if is_sent else "warn"))
    elif tunable.name == LEARNING and tuning.settings is not None:
        line.append((" held" if tuning.settings.is_noise_held else " learns", "dim"))
    return line


def _settled(figures: TuneFigures, tuning: Tuning, words: TuneWords) -> list[Line]:
    """Return bounds and gain to which the filter settles, by the settings in force and tried."""
    if figures.settled is None and (figures.now is None or not figures.now.updates):
        return []
    rows: list[tuple[str, Callable[[Settled], str]]] = [
        ("bounds 3σ", lambda each: _pair(*each.sigma_innovation_arcsec)),
        ("predicted", lambda each: _pair(*each.sigma_predicted_arcsec)),
        ("gain RA δ", lambda each: f"{short_figure(each.gain[0])} {short_figure(each.gain[1])}"),
        ("after", lambda each: count_words(each.updates, "frame")),
    ]
    lines = [_head("settles at", "in force")]
    for label, text in rows:
        line: Line = [(f"  {label:<{LABEL_COLUMNS - 2}}", "")]
        for each, is_coming in ((figures.settled, True), (figures.settled_then, tuning.changes)):
            said = ("…" if is_coming else "-") if each is None else text(each)
            line.append((f"{said:>{VALUE_COLUMNS}}", "dim" if each is None else ""))
        lines.append(line)
    if words.learnt:
        lines.append([(f" {words.learnt}", "dim")])
    if words.aims_by_orbit:
        lines.append([(" the orbit aims, not Q: bounds alone", "dim")])
    return lines


def _head(label: str, column: str) -> Line:
    """Return the head of two columns of figures, the second of them if tried."""
    room = LABEL_COLUMNS + VALUE_COLUMNS - len(column)
    return [
        (f" {label}"[: room - 1].ljust(room) + column + f"{'if tried':>{VALUE_COLUMNS}}", "dim")
    ]


def _pair(east_arcsec: float, north_arcsec: float) -> str:
    """Return three sigma of both axes with one unit: 3.3 .60″."""
    values = [3.0 * east_arcsec, 3.0 * north_arcsec]
    size, unit = 1.0, "″"
    for larger, name in ((60.0, "′"), (3600.0, "°")):
        if max(values) >= 3.0 * larger:
            size, unit = larger, name
    return " ".join(f"{value / size:.3g}".removeprefix("0") for value in values) + unit


def _figures(figures: TuneFigures, frames: str, *, has_changes: bool) -> list[Line]:
    count = LAST_FRAMES if figures.now is None else figures.now.frames
    lines = [_head(frames.format(count=count), "as it was")]
    inks: dict[bool | None, Ink] = {True: "good", False: "warn", None: ""}
    for each in merit.TUNED:
        line: Line = [(f"  {each.label:<{LABEL_COLUMNS - 2}}", "")]
        for found, is_coming in ((figures.now, True), (figures.then, has_changes)):
            text = ("…" if is_coming else "-") if found is None else each.words(found)
            is_sound = found.is_nis_sound if found and each is merit.NIS_MEAN else None
            line.append((f"{text:>{VALUE_COLUMNS}}", "dim" if found is None else inks[is_sound]))
        lines.append(line)
    return lines


def _comparison(
    tuning: Tuning, figures: TuneFigures, of_present: int | None, width: int
) -> list[Line]:
    """Return which settings the same frames favour, by their log L; empty: not known.

    Source: two models whose log likelihoods differ by less than 2 (Burnham & Anderson 2002, 2.6).
    """
    now, then = figures.now, figures.then
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
        [(f" {line[0][0].strip()}", comparison[1])] for line in wrap_to_rows(said, width - 1, 3)
    ]


def _cautions(figures: TuneFigures, of_present: int | None, width: int) -> list[Line]:
    """Return the reasons why the figures cannot be compared; usually none."""
    now, then, said = figures.now, figures.then, []
    if now is not None and then is not None and then.updates != now.updates:
        fewer = now.updates - then.updates
        frames = f"{abs(fewer)} {'fewer' if fewer > 0 else 'more'} frames are measured if tried"
        said.append(f"{frames}: rms and NIS are of other frames, not comparable")
    if now is not None and of_present is not None and of_present < now.frames:
        said.append(
            f"as it was: {of_present} of {now.frames} by what is in force now,"
            f" {now.frames - of_present} by older settings"
        )
    for label, each in (("as it was", now), ("if tried", then)):
        if each is not None and each.is_nis_sound is False and each.nis_band:
            low, high = each.nis_band
            said.append(f"NIS mean {label}: ✓ from {low:.2f} to {high:.2f}")
            break
    return [
        [(f" {line[0][0].strip()}", "warn")]
        for words in said
        for line in wrap_to_rows(words, width - 1, 3)
    ]
