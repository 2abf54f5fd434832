"""Figures of right ascension and declination against time: as in the paper, and magnified."""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from rsoconsole.library.notebook.night.night import DrawnNight, TruePlace, offset_arcsec
from rsoconsole.night import NightFrame
from rsoconsole.records import TrackState
from rsoconsole.sky import wrap_180, wrap_360
from rsoconsole.words import utc_ns_to_iso

STYLE: dict[str, Any] = {
    "figure.dpi": 100,
    "savefig.dpi": 200,
    "figure.constrained_layout.use": True,
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    # What a session calls itself is no formula.
    "text.parse_math": False,
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "xtick.direction": "out",
    "ytick.direction": "out",
    "svg.fonttype": "none",
}
MEASURED: dict[str, Any] = {
    "marker": "s",
    "markersize": 5.2,
    "markerfacecolor": "none",
    "markeredgecolor": "#c62828",
    "markeredgewidth": 1.1,
    "linestyle": "none",
    "zorder": 5,
}
UPDATED: dict[str, Any] = {
    "marker": "^",
    "markersize": 3.6,
    "markerfacecolor": "#1e55c8",
    "markeredgecolor": "none",
    "linestyle": "none",
    "zorder": 6,
}
PREDICTED: dict[str, Any] = {
    "marker": "o",
    "markersize": 6.4,
    "markerfacecolor": "none",
    "markeredgecolor": "#2e7d32",
    "markeredgewidth": 1.0,
    "linestyle": "none",
    "zorder": 4,
}
BOUND: dict[str, Any] = {"color": "#333333", "linestyle": (0, (4, 2.5)), "linewidth": 0.9}
BAND = {"color": "#5b7fb5", "alpha": 0.10, "linewidth": 0}
MISS_COLOUR = "#f3d9b8"


def label_time_axis(axis: Any, night: DrawnNight) -> None:
    """Scale the time axis (seconds since the middle of the first exposure) and label it."""
    first = utc_ns_to_iso(night.frames[0].t_mid_utc_ns, decimals=0).removesuffix("Z")
    at = first.replace("T", " ")
    axis.set_xlabel(f"Time since the middle of the first exposure, {at} UTC (s)")
    last_s = night.seconds_since_start(night.frames[-1])
    margin_s = max(0.02 * last_s, 1.0)
    axis.set_xlim(-margin_s, last_s + margin_s)


def write_title(axis: Any, night: DrawnNight, what: str) -> None:
    """Write a figure's title: what is drawn, the session's title, the filter's preset."""
    axis.set_title(f"{what}. {night.title}, preset {night.config.filter.preset}", loc="left")


