"""Motion about the real Earth: zonal harmonics, Moon, Sun, and radiation pressure. Pure.

Predictions beyond an hour need these forces: about a point mass a geostationary satellite is 3
arcsec off after four hours and minutes of arc after a day. Source of the forces: Montenbruck & Gill
2000, Satellite Orbits, 3.2 to 3.4; zonal coefficients of EGM96, with the sectorial pair that also
moves geostationary satellites; Sun and Moon by IAU SOFA. Integrated by Dormand and Prince's eighth
order (scipy's DOP853). Kilometres, seconds, along GCRS axes.

The sums use plain floats: for three numbers at a time numpy takes five times as long.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from math import acos, asin, ceil, cos, floor, pi, sin, sqrt
from typing import Protocol

import numpy as np

from rsoconsole.orbits.motion.two_body import MU_EARTH_KM3_S2
from rsoconsole.records import FloatArray
from rsoconsole.sky import (
    AU_KM,
    EARTH_RADIUS_KM,
    SUN_RADIUS_KM,
    cirs_to_gcrs,
    jd_ut1,
    moon_gcrs_km,
    sun_gcrs_km,
)
from rsoconsole.words import NS_PER_S

MU_SUN_KM3_S2 = 1.327_124_400_18e11
MU_MOON_KM3_S2 = 4_902.800_066
J2, J3, J4 = 1.082_626_68e-3, -2.532_656_48e-6, -1.619_621_59e-6
C22, S22 = 1.574_536e-6, -9.038_68e-7
"""Sectorial coefficients of degree and order 2, unnormalised."""
EARTH_TURN_RAD_S = 7.292_115_146_706_979e-5
SUN_PRESSURE_N_M2 = 4.56e-6
"""Radiation pressure at one astronomical unit."""
AREA_TO_MASS_M2_KG = 0.026
"""Area over mass, 0.02 m2/kg, times reflectivity, 1.3, of a usual geostationary satellite."""
_KNOT_S = 3600
_BLOCK_S = 6 * _KNOT_S
_TOLERANCE = 1e-10
_FIRST_STEP = 0.1
"""First step, as a share of the time of one radian of a circular orbit."""
_NEAR_SHADOW_KM_2 = (1.2 * EARTH_RADIUS_KM) ** 2

Vector = tuple[float, float, float]


class Propagator(Protocol):
    """Interface of a propagator of states through time."""

    def states(
        self, r_km: FloatArray, v_km_s: FloatArray, t_s: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Propagate a state (3,), (3,) to times (N,); return positions and velocities (N, 3).

        Times are in seconds since the epoch of the state, of any sign.
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class PerturbedPropagator:
    """Propagation with zonal harmonics, Moon, Sun and radiation pressure."""

    epoch_utc_ns: int
    area_to_mass_m2_kg: float = AREA_TO_MASS_M2_KG
    """Area over mass times the reflectivity; 0: no radiation pressure."""
    _fields: list["_Field"] = field(default_factory=list, repr=False, compare=False)

    def states(
        self, r_km: FloatArray, v_km_s: FloatArray, t_s: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Propagate a state (3,), (3,) to times (N,); return positions and velocities (N, 3).

        The state is that at ``epoch_utc_ns``; times are in seconds since then, of any sign. NaN
        where the object has decayed.
        """
        times = np.atleast_1d(np.asarray(t_s, float))
        out = np.full((len(times), 6), np.nan)
        start = np.concatenate([r_km, v_km_s])
        if len(times) and np.all(np.isfinite(start)):
            field_ = self._field(float(min(times.min(), 0.0)), float(max(times.max(), 0.0)))
            for chosen in (times >= 0.0, times < 0.0):
                if np.any(chosen):
                    out[chosen] = _carried(field_, start, times[chosen])
        return out[:, :3], out[:, 3:]

    def _field(self, first_s: float, last_s: float) -> "_Field":
        """Field that covers the span, at best one that has been computed before."""
        for known in self._fields:
            if known.first_s <= first_s and known.last_s >= last_s:
                return known
        made = _Field(self, first_s, last_s)
        self._fields[:] = [made]  # another thread may put its own there at this moment
        return made


