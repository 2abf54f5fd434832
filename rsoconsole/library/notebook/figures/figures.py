"""The paper's figures of a session: confidence, right ascension and declination, residuals.

Marks as in Jordan et al. (arXiv 2304.06227): measured red squares, updated blue triangles,
predicted green circles, 3-sigma bounds dashed. At the scale of a night the three marks coincide and
the bounds vanish; so one figure shows the same relative to a straight line, and another the
innovations with their own bounds.
"""

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rsoconsole.base import SessionError, system_errors_as
from rsoconsole.control import one_line
from rsoconsole.library.notebook.figures.draw_light import draw_light, has_light
from rsoconsole.library.notebook.figures.draw_sky import (
    draw_errors,
    draw_track,
    draw_track_about_line,
)
from rsoconsole.library.notebook.figures.draw_time import (
    draw_confidence,
    draw_nis,
    draw_quality,
    draw_residuals,
)
from rsoconsole.library.notebook.night.night import DrawnNight, read_drawn_night, read_truth
from rsoconsole.session import SessionReader, clock_fault_lines

FigureFormat = Literal["png", "svg", "pdf"]
WIDTH_IN = 6.6
MAX_NOTES = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureRecipe:
    """One of the figures: its name, the function that draws it, its height, and what it needs."""

    name: str
    draw: Callable[[Any, DrawnNight], None]
    """Draws a night into an empty matplotlib figure."""
    height_in: float = 5.0
    needs_track: bool = True


DRAWINGS = {
    each.name: each
    for each in (
        FigureRecipe(name="confidence", draw=draw_confidence, height_in=3.0, needs_track=False),
        FigureRecipe(name="track", draw=draw_track),
        FigureRecipe(name="track_about_line", draw=draw_track_about_line),
        FigureRecipe(name="residuals", draw=draw_residuals),
        FigureRecipe(name="nis", draw=draw_nis, height_in=3.0),
    )
}
"""Recipes of the figures by name, in the order in which they are written."""
QUALITY = FigureRecipe(name="quality", draw=draw_quality, height_in=6.0, needs_track=False)
LIGHT = FigureRecipe(name="lightcurve", draw=draw_light, needs_track=False)


def has_track(night: DrawnNight) -> bool:
    """True where a measurement has updated a lead track in at least one frame of the night."""
    return any(frame.updated is not None for frame in night.frames)


_UNDATED: Mapping[FigureFormat, dict[str, Any]] = {
    "png": {},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
}
"""Metadata by format that keep the time of drawing out of the file."""


def write_figures(
    session: Path, out: Path, *, truth: Path | None = None, file_format: FigureFormat = "png"
) -> tuple[Path, ...]:
    """Draw a session's figures into the folder ``out`` and return their paths, in order.

    ``truth``: file of a simulated observatory's truth, one JSON object for each exposure; with it
    one more figure is drawn, the errors relative to the truth. A session without a track gives only
    the figure of the confidence. Raises SessionError when the session cannot be read, holds no
    frame with a time, or ``out`` cannot be written.
    """
    night = read_drawn_night(session)
    drawings = [each for each in DRAWINGS.values() if has_track(night) or not each.needs_track]
    if has_light(night):
        drawings.append(LIGHT)
    if truth is not None and has_track(night):
        places = read_truth(truth, night)
        drawings.append(
            FigureRecipe(name="errors", draw=lambda figure, each: draw_errors(figure, each, places))
        )
    notes = clock_fault_lines(SessionReader(session))
    # Half a second of imports: only who draws pays for them. No window system is asked for.
    from rsoconsole.library.notebook.figures.inline import NightFigure, figure_style

    paths = []
    with figure_style(salt=night.title), warnings.catch_warnings():
        # A sign that the font lacks is a box in the picture, nothing to print code lines for.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        for number, drawing in enumerate(drawings, start=1):
            figure = NightFigure(WIDTH_IN, drawing.height_in)
            drawing.draw(figure, night)
            if notes:
                # Times on both sides of such an instant do not go together.
                words = "\n".join(f"CLOCK {one_line(each)}" for each in notes[:MAX_NOTES])
                figure.text(0.995, 0.995, words, fontsize=5, color="#9c1c15", ha="right", va="top")
            path = out / f"{number}_{drawing.name}.{file_format}"
            with system_errors_as(SessionError, f"{path} cannot be written: "):
                out.mkdir(parents=True, exist_ok=True)
                figure.savefig(path, metadata=_UNDATED[file_format])
            paths.append(path)
    return tuple(paths)


