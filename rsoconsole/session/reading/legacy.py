"""Sessions of before in the language of today: the one place that knows how they were.

Records of schema 1 to 3 carry no ids, and sentences for reasons; the first ones of schema 4 have
sentences for what came of a command, for most of what spoke against a candidate, for what a miss is
put down to, for what ended a track and for why a slew was refused. Which
measurement a track took is told by the track's own innovation, the two that began it by its first
slope; both were exact when they were written.
"""

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field, replace
from typing import Any, NamedTuple, assert_never

from rsoconsole.foreign_text import json_of
from rsoconsole.reason_text import text
from rsoconsole.reasons import Cause, Missed, Reason, Unclassified
from rsoconsole.records import (
    Closeup,
    CycleTiming,
    Detections,
    Event,
    ExpectedMembers,
    FollowedAgain,
    FrameTaken,
    Identified,
    LeapDone,
    LowPass,
    Measurement,
    Miss,
    NotFollowed,
    NotSolved,
    OperatorAction,
    OrbitEstimate,
    PairMotions,
    ParameterChange,
    Record,
    Ruling,
    SlewCommand,
    Solution,
    StateChange,
    TrackState,
    mark_id_of,
    measurement_id_of,
)
from rsoconsole.session.log import decode
from rsoconsole.session.reading import old_reasons
from rsoconsole.sky import NS_PER_S, separation_deg
from rsoconsole.tracking.filters import measured_direction_deg

LAST_SCHEMA = 3
"""Records up to this schema have no ids."""
KINDS = (
    FrameTaken,
    Measurement,
    NotFollowed,
    Ruling,
    FollowedAgain,
    TrackState,
    Miss,
    OrbitEstimate,
    Identified,
    SlewCommand,
    CycleTiming,
    Event,
)
"""Records that get ids, and those that tell which."""
_OF_TRACK = ("prediction", "prediction, offset by hand", "orbit", "orbit, offset by hand")
"""Reasons of slews that led to a track."""
_SAME_PLACE_DEG = 1.0 / 3600.0
_READ: dict[str, tuple[str, Callable[[str], Reason]]] = {
    "NotFollowed": ("reason", old_reasons.not_taken),
    "Miss": ("reason", old_reasons.missed),
    "FrameTaken": ("blocked", old_reasons.slew_refusal),
    "StateChange": ("reason", old_reasons.cause),
    "OperatorAction": ("outcome", old_reasons.result),
}
"""Kind -> the field that was a sentence, and what reads it."""
_NO_ID: dict[str, dict[str, Any]] = {
    "Measurement": {"measurement_id": ""},
    "TrackState": {"track_id": 0},
    "OrbitEstimate": {"track_id": 0},
    "Identified": {"track_id": 0},
}


def decode_old(kind: str, body: str) -> Record:
    """As ``codec.decode``, for a record of any schema; those of old ones have no ids yet."""
    return decode(kind, body, _upgraded)


def is_without_ids(kind: str, body: str) -> bool:
    """Whether a record is one of schema 1 to 3: it has no id where today's has one."""
    return not _NO_ID.get(kind, {}).keys() <= json_of(body).keys()


def decode_recorded(kind: str, body: str) -> Record:
    """As ``codec.decode``, for a record of schema 4: what is still a sentence becomes a kind."""
    return decode(kind, body, _with_kinds if kind in _READ or kind == "Detections" else _as_it_is)


def _as_it_is(_kind: str, fields: dict[str, Any]) -> dict[str, Any]:
    return fields


def _with_kinds(kind: str, fields: dict[str, Any]) -> dict[str, Any]:
    """The fields of a record, its reason as kind and figures."""
    if kind == "Detections":
        rejected = fields.get("rejected", ())
        if all(not isinstance(each["reason"], str) for each in rejected):
            return fields
        return {**fields, "rejected": [_rejected(each) for each in rejected]}
    if kind not in _READ:
        return fields
    name, read = _READ[kind]
    if isinstance(words := fields.get(name), str):
        reason = read(words)
        if fields.get("after") == "FAULT" and isinstance(reason, Unclassified):
            reason = Cause(kind="instrument", detail=words)
        return {**fields, name: asdict(reason)}
    if not isinstance(words, dict):
        return fields
    return {**fields, name: _outcome(words) if kind == "OperatorAction" else _with_parts(words)}


def _outcome(result: dict[str, Any]) -> dict[str, Any]:
    """What came of a command, by the kind that it has today."""
    kind = result.get("kind", "")
    return {**result, "kind": old_reasons.OUTCOME_KINDS.get(kind, kind)}


