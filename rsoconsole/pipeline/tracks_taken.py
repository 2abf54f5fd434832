"""Which measurements each track took, told from the records that the fold left."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from rsoconsole.records import FollowedAgain, Measurement, TrackState
from rsoconsole.sky.angles import separation_deg
from rsoconsole.sky.times import NS_PER_S
from rsoconsole.tracking.lqe import measured_direction_deg

_SAME_PLACE_DEG = 1.0 / 3600.0


@dataclass(slots=True)
class Track:
    """One track, from the two measurements that began it."""

    measurements: list[Measurement]
    """In order of time."""
    last: TrackState
    """The filter after the last of them."""
    predicted: TrackState | None = None
    """And before it; None where it began the track."""


@dataclass(slots=True)
class _Followed:
    """What the log says of one frame in the end."""

    candidates: list[Measurement] = field(default_factory=list)
    predicted: TrackState | None = None
    corrected: TrackState | None = None
    taken: Measurement | None = None
    """Once it has been asked for."""


class TracksTaken:
    """Takes a session's records in order."""

    KINDS = (Measurement, TrackState, FollowedAgain)
    """Those that it needs; others pass by."""

    def __init__(self) -> None:
        self._frames: dict[int, _Followed] = {}
        """In order of their numbers."""

    def hear(self, record: Any) -> None:
        """One record."""
        if not isinstance(record, self.KINDS):
            return
        frame = self._frames.setdefault(record.frame_id, _Followed())
        frame.taken = None
        if isinstance(record, Measurement):
            frame.candidates.append(record)
        elif isinstance(record, FollowedAgain):
            frame.predicted = frame.corrected = None
        elif record.kind == "predicted":
            frame.predicted = record
        else:
            frame.corrected = record

    def tracks(self) -> list[Track]:
        """All of them, in order of time."""
        in_order = [self._frames[number] for number in sorted(self._frames)]
        found: list[Track] = []
        for place, frame in enumerate(in_order):
            if frame.corrected is None or not frame.candidates:
                continue
            if frame.corrected.kind == "initial" or not found:
                begun_by = list(_begun_by(in_order[:place], frame.corrected))
                found.append(Track(begun_by, frame.corrected))
            found[-1].measurements.append(_taken(frame))
            found[-1].last, found[-1].predicted = frame.corrected, frame.predicted
        return found


def _taken(frame: _Followed) -> Measurement:
    if frame.taken is None:
        assert frame.corrected is not None
        place = measured_direction_deg(frame.corrected, frame.predicted)
        frame.taken = min(frame.candidates, key=lambda each: _away(each, place))
    return frame.taken


def _begun_by(before: Sequence[_Followed], initial: TrackState) -> Iterator[Measurement]:
    """The first of the two measurements that made a track: where its slope came from."""
    ra, ra_rate, dec, dec_rate = initial.x
    for frame in reversed(before):
        for each in frame.candidates:
            since_s = (each.t_mid_utc_ns - initial.t_utc_ns) / NS_PER_S
            place = ((ra + ra_rate * since_s) % 360.0, dec + dec_rate * since_s)
            if -90.0 <= place[1] <= 90.0 and _away(each, place) < _SAME_PLACE_DEG:
                yield each
                return


def _away(measurement: Measurement, place: tuple[float, float]) -> float:
    return separation_deg(measurement.ra_icrs_deg, measurement.dec_icrs_deg, *place)
