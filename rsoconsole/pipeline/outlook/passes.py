"""When catalogued objects pass over a site in a night. Pure.

Objects are looked at once a minute; between two looks a place is that of the cubic through both
places and velocities, which is good to a metre for the lowest orbit.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rsoconsole.config import LimitsConfig
from rsoconsole.orbits.elements import CatalogueEntry, array_of, nearest_in_epoch_of_each
from rsoconsole.orbits.identification import ASSUMED, ElementErrors, position_sigmas_km, regime_of
from rsoconsole.pipeline.outlook.standing import Axes, axes_of, directions, margin_deg
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import (
    EARTH_RADIUS_KM,
    NS_PER_DAY,
    NS_PER_S,
    IntArray,
    jd_utc,
    lit_fraction_by,
    site_gcrs,
    sun_gcrs_km,
    teme_to_gcrs_rotation,
)

STEP_S = 60
LOW_REVOLUTIONS = 9.0
"""A day, from which an orbit counts as low."""
LIT_SHARE = 0.5
"""Of the Sun's disc, from which a satellite counts as lit."""
_OBJECTS_AT_ONCE = 400
_NEAR_LIMIT_DEG, _NEARER = 4.0, 0.5
"""What is highest so far below the limit at a look may be above it between two: the lowest orbits
turn the faster in altitude the higher they stand, so by that share of the limit more."""
_PARTS = 60
"""Of the time between two looks."""
_FLATTENING_KM = 22.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Corner:
    """Where an object stands at one instant of its pass."""

    t_utc_ns: int
    alt_deg: float
    """Geometric, without refraction."""
    az_deg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class NightPass:
    """One pass above the limit, as far as it lies in the span."""

    norad_id: int
    name: str
    rise: Corner
    top: Corner
    set: Corner
    lit_from_utc_ns: int | None
    """Where the Sun shines on it, to a minute; None: nowhere on its pass."""
    lit_until_utc_ns: int | None
    range_km: float
    """At the top, as the next."""
    rate_arcsec_s: float
    """Over the stars."""
    tle_age_days: float
    sigma_s: float
    """How early or late it may be by the age of its elements, one sigma; where nobody steers it."""


def night_passes(
    entries: Sequence[CatalogueEntry],
    site: Site,
    span_utc_ns: tuple[int, int],
    limits: LimitsConfig,
    *,
    is_low_only: bool = True,
    errors: ElementErrors = ASSUMED,
) -> Iterator[tuple[int, tuple[NightPass, ...]]]:
    """Passes within a span, by some objects after another, each time with how many were looked at.

    Of each object the set nearest in epoch counts. ``is_low_only``: of low orbits alone, else what
    never sets has one pass, the whole span. Elements that SGP4 refuses are left out.
    """
    nearest = nearest_in_epoch_of_each(entries, span_utc_ns[0])
    looked_at = [e for e in nearest if _may_rise(e, site, limits, is_low_only=is_low_only)]
    looks = _Looks.over(site, span_utc_ns)
    done = len(nearest) - len(looked_at)
    for start in range(0, len(looked_at), _OBJECTS_AT_ONCE):
        some = looked_at[start : start + _OBJECTS_AT_ONCE]
        found = [
            each
            for entry, path in looks.near_the_limit(some, limits)
            if (each := _pass(entry, path, span_utc_ns, limits, errors)) is not None
        ]
        done += len(some)
        yield done, tuple(sorted(found, key=lambda each: each.rise.t_utc_ns))
    if not looked_at:
        yield done, ()