def _carried(field_: "_Field", start: FloatArray, times: FloatArray) -> FloatArray:
    """States (N, 6) at times that lie on one side of the epoch."""
    from scipy.integrate import solve_ivp

    unique, where = np.unique(np.abs(times), return_inverse=True)
    sign = -1.0 if times[0] < 0.0 else 1.0
    if unique[-1] == 0.0:
        return np.tile(start, (len(times), 1))
    span_s, distance_km = float(unique[-1]), float(np.linalg.norm(start[:3]))
    solved = solve_ivp(
        field_,
        (0.0, sign * span_s),
        start,
        method="DOP853",
        first_step=min(_FIRST_STEP * sqrt(distance_km**3 / MU_EARTH_KM3_S2), span_s),
        t_eval=sign * unique,
        rtol=_TOLERANCE,
        atol=np.repeat([1e-7, 1e-10], 3),
        events=_come_down,
    )
    found = np.full((len(unique), 6), np.nan)
    found[: len(solved.t)] = np.reshape(solved.y, (6, -1)).T
    return found[where]


@lru_cache(maxsize=8)
def _bodies(first_block: int, last_block: int) -> tuple[float, list[list[list[float]]]]:
    """Coefficients of Moon and Sun over whole blocks of time, for all objects alike.

    The first knot, seconds of UTC since 1970, and per interval and coordinate the four
    coefficients of a cubic, the highest first.
    """
    from scipy.interpolate import CubicSpline

    first, last = first_block * _BLOCK_S - 2 * _KNOT_S, last_block * _BLOCK_S + 2 * _KNOT_S
    knots = np.arange(first, last + 1, _KNOT_S)
    at = knots * NS_PER_S
    places = np.concatenate([moon_gcrs_km(at), sun_gcrs_km(at)], axis=-1)
    cubics = CubicSpline((knots - first).astype(float), places).c
    return float(first), np.moveaxis(cubics, 0, -1).tolist()


class _Field:
    """The acceleration everywhere over a span; axis, Moon and Sun are computed once."""

    def __init__(self, forces: PerturbedPropagator, first_s: float, last_s: float) -> None:
        import erfa

        self.first_s, self.last_s = first_s, last_s
        self._push_km = SUN_PRESSURE_N_M2 * AU_KM**2 * forces.area_to_mass_m2_kg / 1000.0
        epoch_s, epoch_ns = divmod(forces.epoch_utc_ns, NS_PER_S)
        first_block = floor((epoch_s + first_s) / _BLOCK_S)
        last_block = floor((epoch_s + last_s) / _BLOCK_S) + 1
        first_knot_s, self._cubics = _bodies(first_block, last_block)
        self._since_knot_s = epoch_s - first_knot_s + epoch_ns / NS_PER_S
        middle = forces.epoch_utc_ns + int((first_s + last_s) / 2.0 * NS_PER_S)
        self._x_axis, self._y_axis, self._pole = cirs_to_gcrs(middle).T.tolist()
        self._turned_rad = float(erfa.era00(*jd_ut1(forces.epoch_utc_ns)))

    def __call__(self, t_s: float, state: FloatArray) -> list[float]:
        """Velocity and acceleration, for an integrator."""
        x, y, z, vx, vy, vz = state.tolist()
        r = (x, y, z)
        moon, sun = self._bodies(t_s)
        parts = [
            self._earth(r, t_s),
            _pull(MU_MOON_KM3_S2, moon, r),
            _pull(MU_SUN_KM3_S2, sun, r),
            self._sunlight(r, sun),
        ]
        ax, ay, az = (sum(each) for each in zip(*parts, strict=True))
        return [vx, vy, vz, ax, ay, az]

    def _earth(self, r: Vector, t_s: float) -> Vector:
        """Acceleration by the Earth: the point mass, J2 to J4 about the axis, and degree and order
        2 along the equator.
        """
        d2 = _dot(r, r)
        d = sqrt(d2)
        pole = self._pole
        s = _dot(r, pole) / d
        s2, q = s * s, EARTH_RADIUS_KM / d
        p2, p3 = 1.5 * s2 - 0.5, (2.5 * s2 - 1.5) * s
        p4 = (4.375 * s2 - 3.75) * s2 + 0.375
        slope = (
            q * q * (J2 * 3.0 * s + q * (J3 * (7.5 * s2 - 1.5) + q * J4 * (17.5 * s2 - 7.5) * s))
        )
        swell = q * q * (J2 * 3.0 * p2 + q * (J3 * 4.0 * p3 + q * J4 * 5.0 * p4))
        angle = self._turned_rad + EARTH_TURN_RAD_S * t_s
        c, n = cos(angle), sin(angle)
        east, west = _dot(r, self._x_axis), _dot(r, self._y_axis)
        x, y = c * east + n * west, c * west - n * east
        scale = 3.0 * MU_EARTH_KM3_S2 * EARTH_RADIUS_KM**2 / (d2 * d2 * d)
        form = C22 * (x * x - y * y) + 2.0 * S22 * x * y
        along_x, along_y = 2.0 * (C22 * x + S22 * y), 2.0 * (S22 * x - C22 * y)
        outward = MU_EARTH_KM3_S2 / (d2 * d) * (swell + s * slope - 1.0) - scale * 5.0 * form / d2
        axial = -MU_EARTH_KM3_S2 / d2 * slope
        first, second = scale * (c * along_x - n * along_y), scale * (n * along_x + c * along_y)
        x_axis, y_axis = self._x_axis, self._y_axis
        return (
            outward * r[0] + axial * pole[0] + first * x_axis[0] + second * y_axis[0],
            outward * r[1] + axial * pole[1] + first * x_axis[1] + second * y_axis[1],
            outward * r[2] + axial * pole[2] + first * x_axis[2] + second * y_axis[2],
        )

    def _sunlight(self, r: Vector, sun: Vector) -> Vector:
        if self._push_km == 0.0:
            return (0.0, 0.0, 0.0)
        away = (r[0] - sun[0], r[1] - sun[1], r[2] - sun[2])
        d2 = _dot(away, away)
        push = self._push_km / (d2 * sqrt(d2)) * _lit(r, sun)
        return (push * away[0], push * away[1], push * away[2])

    def _bodies(self, t_s: float) -> tuple[Vector, Vector]:
        """Moon and Sun from the Earth's centre, km."""
        since_s = t_s + self._since_knot_s
        n = min(max(int(since_s / _KNOT_S), 0), len(self._cubics) - 1)
        u = since_s - n * _KNOT_S
        a, b, c, d, e, f = (((c3 * u + c2) * u + c1) * u + c0 for c3, c2, c1, c0 in self._cubics[n])
        return (a, b, c), (d, e, f)


