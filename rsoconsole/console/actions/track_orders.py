"""The operator's word on one track of the list: it is dropped, or kept whatever it misses."""

from functools import partial

from rsoconsole.console.actions.second_press import CarefulSeat, has_track
from rsoconsole.console.actions.track_actions import TrackActions
from rsoconsole.console.night import FollowedTrack
from rsoconsole.control import Drop, Keep

DROP_KEY = "-"


class TrackOrders(TrackActions, CarefulSeat):
    """Drop, keep, and take a drop back."""

    def drop_track(self) -> None:
        """The one at the cursor ends for good; the lead asks for the same key once more."""
        track = self.track_at_cursor
        if track is None:
            self.say("nothing is followed that could be dropped", "warn")
        elif self.may_act():
            drop = partial(self._send_drop, track)
            if track.is_lead and has_track(self.engine):
                what = f"drops {self.words_of(track)}, the lead"
                self.twice(f"drop_track {track.track_id}", what, drop, key=DROP_KEY)
            else:
                drop()

    def _send_drop(self, track: FollowedTrack) -> None:
        self.send(Drop(track=track.track_id))
        self.say(f"{self.words_of(track)} is to be dropped …")

    def keep_track(self) -> None:
        """No miss ends the one at the cursor in the field; once more: that holds no longer."""
        track = self.track_at_cursor
        if track is None:
            self.say("nothing is followed that could be kept", "warn")
        elif self.may_act():
            is_kept = track.state.is_kept
            self.send(Keep(track=track.track_id, off=True if is_kept else None))
            said = "is kept no longer" if is_kept else "is kept: no miss ends it in the field"
            self.say(f"{self.words_of(track)} {said} …")

    def take_back_drop(self) -> bool:
        """Follow again what was dropped last; False where nothing was."""
        if self.engine.holder != "autonomy" or not self.night.dropped:
            return False
        number = self.night.dropped[-1]
        self.send(Drop(track=number, off=True))
        self.say(f"track {number} is followed again, as if it had not been dropped …")
        return True
