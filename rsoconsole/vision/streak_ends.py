"""Where a streak's light ends: the probability of each place, stars that nobody has seen included.

For every place on a grid the raw pixels about it are fitted with light that begins there, once
without and once with a star anywhere near. The sum of what is left, weighted by how often a star
stands there, is the end's probability: its mean is the end, its spread the end's sigma. So an end
behind a masked star is as uncertain as the mask is wide, and light that drowns in noise has the
sigma that it deserves, which no parabola through the best fit gives.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray
from rsoconsole.vision.streak_model import (
    IntArray,
    LineFit,
    Pixels,
    across_profile,
    amplitude_at,
    star_columns,
)
from rsoconsole.vision.streak_noise import variance_of

Float32Array = npt.NDArray[np.float32]

_INSIDE_PX = 24.0
"""How much of the lit side is looked at: the light there sets the level."""
_RANGE_PX, _NEAR_PX = 12.0, 4.0
_FURTHEST_PX = 45.0
_LEAST_REACH_PX = 24.0
_COARSE_STEP, _NEAR_STEP = 1.6, 0.8
"""Spacing of the first places tried, in sigmas of a star's disc."""
_FINE_TRIALS = 25
_LEAST_LIKELY = 10.0
"""Natural logarithm of the odds against a place from which it is not looked at any closer."""
_SCALE_PRIOR, _TILT_PRIOR = 0.3, 0.4
"""One sigma of the light near an end relative to the line's there: its level, and its change
over the ``_INSIDE_PX`` next to the end."""
_STARS_PER_PX2 = 1.0 / 700.0
"""Stars about as bright as the streak, per e-fold of brightness, in a field of the Milky Way."""
_COARSE_STARS, _FINE_STARS = (1.6, 3), (1.15, 5)
"""Places tried for a star: their spacing in sigmas of its disc, and how many across."""
_DIMMEST = 0.5
"""Of the mean light along the line."""
_FLOOR_PX = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class End:
    """One end along the line."""

    u: float
    sigma_px: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Side:
    """Pixels with the axis turned so that the light lies at greater w."""

    w: FloatArray
    v: FloatArray
    """Across, from the line."""
    value: FloatArray
    """Over its sigma, sky and known stars taken away; (n,) like all that follow."""
    light: FloatArray
    """Of the line were it endless on this side, over the same sigma."""
    scale: FloatArray
    """1 / sigma."""
    known: FloatArray
    """(n, m) derivatives by what else is fitted, over the same sigma."""
    believed: FloatArray
    """(m,) inverse variance that each of those has beforehand."""
    edge_sigma: float


def find_end(
    pixels: Pixels, fit: LineFit, side: int, psf_sigma: float, *, is_near: bool = False
) -> End:
    """The end at the side of low u (0) or high u (1) of a fitted line that has one there.

    ``is_near``: the fitted end is known to be good to a pixel or so.
    """
    turn = 1.0 if side == 0 else -1.0
    line = fit.line
    ends = (line.u_a, line.u_b) if side == 0 else (line.u_b, line.u_a)
    begun = turn * (ends[0] if ends[0] is not None else line.knot_range[side])
    last = turn * (ends[1] if ends[1] is not None else line.knot_range[1 - side])
    reach = max(_NEAR_PX if is_near else _RANGE_PX, 5.0 * psf_sigma)
    step = (_NEAR_STEP if is_near else _COARSE_STEP) * psf_sigma
    # Beyond the strip nothing would speak against a light that goes on and on.
    lowest = begun - strip_reach(psf_sigma) + 3.0 * psf_sigma
    highest = min(begun + _FURTHEST_PX, last - 2.0)
    low, high = max(begun - reach, lowest), max(min(begun + reach, highest), begun + 2.0)
    while True:
        places = np.arange(low, high + 0.5 * step, step)
        side_of = _side_of(pixels, fit, side, places, psf_sigma)
        chance = _chances(side_of, places, psf_sigma, _COARSE_STARS)
        is_likely = np.flatnonzero(chance > chance.max() - _LEAST_LIKELY)
        runs_low = is_likely[0] == 0 and low > lowest
        runs_high = is_likely[-1] == len(places) - 1 and high < highest
        if not (runs_low or runs_high):
            break
        wider = high - low
        low = max(low - wider, lowest) if runs_low else low
        high = min(high + wider, highest) if runs_high else high
        step = max(step, (high - low) / 36.0)
    first, final = max(is_likely[0] - 1, 0), min(is_likely[-1] + 1, len(places) - 1)
    fine = np.linspace(places[first], places[final], _FINE_TRIALS)
    for _ in range(2):
        side_of = _side_of(pixels, fit, side, fine, psf_sigma)
        chance = _chances(side_of, fine, psf_sigma, _FINE_STARS)
        weight = np.exp(chance - chance.max())
        weight /= weight.sum()
        mean = float(weight @ fine)
        sigma = float(np.sqrt(weight @ (fine - mean) ** 2))
        spacing = float(fine[1] - fine[0])
        if sigma > 0.7 * spacing:
            break
        fine = np.linspace(mean - 3.0 * spacing, mean + 3.0 * spacing, _FINE_TRIALS)
    return End(u=turn * mean, sigma_px=float(np.hypot(sigma, _FLOOR_PX)))


