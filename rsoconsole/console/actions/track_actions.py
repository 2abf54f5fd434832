"""The keys of the list of tracks: choose one, make it the lead, drop it, keep it."""

from typing import ClassVar, Literal

from textual.binding import Binding, BindingType
from textual.message import Message

from rsoconsole.console.actions.plot_actions import PlotActions
from rsoconsole.console.actions.seat import Seat
from rsoconsole.console.actions.track_list import lead_of, track_words
from rsoconsole.console.actions.track_orders import TrackOrders
from rsoconsole.console.panes import LinesPane
from rsoconsole.control import Choose

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
