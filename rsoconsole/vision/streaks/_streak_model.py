"""A straight streak as a blurred line with two ends, and its fit to raw pixels.

Model: amplitude(u) x Gaussian across x box along, the box's edges blurred by the same Gaussian (an
error function). The amplitude may change along the streak on a few knots, so that cloud, glint and
tumbling move neither end. The covariance contains the uncertainty of all parameters.
"""

from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.vision.arrays import BoolArray

_ITERATIONS = 20
_WIDTH_PRIOR = 0.35
"""Relative sigma of the width about the stars' own: it matters for faint streaks alone."""
_AMPLITUDE_PRIOR = 1.0
"""Change of amplitude between neighbouring knots, relative, one sigma."""
_SHAPE = 5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StreakPixels:
    """Pixels about one streak, arrays (n,), in axes along and across a first guess of it.

    u runs along the streak, v across it, px.
    """

    u: FloatArray
    v: FloatArray
    value: FloatArray
    """ADU above the sky."""
    noise: float
    """One sigma of a pixel of plain sky, ADU."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StreakModel:
    """Parameters of the model of a streak; an end outside the frame is None."""

    u_a: float | None
    u_b: float | None
    offset: float
    """v of the line at u = 0, px."""
    slope: float
    sigma: float
    """Sigma of the Gaussian across, px."""
    amplitudes: tuple[float, ...]
    """Amplitudes in ADU per pixel of length, at knots evenly spaced over ``knot_range``."""
    knot_range: tuple[float, float]
    sky: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineFit:
    """Line fitted to pixels, with its covariance."""

    line: StreakModel
    covariance: FloatArray
    """(4, 4) of u_a, u_b, offset, slope; rows of an end outside the frame are 0."""
    excess: float
    """Variance that the source's own light adds, ADU^2 per ADU: photons, and a different PSF."""
    model: FloatArray
    """Model at every pixel, ADU, without the sky term."""
    hidden_variance: tuple[float, float] = (0.0, 0.0)
    """Variance added to either end, px^2, where a star hides it: the end may be anywhere behind."""


def fit_line(
    pixels: StreakPixels, start: StreakModel, psf_sigma: float, *, excess: float = 0.0
) -> LineFit | None:
    """Fit a line by Levenberg-Marquardt from ``start``; None when it diverges or becomes singular.

    ``psf_sigma``: sigma of the stars, px; the line's width has a prior about it. ``excess``: as in
    ``LineFit``, for the weights.
    """
    parameters = _pack(start)
    free = np.ones(parameters.size, dtype=bool)
    free[0], free[1] = start.u_a is not None, start.u_b is not None
    weight = _weights(pixels, start, excess)
    prior_j, prior_r = _priors(start, psf_sigma, parameters)
    damping = 1e-3
    hats = _hats(pixels.u, start)
    value, jacobian = _evaluate(pixels, parameters, start, hats)
    residual = pixels.value - value
    cost = float(weight @ residual**2 + np.sum(prior_r**2))
    for _ in range(_ITERATIONS):
        normal = (jacobian * weight) @ jacobian.T + prior_j.T @ prior_j
        gradient = jacobian @ (weight * residual) - prior_j.T @ prior_r
        damped = normal + damping * np.diag(np.diag(normal) + 1e-12)
        step = _solve(damped, gradient, free)
        if step is None:
            return None
        trial = _bounded(parameters + step, start, psf_sigma)
        trial_value, trial_jacobian = _evaluate(pixels, trial, start, hats)
        trial_residual = pixels.value - trial_value
        _, trial_prior = _priors(start, psf_sigma, trial)
        trial_cost = float(weight @ trial_residual**2 + np.sum(trial_prior**2))
        if trial_cost > cost:
            damping = min(damping * 8.0, 1e6)
            continue
        is_converged = cost - trial_cost < 1e-3
        parameters, residual, jacobian, cost = trial, trial_residual, trial_jacobian, trial_cost
        prior_r, damping = trial_prior, damping / 5.0
        if is_converged:
            break
    normal = (jacobian * weight) @ jacobian.T + prior_j.T @ prior_j
    return _finish(pixels, parameters, start, normal=normal, free=free)


def model_light_adu(pixels: StreakPixels, line: StreakModel) -> FloatArray:
    """Return the light of the line in every pixel, (n,), ADU, without its sky term."""
    value, _ = _evaluate(pixels, _pack(line), line, _hats(pixels.u, line))
    return value - line.sky


def source_variance_per_adu(pixels: StreakPixels, line: StreakModel, model: FloatArray) -> float:
    """Return a pixel's variance per ADU of the streak's light, by the residuals; 0 or more.

    ``model``: the line's light in every pixel, ADU. Residuals are limited to four sigma, since
    light of other sources is not noise.
    """
    source = np.maximum(model, 0.0)
    total = float(source @ source)
    residual2 = (pixels.value - line.sky - model) ** 2
    excess = 0.0
    for _ in range(3):
        limit = 16.0 * (pixels.noise**2 + max(excess, 0.2 * pixels.noise) * source)
        squared = np.minimum(residual2, limit) - pixels.noise**2
        excess = max(0.0, float(source @ squared) / total) if total > 0 else 0.0
    return excess


def with_amplitude_knots(line: StreakModel, count: int) -> StreakModel:
    """Return the line with its amplitude interpolated to ``count`` knots."""
    low, high = line.knot_range
    old = np.linspace(low, high, len(line.amplitudes))
    new = np.interp(np.linspace(low, high, count), old, line.amplitudes)
    return StreakModel(
        u_a=line.u_a,
        u_b=line.u_b,
        offset=line.offset,
        slope=line.slope,
        sigma=line.sigma,
        amplitudes=tuple(float(a) for a in new),
        knot_range=line.knot_range,
        sky=line.sky,
    )


