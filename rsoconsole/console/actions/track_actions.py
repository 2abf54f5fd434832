"""The keys of the list of tracks: choose one, make it the lead, drop it, keep it."""

from dataclasses import replace
from functools import partial, partialmethod
from typing import ClassVar

from textual.binding import Binding, BindingType

from rsoconsole.console.actions.seat import Seat, TwicePressed, has_track
from rsoconsole.console.drawing.pane_layout import Box
from rsoconsole.console.drawing.plot import AXIS_COLUMNS
from rsoconsole.console.panes.panes import Build, LinesPane
from rsoconsole.console.words import panels
from rsoconsole.console.words.curves import Page, alignment_lines, focus_lines, quality_lines
from rsoconsole.console.words.panels import LIVE_STEP, PlotWindow, axis_lines
from rsoconsole.console.words.track_lines import (
    is_chosen,
    name_words,
    neighbour_lines,
    track_list_lines,
)
from rsoconsole.console.words.words import present_utc_ns
from rsoconsole.control import Choose, Drop, Keep
from rsoconsole.night import FollowedTrack, FrameRow, NightView
from rsoconsole.words import KEPT

DROP_KEY = "-"


def lead_of(night: NightView) -> FollowedTrack | None:
    """The track that the telescope follows."""
    return next((each for each in night.tracks if each.is_lead), None)


def track_words(night: NightView, track: FollowedTrack) -> str:
    """Its number, and its name where it has one."""
    name = name_words(night, track.track_id)
    return f"track {track.number}{'' if name == '-' else f' ({name})'}"


def night_of(night: NightView, track: FollowedTrack) -> NightView:
    """The night as one of its tracks saw it: what the plots of that track are drawn from."""
    rows = {row.frame_id: row for row in track.rows}
    blank = {"is_followed": False, "residual_arcsec": None, "sigma_arcsec": None, "nis": None}

    def of_track(row: FrameRow) -> FrameRow:
        own = rows.get(row.frame_id)
        if own is None:
            return replace(row, miss=None, **blank)  # type: ignore[arg-type]
        return replace(
            row,
            is_followed=own.is_measured,
            residual_arcsec=own.residual_arcsec,
            sigma_arcsec=own.sigma_arcsec,
            nis=own.nis,
            miss=own.miss,
        )

    return replace(night, track=track.state, rows=tuple(of_track(row) for row in night.rows))


class PlotActions(Seat):
    """Plots of the track, or over them the curves of the night, the focus, the drift."""

    PAGES: ClassVar[dict[Page, str]] = {
        "quality": "sharpness, sky, transparency and stars over the night",
        "focus": "focus",
        "alignment": "pointing drift and polar alignment",
        "tracks": "the tracks of the field",
    }

    page: Page | None = None
    """What lies over the plots; None: nothing does."""
    window = PlotWindow()
    chosen_track_id: int | None = None
    """Whose plots are shown, and where the list's cursor is; None: the lead's."""
    shows_neighbours = False
    """Whether the list says who stands next to whom."""

    @property
    def chosen_track(self) -> FollowedTrack | None:
        """The chosen track; None for the lead, or where it has ended."""
        tracks = self.night.tracks
        return next((each for each in tracks if each.track_id == self.chosen_track_id), None)

    @property
    def plotted_words(self) -> str:
        """Whose the plots are, where they are not the lead's."""
        chosen = self.chosen_track
        return "" if chosen is None else f"track {chosen.number}"

    def show_plots(self) -> None:
        """The plots of the track and their times, and what lies over them."""
        chosen, of, window = self.chosen_track, self.plotted_words, self.window
        night = self.night if chosen is None else night_of(self.night, chosen)
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
        elif self.page == "tracks":
            self.pane("tracks").show(self._track_lines())

    def _track_lines(self) -> Build:
        """The list, or who stands next to whom."""
        night, track = self.night, self.chosen_track
        chosen = None if track is None else track.track_id
        if self.shows_neighbours:
            return partial(neighbour_lines, night, chosen)
        now = present_utc_ns(night, self.engine)
        return partial(track_list_lines, night, chosen, now, next_aim=self.engine.next_aim)

    def place_plots(self, box: Box, *, is_covered: bool) -> None:
        """The page lies over the plots; while the list of tracks is seen it has the arrows.

        ``is_covered``: something else lies there.
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
        """Put that page over the plots; None: the plots themselves."""
        self.page = page
        self.place_panes()
        self.show_plots()

    def action_track_plots(self) -> None:
        """Confidence, residuals and NIS."""
        self.show_page(None)
        self.say("plots: confidence, residuals, NIS")

    def _turn_to(self, page: Page) -> None:
        """That page; once more: the plots."""
        wanted = None if self.page == page else page
        self.show_page(wanted)
        self.say(self.PAGES[wanted] if wanted else "plots: confidence, residuals, NIS")

    action_night_curves = partialmethod(_turn_to, "quality")
    action_focus_help = partialmethod(_turn_to, "focus")
    action_alignment = partialmethod(_turn_to, "alignment")
    action_track_list = partialmethod(_turn_to, "tracks")

    # -- which frames -------------------------------------------------------------------------

    def action_plots_back(self) -> None:
        """To earlier frames."""
        moved = self.window.moved(-LIVE_STEP, len(self.night.rows), self._mark_count())
        if moved == self.window:
            self.say("plots: no earlier frames")
        else:
            self._show_window(moved)

    def action_plots_on(self) -> None:
        """To later frames; at the end they go on with the night."""
        self._show_window(self.window.moved(LIVE_STEP, len(self.night.rows), self._mark_count()))

    def _mark_count(self) -> int:
        """Marks that the plots have room for."""
        return max(self.pane("confidence").size.width - AXIS_COLUMNS, 1)

    def action_plots_wider(self) -> None:
        """Twice the frames to a mark."""
        self._show_window(self.window.zoomed(2.0))

    def action_plots_finer(self) -> None:
        """Half the frames to a mark."""
        self._show_window(self.window.zoomed(0.5))

    def action_plots_newest(self) -> None:
        """The newest frames, one to a mark."""
        self._show_window(PlotWindow())

    def _show_window(self, window: PlotWindow) -> None:
        self.window = window
        self.show_plots()
        words = window.words(self.night.rows)
        self.say(f"plots: {words or 'the newest frames, one to a mark'}")


class TracksPane(LinesPane, can_focus=False):
    """Shows the list; open, it has the focus, and its keys are the screen's actions on a track."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "screen.move_track_cursor(-1)", "Track above"),
        Binding("down", "screen.move_track_cursor(1)", "Track below"),
        Binding("right", "screen.show_neighbours(True)", "Who stands next to whom"),
        Binding("left", "screen.show_neighbours(False)", "List"),
        Binding("enter", "screen.make_lead", "Make it the lead"),
        Binding("minus,delete", "screen.drop_track", "Drop it"),
        Binding("plus", "screen.keep_track", "Keep it whatever it misses"),
        Binding("escape", "screen.close_tracks", "Close"),
    ]
    DEFAULT_CSS = """
    TracksPane { background: $surface; }
    """


