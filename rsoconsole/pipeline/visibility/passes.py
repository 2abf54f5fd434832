"""Passes of catalogued objects over a site in a night. Pure.

Objects are computed once a minute. Between two minutes their path is the cubic through both places
and velocities, which is good to a metre for the lowest orbit.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from sgp4.api import SatrecArray

from rsoconsole.config import LimitsConfig
from rsoconsole.orbits import (
    ASSUMED,
    CatalogueEntry,
    ElementErrors,
    nearest_epoch_entries,
    orbit_regime,
    position_sigmas_km,
    states_gcrs,
)
from rsoconsole.pipeline.visibility.lost_objects import LostObject, lost_objects
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import (
    EARTH_RADIUS_KM,
    LIT_SHARE,
    IntArray,
    horizon_altitude_deg,
    jd_utc,
    lit_fraction,
    lit_fraction_for_sun,
    phase_angle_deg,
    separation_deg,
    site_gcrs,
    sun_gcrs_km,
    teme_to_gcrs_rotation,
    unit_to_direction,
    zenith_gcrs,
)
from rsoconsole.words import NS_PER_DAY, NS_PER_S

Axes = tuple[FloatArray, FloatArray, FloatArray]
"""Up, north and east at a site, as (N, 3) unit vectors along GCRS axes at N instants."""


class TopocentricPlaces:
    """Places of M objects at N instants as seen from a site; geometric, without refraction."""

    def __init__(
        self,
        entries: Sequence[CatalogueEntry],
        site: Site,
        t_utc_ns: IntArray,
        limits: LimitsConfig,
    ) -> None:
        self.r_km, _ = states_gcrs(entries, t_utc_ns)
        """Position, (M, N, 3), GCRS."""
        self.line_km = self.r_km - site_gcrs(site, t_utc_ns)[0]
        """Line from the site, (M, N, 3)."""
        self.alt_deg, az_deg = altitudes_and_azimuths(self.line_km, site_axes(site, t_utc_ns))
        """Altitude, (M, N); NaN where an object has no place, as is the azimuth."""
        self.az_deg = az_deg
        self.margin_deg = margin_deg(self.alt_deg, az_deg, limits)
        """Altitude above the limit, (M, N); far below it where an object has no place."""


def site_axes(site: Site, t_utc_ns: IntArray) -> Axes:
    """Return unit vectors up, north and east at a site, along GCRS axes; north is horizontal."""
    site_km = site_gcrs(site, t_utc_ns)[0]
    up = zenith_gcrs(site, t_utc_ns)
    toward_deg = 0.01 if site.latitude_deg < 89.0 else -0.01
    moved = replace(site, latitude_deg=site.latitude_deg + toward_deg)
    north = unit_vectors((site_gcrs(moved, t_utc_ns)[0] - site_km) / toward_deg)
    return up, north, np.cross(north, up)


def altitudes_and_azimuths(line_km: FloatArray, axes: Axes) -> tuple[FloatArray, FloatArray]:
    """Return altitudes and azimuths, (...,) deg, of lines from a site, (..., 3).

    ``axes``: up, north and east of the site, (..., 3) each.
    """
    line = unit_vectors(line_km)
    up, north, east = (np.sum(line * axis, axis=-1) for axis in axes)
    alt_deg = np.degrees(np.arcsin(np.clip(up, -1.0, 1.0)))
    return np.asarray(alt_deg), np.asarray(np.degrees(np.arctan2(east, north)) % 360.0)


def margin_deg(alt_deg: FloatArray, az_deg: FloatArray, limits: LimitsConfig) -> FloatArray:
    """Return the altitude above the limit, degrees; negative below, -90 where it is NaN.

    The limit is the higher of altitude limit and horizon mask.
    """
    lowest_deg = np.full(np.shape(alt_deg), limits.min_altitude_deg)
    if limits.horizon:
        lowest_deg = np.maximum(lowest_deg, horizon_altitude_deg(limits.horizon, az_deg))
    return np.where(np.isfinite(alt_deg), alt_deg - lowest_deg, -90.0)


def unit_vectors(vectors: FloatArray) -> FloatArray:
    """Return vectors (..., 3) scaled to unit length."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


