"""A night at one instant, as screens show it, and a place of the log to return to."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from rsoconsole.config import Config
from rsoconsole.night.current_tracks import CurrentTracks, FollowedTrack
from rsoconsole.night.frame import FrameRow, NightFrame
from rsoconsole.night.log_lines import LogLine
from rsoconsole.records import (
    CycleTiming,
    ExpectedMembers,
    FrameTaken,
    Identified,
    LoopState,
    OrbitEstimate,
    PairMotion,
    Site,
    SlewCommand,
    TrackState,
)
from rsoconsole.sky import largest_sigma

Item = TypeVar("Item")
Chunks: TypeAlias = tuple[tuple[Item, ...], ...]
"""Items in order, in chunks of ``CHUNK``."""
CHUNK = 256
"""Items in a chunk: kept places of a night share the chunks that are alike."""


def in_chunks(items: Sequence[Item], before: Chunks[Item]) -> Chunks[Item]:
    """Cut items into chunks, taking those of ``before`` that are the same."""
    chunks = []
    for number, start in enumerate(range(0, len(items), CHUNK)):
        chunk = tuple(items[start : start + CHUNK])
        is_as_before = number < len(before) and before[number] == chunk
        chunks.append(before[number] if is_as_before else chunk)
    return tuple(chunks)


LAST_FRAMES = 8
"""Number of last frames that ``NightView.measured`` covers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LastMeasured:
    """Measurement that the lead track took of one of the last frames."""

    frame_id: int
    t_utc_ns: int
    source: str
    sigma_arcsec: float
    """One sigma along the longer axis of its error ellipse."""
    nis: float | None


def last_measured(
    frames: Iterable[NightFrame], rows: Mapping[int, FrameRow]
) -> tuple[LastMeasured, ...]:
    """Return the measurements of the last ``LAST_FRAMES`` frames, newest first."""
    pairs = ((frame.followed, rows.get(frame.frame_id)) for frame in [*frames][-LAST_FRAMES:])
    found = (
        LastMeasured(
            frame_id=row.frame_id,
            t_utc_ns=taken.t_mid_utc_ns,
            source=taken.source,
            sigma_arcsec=largest_sigma(*taken.cov_sky_arcsec2),
            nis=row.nis,
        )
        for taken, row in pairs
        if taken is not None and row is not None and row.is_followed
    )
    return tuple(sorted(found, key=lambda each: -each.frame_id))


@dataclass(frozen=True, slots=True, kw_only=True)
class Pointing:
    """Direction of the telescope, observed or commanded, at an instant."""

    t_utc_ns: int
    ra_icrs_deg: float
    dec_icrs_deg: float
    is_ordered: bool = False
    """True for the target of a slew from which there is no frame yet."""
    alt_deg: float | None = None
    az_deg: float | None = None
    """Azimuth in degrees; None where the session does not give its site."""


