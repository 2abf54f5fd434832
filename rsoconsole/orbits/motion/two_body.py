"""Motion about a point mass: states propagated to any time, elements of a state. Pure.

Kilometres, seconds, km/s along any inertial axes. Source: Battin 1999, An Introduction to the
Mathematics and Methods of Astrodynamics, chapter 4 for the motion, chapter 9 for its slopes.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rsoconsole.orbits.motion._universal import (
    reduce_to_period,
    universal_anomaly,
    universal_functions,
    universal_functions_u4_u5,
)
from rsoconsole.records import FloatArray

MU_EARTH_KM3_S2 = 398_600.4418
"""Gravitational parameter of the Earth with its atmosphere, IERS Conventions 2010."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Elements:
    """Osculating elements of a bound or unbound orbit; angles in degrees, 0 to 360."""

    a_km: float
    """Semi-major axis; negative for a hyperbola."""
    e: float
    i_deg: float
    raan_deg: float
    """Right ascension of the ascending node; 0 where the orbit lies in the reference plane."""
    argp_deg: float
    """Argument of perigee; 0 for a circle, whose anomaly counts from the node."""
    m_deg: float
    """Mean anomaly; for a hyperbola any number, negative before perigee."""


def propagate(
    r_km: npt.ArrayLike, v_km_s: npt.ArrayLike, dt_s: npt.ArrayLike, mu: float = MU_EARTH_KM3_S2
) -> tuple[FloatArray, FloatArray]:
    """Propagate states by ``dt_s`` along any conic; return positions and velocities.

    ``r_km``, ``v_km_s`` (..., 3), ``dt_s`` (...), of any sign; all broadcast. NaN where there is no
    numerical solution.
    """
    with np.errstate(all="ignore"):
        moved = _moved(r_km, v_km_s, dt_s, mu)
    return moved.r_km, moved.v_km_s


