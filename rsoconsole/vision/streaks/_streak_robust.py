"""Fit of a line where stars stand on it, beside it and just beyond its ends."""

from dataclasses import replace

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.vision.arrays import BoolArray
from rsoconsole.vision.lines.streak_search import Cutout, LitPart
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA
from rsoconsole.vision.streaks._streak_hidden import with_masked_ends_moved
from rsoconsole.vision.streaks._streak_model import (
    LineFit,
    StreakModel,
    StreakPixels,
    fit_line,
    model_light_adu,
    with_amplitude_knots,
)

Axes = tuple[FloatArray, FloatArray]
"""u along and v across of every pixel of a cutout, (h, w) each."""

_REFITS = 3
_KNOTS = ((6, 30.0), (3, 15.0))
"""Number of knots and the matched signal to noise from which they are used."""
_CHI2_PER_KNOT = 8.0
_OUTLIER_SIGMA = 4.5
_ABOVE_STREAK = 2.5
_EVEN_PX = 3.0
_CHI2_OF_A_STAR = 12.0
"""Price in chi-square of a star's place and brightness."""


def fit_robustly(
    cutout: Cutout, axes: Axes, start: StreakModel, stretch: LitPart, psf_sigma: float
) -> LineFit | None:
    """Fit the line after masking the light of other sources; None where the fit fails.

    ``start``: first guess of the line; ``stretch``: its lit part; ``psf_sigma``: of stars, px. The
    amplitude varies along the line only where that fits the light clearly better.
    """
    u, v = axes
    low, high = start.knot_range
    reach = 6.0 * psf_sigma + 10.0
    strip = (np.abs(v) < 5.0 * psf_sigma + 2.0) & (u > low - reach) & (u < high + reach)
    is_used = strip & cutout.is_good & ~_in_the_way(cutout, axes, stretch, psf_sigma)
    line, excess = with_amplitude_knots(start, _knots(stretch, psf_sigma)), 0.0
    for _ in range(_REFITS):
        data = _pixels(cutout, u, v, is_used)
        fit = fit_line(data, line, psf_sigma, excess=excess)
        if fit is None:
            return None
        line, excess = fit.line, fit.excess
        is_outlier = _outliers(cutout, is_used, data, fit) & is_used
        if not is_outlier.any():
            break
        is_used &= ~is_outlier
    data = _pixels(cutout, u, v, is_used)
    best = fit_line(data, line, psf_sigma, excess=excess)
    steady = fit_line(data, with_amplitude_knots(line, 1), psf_sigma, excess=excess)
    if best is not None and steady is not None:
        spared = _CHI2_PER_KNOT * (len(line.amplitudes) - 1)
        is_steady = _chi2(data, steady, excess) - _chi2(data, best, excess) <= spared
        best = steady if is_steady else best
    chosen = best or steady
    return None if chosen is None else with_masked_ends_moved(cutout, axes, chosen, is_used)


def uneven_share(cutout: Cutout, axes: Axes, fit: LineFit) -> float:
    """Return the share of the length where light and fit differ by more than half of the fit.

    It is high for stars in a row, whose light is uneven everywhere; a satellite's streak differs
    only where it meets a star.
    """
    line, (u, v) = fit.line, axes
    low = line.knot_range[0] if line.u_a is None else line.u_a
    high = line.knot_range[1] if line.u_b is None else line.u_b
    core = (np.abs(v - line.offset - line.slope * u) < 1.2 * line.sigma) & (u > low) & (u < high)
    data = _pixels(cutout, u, v, core)
    model = model_light_adu(data, line)
    bins = ((data.u - low) / _EVEN_PX).astype(int)
    count = np.maximum(np.bincount(bins), 1)
    light = np.bincount(bins, model) / count
    off = np.abs(np.bincount(bins, data.value - line.sky - model) / count)
    is_off = (off > 0.5 * np.abs(light)) & (off > 3.0 * data.noise / np.sqrt(count))
    return float(np.mean(is_off)) if is_off.size else 0.0


def without_star_beyond_end(
    cutout: Cutout, axes: Axes, start: StreakModel, stretch: LitPart, fit: LineFit
) -> LineFit:
    """Return the fit, or if likelier one that leaves out a star beyond a dark gap.

    ``start`` and ``stretch``: first guess of the line, and its lit part.
    """
    for side, dark_u in enumerate(stretch.dark_u):
        if dark_u is None or (start.u_a if side == 0 else start.u_b) is None:
            continue
        u, v = axes
        beyond = u < dark_u if side == 0 else u > dark_u
        inward = dark_u + 2.0 * start.sigma * (1.0 if side == 0 else -1.0)
        shorter = replace(start, u_a=inward) if side == 0 else replace(start, u_b=inward)
        rest = replace(cutout, is_good=cutout.is_good & ~beyond)
        other = fit_robustly(rest, axes, shorter, stretch, start.sigma)
        if other is None:
            continue
        strip = (np.abs(v) < 5.0 * start.sigma + 2.0) & cutout.is_good
        strip &= (np.abs(u - dark_u) < 20.0 + 4.0 * start.sigma) | beyond
        strip &= (u > stretch.u_a - 12.0) & (u < stretch.u_b + 12.0)
        data = _pixels(cutout, u, v, strip)
        sigma = np.sqrt(
            data.noise**2 + fit.excess * np.maximum(model_light_adu(data, fit.line), 0.0)
        )
        long, short = (
            (data.value - one.line.sky - model_light_adu(data, one.line)) / sigma
            for one in (fit, other)
        )
        star = _brightest_point(cutout, strip, short, start.sigma, beyond) ** 2
        if float(short @ short) - star + _CHI2_OF_A_STAR < float(long @ long):
            fit = other
    return fit


