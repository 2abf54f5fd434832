"""Motion about a point mass: states carried through any time, elements of a state. Pure.

Kilometres, seconds, km/s along any inertial axes. Universal variables after Battin (1999, An
Introduction to the Mathematics and Methods of Astrodynamics, 4.5 and 4.6), solved by the Laguerre
iteration of Conway (1986, Celestial Mechanics 39, 199), which converges from anywhere.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray

MU_EARTH_KM3_S2 = 398_600.4418
"""IERS Conventions 2010, without the atmosphere's share left out."""
_MOST_STEPS = 60
_ENOUGH = 1e-8
"""A step so small leaves an error of its third power."""
_LAGUERRE_DEGREE = 5.0
_SERIES_BELOW = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Elements:
    """Osculating elements of a bound or unbound orbit; angles in degrees, 0 to 360."""

    a_km: float
    """Negative for a hyperbola."""
    e: float
    i_deg: float
    raan_deg: float
    """0 where the orbit lies in the reference plane."""
    argp_deg: float
    """0 for a circle: the anomaly then counts from the node."""
    m_deg: float
    """Mean anomaly; of a hyperbola 0 to infinity either way."""


def propagate(
    r_km: npt.ArrayLike,
    v_km_s: npt.ArrayLike,
    dt_s: npt.ArrayLike,
    mu: float = MU_EARTH_KM3_S2,
) -> tuple[FloatArray, FloatArray]:
    """Position and velocity (..., 3) after ``dt_s`` (...), of states (..., 3); all broadcast.

    Any conic, forwards and backwards. What has no solution in numbers comes out as NaN.
    """
    r0, v0 = np.asarray(r_km, float), np.asarray(v_km_s, float)
    shape = np.broadcast_shapes(r0.shape[:-1], v0.shape[:-1], np.shape(dt_s))
    dt = np.broadcast_to(np.asarray(dt_s, float), shape)
    r0 = np.broadcast_to(r0, (*shape, 3))
    v0 = np.broadcast_to(v0, (*shape, 3))
    radius = np.sqrt(np.sum(r0 * r0, axis=-1))
    sigma = np.sum(r0 * v0, axis=-1) / np.sqrt(mu)
    alpha = 2.0 / radius - np.sum(v0 * v0, axis=-1) / mu
    with np.errstate(all="ignore"):
        chi = _universal_anomaly(radius, sigma, alpha, _within_period(dt, alpha, mu) * np.sqrt(mu))
        u0, u1, u2, u3 = _universal_functions(chi, alpha)
        new_radius = radius * u0 + sigma * u1 + u2
        f = 1.0 - u2 / radius
        g = (radius * u1 + sigma * u2) / np.sqrt(mu)
        f_dot = -np.sqrt(mu) * u1 / (new_radius * radius)
        g_dot = 1.0 - u2 / new_radius
    _ = u3
    r = f[..., None] * r0 + g[..., None] * v0
    v = f_dot[..., None] * r0 + g_dot[..., None] * v0
    return np.asarray(r), np.asarray(v)


def elements_of(
    r_km: npt.ArrayLike, v_km_s: npt.ArrayLike, mu: float = MU_EARTH_KM3_S2
) -> Elements:
    """Osculating elements of one state, on the axes that it is given on."""
    r, v = np.asarray(r_km, float), np.asarray(v_km_s, float)
    radius = float(np.linalg.norm(r))
    h = np.cross(r, v)
    node = np.array([-h[1], h[0], 0.0])
    if np.hypot(h[0], h[1]) < 1e-12 * np.linalg.norm(h):
        node = np.array([1.0, 0.0, 0.0])
    node /= np.linalg.norm(node)
    pole = h / np.linalg.norm(h)
    e_vector = np.cross(v, h) / mu - r / radius
    e = float(np.linalg.norm(e_vector))
    a_km = float(1.0 / (2.0 / radius - v @ v / mu))
    argp = _angle(node, e_vector, pole) if e > 1e-12 else 0.0
    true = _angle(node, r, pole) - argp
    return Elements(
        a_km=a_km,
        e=e,
        i_deg=float(np.degrees(np.arctan2(np.hypot(h[0], h[1]), h[2]))),
        raan_deg=float(np.degrees(np.arctan2(node[1], node[0])) % 360.0),
        argp_deg=float(np.degrees(argp) % 360.0),
        m_deg=_mean_anomaly_deg(true, e),
    )


