"""The plots of a track, the frames that they show, and the pages shown in their place."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial, partialmethod
from types import MappingProxyType
from typing import ClassVar

from rsoconsole.console.actions.seat import OperatorScreen
from rsoconsole.console.drawing.pane_layout import Box
from rsoconsole.console.drawing.plot import AXIS_COLUMNS
from rsoconsole.console.panes.panes import Build
from rsoconsole.console.words import panels
from rsoconsole.console.words.curves import Page, alignment_lines, focus_lines, image_quality_lines
from rsoconsole.console.words.light_curve import light_curve_lines
from rsoconsole.console.words.panels import LIVE_STEP, PlotWindow, time_axis_lines
from rsoconsole.console.words.track_lines import neighbour_lines, track_list_lines
from rsoconsole.console.words.words import frame_clock_utc_ns
from rsoconsole.night import FollowedTrack, FrameRow, NightView


def night_of_track(night: NightView, track: FollowedTrack) -> NightView:
    """Return a copy of the night whose rows hold one track's measurements, for its plots."""
    rows = {row.frame_id: row for row in track.rows}

    def of_track(row: FrameRow) -> FrameRow:
        own = rows.get(row.frame_id, FrameRow(frame_id=row.frame_id))
        return replace(
            row,
            is_followed=own.is_followed,
            residual_arcsec=own.residual_arcsec,
            sigma_arcsec=own.sigma_arcsec,
            nis=own.nis,
            miss=own.miss,
        )

    return replace(night, track=track.state, rows=tuple(of_track(row) for row in night.rows))


