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
from typing import NamedTuple

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.sky import direction_to_unit, unit_to_direction

ARCSEC_RAD = math.radians(1.0 / 3600.0)
X, Y, VX, VY, ACCELERATION, TURN = range(6)
"""Indices of a motion: place (arcsec), rate (arcsec/s), change of speed (arcsec/s^2), turn."""
_MIN_DEPTH = 0.05
_SLOWEST_ARCSEC_S = 1e-6
_STEPS = np.array([1.0, 1.0, 1e-3, 1e-3, 1e-6, 1e-3])
"""Steps of a motion for numerical slopes."""


class _Parts(NamedTuple):
    """Vectors in space as three arrays (...): numpy takes a fifth of the time of rows of three."""

    x: FloatArray
    y: FloatArray
    z: FloatArray

    def rows(self) -> FloatArray:
        """(..., 3) rows of the parts."""
        return np.stack(self, axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class TangentPlane:
    """Tangent plane at a direction: unit vectors towards it, east and north on it."""

    towards: FloatArray
    east: FloatArray
    north: FloatArray

    @classmethod
    def at(cls, ra_icrs_deg: float, dec_icrs_deg: float) -> "TangentPlane":
        """Return the plane that touches the sky at a direction."""
        ra, dec = math.radians(ra_icrs_deg), math.radians(dec_icrs_deg)
        return cls(
            direction_to_unit(ra_icrs_deg, dec_icrs_deg),
            np.array([-math.sin(ra), math.cos(ra), 0.0]),
            np.array([-math.sin(dec) * math.cos(ra), -math.sin(dec) * math.sin(ra), math.cos(dec)]),
        )

    @property
    def direction_deg(self) -> tuple[float, float]:
        """RA and Dec at which the plane touches the sky."""
        ra, dec = unit_to_direction(self.towards)
        return float(ra) % 360.0, float(dec)

    def project_arcsec(self, ra_icrs_deg: float, dec_icrs_deg: float) -> FloatArray:
        """Return the place (2,) of a direction on the plane, arcsec (east, north).

        A direction more than 87 deg from the tangent point is placed far out on its own side.
        """
        unit = _unit_of(ra_icrs_deg, dec_icrs_deg)
        flat, depth = np.array([unit @ self.east, unit @ self.north]), float(unit @ self.towards)
        if depth < _MIN_DEPTH:
            size = float(np.hypot(*flat))
            flat = flat / size if size > 0.0 else np.array([1.0, 0.0])
            depth = _MIN_DEPTH
        return np.asarray(flat / depth / ARCSEC_RAD)

    def direction_of(self, x_arcsec: float, y_arcsec: float) -> tuple[float, float]:
        """Return RA and Dec (ICRS, deg) of a place on the plane."""
        unit = self.towards + ARCSEC_RAD * (x_arcsec * self.east + y_arcsec * self.north)
        ra, dec = unit_to_direction(unit)
        return float(ra) % 360.0, float(dec)

    def _placed(self, motion: FloatArray) -> tuple[_Parts, _Parts]:
        """Unit vectors and rates (rad/s) in space of motions (..., 6)."""
        x, y = motion[..., X] * ARCSEC_RAD, motion[..., Y] * ARCSEC_RAD
        vx, vy = motion[..., VX] * ARCSEC_RAD, motion[..., VY] * ARCSEC_RAD
        axes = list(
            zip(self.towards.tolist(), self.east.tolist(), self.north.tolist(), strict=True)
        )
        unit = _divided(_Parts(*(t + x * e + y * n for t, e, n in axes)))
        turning = _Parts(*(vx * e + vy * n for _, e, n in axes))
        outward = _dot(turning, unit)
        return unit, _Parts(*(v - u * outward for v, u in zip(turning, unit, strict=True)))

    def _seen(self, unit: FloatArray, rate: FloatArray, rest: FloatArray) -> FloatArray:
        """Motions (..., 6) from the vectors of ``_placed``, with their change (..., 2)."""
        depth = unit @ self.towards
        x, y = (unit @ self.east) / depth, (unit @ self.north) / depth
        vx, vy = rate @ self.east, rate @ self.north
        flat = np.stack([x, y, vx, vy], axis=-1) / ARCSEC_RAD
        return np.concatenate([flat, rest], axis=-1)


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


def propagated_on_sky(
    plane: TangentPlane, motion: FloatArray, dt_s: float
) -> tuple[FloatArray, FloatArray]:
    """Propagate motions (..., 6) by ``dt_s`` on the sky.

    Returns unit vectors of the directions and their rates (rad/s), both (..., 3).
    """
    unit, rate = plane._placed(motion)
    if dt_s == 0.0:
        return unit.rows(), rate.rows()
    speed = np.maximum(np.sqrt(_dot(rate, rate)), _SLOWEST_ARCSEC_S * ARCSEC_RAD)
    ahead = _Parts(*(each / speed for each in rate))
    gain, turn = motion[..., ACCELERATION] * ARCSEC_RAD, motion[..., TURN]
    length = speed * dt_s + 0.5 * gain * dt_s**2
    size = np.sqrt(1.0 + turn**2)
    across = _cross(unit, ahead)
    axis = _Parts(*((a + turn * u) / size for a, u in zip(across, unit, strict=True)))
    angle = length * size
    c, n = np.cos(angle), np.sin(angle)
    later = np.maximum(speed + gain * dt_s, _SLOWEST_ARCSEC_S * ARCSEC_RAD)
    moving = _Parts(*(later * each for each in _turned(ahead, axis, c, n)))
    return _turned(unit, axis, c, n).rows(), moving.rows()


def propagate_onto_plane(
    plane: TangentPlane, motion: FloatArray, dt_s: float, onto: TangentPlane
) -> FloatArray:
    """Propagate motions (..., 6) by ``dt_s`` and express them on another plane, ``onto``.

    Change of speed and turn stay the same.
    """
    unit, rate = propagated_on_sky(plane, motion, dt_s)
    return onto._seen(unit, rate, motion[..., 4:])


def propagate_with_jacobian(
    plane: TangentPlane, motion: FloatArray, dt_s: float, onto: TangentPlane
) -> tuple[FloatArray, FloatArray]:
    """Propagate motions (..., 6) onto another plane; return them and the Jacobian (..., 6, 6)."""
    shifted = motion[None] + (_STEPS * np.eye(6)).reshape(6, *(1,) * (motion.ndim - 1), 6)
    every = propagate_onto_plane(plane, np.concatenate([motion[None], shifted]), dt_s, onto)
    after = every[0]
    columns = (every[1:] - after) / _STEPS.reshape(6, *(1,) * motion.ndim)
    return after, np.moveaxis(columns, 0, -1)


def plane_after(plane: TangentPlane, motion: FloatArray, dt_s: float) -> TangentPlane:
    """Return the plane that touches the sky at the direction of a motion (6,) after ``dt_s``."""
    unit, _ = propagated_on_sky(plane, motion, dt_s)
    ra, dec = unit_to_direction(unit)
    return TangentPlane.at(float(ra), float(dec))


def _turned(vector: _Parts, axis: _Parts, c: FloatArray, n: FloatArray) -> _Parts:
    """Rotate about unit axes (Rodrigues) by angles given by cosine and sine."""
    share = _dot(axis, vector)
    parts = zip(axis, vector, _cross(axis, vector), strict=True)
    return _Parts(*((a * share + (v - a * share) * c) + across * n for a, v, across in parts))


def _dot(one: _Parts, other: _Parts) -> FloatArray:
    return one.x * other.x + one.y * other.y + one.z * other.z


def _divided(vector: _Parts) -> _Parts:
    """Normalise to length 1."""
    size = np.sqrt(_dot(vector, vector))
    return _Parts(*(each / size for each in vector))


def _cross(one: _Parts, other: _Parts) -> _Parts:
    return _Parts(
        one.y * other.z - one.z * other.y,
        one.z * other.x - one.x * other.z,
        one.x * other.y - one.y * other.x,
    )
