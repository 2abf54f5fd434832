"""Streaks of navigation satellites in a night, and their offsets from the orbits.

A streak is assigned to a satellite where it lies within a few arcsec of the satellite's path and
has the direction and length of its motion; along the path it may be off by up to ten seconds.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from rsoconsole.config import Config
from rsoconsole.night import frames_of
from rsoconsole.orbits import NavigationSatellite
from rsoconsole.pipeline.frame.measurement import frame_timing
from rsoconsole.records import (
    Detection,
    Detections,
    FloatArray,
    FrameTaken,
    Measurement,
    Site,
    measurement_id_of,
)
from rsoconsole.session import SessionReader
from rsoconsole.sky import ARCSEC_RAD, SkyPlaces, direction_to_unit, east_and_north, wrap_180
from rsoconsole.words import NS_PER_S

MAX_LATE_S = 10.0
"""Largest time bias of a shutter, s; beyond it the clock is wrong."""
_ACROSS_SIGMAS, _MIN_ACROSS_ARCSEC = 5.0, 3.0
_LENGTH_SHARE, _LENGTH_ARCSEC = 0.2, 6.0
_SHORTEST_ARCSEC, _MAX_TURNED_DEG = 10.0, 10.0
_MIN_RATE_ARCSEC_S = 1.0
_CHUNK = 4000
_MIN_SIGMA_ARCSEC = 0.03
"""Lowest sigma of a streak's midpoint, once the error of its time is removed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredStreakLight:
    """Middle and length of a streak, measured from its ends and its light together; arcsec.

    ``vision/streaks/streak_middle.py`` measures them.
    """

    offset_arcsec: float
    """Offset of the middle from the measurement's position, towards the streak's second end."""
    sigma_arcsec: float
    length_arcsec: float
    length_sigma_arcsec: float
    ends_sigma_arcsec: float
    """Sigma of the middle from the ends alone, as contained in the measurement's covariance."""


@dataclass(slots=True, kw_only=True)
class Streak:
    """Streak with both ends in the frame; ``match`` sets its satellite, offset and rate."""

    measurement: Measurement
    taken: FrameTaken
    session: int
    """Number of its session among those of a calibration."""
    covariance: FloatArray
    """Covariance, (2, 2) arcsec^2; once the streak is matched, without the error of its time."""
    time_sigma_s: float
    """Timing scatter of the shutter as configured in the streak's session, one sigma."""
    light: MeasuredStreakLight | None = None
    """Middle and length measured from its light; None where they were not measured."""
    satellite: NavigationSatellite | None = None
    offset_arcsec: FloatArray = field(default_factory=lambda: np.zeros(2))
    rate_arcsec_s: FloatArray = field(default_factory=lambda: np.zeros(2))


@dataclass(frozen=True, slots=True, kw_only=True)
class NightStreaks:
    """Streaks of one session."""

    folder: Path
    config: Config
    streaks: list[Streak]
    clock_offset_s: float | None
    is_simulated: bool


def read_streaks(folder: Path, session: int) -> NightStreaks:
    """Read the usable streaks of a session. Raises SessionError.

    Usable are streaks found by the detector (not marked by hand) with both ends in the frame and
    with a time. ``session``: number of the session in the calibration.
    """
    reader = SessionReader(folder)
    config = reader.config()
    about = reader.read_meta()
    offset = about.get("clock_offset_s")
    streaks: dict[str, Streak] = {}
    kinds = (FrameTaken, Detections, Measurement)
    for frame in frames_of(record for _, _, record in reader.records(kinds=kinds)):
        taken = frame.taken
        found = {
            measurement_id_of(frame.frame_id, n): each
            for n, each in enumerate(frame.detected_streaks)
        }
        for each in frame.measurements:
            if taken is not None and _is_whole(each, taken):
                east, both, north = each.cov_sky_arcsec2
                streaks[each.measurement_id] = Streak(
                    measurement=each,
                    taken=taken,
                    session=session,
                    covariance=np.array([[east, both], [both, north]]),
                    time_sigma_s=frame_timing(taken, config.exposure).sigma_s,
                    light=_light_along(each, found.get(each.measurement_id)),
                )
    return NightStreaks(
        folder=Path(folder),
        config=config,
        streaks=list(streaks.values()),
        clock_offset_s=float(offset) if isinstance(offset, int | float) else None,
        is_simulated=about.get("is_simulated") is True,
    )


def _is_whole(measurement: Measurement, taken: FrameTaken) -> bool:
    return (
        measurement.source == "network"
        and not measurement.is_clipped
        and not measurement.is_crossing
        and taken.t_mid_utc_ns is not None
    )


