"""A light curve in words for people: head, plot, period and glints."""

import csv
import io
from collections.abc import Iterator
from typing import Any

import numpy as np

from rsoconsole.night import LightPoints, PeriodSearch, TrackLight
from rsoconsole.words import (
    count_words,
    false_alarm_words,
    glint_words,
    no_period_words,
    period_words,
    utc_ns_to_iso,
    utc_text,
)

PLOT_COLUMNS, PLOT_ROWS = 76, 16
MAX_GLINTS = 20
"""Largest number of glints in words; the JSON has all."""


def light_lines(session: str, found: TrackLight) -> Iterator[str]:
    """Yield the answer of ``lightcurve``; ``session``: its name."""
    curve = found.curve
    name = f" ({found.track.name})" if found.track.name else ""
    band = "V" if curve.band == "V" else "instrumental"
    course = (
        "no magnitude above noise"
        if found.mag is None
        else f"{band} {found.mag:.2f} ({found.brightest_mag:.2f} to {found.faintest_mag:.2f})"
    )
    yield (
        f"{session}: track {curve.track_id}{name}: {course},"
        f" {count_words(len(curve.points), 'streak')}, {count_words(len(curve.steps), 'step')}"
    )
    yield from plot_lines(curve.points, found.curve.band)
    yield from _period_lines(found.search)
    if not found.glints:
        yield "no glint"
    for glint in found.glints[:MAX_GLINTS]:
        words = glint_words(
            glint.height_mag, glint.duration_s, is_within_frame=glint.is_within_frame
        )
        yield f"glint at {utc_text(glint.t_utc_ns)}, frame {glint.frame_id}: {words}"
    if len(found.glints) > MAX_GLINTS:
        yield f"and {len(found.glints) - MAX_GLINTS} more glints"
    left_out = [
        (curve.other_band, "in another band"),
        (curve.shared, "shared with another track"),
        (curve.undirected, "without steps, as the direction of motion is not known"),
    ]
    if any(number for number, _ in left_out):
        yield "streaks: " + ", ".join(f"{number} {why}" for number, why in left_out if number)


def _period_lines(search: PeriodSearch) -> Iterator[str]:
    period = search.period
    if period is None:
        yield no_period_words(
            search.points, search.false_alarm_probability, search.min_period_s, search.max_period_s
        )
        return
    yield (
        f"period {period_words(period.period_s, period.sigma_s)}, {period.amplitude_mag:.2f} mag"
        f" from peak to peak, {period.cycles:.1f} periods; false-alarm probability"
        f" {false_alarm_words(search.false_alarm_probability)}"
    )
    yield f"half {period.half_s:.6g} s, double {period.double_s:.6g} s: the turn may be either"
    if period.aliases_s:
        others = ", ".join(f"{each:.6g}" for each in period.aliases_s)
        yield f"by the cadence as likely: {others} s"


def plot_lines(points: LightPoints, band: str) -> list[str]:
    """Draw magnitudes against minutes since the first streak, the bright side up."""
    import plotext

    is_known = np.isfinite(points.mag)
    if is_known.sum() < 2:
        return []
    minutes = (points.t_utc_ns - points.t_utc_ns[0])[is_known] / 6e10
    mag = points.mag[is_known]
    plotext.clear_figure()
    plotext.theme("clear")
    plotext.limit_size(False, False)
    plotext.plot_size(PLOT_COLUMNS, PLOT_ROWS)
    plotext.scatter(minutes.tolist(), (-mag).tolist(), marker="●")
    ticks = np.linspace(float(mag.min()), float(mag.max()), 4)
    plotext.yticks([-float(each) for each in ticks], [f"{each:.2f}" for each in ticks])
    plotext.xlabel("min")
    plotext.ylabel(f"{band} (mag)" if band == "V" else "mag")
    drawn = str(plotext.uncolorize(plotext.build()))
    plotext.clear_figure()
    return [line.rstrip() for line in drawn.splitlines()]


def light_json(session: str, found: TrackLight) -> dict[str, Any]:
    """Return the object of ``lightcurve --json``."""
    curve, search = found.curve, found.search
    return {
        "session": session,
        "track": curve.track_id,
        "name": found.track.name,
        "band": curve.band,
        "streaks": len(curve.points),
        "steps": len(curve.steps),
        "mag": found.mag,
        "brightest_mag": found.brightest_mag,
        "faintest_mag": found.faintest_mag,
        "period": search.period,
        "false_alarm_probability": search.false_alarm_probability,
        "min_period_s": search.min_period_s,
        "max_period_s": search.max_period_s,
        "points_searched": search.points,
        "glints": found.glints,
        "other_band": curve.other_band,
        "shared": curve.shared,
        "undirected": curve.undirected,
        "light": [
            {"frame_id": row[1], "t_utc": row[2], "mag": row[3], "mag_sigma": row[4]}
            for row in _rows("streak", curve.points)
        ],
    }


COLUMNS = (
    "kind",
    "frame_id",
    "t_utc",
    "mag",
    "mag_sigma",
    "light",
    "light_sigma",
    "is_saturated",
    "is_blended",
)


def light_csv(found: TrackLight) -> str:
    """Return streaks and steps as CSV, one a row, in order of time within each kind."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for kind, points in (("streak", found.curve.points), ("step", found.curve.steps)):
        writer.writerows(_without_nan(row) for row in _rows(kind, points))
    return text.getvalue()


def _rows(kind: str, points: LightPoints) -> Iterator[tuple[Any, ...]]:
    for at in range(len(points)):
        yield (
            kind,
            int(points.frame_ids[at]),
            utc_ns_to_iso(int(points.t_utc_ns[at])),
            float(points.mag[at]),
            float(points.mag_sigma[at]),
            float(points.light[at]),
            float(points.light_sigma[at]),
            bool(points.is_saturated[at]),
            bool(points.is_blended[at]),
        )


def _without_nan(row: tuple[Any, ...]) -> list[Any]:
    return ["" if isinstance(each, float) and not np.isfinite(each) else each for each in row]
