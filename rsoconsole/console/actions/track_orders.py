"""The operator's word on one track of the list: it is dropped, or kept whatever it misses."""

from functools import partial

from rsoconsole.console.actions.seat import Seat
from rsoconsole.console.actions.second_press import TwicePressed, has_track
from rsoconsole.console.actions.track_list import TrackList, track_words
from rsoconsole.control import Drop, Keep
from rsoconsole.night import FollowedTrack
from rsoconsole.words import KEPT

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
