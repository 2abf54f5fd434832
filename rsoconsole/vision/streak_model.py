"""A straight streak as a blurred line, the stars beside it as points, and their fit to raw pixels.

Model: amplitude(u) x Gaussian across x box along, the box's edges blurred by the same Gaussian
(an error function), points of light with a place and a flux of their own, and a level of sky. The
amplitude may change along the streak on a few knots. The ends stay where they are given: they
have no parabolic chi2 and are found by ``streak_ends``.
"""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray
from rsoconsole.vision.streak_noise import SourceNoise, excess_of, unsteady_of, variance_of

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.intp]

_WINGS = ((0.88, 1.0), (0.12, 2.2))
"""Share of a star's light and width relative to its core: a Moffat disc of beta 3.5, roughly."""
_STAR_REACH = 6.0
_EDGE_REACH = 5.0
_WIDTH_PRIOR = 0.35
"""Relative one-sigma of the width about the stars' own: it matters for faint streaks alone."""
_AMPLITUDE_PRIOR = 0.7
"""Change of amplitude between neighbouring knots, relative, one sigma."""
_PLACE_PRIOR_PX = 0.6
_LARGEST_STEP_PX = 1.5
_FAR_OFF_PX = 12.0
_SHAPE = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pixels:
    """Pixels about one streak in its own axes: u along, v across, both from a first guess."""

    u: FloatArray
    v: FloatArray
    value: FloatArray
    """ADU above the sky."""
    noise: float
    """One sigma of a pixel of plain sky, ADU."""
    variance: FloatArray
    """Of each without the streak, ADU^2: the sky's, and of a giant star's halo taken away."""
    index: IntArray
    """Place of each in the flattened cutout."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Line:
    """Parameters of the line. An end that is outside the frame is None."""

    u_a: float | None
    u_b: float | None
    offset: float
    """v of the line at u = 0."""
    slope: float
    sigma: float
    """Of the Gaussian across, px."""
    amplitudes: tuple[float, ...]
    """ADU per pixel of length at knots evenly spaced over ``knot_range``."""
    knot_range: tuple[float, float]
    sky: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Points:
    """Stars beside or on the line; one entry each."""

    u: FloatArray
    v: FloatArray
    flux: FloatArray
    """ADU in all."""

    def __len__(self) -> int:
        return int(self.u.size)


NO_POINTS = Points(u=np.zeros(0), v=np.zeros(0), flux=np.zeros(0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineFit:
    """A converged line and the stars beside it."""

    line: Line
    points: Points
    covariance: FloatArray
    """(2, 2) of offset and slope."""
    noise: SourceNoise
    light: FloatArray
    """Of the line alone, ADU at every pixel."""
    glare: FloatArray
    """Of the stars alone."""


def fit_line(
    pixels: Pixels,
    start: Line,
    points: Points,
    psf_sigma: float,
    *,
    noise: SourceNoise,
    steps: int,
) -> LineFit | None:
    """Gauss-Newton from ``start``, ends held; None when it runs away or its matrix is singular."""
    line, count = start, len(start.amplitudes)
    parameters = _pack(line, points)
    light, glare, jacobian = _evaluate(pixels, line, points, psf_sigma)
    inverse: FloatArray = np.zeros((parameters.size, parameters.size))
    for step in range(steps + 1):
        weight = 1.0 / variance_of(pixels.variance, light, glare, noise)
        residual = pixels.value - line.sky - light - glare
        prior_j, prior_r = _priors(parameters, count, psf_sigma, start, points)
        weighted = jacobian * weight[:, None]
        normal = weighted.T @ jacobian + prior_j.T @ prior_j
        try:
            inverse = np.asarray(np.linalg.inv(normal), dtype=np.float64)
        except np.linalg.LinAlgError:
            return None
        if not np.all(np.isfinite(inverse)) or np.any(np.diag(inverse) < 0):
            return None
        if step == steps:
            break
        change = inverse @ (weighted.T @ residual - prior_j.T @ prior_r)
        change = _limited(change, line, count, psf_sigma)
        parameters = parameters + change
        stars = parameters[_SHAPE + count + 1 :: 3]
        stars[:] = np.maximum(stars, 0.0)
        parameters[2] = np.clip(parameters[2], 0.3 * psf_sigma, 6.0 * psf_sigma)
        line, points = _unpack(parameters, line, len(points))
        if abs(line.offset - start.offset) > _FAR_OFF_PX:
            return None
        light, glare, jacobian = _evaluate(pixels, line, points, psf_sigma)
        if float(np.max(np.abs(change) / np.sqrt(np.diag(inverse)))) < 0.03:
            break
    return LineFit(
        line=line,
        points=points,
        covariance=inverse[:2, :2],
        noise=_noise_of(pixels, line, light, glare),
        light=light,
        glare=glare,
    )


def _noise_of(pixels: Pixels, line: Line, light: FloatArray, glare: FloatArray) -> SourceNoise:
    """What the residuals say of the source's own noise."""
    residual = pixels.value - line.sky - light - glare
    width, (low, high) = 2.36 * line.sigma, line.knot_range
    inside = (pixels.u > low + width) & (pixels.u < high - width) & (glare < 0.1 * light)
    return SourceNoise(
        excess=excess_of(residual, pixels.variance, light, glare),
        unsteady=unsteady_of(
            (residual + glare)[inside],
            light[inside],
            pixels.u[inside] - low,
            sigma=line.sigma,
            pixel_variance=pixels.noise**2,
        ),
    )


