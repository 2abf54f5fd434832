"""Paths of catalogued objects on the sky, ahead of their elements or behind. Pure.

A lead, in seconds, is the time by which an object is ahead: with a lead of 10 s it is now where its
elements put it 10 s later, seen from where the site is now; with a lead below 0 it is behind. Unit
vectors along ICRS axes; directions as a plate solution measures them.
"""

from dataclasses import dataclass

import numpy as np
from sgp4.api import SatrecArray

from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import LIGHT_KM_S, earth_velocity_km_s, jd_utc, site_gcrs, teme_to_gcrs_rotation
from rsoconsole.words import NS_PER_S


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ObjectPlaces:
    """Places of M objects, each at L leads (s ahead of its elements); NaN where SGP4 fails."""

    u: FloatArray
    """Unit vectors (M, L, 3) from the site."""
    by_lead: FloatArray
    """Change (M, L, 3) of ``u`` for each second of lead, rad/s."""
    by_time: FloatArray
    """Change (M, L, 3) of ``u`` for each second of time, rad/s."""
    range_km: FloatArray
    r_km: FloatArray
    """Positions (M, L, 3), GCRS."""
    v_km_s: FloatArray


class Observer:
    """A site at one instant, from which catalogued objects are seen."""

    def __init__(self, site: Site, t_utc_ns: int) -> None:
        self._t_utc_ns = t_utc_ns
        at = np.array([t_utc_ns], np.int64)
        position, velocity = site_gcrs(site, at)
        self._site_km, self._site_km_s = position[0], velocity[0]
        self._earth_km_s = earth_velocity_km_s(at)[0]
        # What turns it in the seconds of a lead is 1e-9 of it.
        self._rotation = teme_to_gcrs_rotation(at)[0]

    def places_at_leads(self, satellites: SatrecArray, lead_s: FloatArray) -> ObjectPlaces:
        """Return the places of M objects at this instant, for each of the leads (L,) in seconds."""
        t = self._t_utc_ns + np.rint(np.asarray(lead_s) * NS_PER_S).astype(np.int64)
        jd_1, jd_2 = jd_utc(t)
        failed, r_teme, v_teme = satellites.sgp4(
            np.ascontiguousarray(jd_1), np.ascontiguousarray(jd_2)
        )
        is_good = (failed == 0)[..., None]
        r = np.where(is_good, r_teme @ self._rotation.T, np.nan)
        v = np.where(is_good, v_teme @ self._rotation.T, np.nan)
        tau_s = np.linalg.norm(r - self._site_km, axis=-1, keepdims=True) / LIGHT_KM_S
        # Light time once: what bends in it is a millimetre.
        line = r - v * tau_s - self._site_km - self._earth_km_s * tau_s
        range_km = np.linalg.norm(line, axis=-1, keepdims=True)
        u = line / range_km
        return ObjectPlaces(
            u=u,
            by_lead=_across(v, u) / range_km,
            by_time=_across(v - self._site_km_s, u) / range_km,
            range_km=range_km[..., 0],
            r_km=r,
            v_km_s=v,
        )


class Exposure:
    """A site at three instants of an exposure: its opening, its middle and its closing."""

    def __init__(self, site: Site, t_mid_utc_ns: int, exposure_s: float) -> None:
        self.t_mid_utc_ns, self.exposure_s = t_mid_utc_ns, exposure_s
        half_ns = round(exposure_s * NS_PER_S / 2.0)
        self.middle = Observer(site, t_mid_utc_ns)
        self.opening = Observer(site, t_mid_utc_ns - half_ns)
        self.closing = Observer(site, t_mid_utc_ns + half_ns)

    def places_through_exposure(
        self, satellites: SatrecArray, lead_s: FloatArray
    ) -> tuple[ObjectPlaces, ObjectPlaces, ObjectPlaces]:
        """Return the places of objects at opening, middle and closing, for leads (L,), s."""
        opening, middle, closing = (
            each.places_at_leads(satellites, lead_s)
            for each in (self.opening, self.middle, self.closing)
        )
        return opening, middle, closing


def streak_path(
    opening: FloatArray, middle: FloatArray, closing: FloatArray, parts: int
) -> FloatArray:
    """Return unit vectors (..., parts, 3) at equal time steps through an exposure.

    They lie on a parabola through those at opening, middle and closing, (..., 3) each.
    """
    at = np.linspace(-1.0, 1.0, parts)[:, None]
    before, now, after = (each[..., None, :] for each in (opening, middle, closing))
    path = now + 0.5 * at * (after - before) + 0.5 * at**2 * (after + before - 2.0 * now)
    return np.asarray(path / np.linalg.norm(path, axis=-1, keepdims=True))


def _across(vector: FloatArray, u: FloatArray) -> FloatArray:
    return np.asarray(vector - np.sum(vector * u, axis=-1, keepdims=True) * u)
