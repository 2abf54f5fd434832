"""Directions of one object, reduced for the fit of an orbit. Pure.

A plate solution measures astrometric places: relative to stars whose annual aberration is taken
out. The satellite moves with the Earth, so u = r(t - tau) - r_site(t) - v_earth tau, with the light
time tau, points where the plate says. Every term except the orbit r is computed once, here.
Kilometres along ICRS axes.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from rsoconsole.orbits.first.gooding_iteration import GoodingOrbit, SightLines, gooding_orbits
from rsoconsole.orbits.motion.two_body import MU_EARTH_KM3_S2, propagate
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import (
    ARCSEC_RAD,
    LIGHT_KM_S,
    IntArray,
    direction_to_unit,
    earth_velocity_km_s,
    east_and_north,
    line_of_sight_gcrs,
    site_gcrs,
)
from rsoconsole.words import NS_PER_S


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredDirections:
    """N measured directions in order of time, with the site at each; every array starts with N."""

    t_utc_ns: IntArray
    t_s: FloatArray
    """Times (N,) since the epoch, seconds."""
    epoch_utc_ns: int
    """Epoch of the orbit: the instant of the direction nearest to the middle of the time span."""
    ra_icrs_deg: FloatArray
    dec_icrs_deg: FloatArray
    whitening: FloatArray
    """Whitening matrices (N, 2, 2) of residuals (d alpha cos delta, d delta) in arcsec."""
    cov_sky_arcsec2: FloatArray
    """Covariances (N, 3) of the directions without ``time_sigma_s``: east-east, east-north,
    north-north."""
    time_sigma_s: FloatArray
    """One sigma (N,) of each time, seconds, independent of the others; 0: in the covariance."""
    sites_km: FloatArray
    """Positions (N, 3) of the sites, GCRS."""
    sites_km_s: FloatArray
    earth_km_s: FloatArray
    """Velocities (N, 3) of the Earth's centre about the solar system's barycentre."""
    lines: FloatArray
    """Unit vectors (N, 3) from site to object, the effect of the Earth's motion taken out."""
    east: FloatArray
    """Unit vectors (N, 3) to the east on the sky, at the measured directions."""
    north: FloatArray
    towards: FloatArray
    """Unit vectors (N, 3) of the measured directions themselves."""

    def __len__(self) -> int:
        return len(self.t_s)

    def residuals_arcsec(self, positions_km: FloatArray) -> FloatArray:
        """Residuals (..., N, 2), measured minus predicted on the sky, of positions (..., N, 3).

        East and north, on the tangent plane of each measured direction. The positions are those at
        t - tau, when the light left the object.
        """
        u = positions_km - self.sites_km
        tau_s = np.sqrt(np.sum(u * u, axis=-1, keepdims=True)) / LIGHT_KM_S
        u = u - self.earth_km_s * tau_s
        ahead = np.sum(u * self.towards, axis=-1)
        size = np.sqrt(np.sum(u * u, axis=-1))
        depth = np.maximum(ahead, 0.05 * size)
        off = np.stack([np.sum(u * self.east, axis=-1), np.sum(u * self.north, axis=-1)], axis=-1)
        return np.asarray(-off / depth[..., None] / ARCSEC_RAD)

    def residual_slopes(self, positions_km: FloatArray) -> FloatArray:
        """Return the derivatives (N, 2, 3) of the residuals by the positions (N, 3), arcsec/km.

        The Earth's motion is neglected.
        """
        u = positions_km - self.sites_km
        ahead = np.sum(u * self.towards, axis=-1)
        depth = np.maximum(ahead, 0.05 * np.sqrt(np.sum(u * u, axis=-1)))[:, None]
        slopes = []
        for axis in (self.east, self.north):
            off = np.sum(u * axis, axis=-1)[:, None]
            slopes.append((off / depth * self.towards - axis) / depth)
        return np.stack(slopes, axis=-2) / ARCSEC_RAD

    def subset(self, chosen: npt.NDArray[Any]) -> "MeasuredDirections":
        """Return the directions selected by a mask or indices, with the same epoch."""
        arrays = {
            each.name: getattr(self, each.name)[chosen]
            for each in fields(self)
            if each.name != "epoch_utc_ns"
        }
        return replace(self, **arrays)

    def with_rates(self, rates_arcsec_s: FloatArray) -> "MeasuredDirections":
        """Return the directions with their errors of time along a motion (N, 2), east and north.

        arcsec/s, of the object as seen.
        """
        late = self.time_sigma_s[:, None] * rates_arcsec_s
        along = np.stack([late[:, 0] ** 2, late[:, 0] * late[:, 1], late[:, 1] ** 2], axis=-1)
        return replace(self, whitening=_whitening(self.cov_sky_arcsec2 + along))

    def with_added_error(self, sigma_arcsec: float) -> "MeasuredDirections":
        """Return the directions with an added error on each axis."""
        more = sigma_arcsec**2
        total = np.linalg.inv(np.swapaxes(self.whitening, -1, -2) @ self.whitening)
        return replace(
            self,
            whitening=np.linalg.inv(np.linalg.cholesky(total + more * np.eye(2))),
            cov_sky_arcsec2=self.cov_sky_arcsec2 + more * np.array([1.0, 0.0, 1.0]),
        )

    def with_wider_errors(self, times: float) -> "MeasuredDirections":
        """Return the directions with all errors wider by a factor."""
        return replace(
            self,
            whitening=self.whitening / times,
            cov_sky_arcsec2=self.cov_sky_arcsec2 * times**2,
            time_sigma_s=self.time_sigma_s * times,
        )

    def rates_arcsec_s(self, positions_km: FloatArray, velocities_km_s: FloatArray) -> FloatArray:
        """Rates (N, 2), east and north, of an object at these places with these velocities."""
        away = np.linalg.norm(positions_km - self.sites_km, axis=-1, keepdims=True)
        rates = (velocities_km_s - self.sites_km_s) / away
        axes = (np.sum(rates * axis, axis=-1) for axis in (self.east, self.north))
        return np.asarray(np.stack(list(axes), axis=-1) / ARCSEC_RAD)

    def whitened(self, residuals_arcsec: FloatArray) -> FloatArray:
        """Residuals (..., N, 2) in units of their own sigma, with correlations removed."""
        return np.asarray(np.einsum("nij,...nj->...ni", self.whitening, residuals_arcsec))

    def light_times_s(self, positions_km: FloatArray) -> FloatArray:
        """Light times (..., N) from positions (..., N, 3) to the site."""
        return np.asarray(np.linalg.norm(positions_km - self.sites_km, axis=-1) / LIGHT_KM_S)