def _with_parts(reason: dict[str, Any]) -> dict[str, Any]:
    """A kind with its figures, and what it is made of as kinds too."""
    fields_: dict[str, Any] = {}
    if isinstance(missed := reason.get("missed"), str):
        fields_["missed"] = asdict(old_reasons.missed(missed))
    elif isinstance(missed, dict):
        fields_["missed"] = _with_parts(missed)
    if isinstance(hidden := reason.get("hidden_by"), str):
        fields_["hidden_by"] = [asdict(each) for each in old_reasons.hidden_by_all(hidden)]
    if isinstance(lost := reason.get("lost"), str):
        fields_["lost"] = asdict(old_reasons.track_lost(lost)) if lost else None
    return {**reason, **fields_}


def _upgraded(kind: str, fields: dict[str, Any]) -> dict[str, Any]:
    """The fields of a record with those that it lacks, and its reason as kind and figures."""
    fields = _with_kinds(kind, fields)
    if kind == "Event":
        return {"topic": old_reasons.topic_of(fields["text"]), **fields}
    if kind == "NotFollowed":
        return {**fields, "measurement": _measurement(fields["measurement"])}
    if kind == "Ruling":
        refused = [_measurement(each) for each in fields.get("refused", ())]
        return {**fields, "taken": _measurement(fields.get("taken")), "refused": refused}
    return {**_NO_ID.get(kind, {}), **fields}


def _rejected(fields: dict[str, Any]) -> dict[str, Any]:
    reason = fields["reason"]
    return (
        {**fields, "reason": asdict(old_reasons.rejected(reason))}
        if isinstance(reason, str)
        else fields
    )


def _measurement(fields: Any) -> Any:
    return fields if fields is None else {**_NO_ID["Measurement"], **fields}


class Ids(NamedTuple):
    """What an old record is to be given."""

    track_id: int | None = None
    measurements: tuple[str, ...] = ()
    """Of the measurements in it or named by it, in order."""
    is_instruments: bool = False
    """A miss of the loop's own: an instrument failed, as an alarm had said before."""


def with_ids(record: Record, ids: Ids) -> Record:  # noqa: PLR0911 -- one case a kind
    """The record as it would be written today."""
    match record:
        case Measurement():
            return _named(record, ids.measurements[0])
        case NotFollowed():
            measurement = _named(record.measurement, ids.measurements[0])
            return replace(record, measurement=measurement, track_id=ids.track_id)
        case Ruling():
            return _decision(record, ids.measurements)
        case TrackState():
            is_initial = record.kind == "initial" and len(ids.measurements) > 1
            return replace(
                record,
                track_id=ids.track_id or 1,
                measurement_id=ids.measurements[-1] if ids.measurements else None,
                begun_with=(ids.measurements[0], ids.measurements[1]) if is_initial else None,
            )
        case OrbitEstimate() | Identified():
            return replace(record, track_id=ids.track_id or 1)
        case Miss():
            words = text(record.reason)
            own = Missed(kind="instrument", detail=words) if ids.is_instruments else record.reason
            return replace(record, track_id=ids.track_id, reason=own)
        case SlewCommand():
            return replace(record, track_id=ids.track_id)
        case _:
            return record


def with_kind(row: dict[str, Any]) -> dict[str, Any]:
    """A row of one of the views, with the kind of its outcome as it is today."""
    if "outcome_kind" not in row:
        return row
    old = row["outcome_kind"]
    kind = old_reasons.result(row["outcome"] or "").kind if old is None else old
    return row | {"outcome_kind": old_reasons.OUTCOME_KINDS.get(kind, kind)}


def in_columns(row: dict[str, Any], ids: Ids) -> dict[str, Any]:
    """A row of one of the views, with the ids that SQL cannot find in an old record."""
    fields_ = {
        "track_id": ids.track_id,
        "measurement_id": ids.measurements[-1] if ids.measurements else None,
        "first_measurement_id": ids.measurements[0] if len(ids.measurements) > 1 else None,
        "is_lead": 1,
    }
    return row | {column: value for column, value in fields_.items() if column in row}


def _decision(record: Ruling, ids: tuple[str, ...]) -> Ruling:
    taken, refused = record.taken, ids
    if taken is not None:
        taken, refused = _named(taken, ids[0]), ids[1:]
    pairs = zip(record.refused, refused, strict=True)
    return replace(record, taken=taken, refused=tuple(_named(m, name) for m, name in pairs))


def _named(measurement: Measurement, measurement_id: str) -> Measurement:
    return replace(measurement, measurement_id=measurement_id)


@dataclass(slots=True)
class _Frame:
    """What an old session says of one exposure."""

    tracks_before: int
    """How many tracks had begun before it."""
    measured: list[Measurement] = field(default_factory=list)
    """Under their ids."""
    decisions: int = 0
    decision: Ruling | None = None
    predicted: TrackState | None = None

    def id_of(self, measurement: Measurement) -> str:
        """The id that it has, or gets: new is only what an operator has marked."""
        known = (m.measurement_id for m in self.measured if _named(m, "") == measurement)
        marked = mark_id_of(measurement.frame_id, self.decisions - 1)
        return next(known, marked)


