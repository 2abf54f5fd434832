"""The keys of the plots: which page lies over them, which frames they show."""

from functools import partial, partialmethod
from typing import ClassVar

from rsoconsole.console.actions.seat import Seat
from rsoconsole.console.actions.track_list import TrackList
from rsoconsole.console.drawing import AXIS_COLUMNS, Box
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


class PlotActions:
    """Plots of the track, or over them the curves of the night, the focus, the drift."""

    WORDS: ClassVar[dict[Page, str]] = {
        "quality": "sharpness, sky, transparency and stars over the night",
        "focus": "focus",
        "alignment": "pointing drift and polar alignment",
        "tracks": "the tracks of the field",
    }

    def __init__(self, seat: Seat, tracks: TrackList) -> None:
        """``tracks``: says whose plots they are, and is a page itself."""
        self._seat, self.tracks = seat, tracks
        self.page: Page | None = None
        """What lies over the plots; None: nothing does."""
        self.window = PlotWindow()

    def show(self) -> None:
        """The plots of the track and their times, and what lies over them."""
        seat = self._seat
        night, of = self.tracks.plotted(seat.night), self.tracks.words(seat.night)
        window = self.window
        seat.pane("confidence").show(partial(panels.confidence_lines, night, window=window))
        residuals = partial(panels.residual_lines, night, window=window, of=of)
        seat.pane("east").show(partial(residuals, "east"))
        seat.pane("north").show(partial(residuals, "north"))
        seat.pane("nis").show(partial(panels.nis_lines, night, window=window, of=of))
        words = window.words(night.rows)
        seat.pane("axis").show(
            lambda width, height: axis_lines(window.rows(night.rows, width), width, height, words)
        )
        if self.page == "quality":
            seat.pane("curves").show(partial(quality_lines, night.rows, window=window))
        elif self.page == "focus":
            seat.pane("curves").show(partial(focus_lines, night))
        elif self.page == "alignment":
            seat.pane("curves").show(partial(alignment_lines, night))
        elif self.page == "tracks":
            seat.pane("tracks").show(self.tracks.lines(seat.night, seat.engine))

    def place(self, box: Box, *, is_covered: bool) -> None:
        """The page lies over the plots; while the list of tracks is seen it has the arrows.

        ``is_covered``: something else lies there.
        """
        seat = self._seat
        over, listed = seat.pane("curves"), seat.pane("tracks")
        is_seen = self.page is not None and not is_covered
        listed.display = is_seen and self.page == "tracks"
        over.display = is_seen and not listed.display
        for pane in (over, listed):
            if pane.display:
                pane.styles.offset = (box.x, box.y)
                pane.styles.width, pane.styles.height = box.width, box.height
        listed.can_focus = listed.display
        if listed.display and seat.focused is None:
            seat.set_focus(listed)
        elif not listed.display and seat.focused is listed:
            seat.set_focus(None)

    def show_page(self, page: Page | None) -> None:
        """Put that page over the plots; None: the plots themselves."""
        self.page = page
        self._seat.place_panes()
        self.show()

    def action_track_plots(self) -> None:
        """Confidence, residuals and NIS."""
        self.show_page(None)
        self._seat.say("plots: confidence, residuals, NIS")

    def turn_to(self, page: Page) -> None:
        """That page; once more: the plots."""
        wanted = None if self.page == page else page
        self.show_page(wanted)
        self._seat.say(self.WORDS[wanted] if wanted else "plots: confidence, residuals, NIS")

    action_night_curves = partialmethod(turn_to, "quality")
    action_focus_help = partialmethod(turn_to, "focus")
    action_alignment = partialmethod(turn_to, "alignment")

    # -- which frames -------------------------------------------------------------------------

    def action_plots_back(self) -> None:
        """To earlier frames."""
        moved = self.window.moved(-LIVE_STEP, len(self._seat.night.rows), self._room())
        if moved == self.window:
            self._seat.say("plots: no earlier frames")
        else:
            self._see(moved)

    def action_plots_on(self) -> None:
        """To later frames; at the end they go on with the night."""
        self._see(self.window.moved(LIVE_STEP, len(self._seat.night.rows), self._room()))

    def _room(self) -> int:
        """Marks that the plots have room for."""
        return max(self._seat.pane("confidence").size.width - AXIS_COLUMNS, 1)

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
        self.show()
        words = window.words(self._seat.night.rows)
        self._seat.say(f"plots: {words or 'the newest frames, one to a mark'}")
