"""The panel beside a frame that is processed again: settings, candidates as recorded and now."""

import math
import textwrap
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from rsoconsole.console.dialogs.candidates import detection_outcome
from rsoconsole.console.drawing.plot import Ink, Line
from rsoconsole.console.frame._sheet import FrameScreenState
from rsoconsole.console.words.words import Item, cut_to_width, draw_rule
from rsoconsole.night import light_of_streak
from rsoconsole.records import Detection, Measurement, Solution, StreakLight
from rsoconsole.sky import wrap_180
from rsoconsole.words import short_figure, streak_detail_words

if TYPE_CHECKING:
    from rsoconsole.pipeline import ComparedCandidate

LABEL_COLUMNS = 9
MAX_WARNING_ROWS = 3
STAGES = {
    "pattern": "pattern",
    "background": "sky",
    "map": "map",
    "network": "network",
    "stars": "stars",
    "fit": "fit",
    "faint": "faint",
    "class": "class",
    "solve": "plate",
}


def panel_lines(sheet: FrameScreenState) -> Callable[[int, int], list[Line]]:
    """Return the function that builds the panel's lines: in full, or in three rows a summary."""

    def build(width: int, height: int) -> list[Line]:
        if height <= 3:
            return [cut_to_width(line, width) for line in _summary(sheet)][:height]
        head = [draw_rule("processed once more", "", width), *_settings(sheet, width)]
        lines = _candidates(sheet, width, height - len(head))
        return [cut_to_width(line, width) for line in (*head, *lines)][:height]

    return build


def _settings(sheet: FrameScreenState, width: int) -> list[Line]:
    if sheet.opened is None:
        return [[(" reading the session …", "dim")]]
    before, tau = sheet.recorded_tau, sheet.tau
    mode = sheet.map_mode or sheet.recorded_mode
    recorded = sheet.opened.recorded.seen.solution
    plate = "as recorded" if isinstance(recorded, Solution) else "none on record"
    plate = "found again" if sheet.solves_again else plate
    lines: list[Line] = [
        _setting("τ", f"{before:.3g}", None if tau == before else f"{tau:.3g}", ", .", width),
        _setting(
            "map",
            str(sheet.recorded_mode),
            None if mode == sheet.recorded_mode else str(mode),
            "M",
            width,
        ),
        _setting("plate", plate, None, "P", width),
    ]
    for text, ink in _course(sheet):
        most = MAX_WARNING_ROWS if ink == "warn" and not sheet.failure else None
        lines += [[(f" {t}", ink)] for t in textwrap.wrap(text, max(width - 1, 1))[:most]]
    return lines


def _setting(label: str, before: str, now: str | None, key: str, width: int) -> Line:
    line: Line = [(f" {label:<{LABEL_COLUMNS - 1}}", ""), (before, "dim" if now else "")]
    if now is not None:
        line.append((f" → {now}", "warn"))
    columns = sum(len(text) for text, _ in line)
    return [*line, (key.rjust(max(width - columns - 1, 0)), "dim")]


def _course(sheet: FrameScreenState) -> list[Item]:
    """Return the state of the processing: under way, done with its duration, or the fault."""
    if sheet.fault:
        return [("no pixels, nothing to process", "warn")]
    if sheet.wanted is not None or sheet.pixels is None:
        what = "reading" if sheet.pixels is None else "processing"
        return [(f"{what} … {time.monotonic() - sheet.began_s:.1f} s", "dim")]
    if sheet.failure:
        return [(sheet.failure, "warn")]
    if sheet.done is None:
        return []
    result = sheet.done.result
    ms = result.stage_ms
    words = ", ".join(f"{name} {ms[stage]:.0f}" for stage, name in STAGES.items() if stage in ms)
    said: list[Item] = [(f"{ms['total']:.0f} ms: {words}", "dim")]
    if result.is_same_network is False:
        said.append(("another network than on record", "warn"))
    if result.is_solved_again and not isinstance(result.now.solution, Solution):
        reason = result.now.solution.reason if result.now.solution is not None else "not asked for"
        said.append((f"not solved: {reason}", "warn"))
    return said


def _candidates(sheet: FrameScreenState, width: int, room: int) -> list[Line]:
    """Return the candidates, a few lines each; in little room those about the chosen one."""
    pairs = sheet.candidates
    if sheet.opened is None:
        return []
    if sheet.opened.recorded.seen.detections is None and sheet.done is None:
        return [draw_rule("no candidates", "", width), [(" the frame was never reduced", "dim")]]
    count = f"{len(pairs)} candidate{'' if len(pairs) == 1 else 's'}"
    head = draw_rule(f"{count}, then{'' if sheet.done is None else ' → now'}", "", width)
    if not pairs:
        return [head, [(" nothing was held possible", "dim")]]
    blocks = [_block(sheet, number, pair, width) for number, pair in enumerate(pairs)]
    first = 0
    chosen = sheet.chosen or 0
    while first < chosen and sum(map(len, blocks[first : chosen + 1])) > room - 2:
        first += 1
    lines: list[Line] = [line for block in blocks[first:] for line in block]
    if len(lines) > room - 1:
        more: Line = [(" … d goes on to the others", "dim")]
        lines = [*lines[: max(room - 2, 0)], more]
    return [head, *lines]


