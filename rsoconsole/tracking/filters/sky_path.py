"""Motion of a point on the sky: a curve of constant turn, with changing speed. Pure.

A great circle does not turn; a path of constant rates in right ascension and declination (a
geostationary satellite: a parallel) turns by an amount given by both rates and the declination;
closer orbits lie between and beyond. So six numbers describe a motion: place (two), rate (two), how
the speed changes and how sharply the path turns. Places are tangent-plane coordinates about a
direction, arcsec (east, north). Turn is per length of path, without unit: at a turn of 1 the
direction changes by one radian for each radian of path. Sources: Jacobi's small circles; the
covariant derivative on a sphere, do Carmo 1976, 4-4.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.sky import direction_to_unit, unit_to_direction

ARCSEC_RAD = math.radians(1.0 / 3600.0)
VX, VY, ACCELERATION, TURN = range(2, 6)
"""Indices of a motion: place (arcsec), rate (arcsec/s), change of speed (arcsec/s^2), turn."""
_MIN_DEPTH = 0.05
_SLOWEST_ARCSEC_S = 1e-6
_STEPS = np.array([1.0, 1.0, 1e-3, 1e-3, 1e-6, 1e-3])
"""Steps of a motion for numerical slopes."""


@dataclass(frozen=True, slots=True, eq=False)
class TangentPlane:
    """Tangent plane at a direction."""

    axes: FloatArray
    """(3, 3) unit vectors of east and north on the plane, and towards the direction, as rows."""

    @classmethod
    def at(cls, ra_icrs_deg: float, dec_icrs_deg: float) -> "TangentPlane":
        """Return the plane that touches the sky at a direction."""
        ra, dec = math.radians(ra_icrs_deg), math.radians(dec_icrs_deg)
        to_east, to_north = (math.cos(ra), math.sin(ra)), (math.cos(dec), math.sin(dec))
        return cls(
            np.array(
                [
                    [-to_east[1], to_east[0], 0.0],
                    [-to_north[1] * to_east[0], -to_north[1] * to_east[1], to_north[0]],
                    [to_north[0] * to_east[0], to_north[0] * to_east[1], to_north[1]],
                ]
            )
        )

    @property
    def east(self) -> FloatArray:
        """(3,) unit vector to the east on the plane."""
        return np.asarray(self.axes[0])

    @property
    def north(self) -> FloatArray:
        """(3,) unit vector to the north on the plane."""
        return np.asarray(self.axes[1])

    @property
    def towards(self) -> FloatArray:
        """(3,) unit vector towards the tangent point."""
        return np.asarray(self.axes[2])

    @property
    def direction_deg(self) -> tuple[float, float]:
        """RA and Dec at which the plane touches the sky."""
        _, (_, _, cos_dec), (x, y, z) = self.axes.tolist()
        return math.degrees(math.atan2(y, x)) % 360.0, math.degrees(math.atan2(z, cos_dec))

    def project_arcsec(self, ra_icrs_deg: float, dec_icrs_deg: float) -> FloatArray:
        """Return the place (2,) of a direction on the plane, arcsec (east, north).

        A direction more than 87 deg from the tangent point is placed far out on its own side.
        """
        place = self.axes @ _unit_of(ra_icrs_deg, dec_icrs_deg)
        flat, depth = place[:2], float(place[2])
        if depth < _MIN_DEPTH:
            size = float(np.hypot(*flat))
            flat = flat / size if size > 0.0 else np.array([1.0, 0.0])
            depth = _MIN_DEPTH
        return np.asarray(flat / depth / ARCSEC_RAD)

    def direction_of(self, x_arcsec: float, y_arcsec: float) -> tuple[float, float]:
        """Return RA and Dec (ICRS, deg) of a place on the plane."""
        unit = np.array([x_arcsec * ARCSEC_RAD, y_arcsec * ARCSEC_RAD, 1.0]) @ self.axes
        ra, dec = unit_to_direction(unit)
        return float(ra) % 360.0, float(dec)


@functools.lru_cache(maxsize=256)
def _unit_of(ra_icrs_deg: float, dec_icrs_deg: float) -> FloatArray:
    """(3,) unit vector of a direction, read-only: many tracks use the directions of one frame."""
    unit = direction_to_unit(ra_icrs_deg, dec_icrs_deg)
    unit.setflags(write=False)
    return unit


def constant_rate_bend(dec_icrs_deg: float | FloatArray, rate_arcsec_s: FloatArray) -> FloatArray:
    """Change of speed and turn, (..., 2), of a motion with constant rates in RA and Dec.

    ``rate_arcsec_s`` (..., 2): east and north.
    """
    east, north = rate_arcsec_s[..., 0], rate_arcsec_s[..., 1]
    tangent = np.tan(np.radians(np.clip(dec_icrs_deg, -89.9, 89.9)))
    speed = np.maximum(np.hypot(east, north), _SLOWEST_ARCSEC_S)
    to_east, to_north = -2.0 * tangent * east * north, tangent * east * east
    gain = (to_east * east + to_north * north) / speed
    across = (to_north * east - to_east * north) / speed
    return np.stack([gain * ARCSEC_RAD, across / speed**2], axis=-1)


def _propagated(motion: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
    """Propagate motions (6, ...) by ``dt_s`` on the sky.

    Returns unit vectors of the directions and their rates (rad/s), both (3, ...), along the axes of
    the motions' own plane.
    """
    flat = motion[:4] * ARCSEC_RAD
    unit, rate = np.ones((3, *flat.shape[1:])), np.zeros((3, *flat.shape[1:]))
    unit[:2], rate[:2] = flat[:2], flat[2:]
    unit /= np.sqrt((unit * unit).sum(axis=0))
    rate -= unit * (rate * unit).sum(axis=0)
    if dt_s == 0.0:
        return unit, rate
    speed = np.maximum(np.sqrt((rate * rate).sum(axis=0)), _SLOWEST_ARCSEC_S * ARCSEC_RAD)
    ahead = rate / speed
    gain, turn = motion[ACCELERATION] * ARCSEC_RAD, motion[TURN]
    size = np.sqrt(1.0 + turn * turn)
    angle = (speed * dt_s + 0.5 * gain * dt_s**2) * size
    c, n = np.cos(angle), np.sin(angle) / size
    # Rodrigues' rotation about (across + turn * unit) / size; the three are at right angles.
    across = np.stack(
        [
            unit[1] * ahead[2] - unit[2] * ahead[1],
            unit[2] * ahead[0] - unit[0] * ahead[2],
            unit[0] * ahead[1] - unit[1] * ahead[0],
        ]
    )
    later = np.maximum(speed + gain * dt_s, _SLOWEST_ARCSEC_S * ARCSEC_RAD)
    along_axis = (across + turn * unit) * (turn * (1.0 - c) / size**2)
    return unit * c + ahead * n + along_axis, later * (ahead * c + (turn * across - unit) * n)


def _onto(plane: TangentPlane, motion: FloatArray, dt_s: float, onto: TangentPlane) -> FloatArray:
    """Places and rates (4, ...) of motions (6, ...) after ``dt_s``, on another plane."""
    unit, rate = _propagated(motion, dt_s)
    turned, shape = onto.axes @ plane.axes.T, unit.shape[1:]
    place = turned @ unit.reshape(3, -1)
    flat = np.concatenate([place[:2] / place[2], turned[:2] @ rate.reshape(3, -1)])
    return np.asarray(flat.reshape(4, *shape) / ARCSEC_RAD)


def propagate_onto_plane(
    plane: TangentPlane, motion: FloatArray, dt_s: float, onto: TangentPlane
) -> FloatArray:
    """Propagate motions (N, 6) by ``dt_s`` and express them on another plane, ``onto``.

    Change of speed and turn stay the same.
    """
    after = motion.copy()
    after[:, :4] = _onto(plane, np.ascontiguousarray(motion.T), dt_s, onto).T
    return after


def propagate_with_jacobian(
    plane: TangentPlane, motion: FloatArray, dt_s: float, onto: TangentPlane
) -> tuple[FloatArray, FloatArray]:
    """Propagate motions (N, 6) onto another plane; return them and the Jacobian (N, 6, 6)."""
    shifted = np.repeat(motion.T[:, None], 7, axis=1)
    each = np.arange(6)
    shifted[each, each + 1] += _STEPS[:, None]
    every = _onto(plane, shifted, dt_s, onto)
    after, slopes = motion.copy(), np.zeros((len(motion), 6, 6))
    after[:, :4] = every[:, 0].T
    slopes[:, :4] = ((every[:, 1:] - every[:, :1]) / _STEPS[:, None]).transpose(2, 0, 1)
    slopes[:, ACCELERATION, ACCELERATION] = slopes[:, TURN, TURN] = 1.0
    return after, slopes


def plane_after(plane: TangentPlane, motion: FloatArray, dt_s: float) -> TangentPlane:
    """Return the plane that touches the sky at the direction of a motion (6,) after ``dt_s``."""
    unit, _ = _propagated(motion, dt_s)
    ra, dec = unit_to_direction(unit @ plane.axes)
    return TangentPlane.at(float(ra), float(dec))