def _along(measurement: Measurement) -> FloatArray | None:
    """Vector (2,) from the streak's first end to its second, arcsec east and north, or None."""
    if measurement.ends_icrs_deg is None:
        return None
    (ra_a, dec_a), (ra_b, dec_b) = measurement.ends_icrs_deg
    cos_dec = math.cos(math.radians(measurement.dec_icrs_deg))
    return np.array([wrap_180(ra_b - ra_a) * cos_dec, dec_b - dec_a]) * 3600.0


def _light_along(
    measurement: Measurement, detection: Detection | None
) -> MeasuredStreakLight | None:
    way = _along(measurement)
    if detection is None or way is None or detection.length_px <= 0.0:
        return None
    offset_px, sigma_px = detection.light_offset_px, detection.light_sigma_px
    length_px, length_sigma_px = detection.light_length_px, detection.light_length_sigma_px
    if offset_px is None or sigma_px is None or length_px is None or length_sigma_px is None:
        return None
    scale = float(np.hypot(*way)) / detection.length_px
    return MeasuredStreakLight(
        offset_arcsec=scale * offset_px,
        sigma_arcsec=scale * sigma_px,
        length_arcsec=scale * length_px,
        length_sigma_arcsec=scale * length_sigma_px,
        ends_sigma_arcsec=scale * detection.sigma_along_px,
    )


def _ahead(streak: Streak) -> FloatArray:
    """Return the unit vector (2,) along the streak, towards the second of its ends."""
    way = _along(streak.measurement)
    assert way is not None
    return np.asarray(way / np.hypot(*way))


def _without_time(streak: Streak) -> FloatArray:
    """Measurement's covariance, (2, 2) arcsec^2, without the part that its time error added.

    Along the streak it is the light's, where that is known.
    """
    late = streak.rate_arcsec_s * streak.time_sigma_s
    own = streak.covariance - np.outer(late, late)
    if streak.light is not None:
        ahead, light = _ahead(streak), streak.light
        own = own + (light.sigma_arcsec**2 - light.ends_sigma_arcsec**2) * np.outer(ahead, ahead)
    values, vectors = np.linalg.eigh(own)
    values = np.maximum(values, _MIN_SIGMA_ARCSEC**2)
    return np.asarray((vectors * values) @ vectors.T)


def _shift(streak: Streak) -> FloatArray:
    """Offset (2,) in arcsec from the measurement's place to the midpoint by its light."""
    if streak.light is None:
        return np.zeros(2)
    return np.asarray(streak.light.offset_arcsec * _ahead(streak))


def length_and_sigma_arcsec(streak: Streak) -> tuple[float, float]:
    """Length of a streak and its sigma, arcsec; NaN where the ends are not known."""
    if streak.light is not None:
        return streak.light.length_arcsec, streak.light.length_sigma_arcsec
    way = _along(streak.measurement)
    if way is None:
        return math.nan, math.nan
    # Of two ends: the length is off by their difference, the middle by half their sum.
    ahead = _ahead(streak)
    return float(np.hypot(*way)), 2.0 * math.sqrt(float(ahead @ streak.covariance @ ahead))


def header_mid_utc_ns(streak: Streak) -> int:
    """Mid-exposure by the header (UTC ns), without any correction for the shutter."""
    return streak.taken.t_mid_utc_ns or 0


def match_satellites(
    streaks: Sequence[Streak], site: Site, satellites: Sequence[NavigationSatellite]
) -> None:
    """Set satellite, offset and rate of each streak that lies on a navigation satellite's path."""
    best = [math.inf] * len(streaks)
    for start in range(0, len(streaks), _CHUNK):
        some = streaks[start : start + _CHUNK]
        t = np.array([header_mid_utc_ns(streak) for streak in some], np.int64)
        ra = np.array([streak.measurement.ra_icrs_deg for streak in some])
        dec = np.array([streak.measurement.dec_icrs_deg for streak in some])
        towards = direction_to_unit(ra, dec)
        for satellite in satellites:
            near = _near(satellite, t, towards)
            if not len(near):
                continue
            places = satellite.places(site, t[near])
            offset, rate = _offsets(places, ra[near], dec[near])
            sigma = satellite.sigma_km / places.range_km / ARCSEC_RAD
            for k, number in enumerate(near):
                across = _fits(some[number], offset[k], rate[k], float(sigma[k]))
                if across is not None and across < best[start + number]:
                    best[start + number] = across
                    some[number].satellite = satellite
                    some[number].offset_arcsec, some[number].rate_arcsec_s = offset[k], rate[k]
    for streak in streaks:
        if streak.satellite is not None:
            streak.covariance = _without_time(streak)
            streak.offset_arcsec = streak.offset_arcsec + _shift(streak)