class PlotActions(OperatorScreen):
    """Draws a track's plots, or a page over them: quality, focus, alignment, tracks, light."""

    PAGES: ClassVar[dict[Page, str]] = {
        "quality": "sharpness, sky, transparency and stars over the night",
        "focus": "focus",
        "alignment": "pointing drift and polar alignment",
        "tracks": "the tracks of the field",
        "light": "magnitude over the frames",
    }

    _sigmas_on_trial: Mapping[int, tuple[float, float]] = MappingProxyType({})
    """One sigma (east, north) of the lead by frame, arcsec, with the settings on trial."""
    page: Page | None = None
    """The page that lies over the plots; None: the plots are seen."""
    window = PlotWindow()
    chosen_track_id: int | None = None
    """Track whose plots are shown and which the list's cursor is at; None: the lead."""
    shows_neighbours = False
    """True where the page of tracks lists each track's neighbours; False: the tracks."""

    @property
    def chosen_track(self) -> FollowedTrack | None:
        """The chosen track; None where that is the lead, or where the chosen track has ended."""
        tracks = self.night.tracks
        return next((each for each in tracks if each.track_id == self.chosen_track_id), None)

    @property
    def plotted_track_words(self) -> str:
        """The plotted track in words, "track 3"; empty: the lead."""
        chosen = self.chosen_track
        return "" if chosen is None else f"track {chosen.number_text}"

    def show_plots(self) -> None:
        """Draw the chosen track's plots with their time axis, and the open page, if any."""
        chosen, of, window = self.chosen_track, self.plotted_track_words, self.window
        night = self.night if chosen is None else night_of_track(self.night, chosen)
        self.pane("confidence").show(partial(panels.confidence_lines, night, window=window))
        on_trial = {} if of else self._sigmas_on_trial
        residuals = partial(panels.residual_lines, night, window=window, of=of, on_trial=on_trial)
        self.pane("east").show(partial(residuals, "east"))
        self.pane("north").show(partial(residuals, "north"))
        self.pane("nis").show(partial(panels.nis_lines, night, window=window, of=of))
        words = window.words(night.rows)
        self.pane("axis").show(
            lambda width, height: time_axis_lines(
                window.rows(night.rows, width), width, height, words
            )
        )
        if self.page == "quality":
            self.pane("curves").show(partial(image_quality_lines, night.rows, window=window))
        elif self.page == "focus":
            self.pane("curves").show(partial(focus_lines, night))
        elif self.page == "alignment":
            self.pane("curves").show(partial(alignment_lines, night))
        elif self.page == "light":
            self.pane("curves").show(partial(light_curve_lines, self.night, chosen, window=window))
        elif self.page == "tracks":
            self.pane("tracks").show(self._track_lines())

    def show_bounds_on_trial(self, sigmas_arcsec: Mapping[int, tuple[float, float]]) -> None:
        """Show bounds by the settings on trial in the lead's plots; {}: none."""
        if self._sigmas_on_trial != sigmas_arcsec:
            self._sigmas_on_trial = sigmas_arcsec
            self.show_plots()

    def _track_lines(self) -> Build:
        """Return the builder of the list of tracks or of their neighbours."""
        night, track = self.night, self.chosen_track
        chosen = None if track is None else track.track_id
        if self.shows_neighbours:
            return partial(neighbour_lines, night, chosen)
        now = frame_clock_utc_ns(night, self.engine)
        return partial(track_list_lines, night, chosen, now, next_aim=self.engine.next_aim)

    def place_page(self, box: Box, *, is_covered: bool) -> None:
        """Place the open page at ``box``, over the plots; an open list of tracks gets the focus.

        ``is_covered``: another pane lies over the plots, so that the page is hidden.
        """
        over, listed = self.pane("curves"), self.pane("tracks")
        is_seen = self.page is not None and not is_covered
        listed.display = is_seen and self.page == "tracks"
        over.display = is_seen and not listed.display
        for pane in (over, listed):
            if pane.display:
                pane.styles.offset = (box.x, box.y)
                pane.styles.width, pane.styles.height = box.width, box.height
        listed.can_focus = listed.display
        if listed.display and self.focused is None:
            self.set_focus(listed)
        elif not listed.display and self.focused is listed:
            self.set_focus(None)

    def show_page(self, page: Page | None) -> None:
        """Lay a page over the plots; None: show the plots themselves."""
        self.page = page
        self.place_panes()
        self.show_plots()

    def action_track_plots(self) -> None:
        """Show the plots: confidence, residuals and NIS."""
        self.show_page(None)
        self.say("plots: confidence, residuals, NIS")

    def _turn_to(self, page: Page) -> None:
        """Show that page; if it is shown already, the plots."""
        wanted = None if self.page == page else page
        self.show_page(wanted)
        self.say(self.PAGES[wanted] if wanted else "plots: confidence, residuals, NIS")

    action_night_curves = partialmethod(_turn_to, "quality")
    action_focus_help = partialmethod(_turn_to, "focus")
    action_alignment = partialmethod(_turn_to, "alignment")
    action_track_list = partialmethod(_turn_to, "tracks")
    action_light_curve = partialmethod(_turn_to, "light")

    # -- which frames -------------------------------------------------------------------------

    def action_plots_back(self) -> None:
        """Show earlier frames in the plots."""
        moved = self.window.moved(-LIVE_STEP, len(self.night.rows), self._mark_count())
        if moved == self.window:
            self.say("plots: no earlier frames")
        else:
            self._show_window(moved)

    def action_plots_on(self) -> None:
        """Show later frames in the plots; once they reach the newest, the plots follow new
        frames.
        """
        self._show_window(self.window.moved(LIVE_STEP, len(self.night.rows), self._mark_count()))

    def _mark_count(self) -> int:
        """Return the number of marks that the plots have room for."""
        return max(self.pane("confidence").size.width - AXIS_COLUMNS, 1)

    def action_plots_wider(self) -> None:
        """Show twice as many frames for each mark of the plots."""
        self._show_window(self.window.zoomed(2.0))

    def action_plots_finer(self) -> None:
        """Show half as many frames for each mark of the plots."""
        self._show_window(self.window.zoomed(0.5))

    def action_plots_newest(self) -> None:
        """Show the newest frames in the plots, one frame for each mark."""
        self._show_window(PlotWindow())

    def _show_window(self, window: PlotWindow) -> None:
        self.window = window
        self.show_plots()
        words = window.words(self.night.rows)
        self.say(f"plots: {words or 'the newest frames, one to a mark'}")
