"""What all figures share: type, colours and marks, the axis of time, misses, legends."""

import itertools
from collections.abc import Sequence
from typing import Any

from rsoconsole.night import NightFrame
from rsoconsole.notebook.night import DrawnNight
from rsoconsole.sky import utc_ns_to_iso

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


def time_axis(axis: Any, night: DrawnNight) -> None:
    """Seconds since the first exposure, and when that was."""
    first = utc_ns_to_iso(night.frames[0].t_mid_utc_ns, decimals=0)
    axis.set_xlabel(f"Time since the middle of the first exposure, {_to_the_second(first)} (s)")
    last_s = night.seconds(night.frames[-1])
    margin_s = max(0.02 * last_s, 1.0)
    axis.set_xlim(-margin_s, last_s + margin_s)


def _to_the_second(iso: str) -> str:
    return iso.removesuffix("Z").replace("T", " ") + " UTC"


def head(axis: Any, night: DrawnNight, what: str) -> None:
    """A title: what is drawn, of which session, with which preset."""
    axis.set_title(f"{what}. {night.title}, preset {night.config.filter.preset}", loc="left")


def note(axis: Any, words: str) -> None:
    """A line inside the panel's lower right corner, legible over what is drawn there."""
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
    """A pale column for every frame in which the followed object was not measured.

    Returns one of them for the legend, None when there is none.
    """
    column = None
    half_s = 0.5 * median_step_s(night)
    for frame in night.frames:
        if frame.missed is not None:
            t_s = night.seconds(frame)
            column = axis.axvspan(
                t_s - half_s, t_s + half_s, color=MISS_COLOUR, alpha=0.7, linewidth=0, zorder=0
            )
    return column


def median_step_s(night: DrawnNight) -> float:
    """Typical time from one frame to the next."""
    times = [night.seconds(frame) for frame in night.frames]
    steps = sorted(b - a for a, b in itertools.pairwise(times))
    return steps[len(steps) // 2] if steps else 30.0


def legend_above(figure: Any, handles: Sequence[tuple[Any, str]]) -> None:
    """One line of keys above the panels; those that nothing was drawn for are left out."""
    drawn = [(handle, label) for handle, label in handles if handle is not None]
    figure.legend(
        [handle for handle, _ in drawn],
        [label for _, label in drawn],
        loc="outside upper center",
        ncols=len(drawn),
        columnspacing=1.4,
        handletextpad=0.5,
    )


def finish(figure: Any, night: DrawnNight, what: str, keys: Sequence[tuple[Any, str]] = ()) -> None:
    """What stands about the panels: a title, the axis of time, the keys."""
    panels = figure.axes
    figure.align_ylabels(panels)
    time_axis(panels[-1], night)
    head(panels[0], night, what)
    if keys:
        legend_above(figure, keys)


def with_track(night: DrawnNight) -> list[NightFrame]:
    """Frames at which a track was known."""
    return [frame for frame in night.frames if frame.track is not None]