def _dot(one: Sequence[float], other: Sequence[float]) -> float:
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


def _lit(r: Vector, sun: Vector) -> float:
    """Share of the Sun's disc seen past the Earth: `lit_fraction` of one place."""
    along = _dot(r, sun)
    if along > 0.0 or _dot(r, r) - along * along / _dot(sun, sun) > _NEAR_SHADOW_KM_2:
        return 1.0
    to_sun = (sun[0] - r[0], sun[1] - r[1], sun[2] - r[2])
    far, near = sqrt(_dot(to_sun, to_sun)), sqrt(_dot(r, r))
    a, b = asin(SUN_RADIUS_KM / far), asin(min(EARTH_RADIUS_KM / near, 1.0))
    c = acos(min(max(-_dot(r, to_sun) / (near * far), -1.0), 1.0))
    if c >= a + b:
        return 1.0
    if c <= b - a:
        return 0.0
    x = (c * c + a * a - b * b) / (2.0 * c)
    y = sqrt(max(a * a - x * x, 0.0))
    covered = a * a * acos(min(max(x / a, -1.0), 1.0)) - c * y
    covered += b * b * acos(min(max((c - x) / b, -1.0), 1.0))
    return 1.0 - covered / (pi * a * a)


def _pull(mu: float, body: Vector, r: Vector) -> Vector:
    """Attraction of a far body on the object, less that on the Earth.

    Without loss of digits (Battin 8.61).
    """
    x, y, z = r
    bx, by, bz = body
    ax, ay, az = x - bx, y - by, z - bz
    q = (x * (ax - bx) + y * (ay - by) + z * (az - bz)) / (bx * bx + by * by + bz * bz)
    f = q * (3.0 + 3.0 * q + q * q) / (1.0 + (1.0 + q) ** 1.5)
    scale = -mu / (ax * ax + ay * ay + az * az) ** 1.5
    return (scale * (x + f * bx), scale * (y + f * by), scale * (z + f * bz))


def _come_down(_t_s: float, y: FloatArray) -> float:
    return float(y[0] ** 2 + y[1] ** 2 + y[2] ** 2) - EARTH_RADIUS_KM**2


_come_down.terminal = True  # type: ignore[attr-defined]


STEP_S = 20.0
"""Step of the zonal integration, s; its error is a tenth of a millimetre at 400 km."""
_State = tuple[float, float, float, float, float, float]


@lru_cache(maxsize=16)
def _pole(day: int) -> Vector:
    """The Earth's axis at noon of a day since 1970."""
    x, y, z = cirs_to_gcrs((day * 86_400 + 43_200) * 1_000_000_000)[:, 2].tolist()
    return x, y, z


