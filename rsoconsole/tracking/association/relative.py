"""Relative motion of two satellites of a field, from the frames that showed both. Pure.

Errors of shutter and plate move both streaks of a frame alike, so the relative position is free of
them; each of its axes is fitted separately. The path is an offset, a drift, and oscillations of one
and of half an orbital period: the relative motion of two orbits of nearly one period (Clohessy &
Wiltshire 1960). For other pairs of objects the drift is the main part. A short arc does not
determine an oscillation: the fit averages over priors for oscillations and drifts from small to
large, each weighed by how well it explains the measurements.
"""

import itertools
import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from rsoconsole.records import ClosestKind, FloatArray, PairMotion, PathKind
from rsoconsole.sky import ARCSEC_RAD, IntArray
from rsoconsole.words import NS_PER_S

SIDEREAL_RAD_S = 7.292115e-5
"""Rotation rate of the Earth: that of a geostationary satellite over the stars."""
LONGEST_HORIZON_S = 6 * 3600.0
"""Longest time for which a path is predicted: a quarter of a rotation."""
MIN_FRAMES = 3
_SWINGS_ARCSEC = (10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4, 3e4, 1e5)
_DRIFTS_ARCSEC_RAD = (10.0, 300.0, 1e4, 1e6)
_OFFSET_SHARES, _MIN_OFFSET_ARCSEC = (1.0 / 3.0, 10.0 / 3.0), 60.0
"""Sigma of a swing's middle from the other object: as shares of its width, and least, arcsec."""
_HALF_TURN_SHARE, _OF_WIDE_SWINGS, _WIDE_ARCSEC = 0.05, 0.2, 1e3
"""Width of the half-turn swing by that of the full-turn one: usually, and for wide ones: orbits
that lean, a site that is not the Earth's centre. All of these cover the pairs of catalogued
geostationary objects (``test_relative.py``)."""
SAMPLES = 200
_TERMS = 6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackDirections:
    """Directions of one track in N frames, in order of time."""

    frame_id: IntArray
    """(N,) number of the frame of each direction."""
    t_utc_ns: IntArray
    units: FloatArray
    """(N, 3) unit vectors of the directions."""
    cov_sky_arcsec2: FloatArray
    """(N, 3) covariances ee, en, nn (east, north), without errors common to all of a frame."""
    rate_arcsec_s: FloatArray
    """(N, 2) rates against the stars, east and north."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RelativePositions:
    """Relative positions of two tracks in the N frames that showed both."""

    t_utc_ns: IntArray
    """(N,) instants of the frames."""
    ways_arcsec: FloatArray
    """(N, 2) relative positions, east and north, at the middle between the two."""
    covariance_arcsec2: FloatArray
    """(N, 2, 2) covariances of ``ways_arcsec``."""
    rate_arcsec_s: FloatArray
    """(2,) rate of the faster track over the stars, in the last of the frames."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RelativePath:
    """Relative position of two tracks over time, as S equally likely paths."""

    t_utc_ns: int
    """Reference instant: that of the last frame that showed both."""
    frequency_rad_s: float
    axes: FloatArray
    """(2, 2) rows: unit vectors (east, north) along and across the motion, the axes of the fit."""
    samples: FloatArray
    """(S, 2, 6) coefficients of each axis."""
    frames: int

    @property
    def horizon_s(self) -> float:
        """Longest time for which the path is predicted, s: a quarter period, 6 hours at most."""
        return min(LONGEST_HORIZON_S, 0.5 * math.pi / self.frequency_rad_s)

    def positions_at(self, since_s: FloatArray) -> FloatArray:
        """(S, M, 2) relative positions, east and north, arcsec, at M times after the reference."""
        terms = _terms(self.frequency_rad_s * np.atleast_1d(since_s))
        return np.asarray(np.swapaxes(self.samples @ terms.T, 1, 2) @ self.axes)

    def rates_at(self, since_s: FloatArray) -> FloatArray:
        """(S, M, 2) relative rates, east and north, arcsec/s, at M times after the reference."""
        slopes = _slopes(self.frequency_rad_s * np.atleast_1d(since_s))
        rates = np.swapaxes(self.samples @ slopes.T, 1, 2) @ self.axes
        return np.asarray(rates * self.frequency_rad_s)