def _pack(line: StreakModel) -> FloatArray:
    low, high = line.knot_range
    head = [
        low if line.u_a is None else line.u_a,
        high if line.u_b is None else line.u_b,
        line.offset,
        line.slope,
        line.sigma,
    ]
    return np.array([*head, *line.amplitudes, line.sky], dtype=np.float64)


def _evaluate(
    pixels: StreakPixels, p: FloatArray, start: StreakModel, hats: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Model values (n,) and their derivatives (parameters, n)."""
    from scipy.special import erf

    u, v = pixels.u, pixels.v
    u_a, u_b, offset, slope, sigma = p[:_SHAPE]
    root = np.sqrt(2.0) * sigma
    edge = np.zeros(u.size)
    normal_a, normal_b = np.zeros(u.size), np.zeros(u.size)
    scale = 1.0 / (np.sqrt(2.0 * np.pi) * sigma)
    rise, fall = np.ones(u.size), -np.ones(u.size)
    if start.u_a is not None:
        rise = erf((u - u_a) / root)
        normal_a = scale * np.exp(-0.5 * ((u - u_a) / sigma) ** 2)
    if start.u_b is not None:
        fall = erf((u - u_b) / root)
        normal_b = scale * np.exp(-0.5 * ((u - u_b) / sigma) ** 2)
    edge = 0.5 * (rise - fall)
    t = (v - offset - slope * u) / sigma
    across = scale * np.exp(-0.5 * t * t)
    lit = (p[_SHAPE:-1] @ hats) * across
    body = lit * edge
    jacobian = np.empty((p.size, u.size))
    np.multiply(lit, -normal_a, out=jacobian[0])
    np.multiply(lit, normal_b, out=jacobian[1])
    np.multiply(body, t / sigma, out=jacobian[2])
    np.multiply(jacobian[2], u, out=jacobian[3])
    blur = (normal_b * (u - u_b) - normal_a * (u - u_a)) / sigma
    jacobian[4] = body * (t * t - 1.0) / sigma + lit * blur
    np.multiply(hats, across * edge, out=jacobian[_SHAPE:-1])
    jacobian[-1] = 1.0
    return body + p[-1], jacobian


def _hats(u: FloatArray, line: StreakModel) -> FloatArray:
    """Linear interpolation weights (count, n); beyond the range the last knot holds."""
    count, (low, high) = len(line.amplitudes), line.knot_range
    if count == 1:
        return np.ones((1, u.size))
    place = np.clip((u - low) / max(high - low, 1e-6), 0.0, 1.0) * (count - 1)
    return np.maximum(0.0, 1.0 - np.abs(place - np.arange(count)[:, None]))


def _weights(pixels: StreakPixels, line: StreakModel, excess: float) -> FloatArray:
    variance = np.full(pixels.u.size, pixels.noise**2)
    if excess > 0:
        model = model_light_adu(pixels, line)
        variance += excess * np.maximum(model, 0.0)
    return 1.0 / variance


def _priors(start: StreakModel, psf_sigma: float, p: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives and residuals of the priors, in sigmas."""
    count = len(start.amplitudes)
    jacobian = np.zeros((count, p.size))
    jacobian[0, 4] = 1.0 / (_WIDTH_PRIOR * psf_sigma)
    level = max(float(np.mean(np.abs(start.amplitudes))), 1e-6) * _AMPLITUDE_PRIOR
    for k in range(1, count):
        jacobian[k, _SHAPE + k], jacobian[k, _SHAPE + k - 1] = 1.0 / level, -1.0 / level
    believed = np.zeros(p.size)
    believed[4] = psf_sigma
    return jacobian, jacobian @ (p - believed)


def _solve(matrix: FloatArray, vector: FloatArray, free: BoolArray) -> FloatArray | None:
    step = np.zeros(vector.size)
    try:
        step[free] = np.linalg.solve(matrix[np.ix_(free, free)], vector[free])
    except np.linalg.LinAlgError:
        return None
    return step if np.all(np.isfinite(step)) else None


def _bounded(p: FloatArray, start: StreakModel, psf_sigma: float) -> FloatArray:
    p = p.copy()
    p[4] = float(np.clip(p[4], 0.25 * psf_sigma, 6.0 * psf_sigma))
    if start.u_a is not None and start.u_b is not None and p[1] - p[0] < 1.0:
        middle = 0.5 * (p[0] + p[1])
        p[0], p[1] = middle - 0.5, middle + 0.5
    return p


def _finish(
    pixels: StreakPixels, p: FloatArray, start: StreakModel, *, normal: FloatArray, free: BoolArray
) -> LineFit | None:
    try:
        inverse = np.linalg.inv(normal[np.ix_(free, free)])
    except np.linalg.LinAlgError:
        return None
    if not np.all(np.isfinite(inverse)) or np.any(np.diag(inverse) < 0):
        return None
    covariance = np.zeros((p.size, p.size))
    covariance[np.ix_(free, free)] = inverse
    value, _ = _evaluate(pixels, p, start, _hats(pixels.u, start))
    line = StreakModel(
        u_a=None if start.u_a is None else float(p[0]),
        u_b=None if start.u_b is None else float(p[1]),
        offset=float(p[2]),
        slope=float(p[3]),
        sigma=float(p[4]),
        amplitudes=tuple(float(a) for a in p[_SHAPE:-1]),
        knot_range=start.knot_range,
        sky=float(p[-1]),
    )
    model = value - p[-1]
    return LineFit(
        line=line,
        covariance=covariance[:4, :4],
        excess=source_variance_per_adu(pixels, line, model),
        model=model,
    )
