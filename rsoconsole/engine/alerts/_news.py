"""Alerts made from the records of a session, one record at a time; without side effects."""

from collections.abc import Iterator
from dataclasses import dataclass, field

from rsoconsole.config import AlertKind
from rsoconsole.records import (
    CLOUD,
    FOLLOWING,
    Event,
    FrameTaken,
    Identified,
    Miss,
    Record,
    StateChange,
    TrackState,
)
from rsoconsole.words import IN_FAULT, catalogued_name, match_words, text

URGENT: frozenset[AlertKind] = frozenset(("fault", "limit"))
"""Kinds of alerts for which an operator may have to get up."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Alert:
    """One alert: an event of the session, in a sentence."""

    kind: AlertKind
    text: str
    t_utc_ns: int

    @property
    def is_urgent(self) -> bool:
        """True for faults and limits, whose number is limited separately."""
        return self.kind in URGENT


KINDS = (StateChange, Identified, Miss, Event, FrameTaken, TrackState)
_ITS_OWN = frozenset(("looked for again", "operator's word", "STOP", "disarmed", "moved by hand"))
"""Causes by which a track ends on the operator's order."""


@dataclass(slots=True)
class SessionAlerts:
    """The state from which each record of a session is turned into alerts."""

    frames: int = 0
    tracks: set[int] = field(default_factory=set)
    names: dict[int, str] = field(default_factory=dict)
    is_cloudy: bool = False

    def take(self, t_utc_ns: int, record: Record) -> list[Alert]:
        """Process one record and return its alerts."""
        return [Alert(kind=kind, text=words, t_utc_ns=t_utc_ns) for kind, words in self._of(record)]

    def closing_alert(self, t_utc_ns: int) -> Alert:
        """Return the alert that says that the session was closed."""
        named = ", ".join(dict.fromkeys(self.names.values()))
        words = f"the session is closed: {self.frames} frames, {len(self.tracks)} tracks"
        words += f"; identified: {named}" if named else ""
        return Alert(kind="done", text=words, t_utc_ns=t_utc_ns)

    def _of(self, record: Record) -> Iterator[tuple[AlertKind, str]]:
        match record:
            case FrameTaken():
                self.frames += 1
            case TrackState():
                self.tracks.add(record.track_id)
                if record.kind == "updated":
                    self.is_cloudy = False
            case StateChange():
                yield from self._of_state(record)
            case Identified():
                yield from self._of_name(record)
            case Miss():
                yield from self._of_miss(record)
            case Event(level="alarm"):
                kind: AlertKind = "limit" if record.topic == "limit" else "fault"
                yield kind, record.text
            case _:
                pass

    def _of_state(self, change: StateChange) -> Iterator[tuple[AlertKind, str]]:
        cause = change.reason.kind
        words = text(change.reason)
        if cause == "night ended":
            yield "dawn", f"the night is over: {words}"
        elif change.after == "FAULT" != change.before:
            yield "fault", f"{IN_FAULT}: {words}"
        elif cause in {"limit met", "too many limits"}:
            yield "limit", words
        elif change.after == "TRACK" and change.before not in FOLLOWING:
            yield "lock", f"a satellite is followed, from frame {change.frame_id}: {words}"
        elif cause not in _ITS_OWN and (
            (change.after == "LOST" != change.before)
            or (change.before in FOLLOWING and change.after == "SEARCH")
        ):
            yield "loss", f"the satellite is lost: {words}"

    def _of_name(self, found: Identified) -> Iterator[tuple[AlertKind, str]]:
        if found.verdict != "identified" or not found.matches:
            return
        best = found.matches[0]
        name = catalogued_name(best.name, best.norad_id)
        if self.names.get(found.track_id) != name:
            self.names[found.track_id] = name
            off = ", ".join(match_words(best)[1:])
            yield "identification", f"track {found.track_id} is {name}, {off}"

    def _of_miss(self, miss: Miss) -> Iterator[tuple[AlertKind, str]]:
        cloud = [each for each in miss.reason.hidden_by if each.kind in CLOUD]
        if cloud and not self.is_cloudy:
            self.is_cloudy = True
            yield "clouds", f"clouds, from frame {miss.frame_id}: {text(miss.reason)}"