def strip_reach(psf_sigma: float) -> float:
    """How far beyond a guessed end pixels are wanted, px."""
    return max(_LEAST_REACH_PX, 10.0 * psf_sigma)


def _side_of(
    pixels: Pixels, fit: LineFit, side: int, places: FloatArray, psf_sigma: float
) -> _Side:
    """The pixels that tell about an end in the range of ``places``."""
    turn, line = (1.0 if side == 0 else -1.0), fit.line
    w = turn * pixels.u
    inside = max(_INSIDE_PX, 8.0 * psf_sigma)
    near = (w > places[0] - 3.0 * psf_sigma - 1.0) & (w < places[-1] + inside)
    v = pixels.v - line.offset - line.slope * pixels.u
    chosen = np.flatnonzero(near & (np.abs(v) < 3.0 * line.sigma + 1.0))
    u = pixels.u[chosen]
    shining = fit.light[chosen], fit.glare[chosen]
    variance = variance_of(pixels.variance[chosen], *shining, fit.noise)
    scale = 1.0 / np.sqrt(variance)
    # The knots next to the end are no witness: a guess that reaches too far has dark ones.
    low, high = line.knot_range
    trusted = min(inside, 0.4 * (high - low))
    held = np.maximum(u, low + trusted) if side == 0 else np.minimum(u, high - trusted)
    level = max(float(np.mean(np.abs(line.amplitudes))), 1e-6)
    light = np.clip(amplitude_at(held, line), _DIMMEST * level, None)
    light *= across_profile(u, pixels.v[chosen], line)
    other = line.u_b if side == 0 else line.u_a
    if other is not None:
        light *= _step((turn * other - w[chosen]) / line.sigma)
    known, believed = _known(pixels, fit, chosen, scale, psf_sigma)
    return _Side(
        w=w[chosen],
        v=v[chosen],
        value=(pixels.value[chosen] - line.sky - fit.glare[chosen]) * scale,
        light=light * scale,
        scale=scale,
        known=known,
        believed=believed,
        edge_sigma=line.sigma,
    )


def _known(
    pixels: Pixels, fit: LineFit, chosen: IntArray, scale: FloatArray, psf_sigma: float
) -> tuple[FloatArray, FloatArray]:
    """The sky and the stars already seen: derivatives (n, m) and what is believed of each (m,)."""
    columns = [scale]
    believed = [pixels.u.size * 0.25 / pixels.noise**2]
    for k in range(len(fit.points)):
        near, derivatives = star_columns(pixels, fit.points, k, psf_sigma)
        full = np.zeros((pixels.u.size, 3))
        full[near] = derivatives
        part = full[chosen]
        if np.any(part):
            columns += list((part * scale[:, None]).T)
            believed += [1e-12, 10.0, 10.0]
    return np.stack(columns, axis=1), np.array(believed)


