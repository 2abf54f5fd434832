"""What a night's fold knows at one instant, to be shown."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from rsoconsole.config import Config
from rsoconsole.night.frame import FrameRow, NightFrame
from rsoconsole.night.log_lines import LogLine
from rsoconsole.night.track_fold import FollowedTrack, TracksNow
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
"""The items, in order, in chunks of one size."""
CHUNK = 256


def in_chunks(items: Sequence[Item], before: Chunks[Item]) -> Chunks[Item]:
    """The items in chunks, those of ``before`` where they are the same."""
    chunks = []
    for number, start in enumerate(range(0, len(items), CHUNK)):
        chunk = tuple(items[start : start + CHUNK])
        is_as_before = number < len(before) and before[number] == chunk
        chunks.append(before[number] if is_as_before else chunk)
    return tuple(chunks)


LOOKED_AT = 8
"""The last frames, of which this is told."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LastMeasured:
    """What the track took of one of the last frames."""

    frame_id: int
    t_utc_ns: int
    source: str
    sigma_arcsec: float
    """One sigma where it is known worst."""
    nis: float | None


def last_measured(
    frames: Iterable[NightFrame], rows: Mapping[int, FrameRow]
) -> tuple[LastMeasured, ...]:
    """Newest first, of the last eight frames."""
    found: list[LastMeasured] = []
    for frame in [*frames][-LOOKED_AT:]:
        taken, row = frame.followed, rows.get(frame.frame_id)
        if taken is None or row is None or not row.is_followed:
            continue
        found.append(
            LastMeasured(
                frame_id=frame.frame_id,
                t_utc_ns=taken.t_mid_utc_ns,
                source=taken.source,
                sigma_arcsec=largest_sigma(*taken.cov_sky_arcsec2),
                nis=row.nis,
            )
        )
    return tuple(sorted(found, key=lambda each: -each.frame_id))


@dataclass(frozen=True, slots=True, kw_only=True)
class Pointing:
    """Where the telescope looked, or was sent, at an instant."""

    t_utc_ns: int
    ra_icrs_deg: float
    dec_icrs_deg: float
    is_ordered: bool = False
    """True for a slew of which no frame has been seen yet."""
    alt_deg: float | None = None
    az_deg: float | None = None
    """None where the session does not say its site."""


@dataclass(slots=True, kw_only=True)
class NightView:
    """A session at one instant; what ``Night.view`` gives of it changes no more."""

    folder: Path | None = None
    title: str = ""
    is_closed: bool = False
    is_simulated: bool = False
    config: Config | None = None
    """Of the session's engine; None where it cannot be read."""
    seq: int = 0
    """Place in the log of the last record that has been taken."""
    is_read: bool = False
    """Whether the past has been read to its end: what comes now is news."""
    has_ended: bool = False
    """Its engine has ended as it was asked to, and the mount stood."""
    fault: str | None = None
    """Why the session cannot be read at this moment."""
    tau: float = 0.1
    rows: tuple[FrameRow, ...] = ()
    log: tuple[LogLine, ...] = ()
    """Oldest first."""
    state: LoopState | None = None
    state_since_utc_ns: int | None = None
    last_utc_ns: int | None = None
    frame: FrameTaken | None = None
    pointing: Pointing | None = None
    track: TrackState | None = None
    """The lead."""
    beside: Mapping[int, TrackState] = field(default_factory=dict)
    """The other tracks of the last frame, by track id."""
    timing: CycleTiming | None = None
    slew: SlewCommand | None = None
    track_frame_id: int = 0
    """In which the last lead began."""
    track_since_utc_ns: int | None = None
    """When that was."""
    orbit: OrbitEstimate | None = None
    """Of the lead, or of what was the lead last."""
    orbit_utc_ns: int | None = None
    """When that was found."""
    orbits: Mapping[int, OrbitEstimate] = field(default_factory=dict)
    """The last one of every track, by track id."""
    identified: Identified | None = None
    """Of the lead, or of what was the lead last."""
    identifications: Mapping[int, Identified] = field(default_factory=dict)
    """The last one of every track, by track id."""
    changed: Mapping[str, float | int | str] = field(default_factory=dict)
    """Settings that have been changed since the session began, by dotted name."""
    measured: tuple[LastMeasured, ...] = ()
    """What the track took of the last frames, newest first."""
    tracks: tuple[FollowedTrack, ...] = ()
    """All that are followed, by their numbers."""
    dropped: tuple[int, ...] = ()
    """Tracks whose dropping may still be undone, the last one last."""
    pairs: tuple[PairMotion, ...] = ()
    """How they move to each other, as of the last frame."""
    expected: ExpectedMembers | None = None
    """Who should be in the field beside them, as of the last look at the catalogue."""

    being_fitted_again: frozenset[int] = frozenset()
    """Tracks whose orbit is from before the operator's last word on a frame, by track id."""

    kept_track: TrackState | None = None
    """What was followed until somebody ended it, as it was then: it may be followed again."""

    @property
    def last_seen_utc_ns(self) -> int | None:
        """When the lead was measured last, mid-exposure; None where the record does not say."""
        return next((each.measured_utc_ns for each in self.tracks if each.is_lead), None)

    @property
    def is_in_cloud(self) -> bool:
        """Whether the lead's last miss, in the newest frame that is known, is put down to cloud."""
        last = next((row for row in reversed(self.rows) if row.is_reduced), None)
        return self.state == "COAST" and last is not None and last.is_cloudy

    @property
    def is_orbit_past(self) -> bool:
        """Whether the orbit is of something that is followed no more."""
        orbit = self.orbit
        return orbit is not None and (self.track is None or orbit.track_id != self.track.track_id)

    def setting(self, name: str, changed: Mapping[str, Any] | None = None) -> Any:
        """What a setting is now; None where the session does not say.

        ``changed``: as it was when these had been changed.
        """
        changed = self.changed if changed is None else changed
        if name in changed:
            return changed[name]
        section, _, key = name.partition(".")
        return getattr(getattr(self.config, section, None), key, None)


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptNight:
    """A night as it was at one place of the log: what ``Night.go_back`` returns to.

    Rows, frames and lines are shared with the night and among those that are kept.
    """

    now: NightView
    tracks: TracksNow
    rows: Chunks[FrameRow]
    frames: tuple[Any, ...]
    log: Chunks[LogLine]


def above_horizon(pointing: Pointing, site: Site) -> Pointing:
    """The same with altitude and azimuth, where it has none yet."""
    if pointing.alt_deg is not None:
        return pointing
    from rsoconsole.sky import icrs_to_altaz

    alt_deg, az_deg = icrs_to_altaz(
        site, pointing.ra_icrs_deg, pointing.dec_icrs_deg, pointing.t_utc_ns
    )
    return replace(pointing, alt_deg=alt_deg, az_deg=az_deg)


def is_same_name(one: Identified | None, other: Identified) -> bool:
    """Whether two identifications come to the same: the second is no news."""
    if one is None or (one.verdict, bool(one.hint)) != (other.verdict, bool(other.hint)):
        return False
    names = [each.matches[0].norad_id if each.matches else None for each in (one, other)]
    return names[0] == names[1]