class TrackActions(PlotActions):
    """The keys of the list of tracks; a screen whose keys act also drops and keeps one."""

    def action_close_tracks(self) -> None:
        """Put the list away."""
        self.show_page(None)
        self.say(f"plots: {self.plotted_words or 'the lead'}")

    def action_show_neighbours(self, shows: bool) -> None:
        """Who stands next to whom, or the list."""
        self.shows_neighbours = shows
        self.show_plots()

    def action_move_track_cursor(self, by: int) -> None:
        """Move the list's cursor by a number of rows."""
        tracks, chosen = self.night.tracks, self.chosen_track
        if tracks:
            chosen_id = None if chosen is None else chosen.track_id
            at = next((n for n, each in enumerate(tracks) if is_chosen(each, chosen_id)), 0)
            track = tracks[min(max(at + by, 0), len(tracks) - 1)]
            self.chosen_track_id = None if track.is_lead else track.track_id
        self.show_plots()

    def action_make_lead(self) -> None:
        """The telescope follows the chosen one; the others go on being followed."""
        night, track, lead = self.night, self.chosen_track, lead_of(self.night)
        if track is None or track.is_lead:
            self.say("nothing is followed" if lead is None else f"track {lead.number} is the lead")
        elif self.may_act():
            if track.measured_px is None or track.measured_frame_id is None:
                self.say(f"track {track.number} has no measurement that says which it is", "warn")
                return
            x_px, y_px = track.measured_px
            self.send(Choose(frame_id=track.measured_frame_id, x_px=x_px, y_px=y_px))
            self.say(f"{track_words(night, track)} is to be the lead …")

    def action_drop_track(self) -> None:
        """Not from here."""
        self.say("only the live console drops a track", "warn")

    def action_keep_track(self) -> None:
        """Not from here."""
        self.say("only the live console keeps a track", "warn")


class TrackOrders(TrackActions):
    """Drop a track, keep it, and take a drop back."""

    twice: TwicePressed

    def action_drop_track(self) -> None:
        """The one at the cursor ends for good; the lead asks for the same key once more."""
        track = self.chosen_track or lead_of(self.night)
        if track is None:
            self.say("nothing is followed that could be dropped", "warn")
        elif self.may_act():
            drop = partial(self._send_drop, track)
            if track.is_lead and has_track(self.engine):
                what = f"drops {track_words(self.night, track)}, the lead"
                self.twice.ask(f"drop_track {track.track_id}", what, drop, key=DROP_KEY)
            else:
                drop()

    def _send_drop(self, track: FollowedTrack) -> None:
        self.send(Drop(track=track.track_id))
        self.say(f"{track_words(self.night, track)} is to be dropped …")

    def action_keep_track(self) -> None:
        """No miss ends the one at the cursor in the field; once more: that holds no longer."""
        track = self.chosen_track or lead_of(self.night)
        if track is None:
            self.say("nothing is followed that could be kept", "warn")
        elif self.may_act():
            is_kept = track.state.is_kept
            self.send(Keep(track=track.track_id, off=True if is_kept else None))
            said = "is kept no longer" if is_kept else f"is {KEPT}"
            self.say(f"{track_words(self.night, track)} {said} …")

    def take_back_drop(self) -> bool:
        """Follow again what was dropped last; False where nothing was."""
        if self.engine.holder != "autonomy" or not self.night.dropped:
            return False
        number = self.night.dropped[-1]
        self.send(Drop(track=number, off=True))
        self.say(f"track {number} is followed again …")
        return True
