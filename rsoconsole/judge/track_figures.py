"""What became of each satellite that a run followed: by the record alone, for the summary."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rsoconsole.judge.objects import steps_of
from rsoconsole.night import NightFrame, NightTrack
from rsoconsole.records import Identified, OrbitEstimate


@dataclass(slots=True)
class _Satellite:
    """All tracks of one satellite; of one that nobody knows, the one track."""

    tracks: list[int] = field(default_factory=list)
    frames: int = 0
    """In which it was measured."""
    last_frame: int = 0
    is_measured_last: bool = False


def tracks_figures(
    frames: Sequence[NightFrame], known: Mapping[int, NightTrack]
) -> list[dict[str, Any]]:
    """The summary's ``tracks``: one object a satellite, in the order in which they were found.

    ``tracks``: ids of those that were on it. ``frames``: how many of them measured it. ``state``
    at the end of the run: TRACK, COAST or LOST, and IDLE for one that was ended by a word;
    ``lost``: why, in words. ``orbit``: as in the summary.
    """
    satellites: dict[object, _Satellite] = {}
    for frame in frames:
        for track_id, step in steps_of(frame).items():
            number = _number(known[track_id].identified)
            key: object = ("track", track_id) if number is None else number
            found = satellites.setdefault(key, _Satellite())
            if track_id not in found.tracks:
                found.tracks.append(track_id)
            updated = step.updated
            is_measured = updated is not None and updated.kind != "predicted"
            # A track begins with two measurements, in two frames.
            found.frames += 2 if updated is not None and updated.kind == "initial" else is_measured
            found.last_frame, found.is_measured_last = frame.frame_id, is_measured
    newest = max((frame.frame_id for frame in frames), default=0)
    return [_figures(each, known, newest) for each in satellites.values()]


def _number(found: Identified | None) -> int | None:
    """Of the catalogue, where it is surely that one."""
    if found is None or found.verdict != "identified" or not found.matches:
        return None
    return found.matches[0].norad_id


def _figures(satellite: _Satellite, known: Mapping[int, NightTrack], newest: int) -> dict[str, Any]:
    last = known[satellite.tracks[-1]]
    orbit, named, lost = last.orbit, last.identified, last.lost
    is_named = _number(named) is not None
    return {
        "name": named.matches[0].name if named is not None and is_named else None,
        "norad_id": _number(named),
        "tracks": list(satellite.tracks),
        "frames": satellite.frames,
        "last_frame": satellite.last_frame,
        "state": _state(satellite, lost, newest),
        "lost": lost or None,
        "orbit": None if orbit is None else orbit_figures(orbit),
    }


def _state(satellite: _Satellite, lost: str, newest: int) -> str:
    if lost:
        return "LOST"
    if satellite.last_frame < newest:
        return "IDLE"
    return "TRACK" if satellite.is_measured_last else "COAST"


def orbit_figures(orbit: OrbitEstimate) -> dict[str, Any]:
    """The last one."""
    names: Sequence[str] = (
        *("label", "prior", "a_km", "sigma_a_km", "e", "i_deg", "observations", "arc_s"),
    )
    return {name: getattr(orbit, name) for name in names}