class IdGiver:
    """Takes the records of an old session in order, those of ``KINDS``, and knows their ids."""

    def __init__(self) -> None:
        self._frames: dict[int, _Frame] = {}
        self._tracks = 0
        """How many have begun."""
        self._track_id: int | None = None
        """Of the frame whose records come in."""
        self._is_ruled = False
        """A decision has come, and none of the frames that it has followed again."""
        self._alarms: set[str] = set()
        """Said since the last frame came."""

    def ids_of(self, record: Record) -> Ids:  # noqa: PLR0911, PLR0912 -- one case a kind
        """What this record is to be given; nothing for most kinds."""
        match record:
            case FrameTaken():
                self._frames[record.frame_id] = _Frame(self._tracks)
                self._track_id = None
                self._alarms.clear()
            case CycleTiming():
                self._track_id = None
            case Measurement():
                return Ids(measurements=(self._measured(record),))
            case NotFollowed():
                named = self._frame(record.measurement.frame_id).id_of(record.measurement)
                return Ids(self._track_id, (named,))
            case Ruling():
                return self._ruled(record)
            case FollowedAgain():
                self._begin_again(record)
            case TrackState():
                return self._track(record)
            case OrbitEstimate() | Identified():
                return Ids(max(self._tracks, 1))
            case Miss():
                return Ids(self._track_id, is_instruments=text(record.reason) in self._alarms)
            case Event():
                if record.level == "alarm":
                    self._alarms.add(record.text)
            case SlewCommand():
                return Ids(max(self._tracks, 1) if record.reason in _OF_TRACK else None)
            case (
                Detections()
                | Solution()
                | NotSolved()
                | StateChange()
                | ParameterChange()
                | OperatorAction()
                | Closeup()
                | PairMotions()
                | ExpectedMembers()
                | LeapDone()
                | LowPass()
            ):
                pass
            case _:
                assert_never(record)
        return Ids()

    def _frame(self, frame_id: int) -> _Frame:
        return self._frames.setdefault(frame_id, _Frame(self._tracks))

    def _measured(self, record: Measurement) -> str:
        frame = self._frame(record.frame_id)
        if record.source == "operator":
            named = frame.id_of(record)
        else:
            number = sum(m.source == "network" for m in frame.measured)
            named = measurement_id_of(record.frame_id, number)
        frame.measured.append(_named(record, named))
        return named

    def _ruled(self, record: Ruling) -> Ids:
        frame = self._frame(record.frame_id)
        frame.decisions += 1
        self._is_ruled = True
        spoken_of = (() if record.taken is None else (record.taken,)) + record.refused
        names = tuple(frame.id_of(each) for each in spoken_of)
        frame.decision = _decision(record, names)
        return Ids(measurements=names)

    def _begin_again(self, record: FollowedAgain) -> None:
        frame = self._frame(record.frame_id)
        frame.predicted, self._track_id = None, None
        if self._is_ruled:
            # Tracks that had begun from here on are begun once more.
            self._tracks, self._is_ruled = frame.tracks_before, False
        else:
            frame.tracks_before = self._tracks

    def _track(self, record: TrackState) -> Ids:
        frame = self._frame(record.frame_id)
        self._tracks += record.kind == "initial"
        self._track_id = max(self._tracks, 1)
        if record.kind == "predicted":
            frame.predicted = record
            return Ids(self._track_id)
        taken = _taken(frame, record)
        if taken is None:
            return Ids(self._track_id)
        first = self._first(record) if record.kind == "initial" else None
        both = (taken,) if first is None else (first, taken)
        return Ids(self._track_id, tuple(m.measurement_id for m in both))

    def _first(self, initial: TrackState) -> Measurement | None:
        """The first of the two measurements that made a track: where its slope came from."""
        ra, ra_rate, dec, dec_rate = initial.x
        earlier = (n for n in self._frames if n < initial.frame_id)
        for number in sorted(earlier, reverse=True):
            for each in self._frames[number].measured:
                since_s = (each.t_mid_utc_ns - initial.t_utc_ns) / NS_PER_S
                place = ((ra + ra_rate * since_s) % 360.0, dec + dec_rate * since_s)
                if -90.0 <= place[1] <= 90.0 and _away_deg(each, place) < _SAME_PLACE_DEG:
                    return each
        return None


def _taken(frame: _Frame, corrected: TrackState) -> Measurement | None:
    """The measurement of the innovation; what the operator chose where there was a choice."""
    decision = frame.decision
    if decision is not None and decision.taken is not None:
        return decision.taken
    refused = () if decision is None else decision.refused
    candidates: Iterable[Measurement] = [m for m in frame.measured if m not in refused]
    predicted = None if corrected.kind == "initial" else frame.predicted
    place = measured_direction_deg(corrected, predicted)
    return min(candidates, key=lambda each: _away_deg(each, place), default=None)


def _away_deg(measurement: Measurement, place: tuple[float, float]) -> float:
    return separation_deg(measurement.ra_icrs_deg, measurement.dec_icrs_deg, *place)
