"""The pages over the plots: image quality, focus, and drift with polar alignment."""

from collections.abc import Sequence
from statistics import median_high
from typing import Literal

from rsoconsole.console.drawing.plot import Ink, Line, value_plot
from rsoconsole.console.words.panels import NEWEST, PlotWindow, time_axis_lines
from rsoconsole.console.words.words import cut_to_width, draw_rule
from rsoconsole.night import FRAME_FACTS, FrameQuantity, FrameRow, NightView
from rsoconsole.tracking import (
    Drift,
    HourlyRate,
    PolarHint,
    SolvedPointing,
    fit_drift,
    offsets_arcsec,
)
from rsoconsole.tracking import polar_hint as hint_of
from rsoconsole.words import duration_words

Page = Literal["quality", "focus", "alignment", "tracks", "light"]
LOOKS = 600
"""Number of last frames to which the drift is fitted."""
TREND_FRAMES = 10
WORSE_MAG = 0.3
"""Magnitudes below the night's best transparency from which on it is shown as a warning."""
DIGITS = {
    "0": "█▀█|█ █|▀▀▀",
    "1": " ▄█|  █|  ▀",
    "2": "▀▀█|█▀▀|▀▀▀",
    "3": "▀▀█| ▀█|▀▀▀",
    "4": "█ █|▀▀█|  ▀",
    "5": "█▀▀|▀▀█|▀▀▀",
    "6": "█▀▀|█▀█|▀▀▀",
    "7": "▀▀█|  █|  ▀",
    "8": "█▀█|█▀█|▀▀▀",
    "9": "█▀█|▀▀█|▀▀▀",
    ".": " | |▄",
}