def reduce_directions(
    site: Site,
    t_utc_ns: IntArray,
    ra_icrs_deg: FloatArray,
    dec_icrs_deg: FloatArray,
    cov_sky_arcsec2: FloatArray,
    *,
    time_sigma_s: FloatArray | None = None,
) -> MeasuredDirections:
    """Reduce N measured directions of one object for the fit of its orbit.

    ``cov_sky_arcsec2`` (N, 3): east-east, east-north, north-north. ``time_sigma_s`` (N,): errors of
    the times that it does not hold; they count along the motion, which is estimated from the
    directions themselves until an orbit gives it. The result is in order of time.
    Raises ValueError for a covariance that is not positive definite and for a direction that is not
    a number.
    """
    if not (np.all(np.isfinite(ra_icrs_deg)) and np.all(np.isfinite(dec_icrs_deg))):
        raise ValueError("a direction is not a number")
    order = np.argsort(t_utc_ns, kind="stable")
    t = np.asarray(t_utc_ns, np.int64)[order]
    ra, dec = np.asarray(ra_icrs_deg, float)[order], np.asarray(dec_icrs_deg, float)[order]
    cov = np.asarray(cov_sky_arcsec2, float)[order]
    late_s = np.zeros(len(t)) if time_sigma_s is None else np.asarray(time_sigma_s, float)[order]
    epoch = int(t[np.argmin(np.abs(t - t[0] - (t[-1] - t[0]) // 2))]) if len(t) else 0
    sites_km, sites_km_s = site_gcrs(site, t)
    towards = direction_to_unit(ra, dec)
    east, north = east_and_north(ra, dec)
    reduced = MeasuredDirections(
        t_utc_ns=t,
        t_s=(t - epoch) / NS_PER_S,
        epoch_utc_ns=epoch,
        ra_icrs_deg=ra,
        dec_icrs_deg=dec,
        whitening=_whitening(cov),
        cov_sky_arcsec2=cov,
        time_sigma_s=late_s,
        sites_km=sites_km,
        sites_km_s=sites_km_s,
        earth_km_s=earth_velocity_km_s(t),
        lines=line_of_sight_gcrs(ra, dec, t),
        east=east,
        north=north,
        towards=towards,
    )
    return reduced.with_rates(_own_rates_arcsec_s(reduced)) if np.any(late_s > 0.0) else reduced


_NEAR_S = 600.0
"""Largest time to a neighbour by which the rate of motion is estimated, seconds."""
_SHARE = 0.25
"""Least share of the arc within ``_NEAR_S`` over which it is estimated: times are uncertain."""


def _own_rates_arcsec_s(seen: MeasuredDirections) -> FloatArray:
    """Rates (N, 2) east and north by each direction's neighbours; 0 for a direction without any.

    By a parabola in the plane that touches the sky at the direction, where ways are all but
    straight.
    """
    rates = np.zeros((len(seen), 2))
    for n in np.flatnonzero(seen.time_sigma_s > 0.0):
        dt_s = seen.t_s - seen.t_s[n]
        ahead = seen.towards @ seen.towards[n]
        near = np.flatnonzero((np.abs(dt_s) <= _NEAR_S) & (ahead > 0.2))
        near = near[np.argsort(np.abs(dt_s[near]), kind="stable")]
        spans_s = np.maximum.accumulate(dt_s[near]) - np.minimum.accumulate(dt_s[near])
        count = max(int(np.searchsorted(spans_s, _SHARE * spans_s[-1])) + 1, 3)
        near = near[:count]
        if len(near) < 2 or np.ptp(dt_s[near]) <= 0.0:
            continue
        plane = np.stack([seen.east[n], seen.north[n]], axis=-1)
        off = seen.towards[near] @ plane / ahead[near, None] / ARCSEC_RAD
        powers = dt_s[near, None] ** np.arange(min(len(np.unique(dt_s[near])), 3))
        rates[n] = np.linalg.lstsq(powers, off, rcond=None)[0][1]
    return rates


def _whitening(cov: FloatArray) -> FloatArray:
    """Inverse Cholesky factors (N, 2, 2) of the covariances (N, 3)."""
    ee, en, nn = cov.T
    if not (np.all(ee > 0.0) and np.all(ee * nn - en * en > 0.0)):
        raise ValueError("a covariance on the sky must be positive definite")
    matrices = np.stack([np.stack([ee, en], -1), np.stack([en, nn], -1)], -2)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(matrices)))


State = tuple[FloatArray, FloatArray]
"""Position (3,) km and velocity (3,) km/s at the epoch, along ICRS axes."""
LOWEST_KM = 6_478.0
"""Lowest perigee of an orbit that lasts, from the Earth's centre, km."""
_RADII_KM = np.geomspace(6_500.0, 400_000.0, 160)


INWARD = (0.0, 0.1, 0.2)
"""Shares of the directions to leave out at either end: a wild one spoils the orbits through it."""


def starting_states(seen: MeasuredDirections, inward: float = 0.0) -> tuple[State, ...]:
    """Plausible starting states at the epoch: Gooding's orbits first, then circular orbits.

    ``inward``: the share of the directions that is left out at either end (`INWARD`).
    """
    return (*_by_gooding(seen, inward), *_circles(seen, inward))


def three_sight_lines(seen: MeasuredDirections, inward: float = 0.0) -> SightLines:
    """Choose three lines of sight far apart in time.

    ``inward``: share of the directions left out at each end; a larger share also chooses a later
    middle line.
    """
    first, last = _ends(seen, inward)
    span_s = seen.t_s[last] - seen.t_s[first]
    middle = int(np.argmin(np.abs(seen.t_s - seen.t_s[first] - (0.5 + inward / 2.0) * span_s)))
    chosen = [first, min(max(middle, first + 1), last - 1), last]
    return SightLines(
        t_s=seen.t_s[chosen], sites_km=seen.sites_km[chosen], directions=seen.lines[chosen]
    )


def _ends(seen: MeasuredDirections, inward: float) -> tuple[int, int]:
    """First and last direction that count, with one at least between them if there is any."""
    left_out = min(int(inward * len(seen)), max(len(seen) - 3, 0) // 2)
    return left_out, len(seen) - 1 - left_out


def state_at_line_epoch(orbit: GoodingOrbit, lines: SightLines) -> State:
    """State of an orbit through three lines of sight, at time 0 of these lines.

    Allows for the light time of the middle line.
    """
    # The light of the middle line left so much earlier.
    since = -lines.t_s[1] + orbit.ranges_km[1] / LIGHT_KM_S
    return propagate(orbit.r_km, orbit.v_km_s, since)


def _by_gooding(seen: MeasuredDirections, inward: float) -> Iterator[State]:
    if len(seen) < 3:
        return
    lines = three_sight_lines(seen, inward)
    if len(np.unique(lines.t_s)) < 3:
        return
    for orbit in gooding_orbits(lines):
        r, v = state_at_line_epoch(orbit, lines)
        if is_plausible_orbit(r, v):
            yield r, v


def _circles(seen: MeasuredDirections, inward: float) -> Iterator[State]:
    """Circular orbits through two lines."""
    ends = _ends(seen, inward)
    dt_s = float(seen.t_s[ends[1]] - seen.t_s[ends[0]])
    if dt_s <= 0.0:
        return
    places = [_on_sphere(seen.sites_km[n], seen.lines[n], _RADII_KM) for n in ends]
    across = np.linalg.norm(np.cross(places[0], places[1]), axis=-1)
    angle = np.arctan2(across, np.sum(places[0] * places[1], axis=-1))
    excess = angle - np.sqrt(MU_EARTH_KM3_S2 / _RADII_KM**3) * dt_s
    for n in np.flatnonzero(np.signbit(excess[:-1]) != np.signbit(excess[1:])):
        share = excess[n] / (excess[n] - excess[n + 1])
        radius = np.array([_RADII_KM[n] + share * (_RADII_KM[n + 1] - _RADII_KM[n])])
        first, last = (_on_sphere(seen.sites_km[m], seen.lines[m], radius)[0] for m in ends)
        pole = np.cross(first, last)
        forward = np.cross(pole, first)
        speed = np.sqrt(MU_EARTH_KM3_S2 / radius[0])
        yield propagate(first, speed * forward / np.linalg.norm(forward), -seen.t_s[ends[0]])


def _on_sphere(site: FloatArray, line: FloatArray, radii_km: FloatArray) -> FloatArray:
    """Positions (M, 3) where a line leaves spheres about the Earth's centre."""
    along = site @ line
    reach = -along + np.sqrt(np.maximum(along * along - site @ site + radii_km**2, 0.0))
    return np.asarray(site + reach[:, None] * line)


def is_plausible_orbit(r: FloatArray, v: FloatArray) -> bool:
    """Return True for a bound orbit with its perigee above the atmosphere."""
    radius = float(np.linalg.norm(r))
    energy = float(v @ v) / 2.0 - MU_EARTH_KM3_S2 / radius
    if energy >= 0.0:
        return False
    a = -MU_EARTH_KM3_S2 / (2.0 * energy)
    h = np.cross(r, v)
    e = float(np.sqrt(max(1.0 - float(h @ h) / (MU_EARTH_KM3_S2 * a), 0.0)))
    return a * (1.0 - e) > LOWEST_KM


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineOfSight:
    """A moving line of sight, relative to which an orbit is fitted with six unknowns.

    Unknowns: two offsets of the direction, their rates, the logarithm of the range, and the range
    rate divided by the range.
    """

    site_km: FloatArray
    """Position (3,) of the site."""
    site_km_s: FloatArray
    towards: FloatArray
    east: FloatArray
    north: FloatArray

    @classmethod
    def through(cls, state: State, site_km: FloatArray, site_km_s: FloatArray) -> "LineOfSight":
        """Line of sight from a moving site through the position of a state."""
        towards = state[0] - site_km
        towards = towards / np.linalg.norm(towards)
        east = np.cross([0.0, 0.0, 1.0] if abs(towards[2]) < 0.999 else [1.0, 0.0, 0.0], towards)
        east = east / np.linalg.norm(east)
        return cls(
            site_km=site_km,
            site_km_s=site_km_s,
            towards=towards,
            east=east,
            north=np.cross(towards, east),
        )

    def unknowns(self, state: State) -> FloatArray:
        """Return the unknowns (6,) of a state whose position lies on the line."""
        u = state[0] - self.site_km
        distance = float(np.linalg.norm(u))
        rates = (state[1] - self.site_km_s) / distance
        turn = (rates @ self.east, rates @ self.north)
        return np.array([0.0, 0.0, *turn, np.log(distance), rates @ self.towards])

    def state(self, unknowns: FloatArray) -> State:
        """State for unknowns (6,): position (3,) and velocity (3,)."""
        line, _ = self._line(unknowns)
        turn = unknowns[2] * self.east + unknowns[3] * self.north
        distance = np.exp(unknowns[4])
        return (
            self.site_km + distance * line,
            self.site_km_s + distance * (unknowns[5] * line + turn),
        )

    def slopes(self, unknowns: FloatArray) -> FloatArray:
        """Slopes (6, 6) of a state's position and velocity by the unknowns."""
        line, size = self._line(unknowns)
        turn = unknowns[2] * self.east + unknowns[3] * self.north
        distance, rate = np.exp(unknowns[4]), unknowns[5]
        out = np.zeros((6, 6))
        for n, axis in enumerate((self.east, self.north)):
            aside = distance / size * (axis - line * (line @ axis))
            out[:3, n], out[3:, n] = aside, rate * aside
            out[3:, 2 + n] = distance * axis
        out[:3, 4], out[3:, 4] = distance * line, distance * (rate * line + turn)
        out[3:, 5] = distance * line
        return out

    def _line(self, unknowns: FloatArray) -> tuple[FloatArray, float]:
        line = self.towards + unknowns[0] * self.east + unknowns[1] * self.north
        size = float(np.linalg.norm(line))
        return line / size, size
