"""Motion about the real Earth: zonal harmonics, Moon, Sun, and sunlight's push. Pure.

Predictions beyond an hour need it: about a point mass a geostationary satellite is 3 arcsec off after
four hours and minutes of arc after a day. Source of the forces: Montenbruck & Gill 2000, Satellite
Orbits, 3.2 to 3.4; zonal coefficients of EGM96, the sectorial pair that moves geostationary satellites
too; Sun and Moon by IAU SOFA. Integrated by Dormand and Prince's eighth order (scipy's DOP853).
Kilometres, seconds, along GCRS axes.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rsoconsole.orbit.two_body import MU_EARTH_KM3_S2
from rsoconsole.records import FloatArray
from rsoconsole.sky.moon import moon_gcrs_km
from rsoconsole.sky.places import AU_KM, cirs_to_gcrs, sun_gcrs_km
from rsoconsole.sky.sun import EARTH_RADIUS_KM, lit_fraction
from rsoconsole.sky.times import NS_PER_S, jd_ut1

MU_SUN_KM3_S2 = 1.327_124_400_18e11
MU_MOON_KM3_S2 = 4_902.800_066
ZONALS = (1.082_626_68e-3, -2.532_656_48e-6, -1.619_621_59e-6)
"""J2, J3, J4."""
C22, S22 = 1.574_536e-6, -9.038_68e-7
"""Unnormalised."""
SUN_PRESSURE_N_M2 = 4.56e-6
"""At one astronomical unit."""
AREA_TO_MASS_M2_KG = 0.026
"""Times the reflectivity coefficient: 0.02 m2/kg and 1.3, a usual geostationary satellite."""
_KNOT_S = 3600.0
_TOLERANCE = 1e-11


@dataclass(frozen=True, slots=True, kw_only=True)
class Forces:
    """What moves the object beside the point mass."""

    epoch_utc_ns: int
    """Instant to which times are counted."""
    area_to_mass_m2_kg: float = AREA_TO_MASS_M2_KG
    """Times the reflectivity; 0: sunlight does not push."""
    mu: float = MU_EARTH_KM3_S2
    _tables: list[Any] = field(default_factory=list)

    def positions(self, r_km: FloatArray, v_km_s: FloatArray, t_s: FloatArray) -> FloatArray:
        """Places (N, 3) at times (N,) since the epoch, of a state (3,), (3,) at the epoch."""
        return self.states(r_km, v_km_s, t_s)[0]

    def states(
        self, r_km: FloatArray, v_km_s: FloatArray, t_s: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Positions and velocities (N, 3). NaN where the object has come down."""
        times = np.atleast_1d(np.asarray(t_s, float))
        sky = self._sky(float(min(times.min(), 0.0)), float(max(times.max(), 0.0)))
        out = np.full((len(times), 6), np.nan)
        start = np.concatenate([r_km, v_km_s])
        for chosen, end in ((times >= 0.0, times.max()), (times < 0.0, times.min())):
            if np.any(chosen):
                out[chosen] = self._carried(start, float(end), times[chosen], sky)
        return out[:, :3], out[:, 3:]

    def _carried(
        self, start: FloatArray, end_s: float, times: FloatArray, sky: "_Sky"
    ) -> FloatArray:
        if end_s == 0.0:
            return np.tile(start, (len(times), 1))
        from scipy.integrate import solve_ivp

        unique, where = np.unique(times, return_inverse=True)
        ordered = unique if end_s > 0.0 else unique[::-1]
        solved = solve_ivp(
            lambda t, y: np.concatenate([y[3:], self._acceleration(y[:3], t, sky)]),
            (0.0, end_s),
            start,
            method="DOP853",
            t_eval=ordered,
            rtol=_TOLERANCE,
            atol=np.repeat([1e-7, 1e-10], 3),
            events=_come_down,
        )
        found = np.full((len(unique), 6), np.nan)
        found[: solved.y.shape[1]] = solved.y.T
        return found[where] if end_s > 0.0 else found[::-1][where]

    def _acceleration(self, r: FloatArray, t_s: float, sky: "_Sky") -> FloatArray:
        d2 = float(r @ r)
        d = d2**0.5
        total = (-self.mu / (d2 * d)) * r + self._zonal(r, d, sky.pole)
        total += self._sectorial(r, d, t_s, sky)
        moon, sun = sky.bodies(t_s)
        total += _pull(MU_MOON_KM3_S2, moon, r) + _pull(MU_SUN_KM3_S2, sun, r)
        if self.area_to_mass_m2_kg:
            total += self._push(r, t_s, sun)
        return np.asarray(total)

    def _zonal(self, r: FloatArray, d: float, pole: FloatArray) -> FloatArray:
        s = float(r @ pole) / d
        legendre = (
            (1.5 * s * s - 0.5, 3.0 * s),
            (2.5 * s**3 - 1.5 * s, 7.5 * s * s - 1.5),
            (4.375 * s**4 - 3.75 * s * s + 0.375, 17.5 * s**3 - 7.5 * s),
        )
        outward = axial = 0.0
        for degree, (j, (p, dp)) in enumerate(zip(ZONALS, legendre, strict=True), start=2):
            scale = self.mu / (d * d) * j * (EARTH_RADIUS_KM / d) ** degree
            outward += scale * ((degree + 1) * p + s * dp)
            axial -= scale * dp
        return (outward / d) * r + axial * pole

    def _sectorial(self, r: FloatArray, d: float, t_s: float, sky: "_Sky") -> FloatArray:
        """Degree and order 2: what draws geostationary satellites along the equator."""
        x_axis, y_axis = sky.prime(t_s)
        x, y = float(r @ x_axis), float(r @ y_axis)
        scale = 3.0 * self.mu * EARTH_RADIUS_KM**2 / d**5
        form = C22 * (x * x - y * y) + 2.0 * S22 * x * y
        along_x = 2.0 * (C22 * x + S22 * y)
        along_y = 2.0 * (S22 * x - C22 * y)
        return np.asarray(scale * (along_x * x_axis + along_y * y_axis - 5.0 * form / (d * d) * r))

    def _push(self, r: FloatArray, t_s: float, sun: FloatArray) -> FloatArray:
        away = r - sun
        distance = float(np.linalg.norm(away))
        # Only near the shadow is it worth asking how much of the disc is seen.
        behind = float(r @ sun) < 0.0
        aside = np.linalg.norm(np.cross(r, sun)) / np.linalg.norm(sun)
        lit = 1.0
        if behind and aside < 1.2 * EARTH_RADIUS_KM:
            lit = float(lit_fraction(r, self.epoch_utc_ns + int(t_s * NS_PER_S)))
        pressure = SUN_PRESSURE_N_M2 * (AU_KM / distance) ** 2 * self.area_to_mass_m2_kg / 1000.0
        return np.asarray(lit * pressure / distance * away)

    def _sky(self, first_s: float, last_s: float) -> "_Sky":
        for known in self._tables:
            if known.first_s <= first_s and known.last_s >= last_s:
                return known  # type: ignore[no-any-return]
        table = _sky_between(self.epoch_utc_ns, first_s, last_s)
        self._tables[:] = [table]
        return table


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sky:
    """Earth's axis, Moon and Sun over a span, ready to be asked often."""

    first_s: float
    last_s: float
    pole: FloatArray
    spline: Any
    x_axis: FloatArray
    y_axis: FloatArray
    era_rad: float

    def bodies(self, t_s: float) -> tuple[FloatArray, FloatArray]:
        """Moon and Sun (3,) from the Earth's centre, km."""
        both = self.spline(t_s)
        return both[:3], both[3:]

    def prime(self, t_s: float) -> tuple[FloatArray, FloatArray]:
        """Axes through longitudes 0 and 90 degrees."""
        angle = self.era_rad + 7.292_115_146_706_979e-5 * t_s
        c, s = np.cos(angle), np.sin(angle)
        return c * self.x_axis + s * self.y_axis, c * self.y_axis - s * self.x_axis


