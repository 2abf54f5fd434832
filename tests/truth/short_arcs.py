"""Short arcs of low satellites as an observer sends them: directions with noise and late times.

Truth is scipy's integration of a point mass with J2, by no code of the product's orbits.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import IntArray, SkyPlaces, astrometric_places, site_gcrs, zenith_gcrs
from rsoconsole.words import NS_PER_S, utc_ns_to_iso
from tests.truth.orbit_cases import EARTH_KM, MU, state_of

J2 = 1.08262668e-3
T0_UTC_NS = 1_780_000_000 * NS_PER_S
MIN_ALTITUDE_DEG = 20.0
TIMING_S = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class ShortArc:
    """One arc, what its observer states of it, and where the object really was."""

    site: Site
    t_utc_ns: IntArray
    """Stated times: off by `TIMING_S` each, one sigma."""
    ra_deg: FloatArray
    dec_deg: FloatArray
    sigma_arcsec: float
    start: FloatArray
    """True state (6,) at the instant ``start_utc_ns``."""
    start_utc_ns: int

    @property
    def span_s(self) -> float:
        """From the first line to the last."""
        return float(np.ptp(self.t_utc_ns)) / NS_PER_S

    def states(self, t_utc_ns: IntArray) -> FloatArray:
        """True states (N, 6) at instants in order of time, all of them after the start."""
        return _flown(self.start, (np.asarray(t_utc_ns) - self.start_utc_ns) / NS_PER_S)

    def places(self, t_utc_ns: IntArray) -> SkyPlaces:
        """True places on the sky."""
        return _places(self.site, np.asarray(t_utc_ns), self.states(t_utc_ns))

    def as_csv(self) -> str:
        """The arc as a table with named columns, as it comes from elsewhere."""
        place = (self.site.latitude_deg, self.site.longitude_deg, self.site.elevation_m)
        head = "time,ra_deg,dec_deg,sigma_arcsec,time_sigma_s,lat_deg,lon_deg,alt_m\n"
        return head + "".join(
            f"{utc_ns_to_iso(int(t), 6)},{ra:.6f},{dec:.6f},{self.sigma_arcsec},{TIMING_S},"
            f"{place[0]},{place[1]},{place[2]}\n"
            for t, ra, dec in zip(self.t_utc_ns, self.ra_deg, self.dec_deg, strict=True)
        )


def short_arc(seed: int) -> ShortArc:
    """One arc drawn at random: 5 to 15 lines over 0.5 to 3 min of a pass above 20 deg."""
    random = np.random.default_rng(seed)
    while True:
        site = Site(
            latitude_deg=float(random.uniform(30.0, 55.0) * random.choice([-1.0, 1.0])),
            longitude_deg=float(random.uniform(-180.0, 180.0)),
            elevation_m=float(random.uniform(0.0, 1000.0)),
        )
        begin = T0_UTC_NS + int(random.integers(0, 365 * 86_400)) * NS_PER_S
        start = _drawn_orbit(random)
        span_s, lines = float(random.uniform(30.0, 180.0)), int(random.integers(5, 16))
        if not _is_high(site, start, begin):
            continue
        inner = np.sort(random.uniform(0.0, span_s, lines - 2))
        t = begin + NS_PER_S + np.rint(np.array([0.0, *inner, span_s]) * NS_PER_S).astype(np.int64)
        states = _flown(start, (t - begin) / NS_PER_S)
        if not _is_high(site, states[-1], int(t[-1])):
            continue
        places = _places(site, t, states)
        sigma = float(random.uniform(10.0, 60.0))
        east, north = random.normal(0.0, sigma / 3600.0, (2, lines))
        late = np.rint(random.normal(0.0, TIMING_S, lines) * NS_PER_S).astype(np.int64)
        return ShortArc(
            site=site,
            t_utc_ns=t + late,
            ra_deg=(places.ra_icrs_deg + east / np.cos(np.radians(places.dec_icrs_deg))) % 360.0,
            dec_deg=np.clip(places.dec_icrs_deg + north, -90.0, 90.0),
            sigma_arcsec=round(sigma, 1),
            start=start,
            start_utc_ns=begin,
        )


def _drawn_orbit(random: np.random.Generator) -> FloatArray:
    """400 to 1,500 km high, inclined 30 to 110 deg, eccentricity up to 0.02 (above 250 km)."""
    while True:
        a_km = EARTH_KM + random.uniform(400.0, 1500.0)
        e = random.uniform(0.0, 0.02)
        if a_km * (1.0 - e) > EARTH_KM + 250.0:
            break
    i_rad = math.radians(random.uniform(30.0, 110.0))
    return np.concatenate(state_of(a_km, e, i_rad, tuple(random.uniform(0.0, 2.0 * np.pi, 3))))


def _is_high(site: Site, state: FloatArray, t_utc_ns: int) -> bool:
    at = np.array([t_utc_ns])
    line = state[:3] - site_gcrs(site, at)[0][0]
    sine = line @ zenith_gcrs(site, at)[0] / np.linalg.norm(line)
    return bool(sine > math.sin(math.radians(MIN_ALTITUDE_DEG)))


def _flown(start: FloatArray, since_s: FloatArray) -> FloatArray:
    solved = solve_ivp(
        _slope, (0.0, float(since_s[-1]) + 1.0), start, method="DOP853", t_eval=since_s,
        rtol=1e-11, atol=1e-9,
    )  # fmt: skip
    return np.asarray(solved.y.T)


def _slope(_: float, state: FloatArray) -> FloatArray:
    """Source: Montenbruck & Gill 2000, 3.2; J2 about GCRS axes, 0.15 deg off those of date."""
    r = state[:3]
    d = math.sqrt(float(r @ r))
    z2 = 5.0 * (r[2] / d) ** 2
    swell = 1.5 * J2 * (EARTH_KM / d) ** 2
    pull = -MU / d**3 * r * (1.0 + swell * (np.array([1.0, 1.0, 3.0]) - z2))
    return np.concatenate([state[3:], pull])


def _places(site: Site, t: IntArray, states: FloatArray) -> SkyPlaces:
    def position_of(at: IntArray) -> tuple[FloatArray, FloatArray]:
        dt = ((at - t) / NS_PER_S)[:, None]
        return states[:, :3] + states[:, 3:] * dt, states[:, 3:]

    return astrometric_places(position_of, site, t)