def _brightest_point(
    cutout: Cutout, strip: BoolArray, deviation: FloatArray, sigma: float, where: BoolArray
) -> float:
    """Matched signal to noise of the brightest star-like spot among the residuals."""
    import cv2

    image = np.zeros(cutout.values.shape, dtype=np.float32)
    image[strip] = deviation
    smooth = cv2.GaussianBlur(image, (0, 0), sigma) * (2.0 * np.sqrt(np.pi) * sigma)
    return float(np.max(smooth[strip & where], initial=0.0))


def _knots(stretch: LitPart, psf_sigma: float) -> int:
    """Numbers of knots, by how well the streak's brightness determines a change along it."""
    length = stretch.u_b - stretch.u_a
    for count, least_snr in _KNOTS:
        if stretch.matched_snr > least_snr and length > 4.0 * count * FWHM_PER_SIGMA * psf_sigma:
            return count
    return 1


def _pixels(cutout: Cutout, u: FloatArray, v: FloatArray, is_used: BoolArray) -> StreakPixels:
    return StreakPixels(
        u=u[is_used], v=v[is_used], value=cutout.values[is_used], noise=max(cutout.noise, 1e-9)
    )


def _chi2(data: StreakPixels, fit: LineFit, excess: float) -> float:
    variance = data.noise**2 + excess * np.maximum(fit.model, 0.0)
    return float(np.sum((data.value - fit.line.sky - fit.model) ** 2 / variance))


def _in_the_way(cutout: Cutout, axes: Axes, stretch: LitPart, psf_sigma: float) -> BoolArray:
    """Pixels near light far above the streak's possible level there; (h, w)."""
    import cv2

    u, v = axes
    gain = 2.0 * np.sqrt(np.pi) * psf_sigma / max(cutout.noise, 1e-9)
    values = (cutout.values * cutout.is_good).astype(np.float32)
    smooth = cv2.GaussianBlur(values, (0, 0), psf_sigma) * gain
    places = np.linspace(stretch.u_a, stretch.u_b, len(stretch.amplitudes))
    level = np.interp(u, places, _calm(stretch.amplitudes))
    beyond = 4.0 * psf_sigma + 2.0
    level[(u < stretch.u_a - beyond) | (u > stretch.u_b + beyond)] = 0.0
    # Smoothed once more, the streak is sqrt(2) wider; half a pixel for the guess's own error.
    off = np.maximum(np.abs(v) - 0.75, 0.0) / (1.15 * psf_sigma)
    expected = level * np.exp(-0.25 * off**2) / (2.0 * np.sqrt(np.pi) * psf_sigma) * gain
    found = smooth > _OUTLIER_SIGMA + _ABOVE_STREAK * expected
    size = 2 * int(np.ceil(1.5 * psf_sigma)) + 1
    return np.asarray(cv2.dilate(found.astype(np.uint8), np.ones((size, size))) > 0)


def _calm(amplitudes: tuple[float, ...]) -> FloatArray:
    """Running median of three: one part brightened by a star does not count."""
    padded = np.array([amplitudes[0], *amplitudes, amplitudes[-1]])
    return np.asarray(np.median([padded[:-2], padded[1:-1], padded[2:]], axis=0))


def _outliers(cutout: Cutout, is_used: BoolArray, data: StreakPixels, fit: LineFit) -> BoolArray:
    """Pixels near light that the line does not explain: stars, cosmic rays, hot pixels; (h, w)."""
    import cv2

    deviation = np.zeros(cutout.values.shape, dtype=np.float32)
    variance = data.noise**2 + fit.excess * np.maximum(fit.model, 0.0)
    deviation[is_used] = (data.value - fit.line.sky - fit.model) / np.sqrt(variance)
    sigma = fit.line.sigma
    smooth = cv2.GaussianBlur(deviation, (0, 0), sigma) * (2.0 * np.sqrt(np.pi) * sigma)
    found = (smooth > _OUTLIER_SIGMA) | (deviation > _OUTLIER_SIGMA + 1.0)
    size = 2 * int(np.ceil(sigma)) + 1
    return np.asarray(cv2.dilate(found.astype(np.uint8), np.ones((size, size))) > 0)
