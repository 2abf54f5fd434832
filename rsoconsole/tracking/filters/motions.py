"""Motions that a bank of filters weighs, and what each may do unforeseen. Pure."""

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray
from rsoconsole.tracking.filters.sky_path import ACCELERATION, ARCSEC_RAD, TURN

MOTIONS = ("parallel", "great circle", "any orbit", "changing orbit")
PARALLEL, GREAT_CIRCLE, ANY_ORBIT = range(3)
MOTION_PRIORS = (0.3, 0.1, 0.4, 0.2)
"""Probabilities of the motions before any measurement."""
_CALM_Q, _OPEN_Q = 3e-9, 1e-8
"""White acceleration, arcsec^2/s^3, at 15 arcsec/s; with the third power of the rate elsewhere."""
_CALM_RATE_ARCSEC_S = 15.0
_CHANGES, _OVER_RAD = np.array([0.006, 0.006, 0.5, 4.0]), 0.02
"""Sigma of the change of turn over a radian of path, by motion; path of random changes, rad."""
_GOES_ON = np.array([0.0, 0.0, 1.5, 1.5])
"""Least change of that kind, by motion, over a longer coast."""


def motion_noise(
    means: FloatArray,
    motion: npt.NDArray[np.intp],
    dt_s: float,
    path_since_update_rad: FloatArray,
) -> FloatArray:
    """Return the process noise (N, 6, 6) of filters with means (N, 6) over ``dt_s``.

    ``motion`` (N,): index of each filter's motion. Over a coast, which ``path_since_update_rad``
    (N,) has lasted already, the path goes on changing the same way.
    """
    span = abs(dt_s)
    speed = np.hypot(means[:, 2], means[:, 3])
    length_rad = speed * span * ARCSEC_RAD
    is_open = motion >= ANY_ORBIT
    q = np.where(is_open, _OPEN_Q, _CALM_Q) * (speed / _CALM_RATE_ARCSEC_S) ** 3
    noise = np.zeros((len(means), 6, 6))
    for place, rate in ((0, 2), (1, 3)):
        noise[:, place, place] = q * span**3 / 3.0
        noise[:, place, rate] = noise[:, rate, place] = q * dt_s * span / 2.0
        noise[:, rate, rate] = q * span
    until = path_since_update_rad + length_rad
    at_random = _CHANGES[motion] ** 2 * np.minimum(length_rad, _OVER_RAD) * _OVER_RAD
    goes_on = np.maximum(_CHANGES, _GOES_ON)[motion] ** 2 * (until**2 - path_since_update_rad**2)
    turned = np.maximum(at_random, np.where(until > _OVER_RAD, goes_on, 0.0))
    noise[:, TURN, TURN] = turned
    noise[:, ACCELERATION, ACCELERATION] = turned * (speed**2 * ARCSEC_RAD) ** 2
    return noise


def unknown_bend_prior(speed_arcsec_s: float) -> tuple[FloatArray, FloatArray]:
    """Return the prior of an unknown path's change of speed (arcsec/s^2) and turn.

    As mean (2,) and covariance (2, 2).
    """
    gain = speed_arcsec_s**2 * ARCSEC_RAD
    return np.zeros(2), np.diag([gain**2, 1.0])
