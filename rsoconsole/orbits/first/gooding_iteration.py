"""Gooding's angles-only method: orbits through three lines of sight. Pure.

The two outer ranges are unknown; Lambert's problem joins the outer places, and Newton's method
brings the place between them onto the middle line of sight. Source: Gooding 1993, A new procedure
for orbit determination based on three lines of sight (angles only), DRA Technical Report 93004;
1997, Celestial Mechanics and Dynamical Astronomy 66, 387. Kilometres, seconds, km/s along inertial
axes.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from rsoconsole.orbits.first.lambert import lambert
from rsoconsole.orbits.motion.two_body import MU_EARTH_KM3_S2, dot, propagate
from rsoconsole.records import FloatArray

BoolArray = npt.NDArray[np.bool_]

_MAX_STEPS = 30
_STEP = 1e-6
"""Step of a range for numerical slopes, as a share of it."""
_LONGEST = 0.6
"""Share of a range that one step may take."""
_SHARES = 0.5 ** np.arange(1, 8)
"""Shares of a step to try when it was too long, the longest first."""
_STANDS_STILL = 1e-13
"""Largest share of the range that counts as no step."""
_HOPEFUL = (5.0, 0.6)
"""Bound of a search's miss after n steps, the first times the second to the n."""
_ACCEPTED = 1e-10
"""Largest miss of an accepted orbit, as a share of the range."""
_SAME = 1e-6
_STARTS_KM = tuple(float(x) for x in np.geomspace(6_600.0, 90_000.0, 9))
"""Distances from the Earth's centre at which a search begins."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SightLines:
    """Three lines of sight at three instants, in order of time."""

    t_s: FloatArray
    """Times (3,) in seconds since any epoch."""
    sites_km: FloatArray
    """Positions (3, 3) of the sites."""
    directions: FloatArray
    """Unit vectors (3, 3) from the sites to the object."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GoodingOrbit:
    """One orbit through three lines of sight."""

    r_km: FloatArray
    """Position (3,) at the middle instant; ``v_km_s`` is the velocity."""
    v_km_s: FloatArray
    ranges_km: FloatArray
    """Ranges (3,) from the sites."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Searches:
    """N searches side by side, along Lambert's conics without a whole revolution."""

    lines: SightLines
    axes: FloatArray
    """Axes (3, 3), in columns: two across the middle line of sight, and that line."""
    mu: float
    is_retrograde: BoolArray
    """True (N,) where the motion turns against the third axis."""

    def of(self, chosen: npt.NDArray[Any]) -> "_Searches":
        """The chosen searches."""
        return replace(self, is_retrograde=self.is_retrograde[chosen])

    def middle(self, ranges: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Position and velocity (N, 3) at the middle instant, for outer ranges (N, 2)."""
        lines = self.lines
        first = lines.sites_km[0] + ranges[:, :1] * lines.directions[0]
        last = lines.sites_km[2] + ranges[:, 1:] * lines.directions[2]
        v_first, _ = lambert(
            first, last, lines.t_s[2] - lines.t_s[0], self.mu, is_retrograde=self.is_retrograde
        )
        return propagate(first, v_first, lines.t_s[1] - lines.t_s[0], self.mu)

    def miss(self, ranges: FloatArray) -> FloatArray:
        """Miss (N, 2): how far the middle place lies off the middle line, on its tangent plane.

        In units of its distance; behind the observer it grows on. NaN where no conic is.
        """
        seen = self.middle(ranges)[0] - self.lines.sites_km[1]
        seen = seen / np.sqrt(dot(seen, seen))[:, None]
        x, y, ahead = np.moveaxis(seen @ self.axes, -1, 0)
        growth = np.where(ahead > 0.0, 1.0, (2.0 + ahead) / np.hypot(x, y))
        return np.stack([x * growth, y * growth], axis=-1)

    def misses_about(self, ranges: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The miss (N, 2) and its slopes (N, 2, 2) by the two ranges."""
        steps = _STEP * ranges
        around = [ranges]
        for n in (0, 1):
            aside = np.zeros_like(ranges)
            aside[:, n] = steps[:, n]
            around += [ranges + aside, ranges - aside]
        at, east, west, north, south = np.split(self.times(5).miss(np.concatenate(around)), 5)
        by_first = (east - west) / (2.0 * steps[:, :1])
        by_last = (north - south) / (2.0 * steps[:, 1:])
        return at, np.stack([by_first, by_last], axis=-1)

    def times(self, copies: int) -> "_Searches":
        """All searches, repeated one behind the other."""
        return self.of(np.tile(np.arange(len(self.is_retrograde)), copies))


def gooding_orbits(lines: SightLines, *, mu: float = MU_EARTH_KM3_S2) -> tuple[GoodingOrbit, ...]:
    """Find the orbits through the three lines; an empty tuple where there is none.

    Searches both directions of motion, with less than a revolution from the first line to the last,
    from each distance in ``_STARTS_KM``. The result includes orbits that pass below the Earth's
    surface between the lines: the caller decides what is possible. Several orbits through three
    lines are common.
    """
    begun = np.array([_ranges_at(lines, radius) for radius in _STARTS_KM])
    searches = _Searches(
        lines=lines,
        axes=_axes(lines.directions[1]),
        mu=mu,
        is_retrograde=np.repeat([False, True], len(begun)),
    )
    with np.errstate(all="ignore"):
        ranges = _search(searches, np.tile(begun, (2, 1)))
        return _accepted(searches, ranges)


def _ranges_at(lines: SightLines, radius_km: float) -> list[float]:
    """Ranges along the two outer lines to a sphere about the Earth's centre."""
    ranges = []
    for n in (0, 2):
        site, direction = lines.sites_km[n], lines.directions[n]
        along = float(site @ direction)
        inside = along * along - float(site @ site) + radius_km * radius_km
        ranges.append(max(-along + float(np.sqrt(max(inside, 0.0))), 100.0))
    return ranges


def _search(searches: _Searches, ranges: FloatArray) -> FloatArray:
    """Run Newton's method with shortened steps; return where each search (N, 2) ends."""
    ranges = ranges.copy()
    open_ = np.arange(len(ranges))
    miss, slopes = searches.misses_about(ranges)
    is_open: BoolArray = np.all(np.isfinite(miss), axis=-1)
    for n in range(_MAX_STEPS):
        open_, miss, slopes = open_[is_open], miss[is_open], slopes[is_open]
        if not len(open_):
            break
        searches = searches.of(is_open)
        at = ranges[open_]
        moved = at + _newton_step(slopes, miss, at)
        new_miss, new_slopes = searches.misses_about(moved)
        worse = np.flatnonzero(~(_size(new_miss) < _size(miss)))
        if len(worse):
            some = searches.of(worse)
            step = moved[worse] - at[worse]
            moved[worse] = _shortened(some, at[worse], miss[worse], step)
            new_miss[worse], new_slopes[worse] = some.misses_about(moved[worse])
        ranges[open_], miss, slopes = moved, new_miss, new_slopes
        is_small = np.max(np.abs(moved - at) / at, axis=-1) < _STANDS_STILL
        is_open = ~is_small & (_size(miss) < _HOPEFUL[0] * _HOPEFUL[1] ** n)
    return ranges


def _newton_step(slopes: FloatArray, miss: FloatArray, ranges: FloatArray) -> FloatArray:
    """Steps (N, 2), none longer than a share of the range."""
    (a, b), (c, d) = np.moveaxis(slopes, 0, -1)
    below = a * d - b * c
    across = np.stack([b * miss[:, 1] - d * miss[:, 0], c * miss[:, 0] - a * miss[:, 1]], axis=-1)
    step = across / below[:, None]
    longest = np.max(np.abs(step) / ranges, axis=-1, keepdims=True)
    return np.asarray(step * np.minimum(1.0, _LONGEST / longest))


def _shortened(
    searches: _Searches, at: FloatArray, miss: FloatArray, step: FloatArray
) -> FloatArray:
    """Ranges after the longest share of a step that lessens the miss; unmoved if none does."""
    trial = at + _SHARES[:, None, None] * step
    count = len(at)
    misses = searches.times(len(_SHARES)).miss(trial.reshape(-1, 2)).reshape(-1, count, 2)
    lessens = _size(misses) < _size(miss)
    first = np.argmax(lessens, axis=0)
    is_better = np.any(lessens, axis=0)
    return np.where(is_better[:, None], trial[first, np.arange(count)], at)


def _size(miss: FloatArray) -> FloatArray:
    return np.hypot(miss[..., 0], miss[..., 1])


def _axes(direction: FloatArray) -> FloatArray:
    """Two unit vectors across a direction and the direction, in columns."""
    aside = np.eye(3)[int(np.argmin(np.abs(direction)))]
    east = np.cross(aside, direction)
    east /= np.linalg.norm(east)
    return np.stack([east, np.cross(direction, east), direction], axis=-1)


def _accepted(searches: _Searches, ranges: FloatArray) -> tuple[GoodingOrbit, ...]:
    """Orbits on which a search came to rest, each once."""
    off = np.linalg.norm(searches.miss(ranges), axis=-1)
    r, v = searches.middle(ranges)
    middle = np.sqrt(np.sum((r - searches.lines.sites_km[1]) ** 2, axis=-1))
    is_good = (off < _ACCEPTED) & np.all(ranges > 0.0, axis=-1) & np.all(np.isfinite(v), axis=-1)
    found: list[GoodingOrbit] = []
    for n in np.flatnonzero(is_good):
        orbit = GoodingOrbit(
            r_km=r[n], v_km_s=v[n], ranges_km=np.array([ranges[n, 0], middle[n], ranges[n, 1]])
        )
        if not any(_is_same(orbit, each) for each in found):
            found.append(orbit)
    return tuple(found)


def _is_same(one: GoodingOrbit, other: GoodingOrbit) -> bool:
    return bool(np.allclose(one.ranges_km, other.ranges_km, rtol=_SAME, atol=0.0))
