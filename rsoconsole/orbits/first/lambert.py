"""Lambert's problem: the conics through two places in a given time; many at once. Pure.

Source of the method: Izzo 2015, Revisiting Lambert's problem, Celestial Mechanics and Dynamical
Astronomy 121, 1 (arXiv 1403.2705): Lancaster and Blanchard's variables, Householder iterations from
Izzo's starting values. Kilometres, seconds, km/s along inertial axes.
"""

import numpy as np
import numpy.typing as npt

from rsoconsole.orbits.motion.two_body import cross, dot
from rsoconsole.records import FloatArray

_MAX_STEPS = 16
_ENOUGH = 1e-6
"""Largest step after which the iteration ends; its error is of the step's fourth power."""
_SERIES_WITHIN = 0.1
"""Distance from the parabola (x = 1) within which the time is summed as a series."""
_SERIES_TERMS = 24


def lambert(
    r1_km: npt.ArrayLike,
    r2_km: npt.ArrayLike,
    dt_s: npt.ArrayLike,
    mu: float,
    *,
    is_retrograde: npt.ArrayLike = False,
    revolutions: npt.ArrayLike = 0,
    is_left: npt.ArrayLike = False,
) -> tuple[FloatArray, FloatArray]:
    """Return velocities (..., 3) at both ends of the conic arc flown in the time ``dt_s``.

    ``r1_km``, ``r2_km``: the ends (..., 3); all arguments broadcast. ``is_retrograde``: True for
    motion against the third axis. ``revolutions``: whole revolutions on the way; with one or more
    there are two conics, and ``is_left`` chooses the one with the longer period. NaN where there is
    no conic: the time is too short for the revolutions, or both ends lie on one line with the
    centre, which defines no plane.
    """
    r1, r2 = np.asarray(r1_km, float), np.asarray(r2_km, float)
    shape = np.broadcast_shapes(
        *(r1.shape[:-1], r2.shape[:-1], np.shape(dt_s), np.shape(is_retrograde)),
        *(np.shape(revolutions), np.shape(is_left)),
    )
    r1, r2 = np.broadcast_to(r1, (*shape, 3)), np.broadcast_to(r2, (*shape, 3))
    whole = np.broadcast_to(np.asarray(revolutions, float), shape)
    left = np.broadcast_to(np.asarray(is_left, bool), shape)
    with np.errstate(all="ignore"):
        d1, d2 = _length(r1), _length(r2)
        e1, e2 = r1 / d1, r2 / d2
        normal = cross(e1, e2)
        pole = normal / _length(normal)
        turns_back = (pole[..., 2:] < 0.0) != np.asarray(is_retrograde, bool)[..., None]
        pole = np.where(turns_back, -pole, pole)
        chord = _length(r2 - r1)
        half = (d1 + d2 + chord) / 2.0
        # 1 - c/s would lose digits where the angle is near 180 degrees.
        aligned = np.maximum(1.0 + dot(e1, e2)[..., None], 0.0)
        lam = np.sqrt(d1 * d2 * aligned / 2.0) / half
        lam = np.where(turns_back, -lam, lam)
        time = np.sqrt(2.0 * mu / half[..., 0] ** 3) * dt_s
        given = (lam[..., 0], np.broadcast_to(time, shape), whole, left)
        x = _root(*(np.ravel(each) for each in given)).reshape(shape)[..., None]
        y = np.sqrt(1.0 - lam * lam * (1.0 - x * x))
        gamma = np.sqrt(mu * half / 2.0)
        rho = (d1 - d2) / chord
        across = gamma * np.sqrt(d1 * d2) * _length(e2 - e1) / chord * (y + lam * x)
        radial_1 = gamma * ((lam * y - x) - rho * (lam * y + x)) / d1
        radial_2 = -gamma * ((lam * y - x) + rho * (lam * y + x)) / d2
        v1 = radial_1 * e1 + across / d1 * cross(pole, e1)
        v2 = radial_2 * e2 + across / d2 * cross(pole, e2)
    return np.asarray(v1), np.asarray(v2)


def _length(vector: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(dot(vector, vector))[..., None])