if TYPE_CHECKING:
    from matplotlib.figure import Figure


class NightPlots(ABC):
    """Plots that a session, a branch and a what-if have in common.

    Every method draws into ``figure`` (an empty matplotlib Figure or SubFigure of your own) or into
    a new figure, and returns it; a notebook displays it where it is the last line of a cell. No
    pyplot and no window is needed. Marks as in Jordan et al. (arXiv 2304.06227): measured red
    squares, updated blue triangles, predicted green circles, 3-sigma bounds dashed; frames in which
    the lead track was missed are shaded. Raises SessionError where there is no frame with a time,
    or no track to draw.
    """

    @abstractmethod
    def nights(self) -> tuple[DrawnNight, ...]:
        """Return the nights to draw, side by side."""

    def plot_confidence(self, figure: Any = None) -> "Figure":
        """Plot the confidence of the lead's measurements, the confidence of the others, and tau."""
        return self._plot(DRAWINGS["confidence"], figure)

    def plot_track(self, figure: Any = None) -> "Figure":
        """Plot right ascension and declination in degrees against time, as in the paper."""
        return self._plot(DRAWINGS["track"], figure)

    def plot_about_line(self, figure: Any = None) -> "Figure":
        """Plot the track in arcsec relative to the straight line through the updated states."""
        return self._plot(DRAWINGS["track_about_line"], figure)

    def plot_residuals(self, figure: Any = None) -> "Figure":
        """Plot the innovations on the sky (measured minus predicted) within bounds of 3 sqrt(S)."""
        return self._plot(DRAWINGS["residuals"], figure)

    def plot_nis(self, figure: Any = None) -> "Figure":
        """Plot the NIS of every update, its 95 % band, and its running mean."""
        return self._plot(DRAWINGS["nis"], figure)

    def plot_quality(self, figure: Any = None) -> "Figure":
        """Plot image and sky quality of each frame: width of its stars, background and so on."""
        return self._plot(QUALITY, figure)

    def plot_lightcurve(self, figure: Any = None, *, track: int | None = None) -> "Figure":
        """Plot a track's magnitude against time, and by the phase of its period if it has one.

        ``track``: its number; None: the track of the most streaks with a brightness. Raises
        SessionError where no brightness is on record.
        """
        nights = self.nights()
        if not any(has_light(night, track) for night in nights):
            of = "no track" if track is None else f"not of track {track}"
            raise SessionError(f"{nights[0].title}: brightness is on record of {of}")
        return self._plot(replace(LIGHT, draw=partial(draw_light, track=track)), figure)

    def _plot(self, drawing: FigureRecipe, figure: Any) -> "Figure":
        nights = self.nights()
        if drawing.needs_track and not any(has_track(night) for night in nights):
            raise SessionError(
                f"{nights[0].title}: nothing was followed, there is no {drawing.name} to draw; "
                "plot_confidence() shows what was detected"
            )
        # Half a second of imports: only who draws pays for them.
        from rsoconsole.library.notebook.figures.inline import NightFigure, figure_style

        if figure is None:
            figure = NightFigure(WIDTH_IN * len(nights), drawing.height_in)
        elif hasattr(figure, "set_layout_engine") and figure.get_layout_engine() is None:
            figure.set_layout_engine("constrained")  # the keys stand outside the panels
        with figure_style():
            if len(nights) == 1:
                drawing.draw(figure, nights[0])
                return figure  # type: ignore[no-any-return]
            for night, part in zip(nights, figure.subfigures(1, len(nights)), strict=True):
                if not drawing.needs_track or has_track(night):
                    drawing.draw(part, night)
                else:
                    part.suptitle(f"{night.title}: nothing followed", fontsize=9.5)
        return figure  # type: ignore[no-any-return]
