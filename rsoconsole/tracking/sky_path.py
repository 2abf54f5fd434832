"""How a point moves on the sky: a curve of constant turn, along which it may speed up. Pure.

A great circle does not turn; whoever keeps constant rates in right ascension and declination (a
geostationary satellite: a parallel) turns by what both rates and the declination say; what orbits
closer does something between and beyond. So six numbers tell a motion: place, rate, how the speed
changes and how sharply the path turns. Places are tangent-plane coordinates about a direction,
arcsec (east, north); turn is per length of path, without unit: 1 turns by as much as it moves on.
Sources: Jacobi's small circles; the covariant derivative on a sphere, do Carmo 1976, 4-4.
"""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.sky.angles import direction_to_unit, unit_to_direction

ARCSEC_RAD = math.radians(1.0 / 3600.0)
X, Y, VX, VY, ACCELERATION, TURN = range(6)
"""Of a motion: place (arcsec), rate (arcsec/s), change of speed (arcsec/s^2), turn."""
_LEAST_DEPTH = 0.05
_SLOWEST_ARCSEC_S = 1e-6
_STEPS = np.array([1.0, 1.0, 1e-3, 1e-3, 1e-6, 1e-3])
"""Small ones, for slopes."""


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """The tangent plane at a direction: unit vectors towards it, east and north on it."""

    towards: FloatArray
    east: FloatArray
    north: FloatArray

    @classmethod
    def at(cls, ra_icrs_deg: float, dec_icrs_deg: float) -> "Plane":
        """The one that touches the sky there."""
        ra, dec = math.radians(ra_icrs_deg), math.radians(dec_icrs_deg)
        return cls(
            direction_to_unit(ra_icrs_deg, dec_icrs_deg),
            np.array([-math.sin(ra), math.cos(ra), 0.0]),
            np.array([-math.sin(dec) * math.cos(ra), -math.sin(dec) * math.sin(ra), math.cos(dec)]),
        )

    @property
    def direction_deg(self) -> tuple[float, float]:
        """Where it touches: RA and Dec."""
        ra, dec = unit_to_direction(self.towards)
        return float(ra) % 360.0, float(dec)

    def place_of(self, ra_icrs_deg: float, dec_icrs_deg: float) -> FloatArray:
        """(2,) arcsec; what is about a right angle away or more lies far off on its side."""
        unit = direction_to_unit(ra_icrs_deg, dec_icrs_deg)
        flat, depth = np.array([unit @ self.east, unit @ self.north]), float(unit @ self.towards)
        if depth < _LEAST_DEPTH:
            size = float(np.hypot(*flat))
            flat = flat / size if size > 0.0 else np.array([1.0, 0.0])
            depth = _LEAST_DEPTH
        return np.asarray(flat / depth / ARCSEC_RAD)

    def direction_of(self, x_arcsec: float, y_arcsec: float) -> tuple[float, float]:
        """RA and Dec of a place on it."""
        unit = self.towards + ARCSEC_RAD * (x_arcsec * self.east + y_arcsec * self.north)
        ra, dec = unit_to_direction(unit)
        return float(ra) % 360.0, float(dec)

    def _placed(self, motion: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Unit vectors and rates (rad/s) in space (..., 3) of motions (..., 6)."""
        place = motion[..., :2] * ARCSEC_RAD
        unit = self.towards + place[..., :1] * self.east + place[..., 1:] * self.north
        unit = unit / np.linalg.norm(unit, axis=-1, keepdims=True)
        rate = motion[..., 2:4] * ARCSEC_RAD
        turning = rate[..., :1] * self.east + rate[..., 1:] * self.north
        turning = turning - unit * np.sum(turning * unit, axis=-1, keepdims=True)
        return unit, turning

    def _seen(self, unit: FloatArray, rate: FloatArray, rest: FloatArray) -> FloatArray:
        """Motions (..., 6) of what ``_placed`` gives, with how they change (..., 2)."""
        depth = unit @ self.towards
        x, y = (unit @ self.east) / depth, (unit @ self.north) / depth
        vx, vy = rate @ self.east, rate @ self.north
        flat = np.stack([x, y, vx, vy], axis=-1) / ARCSEC_RAD
        return np.concatenate([flat, rest], axis=-1)


def parallel_of(dec_icrs_deg: float | FloatArray, rate_arcsec_s: FloatArray) -> FloatArray:
    """(..., 2) change of speed and turn of constant rates in RA and Dec; ``rate`` (..., 2)."""
    east, north = rate_arcsec_s[..., 0], rate_arcsec_s[..., 1]
    tangent = np.tan(np.radians(np.clip(dec_icrs_deg, -89.9, 89.9)))
    speed = np.maximum(np.hypot(east, north), _SLOWEST_ARCSEC_S)
    to_east, to_north = -2.0 * tangent * east * north, tangent * east * east
    gain = (to_east * east + to_north * north) / speed
    across = (to_north * east - to_east * north) / speed
    return np.stack([gain * ARCSEC_RAD, across / speed**2], axis=-1)


def carried(plane: Plane, motion: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
    """Unit vectors and rates (rad/s), (..., 3), of motions (..., 6) after ``dt_s``."""
    unit, rate = plane._placed(motion)
    speed = np.maximum(np.linalg.norm(rate, axis=-1, keepdims=True), _SLOWEST_ARCSEC_S * ARCSEC_RAD)
    ahead = rate / speed
    gain, turn = motion[..., ACCELERATION : ACCELERATION + 1] * ARCSEC_RAD, motion[..., TURN:]
    length = speed * dt_s + 0.5 * gain * dt_s**2
    axis = np.cross(unit, ahead) + turn * unit
    size = np.sqrt(1.0 + turn**2)
    axis, angle = axis / size, length * size
    later = np.maximum(speed + gain * dt_s, _SLOWEST_ARCSEC_S * ARCSEC_RAD)
    return _turned(unit, axis, angle), later * _turned(ahead, axis, angle)


def moved(plane: Plane, motion: FloatArray, dt_s: float, onto: Plane) -> FloatArray:
    """Motions (..., 6) on another plane after a time; what changes speed and path stays."""
    unit, rate = carried(plane, motion, dt_s)
    return onto._seen(unit, rate, motion[..., 4:])


def with_slopes(
    plane: Plane, motion: FloatArray, dt_s: float, onto: Plane
) -> tuple[FloatArray, FloatArray]:
    """``moved`` and its slopes (..., 6, 6): of each number after by each before."""
    shifted = motion[None] + (_STEPS * np.eye(6)).reshape(6, *(1,) * (motion.ndim - 1), 6)
    every = moved(plane, np.concatenate([motion[None], shifted]), dt_s, onto)
    after = every[0]
    columns = (every[1:] - after) / _STEPS.reshape(6, *(1,) * motion.ndim)
    return after, np.moveaxis(columns, 0, -1)


def plane_after(plane: Plane, motion: FloatArray, dt_s: float) -> Plane:
    """The plane that touches where one motion (6,) leads."""
    unit, _ = carried(plane, motion, dt_s)
    ra, dec = unit_to_direction(unit)
    return Plane.at(float(ra), float(dec))


def _turned(vector: FloatArray, axis: FloatArray, angle: FloatArray) -> FloatArray:
    """Rodrigues' rotation of vectors (..., 3) about unit axes by angles (..., 1)."""
    along = axis * np.sum(axis * vector, axis=-1, keepdims=True)
    return np.asarray(
        along + (vector - along) * np.cos(angle) + np.cross(axis, vector) * np.sin(angle)
    )