STEP_S = 60
LOW_REVOLUTIONS = 9.0
"""Revolutions a day from which an orbit counts as low."""
_OBJECTS_AT_ONCE = 400
_NEAR_LIMIT_DEG, _NEARER = 4.0, 0.5
"""Margin below the altitude limit, deg, and share of the limit added to it, that count as near."""
_PARTS = 60
"""Number of parts of the time between two instants."""
_FLATTENING_KM = 22.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PassPoint:
    """Place of an object at one instant of its pass."""

    t_utc_ns: int
    alt_deg: float
    """Altitude, geometric, without refraction."""
    az_deg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class NightPass:
    """Pass of an object above the limit, as far as it lies in the span asked for."""

    norad_id: int
    name: str
    rise: PassPoint
    top: PassPoint
    set: PassPoint
    lit_from_utc_ns: int | None
    """Begin of the sunlit part, to a minute; None: no part of the pass is sunlit."""
    lit_until_utc_ns: int | None
    is_lit: bool
    """True where the Sun shines on it at the top of the pass."""
    phase_deg: float
    """Angle at the object between Sun and site at the top of the pass."""
    range_km: float
    """Distance at the top of the pass."""
    rate_arcsec_s: float
    """Angular rate against the stars at the top of the pass."""
    tle_age_days: float
    sigma_s: float
    """Sigma of the object's time along its orbit by the elements' age, without a manoeuvre."""


def night_passes(
    entries: Sequence[CatalogueEntry],
    site: Site,
    span_utc_ns: tuple[int, int],
    limits: LimitsConfig,
    *,
    is_low_only: bool = True,
    errors: ElementErrors = ASSUMED,
) -> Iterator[tuple[int, tuple[NightPass, ...], tuple[LostObject, ...]]]:
    """Yield (number of objects computed so far, new passes, objects without places), in parts.

    ``span_utc_ns``: (start, end) within which passes are searched. ``is_low_only``: True for low
    orbits only; else an object that never sets has one pass, the whole span. The element set
    nearest in epoch is used. Objects for which SGP4 has no place in a part of the span
    (decayed, old elements) have the passes of the rest.
    """
    nearest = nearest_epoch_entries(entries, span_utc_ns[0])
    looked_at = [e for e in nearest if _may_rise(e, site, limits, is_low_only=is_low_only)]
    looks = _Looks(site, span_utc_ns)
    done = len(nearest) - len(looked_at)
    for start in range(0, len(looked_at), _OBJECTS_AT_ONCE):
        some = looked_at[start : start + _OBJECTS_AT_ONCE]
        lost: list[LostObject] = []
        found = [
            each
            for entry, path in looks.near_the_limit(some, limits, lost)
            if (each := _pass(entry, path, span_utc_ns, limits, errors)) is not None
        ]
        done += len(some)
        yield done, tuple(sorted(found, key=lambda each: each.rise.t_utc_ns)), tuple(lost)
    if not looked_at:
        yield done, (), ()


def _may_rise(
    entry: CatalogueEntry, site: Site, limits: LimitsConfig, *, is_low_only: bool
) -> bool:
    """True where its orbit ever comes above the limit, as seen from that latitude."""
    if is_low_only and entry.revolutions_a_day < LOW_REVOLUTIONS:
        return False
    highest_km = entry.record.alta * entry.record.radiusearthkm + EARTH_RADIUS_KM + _FLATTENING_KM
    if not highest_km > EARTH_RADIUS_KM:
        return True  # SGP4 says why it has no place
    low_rad = np.radians(limits.min_altitude_deg)
    reach_rad = (
        np.arccos(np.cos(low_rad) * (EARTH_RADIUS_KM - _FLATTENING_KM) / highest_km) - low_rad
    )
    tilt_deg = float(np.degrees(entry.record.inclo))
    northmost_deg = min(tilt_deg, 180.0 - tilt_deg)
    return abs(site.latitude_deg) <= northmost_deg + float(np.degrees(reach_rad)) + 1.0