def image_quality_lines(
    rows: Sequence[FrameRow], width: int, height: int, *, window: PlotWindow = NEWEST
) -> list[Line]:
    """Plot FWHM, background, transparency and number of stars, one below the other.

    Each title has the newest frame's value and the range of all frames shown.
    """
    marks, visible = window.rows(rows, width), window.visible_rows(rows, width)
    best = max((row.zero_point_mag for row in window.seen(rows) if row.zero_point_mag), default=0.0)
    each = max((height - 1) // len(FRAME_FACTS), 2)
    lines: list[Line] = []
    for fact in FRAME_FACTS:
        lines.append(
            _title(fact, [row.facts.get(fact.name) for row in visible], width, best_mag=best)
        )
        lines += value_plot([row.facts.get(fact.name) for row in marks], width, each - 1)
    return [*lines[: height - 1], *time_axis_lines(marks, width, 1, window.words(rows))][:height]


def focus_lines(night: NightView, width: int, height: int) -> list[Line]:
    """Build the focus page: the stars' FWHM in large digits, its trend and its curve."""
    rows = [row for row in night.rows if row.fwhm_px is not None]
    if not rows:
        return [
            draw_rule("focus", "", width),
            [(" no frame has shown stars whose width it tells", "dim")],
        ]
    widths = [row.fwhm_px for row in rows if row.fwhm_px is not None]
    config = night.config
    now, best = widths[-1], min(widths)
    lines = [draw_rule("focus: FWHM of the stars", f"frame {rows[-1].frame_id:04d}", width)]
    lines += [[(f"  {line}", "title")] for line in large_digits(f"{now:.2f}")]
    arcsec = "" if config is None else f" = {now * config.optics.scale_arcsec_px:.1f}″"
    best_row = next(row for row in rows if row.fwhm_px == best)
    figures = f"  FWHM {now:.2f} px{arcsec}   best {best:.2f} in frame {best_row.frame_id:04d}"
    lines.append([(figures, "")])
    words, ink = fwhm_trend_words(widths)
    lines.append([(f"  {words}", ink)])
    lines.append(
        cut_to_width(
            [("  seeing widens it too: turn the focus, then wait for some frames", "dim")], width
        )
    )
    left = height - len(lines) - 1
    last = rows[-max((width - 6) // 2, 1) :]
    if left >= 2:
        lines += value_plot([row.fwhm_px for row in last], width, left)
        lines += time_axis_lines(last, width, 1)
    return [cut_to_width(line, width) for line in lines][:height]


def fwhm_trend_words(widths: Sequence[float]) -> tuple[str, Ink]:
    """Return whether the FWHM has changed by more than its scatter, as (text, ink).

    ``widths``: FWHM of the frames, pixels, oldest first.
    """
    last = list(widths)[-TREND_FRAMES:]
    if len(last) < 4:
        return f"{len(last)} of the 4 frames that a trend takes", "dim"
    half = len(last) // 2
    before, after = last[:half], last[-half:]
    change = median_high(after) - median_high(before)
    scatter = max(max(before) - min(before), max(after) - min(after), 0.02)
    said = f"over the last {len(last)} frames"
    if abs(change) <= scatter:
        return f"steady {said} (within {scatter:.2f} px)", ""
    if change > 0.0:
        return f"↑ wider by {change:.2f} px {said}", "warn"
    return f"↓ sharper by {-change:.2f} px {said}", "good"


def alignment_lines(night: NightView, width: int, height: int) -> list[Line]:
    """Build the page of the drift between mount and stars, field rotation and polar error."""
    looks = solved_pointings(night.rows)
    title = draw_rule("pointing drift and polar alignment", f"{len(looks)} solved frames", width)
    drift = fit_drift(looks)
    if drift is None:
        words = " five solved frames over three minutes on one side of the pier, at least"
        return [title, cut_to_width([(words, "dim")], width)][:height]
    lines = [title, *_drift_words(drift)]
    lines += _hint(night, looks, drift)
    left = (height - len(lines) - 1) // 2
    if left >= 3:
        offsets = offsets_arcsec(looks)
        rows = [row for row in night.rows if _look(row) is not None][-len(looks) :]
        for axis, name in enumerate(("offset east", "offset north")):
            values = [float(value) for value in offsets[:, axis]]
            lines.append(_title(FrameQuantity(name, name, "″", "+.0f"), values, width))
            lines += value_plot(values, width, left - 1)
        lines += time_axis_lines(rows, width, 1)
    return [cut_to_width(line, width) for line in lines][:height]


def solved_pointings(rows: Sequence[FrameRow]) -> list[SolvedPointing]:
    """Return the last solved frames' directions, both by the mount and by the plate."""
    return [look for row in rows[-LOOKS:] if (look := _look(row)) is not None]


def large_digits(text: str) -> list[str]:
    """Return a number in large digits, as three lines of text."""
    rows = ["", "", ""]
    for character in text:
        for number, part in enumerate(DIGITS[character].split("|")):
            rows[number] += f"{part} "
    return rows


def _title(
    fact: FrameQuantity, values: Sequence[float | None], width: int, *, best_mag: float = 0.0
) -> Line:
    """Return name, last value and range; ``best_mag``: the night's best zero point."""
    _, name, unit, form = fact
    known = [value for value in values if value is not None]
    now = next((value for value in reversed(values) if value is not None), None)
    if now is None:
        return draw_rule(f"{name}: not measured", "", width)
    shown = f"{now:{form}} {unit}".strip()
    line = draw_rule(f"{name} {shown}", f"{min(known):{form}} to {max(known):{form}}", width)
    is_hazy = unit == "mag" and best_mag - now > WORSE_MAG
    return [(text, "warn" if is_hazy and ink == "title" else ink) for text, ink in line]


def _drift_words(drift: Drift) -> list[Line]:
    def rate(value: HourlyRate, form: str) -> str:
        return f"{value.value:{form}} ±{value.sigma:{form.lstrip('+')}}"

    over = f"{drift.frames} frames, {duration_words(drift.hours * 3600.0)}"
    return [
        [(f" RA  {rate(drift.east_arcsec_h, '+.1f')} ″/h on the sky", "")],
        [(f" Dec {rate(drift.north_arcsec_h, '+.1f')} ″/h   over {over}", "")],
        [(f" field turns {rate(drift.rotation_deg_h, '+.3f')} °/h", "")],
    ]


def _hint(night: NightView, looks: Sequence[SolvedPointing], drift: Drift) -> list[Line]:
    """Return the polar axis's error by the drift, in lines; empty where the site is not known."""
    if night.config is None:
        return []
    from rsoconsole.sky import hour_angle_icrs_deg

    site = night.config.site.to_site()
    middle = looks[-max(drift.frames // 2, 1)]
    hour_angle_deg = float(hour_angle_icrs_deg(site, *middle.plate_icrs_deg, middle.t_utc_ns))
    hint = hint_of(drift, hour_angle_deg, site.latitude_deg)
    return [[(f" {line}", "title" if hint.words else "dim")] for line in polar_error_words(hint)]


def polar_error_words(hint: PolarHint) -> list[str]:
    """Return the error of the polar axis in words, in short lines."""
    if hint.axis == "both":
        return [
            "polar axis: here both its errors mix;",
            "near the meridian the azimuth's shows,",
            "low in the east or west the altitude's",
        ]
    if not hint.words:
        return [f"polar axis: no error in {hint.axis} that shows here"]
    return [
        f"polar axis about {hint.error_arcmin:.1f}′ {hint.words} ({hint.axis})",
        "flexure and refraction have their part in it",
    ]


def _look(row: FrameRow) -> SolvedPointing | None:
    if None in (row.t_utc_ns, row.mount_icrs_deg, row.plate_icrs_deg, row.rotation_deg):
        return None
    return SolvedPointing(
        t_utc_ns=row.t_utc_ns or 0,
        mount_icrs_deg=row.mount_icrs_deg or (0.0, 0.0),
        plate_icrs_deg=row.plate_icrs_deg or (0.0, 0.0),
        rotation_deg=row.rotation_deg or 0.0,
    )