def _root(lam: FloatArray, time: FloatArray, whole: FloatArray, left: FloatArray) -> FloatArray:
    """Lancaster and Blanchard's x, all (N,); NaN where there is none."""
    at_zero = np.arccos(np.clip(lam, -1.0, 1.0)) + lam * np.sqrt(1.0 - lam * lam)
    at_one = 2.0 / 3.0 * (1.0 - lam**3)
    slow = (at_zero / time) ** (2.0 / 3.0) - 1.0
    fast = 2.5 * at_one * (at_one - time) / (time * (1.0 - lam**5)) + 1.0
    between = (time / at_zero) ** (np.log(2.0) / np.log(at_one / at_zero)) - 1.0
    single = np.where(time >= at_zero, slow, np.where(time < at_one, fast, between))
    longer = ((whole + 1.0) * np.pi / time) ** (2.0 / 3.0)
    shorter = (8.0 * time / (np.maximum(whole, 1.0) * np.pi)) ** (2.0 / 3.0)
    several = np.where(left, longer, shorter)
    x = np.where(whole > 0.0, (several - 1.0) / (several + 1.0), single)
    for _ in range(_MAX_STEPS):
        now = _time(x, lam, whole)
        d1, d2, d3 = _slopes(x, lam, now)
        off = now - time
        step = off * (d1 * d1 - off * d2 / 2.0)
        step = step / (d1 * (d1 * d1 - off * d2) + d3 * off * off / 6.0)
        new = x - step
        new = np.where(new > -1.0, new, (x - 1.0) / 2.0)
        new = np.where((whole > 0.0) & (new >= 1.0), (1.0 + x) / 2.0, new)
        is_done = ~(np.abs(new - x) > _ENOUGH * np.maximum(1.0, np.abs(x)))
        x = new
        if is_done.all():
            break
    # A last step so small came from a small miss, unless there is no root at all.
    return np.where(is_done & (np.abs(off) < 1e-4 * time), x, np.nan)


def _time(x: FloatArray, lam: FloatArray, whole: FloatArray) -> FloatArray:
    """Izzo's time of flight, without a dimension."""
    e = 1.0 - x * x
    y = np.sqrt(1.0 - lam * lam * e)
    size = np.sqrt(np.abs(e))
    across = (y - lam * x) * size
    psi = np.where(e > 0.0, np.arctan2(across, x * y + lam * e), np.arcsinh(across))
    time = ((psi + whole * np.pi) / size - x + lam * y) / e
    near = np.flatnonzero((np.abs(x - 1.0) < _SERIES_WITHIN) & (whole == 0.0))
    if len(near):
        time[near] = _time_by_series(x[near], y[near], lam[near])
    return np.asarray(time)


def _time_by_series(x: FloatArray, y: FloatArray, lam: FloatArray) -> FloatArray:
    """Battin's hypergeometric series about the parabola."""
    eta = y - lam * x
    s = (1.0 - lam - x * eta) / 2.0
    total = np.ones_like(s)
    for n in range(_SERIES_TERMS, -1, -1):
        total = 1.0 + (3.0 + n) / (2.5 + n) * s * total
    return np.asarray((eta**3 * 4.0 / 3.0 * total + 4.0 * lam * eta) / 2.0)


def _slopes(
    x: FloatArray, lam: FloatArray, time: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """First three derivatives of the time (Izzo, equation 22); rough at the parabola itself."""
    x = np.where(np.abs(x - 1.0) < 1e-5, np.where(x < 1.0, 1.0 - 1e-5, 1.0 + 1e-5), x)
    e = 1.0 - x * x
    y = np.sqrt(1.0 - lam * lam * e)
    d1 = (3.0 * time * x - 2.0 + 2.0 * lam**3 * x / y) / e
    d2 = (3.0 * time + 5.0 * x * d1 + 2.0 * (1.0 - lam * lam) * lam**3 / y**3) / e
    d3 = (7.0 * x * d2 + 8.0 * d1 - 6.0 * (1.0 - lam * lam) * lam**5 * x / y**5) / e
    return d1, d2, d3