def write_corner_note(axis: Any, words: str) -> None:
    """Write a note into the panel's lower right corner, on a background that keeps it legible."""
    paper = {"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.5}
    axis.text(
        *(0.992, 0.03, words),
        transform=axis.transAxes,
        ha="right",
        fontsize=8.0,
        zorder=7,
        bbox=paper,
    )


def shade_misses(axis: Any, night: DrawnNight) -> Any:
    """Shade the time of every frame in which the lead track was missed.

    Returns one of the shaded columns, for the legend; None where there is none.
    """
    column = None
    half_s = 0.5 * median_frame_interval_s(night)
    for frame in night.frames:
        if frame.lead_miss_reason is not None:
            t_s = night.seconds_since_start(frame)
            column = axis.axvspan(
                t_s - half_s, t_s + half_s, color=MISS_COLOUR, alpha=0.7, linewidth=0, zorder=0
            )
    return column


def median_frame_interval_s(night: DrawnNight) -> float:
    """Return the median time from one frame to the next, s; 30 where there are fewer than two."""
    times = [night.seconds_since_start(frame) for frame in night.frames]
    steps = sorted(b - a for a, b in itertools.pairwise(times))
    return steps[len(steps) // 2] if steps else 30.0


def legend_above(figure: Any, handles: Sequence[tuple[Any, str]]) -> None:
    """Draw a legend in one line above the panels; entries whose handle is None are left out."""
    drawn = [(handle, label) for handle, label in handles if handle is not None]
    figure.legend(
        [handle for handle, _ in drawn],
        [label for _, label in drawn],
        loc="outside upper center",
        ncols=len(drawn),
        columnspacing=1.4,
        handletextpad=0.5,
    )


def finish_figure(
    figure: Any, night: DrawnNight, what: str, keys: Sequence[tuple[Any, str]] = ()
) -> None:
    """Finish a figure: title, axis of time, legend.

    ``what``: what is drawn, for the title; ``keys``: entries (handle, label) of the legend.
    """
    panels = figure.axes
    figure.align_ylabels(panels)
    label_time_axis(panels[-1], night)
    write_title(panels[0], night, what)
    if keys:
        legend_above(figure, keys)


def tracked_frames(night: DrawnNight) -> list[NightFrame]:
    """Return the frames in which there was a lead track."""
    return [frame for frame in night.frames if frame.lead_state is not None]


_FAR_WIDER = 5.0
Where = Callable[[NightFrame, float, float], float | None]
"""Function of a frame, RA and Dec (degrees) that gives the value to plot; None: no mark."""


def draw_track(figure: Any, night: DrawnNight) -> None:
    """Draw right ascension and declination in degrees against time, as in the paper."""
    frames = tracked_frames(night)
    ra_0_deg = _first(frames).x[0]

    def ra_deg(_frame: NightFrame, ra: float, _dec: float) -> float:
        return ra_0_deg + float(wrap_180(ra - ra_0_deg))

    def dec_deg(_frame: NightFrame, _ra: float, dec: float) -> float:
        return dec

    upper, lower = figure.subplots(2, 1, sharex=True)
    keys = _panel(upper, night, ra_deg, lambda state: math.sqrt(state.P[0][0]))
    _panel(lower, night, dec_deg, lambda state: math.sqrt(state.P[2][2]))
    upper.yaxis.set_major_formatter(lambda value, _: f"{wrap_360(value):.4g}")
    lower.ticklabel_format(axis="y", useOffset=False)
    upper.set_ylabel("Right ascension, ICRS (deg)")
    lower.set_ylabel("Declination, ICRS (deg)")
    finish_figure(figure, night, "The track", keys)


def draw_track_about_line(figure: Any, night: DrawnNight) -> None:
    """Draw RA and Dec minus a straight line fitted to the updated states, arcsec."""
    frames = [frame for frame in tracked_frames(night) if frame.updated is not None]
    ra_0_deg = _first(frames).x[0]
    t_s = np.array([night.seconds_since_start(frame) for frame in frames])
    states = [frame.updated for frame in frames if frame.updated is not None]
    ras = np.array([ra_0_deg + float(wrap_180(state.x[0] - ra_0_deg)) for state in states])
    decs = np.array([state.x[2] for state in states])
    ra_line, dec_line = _line(t_s, ras), _line(t_s, decs)
    cos_dec = math.cos(math.radians(float(decs.mean())))

    def ra_arcsec(frame: NightFrame, ra: float, _dec: float) -> float:
        line_deg = ra_line[0] + ra_line[1] * night.seconds_since_start(frame)
        return float(wrap_180(ra - line_deg)) * cos_dec * 3600.0

    def dec_arcsec(frame: NightFrame, _ra: float, dec: float) -> float:
        return (dec - dec_line[0] - dec_line[1] * night.seconds_since_start(frame)) * 3600.0

    upper, lower = figure.subplots(2, 1, sharex=True)
    _error_bars(upper, night, ra_arcsec, 0)
    _error_bars(lower, night, dec_arcsec, 2)
    keys = _panel(upper, night, ra_arcsec, _sigma_east_arcsec)
    _panel(lower, night, dec_arcsec, _sigma_north_arcsec)
    upper.set_ylabel("(α − line) cos δ (arcsec)")
    lower.set_ylabel("δ − line (arcsec)")
    write_corner_note(upper, _line_words("α", ra_line))
    write_corner_note(lower, _line_words("δ", dec_line))
    finish_figure(figure, night, "The track about a straight line", _with_bars(keys))


def draw_errors(figure: Any, night: DrawnNight, truth: Mapping[int, TruePlace]) -> None:
    """Draw measured, updated and predicted directions minus the satellite's true directions.

    ``truth``: true places by frame number.
    """

    def error(index: int) -> Where:
        def of(frame: NightFrame, ra: float, dec: float) -> float | None:
            true = truth.get(frame.frame_id)
            if true is None:
                return None
            return offset_arcsec(ra, dec, true.ra_icrs_deg, true.dec_icrs_deg)[index]

        return of

    upper, lower = figure.subplots(2, 1, sharex=True)
    _error_bars(upper, night, error(0), 0)
    _error_bars(lower, night, error(1), 2)
    keys = _panel(upper, night, error(0), _sigma_east_arcsec, is_about_zero=True)
    _panel(lower, night, error(1), _sigma_north_arcsec, is_about_zero=True)
    upper.set_ylabel("Error in α cos δ (arcsec)")
    lower.set_ylabel("Error in δ (arcsec)")
    name = next((true.name for true in truth.values()), "nothing real")
    finish_figure(figure, night, f"Errors against the true place of {name}", _with_bars(keys))


def _panel(
    axis: Any,
    night: DrawnNight,
    where: Where,
    sigma: Callable[[TrackState], float],
    *,
    is_about_zero: bool = False,
) -> list[tuple[Any, str]]:
    """One panel: bounds of the best state of each frame about it (or about 0), and the marks."""
    column = shade_misses(axis, night)
    frames = tracked_frames(night)
    bounds, bounds_key = _bounds(axis, night, where, sigma, is_about_zero)
    keys: list[tuple[Any, str]] = []
    shown: list[float] = []
    for marks, words in ((PREDICTED, "predicted"), (MEASURED, "measured"), (UPDATED, "updated")):
        points = [
            (night.seconds_since_start(frame), value)
            for frame in frames
            for value in [_value(frame, words, where)]
            if value is not None
        ]
        shown += [value for _, value in points]
        if points:
            (line,) = axis.plot(*zip(*points, strict=True), **marks)
            keys.append((line, words))
    _fit(axis, shown, bounds)
    return [*keys, (bounds_key, "± 3 √P, frame included"), (column, "missed")]


def _value(frame: NightFrame, words: str, where: Where) -> float | None:
    if words == "measured":
        m = frame.lead_measured
        return None if m is None else where(frame, m.ra_icrs_deg, m.dec_icrs_deg)
    state = frame.predicted if words == "predicted" else frame.updated
    return None if state is None else where(frame, state.x[0], state.x[2])


def _bounds(
    axis: Any,
    night: DrawnNight,
    where: Where,
    sigma: Callable[[TrackState], float],
    is_about_zero: bool,
) -> tuple[list[tuple[float, float]], Any]:
    """Dashed 3-sigma lines of the state after the frame; broken where there was no track."""
    t_s: list[float] = []
    low: list[float] = []
    high: list[float] = []
    for frame in night.frames:
        state = frame.lead_state
        centre = None if state is None else where(frame, state.x[0], state.x[2])
        t_s.append(night.seconds_since_start(frame))
        if state is None or centre is None:
            low.append(math.nan)
            high.append(math.nan)
            continue
        middle, reach = (0.0 if is_about_zero else centre), 3.0 * sigma(state)
        low.append(middle - reach)
        high.append(middle + reach)
    axis.fill_between(t_s, low, high, **BAND)
    (key,) = axis.plot(t_s, high, **BOUND)
    axis.plot(t_s, low, **BOUND)
    return [pair for pair in zip(low, high, strict=True) if not math.isnan(pair[0])], key


def _fit(axis: Any, shown: list[float], bounds: list[tuple[float, float]]) -> None:
    """The panel holds every mark, and the bounds but those far wider than usual."""
    if not shown or not bounds:
        return
    widths = sorted(high - low for low, high in bounds)
    widest = _FAR_WIDER * widths[len(widths) // 2]
    usual = [(low, high) for low, high in bounds if high - low <= widest]
    low = min(*shown, *(pair[0] for pair in usual))
    high = max(*shown, *(pair[1] for pair in usual))
    margin = 0.08 * (high - low) or 1.0
    axis.set_ylim(low - margin, high + margin)


def _first(frames: list[NightFrame]) -> TrackState:
    state = frames[0].lead_state
    if state is None:
        raise ValueError("a frame without a track was taken for one with")
    return state


def _line(t_s: Any, degrees: Any) -> tuple[float, float]:
    """Line through the points: (value at 0 s in deg, slope in deg/s)."""
    if len(t_s) < 2:
        return float(degrees[0]), 0.0
    slope, start = np.polyfit(t_s, degrees, 1)
    return float(start), float(slope)


def _line_words(letter: str, line: tuple[float, float]) -> str:
    start = wrap_360(line[0]) if letter == "α" else line[0]
    sign = "+" if line[1] >= 0.0 else "−"
    words = f"line: {letter} = {start:.5f}° {sign} {abs(line[1]) * 3600.0:.4f}″/s · t"
    return words.replace("-", "−")


def _sigma_east_arcsec(state: TrackState) -> float:
    return math.sqrt(state.P[0][0]) * math.cos(math.radians(state.x[2])) * 3600.0


def _sigma_north_arcsec(state: TrackState) -> float:
    return math.sqrt(state.P[2][2]) * 3600.0


def _with_bars(keys: list[tuple[Any, str]]) -> list[tuple[Any, str]]:
    return [(key, "measured, ± 1 σ" if words == "measured" else words) for key, words in keys]


def _error_bars(axis: Any, night: DrawnNight, where: Where, index: int) -> None:
    """Draw one sigma of each accepted measurement, by its own covariance."""
    points = [
        (night.seconds_since_start(frame), value, math.sqrt(m.cov_sky_arcsec2[index]))
        for frame in night.frames
        if (m := frame.lead_measured) is not None
        and (value := where(frame, m.ra_icrs_deg, m.dec_icrs_deg)) is not None
    ]
    if points:
        t_s, values, sigmas = zip(*points, strict=True)
        colour = MEASURED["markeredgecolor"]
        axis.errorbar(
            t_s, values, yerr=sigmas, fmt="none", ecolor=colour, elinewidth=0.8, alpha=0.6
        )
