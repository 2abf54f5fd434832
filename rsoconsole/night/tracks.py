"""Every track of a session at its end: measurements, orbit, identification, ending. Pure."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from rsoconsole.control import one_line
from rsoconsole.night.frame import NightFrame
from rsoconsole.night.quality import FilterQuality, filter_quality, updates_of
from rsoconsole.records import Identified, Measurement, OrbitEstimate, TrackState
from rsoconsole.words import identity_words, text


@dataclass(frozen=True, slots=True, kw_only=True)
class NightTrack:
    """One track at the session's end, without results that a decision has replaced."""

    number: int
    states: tuple[TrackState, ...]
    measurements: tuple[Measurement, ...]
    """Measurements that the track took, in order of time, with the first where it is on record."""
    orbit: OrbitEstimate | None = None
    """Last orbit of the track; None without an orbit."""
    identified: Identified | None = None
    """Last identification of the track; None without one."""
    missed: Mapping[int, str] = field(default_factory=dict)
    lost: str = ""
    """Reason why the fold last gave the track up, in words; empty: it did not."""
    ended: str = ""
    """Cause of the track's end (given up, or dropped by the operator), in words; empty: neither."""

    @property
    def name(self) -> str | None:
        """Name of the object in the catalogue; None unless it is identified."""
        found = self.identified
        is_known = found is not None and found.verdict == "identified" and bool(found.matches)
        return self.identity_text if is_known else None

    @property
    def identity_text(self) -> str:
        """Identity of the object in words: INTELSAT 14, UCT 7?, not in catalogue; "-": none yet."""
        return one_line(identity_words(self.identified))

    @property
    def quality(self) -> FilterQuality:
        """Figures of merit of the track's filter updates."""
        return filter_quality(updates_of(self.states))


@dataclass(slots=True)
class _Parts:
    states: list[TrackState] = field(default_factory=list)
    missed: dict[int, str] = field(default_factory=dict)
    lost: list[str] = field(default_factory=list)
    orbit: OrbitEstimate | None = None
    name: Identified | None = None
    dropped: list[str] = field(default_factory=list)


def tracks_of(frames: Iterable[NightFrame]) -> dict[int, NightTrack]:
    """Gather the tracks of a night's frames, by track number."""
    parts: dict[int, _Parts] = {}
    measured: dict[str, Measurement] = {}
    for frame in sorted(frames, key=lambda each: each.frame_id):
        measured |= {each.measurement_id: each for each in frame.all_measurements}
        for each in frame.tracks:
            states = parts.setdefault(each.track_id, _Parts()).states
            states += [state for state in (each.predicted, each.updated) if state is not None]
        for miss in frame.misses:
            own = None if miss.track_id is None else parts.get(miss.track_id)
            if own is None:
                continue
            own.missed[frame.frame_id] = text(miss.reason)
            if miss.reason.lost is not None:
                own.lost.append(text(miss.reason.lost))
        for orbit in frame.orbits:
            parts.setdefault(orbit.track_id, _Parts()).orbit = orbit
        for name in frame.names:
            parts.setdefault(name.track_id, _Parts()).name = name
        for number in () if frame.decision is None else frame.decision.dropped:
            if number in parts:
                parts[number].dropped.append("dropped by the operator")
    return {
        number: _track(number, own, measured) for number, own in sorted(parts.items()) if own.states
    }


def _track(number: int, own: _Parts, measured: dict[str, Measurement]) -> NightTrack:
    ids: list[str | None] = []
    for state in own.states:
        begun = (*(state.begun_with or ())[:1], *state.begun_through)
        ids += [*begun, state.measurement_id]
    ended = (*own.lost, *own.dropped)
    return NightTrack(
        number=number,
        states=tuple(own.states),
        measurements=tuple(measured[each] for each in ids if each in measured),
        orbit=own.orbit,
        identified=own.name,
        missed=own.missed,
        lost=own.lost[-1] if own.lost else "",
        ended=ended[-1] if ended else "",
    )
