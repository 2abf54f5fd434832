"""Universal variables: one anomaly and five functions for every conic. Pure.

Source: Battin 1999, An Introduction to the Mathematics and Methods of Astrodynamics, 4.5 and 4.6,
solved by the Laguerre iteration of Conway 1986, Celestial Mechanics 39, 199, which converges from
anywhere. Every argument is an array of one shape; lengths in km, times multiplied by sqrt(mu).
"""

import numpy as np

from rsoconsole.records import FloatArray

_MAX_STEPS = 60
_ENOUGH = 1e-8
"""Largest step after which the iteration ends; its error is of the step's third power."""
_LAGUERRE_DEGREE = 5.0
_SERIES_BELOW = 0.01
_HIGHER_SERIES_BELOW = 0.3
_HIGHER_TERMS = 8


def reduce_to_period(dt: FloatArray, alpha: FloatArray, mu: float) -> FloatArray:
    """Reduce times by whole periods, to at most half a period either way.

    Times on an open orbit are unchanged. ``alpha``: reciprocal of the semi-major axis.
    """
    period = 2.0 * np.pi / np.sqrt(mu * np.maximum(alpha, 0.0) ** 3)
    reduced = dt - period * np.rint(dt / period)
    return np.where((alpha > 0.0) & np.isfinite(period), reduced, dt)


def universal_anomaly(
    radius: FloatArray, sigma: FloatArray, alpha: FloatArray, h_2: FloatArray, time: FloatArray
) -> FloatArray:
    """Solve radius u1 + sigma u2 + u3 = time for the universal anomaly chi; all arrays (N,).

    ``sigma``: r.v / sqrt(mu); ``alpha``: 1 / a; ``h_2``: squared angular momentum over mu;
    ``time``: sqrt(mu) dt. NaN where the iteration does not converge.
    """
    found = _start(radius, sigma, alpha, h_2, time)
    open_ = np.flatnonzero(np.isfinite(found))
    chi = found[open_]
    radius, sigma, alpha, time = (each[open_] for each in (radius, sigma, alpha, time))
    degree = _LAGUERRE_DEGREE
    for _ in range(_MAX_STEPS):
        u0, u1, u2, u3 = universal_functions(chi, alpha)
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
    """First chi of the iteration: for an ellipse from the mean motion, for a hyperbola from
    Kepler's equation.

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


def universal_functions(
    chi: FloatArray, alpha: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Functions u0 to u3 of Battin: d u(n+1) / d chi = u(n)."""
    z = alpha * chi * chi
    c2, c3 = _stumpff(z)
    u2 = chi * chi * c2
    u3 = chi**3 * c3
    return 1.0 - alpha * u2, chi - alpha * u3, u2, u3


def _stumpff(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Functions (1 - cos s) / s2 and (s - sin s) / s3 with s2 = z.

    For z < 0 by hyperbolic functions.
    """
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
    c2 = c3 = np.ones_like(z)
    for n in (5, 4, 3, 2):
        c2 = 1.0 - z / ((2 * n - 1) * 2 * n) * c2
        c3 = 1.0 - z / (2 * n * (2 * n + 1)) * c3
    return c2 / 2.0, c3 / 6.0


def universal_functions_u4_u5(chi: FloatArray, alpha: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return Battin's universal functions U4 and U5, for the partial derivatives of a state.

    ``chi`` includes all whole revolutions.
    """
    z = alpha * chi * chi
    c2, c3 = _stumpff(z)
    is_small = np.abs(z) < _HIGHER_SERIES_BELOW
    size = np.where(is_small, 1.0, z)
    near_4, near_5 = _higher_by_series(np.where(is_small, z, 0.0))
    c4 = np.where(is_small, near_4, (0.5 - c2) / size)
    c5 = np.where(is_small, near_5, (1.0 / 6.0 - c3) / size)
    return chi**4 * c4, chi**5 * c5


def _higher_by_series(z: FloatArray) -> tuple[FloatArray, FloatArray]:
    c4 = c5 = np.ones_like(z)
    for n in range(_HIGHER_TERMS, 2, -1):
        c4 = 1.0 - z / ((2 * n - 1) * 2 * n) * c4
        c5 = 1.0 - z / (2 * n * (2 * n + 1)) * c5
    return c4 / 24.0, c5 / 120.0
