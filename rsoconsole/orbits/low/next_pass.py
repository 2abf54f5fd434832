"""When an orbit brings its object above a site again, and how sure that is. Pure."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rsoconsole.orbits.motion import (
    MU_EARTH_KM3_S2,
    KnownOrbit,
    propagate_with_slopes,
    semi_major_axis,
)
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import NS_PER_S, IntArray, site_gcrs, zenith_gcrs

STEP_S = 15.0
_LOOKED_AT = 400
"""Instants at a time."""
_LONGEST_S = 7_200.0
"""A pass that lasts longer is cut there."""
_LEFT_OUT_KM = (0.3, 0.1)
"""Along and across the orbit, for each revolution: what the Earth's unevenness does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedPass:
    """One pass above the limit."""

    rise_utc_ns: int
    set_utc_ns: int
    top_altitude_deg: float
    sigma_s: float
    """Of all three instants: how early or late it may be, one sigma."""
    sigma_across_deg: float
    """Seen from the site when it is highest, one sigma."""


def passes_above(
    orbit: KnownOrbit, site: Site, from_utc_ns: int, until_utc_ns: int, least_altitude_deg: float
) -> Iterator[ExpectedPass]:
    """Passes that begin within a span, one after another; one under way at its start is none."""
    last_ns = from_utc_ns
    while last_ns < until_utc_ns:
        t = last_ns + (np.arange(_LOOKED_AT) * STEP_S * NS_PER_S).astype(np.int64)
        is_up = _altitudes(orbit, site, t) > least_altitude_deg
        last_ns = int(t[-1])
        for n in np.flatnonzero(~is_up[:-1] & is_up[1:]):
            if t[n] >= until_utc_ns:
                return
            found = _pass(orbit, site, int(t[n]), least_altitude_deg)
            if found is not None:
                yield found


def errors_at(orbit: KnownOrbit, site: Site, t_utc_ns: int) -> tuple[float, float]:
    """One sigma along the orbit in seconds, and across it in degrees as seen from the site."""
    since_s = (t_utc_ns - orbit.epoch_utc_ns) / NS_PER_S
    _, _, slopes = propagate_with_slopes(orbit.r_km, orbit.v_km_s, np.array([since_s]))
    r, v = (each[0] for each in orbit.states(np.array([t_utc_ns])))
    spread = slopes[0] @ orbit.covariance @ slopes[0].T
    ahead = v / np.linalg.norm(v)
    a_km, _ = semi_major_axis(orbit.r_km, orbit.v_km_s)
    turns = abs(since_s) / (2.0 * np.pi * np.sqrt(max(a_km, 1.0) ** 3 / MU_EARTH_KM3_S2))
    line = r - site_gcrs(site, np.array([t_utc_ns]))[0][0]
    range_km = float(np.linalg.norm(line))
    # Across as it is seen: neither ahead nor towards the eye.
    aside = np.cross(line / range_km, ahead)
    aside = aside / np.linalg.norm(aside)
    left_out = turns * np.array(_LEFT_OUT_KM)
    along_km = float(np.hypot(np.sqrt(ahead @ spread @ ahead), left_out[0]))
    across_km = float(np.hypot(np.sqrt(aside @ spread @ aside), left_out[1]))
    return along_km / float(np.linalg.norm(v)), float(np.degrees(across_km / range_km))


def _altitudes(orbit: KnownOrbit, site: Site, t: IntArray) -> FloatArray:
    """(N,) degrees above the ellipsoid's horizon."""
    r, _ = orbit.states(t)
    places, _ = site_gcrs(site, t)
    line = r - places
    up = zenith_gcrs(site, t)
    sine = np.sum(line * up, axis=-1) / np.linalg.norm(line, axis=-1)
    return np.asarray(np.degrees(np.arcsin(sine)))


def _pass(
    orbit: KnownOrbit, site: Site, t_below_ns: int, least_altitude_deg: float
) -> ExpectedPass | None:
    """The pass that begins within a step of an instant."""
    coarse = t_below_ns + (np.arange(0.0, _LONGEST_S, STEP_S) * NS_PER_S).astype(np.int64)
    is_down = _altitudes(orbit, site, coarse) <= least_altitude_deg
    ends = np.flatnonzero(is_down[2:])
    last_ns = int(coarse[2 + ends[0]] if len(ends) else coarse[-1])
    fine = np.arange(t_below_ns, last_ns, NS_PER_S // 2)
    altitude = _altitudes(orbit, site, fine)
    up = np.flatnonzero(altitude > least_altitude_deg)
    if not len(up):
        return None
    top = int(np.argmax(altitude))
    sigma_s, across_deg = errors_at(orbit, site, int(fine[top]))
    return ExpectedPass(
        rise_utc_ns=int(fine[up[0]]),
        set_utc_ns=int(fine[up[-1]]),
        top_altitude_deg=float(altitude[top]),
        sigma_s=sigma_s,
        sigma_across_deg=across_deg,
    )
