"""Figure of a light curve: magnitude against time, and by the phase of its period."""

from typing import Any

import numpy as np

from rsoconsole.library.notebook.figures.draw_sky import (
    MEASURED,
    finish_figure,
    write_corner_note,
)
from rsoconsole.library.notebook.night.night import DrawnNight
from rsoconsole.night import LightPeriod, TrackLight, light_of_track, tracks_with_light
from rsoconsole.words import no_period_words, period_words

_STEPS: dict[str, Any] = {
    "marker": ".",
    "markersize": 2.2,
    "color": "#5b7fb5",
    "linestyle": "none",
    "alpha": 0.6,
    "zorder": 3,
}
_GLINT: dict[str, Any] = {
    "marker": "*",
    "markersize": 9.0,
    "color": "#b26a00",
    "linestyle": "none",
    "zorder": 7,
}


def has_light(night: DrawnNight, track: int | None = None) -> bool:
    """True where brightness of the track, or with None of any track, is on record."""
    known = tracks_with_light(night.frames)
    return bool(known) if track is None else track in known


def draw_light(figure: Any, night: DrawnNight, track: int | None = None) -> None:
    """Draw the magnitudes of a track, the bright side up, and its light by phase.

    ``track``: its number; None: the track of the most streaks with a brightness. Without any the
    panel stays empty.
    """
    chosen = next(iter(tracks_with_light(night.frames)), None) if track is None else track
    found = None if chosen is None else light_of_track(night.frames, chosen)
    period = None if found is None else found.search.period
    panels = figure.subplots(1 if period is None else 2, 1, squeeze=False)[:, 0]
    upper = panels[-1]
    if found is None:
        write_corner_note(upper, "no brightness on record")
        finish_figure(figure, night, "Light curve")
        return
    keys = _draw_course(upper, night, found)
    if period is None:
        search = found.search
        write_corner_note(
            upper,
            no_period_words(
                search.points,
                search.false_alarm_probability,
                search.min_period_s,
                search.max_period_s,
            ),
        )
    else:
        _draw_phases(panels[0], found, period)
    finish_figure(figure, night, f"Light curve of track {found.track.number}", keys)


def _draw_course(axis: Any, night: DrawnNight, found: TrackLight) -> list[tuple[Any, str]]:
    keys: list[tuple[Any, str]] = []
    points, steps = found.curve.points, found.curve.steps
    if len(steps):
        is_shown = np.isfinite(steps.mag) & (steps.mag_sigma < 0.5)
        at_s = _seconds(night, steps.t_utc_ns)[is_shown]
        (line,) = axis.plot(at_s, steps.mag[is_shown], **_STEPS)
        keys.append((line, "steps along streaks"))
    at_s = _seconds(night, points.t_utc_ns)
    colour = MEASURED["markeredgecolor"]
    axis.errorbar(
        at_s, points.mag, yerr=points.mag_sigma, fmt="none", ecolor=colour, elinewidth=0.8
    )
    (line,) = axis.plot(at_s, points.mag, **{**MEASURED, "markersize": 4.2})
    keys.append((line, "streaks, ± 1 σ"))
    if found.glints:
        at_s = _seconds(night, np.array([each.t_utc_ns for each in found.glints]))
        top = np.full(at_s.size, 0.96)
        (line,) = axis.plot(at_s, top, transform=axis.get_xaxis_transform(), **_GLINT)
        keys.append((line, "glints"))
    axis.set_ylabel(_band_words(found))
    axis.invert_yaxis()
    return keys


def _draw_phases(axis: Any, found: TrackLight, period: LightPeriod) -> None:
    """Light by phase over two periods; steps where a period is short against an exposure."""
    points, steps = found.curve.points, found.curve.steps
    exposure_s = float(np.nanmedian(np.append(points.exposure_s, 0.0)))
    is_fast = bool(len(steps)) and period.period_s < 3.0 * exposure_s
    shown = steps if is_fast else points
    phase = (shown.t_utc_ns - points.t_utc_ns[0]) / 1e9 / period.period_s % 1.0
    marks = _STEPS if is_fast else {**MEASURED, "markersize": 4.2}
    axis.plot(np.concatenate([phase, phase + 1.0]), np.tile(shown.mag, 2), **marks)
    axis.set_xlim(0.0, 2.0)
    axis.set_xlabel(f"Phase of {period_words(period.period_s, period.sigma_s)}")
    axis.set_ylabel(_band_words(found))
    axis.invert_yaxis()


def _band_words(found: TrackLight) -> str:
    return f"{'V' if found.curve.band == 'V' else 'Instrumental'} (mag)"


def _seconds(night: DrawnNight, t_utc_ns: Any) -> Any:
    return (t_utc_ns - night.frames[0].t_mid_utc_ns) / 1e9
