"""Where catalogued objects stand over a site, against its limits. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.config import LimitsConfig
from rsoconsole.orbits.elements import CatalogueEntry, states_gcrs
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import IntArray, site_gcrs, zenith_gcrs
from rsoconsole.sky.limits import horizon_altitude_deg

Axes = tuple[FloatArray, FloatArray, FloatArray]
"""Up, north and east of a site at instants, (N, 3) unit vectors along GCRS axes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Standing:
    """M objects at N instants; geometric, without refraction."""

    r_km: FloatArray
    """(M, N, 3), GCRS."""
    line_km: FloatArray
    """(M, N, 3), from the site."""
    alt_deg: FloatArray
    """(M, N); NaN where an object has no place."""
    az_deg: FloatArray
    margin_deg: FloatArray
    """(M, N), above the limit; far below it where an object has no place."""


def standing(
    entries: Sequence[CatalogueEntry], site: Site, t_utc_ns: IntArray, limits: LimitsConfig
) -> Standing:
    """All objects at all instants (N,)."""
    r_km, _ = states_gcrs(entries, t_utc_ns)
    line_km = r_km - site_gcrs(site, t_utc_ns)[0]
    alt_deg, az_deg = directions(line_km, axes_of(site, t_utc_ns))
    return Standing(
        r_km=r_km,
        line_km=line_km,
        alt_deg=alt_deg,
        az_deg=az_deg,
        margin_deg=margin_deg(alt_deg, az_deg, limits),
    )


def axes_of(site: Site, t_utc_ns: IntArray) -> Axes:
    """The vertical and the north of the site as the ground there lies, and its east."""
    site_km = site_gcrs(site, t_utc_ns)[0]
    up = zenith_gcrs(site, t_utc_ns)
    toward_deg = 0.01 if site.latitude_deg < 89.0 else -0.01
    moved = replace(site, latitude_deg=site.latitude_deg + toward_deg)
    north = unit((site_gcrs(moved, t_utc_ns)[0] - site_km) / toward_deg)
    return up, north, np.cross(north, up)


def directions(line_km: FloatArray, axes: Axes) -> tuple[FloatArray, FloatArray]:
    """Altitude and azimuth (deg) of lines (..., 3); ``axes`` (..., 3) up, north and east."""
    line = unit(line_km)
    up, north, east = (np.sum(line * axis, axis=-1) for axis in axes)
    alt_deg = np.degrees(np.arcsin(np.clip(up, -1.0, 1.0)))
    return np.asarray(alt_deg), np.asarray(np.degrees(np.arctan2(east, north)) % 360.0)


def margin_deg(alt_deg: FloatArray, az_deg: FloatArray, limits: LimitsConfig) -> FloatArray:
    """How far above altitude limit and horizon mask; -90 where there is no place."""
    lowest_deg = np.full(np.shape(alt_deg), limits.min_altitude_deg)
    if limits.horizon:
        lowest_deg = np.maximum(lowest_deg, horizon_altitude_deg(limits.horizon, az_deg))
    return np.where(np.isfinite(alt_deg), alt_deg - lowest_deg, -90.0)


def unit(vectors: FloatArray) -> FloatArray:
    """(..., 3) of length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