def _block(
    sheet: FrameScreenState, number: int, pair: "ComparedCandidate", width: int
) -> list[Line]:
    is_chosen = number == sheet.chosen
    place = pair.latest_detection
    details = streak_detail_words(place, _recorded_light(sheet, pair))
    first = f"{_confidence(pair, 'was')} → {_confidence(pair, 'now')}"
    if sheet.done is None:
        first = _confidence(pair, "was")
    line: Line = [
        ("▸" if is_chosen else " ", "title"),
        (f"{first}  at {place.x_px:.0f},{place.y_px:.0f}", "title"),
    ]
    lines: list[Line] = [line]
    lines += [[(f"   {part}", "")] for part in textwrap.wrap(", ".join(details), max(width - 4, 1))]
    for text, ink in _outcomes(sheet, pair):
        lines += [[(f"   {part}", ink)] for part in textwrap.wrap(text, max(width - 4, 1))]
    return lines


def _recorded_light(sheet: FrameScreenState, pair: "ComparedCandidate") -> StreakLight | None:
    """Return the brightness of a candidate as recorded; None where it is not on record."""
    if sheet.opened is None or pair.was is None:
        return None
    return light_of_streak(sheet.opened.detail, pair.was.detection)


def _confidence(pair: "ComparedCandidate", when: str) -> str:
    judged = pair.was if when == "was" else pair.now
    return "-" if judged is None else short_figure(judged.detection.confidence)


def _outcomes(sheet: FrameScreenState, pair: "ComparedCandidate") -> list[Item]:
    """Return a candidate's outcome as recorded and now; once where both are the same."""
    was = "not a candidate"
    if pair.was is not None:
        was = pair.was.reason or _fate(sheet, pair.was.detection)
    if sheet.done is None:
        return [(was, "")]
    moved = _moved(sheet, pair)
    said: list[Item] = [(moved, "")] if moved else []
    if pair.is_as_recorded:
        return [(f"{was}; now the same", ""), *said]
    if pair.now is None:
        return [(f"then {was}", "dim"), ("now not a candidate", "warn"), *said]
    now = pair.now.reason or "detected"
    ink: Ink = "good" if pair.now.is_taken else "warn"
    return [(f"then {was}", "dim"), (f"now {now}", ink), *said]


def _fate(sheet: FrameScreenState, streak: Detection) -> str:
    assert sheet.opened is not None
    return ", ".join(word for word in detection_outcome(streak, sheet.opened.detail) if word)


def _moved(sheet: FrameScreenState, pair: "ComparedCandidate") -> str:
    """Return how far the new measurement is from the recorded one, in words; empty: unknown."""
    if sheet.done is None or pair.was is None or pair.now is None:
        return ""
    result = sheet.done.result
    was = _measurement_of(pair.was.detection, result.was.measurements)
    now = _measurement_of(pair.now.detection, result.now.measurements)
    if was is None or now is None:
        return ""
    cos_dec = math.cos(math.radians(was.dec_icrs_deg))
    east = float(wrap_180(now.ra_icrs_deg - was.ra_icrs_deg)) * cos_dec * 3600.0
    north = (now.dec_icrs_deg - was.dec_icrs_deg) * 3600.0
    sigma = math.sqrt(max(was.cov_sky_arcsec2[0], was.cov_sky_arcsec2[2]))
    return f"on the sky {east:+.2f}″ E {north:+.2f}″ N of then, ±{sigma:.2f}″"


def _measurement_of(streak: Detection, measurements: tuple[Measurement, ...]) -> Measurement | None:
    return next((m for m in measurements if (m.x_px, m.y_px) == (streak.x_px, streak.y_px)), None)


def _summary(sheet: FrameScreenState) -> list[Line]:
    """Return the panel as a summary of two lines."""
    if sheet.opened is None:
        return [[(" reading the session …", "dim")]]
    tau, mode = sheet.tau, sheet.map_mode or sheet.recorded_mode
    has_changes = tau != sheet.recorded_tau or mode != sheet.recorded_mode or sheet.solves_again
    head: Line = [(f" τ {tau:.3g} {mode}  ", "warn" if has_changes else "")]
    if sheet.done is not None and sheet.wanted is None and not sheet.failure:
        head.append((f"{sheet.done.result.stage_ms['total']:.0f} ms", "dim"))
    else:
        head += _course(sheet)[:1]
    pairs = sheet.candidates
    then = sum(pair.was is not None and pair.was.is_taken for pair in pairs)
    now = sum(pair.now is not None and pair.now.is_taken for pair in pairs)
    if sheet.done is None:
        return [head, [(f" {then} detected then · L lists", "")]]
    is_same = all(pair.is_as_recorded for pair in pairs)
    ink: Ink = "" if is_same else "warn"
    words = "as recorded" if is_same else "not as recorded"
    return [head, [(f" then {then}, now {now}: {words} · L lists", ink)]]
