"""Satellites moved by other code than the product's, and seen with noise.

Truth is a numerical integration of many satellites at once (scipy's, of another order and step)
through a potential whose gradient is taken by complex steps, with Moon and Sun of JPL's DE421.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from rsoconsole.orbits import MeasuredDirections, reduce_directions
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import IntArray, SkyPlaces, astrometric_places, jd_ut1
from rsoconsole.sky.times import jd_tt
from rsoconsole.words import NS_PER_S
from tests.truth.orbit_cases import EARTH_KM, MU, state_of

DAYTONA = Site(latitude_deg=29.19, longitude_deg=-81.05, elevation_m=10.0)
MU_SUN, MU_MOON = 1.32712440018e11, 4902.800066
AREA_TO_MASS_M2_KG = 0.026
"""Times the reflectivity."""
AU_KM = 149_597_870.7


@dataclass(frozen=True, kw_only=True, eq=False)
class Flight:
    """M satellites from one instant on, states (M, 6) on GCRS axes."""

    t0_utc_ns: int
    start: FloatArray
    site: Site = DAYTONA
    with_forces: bool = True

    def states(self, since_s: FloatArray) -> FloatArray:
        """(T, M, 6) at times (T,) since the start, none before it."""
        times = np.asarray(since_s, float)
        unique, where = np.unique(np.append(times, 0.0), return_inverse=True)
        if len(unique) == 1:
            return np.repeat(self.start[None], len(times), axis=0)
        solved = solve_ivp(
            self._slope,
            (0.0, unique[-1]),
            self.start.ravel(),
            method="DOP853",
            t_eval=unique,
            rtol=3e-13,
            atol=1e-9,
            max_step=900.0,
        )
        return solved.y.T.reshape(len(unique), -1, 6)[where[:-1]]

    def places(self, since_s: FloatArray) -> list[SkyPlaces]:
        """What a plate solution would measure of each satellite, without noise."""
        t = self.instants(since_s)
        states = self.states(since_s)
        return [
            astrometric_places(_about(t, states[:, m]), self.site, t)
            for m in range(len(self.start))
        ]

    def instants(self, since_s: FloatArray) -> IntArray:
        return self.t0_utc_ns + np.rint(np.asarray(since_s) * NS_PER_S).astype(np.int64)

    def _slope(self, t_s: float, flat: FloatArray) -> FloatArray:
        state = flat.reshape(-1, 6)
        r = state[:, :3]
        total = -MU * r / np.linalg.norm(r, axis=1, keepdims=True) ** 3
        if self.with_forces:
            total = total + self._forces(t_s, r)
        return np.concatenate([state[:, 3:], total], axis=1).ravel()

    def _forces(self, t_s: float, r: FloatArray) -> FloatArray:
        rotation = self._to_earth(t_s)
        fixed = r @ rotation.T
        step = 1e-20
        gradient = [
            _bulge(fixed + 1j * step * axis).imag / step for axis in np.eye(3)
        ]  # d/dx f = Im f(x + ih) / h
        total = np.stack(gradient, axis=1) @ rotation
        both = self._bodies(t_s)
        for mu, body in ((MU_MOON, both[:3]), (MU_SUN, both[3:])):
            away = body - r
            total += mu * away / np.linalg.norm(away, axis=1, keepdims=True) ** 3
            total -= mu * body / np.linalg.norm(body) ** 3
        from_sun = r - both[3:]
        distance = np.linalg.norm(from_sun, axis=1, keepdims=True)
        push = 4.56e-9 * AREA_TO_MASS_M2_KG * (AU_KM / distance) ** 2
        sunward = both[3:] / np.linalg.norm(both[3:])
        along = r @ sunward
        aside = np.linalg.norm(r - along[:, None] * sunward, axis=1)
        lit = ~((along < 0.0) & (aside < EARTH_KM))
        return np.asarray(total + push * lit[:, None] * from_sun / distance)

    def _to_earth(self, t_s: float) -> FloatArray:
        import erfa

        # The pole moves by a tenth of an arcsecond a day: once will do.
        return np.asarray(erfa.rz(self._turned_rad + 7.292115146706979e-5 * t_s, self._to_cirs))

    @cached_property
    def _turned_rad(self) -> float:
        import erfa

        return float(erfa.era00(*jd_ut1(self.t0_utc_ns)))

    @cached_property
    def _to_cirs(self) -> FloatArray:
        import erfa

        return np.asarray(erfa.c2i06a(*jd_tt(self.t0_utc_ns)))

    @cached_property
    def _bodies(self) -> CubicSpline:
        """Moon and Sun (6,) from the Earth's centre, km."""
        import skyfield_data
        from skyfield.api import load, load_file

        timescale = load.timescale(builtin=True)
        knots = np.arange(-3600.0, 4.0 * 86400.0, 900.0)
        tt = [jd_tt(int(self.t0_utc_ns + knot * NS_PER_S)) for knot in knots]
        at = timescale.tt_jd(np.array([float(one) + float(two) for one, two in tt]))
        kernel = load_file(str(Path(skyfield_data.__file__).parent / "data" / "de421.bsp"))
        moon, sun = (
            (kernel[each] - kernel["earth"]).at(at).position.km for each in ("moon", "sun")
        )
        kernel.close()
        return CubicSpline(knots, np.concatenate([moon, sun]).T)