def _may_rise(
    entry: CatalogueEntry, site: Site, limits: LimitsConfig, *, is_low_only: bool
) -> bool:
    """Whether its orbit ever comes above the limit, as seen from that latitude."""
    if is_low_only and entry.revolutions_a_day < LOW_REVOLUTIONS:
        return False
    highest_km = entry.record.alta * entry.record.radiusearthkm + EARTH_RADIUS_KM + _FLATTENING_KM
    if not highest_km > EARTH_RADIUS_KM:
        return False
    low_rad = np.radians(limits.min_altitude_deg)
    reach_rad = (
        np.arccos(np.cos(low_rad) * (EARTH_RADIUS_KM - _FLATTENING_KM) / highest_km) - low_rad
    )
    tilt_deg = float(np.degrees(entry.record.inclo))
    northmost_deg = min(tilt_deg, 180.0 - tilt_deg)
    return abs(site.latitude_deg) <= northmost_deg + float(np.degrees(reach_rad)) + 1.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Looks:
    """The site at each look, one before the span and one behind it among them."""

    t_utc_ns: IntArray
    """(N,)"""
    site_km: FloatArray
    site_km_s: FloatArray
    axes: Axes
    sun_km: FloatArray
    to_gcrs: FloatArray
    """(N, 3, 3) from TEME, as SGP4 has it."""

    @classmethod
    def over(cls, site: Site, span_utc_ns: tuple[int, int]) -> "_Looks":
        """Those of a span."""
        step_ns = STEP_S * NS_PER_S
        t = np.arange(span_utc_ns[0] - step_ns, span_utc_ns[1] + 2 * step_ns, step_ns)
        site_km, site_km_s = site_gcrs(site, t)
        return cls(
            t_utc_ns=t,
            site_km=site_km,
            site_km_s=site_km_s,
            axes=axes_of(site, t),
            sun_km=sun_gcrs_km(t),
            to_gcrs=teme_to_gcrs_rotation(t),
        )

    def near_the_limit(
        self, entries: Sequence[CatalogueEntry], limits: LimitsConfig
    ) -> Iterator[tuple[CatalogueEntry, "_Path"]]:
        """Each object over each run of looks at which it is not far below the limit."""
        jd_1, jd_2 = jd_utc(self.t_utc_ns)
        failed, r_teme, v_teme = array_of([each.record for each in entries]).sgp4(
            np.ascontiguousarray(jd_1), np.ascontiguousarray(jd_2)
        )
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
    """One object at L looks, and anywhere between them."""

    t_utc_ns: IntArray
    """(L,)"""
    r_km: FloatArray
    line_km: FloatArray
    line_km_s: FloatArray
    axes: Axes
    sun_km: FloatArray

    def fine(self) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        """Instants, lines from the site (km), altitudes and azimuths, a second apart."""
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
        alt_deg, az_deg = directions(line, (up, north, east))
        step_ns = STEP_S * NS_PER_S // _PARTS
        t = self.t_utc_ns[:-1, None] + np.arange(_PARTS) * step_ns
        return t.ravel(), line, alt_deg, az_deg


def _pass(
    entry: CatalogueEntry,
    path: _Path,
    span_utc_ns: tuple[int, int],
    limits: LimitsConfig,
    errors: ElementErrors,
) -> NightPass | None:
    """The one of a run of looks; None where it is not above the limit in the span."""
    t, lines, alt, az = path.fine()
    is_up = margin_deg(alt, az, limits) > 0.0
    is_up &= (t >= span_utc_ns[0]) & (t <= span_utc_ns[1])
    up = np.flatnonzero(is_up)
    if not len(up):
        return None
    rise, set_ = int(up[0]), int(up[-1])
    top = int(up[np.argmax(alt[up])])
    lit = lit_fraction_by(path.sun_km, path.r_km) >= LIT_SHARE
    bright = path.t_utc_ns[lit]
    is_lit = bool(len(bright)) and bright[-1] >= t[rise] and bright[0] <= t[set_]
    nearest = int(np.argmin(np.abs(path.t_utc_ns - t[top])))
    beside = lines[[max(top - 1, 0), min(top + 1, len(t) - 1)]]
    beside = beside / np.linalg.norm(beside, axis=-1, keepdims=True)
    moved_deg = float(np.degrees(np.arcsin(np.linalg.norm(np.cross(*beside)))))
    span_s = (t[min(top + 1, len(t) - 1)] - t[max(top - 1, 0)]) / NS_PER_S
    age_days = (int(t[top]) - entry.epoch_utc_ns) / NS_PER_DAY
    regime = regime_of(entry.revolutions_a_day, entry.eccentricity)
    spread = errors.of(regime, is_moved=False)
    along_km = float(position_sigmas_km(spread, age_days)[1])
    speed_km_s = float(entry.revolutions_a_day * 2.0 * np.pi / 86_400.0) * float(
        np.linalg.norm(path.r_km[nearest])
    )

    def corner(n: int) -> Corner:
        return Corner(t_utc_ns=int(t[n]), alt_deg=float(alt[n]), az_deg=float(az[n]))

    return NightPass(
        norad_id=entry.norad_id,
        name=entry.name or str(entry.norad_id),
        rise=corner(rise),
        top=corner(top),
        set=corner(set_),
        lit_from_utc_ns=max(int(bright[0]), int(t[rise])) if is_lit else None,
        lit_until_utc_ns=min(int(bright[-1]), int(t[set_])) if is_lit else None,
        range_km=float(np.linalg.norm(lines[top])),
        rate_arcsec_s=3600.0 * moved_deg / span_s,
        tle_age_days=age_days,
        sigma_s=along_km / speed_km_s,
    )
