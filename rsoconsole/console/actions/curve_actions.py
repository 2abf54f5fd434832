"""The keys of the plots: which page lies over them, which frames they show."""

from functools import partial
from typing import ClassVar

from rsoconsole.console.actions.tune_actions import TuneActions
from rsoconsole.console.drawing import AXIS_COLUMNS, orbit_box
from rsoconsole.console.night import NightView
from rsoconsole.console.panes import LinesPane
from rsoconsole.console.words import (
    LIVE_STEP,
    Page,
    PlotWindow,
    alignment_lines,
    axis_lines,
    focus_lines,
    panels,
    quality_lines,
)


class CurveActions(TuneActions):
    """Plots of the track, or over them the curves of the night, the focus, the drift."""

    WORDS: ClassVar[dict[Page, str]] = {
        "quality": "sharpness, sky, transparency and stars over the night",
        "focus": "focus",
        "alignment": "pointing drift and polar alignment",
        "tracks": "the tracks of the field",
    }

    def on_plots_made(self) -> None:
        """Before the first paint."""
        self.page: Page | None = None
        self.window = PlotWindow()

    @property
    def plotted(self) -> NightView:
        """The night that the plots of the track are drawn from."""
        return self.night

    @property
    def plotted_words(self) -> str:
        """Whose these plots are, where they are not the lead's."""
        return ""

    def pane(self, name: str) -> LinesPane:
        """The pane of that name."""
        return self.query_one(f"#{name}", LinesPane)

    def show_plots(self) -> None:
        """The plots of the track and their times, and what lies over them."""
        night, of = self.plotted, self.plotted_words
        window = self.window
        self.pane("confidence").show(partial(panels.confidence_lines, night, window=window))
        residuals = partial(panels.residual_lines, night, window=window, of=of)
        self.pane("east").show(partial(residuals, "east"))
        self.pane("north").show(partial(residuals, "north"))
        self.pane("nis").show(partial(panels.nis_lines, night, window=window, of=of))
        words = window.words(night.rows)
        self.pane("axis").show(
            lambda width, height: axis_lines(window.rows(night.rows, width), width, height, words)
        )
        if self.page == "quality":
            self.pane("curves").show(partial(quality_lines, night.rows, window=window))
        elif self.page == "focus":
            self.pane("curves").show(partial(focus_lines, night))
        elif self.page == "alignment":
            self.pane("curves").show(partial(alignment_lines, night))

    def place_curves(self, *, alert_rows: int, timeline_rows: int, aspect: float) -> None:
        """Over the plots."""
        pane = self.pane("curves")
        pane.display = self.page is not None and not self.covers_plots()
        if not pane.display:
            return
        box = orbit_box(
            *self.size, alert_rows=alert_rows, timeline_rows=timeline_rows, aspect=aspect
        )
        pane.styles.offset = (box.x, box.y)
        pane.styles.width, pane.styles.height = box.width, box.height

    def covers_plots(self) -> bool:
        """Whether something lies there that hides the curves."""
        return False

    def place_panes(self) -> None:
        """Where each pane lies; the screen that has them knows."""

    def show_page(self, page: Page | None) -> None:
        """Put that page over the plots; None: the plots themselves."""
        self.page = page
        self.place_panes()
        self.show_plots()

    def action_track_plots(self) -> None:
        """Confidence, residuals and NIS."""
        self.show_page(None)
        self.say("plots: confidence, residuals, NIS")

    def action_night_curves(self) -> None:
        """FWHM, background, transparency and stars; once more: the plots."""
        self._turn_to("quality")

    def action_focus_help(self) -> None:
        """The focus; once more: the plots."""
        self._turn_to("focus")

    def action_alignment(self) -> None:
        """Drift and polar alignment; once more: the plots."""
        self._turn_to("alignment")

    def _turn_to(self, page: Page) -> None:
        wanted = None if self.page == page else page
        self.show_page(wanted)
        self.say(self.WORDS[wanted] if wanted else "plots: confidence, residuals, NIS")

    # -- which frames -------------------------------------------------------------------------

    def action_plots_back(self) -> None:
        """To earlier frames."""
        moved = self.window.moved(-LIVE_STEP, len(self.night.rows), self._room())
        if moved == self.window:
            self.say("plots: no earlier frames")
        else:
            self._see(moved)

    def action_plots_on(self) -> None:
        """To later frames; at the end they go on with the night."""
        self._see(self.window.moved(LIVE_STEP, len(self.night.rows), self._room()))

    def _room(self) -> int:
        """Marks that the plots have room for."""
        return max(self.pane("confidence").size.width - AXIS_COLUMNS, 1)

    def action_plots_wider(self) -> None:
        """Twice the frames to a mark."""
        self._see(self.window.zoomed(2.0))

    def action_plots_finer(self) -> None:
        """Half the frames to a mark."""
        self._see(self.window.zoomed(0.5))

    def action_plots_newest(self) -> None:
        """The newest frames, one to a mark."""
        self._see(PlotWindow())

    def _see(self, window: PlotWindow) -> None:
        self.window = window
        self.show_plots()
        words = window.words(self.night.rows)
        self.say(f"plots: {words or 'the newest frames, one to a mark'}")
