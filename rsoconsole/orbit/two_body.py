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
_SERIES_BELOW = 0.01


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
    with np.errstate(all="ignore"):
        distance_2 = dot(r0, r0)
        radius, along, speed_2 = np.sqrt(distance_2), dot(r0, v0), dot(v0, v0)
        sigma, alpha = along / np.sqrt(mu), 2.0 / radius - speed_2 / mu
        h_2 = (distance_2 * speed_2 - along * along) / mu
        dt = _within_period(np.asarray(dt_s, float), alpha, mu)
        radius, sigma, alpha, h_2, time = np.broadcast_arrays(
            radius, sigma, alpha, h_2, dt * np.sqrt(mu)
        )
        chi = _universal_anomaly(
            *(each.ravel() for each in (radius, sigma, alpha, h_2, time))
        ).reshape(radius.shape)
        u0, u1, u2, _ = _universal_functions(chi, alpha)
        new_radius = radius * u0 + sigma * u1 + u2
        f = 1.0 - u2 / radius
        g = (radius * u1 + sigma * u2) / np.sqrt(mu)
        f_dot = -np.sqrt(mu) * u1 / (new_radius * radius)
        g_dot = 1.0 - u2 / new_radius
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
    radius: FloatArray, sigma: FloatArray, alpha: FloatArray, h_2: FloatArray, time: FloatArray
) -> FloatArray:
    """chi such that r u1 + sigma u2 + u3 = sqrt(mu) dt; all (N,). NaN where none is reached."""
    found = _start(radius, sigma, alpha, h_2, time)
    open_ = np.flatnonzero(np.isfinite(found))
    chi = found[open_]
    radius, sigma, alpha, time = (each[open_] for each in (radius, sigma, alpha, time))
    degree = _LAGUERRE_DEGREE
    for _ in range(_MOST_STEPS):
        u0, u1, u2, u3 = _universal_functions(chi, alpha)
        value = radius * u1 + sigma * u2 + u3 - time
        slope = radius * u0 + sigma * u1 + u2
        bend = (1.0 - alpha * radius) * u1 + sigma * u0
        inner = (degree - 1.0) ** 2 * slope**2 - degree * (degree - 1.0) * value * bend
        # The slope is the distance from the centre, and never negative.
        step = degree * value / (slope + np.sqrt(np.abs(inner)))
        # Where numbers overflowed, chi was far too large.
        step = np.where(np.isfinite(step), step, chi / 2.0)
        chi = chi - step
        is_open = np.abs(step) > _ENOUGH * np.abs(chi)
        left = np.count_nonzero(is_open)
        if left == 0:
            found[open_] = chi
            return found
        if 2 * left < len(chi):
            found[open_] = chi
            open_, chi = open_[is_open], chi[is_open]
            radius, sigma, alpha, time = (each[is_open] for each in (radius, sigma, alpha, time))
            is_open = is_open[is_open]
    found[open_] = np.where(is_open, np.nan, chi)
    return found


def _start(
    radius: FloatArray, sigma: FloatArray, alpha: FloatArray, h_2: FloatArray, time: FloatArray
) -> FloatArray:
    """A first chi: of an ellipse the mean motion's, of a hyperbola Kepler's equation's.

    That equation is e sinh F - F = M with sqrt(-alpha) chi = F - F0; two rounds of
    F = asinh((M + F) / e) come near from anywhere.
    """
    bound = alpha * time
    is_open = alpha <= 0.0
    if not np.any(is_open):
        return bound
    k = np.sqrt(np.maximum(-alpha, 1e-300))
    e = np.sqrt(1.0 + h_2 * np.maximum(-alpha, 0.0))
    start = np.arcsinh(sigma * k / e)
    mean = k**3 * time + sigma * k - start
    late = np.arcsinh(mean / e)
    for _ in range(2):
        late = np.arcsinh((mean + late) / e)
    far = (late - start) / k
    # Near a parabola that loses all its digits, but there a short time is a small chi.
    near = np.sign(time) * np.minimum(np.abs(time / radius), np.cbrt(6.0 * np.abs(time)))
    is_lost = ~np.isfinite(far) | (np.abs(late - start) < 1e-4)
    return np.where(is_open, np.where(is_lost, near, far), bound)


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
    half, odd = np.sin(root / 2.0), root - np.sin(root)
    is_open = z < 0.0
    if np.any(is_open):
        half = np.where(is_open, np.sinh(root / 2.0), half)
        odd = np.where(is_open, np.sinh(root) - root, odd)
    size = root * root
    c2, c3 = 2.0 * half * half / size, odd / (root * size)
    if not np.any(is_small):
        return c2, c3
    near_2, near_3 = _stumpff_by_series(np.where(is_small, z, 0.0))
    return np.where(is_small, near_2, c2), np.where(is_small, near_3, c3)


def _stumpff_by_series(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    c2 = c3 = 1.0
    for n in (5, 4, 3, 2):
        c2 = 1.0 - z / ((2 * n - 1) * 2 * n) * c2
        c3 = 1.0 - z / (2 * n * (2 * n + 1)) * c3
    return np.asarray(c2 / 2.0), np.asarray(c3 / 6.0)


def dot(one: FloatArray, other: FloatArray) -> FloatArray:
    """(...) of vectors (..., 3)."""
    return np.asarray(np.einsum("...i,...i->...", one, other))


def cross(one: FloatArray, other: FloatArray) -> FloatArray:
    """(..., 3), in a third of the time that numpy's own takes for few vectors."""
    ax, ay, az = one[..., 0], one[..., 1], one[..., 2]
    bx, by, bz = other[..., 0], other[..., 1], other[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)