def _chances(
    side: _Side, places: FloatArray, psf_sigma: float, star_grid: tuple[float, int]
) -> FloatArray:
    """Logarithm of the probability of each place, up to a constant, (t,)."""
    begun = side.light[:, None] * _step((side.w[:, None] - places) / side.edge_sigma)
    tilt = begun * (np.clip((side.w[:, None] - places) / _INSIDE_PX, 0.0, 1.0) - 0.5)
    stars = _star_discs(side, places, psf_sigma, star_grid)
    known, inverse = side.known, np.linalg.inv(side.known.T @ side.known + np.diag(side.believed))
    of_value, of_begun, of_tilt, of_star = (known.T @ x for x in (side.value, begun, tilt, stars))

    def left(x_y: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
        return np.asarray(x_y - np.einsum("i...,i...->...", a, inverse @ b))

    value = side.value
    b1 = left(value @ begun, of_begun, (of_value[:, None])) + 1.0 / _SCALE_PRIOR**2
    b2 = left(value @ tilt, of_tilt, (of_value[:, None]))
    m11 = left(np.einsum("it,it->t", begun, begun), of_begun, of_begun) + 1.0 / _SCALE_PRIOR**2
    m12 = left(np.einsum("it,it->t", begun, tilt), of_begun, of_tilt)
    m22 = left(np.einsum("it,it->t", tilt, tilt), of_tilt, of_tilt) + 1.0 / _TILT_PRIOR**2
    determinant = m11 * m22 - m12 * m12
    x1, x2 = (m22 * b1 - m12 * b2) / determinant, (m11 * b2 - m12 * b1) / determinant
    gain = 0.5 * (b1 * x1 + b2 * x2)
    projected = inverse @ of_star
    s1 = begun.T.astype(np.float32) @ stars - of_begun.T @ projected
    s2 = tilt.T.astype(np.float32) @ stars - of_tilt.T @ projected
    star_value = value @ stars - of_value @ projected
    star_star = np.einsum("ij,ij->j", stars, stars) - np.einsum("ij,ij->j", of_star, projected)
    y1 = (m22[:, None] * s1 - m12[:, None] * s2) / determinant[:, None]
    y2 = (m11[:, None] * s2 - m12[:, None] * s1) / determinant[:, None]
    power = star_star - s1 * y1 - s2 * y2
    signal = star_value - b1[:, None] * y1 - b2[:, None] * y2
    is_seen = (power > 0.05 * star_star) & (power > 1e-12) & (signal > 0.0)
    z = np.where(is_seen, signal, 0.0) / np.sqrt(np.where(is_seen, power, 1.0))
    cell = (star_grid[0] * psf_sigma) ** 2
    weight = _STARS_PER_PX2 * cell * np.sqrt(2.0 * np.pi) / np.maximum(z, 1.5)
    with_star = 0.5 * z * z + np.log(weight)
    largest = np.maximum(with_star.max(axis=1), 0.0)
    total = np.exp(-largest) + np.exp(with_star - largest[:, None]).sum(axis=1)
    return np.asarray(gain + largest + np.log(total))


def _star_discs(
    side: _Side, places: FloatArray, psf_sigma: float, star_grid: tuple[float, int]
) -> Float32Array:
    """A star of unit flux at each place that one is thought of, over the sigma; (n, j)."""
    step, rows = star_grid[0] * psf_sigma, star_grid[1]
    along = np.arange(places[0] - 2.0 * psf_sigma, places[-1] + 4.0 * psf_sigma + step, step)
    across = step * (np.arange(rows) - 0.5 * (rows - 1))
    du, dv = side.w[:, None] - along, side.v[:, None] - across
    # The disc's core alone is separable, and enough for a star too faint to be seen by itself.
    core_u = np.exp(-0.5 * (du / psf_sigma) ** 2).astype(np.float32)
    core_v = np.exp(-0.5 * (dv / psf_sigma) ** 2) * side.scale[:, None]
    core_v = (core_v / (2.0 * np.pi * psf_sigma**2)).astype(np.float32)
    discs = core_u[:, :, None] * core_v[:, None, :]
    return np.asarray(discs.reshape(side.w.size, along.size * across.size))


def _step(t: FloatArray) -> FloatArray:
    """Share of a unit Gaussian below t, good to 2e-4 (Page 1977)."""
    t = np.clip(t, -5.0, 5.0)
    return np.asarray(1.0 / (1.0 + np.exp(-t * (1.5976 + 0.070565992 * t * t))))
