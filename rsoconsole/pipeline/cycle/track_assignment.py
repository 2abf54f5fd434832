"""Assignment of a session's measurements to its tracks, from the records."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

from rsoconsole.config import FilterConfig
from rsoconsole.pipeline.frame.marked_frames import BEGIN_MARK, HELD
from rsoconsole.records import (
    FOLLOWING,
    CauseKind,
    FollowedAgain,
    Measurement,
    OperatorAction,
    Record,
    StateChange,
    TrackState,
)
from rsoconsole.tracking import Following

WHOLE = 32
"""Number of a track's last steps that stay whole; a begun mark reaches further."""


@dataclass(slots=True)
class Track:
    """Track with its measurements, those that began it included."""

    measurements: list[Measurement]
    last: TrackState
    predicted: TrackState | None = None
    """State that the filter predicted for the last measurement; None where that began the track."""

    @property
    def track_id(self) -> int:
        """Number of the track, as in the records."""
        return self.last.track_id


@dataclass(slots=True)
class _Steps:
    """Final steps of a track in one frame."""

    predicted: TrackState | None = None
    corrected: TrackState | None = None

    @property
    def is_lead(self) -> bool:
        state = self.corrected or self.predicted
        return state is not None and state.is_lead


class TrackAssignment:
    """Assigns a session's measurements to its tracks, from the records in order."""

    KINDS = (Measurement, TrackState, FollowedAgain, OperatorAction)
    """Kinds of records that are used; ``receive`` ignores any other kind."""

    def __init__(self) -> None:
        self._frames: dict[int, dict[int, _Steps]] = {}
        self._measured: dict[str, Measurement] = {}
        self._whole: dict[int, deque[_Steps]] = {}
        self._known: dict[int, Track] = {}
        """Tracks up to a frame, so that each frame is processed once."""
        self._known_to = -1
        self._most_whole = WHOLE

    def receive(self, record: Record) -> None:
        """Process the next record of the log."""
        match record:
            case Measurement():
                self._measured[record.measurement_id] = record
            case FollowedAgain():
                self._frames.pop(record.frame_id, None)
                self._begin_again()
            case TrackState():
                if record.frame_id <= self._known_to:
                    self._begin_again()
                of_frame = self._frames.setdefault(record.frame_id, {})
                steps = of_frame.setdefault(record.track_id, _Steps())
                if record.kind == "predicted":
                    steps.predicted = record
                else:
                    steps.corrected = record
                    self._let_go(record.track_id, steps)
            case OperatorAction() if record.verb == BEGIN_MARK:
                self._most_whole = WHOLE + HELD

    def tracks(self) -> list[Track]:
        """All tracks so far, in order of time."""
        for number in sorted(each for each in self._frames if each > self._known_to):
            for track_id, steps in self._frames[number].items():
                if steps.corrected is not None:
                    self._go_on(track_id, steps.corrected, steps.predicted)
            self._known_to = number
        return list(self._known.values())

    def _begin_again(self) -> None:
        """Drop the tracks so far: they rest on steps that no longer hold."""
        self._known, self._known_to = {}, -1

    def _let_go(self, track_id: int, newest: _Steps) -> None:
        """Drop covariances and mixtures of old steps, some 5 kB a step, from memory."""
        whole = self._whole.setdefault(track_id, deque())
        if not whole or whole[-1] is not newest:
            whole.append(newest)
        if len(whole) > self._most_whole:
            old = whole.popleft()
            old.predicted = None
            if old.corrected is not None:
                old.corrected = replace(old.corrected, P=(), mixture=None, memory=None)

    @property
    def newest_frame_id(self) -> int:
        """Number of the newest frame for which any track was predicted; -1 before the first."""
        return max(self._frames, default=-1)

    def live_tracks(self) -> list[Track]:
        """Return the tracks that continue in the newest frame with a prediction, the lead first."""
        if not self._frames:
            return []
        newest = self._frames[max(self._frames)]
        is_again = any(
            each.corrected is not None and each.corrected.kind == "initial" and each.is_lead
            for each in newest.values()
        )
        # A lead that was only predicted where another begins has been given up for it; of what
        # stands beside it the new track says which.
        ended: set[int | None]
        ended = {n for n, s in newest.items() if is_again and s.corrected is None and s.is_lead}
        ended |= {s.corrected.replaces for s in newest.values() if s.corrected is not None}
        found = [
            track
            for track in self.tracks()
            if track.track_id in newest and track.track_id not in ended
        ]
        return sorted(found, key=lambda track: not newest[track.track_id].is_lead)

    def _go_on(self, track_id: int, corrected: TrackState, predicted: TrackState | None) -> None:
        """Add an accepted measurement to its track."""
        taken = self._named((corrected.measurement_id,))
        if not taken:
            return  # its record has been lost
        if corrected.shared_with is not None:
            taken = []  # lies between two satellites: no direction of either
        if track_id not in self._known:
            earlier = (*(corrected.begun_with or ())[:1], *corrected.begun_through)
            self._known[track_id] = Track(self._named(earlier), corrected)
        track = self._known[track_id]
        track.measurements += taken
        track.last, track.predicted = corrected, predicted

    def _named(self, ids: Sequence[str | None]) -> list[Measurement]:
        return [self._measured[each] for each in ids if each in self._measured]


NS = 1_000_000_000
KEPT_S = 900.0
"""Longest time that a track is kept after disarming, STOP, a new search or a fault, s."""
_LEAVES_NOTHING: frozenset[CauseKind] = frozenset(
    ("limit met", "too many limits", "clock set", "night ended", "engine ended", "resumed")
)
"""Causes after which a track cannot be followed again, or is no longer kept."""


def kept_until_utc_ns(
    kept: Following, settings: FilterConfig, now_utc_ns: int, *, is_lent: bool
) -> int:
    """Return the last instant, UTC ns, at which an interrupted track can be resumed.

    ``kept``: state with the track; ``is_lent``: True where the operator moves the mount by hand:
    the track can then be resumed for as long as it could have coasted, else for ``KEPT_S`` at
    most.
    """
    seen_ns = now_utc_ns if kept.lead_measured is None else kept.lead_measured.t_mid_utc_ns
    until_ns = seen_ns + round(settings.max_coast_s * NS)
    return until_ns if is_lent else min(until_ns, now_utc_ns + round(KEPT_S * NS))


def resumable_state_after(
    change: StateChange, before: Following, kept: Following | None
) -> Following | None:
    """Return the state of the track that can be resumed after a change of state; or None.

    ``change``: not caused by a frame; ``before``: state before it; ``kept``: state that could be
    resumed until then.
    """
    if change.reason.kind in _LEAVES_NOTHING:
        return None
    if before.state in FOLLOWING:
        return before
    # There was a track then; under what is tried there is not.
    return None if change.before in FOLLOWING else kept
