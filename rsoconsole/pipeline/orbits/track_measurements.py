"""Directions of one object, from a session's track or from a file of observations."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rsoconsole.base import OrbitError, SessionError, parse_json, read_named_file, value_errors_as
from rsoconsole.config import Config, LimitsConfig
from rsoconsole.orbits import MeasuredDirections, merged_tracklets, reduce_directions
from rsoconsole.pipeline.cycle.track_assignment import Track, TrackAssignment
from rsoconsole.records import (
    FrameTaken,
    Measurement,
    Photometry,
    Site,
    StreakLight,
    TrackState,
)
from rsoconsole.session import SessionReader
from rsoconsole.sky import iso_to_utc_ns
from rsoconsole.tracking import (
    Motion,
    append_length_excess,
    expected_motion,
    motion_in_exposure,
    widened_for_short_streak,
)

_BESIDE, _BESIDE_S = 5, 600.0
"""Measurements to either side, and seconds, over which a satellite's rate counts as constant."""


class PartialStreakErrors:
    """Widens the errors of streaks that show only part of the motion during the exposure.

    It keeps the shortfalls in length of the track's earlier streaks.
    """

    def __init__(self) -> None:
        self._excesses: tuple[float, ...] = ()
        self._added_arcsec2: tuple[float, ...] = (0.0, 0.0, 0.0)
        """Addition to the covariance of the last measurement."""

    def with_widened_covariances(
        self,
        fresh: Sequence[Measurement],
        taken: Sequence[Measurement],
        track: TrackState,
        exposures_s: Mapping[int, float],
    ) -> tuple[Measurement, ...]:
        """Return a track's new measurements, with wider covariances for partial streaks.

        Successive partial streaks share an error. ``fresh``: the new measurements, the last of
        ``taken`` (their covariances may differ); ``taken``: all of the track's, in order of time;
        ``track``: its present state; ``exposures_s``: known exposure times by frame number.
        """
        found, first = [], len(taken) - len(fresh)
        for n, each in enumerate(fresh, start=first):
            exposure_s = exposures_s.get(each.frame_id)
            wider = each
            if exposure_s is not None:
                expected = _motion(taken, n, exposure_s) or expected_motion(track, exposure_s)
                wider = widened_for_short_streak(each, expected, self._excesses)
                self._excesses = append_length_excess(self._excesses, each, expected)
            found.append(wider)
            added = np.subtract(wider.cov_sky_arcsec2, each.cov_sky_arcsec2)
            self._added_arcsec2 = tuple(map(float, added))
        return tuple(found)

    def with_last_widening(self, measurement: Measurement) -> Measurement:
        """Return the last measurement with its widening added to the covariance given here."""
        ee, en, nn = np.add(measurement.cov_sky_arcsec2, self._added_arcsec2)
        return replace(measurement, cov_sky_arcsec2=(float(ee), float(en), float(nn)))


def _motion(taken: Sequence[Measurement], n: int, exposure_s: float) -> Motion | None:
    """Motion in one exposure by the measurements beside the n-th; None where there are none.

    The state's own rate is the present one: on an eccentric orbit it was another an hour ago.
    """
    here_ns = taken[n].t_mid_utc_ns
    near = [
        each
        for each in taken[max(n - _BESIDE, 0) : n + _BESIDE + 1]
        if abs(each.t_mid_utc_ns - here_ns) <= _BESIDE_S * 1e9
    ]
    first, last = near[0], near[-1]
    if (last.t_mid_utc_ns - first.t_mid_utc_ns) / 1e9 <= exposure_s:
        return None
    return motion_in_exposure(first, last, exposure_s)


_FEWEST = 3
_SHAPE = 'like {"site": {"lat_deg", "lon_deg", "alt_m"}, "obs": [[time, RA, Dec], ...]}'
ARC_GAP_S = 3 * 3600.0


def directions_from_measurements(site: Site, taken: Sequence[Measurement]) -> MeasuredDirections:
    """Convert measurements to directions for an orbit, as seen from a site.

    Raises ValueError for a measurement that is not a direction.
    """
    return reduce_directions(
        site,
        np.array([each.t_mid_utc_ns for each in taken], np.int64),
        np.array([each.ra_icrs_deg for each in taken]),
        np.array([each.dec_icrs_deg for each in taken]),
        np.array([each.cov_sky_arcsec2 for each in taken]),
    )