class _Looks:
    """Site at each instant, of which one lies before the span and one after it."""

    def __init__(self, site: Site, span_utc_ns: tuple[int, int]) -> None:
        self._span = span_utc_ns
        step_ns = STEP_S * NS_PER_S
        t = np.arange(span_utc_ns[0] - step_ns, span_utc_ns[1] + 2 * step_ns, step_ns)
        self.t_utc_ns = t
        self.site_km, self.site_km_s = site_gcrs(site, t)
        self.axes = site_axes(site, t)
        self.sun_km = sun_gcrs_km(t)
        self.to_gcrs = teme_to_gcrs_rotation(t)
        """Rotation from TEME, SGP4's frame, (N, 3, 3)."""

    def near_the_limit(
        self, entries: Sequence[CatalogueEntry], limits: LimitsConfig, lost: list[LostObject]
    ) -> Iterator[tuple[CatalogueEntry, "_Path"]]:
        """Yield each object with each run of instants at which it is not far below the limit.

        Objects without a place at some instant of the span are appended to ``lost``.
        """
        jd_1, jd_2 = jd_utc(self.t_utc_ns)
        failed, r_teme, v_teme = SatrecArray([each.record for each in entries]).sgp4(
            np.ascontiguousarray(jd_1), np.ascontiguousarray(jd_2)
        )
        lost += lost_objects(entries, failed, self.t_utc_ns, self._span)
        # The site is turned towards the objects' axes: there are far more of those.
        up, site_km = (
            np.einsum("nji,nj->ni", self.to_gcrs, each) for each in (self.axes[0], self.site_km)
        )
        line = r_teme - site_km
        high = np.einsum("mni,ni->mn", line, up)
        limit_deg = limits.min_altitude_deg
        lowest = np.sin(np.radians((1.0 - _NEARER) * limit_deg - _NEAR_LIMIT_DEG))
        is_near = (high > lowest * np.sqrt(np.einsum("mni,mni->mn", line, line))) & (failed == 0)
        for n in np.flatnonzero(is_near.any(axis=1)):
            edges = np.flatnonzero(np.diff(np.concatenate([[False], is_near[n], [False]])))
            for first, last in zip(edges[::2], edges[1::2], strict=True):
                run = slice(max(first - 1, 0), min(last + 1, len(self.t_utc_ns)))
                if np.all(failed[n, run] == 0) and run.stop - run.start > 1:
                    yield entries[int(n)], self._path(r_teme[n, run], v_teme[n, run], run)

    def _path(self, r_teme: FloatArray, v_teme: FloatArray, run: slice) -> "_Path":
        r_km, v_km_s = (
            np.einsum("nij,nj->ni", self.to_gcrs[run], each) for each in (r_teme, v_teme)
        )
        return _Path(
            t_utc_ns=self.t_utc_ns[run],
            r_km=r_km,
            line_km=r_km - self.site_km[run],
            line_km_s=v_km_s - self.site_km_s[run],
            axes=(self.axes[0][run], self.axes[1][run], self.axes[2][run]),
            sun_km=self.sun_km[run],
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Path:
    """Path of one object at L instants, and anywhere between them."""

    t_utc_ns: IntArray
    """Instants, (L,)."""
    r_km: FloatArray
    line_km: FloatArray
    line_km_s: FloatArray
    axes: Axes
    sun_km: FloatArray

    def fine(self) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        """Return instants, lines from the site (km), altitudes and azimuths, a second apart."""
        u = (np.arange(_PARTS) / _PARTS)[:, None]
        a, b = self.line_km[:-1, None], self.line_km[1:, None]
        slope_a, slope_b = (
            STEP_S * each[:, None] for each in (self.line_km_s[:-1], self.line_km_s[1:])
        )
        line = (
            (1.0 + 2.0 * u) * (1.0 - u) ** 2 * a
            + u * (1.0 - u) ** 2 * slope_a
            + u * u * (3.0 - 2.0 * u) * b
            + u * u * (u - 1.0) * slope_b
        ).reshape(-1, 3)
        up, north, east = (
            ((1.0 - u) * each[:-1, None] + u * each[1:, None]).reshape(-1, 3) for each in self.axes
        )
        alt_deg, az_deg = altitudes_and_azimuths(line, (up, north, east))
        step_ns = STEP_S * NS_PER_S // _PARTS
        t = self.t_utc_ns[:-1, None] + np.arange(_PARTS) * step_ns
        return t.ravel(), line, alt_deg, az_deg

    def light(self, n: int, t_utc_ns: int, line_km: FloatArray) -> tuple[bool, float]:
        """Return whether it is lit, and its phase angle (deg), at the n-th of the fine instants."""
        first, share = divmod(n, _PARTS)
        # In a minute the site leaves its chord by 15 m.
        before, after = (self.r_km[k] - self.line_km[k] for k in (first, first + 1))
        site_km = before + share / _PARTS * (after - before)
        r_km = site_km + line_km
        is_lit = bool(lit_fraction_for_sun(self.sun_km[first], r_km) >= LIT_SHARE)
        return is_lit, float(phase_angle_deg(r_km, site_km, t_utc_ns))


def _pass(
    entry: CatalogueEntry,
    path: _Path,
    span_utc_ns: tuple[int, int],
    limits: LimitsConfig,
    errors: ElementErrors,
) -> NightPass | None:
    """Return the pass of a run of instants; None where it is not above the limit in the span."""
    t, lines, alt, az = path.fine()
    is_up = margin_deg(alt, az, limits) > 0.0
    is_up &= (t >= span_utc_ns[0]) & (t <= span_utc_ns[1])
    up = np.flatnonzero(is_up)
    if not len(up):
        return None
    rise, set_ = int(up[0]), int(up[-1])
    top = int(up[np.argmax(alt[up])])
    lit = lit_fraction_for_sun(path.sun_km, path.r_km) >= LIT_SHARE
    bright = path.t_utc_ns[lit]
    is_lit = bool(len(bright)) and bright[-1] >= t[rise] and bright[0] <= t[set_]
    nearest = int(np.argmin(np.abs(path.t_utc_ns - t[top])))
    is_top_lit, phase_deg = path.light(top, int(t[top]), lines[top])
    beside = unit_vectors(lines[[max(top - 1, 0), min(top + 1, len(t) - 1)]])
    moved_deg = float(np.degrees(np.arcsin(np.linalg.norm(np.cross(*beside)))))
    span_s = (t[min(top + 1, len(t) - 1)] - t[max(top - 1, 0)]) / NS_PER_S
    age_days = (int(t[top]) - entry.epoch_utc_ns) / NS_PER_DAY
    regime = orbit_regime(entry.revolutions_a_day, entry.eccentricity)
    spread = errors.spread_for(regime, is_moved=False)
    along_km = float(position_sigmas_km(spread, age_days)[1])
    speed_km_s = float(entry.revolutions_a_day * 2.0 * np.pi / 86_400.0) * float(
        np.linalg.norm(path.r_km[nearest])
    )

    def corner(n: int) -> PassPoint:
        return PassPoint(t_utc_ns=int(t[n]), alt_deg=float(alt[n]), az_deg=float(az[n]))

    return NightPass(
        norad_id=entry.norad_id,
        name=entry.name or str(entry.norad_id),
        rise=corner(rise),
        top=corner(top),
        set=corner(set_),
        lit_from_utc_ns=max(int(bright[0]), int(t[rise])) if is_lit else None,
        lit_until_utc_ns=min(int(bright[-1]), int(t[set_])) if is_lit else None,
        is_lit=is_top_lit,
        phase_deg=phase_deg,
        range_km=float(np.linalg.norm(lines[top])),
        rate_arcsec_s=3600.0 * moved_deg / span_s,
        tle_age_days=age_days,
        sigma_s=along_km / speed_km_s,
    )


MINUTES = (*range(21), *range(25, 60, 5), *range(60, 721, 15))
"""Minutes ahead for which satellites are computed: close at first, as low ones set in minutes."""
RATE_STEP_S = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class VisibleSatellite:
    """Satellite above altitude limit and horizon mask at one instant."""

    norad_id: int
    name: str
    ra_icrs_deg: float
    dec_icrs_deg: float
    """Declination; both geometric, to some arcseconds: a go-to computes the place again."""
    alt_deg: float
    az_deg: float
    is_lit: bool
    range_km: float
    """Distance from the site."""
    phase_deg: float
    """Angle at the object between Sun and site."""
    rate_arcsec_s: float
    """Angular rate against the stars."""
    minutes_left: float | None
    """Minutes until it sinks to the limit; None: not within 12 hours."""


def visible_satellites(
    entries: Sequence[CatalogueEntry], site: Site, t_utc_ns: int, limits: LimitsConfig
) -> tuple[VisibleSatellite, ...]:
    """Return the satellites above altitude limit and horizon mask, the highest first.

    Elements that SGP4 refuses are left out.
    """
    nearest = nearest_epoch_entries(entries, t_utc_ns)
    if not nearest:
        return ()
    now = TopocentricPlaces(
        nearest, site, np.array([t_utc_ns, t_utc_ns + RATE_STEP_S * NS_PER_S]), limits
    )
    is_up = now.margin_deg[:, 0] > 0.0
    there = [each for each, up in zip(nearest, is_up, strict=True) if up]
    if not there:
        return ()
    ra_deg, dec_deg = unit_to_direction(now.line_km[is_up])
    rates = np.asarray(separation_deg(ra_deg[:, 0], dec_deg[:, 0], ra_deg[:, 1], dec_deg[:, 1]))
    r_km, line_km = now.r_km[is_up, 0], now.line_km[is_up, 0]
    lit = lit_fraction(r_km, t_utc_ns) >= LIT_SHARE
    phases_deg = phase_angle_deg(r_km, r_km - line_km, t_utc_ns)
    left = _minutes_left(there, site, t_utc_ns, limits)
    found = [
        VisibleSatellite(
            norad_id=each.norad_id,
            name=each.name or str(each.norad_id),
            ra_icrs_deg=float(ra_deg[n, 0]),
            dec_icrs_deg=float(dec_deg[n, 0]),
            alt_deg=float(now.alt_deg[is_up][n, 0]),
            az_deg=float(now.az_deg[is_up][n, 0]),
            is_lit=bool(lit[n]),
            range_km=float(np.linalg.norm(line_km[n])),
            phase_deg=float(phases_deg[n]),
            rate_arcsec_s=float(rates[n]) * 3600.0 / RATE_STEP_S,
            minutes_left=None if np.isinf(left[n]) else float(left[n]),
        )
        for n, each in enumerate(there)
    ]
    return tuple(sorted(found, key=lambda up: -up.alt_deg))


def _minutes_left(
    entries: Sequence[CatalogueEntry], site: Site, t_utc_ns: int, limits: LimitsConfig
) -> FloatArray:
    """Return the minutes until each satellite sinks to the limit; infinite where it does not."""
    minutes = np.array(MINUTES)
    t = t_utc_ns + minutes.astype(np.int64) * 60 * NS_PER_S
    margin = TopocentricPlaces(entries, site, t, limits).margin_deg
    is_down = margin <= 0.0
    first = np.argmax(is_down, axis=1)
    rows = np.arange(len(entries))
    last = np.maximum(first - 1, 0)
    before, after = margin[rows, last], margin[rows, first]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = before / (before - after)
        left = minutes[last] + share * (minutes[first] - minutes[last])
    return np.where(is_down.any(axis=1), left, np.inf)