def propagate_with_slopes(
    r_km: FloatArray, v_km_s: FloatArray, dt_s: FloatArray, mu: float = MU_EARTH_KM3_S2
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Propagate one state (3,), (3,) to times (N,); return positions, velocities and slopes.

    Slopes (N, 3, 6): derivatives of the position by the first position and velocity, exact after
    any number of revolutions. Positions and velocities (N, 3).
    """
    with np.errstate(all="ignore"):
        moved = _moved(r_km, v_km_s, dt_s, mu)
        whole = np.where(moved.alpha > 0.0, dt_s - moved.dt_s, 0.0)  # seconds of revolutions
        chi = moved.chi + whole * np.sqrt(mu) * np.maximum(moved.alpha, 0.0)
        u4, u5 = universal_functions_u4_u5(chi, moved.alpha)
        root = np.sqrt(mu)
        c = (3.0 * u5 - chi * u4) / root - dt_s * moved.u2
        r0, v0, radius = moved.r0_km, moved.v0_km_s, moved.radius
        by_r = _outer(moved.v_km_s - v0, moved.v_km_s - v0) * (moved.new_radius / mu)[:, None, None]
        by_r += _outer(moved.r_km, r0) * (moved.u2 / radius**3)[:, None, None]
        by_r += _outer(moved.v_km_s, r0) * (c / radius**3)[:, None, None]
        by_r += moved.f[:, None, None] * np.eye(3)
        by_v = _outer(moved.r_km - r0, v0) - _outer(moved.v_km_s - v0, r0)
        by_v = by_v * (moved.u2 / mu)[:, None, None]
        by_v += _outer(moved.v_km_s, v0) * (c / mu)[:, None, None]
        by_v += moved.g[:, None, None] * np.eye(3)
    return moved.r_km, moved.v_km_s, np.concatenate([by_r, by_v], axis=-1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Moved:
    """Motion from one state to another, with the quantities of its solution."""

    r0_km: FloatArray
    v0_km_s: FloatArray
    r_km: FloatArray
    v_km_s: FloatArray
    dt_s: FloatArray
    """Time to the same place, at most half a revolution away."""
    alpha: FloatArray
    chi: FloatArray
    u2: FloatArray
    f: FloatArray
    g: FloatArray
    radius: FloatArray
    new_radius: FloatArray


def _moved(r_km: npt.ArrayLike, v_km_s: npt.ArrayLike, dt_s: npt.ArrayLike, mu: float) -> _Moved:
    r0, v0 = np.asarray(r_km, float), np.asarray(v_km_s, float)
    distance_2, along, speed_2 = dot(r0, r0), dot(r0, v0), dot(v0, v0)
    radius = np.sqrt(distance_2)
    sigma, alpha = along / np.sqrt(mu), 2.0 / radius - speed_2 / mu
    h_2 = (distance_2 * speed_2 - along * along) / mu
    dt = reduce_to_period(np.asarray(dt_s, float), alpha, mu)
    radius, sigma, alpha, h_2, dt = np.broadcast_arrays(radius, sigma, alpha, h_2, dt)
    flat = (each.ravel() for each in (radius, sigma, alpha, h_2, dt * np.sqrt(mu)))
    chi = universal_anomaly(*flat).reshape(radius.shape)
    u0, u1, u2, _ = universal_functions(chi, alpha)
    new_radius = radius * u0 + sigma * u1 + u2
    f = 1.0 - u2 / radius
    g = (radius * u1 + sigma * u2) / np.sqrt(mu)
    f_dot = -np.sqrt(mu) * u1 / (new_radius * radius)
    g_dot = 1.0 - u2 / new_radius
    return _Moved(
        r0_km=r0,
        v0_km_s=v0,
        r_km=f[..., None] * r0 + g[..., None] * v0,
        v_km_s=f_dot[..., None] * r0 + g_dot[..., None] * v0,
        dt_s=dt,
        alpha=alpha,
        chi=chi,
        u2=u2,
        f=f,
        g=g,
        radius=radius,
        new_radius=new_radius,
    )


def _outer(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray(one[..., :, None] * other[..., None, :])


def osculating_elements(
    r_km: npt.ArrayLike, v_km_s: npt.ArrayLike, mu: float = MU_EARTH_KM3_S2
) -> Elements:
    """Compute osculating elements of one state, on the axes of the state."""
    r, v = np.asarray(r_km, float), np.asarray(v_km_s, float)
    radius = float(np.linalg.norm(r))
    h = _cross_of_one(r, v)
    node = np.array([-h[1], h[0], 0.0])
    if np.hypot(h[0], h[1]) < 1e-12 * np.linalg.norm(h):
        node = np.array([1.0, 0.0, 0.0])
    node /= np.linalg.norm(node)
    pole = h / np.linalg.norm(h)
    e_vector = _cross_of_one(v, h) / mu - r / radius
    e = float(np.linalg.norm(e_vector))
    a_km, i_deg = _axis_km(radius, v, mu), _inclination_deg(h)
    argp = _angle(node, e_vector, pole) if e > 1e-12 else 0.0
    true = _angle(node, r, pole) - argp
    return Elements(
        a_km=a_km,
        e=e,
        i_deg=i_deg,
        raan_deg=float(np.degrees(np.arctan2(node[1], node[0])) % 360.0),
        argp_deg=float(np.degrees(argp) % 360.0),
        m_deg=_mean_anomaly_deg(true, e),
    )


def axis_and_inclination(
    r_km: npt.ArrayLike, v_km_s: npt.ArrayLike, mu: float = MU_EARTH_KM3_S2
) -> tuple[float, float]:
    """Semi-major axis (km) and inclination (degrees), quicker than by ``osculating_elements``."""
    r, v = np.asarray(r_km, float), np.asarray(v_km_s, float)
    axis_km = _axis_km(float(np.linalg.norm(r)), v, mu)
    return axis_km, _inclination_deg(_cross_of_one(r, v))


def _axis_km(radius: float, v: FloatArray, mu: float) -> float:
    return float(1.0 / (2.0 / radius - v @ v / mu))


def _inclination_deg(h: FloatArray) -> float:
    return float(np.degrees(np.arctan2(np.hypot(h[0], h[1]), h[2])))


def eccentricity_vector(
    r: FloatArray, v: FloatArray, mu: float = MU_EARTH_KM3_S2
) -> tuple[FloatArray, FloatArray]:
    """Eccentricity vector (3,), towards the perigee; and its slopes (3, 6) by the state."""
    radius = float(np.sqrt(r @ r))
    near, along = float(v @ v) - mu / radius, float(r @ v)
    by_r = near * np.eye(3) + mu / radius**3 * np.outer(r, r) - np.outer(v, v)
    by_v = 2.0 * np.outer(r, v) - np.outer(v, r) - along * np.eye(3)
    return (near * r - along * v) / mu, np.concatenate([by_r, by_v], axis=-1) / mu


def semi_major_axis(
    r: FloatArray, v: FloatArray, mu: float = MU_EARTH_KM3_S2
) -> tuple[float, FloatArray]:
    """Return the semi-major axis, km, and its gradient (6,) with respect to position, km, and
    velocity, km/s.
    """
    radius = float(np.sqrt(r @ r))
    a_km = 1.0 / (2.0 / radius - float(v @ v) / mu)
    return a_km, 2.0 * a_km * a_km * np.concatenate([r / radius**3, v / mu])


def period_s(a_km: float, mu: float = MU_EARTH_KM3_S2) -> float:
    """Time of one revolution; infinite for an unbound orbit."""
    return float(2.0 * np.pi * np.sqrt(a_km**3 / mu)) if a_km > 0.0 else float("inf")


def _angle(start: FloatArray, end: FloatArray, pole: FloatArray) -> float:
    """Angle from one direction to another, turning about the pole."""
    return float(np.arctan2(_cross_of_one(start, end) @ pole, start @ end))


def _mean_anomaly_deg(true_rad: float, e: float) -> float:
    if e < 1.0:
        half = np.arctan2(
            np.sqrt(1.0 - e) * np.sin(true_rad / 2.0), np.sqrt(1.0 + e) * np.cos(true_rad / 2.0)
        )
        eccentric = 2.0 * half
        return float(np.degrees(eccentric - e * np.sin(eccentric)) % 360.0)
    half = np.sqrt((e - 1.0) / (e + 1.0)) * np.tan(true_rad / 2.0)
    hyperbolic = 2.0 * np.arctanh(half)
    return float(np.degrees(e * np.sinh(hyperbolic) - hyperbolic))


def dot(one: FloatArray, other: FloatArray) -> FloatArray:
    """Dot products (...) of vectors (..., 3)."""
    return np.asarray(np.einsum("...i,...i->...", one, other))


def cross(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return cross products (..., 3), for few vectors in a third of numpy's time."""
    ax, ay, az = one[..., 0], one[..., 1], one[..., 2]
    bx, by, bz = other[..., 0], other[..., 1], other[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def _cross_of_one(one: FloatArray, other: FloatArray) -> FloatArray:
    """Cross product (3,) of two vectors (3,): plain floats, because numpy takes ten times as
    long.
    """
    (ax, ay, az), (bx, by, bz) = one.tolist(), other.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


@dataclass(frozen=True, slots=True, kw_only=True)
class TwoBodyPropagator:
    """Propagator about the Earth as a point mass."""

    def states(
        self, r_km: FloatArray, v_km_s: FloatArray, t_s: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Propagate a state (3,), (3,) by times (N,), s; return positions and velocities (N, 3)."""
        return propagate(r_km, v_km_s, np.atleast_1d(np.asarray(t_s, float)))
