"""Reasons for a miss in a frame: cloud, the Earth's shadow, a refused slew. Pure.

Everything is derived from a session's records, so that a replay finds the same.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.records import (
    Detections,
    FloatArray,
    FrameTaken,
    HiddenBy,
    Missed,
    Site,
    SlewRefusal,
    Solution,
    TrackState,
)
from rsoconsole.sky import (
    GEO_RADIUS_KM,
    cirs_to_gcrs,
    line_of_sight_gcrs,
    lit_fraction,
    separation_deg,
    site_gcrs,
    wrap_360,
)
from rsoconsole.words import NS_PER_S

FEW_STARS = 8
"""Star count below which a field of a degree or more counts as hidden, as by cloud."""
CLOUD_SHARE = 0.5
"""Fraction of the usual star count below which the sky counts as cloudy."""
CLOUD_MAG = 0.7
"""Loss of starlight, mag, from which the sky counts as cloudy; when clear it varies by 0.2."""
KEPT_FRAMES = 60
MIN_FRAMES = 3
SAME_SKY_DEG = 5.0
"""Largest angle for comparing star counts: at the Milky Way's edge they change within 10 deg."""

SIDEREAL_DEG_S = 360.98564736629 / 86_400.0
GEO_RA_RATE_OFF_ARCSEC_S = 2.0
GEO_DEC_RATE_ARCSEC_S = 4.0
"""Rate in declination of a geosynchronous satellite with an inclination of 15 deg."""
DAY_S = 86_400
_STEP_S = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class StarStatistics:
    """Count and median flux of the stars in one frame."""

    count: int
    flux_adu_s: float | None
    """Median flux of the 20th to 60th brightest star, ADU/s; None where there are too few."""
    sensor_px: int = 0
    """Number of unbinned pixels that were read; a part of the sensor shows fewer stars."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StarHistory:
    """Stars of the last solved frames that showed the present part of the sky."""

    frames: tuple[StarStatistics, ...] = ()
    centre_icrs_deg: tuple[float, float] | None = None

    def usual_count(self, sensor_px: int) -> int | None:
        """Return the star count of the clearest frames (90th percentile).

        ``sensor_px``: number of unbinned sensor pixels read in the present frame. The count of a
        frame that read more pixels is scaled down in proportion; that of a smaller frame is not
        scaled up. None with fewer than ``MIN_FRAMES`` frames.
        """
        counts = sorted(
            stars.count
            if stars.sensor_px <= sensor_px
            else round(stars.count * sensor_px / stars.sensor_px)
            for stars in self.frames
        )
        return counts[(len(counts) - 1) * 9 // 10] if len(counts) >= MIN_FRAMES else None

    def usual_flux_adu_s(self, sensor_px: int) -> float | None:
        """Return the star flux, ADU/s, of the clearest frames (90th percentile).

        ``sensor_px``: number of unbinned sensor pixels read in the present frame. Only frames with
        the same number count, because a smaller part of the sensor shows fewer bright stars. None
        with fewer than ``MIN_FRAMES`` of them.
        """
        known = sorted(
            stars.flux_adu_s
            for stars in self.frames
            if stars.flux_adu_s is not None and stars.sensor_px == sensor_px
        )
        return known[(len(known) - 1) * 9 // 10] if len(known) >= MIN_FRAMES else None


def star_statistics(taken: FrameTaken, detections: Detections) -> StarStatistics | None:
    """Return the star statistics of a frame; None without a star count or exposure time."""
    exposure_s = taken.exposure_s
    if detections.star_count is None or exposure_s is None:
        return None
    flux_adu = detections.star_flux_adu
    binning = None if taken.camera is None else taken.camera.binning
    # Pixels of the sensor on each axis of one of the frame's.
    joined = 1 if binning is None else int(binning.split("x")[0])
    return StarStatistics(
        count=detections.star_count,
        flux_adu_s=None if flux_adu is None or exposure_s <= 0.0 else flux_adu / exposure_s,
        sensor_px=taken.width_px * taken.height_px * joined**2,
    )


def updated_star_history(
    before: StarHistory, stars: StarStatistics | None, solution: object
) -> StarHistory:
    """Return the star history with one more frame; unchanged without a solution or star count.

    A frame more than ``SAME_SKY_DEG`` from the last one begins a new history.
    """
    if stars is None or not isinstance(solution, Solution):
        return before
    centre = (solution.ra_icrs_deg, solution.dec_icrs_deg)
    last = before.centre_icrs_deg
    is_same_sky = last is None or separation_deg(*last, *centre) <= SAME_SKY_DEG
    frames = (*(before.frames if is_same_sky else ()), stars)
    return StarHistory(frames=frames[-KEPT_FRAMES:], centre_icrs_deg=centre)


def miss_with_causes(
    plain: Missed,
    *,
    stars: StarStatistics | None,
    stars_before: StarHistory,
    track: TrackState | None,
    site: Site,
    t_utc_ns: int,
    blocked: SlewRefusal | None = None,
) -> Missed:
    """Return the miss ``plain`` with its likely causes added, most certain first.

    ``blocked``: reason why the slew to the track was refused. Without a track, cloud is the only
    possible cause. Where no cause is found, ``hidden_by`` is empty.
    """
    is_refused = blocked is not None and track is not None
    causes = (
        HiddenBy(kind="slew refused", refusal=blocked) if is_refused else None,
        cloud_cause(stars, stars_before),
        None if track is None else eclipse_cause(track, site, t_utc_ns),
    )
    return replace(plain, hidden_by=tuple(cause for cause in causes if cause is not None))


def cloud_cause(stars: StarStatistics | None, before: StarHistory) -> HiddenBy | None:
    """Return cloud as the cause of a miss; None for a clear sky, or without a star count.

    Stars are very few, or far fewer or fainter than in the history ``before`` the frame.
    """
    if stars is None:
        return None
    usual_count = before.usual_count(stars.sensor_px)
    usual_flux = before.usual_flux_adu_s(stars.sensor_px)
    if usual_count is not None and stars.count < CLOUD_SHARE * usual_count:
        return HiddenBy(kind="fewer stars", stars=stars.count, usual_stars=usual_count)
    if usual_flux and stars.flux_adu_s and stars.flux_adu_s > 0.0:
        lost_mag = 2.5 * math.log10(usual_flux / stars.flux_adu_s)
        if lost_mag > CLOUD_MAG:
            return HiddenBy.by_faint_stars(lost_mag)
    if usual_count is None and stars.count < FEW_STARS:
        return HiddenBy(kind="few stars", stars=stars.count)
    return None


def eclipse_cause(track: TrackState, site: Site, t_utc_ns: int) -> HiddenBy | None:
    """Return an eclipse as the cause of a miss, for a geostationary-like track.

    None outside the Earth's shadow, and for any other track.
    """
    if not is_geostationary_like(track):
        return None
    lit = float(lit_fraction(_at_geo_km(direction_at(track, t_utc_ns), site, t_utc_ns), t_utc_ns))
    if lit <= 0.0:
        return HiddenBy(kind="shadow")
    if lit < 1.0:
        return HiddenBy.by_penumbra(lit)
    return None


def is_geostationary_like(track: TrackState) -> bool:
    """True where the object stays above one place on the ground, or nearly so, by its rates."""
    ra_off_arcsec_s = abs(track.x[1] - SIDEREAL_DEG_S) * 3600.0
    dec_arcsec_s = abs(track.x[3]) * 3600.0
    return ra_off_arcsec_s < GEO_RA_RATE_OFF_ARCSEC_S and dec_arcsec_s < GEO_DEC_RATE_ARCSEC_S


def direction_at(track: TrackState, t_utc_ns: int) -> tuple[float, float]:
    """RA and Dec of the track at an instant, at its constant rates, ICRS degrees."""
    dt_s = (t_utc_ns - track.t_utc_ns) / NS_PER_S
    dec_deg = min(max(track.x[2] + track.x[3] * dt_s, -90.0), 90.0)
    return wrap_360(track.x[0] + track.x[1] * dt_s), dec_deg


def next_eclipse_utc_ns(
    direction_icrs_deg: tuple[float, float], site: Site, t_utc_ns: int
) -> int | None:
    """Return the start of a geostationary satellite's next eclipse, UTC ns, to the second.

    The satellite is assumed to stay fixed over the ground. Returns ``t_utc_ns`` where it is in
    eclipse already, None where no eclipse begins within a day.
    """
    start_km = _at_geo_km(direction_icrs_deg, site, t_utc_ns)
    pole = cirs_to_gcrs(t_utc_ns)[:, 2]

    def is_dimmed(since_s: FloatArray) -> FloatArray:
        instants = t_utc_ns + np.rint(since_s * NS_PER_S).astype(np.int64)
        return np.asarray(lit_fraction(_turned(start_km, pole, since_s), instants) < 1.0)

    dimmed = np.flatnonzero(is_dimmed(np.arange(0.0, DAY_S + _STEP_S, _STEP_S)))
    if not dimmed.size:
        return None
    if dimmed[0] == 0:
        return t_utc_ns
    fine_s = np.arange((dimmed[0] - 1.0) * _STEP_S, dimmed[0] * _STEP_S + 1.0)
    return t_utc_ns + round(float(fine_s[np.flatnonzero(is_dimmed(fine_s))[0]])) * NS_PER_S


def _at_geo_km(direction_icrs_deg: tuple[float, float], site: Site, t_utc_ns: int) -> FloatArray:
    """GCRS position (3,) where a line of sight meets the sphere of the geostationary belt."""
    at = np.array([t_utc_ns])
    ra, dec = (np.array([value]) for value in direction_icrs_deg)
    line = line_of_sight_gcrs(ra, dec, at)[0]
    site_km = site_gcrs(site, at)[0][0]
    along = float(line @ site_km)
    range_km = -along + math.sqrt(along**2 + GEO_RADIUS_KM**2 - float(site_km @ site_km))
    return np.asarray(site_km + range_km * line)


def _turned(position_km: FloatArray, pole: FloatArray, since_s: FloatArray) -> FloatArray:
    """Rotate a position (3,) round the pole with the Earth; (N, 3). Source: Rodrigues 1840."""
    angle = np.radians(SIDEREAL_DEG_S * since_s)[:, None]
    along = float(pole @ position_km) * pole
    return np.asarray(
        along + np.cos(angle) * (position_km - along) + np.sin(angle) * np.cross(pole, position_km)
    )
