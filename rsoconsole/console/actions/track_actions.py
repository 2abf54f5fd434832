"""Keys of the list of tracks: choose a track, make it the lead, drop it, keep it."""

from functools import partial
from typing import ClassVar

from textual.binding import Binding, BindingType

from rsoconsole.console.actions.plot_actions import PlotActions
from rsoconsole.console.actions.second_press import TwoPressKeys, has_track
from rsoconsole.console.panes.panes import LinesPane
from rsoconsole.console.words.track_lines import is_chosen, track_name_words
from rsoconsole.control import ChooseStreak, DropTrack, KeepTrack
from rsoconsole.night import FollowedTrack, NightView
from rsoconsole.words import KEPT

DROP_KEY = "-"


def lead_track(night: NightView) -> FollowedTrack | None:
    """Return the lead, the track that the telescope follows; None: nothing is followed."""
    return next((each for each in night.tracks if each.is_lead), None)


def track_words(night: NightView, track: FollowedTrack) -> str:
    """Return a track in words: its number, and its name where it has one."""
    name = track_name_words(night, track.track_id)
    return f"track {track.number_text}{'' if name == '-' else f' ({name})'}"


class TracksPane(LinesPane, can_focus=False):
    """Pane of the list of tracks; while open it has the focus, and its keys act on a track."""

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
    """Keys of the list of tracks; dropping and keeping a track are refused here."""

    def action_close_tracks(self) -> None:
        """Close the list of tracks; the plots show again."""
        self.show_page(None)
        self.say(f"plots: {self.plotted_track_words or 'the lead'}")

    def action_show_neighbours(self, shows: bool) -> None:
        """List each track's neighbours, or with ``shows`` False the tracks."""
        self.shows_neighbours = shows
        self.show_plots()

    def action_move_track_cursor(self, by: int) -> None:
        """Move the list's cursor by ``by`` rows; a negative number moves it up."""
        if self.night.tracks:
            self._choose_track(min(max(self._chosen_index + by, 0), len(self.night.tracks) - 1))
        self.show_plots()

    def action_next_track(self) -> None:
        """Choose the next track; behind the last one comes the first."""
        count = len(self.night.tracks)
        if count < 2:
            self.say("no second satellite is followed")
            return
        track = self._choose_track((self._chosen_index + 1) % count)
        self.show_plots()
        self.say(f"plots: {track_words(self.night, track)}")

    @property
    def _chosen_index(self) -> int:
        """Index of the chosen track; without one that of the lead."""
        chosen = None if self.chosen_track is None else self.chosen_track.track_id
        found = (n for n, each in enumerate(self.night.tracks) if is_chosen(each, chosen))
        return next(found, 0)

    def _choose_track(self, index: int) -> FollowedTrack:
        track = self.night.tracks[index]
        self.chosen_track_id = None if track.is_lead else track.track_id
        return track

    def action_make_lead(self) -> None:
        """Make the chosen track the lead; the other tracks are still followed."""
        night, track, lead = self.night, self.chosen_track, lead_track(self.night)
        if track is None or track.is_lead:
            self.say(
                "nothing is followed" if lead is None else f"track {lead.number_text} is the lead"
            )
        elif self.check_can_act():
            if track.measured_px is None or track.measured_frame_id is None:
                self.say(
                    f"track {track.number_text} has no measurement that says which it is", "warn"
                )
                return
            x_px, y_px = track.measured_px
            self.send(ChooseStreak(frame_id=track.measured_frame_id, x_px=x_px, y_px=y_px))
            self.say(f"{track_words(night, track)} is to be the lead …")

    def action_drop_track(self) -> None:
        """Refuse: only the live console drops a track."""
        self.say("only the live console drops a track", "warn")

    def action_keep_track(self) -> None:
        """Refuse: only the live console keeps a track."""
        self.say("only the live console keeps a track", "warn")


class LiveTrackActions(TrackActions):
    """Keys of the live console's list of tracks: drop a track, keep it, take a drop back."""

    twice: TwoPressKeys

    def action_drop_track(self) -> None:
        """Drop the track at the cursor; the lead only on a second press."""
        track = self.chosen_track or lead_track(self.night)
        if track is None:
            self.say("nothing is followed that could be dropped", "warn")
        elif self.check_can_act():
            drop = partial(self._send_drop, track)
            if track.is_lead and has_track(self.engine):
                what = f"drops {track_words(self.night, track)}, the lead"
                self.twice.handle_press(f"drop_track {track.track_id}", what, drop, key=DROP_KEY)
            else:
                drop()

    def _send_drop(self, track: FollowedTrack) -> None:
        self.send(DropTrack(track=track.track_id))
        self.say(f"{track_words(self.night, track)} is to be dropped …")

    def action_keep_track(self) -> None:
        """Keep the track at the cursor however many frames miss it, or release it if it is kept."""
        track = self.chosen_track or lead_track(self.night)
        if track is None:
            self.say("nothing is followed that could be kept", "warn")
        elif self.check_can_act():
            is_kept = track.state.is_kept
            self.send(KeepTrack(track=track.track_id, off=True if is_kept else None))
            said = "is kept no longer" if is_kept else f"is {KEPT}"
            self.say(f"{track_words(self.night, track)} {said} …")

    def take_back_drop(self) -> bool:
        """Follow the last dropped track again; False: there is none, or autonomy has no control."""
        if self.engine.holder != "autonomy" or not self.night.dropped:
            return False
        number = self.night.dropped[-1]
        self.send(DropTrack(track=number, off=True))
        self.say(f"track {number} is followed again …")
        return True