def _about(t: IntArray, states: FloatArray):
    """Positions near the instants of states (N, 6), by their velocity and the bend of the way."""

    def position_of(at: IntArray) -> tuple[FloatArray, FloatArray]:
        dt = ((at - t) / NS_PER_S)[:, None]
        r, v = states[:, :3], states[:, 3:]
        a = -MU * r / np.linalg.norm(r, axis=1, keepdims=True) ** 3
        return r + v * dt + a * dt * dt / 2.0, v + a * dt

    return position_of


def _bulge(fixed):
    """Potential of J2 to J4, C22 and S22 (km2/s2) at complex places (M, 3) on the turning Earth."""
    x, y, z = fixed.T
    d = np.sqrt(x * x + y * y + z * z)
    s, q = z / d, EARTH_KM / d
    zonal = 1.08262668e-3 * q**2 * (3 * s * s - 1) / 2
    zonal = zonal - 2.53265648e-6 * q**3 * (5 * s**3 - 3 * s) / 2
    zonal = zonal - 1.61962159e-6 * q**4 * (35 * s**4 - 30 * s * s + 3) / 8
    form = 1.574536e-6 * (x * x - y * y) + 2.0 * -9.03868e-7 * x * y
    return MU / d * (-zonal + 3.0 * q**2 * form / (d * d))


def geostationary(
    random: np.random.Generator,
    count: int,
    *,
    t0_utc_ns: int,
    i_deg: float,
    e: FloatArray,
    a_km: tuple[float, float] = (42_166.0, 15.0),
    site: Site = DAYTONA,
) -> Flight:
    """Satellites (count,) about a semi-major axis (mean, sigma), 20 degrees or more high."""
    import erfa

    east = np.radians(site.longitude_deg) + float(erfa.era00(*jd_ut1(t0_utc_ns)))
    start = []
    for n in range(count):
        longitude = east + np.radians(random.uniform(-35.0, 35.0))
        node, argp = random.uniform(0.0, 2.0 * np.pi, 2)
        mean = longitude - node - argp
        a = random.normal(*a_km)
        start.append(
            np.concatenate(state_of(a, float(e[n]), np.radians(i_deg), (node, argp, mean)))
        )
    return Flight(t0_utc_ns=t0_utc_ns, start=np.array(start), site=site)


def seen_with_noise(
    random: np.random.Generator, site: Site, places: SkyPlaces, sigma_arcsec: float
) -> MeasuredDirections:
    """The same noise east and north, of the stated size."""
    north = random.normal(0.0, sigma_arcsec, len(places.t_utc_ns)) / 3600.0
    east = random.normal(0.0, sigma_arcsec, len(places.t_utc_ns)) / 3600.0
    ra = places.ra_icrs_deg + east / np.cos(np.radians(places.dec_icrs_deg))
    covariance = np.tile([sigma_arcsec**2, 0.0, sigma_arcsec**2], (len(ra), 1))
    return reduce_directions(site, places.t_utc_ns, ra, places.dec_icrs_deg + north, covariance)


def off_arcsec(one: SkyPlaces, other: SkyPlaces) -> FloatArray:
    """(N, 2) east and north, one minus other."""
    d_ra = (one.ra_icrs_deg - other.ra_icrs_deg + 180.0) % 360.0 - 180.0
    east = d_ra * np.cos(np.radians(other.dec_icrs_deg))
    return np.stack([east, one.dec_icrs_deg - other.dec_icrs_deg], axis=-1) * 3600.0
