"""Every track of a session: what it measured, its orbit, its name, how it ended. Pure."""

import math
import statistics
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from rsoconsole.control import one_line
from rsoconsole.reason_text import text
from rsoconsole.reasons import Missed
from rsoconsole.records import (
    FollowedAgain,
    Identified,
    Measurement,
    Miss,
    OrbitEstimate,
    Record,
    Ruling,
    TrackState,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class NightTrack:
    """One track, as the record has it at its end; what the operator's word replaced counts not."""

    number: int
    """Its number in the session."""
    states: tuple[TrackState, ...]
    """In order of time: predicted, initial, updated."""
    measurements: tuple[Measurement, ...]
    """Those that it took, in order of time, the first of all among them where it is on record."""
    orbit: OrbitEstimate | None = None
    """The last one."""
    identified: Identified | None = None
    """The last word on which catalogued object it is."""
    missed: Mapping[int, str] = field(default_factory=dict)
    """Frames that did not show it, by their numbers, and why."""
    ended: str = ""
    """What ended it, in words; empty: nothing that is on record."""

    @property
    def name(self) -> str | None:
        """In the catalogue; None where that is not known, or more than one may be it."""
        found = self.identified
        if found is None or found.verdict != "identified" or not found.matches:
            return None
        best = found.matches[0]
        return one_line(best.name or str(best.norad_id))

    @property
    def object_words(self) -> str:
        """What catalogue or ledger say of it: a name, a name in doubt, or that none fits."""
        found = self.identified
        if found is None:
            return "not asked"
        if found.verdict == "unknown" and found.ledger is not None:
            return one_line(found.ledger.name) + ("" if found.ledger.is_sure else "?")
        if self.name is not None or not found.matches:
            return self.name or found.verdict
        best = found.matches[0]
        return f"{found.verdict}: {one_line(best.name or str(best.norad_id))}?"

    @property
    def has_led(self) -> bool:
        """Whether the telescope ever followed it."""
        return any(state.is_lead for state in self.states)

    @property
    def residual_rms_arcsec(self) -> float | None:
        """Of measured minus predicted, on the sky; None without an update."""
        off = [s.innovation_arcsec for s in self.states if s.innovation_arcsec is not None]
        return math.sqrt(statistics.fmean(e * e + n * n for e, n in off)) if off else None

    @property
    def nis_mean(self) -> float | None:
        """Of its updates; None without one."""
        found = [s.nis for s in self.states if s.nis is not None]
        return statistics.fmean(found) if found else None


@dataclass(slots=True)
class _Parts:
    states: dict[tuple[int, str], TrackState] = field(default_factory=dict)
    """By frame and kind."""
    missed: dict[int, str] = field(default_factory=dict)
    lost: dict[int, str] = field(default_factory=dict)
    """By frame: what ended it there."""
    orbits: dict[int, OrbitEstimate] = field(default_factory=dict)
    names: dict[int, Identified] = field(default_factory=dict)
    dropped: dict[int, str] = field(default_factory=dict)

    def forget(self, frame_id: int) -> None:
        """What a frame first led to counts no more."""
        for kind in ("predicted", "initial", "updated"):
            self.states.pop((frame_id, kind), None)
        for found in (self.missed, self.lost, self.orbits, self.names):
            found.pop(frame_id, None)


def tracks_of(records: Iterable[Record]) -> dict[int, NightTrack]:
    """The tracks of a log by their numbers."""
    parts: dict[int, _Parts] = {}
    measured: dict[str, Measurement] = {}
    for record in records:
        match record:
            case Measurement():
                measured[record.measurement_id] = record
            case FollowedAgain():
                for each in parts.values():
                    each.forget(record.frame_id)
            case Ruling():
                for number, each in parts.items():
                    each.dropped.pop(record.frame_id, None)
                    if number in record.dropped:
                        each.dropped[record.frame_id] = "dropped by the operator"
            case TrackState():
                own = parts.setdefault(record.track_id, _Parts())
                own.states[record.frame_id, record.kind] = record
            case Miss(track_id=int(number)) if number in parts:
                reason = record.reason
                parts[number].missed[record.frame_id] = text(reason)
                if isinstance(reason, Missed) and reason.lost is not None:
                    parts[number].lost[record.frame_id] = text(reason.lost)
            case OrbitEstimate():
                parts.setdefault(record.track_id, _Parts()).orbits[record.frame_id] = record
            case Identified():
                parts.setdefault(record.track_id, _Parts()).names[record.frame_id] = record
    return {
        number: _track(number, own, measured) for number, own in sorted(parts.items()) if own.states
    }


def _track(number: int, own: _Parts, measured: dict[str, Measurement]) -> NightTrack:
    states = tuple(state for _, state in sorted(own.states.items(), key=lambda at: at[0][0]))
    ids: list[str | None] = []
    for state in states:
        begun = (*(state.begun_with or ())[:1], *state.begun_through)
        ids += [*begun, state.measurement_id]
    ended = (*own.lost.values(), *own.dropped.values())
    return NightTrack(
        number=number,
        states=states,
        measurements=tuple(measured[each] for each in ids if each in measured),
        orbit=own.orbits[max(own.orbits)] if own.orbits else None,
        identified=own.names[max(own.names)] if own.names else None,
        missed=own.missed,
        ended=ended[-1] if ended else "",
    )