def period_s(a_km: float, mu: float = MU_EARTH_KM3_S2) -> float:
    """Time of one revolution; infinite for an unbound orbit."""
    return float(2.0 * np.pi * np.sqrt(a_km**3 / mu)) if a_km > 0.0 else float("inf")


def _angle(start: FloatArray, end: FloatArray, pole: FloatArray) -> float:
    """From one direction to another, turning about the pole."""
    return float(np.arctan2(np.cross(start, end) @ pole, start @ end))


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


def _within_period(dt: FloatArray, alpha: FloatArray, mu: float) -> FloatArray:
    """The same place on a closed orbit, at most half a revolution away."""
    period = 2.0 * np.pi / np.sqrt(mu * np.maximum(alpha, 0.0) ** 3)
    reduced = dt - period * np.rint(dt / period)
    return np.where((alpha > 0.0) & np.isfinite(period), reduced, dt)


def _universal_anomaly(
    radius: FloatArray, sigma: FloatArray, alpha: FloatArray, time: FloatArray
) -> FloatArray:
    """chi such that r u1 + sigma u2 + u3 = sqrt(mu) dt."""
    chi = _start(radius, sigma, alpha, time)
    degree = _LAGUERRE_DEGREE
    for _ in range(_MOST_STEPS):
        u0, u1, u2, u3 = _universal_functions(chi, alpha)
        value = radius * u1 + sigma * u2 + u3 - time
        slope = radius * u0 + sigma * u1 + u2
        bend = (1.0 - alpha * radius) * u1 + sigma * u0
        root = np.sqrt(
            np.abs((degree - 1.0) ** 2 * slope**2 - degree * (degree - 1) * value * bend)
        )
        step = degree * value / (slope + np.where(slope >= 0.0, root, -root))
        chi = chi - np.where(np.isfinite(step), step, 0.0)
        if np.all(~(np.abs(step) > _ENOUGH * np.abs(chi))):
            break
    return np.asarray(chi)


def _start(
    radius: FloatArray, sigma: FloatArray, alpha: FloatArray, time: FloatArray
) -> FloatArray:
    """Of a hyperbola the logarithm that late times follow (Vallado 2013, algorithm 8)."""
    way = np.sign(time)
    root = np.sqrt(np.maximum(-1.0 / alpha, 0.0))
    growth = -2.0 * alpha * time / (sigma + way * root * (1.0 - radius * alpha))
    late = way * root * np.log(np.maximum(growth, 1.0))
    open_ = np.where((alpha < 0.0) & (growth > np.e), late, time / radius)
    parabolic = way * np.sqrt(np.abs(time / radius))
    open_ = np.where(np.abs(open_) > np.abs(parabolic) * 30.0, parabolic, open_)
    return np.where(alpha > 0.0, alpha * time, open_)


def _universal_functions(
    chi: FloatArray, alpha: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """u0 to u3 of Battin: d u(n+1) / d chi = u(n)."""
    z = alpha * chi * chi
    c2, c3 = _stumpff(z)
    u2 = chi * chi * c2
    u3 = chi**3 * c3
    return 1.0 - alpha * u2, chi - alpha * u3, u2, u3


def _stumpff(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(1 - cos s) / s2 and (s - sin s) / s3 with s2 = z; z < 0 by hyperbolic functions."""
    is_small = np.abs(z) < _SERIES_BELOW
    if np.all(is_small):
        return _stumpff_by_series(z)
    root = np.sqrt(np.abs(z))
    # 1 - cos by the half angle: no digits are lost to the difference.
    if np.all(z > 0.0):
        half, odd = np.sin(root / 2.0), root - np.sin(root)
    else:
        half = np.where(z >= 0.0, np.sin(root / 2.0), np.sinh(root / 2.0))
        odd = np.where(z >= 0.0, root - np.sin(root), np.sinh(root) - root)
    c2, c3 = 2.0 * half**2 / root**2, odd / root**3
    if not np.any(is_small):
        return c2, c3
    near_2, near_3 = _stumpff_by_series(np.where(is_small, z, 0.0))
    return np.where(is_small, near_2, c2), np.where(is_small, near_3, c3)


def _stumpff_by_series(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    s2 = s3 = np.ones_like(z)
    for n in range(6, 0, -1):
        s2 = 1.0 - z / ((2 * n + 1) * (2 * n + 2)) * s2
        s3 = 1.0 - z / ((2 * n + 2) * (2 * n + 3)) * s3
    return s2 / 2.0, s3 / 6.0