def light_at(u: FloatArray, v: FloatArray, line: Line) -> FloatArray:
    """What the line sheds on these pixels, ADU."""
    edge, _ = _edge(u, line)
    amplitude = _hats(u, len(line.amplitudes), line.knot_range) @ np.array(line.amplitudes)
    return np.asarray(amplitude * edge * across_profile(u, v, line))


def across_profile(u: FloatArray, v: FloatArray, line: Line) -> FloatArray:
    """Share of the light at u that falls on a pixel; unit integral across."""
    t = (v - line.offset - line.slope * u) / line.sigma
    return np.asarray(np.exp(-0.5 * t * t) / (np.sqrt(2.0 * np.pi) * line.sigma))


def amplitude_at(u: FloatArray, line: Line) -> FloatArray:
    """ADU per pixel of length, held beyond the outer knots."""
    knots = np.linspace(*line.knot_range, len(line.amplitudes))
    return np.asarray(np.interp(u, knots, line.amplitudes), dtype=np.float64)


def with_knots(line: Line, count: int, knot_range: tuple[float, float]) -> Line:
    """The same line with its amplitude on ``count`` knots over another range."""
    places = np.linspace(*knot_range, count)
    new = amplitude_at(places, line)
    return replace(line, amplitudes=tuple(float(a) for a in new), knot_range=knot_range)


def _pack(line: Line, points: Points) -> FloatArray:
    stars = np.stack([points.flux, points.u, points.v], axis=1).ravel()
    head = [line.offset, line.slope, line.sigma, *line.amplitudes, line.sky]
    return np.concatenate([np.array(head, dtype=np.float64), stars])


def _unpack(p: FloatArray, line: Line, stars: int) -> tuple[Line, Points]:
    count = len(line.amplitudes)
    each = p[_SHAPE + count + 1 :].reshape(stars, 3)
    moved = replace(
        line,
        offset=float(p[0]),
        slope=float(p[1]),
        sigma=float(p[2]),
        amplitudes=tuple(float(a) for a in p[_SHAPE : _SHAPE + count]),
        sky=float(p[_SHAPE + count]),
    )
    return moved, Points(flux=each[:, 0], u=each[:, 1], v=each[:, 2])


def _edge(u: FloatArray, line: Line) -> tuple[FloatArray, FloatArray]:
    """Box along with blurred edges, (n,), and its derivative by the width."""
    from scipy.special import erf

    edge, by_sigma = np.ones(u.size), np.zeros(u.size)
    for end, sign in ((line.u_a, 1.0), (line.u_b, -1.0)):
        if end is None:
            continue
        t = sign * (u - end) / line.sigma
        near = np.flatnonzero(np.abs(t) < _EDGE_REACH)
        step = (t > 0).astype(np.float64)
        step[near] = 0.5 * (1.0 + erf(t[near] / np.sqrt(2.0)))
        slope = np.exp(-0.5 * t[near] ** 2) / np.sqrt(2.0 * np.pi)
        by_sigma *= step
        by_sigma[near] -= edge[near] * slope * t[near] / line.sigma
        edge *= step
    return edge, by_sigma


