"""The paper's figures by one call each, of one night or of two side by side."""

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

from rsoconsole.errors import SessionError
from rsoconsole.notebook.figures.figures import DRAWINGS, QUALITY, WIDTH_IN, Drawing, has_track
from rsoconsole.notebook.night import DrawnNight

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class NightPlots(ABC):
    """What a session, a branch and a what-if have in common.

    Every method draws into ``figure`` (a matplotlib Figure or SubFigure of your own, empty) or
    into a new one, and returns it; the last line of a cell shows it. Nothing needs pyplot or a
    window. Marks as in Jordan et al. (arXiv 2304.06227): measured red squares, updated blue
    triangles, predicted green circles, 3-sigma bounds dashed; frames that were missed are shaded.
    Raises SessionError where there is no frame with a time, or no track to draw.
    """

    @abstractmethod
    def nights(self) -> tuple[DrawnNight, ...]:
        """What is drawn, side by side."""

    def plot_confidence(self, figure: Any = None) -> "Figure":
        """Confidence of what the track took and of what it did not, and tau."""
        return self._plot(DRAWINGS["confidence"], figure)

    def plot_track(self, figure: Any = None) -> "Figure":
        """Right ascension and declination in degrees against time, as in the paper."""
        return self._plot(DRAWINGS["track"], figure)

    def plot_about_line(self, figure: Any = None) -> "Figure":
        """The same in seconds of arc about the straight line through the updated states."""
        return self._plot(DRAWINGS["track_about_line"], figure)

    def plot_residuals(self, figure: Any = None) -> "Figure":
        """Innovations on the sky, measured minus predicted, within 3 sqrt(S)."""
        return self._plot(DRAWINGS["residuals"], figure)

    def plot_nis(self, figure: Any = None) -> "Figure":
        """Normalised innovation squared against its 95 % band, and its running mean."""
        return self._plot(DRAWINGS["nis"], figure)

    def plot_quality(self, figure: Any = None) -> "Figure":
        """What each frame says of image and sky: width of its stars, background and so on."""
        return self._plot(QUALITY, figure)

    def _plot(self, drawing: Drawing, figure: Any) -> "Figure":
        nights = self.nights()
        if drawing.needs_track and not any(has_track(night) for night in nights):
            raise SessionError(
                f"{nights[0].title}: nothing was followed, there is no {drawing.name} to draw; "
                "plot_confidence() shows what was detected"
            )
        # Half a second of imports: only who draws pays for them.
        from rsoconsole.notebook.figures.inline import NightFigure, styled

        if figure is None:
            figure = NightFigure(WIDTH_IN * len(nights), drawing.height_in)
        elif hasattr(figure, "set_layout_engine") and figure.get_layout_engine() is None:
            figure.set_layout_engine("constrained")  # the keys stand outside the panels
        with styled():
            if len(nights) == 1:
                drawing.draw(figure, nights[0])
                return figure  # type: ignore[no-any-return]
            for night, part in zip(nights, figure.subfigures(1, len(nights)), strict=True):
                if not drawing.needs_track or has_track(night):
                    drawing.draw(part, night)
                else:
                    part.suptitle(f"{night.title}: nothing followed", fontsize=9.5)
        return figure  # type: ignore[no-any-return]
