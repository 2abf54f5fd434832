"""The list of tracks over the plots: one is chosen, its plots are shown, it is made the lead."""

from dataclasses import replace
from functools import partial
from typing import ClassVar, Literal

from textual.binding import Binding, BindingType
from textual.message import Message

from rsoconsole.console.actions.curve_actions import CurveActions
from rsoconsole.console.night import FollowedTrack, FrameRow, NightView
from rsoconsole.console.panes import LinesPane
from rsoconsole.console.words import (
    is_chosen,
    name_words,
    neighbour_lines,
    present_utc_ns,
    track_list_lines,
)
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


class TrackActions(CurveActions):
    """Choose one of the tracks, look at it, make it the lead."""

    track_chosen: int | None = None
    """Whose plots are shown, and where the list's cursor is; None: the lead's."""

    shows_neighbours = False
    """Whether the list says who stands next to whom."""

    @property
    def tracks_pane(self) -> TracksPane:
        """The list."""
        return self.query_one("#tracks", TracksPane)

    @property
    def plotted(self) -> NightView:
        """The night with the rows of the chosen track; as it is where that is the lead's."""
        chosen = self._chosen_track
        return self.night if chosen is None else night_of(self.night, chosen)

    @property
    def plotted_words(self) -> str:
        """Whose the plots are, where they are not the lead's."""
        chosen = self._chosen_track
        return "" if chosen is None else f"track {chosen.number}"

    @property
    def _chosen_track(self) -> FollowedTrack | None:
        """The one that was chosen; None for the lead, or where it has ended."""
        tracks = self.night.tracks
        return next((each for each in tracks if each.track_id == self.track_chosen), None)

    def show_plots(self) -> None:
        """The list too."""
        super().show_plots()
        if self.page == "tracks":
            now = present_utc_ns(self.night, self.engine)
            chosen = self.track_chosen if self._chosen_track is not None else None
            lines = partial(track_list_lines, self.night, chosen, now)
            listed = partial(lines, next_aim=self.engine.next_aim)
            if self.shows_neighbours:
                self.tracks_pane.show(partial(neighbour_lines, self.night, chosen))
            else:
                self.tracks_pane.show(listed)

    def place_curves(self, *, alert_rows: int, timeline_rows: int, aspect: float) -> None:
        """Over the plots; while it is seen the list has the arrows."""
        super().place_curves(alert_rows=alert_rows, timeline_rows=timeline_rows, aspect=aspect)
        over, pane = self.pane("curves"), self.tracks_pane
        pane.display = self.page == "tracks" and over.display
        if pane.display:
            over.display = False
            pane.styles.offset = over.styles.offset
            pane.styles.width, pane.styles.height = over.styles.width, over.styles.height
        pane.can_focus = pane.display
        if pane.display and self.focused is None:
            self.set_focus(pane)
        elif not pane.display and self.focused is pane:
            self.set_focus(None)

    def action_track_list(self) -> None:
        """The tracks of the field; once more: the plots of the chosen one."""
        self._turn_to("tracks")

    def on_tracks_pane_wanted(self, message: TracksPane.Wanted) -> None:
        """One of the list's keys."""
        message.stop()
        if message.what == "close":
            self.show_page(None)
            self.say(f"plots: {self.plotted_words or 'the lead'}")
        elif message.what in {"neighbours", "list"}:
            self.shows_neighbours = message.what == "neighbours"
            self.show_plots()
        elif message.what == "lead":
            self._make_lead()
        elif message.what == "drop":
            self.drop_track()
        elif message.what == "keep":
            self.keep_track()
        else:
            self._choose_row(-1 if message.what == "above" else 1)

    def drop_track(self) -> None:
        """The live console drops it."""
        self.say("only the live console drops a track", "warn")

    def keep_track(self) -> None:
        """The live console keeps it."""
        self.say("only the live console keeps a track", "warn")

    def _choose_row(self, by: int) -> None:
        tracks = self.night.tracks
        if not tracks:
            return
        chosen = self.track_chosen if self._chosen_track is not None else None
        at = next((n for n, each in enumerate(tracks) if is_chosen(each, chosen)), 0)
        track = tracks[min(max(at + by, 0), len(tracks) - 1)]
        self.track_chosen = None if track.is_lead else track.track_id
        self.show_plots()

    def _make_lead(self) -> None:
        """The telescope follows the chosen one; the others go on being followed."""
        track = self._chosen_track
        if track is None or track.is_lead:
            lead = next((each for each in self.night.tracks if each.is_lead), None)
            said = "nothing is followed" if lead is None else f"track {lead.number} is the lead"
            self.say(said)
        elif self.may_act():
            if track.measured_px is None or track.measured_frame_id is None:
                self.say(f"track {track.number} has no measurement that says which it is", "warn")
                return
            x_px, y_px = track.measured_px
            self.send(Choose(frame_id=track.measured_frame_id, x_px=x_px, y_px=y_px))
            self.say(f"{self.words_of(track)} is to be the lead …")

    @property
    def track_at_cursor(self) -> FollowedTrack | None:
        """The chosen one, or the lead."""
        lead = next((each for each in self.night.tracks if each.is_lead), None)
        return self._chosen_track or lead

    def words_of(self, track: FollowedTrack) -> str:
        """Its number, and its name where it has one."""
        name = name_words(self.night, track.track_id)
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