class TrackLight(NamedTuple):
    """Apparent magnitude in V of one measurement of a track, not saturated."""

    t_utc_ns: int
    mag: float
    sigma_mag: float
    """One sigma by noise, zero point and the object's unknown colour."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservedTrack:
    """Measured directions of one object, and the session or file that they come from."""

    name: str
    """Name of the file or session, and the number of the track."""
    site: Site
    limits: LimitsConfig | None
    """Limits of the session's telescope; None for a file."""
    seen: MeasuredDirections
    tracks: int = 1
    number: int = 1
    track_id: int | None = None
    """Track id in the session's records; None for a file."""
    lights: tuple[TrackLight, ...] = ()
    """Magnitudes on record, in order of time; () for a file."""
    not_used: tuple[str, ...] = ()
    """Lines of the file, and of the list of stations, that gave no direction: place and why."""


def read_observed_tracks(
    path: Path, *, sigma_arcsec: float = 1.0, track: int | None = None, site: Site | None = None
) -> tuple[ObservedTrack, ...]:
    """Read the tracks of a session, the longest first, or the observations of a file.

    ``track``: number of a session's track, from 1 in order of time; None: all of them.
    ``sigma_arcsec``: for observations that state no sigma; ``site``: for a file that states none.
    Raises SessionError or OrbitError naming the file and its fault.
    """
    if path.is_dir() or path.name == "session.db":
        return _read_session(path if path.is_dir() else path.parent, track)
    return (_read_file(path, sigma_arcsec, site),)


def split_into_arcs(seen: MeasuredDirections) -> tuple[MeasuredDirections, ...]:
    """Split directions into arcs, in order of time, at each gap longer than ``ARC_GAP_S``."""
    starts = np.flatnonzero(np.diff(seen.t_s) > ARC_GAP_S) + 1
    groups = np.split(np.arange(len(seen)), starts)
    return tuple(merged_tracklets([seen.subset(each)])[0] for each in groups)


def longest_arc(seen: MeasuredDirections) -> MeasuredDirections:
    """Return the arc with the most directions."""
    return max(split_into_arcs(seen), key=len)


def _read_session(folder: Path, track: int | None) -> tuple[ObservedTrack, ...]:
    reader = SessionReader(folder)
    config = reader.config()
    known = _tracks(reader)
    tracks = known.tracks
    if not tracks:
        raise SessionError(
            f"{folder} holds no track: nothing was followed in it; name a session that has one"
        )
    if track is not None and not 1 <= track <= len(tracks):
        raise SessionError(f"{folder} has tracks 1 to {len(tracks)}, not {track}")
    found = [
        _of_track(folder.resolve().name, config, number, known)
        for number in range(1, len(tracks) + 1)
        if track in (None, number)
    ]
    return tuple(sorted(found, key=lambda each: -len(each.seen)))


class _Tracks(NamedTuple):
    """Tracks of a session, in order of time, and what is known of their frames."""

    tracks: list[Track]
    exposures_s: dict[int, float]
    """Exposure time by frame number."""
    lights: dict[str, StreakLight]
    """Brightness by measurement id."""


def _of_track(name: str, config: Config, number: int, known: _Tracks) -> ObservedTrack:
    site, count, track = config.site.to_site(), len(known.tracks), known.tracks[number - 1]
    measured = tuple(track.measurements)
    taken = PartialStreakErrors().with_widened_covariances(
        measured, measured, track.last, known.exposures_s
    )
    try:
        seen = directions_from_measurements(site, taken)
    except ValueError as error:
        raise SessionError(
            f"{name}, track {number}: {error}; take another track with --track"
        ) from error
    return ObservedTrack(
        name=name if count == 1 else f"{name}, track {number} of {count}",
        site=site,
        limits=config.limits,
        seen=seen,
        tracks=count,
        number=number,
        track_id=track.track_id,
        lights=tuple(_lights(measured, known.lights)),
    )