@dataclass(slots=True, kw_only=True)
class NightView:
    """Session at one instant; one given by ``Night.view`` does not change any more."""

    folder: Path | None = None
    title: str = ""
    is_closed: bool = False
    is_simulated: bool = False
    config: Config | None = None
    """Settings of the session's engine; None where they cannot be read."""
    seq: int = 0
    """Place in the log of the last folded record."""
    is_read: bool = False
    """True where the past has been read to its end: further records are news."""
    has_ended: bool = False
    """True where its engine ended as ordered, with the mount at rest."""
    fault: str | None = None
    """Reason why the session cannot be read at this moment; None: it can."""
    tau: float = 0.1
    rows: tuple[FrameRow, ...] = ()
    log: tuple[LogLine, ...] = ()
    """The log lines, oldest first."""
    state: LoopState | None = None
    state_since_utc_ns: int | None = None
    last_utc_ns: int | None = None
    frame: FrameTaken | None = None
    pointing: Pointing | None = None
    track: TrackState | None = None
    """The lead track's state."""
    beside: Mapping[int, TrackState] = field(default_factory=dict)
    """The other tracks of the last frame, by track id."""
    timing: CycleTiming | None = None
    slew: SlewCommand | None = None
    track_frame_id: int = 0
    """Frame in which the last lead track began."""
    track_since_utc_ns: int | None = None
    """Mid-exposure of that frame, UTC nanoseconds."""
    orbit: OrbitEstimate | None = None
    """Orbit of the lead track, or of the last one."""
    orbit_utc_ns: int | None = None
    """Time at which that orbit was found, UTC nanoseconds."""
    orbits: Mapping[int, OrbitEstimate] = field(default_factory=dict)
    """Last orbit of every track, by track id."""
    identified: Identified | None = None
    """Identification of the lead track, or of the last one."""
    identifications: Mapping[int, Identified] = field(default_factory=dict)
    """Last identification of every track, by track id."""
    changed: Mapping[str, float | int | str] = field(default_factory=dict)
    """Settings changed since the session began, by dotted name."""
    measured: tuple[LastMeasured, ...] = ()
    """Measurements that the lead took of the last frames, newest first."""
    tracks: tuple[FollowedTrack, ...] = ()
    """All followed tracks, by their numbers."""
    dropped: tuple[int, ...] = ()
    """Tracks whose dropping may still be undone, the last one last."""
    pairs: tuple[PairMotion, ...] = ()
    """Relative motions of the tracks, as of the last frame."""
    expected: ExpectedMembers | None = None
    """Catalogued objects that should be in the field, as of the last look at the catalogue."""
    being_fitted_again: frozenset[int] = frozenset()
    """Tracks whose orbit is from before the operator's last decision on a frame, by track id."""
    kept_track: TrackState | None = None
    """Lead track as it was ended by a command: it may be followed again; None: there is none."""

    @property
    def last_seen_utc_ns(self) -> int | None:
        """Mid-exposure of the lead's last measurement; None where the record does not say."""
        return next((each.measured_utc_ns for each in self.tracks if each.is_lead), None)

    @property
    def is_in_cloud(self) -> bool:
        """True where the lead coasts, and its miss in the newest frame is attributed to cloud."""
        last = next((row for row in reversed(self.rows) if row.is_reduced), None)
        return self.state == "COAST" and last is not None and last.is_cloudy

    @property
    def is_orbit_past(self) -> bool:
        """True where the orbit is of a track that has ended."""
        orbit = self.orbit
        return orbit is not None and (self.track is None or orbit.track_id != self.track.track_id)

    def setting(self, name: str, changed: Mapping[str, Any] | None = None) -> Any:
        """Return the value of a setting in force; None where it is not on record.

        ``name``: dotted; ``changed``: the settings changed by then, None: by now.
        """
        changed = self.changed if changed is None else changed
        if name in changed:
            return changed[name]
        section, _, key = name.partition(".")
        return getattr(getattr(self.config, section, None), key, None)


@dataclass(frozen=True, slots=True, kw_only=True)
class NightCheckpoint:
    """Night as it was at one place of the log, for ``Night.go_back``.

    Rows, frames and lines are shared with the night and among kept places.
    """

    now: NightView
    tracks: CurrentTracks
    rows: Chunks[FrameRow]
    frames: tuple[Any, ...]
    log: Chunks[LogLine]


def above_horizon(pointing: Pointing, site: Site) -> Pointing:
    """Add altitude and azimuth to a pointing that has none yet."""
    if pointing.alt_deg is not None:
        return pointing
    from rsoconsole.sky import icrs_to_altaz

    alt_deg, az_deg = icrs_to_altaz(
        site, pointing.ra_icrs_deg, pointing.dec_icrs_deg, pointing.t_utc_ns
    )
    return replace(pointing, alt_deg=alt_deg, az_deg=az_deg)


def is_same_name(one: Identified | None, other: Identified) -> bool:
    """Return True if both identifications agree in result, hint and object."""
    if one is None or (one.verdict, bool(one.hint)) != (other.verdict, bool(other.hint)):
        return False
    names = [each.matches[0].norad_id if each.matches else None for each in (one, other)]
    return names[0] == names[1]