_NEAR_COS = math.cos(math.radians(1.0))
_PARALLAX_RAD = 0.3
"""Widest angle between the directions from a site and from the Earth's centre: at 20,000 km."""


def _near(
    satellite: NavigationSatellite, t: npt.NDArray[np.int64], towards: FloatArray
) -> npt.NDArray[np.int64]:
    """Indices of the instants when the satellite is roughly there, seen from the Earth's centre."""
    r, _ = satellite.position_gcrs(t)
    with np.errstate(invalid="ignore"):
        cos = np.sum(r * towards, axis=1) / np.linalg.norm(r, axis=1)
        return np.flatnonzero(cos > math.cos(_PARALLAX_RAD))


def _offsets(places: SkyPlaces, ra: FloatArray, dec: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return measured minus predicted, (N, 2) arcsec, and the rate, (N, 2): both east and north."""
    cos_dec = np.cos(np.radians(places.dec_icrs_deg))
    line, measured = (
        direction_to_unit(places.ra_icrs_deg, places.dec_icrs_deg),
        direction_to_unit(ra, dec),
    )
    east, north = east_and_north(places.ra_icrs_deg, places.dec_icrs_deg)
    ahead = np.sum(line * measured, axis=-1)
    depth = np.where(ahead > _NEAR_COS, ahead, np.nan)
    off = np.stack([np.sum(east * measured, -1), np.sum(north * measured, -1)], -1) / depth[:, None]
    rate = np.stack([places.ra_rate_deg_s * cos_dec, places.dec_rate_deg_s], axis=-1) * 3600.0
    return np.asarray(off / ARCSEC_RAD), np.asarray(rate)


def _fits(
    streak: Streak, offset: FloatArray, rate: FloatArray, sigma_arcsec: float
) -> float | None:
    """Distance across the satellite's path, arcsec; None where the streak is another's."""
    speed = float(np.hypot(*rate))
    if not np.all(np.isfinite(offset)) or not speed > _MIN_RATE_ARCSEC_S:
        return None
    ahead = rate / speed
    aside = np.array([-ahead[1], ahead[0]])
    across = abs(float(offset @ aside))
    allowed = _ACROSS_SIGMAS * math.hypot(
        math.sqrt(float(aside @ streak.covariance @ aside)), sigma_arcsec
    )
    if across > max(allowed, _MIN_ACROSS_ARCSEC):
        return None
    if abs(float(offset @ ahead)) > (MAX_LATE_S * speed + _ACROSS_SIGMAS * sigma_arcsec):
        return None
    return across if _has_shape_of(streak, speed, aside) else None


def _has_shape_of(streak: Streak, speed: float, aside: FloatArray) -> bool:
    """True where direction and length of the streak fit; always where its ends are not known."""
    way, expected = _along(streak.measurement), speed * (streak.taken.exposure_s or 0.0)
    if way is None:
        return True
    length = float(np.hypot(*way))
    if abs(length - expected) > max(_LENGTH_SHARE * expected, _LENGTH_ARCSEC):
        return False
    turned = abs(float(way @ aside)) / max(length, _SHORTEST_ARCSEC)
    return length <= _SHORTEST_ARCSEC or turned <= math.sin(math.radians(_MAX_TURNED_DEG))


def satellite_label(streak: Streak) -> str:
    """Label of the streak's satellite, unique within a file of orbits."""
    assert streak.satellite is not None
    return f"{streak.satellite.name} {streak.satellite.norad_id or ''}"


def recompute_offsets(streaks: Sequence[Streak], site: Site, late_s: FloatArray) -> None:
    """Recompute offset and rate of the streaks of one satellite for later instants.

    ``late_s``: seconds (N,) from the header's mid-exposure to the later instant of each streak.
    """
    satellite = streaks[0].satellite
    assert satellite is not None
    t = np.array([header_mid_utc_ns(s) for s in streaks], np.int64)
    t = t + np.rint(late_s * NS_PER_S).astype(np.int64)
    places = satellite.places(site, t)
    ra = np.array([s.measurement.ra_icrs_deg for s in streaks])
    dec = np.array([s.measurement.dec_icrs_deg for s in streaks])
    offset, rate = _offsets(places, ra, dec)
    for k, streak in enumerate(streaks):
        streak.offset_arcsec, streak.rate_arcsec_s = offset[k] + _shift(streak), rate[k]
