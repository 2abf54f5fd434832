"""A straight streak as a blurred line with two ends, and its fit to raw pixels.

Model: amplitude(u) x Gaussian across x box along, the box's edges blurred by the same Gaussian (an
error function). The amplitude may change along the streak on a few knots, so that cloud, glint and
tumbling move neither end. The covariance contains the uncertainty of all parameters.
"""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray

_ITERATIONS = 20
_WIDTH_PRIOR = 0.35
"""Relative sigma of the width about the stars' own: it matters for faint streaks alone."""
_AMPLITUDE_PRIOR = 1.0
"""Change of amplitude between neighbouring knots, relative, one sigma."""
_SHAPE = 5
_FAR = 7.0
"""Distance from an end, in sigmas, beyond which its blur is less than 3e-12."""


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
    is_free = np.ones(parameters.size, dtype=bool)
    is_free[0], is_free[1] = start.u_a is not None, start.u_b is not None
    free = np.ix_(np.flatnonzero(is_free), np.flatnonzero(is_free))
    hats = _hats(pixels.u, start)
    value, jacobian = _evaluate(pixels, parameters, start, hats)
    light = np.maximum(value - start.sky, 0.0)
    weight = 1.0 / (pixels.noise**2 + max(excess, 0.0) * light)
    prior_j, believed = _prior(start, psf_sigma, parameters.size)
    residual, prior_r = pixels.value - value, prior_j @ (parameters - believed)
    cost = float(weight @ residual**2 + prior_r @ prior_r)
    normal = (jacobian * weight) @ jacobian.T + prior_j.T @ prior_j
    damping = 1e-3
    for _ in range(_ITERATIONS):
        gradient = jacobian @ (weight * residual) - prior_j.T @ prior_r
        damped = normal + damping * np.diag(np.diag(normal) + 1e-12)
        step = np.zeros(parameters.size)
        try:
            step[is_free] = np.linalg.solve(damped[free], gradient[is_free])
        except np.linalg.LinAlgError:
            return None
        if not np.all(np.isfinite(step)):
            return None
        trial = _bounded(parameters + step, start, psf_sigma)
        trial_value, trial_jacobian = _evaluate(pixels, trial, start, hats)
        trial_residual, trial_prior = pixels.value - trial_value, prior_j @ (trial - believed)
        trial_cost = float(weight @ trial_residual**2 + trial_prior @ trial_prior)
        if trial_cost > cost:
            damping = min(damping * 8.0, 1e6)
            continue
        is_converged = cost - trial_cost < 1e-3
        parameters, value, jacobian, cost = trial, trial_value, trial_jacobian, trial_cost
        residual, prior_r, damping = trial_residual, trial_prior, damping / 5.0
        normal = (jacobian * weight) @ jacobian.T + prior_j.T @ prior_j
        if is_converged:
            break
    try:
        inverse = np.linalg.inv(normal[free])
    except np.linalg.LinAlgError:
        return None
    if not np.all(np.isfinite(inverse)) or np.any(np.diag(inverse) < 0):
        return None
    covariance = np.zeros((parameters.size, parameters.size))
    covariance[free] = inverse
    line, model = _unpack(parameters, start), value - parameters[-1]
    return LineFit(
        line=line,
        covariance=covariance[:4, :4],
        excess=source_variance_per_adu(pixels, line, model),
        model=model,
    )


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


def _unpack(p: FloatArray, start: StreakModel) -> StreakModel:
    return StreakModel(
        u_a=None if start.u_a is None else float(p[0]),
        u_b=None if start.u_b is None else float(p[1]),
        offset=float(p[2]),
        slope=float(p[3]),
        sigma=float(p[4]),
        amplitudes=tuple(float(a) for a in p[_SHAPE:-1]),
        knot_range=start.knot_range,
        sky=float(p[-1]),
    )


def _evaluate(
    pixels: StreakPixels, p: FloatArray, start: StreakModel, hats: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Model values (n,) and their derivatives (parameters, n)."""
    u, v = pixels.u, pixels.v
    u_a, u_b, offset, slope, sigma = p[:_SHAPE].tolist()
    rise, normal_a = _step(u, u_a, sigma) if start.u_a is not None else (1.0, np.zeros(u.size))
    fall, normal_b = _step(u, u_b, sigma) if start.u_b is not None else (-1.0, np.zeros(u.size))
    edge = 0.5 * (rise - fall)
    scale = 1.0 / (math.sqrt(2.0 * math.pi) * sigma)
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


def _step(u: FloatArray, at: float, sigma: float) -> tuple[FloatArray, FloatArray]:
    """Error function of a blurred step from -1 to 1, and the Gaussian of its blur."""
    from scipy.special import erf

    t = (u - at) / sigma
    step, normal = np.sign(t), np.zeros(u.size)
    near = np.flatnonzero(np.abs(t) < _FAR)
    t = t[near]
    step[near] = erf(t / math.sqrt(2.0))
    normal[near] = np.exp(-0.5 * t * t) / (math.sqrt(2.0 * math.pi) * sigma)
    return step, normal


def _hats(u: FloatArray, line: StreakModel) -> FloatArray:
    """Linear interpolation weights (count, n); beyond the range the last knot holds."""
    count, (low, high) = len(line.amplitudes), line.knot_range
    if count == 1:
        return np.ones((1, u.size))
    place = np.clip((u - low) / max(high - low, 1e-6), 0.0, 1.0) * (count - 1)
    return np.maximum(0.0, 1.0 - np.abs(place - np.arange(count)[:, None]))


def _prior(start: StreakModel, psf_sigma: float, size: int) -> tuple[FloatArray, FloatArray]:
    """Derivatives of the priors' residuals, in sigmas, and the parameters that they believe in."""
    count = len(start.amplitudes)
    jacobian, believed = np.zeros((count, size)), np.zeros(size)
    jacobian[0, 4], believed[4] = 1.0 / (_WIDTH_PRIOR * psf_sigma), psf_sigma
    level = max(float(np.mean(np.abs(start.amplitudes))), 1e-6) * _AMPLITUDE_PRIOR
    for k in range(1, count):
        jacobian[k, _SHAPE + k], jacobian[k, _SHAPE + k - 1] = 1.0 / level, -1.0 / level
    return jacobian, believed


def _bounded(p: FloatArray, start: StreakModel, psf_sigma: float) -> FloatArray:
    p = p.copy()
    p[4] = float(np.clip(p[4], 0.25 * psf_sigma, 6.0 * psf_sigma))
    if start.u_a is not None and start.u_b is not None and p[1] - p[0] < 1.0:
        middle = 0.5 * (p[0] + p[1])
        p[0], p[1] = middle - 0.5, middle + 0.5
    return p
