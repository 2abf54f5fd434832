"""A night at one instant, as screens show it, and a checkpoint to return to."""

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
"""Items in order, cut into chunks of ``CHUNK`` items."""
CHUNK = 256
"""Number of items in a chunk; checkpoints of a night share chunks that are equal."""


def in_chunks(items: Sequence[Item], before: Chunks[Item]) -> Chunks[Item]:
    """Cut items into chunks, reusing the chunk objects of ``before`` that are equal."""
    chunks = []
    for number, start in enumerate(range(0, len(items), CHUNK)):
        chunk = tuple(items[start : start + CHUNK])
        is_as_before = number < len(before) and before[number] == chunk
        chunks.append(before[number] if is_as_before else chunk)
    return tuple(chunks)


LAST_FRAMES = 8
"""Number of last frames that ``NightView.measured`` covers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecentMeasurement:
    """A measurement that the lead track took in one of the last frames."""

    frame_id: int
    t_utc_ns: int
    source: str
    sigma_arcsec: float
    """One sigma along the longer axis of the measurement's error ellipse."""
    nis: float | None


def recent_measurements(
    frames: Iterable[NightFrame], rows: Mapping[int, FrameRow]
) -> tuple[RecentMeasurement, ...]:
    """Return the lead's measurements in the last ``LAST_FRAMES`` frames, newest first.

    ``rows``: the frames' values for the plots, by frame number.
    """
    pairs = (
        (frame.accepted_measurement, rows.get(frame.frame_id)) for frame in [*frames][-LAST_FRAMES:]
    )
    found = (
        RecentMeasurement(
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
    """True for the target of a slew after which no frame has come yet."""
    alt_deg: float | None = None
    az_deg: float | None = None
    """Azimuth in degrees; None where the session does not give its site."""


@dataclass(slots=True, kw_only=True)
class NightView:
    """View of a session at one instant; unchanged once ``Night.view`` has returned it."""

    folder: Path | None = None
    title: str = ""
    is_closed: bool = False
    is_simulated: bool = False
    config: Config | None = None
    """Settings of the session's engine; None where they cannot be read."""
    seq: int = 0
    is_read: bool = False
    """True where the session's past has been read to its end: further records are news."""
    has_ended: bool = False
    """True where the engine ended as ordered, with the mount at rest."""
    fault: str | None = None
    """Reason why the session cannot be read at this moment; None: it can be read."""
    tau: float = 0.1
    rows: tuple[FrameRow, ...] = ()
    log: tuple[LogLine, ...] = ()
    state: LoopState | None = None
    state_since_utc_ns: int | None = None
    last_utc_ns: int | None = None
    frame: FrameTaken | None = None
    pointing: Pointing | None = None
    track: TrackState | None = None
    """The lead track's last state; None without a lead."""
    beside: Mapping[int, TrackState] = field(default_factory=dict)
    """States of the tracks other than the lead in the last frame, by track id."""
    timing: CycleTiming | None = None
    slew: SlewCommand | None = None
    track_frame_id: int = 0
    """Number of the frame in which the last lead track began."""
    track_since_utc_ns: int | None = None
    """Mid-exposure of ``track_frame_id``, UTC nanoseconds."""
    orbit: OrbitEstimate | None = None
    """Last orbit of the lead track, or of the last lead where there is none now."""
    orbit_utc_ns: int | None = None
    """Time at which ``orbit`` was found, UTC nanoseconds."""
    orbits: Mapping[int, OrbitEstimate] = field(default_factory=dict)
    identified: Identified | None = None
    """Last identification of the lead track, or of the last lead where there is none now."""
    identifications: Mapping[int, Identified] = field(default_factory=dict)
    changed: Mapping[str, float | int | str] = field(default_factory=dict)
    measured: tuple[RecentMeasurement, ...] = ()
    tracks: tuple[FollowedTrack, ...] = ()
    dropped: tuple[int, ...] = ()
    pairs: tuple[PairMotion, ...] = ()
    expected: ExpectedMembers | None = None
    """Catalogued objects that should be in the field, by the last comparison with the catalogue."""
    being_fitted_again: frozenset[int] = frozenset()
    """Ids of tracks whose orbit does not yet include the operator's last decision on a frame."""
    kept_track: TrackState | None = None
    """Lead track that a command ended and a command may resume; None: there is no such track."""

    @property
    def last_measured_utc_ns(self) -> int | None:
        """Mid-exposure of the lead's last measurement, UTC nanoseconds; None: none is on record."""
        return next((each.measured_utc_ns for each in self.tracks if each.is_lead), None)

    @property
    def is_in_cloud(self) -> bool:
        """True where the lead coasts and its miss in the newest frame is attributed to cloud."""
        last = next((row for row in reversed(self.rows) if row.is_reduced), None)
        return self.state == "COAST" and last is not None and last.is_cloudy

    @property
    def is_orbit_of_past_lead(self) -> bool:
        """True where ``orbit`` is of a track that no longer leads."""
        orbit = self.orbit
        return orbit is not None and (self.track is None or orbit.track_id != self.track.track_id)

    def setting(self, name: str, changed: Mapping[str, Any] | None = None) -> Any:
        """Return the value of a setting, by its dotted name; None where it is not on record.

        ``changed``: changed settings of the instant of interest; None: those in force now.
        """
        changed = self.changed if changed is None else changed
        if name in changed:
            return changed[name]
        section, _, key = name.partition(".")
        return getattr(getattr(self.config, section, None), key, None)


@dataclass(frozen=True, slots=True, kw_only=True)
class NightCheckpoint:
    """Checkpoint of a night at one place in its log.

    Rows, frames and log lines are shared with the night and with other checkpoints.
    """

    now: NightView
    tracks: CurrentTracks
    rows: Chunks[FrameRow]
    frames: tuple[Any, ...]
    log: Chunks[LogLine]


def with_altaz(pointing: Pointing, site: Site) -> Pointing:
    """Return a pointing with its altitude and azimuth at a site added, if it has none yet."""
    if pointing.alt_deg is not None:
        return pointing
    from rsoconsole.sky import icrs_to_altaz

    alt_deg, az_deg = icrs_to_altaz(
        site, pointing.ra_icrs_deg, pointing.dec_icrs_deg, pointing.t_utc_ns
    )
    return replace(pointing, alt_deg=alt_deg, az_deg=az_deg)


def is_same_identification(one: Identified | None, other: Identified) -> bool:
    """Return True if both identifications agree in result, hint and object."""
    if one is None or (one.verdict, bool(one.hint)) != (other.verdict, bool(other.hint)):
        return False
    names = [each.matches[0].norad_id if each.matches else None for each in (one, other)]
    return names[0] == names[1]