def _lights(
    measured: Sequence[Measurement], known: Mapping[str, StreakLight]
) -> Iterator[TrackLight]:
    """Yield the magnitudes in V of what is not saturated."""
    for each in measured:
        light = known.get(each.measurement_id)
        if light is None or light.band != "V" or light.is_saturated:
            continue
        if light.mag is not None and light.sigma_mag is not None:
            yield TrackLight(each.t_mid_utc_ns, light.mag, light.sigma_mag)


def _tracks(reader: SessionReader) -> _Tracks:
    """Return the tracks with enough measurements, else all that have any, in order of time."""
    taken, exposures_s, lights = TrackAssignment(), dict[int, float](), dict[str, StreakLight]()
    for _, _, record in reader.records(kinds=(FrameTaken, Photometry, *TrackAssignment.KINDS)):
        taken.receive(record)
        if isinstance(record, FrameTaken) and record.exposure_s is not None:
            exposures_s[record.frame_id] = record.exposure_s
        elif isinstance(record, Photometry):
            lights.update((each.measurement_id, each) for each in record.streaks)
    found = [each for each in taken.tracks() if each.measurements]
    tracks = [each for each in found if len(each.measurements) >= _FEWEST] or found
    return _Tracks(tracks, exposures_s, lights)


def _read_file(path: Path, sigma_arcsec: float, elsewhere: Site | None) -> ObservedTrack:
    text = read_named_file(path, OrbitError, "name a session's folder or a file of observations")
    try:
        read = parse_json(text)
    except ValueError as error:
        raise OrbitError(f"{path} is not JSON: {error}; it must be {_SHAPE}") from error
    if not isinstance(read, dict):
        raise OrbitError(f"{path} is no file of observations: it must be {_SHAPE}")
    site_read = read.get("site")
    site = elsewhere if site_read is None and elsewhere is not None else _site(site_read, path)
    rows = read.get("obs")
    if not isinstance(rows, list) or not rows:
        raise OrbitError(f"{path} holds no observations: it must be {_SHAPE}")
    parsed: list[tuple[int, float, float, float, float]] = []
    faults: list[str] = []
    for number, row in enumerate(rows, start=1):
        where = f"{path}, observation {number}"
        try:
            values = _row(row, where, sigma_arcsec)
        except OrbitError as error:
            faults.append(str(error))
            continue
        if values in parsed[-1:]:
            faults.append(f"{where}: the same as the one before")
        else:
            parsed.append(values)
    if not parsed:
        raise OrbitError(faults[0])
    t, ra, dec, east, north = (np.array(column) for column in zip(*parsed, strict=True))
    cov = np.stack([east**2, np.zeros_like(east), north**2], axis=-1)
    return ObservedTrack(
        name=path.name,
        site=site,
        limits=None,
        seen=reduce_directions(site, t, ra, dec, cov),
        not_used=tuple(faults),
    )


def _site(table: Any, path: Path) -> Site:
    try:
        return Site(
            latitude_deg=_number(table["lat_deg"], 90.0),
            longitude_deg=_number(table["lon_deg"], 360.0),
            elevation_m=_number(table.get("alt_m", 0.0), 1e5),
        )
    except (TypeError, KeyError, ValueError, AttributeError) as error:
        raise OrbitError(
            f"{path} has no site that can be used: it must be {_SHAPE}; or say it with --site"
        ) from error


def _row(row: Any, where: str, sigma_arcsec: float) -> tuple[int, float, float, float, float]:
    """Return time, RA, Dec and the sigmas east and north, arcsec."""
    if not isinstance(row, list) or not 3 <= len(row) <= 5:
        raise OrbitError(f"{where}: [time, RA, Dec] in degrees is needed, then sigmas in arcsec")
    with value_errors_as(OrbitError, f"{where}: ", (TypeError, ValueError)):
        t_utc_ns = iso_to_utc_ns(row[0])
        ra, dec = _number(row[1], 360.0), _number(row[2], 90.0)
        sigmas = [_number(each, 3600.0) for each in row[3:]] or [sigma_arcsec]
    if min(sigmas) <= 0.0:
        raise OrbitError(f"{where}: a sigma must be above 0")
    return t_utc_ns, ra % 360.0, dec, sigmas[0], sigmas[-1]


def _number(value: Any, largest: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r} is not a number")
    if not (math.isfinite(value) and abs(value) <= largest):
        raise ValueError(f"{value!r} is not within {largest:g} either side of 0")
    return float(value)