def relative_positions(one: TrackDirections, other: TrackDirections) -> RelativePositions | None:
    """Return positions of ``other`` from ``one`` in frames with both; None: too few of these."""
    _, i, j = np.intersect1d(one.frame_id, other.frame_id, return_indices=True)
    if len(i) < MIN_FRAMES:
        return None
    # A rolling shutter sees one a moment after the other.
    late_s = (one.t_utc_ns[i] - other.t_utc_ns[j]) / NS_PER_S
    here, there = one.units[i], other.units[j]
    east, north = east_and_north_at(here + there)
    moved = other.rate_arcsec_s[j] * late_s[:, None]
    cov = one.cov_sky_arcsec2[i] + other.cov_sky_arcsec2[j]
    rates = np.stack([one.rate_arcsec_s[i[-1]], other.rate_arcsec_s[j[-1]]])
    return RelativePositions(
        t_utc_ns=one.t_utc_ns[i],
        ways_arcsec=_way(here, there, east, north) + moved,
        covariance_arcsec2=np.stack([cov[:, :2], cov[:, 1:]], axis=1),
        rate_arcsec_s=rates[int(np.argmax(np.hypot(*rates.T)))],
    )


def east_and_north_at(towards: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors east (N, 3) and north (N, 3) at directions (N, 3) of any length."""
    x, y, z = np.moveaxis(towards / np.linalg.norm(towards, axis=-1, keepdims=True), -1, 0)
    level = np.maximum(np.hypot(x, y), 1e-9)
    east = np.stack([-y / level, x / level, np.zeros_like(x)], axis=-1)
    north = np.stack([-z * x / level, -z * y / level, level], axis=-1)
    return east, north


def relative_path(ways: RelativePositions) -> RelativePath:
    """Fit the path of one track relative to another, and draw equally likely samples of it."""
    frequency = max(SIDEREAL_RAD_S, float(np.hypot(*ways.rate_arcsec_s)) * ARCSEC_RAD)
    ahead = ways.rate_arcsec_s / max(float(np.hypot(*ways.rate_arcsec_s)), 1e-9)
    axes = np.array([ahead, [-ahead[1], ahead[0]]])
    since_s = (ways.t_utc_ns - ways.t_utc_ns[-1]) / NS_PER_S
    terms = _terms(frequency * since_s)
    values = ways.ways_arcsec @ axes.T
    variances = np.einsum("ai,nij,aj->na", axes, ways.covariance_arcsec2, axes)
    fits = [_fit(terms, values[:, a], variances[:, a]) for a in (0, 1)]
    drawn = [_drawn(fit, a) for a, fit in enumerate(fits)]
    return RelativePath(
        t_utc_ns=int(ways.t_utc_ns[-1]),
        frequency_rad_s=frequency,
        axes=axes,
        samples=np.stack(drawn, axis=1),
        frames=len(since_s),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Fit:
    """Fit of one axis: a mixture over priors."""

    weights: FloatArray
    """(K,) weights of the priors."""
    means: FloatArray
    """(K, 6) mean coefficients."""
    roots: FloatArray
    """(K, 6, 6) factors of a standard normal that give the spread about the mean."""


def _fit(terms: FloatArray, values: FloatArray, variances: FloatArray) -> _Fit:
    fit, misfit = _fitted(terms, values, variances)
    freedom = len(values) - _TERMS
    if freedom > 0 and misfit > freedom:
        # The streaks err by more than they state.
        fit, _ = _fitted(terms, values, variances * misfit / freedom)
    return fit


def _fitted(terms: FloatArray, values: FloatArray, variances: FloatArray) -> tuple[_Fit, float]:
    """Fit of an axis, and the sum of squares that the likeliest prior leaves, in sigmas."""
    sigmas = _priors()
    weighted = terms / variances[:, None]
    normal, right = weighted.T @ terms, weighted.T @ values
    M = np.eye(_TERMS) + sigmas[:, :, None] * normal * sigmas[:, None, :]
    roots = np.linalg.inv(np.linalg.cholesky(M))
    half = np.einsum("kij,kj->ki", roots, sigmas * right)
    log_det = -np.sum(np.log(np.abs(np.diagonal(roots, axis1=1, axis2=2))), axis=1)
    evidence = 0.5 * np.sum(half**2, axis=1) - log_det
    weights = np.exp(evidence - np.max(evidence))
    means = sigmas * np.einsum("kji,kj->ki", roots, half)
    best = means[int(np.argmax(weights))]
    left = values - terms @ best
    fit = _Fit(
        weights=weights / weights.sum(),
        means=means,
        roots=sigmas[:, :, None] * np.swapaxes(roots, 1, 2),
    )
    return fit, float(np.sum(left**2 / variances))


@cache
def _priors() -> FloatArray:
    """(K, 6) one sigma of each coefficient by prior, all priors equally likely."""
    rows = []
    for swing, drift, share in itertools.product(
        _SWINGS_ARCSEC, _DRIFTS_ARCSEC_RAD, _OFFSET_SHARES
    ):
        half = (_OF_WIDE_SWINGS if swing >= _WIDE_ARCSEC else _HALF_TURN_SHARE) * swing
        least = _MIN_OFFSET_ARCSEC * share / _OFFSET_SHARES[0]
        rows.append([max(least, share * swing), drift, swing, swing, half, half])
    return np.array(rows)


def _drawn(fit: _Fit, axis: int) -> FloatArray:
    """(S, 6) equally likely coefficients."""
    share, normal = _draws(axis)
    chosen = np.searchsorted(np.cumsum(fit.weights), share * (1.0 - 1e-12))
    chosen = np.minimum(chosen, len(fit.weights) - 1)
    return np.asarray(fit.means[chosen] + np.einsum("sij,sj->si", fit.roots[chosen], normal))


@cache
def _draws(axis: int) -> tuple[FloatArray, FloatArray]:
    """Fixed random numbers: (S,) evenly from 0 to 1 in shuffled order, (S, 6) normal."""
    random = np.random.Generator(np.random.PCG64(axis))
    share = random.permutation((np.arange(SAMPLES) + 0.5) / SAMPLES)
    normal = random.standard_normal((SAMPLES, _TERMS))
    normal = (normal - normal.mean(axis=0)) / normal.std(axis=0)
    return share, normal


def _terms(angle: FloatArray) -> FloatArray:
    one = np.ones_like(angle)
    return np.stack(
        [*(one, angle, np.cos(angle), np.sin(angle)), *(np.cos(2.0 * angle), np.sin(2.0 * angle))],
        axis=-1,
    )


def _slopes(angle: FloatArray) -> FloatArray:
    one = np.ones_like(angle)
    return np.stack(
        [
            *(0.0 * one, one, -np.sin(angle), np.cos(angle)),
            *(-2.0 * np.sin(2.0 * angle), 2.0 * np.cos(2.0 * angle)),
        ],
        axis=-1,
    )


def _way(here: FloatArray, there: FloatArray, east: FloatArray, north: FloatArray) -> FloatArray:
    chord = there - here
    half = np.clip(np.linalg.norm(chord, axis=-1) / 2.0, 1e-12, 1.0)
    flat = np.stack([np.sum(chord * east, axis=-1), np.sum(chord * north, axis=-1)], axis=-1)
    return np.asarray(flat * (np.arcsin(half) / half)[..., None] / ARCSEC_RAD)


_STEPS = 73
"""Number of instants of the horizon at which a path is evaluated."""
_NEWTON_STEPS = 3
_LOW, _HIGH, _LOWEST, _HIGHEST = 16.0, 84.0, 2.5, 97.5
_AT_AN_END = 0.02
"""Share of the horizon within which the least separation counts as at its end."""


def pair_motion(
    tracks: tuple[int, int],
    path: RelativePath,
    t_utc_ns: int,
    *,
    warned_arcsec: float = 0.0,
    warned_ahead_s: float = 0.0,
) -> PairMotion:
    """Return the record of two tracks' relative motion at an instant.

    Its probability of an approach is that of a separation below ``warned_arcsec`` within the next
    ``warned_ahead_s`` seconds.
    """
    late_s = (t_utc_ns - path.t_utc_ns) / NS_PER_S
    since_s = late_s + np.linspace(0.0, path.horizon_s, _STEPS)
    ways = path.positions_at(since_s)
    now, rate = ways[:, 0], 60.0 * path.rates_at(since_s[:1])[:, 0]
    separation = np.hypot(*now.T)
    towards = now / np.maximum(separation, 1e-9)[:, None]
    separation_rate = np.sum(towards * rate, axis=1)
    east, north = np.mean(now, axis=0)
    angle_deg = float(np.degrees(np.arctan2(east, north))) % 360.0
    beside_deg = (np.degrees(np.arctan2(*now.T)) - angle_deg + 180.0) % 360.0 - 180.0
    at_s, nearest = closest_approaches(since_s, ways)
    after_s = at_s - late_s
    likely_s, soonest_s, latest_s = map(float, np.percentile(after_s, [50.0, _LOW, _HIGH]))
    share = likely_s / path.horizon_s
    kind: ClosestKind = (
        "now" if share < _AT_AN_END else "beyond" if share > 1.0 - _AT_AN_END else "ahead"
    )
    shares = [50.0, _LOW, _HIGH, _LOWEST, _HIGHEST]
    middle, low, high, lowest, highest = np.percentile(nearest, shares)
    soon = np.hypot(*np.moveaxis(ways[:, since_s - late_s <= warned_ahead_s], -1, 0))
    is_warned = (nearest < warned_arcsec) & (after_s <= warned_ahead_s)
    is_warned |= np.min(soon, axis=1, initial=np.inf) < warned_arcsec
    sigma_now, sigma_rate = np.std(now, axis=0), np.std(rate, axis=0)
    mean_rate = np.mean(rate, axis=0)
    return PairMotion(
        track_id=tracks[0],
        other_track_id=tracks[1],
        t_utc_ns=t_utc_ns,
        frames=path.frames,
        east_arcsec=_rounded(east),
        north_arcsec=_rounded(north),
        sigma_east_arcsec=_rounded(sigma_now[0]),
        sigma_north_arcsec=_rounded(sigma_now[1]),
        separation_arcsec=_rounded(np.mean(separation)),
        sigma_separation_arcsec=_rounded(np.std(separation)),
        position_angle_deg=_rounded(angle_deg) % 360.0,
        sigma_position_angle_deg=_rounded(np.sqrt(np.mean(beside_deg**2))),
        rate_east_arcsec_min=_rounded(mean_rate[0]),
        rate_north_arcsec_min=_rounded(mean_rate[1]),
        sigma_rate_east_arcsec_min=_rounded(sigma_rate[0]),
        sigma_rate_north_arcsec_min=_rounded(sigma_rate[1]),
        separation_rate_arcsec_min=_rounded(np.mean(separation_rate)),
        sigma_separation_rate_arcsec_min=_rounded(np.std(separation_rate)),
        closest=kind,
        closest_utc_ns=t_utc_ns + round(likely_s * NS_PER_S),
        sigma_closest_s=_rounded((latest_s - soonest_s) / 2.0),
        closest_arcsec=_rounded(middle),
        closest_low_arcsec=_rounded(low),
        closest_high_arcsec=_rounded(high),
        closest_lowest_arcsec=_rounded(lowest),
        closest_highest_arcsec=_rounded(highest),
        horizon_s=_rounded(path.horizon_s),
        path=_kind_of(ways, mean_rate / 60.0, since_s, likely_s + late_s),
        close_probability=_rounded(np.mean(is_warned)),
    )


def closest_approaches(since_s: FloatArray, ways: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the times and distances, (S,) each, of the closest approach of S paths to 0.

    ``ways``: the paths (S, M, 2) at evenly spaced instants ``since_s`` (M,), interpolated by a
    parabola through three instants.
    """
    squares = ways[..., 0] ** 2 + ways[..., 1] ** 2
    at = np.clip(np.argmin(squares, axis=1), 1, ways.shape[1] - 2)
    rows = np.arange(len(ways))
    before, middle, after = (ways[rows, at + step] for step in (-1, 0, 1))
    rate, bend = (after - before) / 2.0, (after + before) / 2.0 - middle
    x = np.zeros(len(ways))
    for _ in range(_NEWTON_STEPS):
        place = middle + rate * x[:, None] + bend * x[:, None] ** 2
        slope = rate + 2.0 * bend * x[:, None]
        curve = np.sum(slope**2, axis=1) + np.maximum(2.0 * np.sum(place * bend, axis=1), 0.0)
        x = np.clip(x - np.sum(place * slope, axis=1) / np.maximum(curve, 1e-12), -1.0, 1.0)
    place = middle + rate * x[:, None] + bend * x[:, None] ** 2
    step_s = float(since_s[1] - since_s[0])
    return np.asarray(since_s[at] + x * step_s), np.hypot(*place.T)


def _kind_of(
    ways: FloatArray, rate_arcsec_s: FloatArray, since_s: FloatArray, at_s: float
) -> PathKind:
    """Kind of the path: curved where its bend until it is nearest exceeds its error."""
    number = int(np.argmin(np.abs(since_s - at_s)))
    mean, start = np.mean(ways[:, number], axis=0), np.mean(ways[:, 0], axis=0)
    straight = start + rate_arcsec_s * (since_s[number] - since_s[0])
    sigma = float(np.hypot(*np.std(ways[:, number], axis=0)))
    return "curved" if float(np.hypot(*(mean - straight))) > sigma else "straight"


def _rounded(value: np.floating[Any] | float) -> float:
    """Round a value for the record to its useful digits."""
    return round(float(value), 3)
