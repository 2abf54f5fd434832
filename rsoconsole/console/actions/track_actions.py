"""The keys of the list of tracks: choose one, make it the lead, drop it, keep it."""

from dataclasses import dataclass, replace
from functools import partial, partialmethod
from typing import ClassVar, Literal

from textual.binding import Binding, BindingType
from textual.message import Message

from rsoconsole.console.actions.seat import Seat, TwicePressed, has_track
from rsoconsole.console.drawing.pane_layout import Box
from rsoconsole.console.drawing.plot import AXIS_COLUMNS
from rsoconsole.console.night.engine_seen import EngineView
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


@dataclass(slots=True)
class TrackList:
    """Where the list's cursor is, and what it shows."""

    chosen_id: int | None = None
    """Whose plots are shown, and where the cursor is; None: the lead's."""
    shows_neighbours: bool = False
    """Whether the list says who stands next to whom."""

    def chosen(self, night: NightView) -> FollowedTrack | None:
        """The chosen track; None for the lead, or where it has ended."""
        return next((each for each in night.tracks if each.track_id == self.chosen_id), None)

    def at_cursor(self, night: NightView) -> FollowedTrack | None:
        """The chosen one, or the lead."""
        return self.chosen(night) or lead_of(night)

    def plotted(self, night: NightView) -> NightView:
        """The night with the rows of the chosen track; as it is where that is the lead's."""
        chosen = self.chosen(night)
        return night if chosen is None else night_of(night, chosen)

    def words(self, night: NightView) -> str:
        """Whose the plots are, where they are not the lead's."""
        chosen = self.chosen(night)
        return "" if chosen is None else f"track {chosen.number}"

    def lines(self, night: NightView, engine: EngineView) -> Build:
        """The list, or who stands next to whom."""
        chosen = self.chosen_id if self.chosen(night) is not None else None
        if self.shows_neighbours:
            return partial(neighbour_lines, night, chosen)
        now = present_utc_ns(night, engine)
        return partial(track_list_lines, night, chosen, now, next_aim=engine.next_aim)

    def move(self, night: NightView, by: int) -> None:
        """Move the cursor by a number of rows."""
        tracks = night.tracks
        if not tracks:
            return
        chosen = self.chosen_id if self.chosen(night) is not None else None
        at = next((n for n, each in enumerate(tracks) if is_chosen(each, chosen)), 0)
        track = tracks[min(max(at + by, 0), len(tracks) - 1)]
        self.chosen_id = None if track.is_lead else track.track_id


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


DROP_KEY = "-"


class TrackOrders:
    """Drop, keep, and take a drop back."""

    def __init__(self, seat: Seat, twice: TwicePressed, tracks: TrackList) -> None:
        self._seat, self._twice, self._tracks = seat, twice, tracks

    def drop_track(self) -> None:
        """The one at the cursor ends for good; the lead asks for the same key once more."""
        seat = self._seat
        track = self._tracks.at_cursor(seat.night)
        if track is None:
            seat.say("nothing is followed that could be dropped", "warn")
        elif seat.may_act():
            drop = partial(self._send_drop, track)
            if track.is_lead and has_track(seat.engine):
                what = f"drops {track_words(seat.night, track)}, the lead"
                self._twice.ask(f"drop_track {track.track_id}", what, drop, key=DROP_KEY)
            else:
                drop()

    def _send_drop(self, track: FollowedTrack) -> None:
        self._seat.send(Drop(track=track.track_id))
        self._seat.say(f"{track_words(self._seat.night, track)} is to be dropped …")

    def keep_track(self) -> None:
        """No miss ends the one at the cursor in the field; once more: that holds no longer."""
        seat = self._seat
        track = self._tracks.at_cursor(seat.night)
        if track is None:
            seat.say("nothing is followed that could be kept", "warn")
        elif seat.may_act():
            is_kept = track.state.is_kept
            seat.send(Keep(track=track.track_id, off=True if is_kept else None))
            said = "is kept no longer" if is_kept else f"is {KEPT}"
            seat.say(f"{track_words(seat.night, track)} {said} …")

    def take_back_drop(self) -> bool:
        """Follow again what was dropped last; False where nothing was."""
        seat = self._seat
        if seat.engine.holder != "autonomy" or not seat.night.dropped:
            return False
        number = seat.night.dropped[-1]
        seat.send(Drop(track=number, off=True))
        seat.say(f"track {number} is followed again …")
        return True


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


Wanting = Literal["above", "below", "lead", "drop", "keep", "close", "neighbours", "list"]


class TracksPane(LinesPane, can_focus=False):
    """Shows the list; its keys say what is wanted. Open, it has the focus."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "say('above')", "Track above"),
        Binding("down", "say('below')", "Track below"),
        Binding("right", "say('neighbours')", "Who stands next to whom"),
        Binding("left", "say('list')", "List"),
        Binding("enter", "say('lead')", "Make it the lead"),
        Binding("minus,delete", "say('drop')", "Drop it"),
        Binding("plus", "say('keep')", "Keep it whatever it misses"),
        Binding("escape", "say('close')", "Close"),
    ]
    DEFAULT_CSS = """
    TracksPane { background: $surface; }
    """

    class Wanted(Message):
        """Something is to be done with the list."""

        def __init__(self, what: Wanting) -> None:
            super().__init__()
            self.what: Wanting = what

    def action_say(self, what: Wanting) -> None:
        """What is wanted."""
        self.post_message(self.Wanted(what))


class TrackActions:
    """Choose one of the tracks, look at it, make it the lead."""

    def __init__(self, seat: Seat, plots: PlotActions) -> None:
        self._seat, self._plots, self._tracks = seat, plots, plots.tracks
        self.orders: TrackOrders | None = None
        """None where nothing is dropped or kept: in a review."""

    def action_track_list(self) -> None:
        """The tracks of the field; once more: the plots of the chosen one."""
        self._plots.turn_to("tracks")

    def do(self, message: TracksPane.Wanted) -> None:
        """One of the list's keys."""
        night = self._seat.night
        if message.what == "close":
            self._plots.show_page(None)
            self._seat.say(f"plots: {self._tracks.words(night) or 'the lead'}")
        elif message.what in {"neighbours", "list"}:
            self._tracks.shows_neighbours = message.what == "neighbours"
            self._plots.show()
        elif message.what == "lead":
            self._make_lead()
        elif message.what in {"drop", "keep"}:
            self._order(message.what)
        else:
            self._tracks.move(night, -1 if message.what == "above" else 1)
            self._plots.show()

    def _order(self, what: Wanting) -> None:
        if self.orders is None:
            self._seat.say(f"only the live console {what}s a track", "warn")
        elif what == "drop":
            self.orders.drop_track()
        else:
            self.orders.keep_track()

    def _make_lead(self) -> None:
        """The telescope follows the chosen one; the others go on being followed."""
        seat, night = self._seat, self._seat.night
        track, lead = self._tracks.chosen(night), lead_of(night)
        if track is None or track.is_lead:
            said = "nothing is followed" if lead is None else f"track {lead.number} is the lead"
            seat.say(said)
        elif seat.may_act():
            if track.measured_px is None or track.measured_frame_id is None:
                seat.say(f"track {track.number} has no measurement that says which it is", "warn")
                return
            x_px, y_px = track.measured_px
            seat.send(Choose(frame_id=track.measured_frame_id, x_px=x_px, y_px=y_px))
            seat.say(f"{track_words(night, track)} is to be the lead …")
