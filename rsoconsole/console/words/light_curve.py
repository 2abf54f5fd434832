"""The page of a track's brightness over the frames, bright side up."""

import math
from collections.abc import Sequence
from statistics import median, pstdev

from rsoconsole.console.drawing.light_plot import LightMark, light_plot
from rsoconsole.console.drawing.plot import VALUE_BEYOND, Line
from rsoconsole.console.words.panels import NEWEST, PlotWindow, time_axis_lines
from rsoconsole.console.words.words import Item, cut_to_width, draw_rule, items_in_rows
from rsoconsole.night import FollowedTrack, FrameRow, NightView
from rsoconsole.records import Band, StreakLight
from rsoconsole.words import BAND_WORDS, magnitude_words, short_figure

MIN_FOR_SCATTER = 3
MAX_FIGURE_ROWS = 3


def light_curve_lines(
    night: NightView,
    track: FollowedTrack | None,
    width: int,
    height: int,
    *,
    window: PlotWindow = NEWEST,
) -> list[Line]:
    """Plot a track's magnitude in each frame with its error, below its last one and its scatter.

    ``track``: a chosen one; None: the lead. Magnitudes of another band than the last one's are
    left out, and that is said.
    """
    followed = track or next((each for each in night.tracks if each.is_lead), None)
    of = "" if track is None else f"track {track.number_text}: "
    lights = _lights(followed, night.rows)
    visible = window.visible_rows(night.rows, width)
    known = [light for row in visible if (light := lights.get(row.frame_id)) is not None]
    if not known:
        said = " no magnitude is on record of these frames" if visible else " no frame yet"
        title = draw_rule(f"{of}brightness: not measured", "", width)
        return [title, cut_to_width([(said, "dim")], width)][: max(height, 1)]
    band = known[-1].band
    own = [light.mag for light in known if light.band == band and light.mag is not None]
    title = draw_rule(
        f"{of}brightness {magnitude_words(known[-1])}", f"{min(own):.2f} to {max(own):.2f}", width
    )
    figures = items_in_rows(_figures(known, band), width, MAX_FIGURE_ROWS, " · ")
    shown = window.rows(night.rows, width)
    marks = [_mark(lights.get(row.frame_id), band) for row in shown]
    room = height - 2 - len(figures)
    if room < 2:
        figures, room = [], height - 2
    plot = light_plot(marks, width, room) if room > 0 else []
    axis = time_axis_lines(shown, width, 1, window.words(night.rows))
    return [title, *figures, *plot, *axis][: max(height, 1)]


def _lights(track: FollowedTrack | None, rows: Sequence[FrameRow]) -> dict[int, StreakLight]:
    """Return the magnitudes by frame number; of the leads of each frame without a track.

    A track's own rows are its last ones: before them, it is the lead's that it is taken for.
    """
    found = {row.frame_id: row.light for row in rows}
    if track is not None:
        first = track.rows[0].frame_id if track.rows else math.inf
        before = range(track.began_frame_id, int(first)) if track.is_lead and track.rows else ()
        found = {n: found.get(n) for n in before}
        found |= {row.frame_id: row.light for row in track.rows}
    return {n: light for n, light in found.items() if light is not None and light.mag is not None}


def _mark(light: StreakLight | None, band: Band) -> LightMark | None:
    if light is None or light.mag is None or light.band != band:
        return None
    return LightMark(mag=light.mag, sigma=light.mag_sigma, is_saturated=light.is_saturated)


def _figures(known: Sequence[StreakLight], band: Band) -> list[Item]:
    """Return what the magnitudes come to: median, scatter and error, and what was left out."""
    own = [each for each in known if each.band == band]
    sure = [each for each in own if not each.is_saturated]
    items: list[Item] = []
    if len(sure) >= MIN_FOR_SCATTER:
        mags = [each.mag for each in sure if each.mag is not None]
        errors = [each.mag_sigma for each in sure if each.mag_sigma is not None]
        items.append((f"median {median(mags):.2f} of {len(mags)}", ""))
        items.append((f"scatter ±{short_figure(pstdev(mags))}", ""))
        if errors:
            items.append((f"errors ±{short_figure(_rms(errors))}", ""))
    if band == "instrumental":
        items.append((f"{BAND_WORDS[band]}: no zero point, 0 is 1 ADU/s", "dim"))
    if len(sure) < len(own):
        items.append((f"{VALUE_BEYOND[1]} saturated, brighter", "dim"))
    if len(own) < len(known):
        items.append((f"{len(known) - len(own)} of another band left out", "dim"))
    return items


def _rms(values: Sequence[float]) -> float:
    return math.sqrt(sum(value**2 for value in values) / len(values))