def _evaluate(
    pixels: Pixels, line: Line, points: Points, psf_sigma: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Light of the line and of the stars (n,), and the derivatives (n, parameters)."""
    u, v, sigma, count = pixels.u, pixels.v, line.sigma, len(line.amplitudes)
    jacobian = np.zeros((u.size, _SHAPE + count + 1 + 3 * len(points)))
    edge, edge_by_sigma = _edge(u, line)
    t = (v - line.offset - line.slope * u) / sigma
    across = np.exp(-0.5 * t * t) / (np.sqrt(2.0 * np.pi) * sigma)
    shape = across * edge
    hats = _hats(u, count, line.knot_range)
    amplitude = hats @ np.array(line.amplitudes)
    light = amplitude * shape
    jacobian[:, 0] = light * t / sigma
    jacobian[:, 1] = jacobian[:, 0] * u
    jacobian[:, 2] = light * (t * t - 1.0) / sigma + amplitude * across * edge_by_sigma
    jacobian[:, _SHAPE : _SHAPE + count] = hats * shape[:, None]
    jacobian[:, _SHAPE + count] = 1.0
    glare = np.zeros(u.size)
    for k in range(len(points)):
        near, columns = star_columns(pixels, points, k, psf_sigma)
        first = _SHAPE + count + 1 + 3 * k
        jacobian[near, first : first + 3] = columns
        glare[near] += points.flux[k] * columns[:, 0]
    return light, glare, jacobian


def star_columns(
    pixels: Pixels, points: Points, k: int, psf_sigma: float
) -> tuple[IntArray, FloatArray]:
    """Pixels that star k lights, and the derivatives there by its flux, u and v, (n, 3)."""
    reach = _STAR_REACH * psf_sigma
    du, dv = pixels.u - points.u[k], pixels.v - points.v[k]
    near = np.flatnonzero((np.abs(du) < reach) & (np.abs(dv) < reach))
    du, dv = du[near], dv[near]
    r2 = (du * du + dv * dv) / psf_sigma**2
    columns = np.zeros((near.size, 3))
    for share, width in _WINGS:
        s2 = (width * psf_sigma) ** 2
        part = share / (2.0 * np.pi * s2) * np.exp(-0.5 * r2 / width**2)
        columns[:, 0] += part
        slope = points.flux[k] / s2 * part
        columns[:, 1] += slope * du
        columns[:, 2] += slope * dv
    return near, columns


def _hats(u: FloatArray, count: int, knot_range: tuple[float, float]) -> FloatArray:
    """Linear interpolation weights (n, count); beyond the range the last knot holds."""
    if count == 1:
        return np.ones((u.size, 1))
    low, high = knot_range
    place = np.clip((u - low) / max(high - low, 1e-6), 0.0, 1.0) * (count - 1)
    return np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(count)))


def _priors(
    p: FloatArray, count: int, psf_sigma: float, start: Line, begun: Points
) -> tuple[FloatArray, FloatArray]:
    """Derivatives and residuals of what is believed beforehand, in sigmas."""
    stars = len(begun)
    jacobian = np.zeros((2 * count + 2 * stars, p.size))
    believed = np.zeros(p.size)
    jacobian[0, 2] = 1.0 / (_WIDTH_PRIOR * psf_sigma)
    believed[2] = psf_sigma
    mean = max(float(np.mean(np.abs(start.amplitudes))), 1e-6)
    level = mean * _AMPLITUDE_PRIOR
    for k in range(1, count):
        jacobian[k, _SHAPE + k], jacobian[k, _SHAPE + k - 1] = 1.0 / level, -1.0 / level
    for k in range(count):
        # Hardly felt, but for a line of which masks leave nothing to see.
        jacobian[count + k, _SHAPE + k] = 1.0 / (5.0 * mean)
    for k in range(stars):
        first = _SHAPE + count + 1 + 3 * k
        for axis, place in ((1, begun.u[k]), (2, begun.v[k])):
            jacobian[2 * count + 2 * k + axis - 1, first + axis] = 1.0 / _PLACE_PRIOR_PX
            believed[first + axis] = place
    return jacobian, jacobian @ (p - believed)


def _limited(change: FloatArray, line: Line, count: int, psf_sigma: float) -> FloatArray:
    """A step cut back to where the linear model holds."""
    half = max(0.5 * (line.knot_range[1] - line.knot_range[0]), 1.0)
    change = change.copy()
    change[0] = np.clip(change[0], -_LARGEST_STEP_PX, _LARGEST_STEP_PX)
    change[1] = np.clip(change[1], -_LARGEST_STEP_PX / half, _LARGEST_STEP_PX / half)
    change[2] = np.clip(change[2], -0.3 * psf_sigma, 0.3 * psf_sigma)
    places = change[_SHAPE + count + 1 :].reshape(-1, 3)
    places[:, 1:] = np.clip(places[:, 1:], -0.7, 0.7)
    return change