@dataclass(frozen=True, slots=True, kw_only=True)
class ZonalPropagator:
    """Propagator with the Earth's gravity alone, symmetric about its axis."""

    epoch_utc_ns: int

    def states(
        self, r_km: FloatArray, v_km_s: FloatArray, t_s: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Propagate a state (3,), (3,) to times (N,); return positions and velocities (N, 3).

        The state is that at ``epoch_utc_ns``; times are in seconds since then, of any sign. NaN
        where the object has decayed.
        """
        times = np.atleast_1d(np.asarray(t_s, float))
        out = np.full((len(times), 6), np.nan)
        start = np.concatenate([r_km, v_km_s])
        if not np.all(np.isfinite(start)):
            return out[:, :3], out[:, 3:]
        pole = _pole(self.epoch_utc_ns // 86_400_000_000_000)
        for step_s, chosen in ((STEP_S, times >= 0.0), (-STEP_S, times < 0.0)):
            if np.any(chosen):
                out[chosen] = _carried_zonal(start, times[chosen], step_s, pole)
        return out[:, :3], out[:, 3:]


def _carried_zonal(start: FloatArray, times: FloatArray, step_s: float, pole: Vector) -> FloatArray:
    """Propagated states (N, 6) on one side of the epoch: between whole steps by Hermite's cubic."""
    steps = max(1, ceil(float(np.max(np.abs(times))) / abs(step_s)))
    states = np.full((steps + 1, 6), np.nan)
    slopes = np.full((steps + 1, 6), np.nan)
    y: _State = tuple(start.tolist())
    for n in range(steps + 1):
        k1 = _slope(y, pole)
        states[n], slopes[n] = y, k1
        if y[0] ** 2 + y[1] ** 2 + y[2] ** 2 < EARTH_RADIUS_KM**2:
            break
        k2 = _slope(_moved(y, k1, step_s / 2.0), pole)
        k3 = _slope(_moved(y, k2, step_s / 2.0), pole)
        k4 = _slope(_moved(y, k3, step_s), pole)
        mean = tuple(
            (a + 2.0 * (b + c) + d) / 6.0 for a, b, c, d in zip(k1, k2, k3, k4, strict=True)
        )
        y = _moved(y, mean, step_s)  # type: ignore[arg-type]
    n = np.minimum((times / step_s).astype(int), steps - 1)
    u = (times / step_s - n)[:, None]
    before, after = states[n], states[n + 1]
    # Positions by a quintic would want more slopes; velocities are the cubic's of their own.
    h00, h10 = (1.0 + 2.0 * u) * (1.0 - u) ** 2, u * (1.0 - u) ** 2
    h01, h11 = u * u * (3.0 - 2.0 * u), u * u * (u - 1.0)
    return np.asarray(h00 * before + h01 * after + step_s * (h10 * slopes[n] + h11 * slopes[n + 1]))


def _moved(y: _State, slope: _State, step_s: float) -> _State:
    return (
        y[0] + step_s * slope[0],
        y[1] + step_s * slope[1],
        y[2] + step_s * slope[2],
        y[3] + step_s * slope[3],
        y[4] + step_s * slope[4],
        y[5] + step_s * slope[5],
    )


def _slope(y: _State, pole: Vector) -> _State:
    """Velocity and acceleration. Source: Montenbruck & Gill 2000, 3.2; as in `forces`."""
    x, y_, z, vx, vy, vz = y
    px, py, pz = pole
    d2 = x * x + y_ * y_ + z * z
    d = sqrt(d2)
    s, q = (x * px + y_ * py + z * pz) / d, EARTH_RADIUS_KM / d
    s2 = s * s
    j2, j3, j4 = J2 * q * q, J3 * q * q * q, J4 * q * q * q * q
    slope = j2 * 3.0 * s + j3 * (7.5 * s2 - 1.5) + j4 * (17.5 * s2 - 7.5) * s
    swell = (
        j2 * 3.0 * (1.5 * s2 - 0.5)
        + j3 * 4.0 * (2.5 * s2 - 1.5) * s
        + j4 * 5.0 * ((4.375 * s2 - 3.75) * s2 + 0.375)
    )
    pull = MU_EARTH_KM3_S2 / d2
    outward, axial = pull / d * (swell + s * slope - 1.0), -pull * slope
    return (
        vx,
        vy,
        vz,
        outward * x + axial * px,
        outward * y_ + axial * py,
        outward * z + axial * pz,
    )