def _sky_between(epoch_utc_ns: int, first_s: float, last_s: float) -> _Sky:
    import erfa
    from scipy.interpolate import CubicSpline

    first, last = first_s - 2.0 * _KNOT_S, last_s + 2.0 * _KNOT_S
    knots = np.linspace(first, last, int((last - first) / _KNOT_S) + 2)
    at = epoch_utc_ns + (knots * NS_PER_S).astype(np.int64)
    rotation = cirs_to_gcrs(epoch_utc_ns + int((first_s + last_s) / 2.0 * NS_PER_S))
    return _Sky(
        first_s=first_s,
        last_s=last_s,
        pole=rotation[:, 2],
        spline=CubicSpline(knots, np.concatenate([moon_gcrs_km(at), sun_gcrs_km(at)], axis=-1)),
        x_axis=rotation[:, 0],
        y_axis=rotation[:, 1],
        era_rad=float(erfa.era00(*jd_ut1(epoch_utc_ns))),
    )


def _pull(mu: float, body: FloatArray, r: FloatArray) -> FloatArray:
    """Of a far body on the object, less that on the Earth; without loss of digits (Battin 8.61)."""
    away = r - body
    q = float(r @ (r - 2.0 * body)) / float(body @ body)
    f = q * (3.0 + 3.0 * q + q * q) / (1.0 + (1.0 + q) ** 1.5)
    return np.asarray(-mu / float(away @ away) ** 1.5 * (r + f * body))


def _come_down(_t_s: float, y: FloatArray) -> float:
    return float(y[0] ** 2 + y[1] ** 2 + y[2] ** 2) - EARTH_RADIUS_KM**2


_come_down.terminal = True  # type: ignore[attr-defined]
