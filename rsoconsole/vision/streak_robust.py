"""A line and its two ends, measured where stars stand in the way, beside it and on its tips."""

from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.vision.stars import FWHM_PER_SIGMA
from rsoconsole.vision.streak_beside import Axes, joined, unexplained, within
from rsoconsole.vision.streak_ends import End, find_end, strip_reach
from rsoconsole.vision.streak_model import (
    BoolArray,
    Line,
    LineFit,
    Pixels,
    Points,
    fit_line,
    light_at,
    star_columns,
    with_knots,
)
from rsoconsole.vision.streak_noise import GLARE_ERROR, NO_SOURCE_NOISE
from rsoconsole.vision.streak_search import Cutout
from rsoconsole.vision.streak_stretch import Ends

_ROUNDS = 3
_LEAST_PIXELS = 30
_HALF_STRIP = 4.0
"""Half the width of the strip that is fitted, in sigmas of a star; a pixel and a half more."""
_KNOTS = ((6, 30.0), (3, 15.0))
"""Number of knots and the matched signal to noise from which they are used."""
_MOVED_PX = 2.0
_EVEN_PX = 3.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Measured:
    """A fitted line and how well each end is known; None for an end outside the frame."""

    fit: LineFit
    ends: tuple[End | None, End | None]


def fit_robustly(
    cutout: Cutout, axes: Axes, start: Line, stretch: Ends, psf_sigma: float
) -> Measured | None:
    """The line, the stars beside it and its ends in turn until the ends stay; None: no line."""
    line = with_knots(start, _knots(stretch, psf_sigma), start.knot_range)
    points = _listed(cutout, axes, line, psf_sigma)
    masked = np.zeros(cutout.values.size, dtype=bool)
    pixels = _strip(cutout, axes, line, psf_sigma, masked)
    points = joined(points, _in_the_way(axes, pixels, line, points, psf_sigma))
    measured: Measured | None = None
    noise = NO_SOURCE_NOISE
    for number in range(_ROUNDS):
        if number > 0:
            pixels = _strip(cutout, axes, line, psf_sigma, masked)
        if pixels.u.size < _LEAST_PIXELS:
            return None
        fit = fit_line(pixels, line, points, psf_sigma, noise=noise, steps=3)
        if fit is None:
            return None
        more, lone = unexplained(axes, pixels, fit, psf_sigma)
        if measured is not None:
            more = _off_the_tips(more, measured, psf_sigma)
        if len(more) or lone.size:
            masked[lone] = True
            pixels = _strip(cutout, axes, line, psf_sigma, masked)
            noise, points = fit.noise, joined(fit.points, more)
            fit = fit_line(pixels, fit.line, points, psf_sigma, noise=noise, steps=3)
        if fit is None or max(fit.line.amplitudes) <= 0.0:
            return None
        measured = _with_ends(pixels, fit, psf_sigma, is_near=number > 0)
        is_settled = not _has_moved(measured, fit.line, psf_sigma)
        line, points, noise = measured.fit.line, fit.points, fit.noise
        if is_settled:
            break
    if measured is None:
        return None
    last = fit_line(pixels, line, points, psf_sigma, noise=noise, steps=2)
    return replace(measured, fit=last) if last is not None else measured


def _in_the_way(axes: Axes, pixels: Pixels, line: Line, points: Points, psf_sigma: float) -> Points:
    """Stars far above what the streak gives, before any fit."""
    light = light_at(pixels.u, pixels.v, line)
    glare = np.zeros(light.size)
    for k in range(len(points)):
        near, columns = star_columns(pixels, points, k, psf_sigma)
        glare[near] += points.flux[k] * columns[:, 0]
    guessed = LineFit(
        line=line,
        points=points,
        covariance=np.zeros((2, 2)),
        noise=NO_SOURCE_NOISE,
        light=light,
        glare=glare,
    )
    # Smoothed as a star is, the streak itself stands out so much.
    streak = np.max(light, initial=0.0) / pixels.noise * np.sqrt(2.0 * np.pi) * psf_sigma
    found, _ = unexplained(axes, pixels, guessed, psf_sigma, 4.5 + 1.5 * streak)
    return found


def _with_ends(pixels: Pixels, fit: LineFit, psf_sigma: float, *, is_near: bool) -> Measured:
    """The same line with its ends where they are likeliest."""
    line = fit.line
    a = None if line.u_a is None else find_end(pixels, fit, 0, psf_sigma, is_near=is_near)
    b = None if line.u_b is None else find_end(pixels, fit, 1, psf_sigma, is_near=is_near)
    u_a, u_b = None if a is None else a.u, None if b is None else b.u
    low = line.knot_range[0] if u_a is None else u_a
    high = line.knot_range[1] if u_b is None else u_b
    high = max(high, low + 1.0)
    moved = with_knots(replace(line, u_a=u_a, u_b=u_b), len(line.amplitudes), (low, high))
    return Measured(fit=replace(fit, line=moved), ends=(a, b))


def _has_moved(measured: Measured, before: Line, psf_sigma: float) -> bool:
    """Whether an end stands where the fit before it was plainly wrong."""
    for end, guessed in zip(measured.ends, (before.u_a, before.u_b), strict=True):
        if end is None or guessed is None:
            continue
        if abs(end.u - guessed) > max(_MOVED_PX, 2.0 * psf_sigma, 1.5 * end.sigma_px):
            return True
    return False


def _off_the_tips(found: Points, measured: Measured, psf_sigma: float) -> Points:
    """Those that are no part of an end's own uncertainty, which knows of stars already."""
    kept = np.ones(len(found), dtype=bool)
    for end in measured.ends:
        if end is not None:
            kept &= np.abs(found.u - end.u) > 3.0 * psf_sigma + 2.0 * end.sigma_px
    return Points(u=found.u[kept], v=found.v[kept], flux=found.flux[kept])


def _listed(cutout: Cutout, axes: Axes, line: Line, psf_sigma: float) -> Points:
    """Stars of the frame's list in and near the strip, as the fit's first guesses."""
    u, v = axes
    # The axes are linear in x and y: three corners give them everywhere.
    du_x, du_y = u[0, 1] - u[0, 0], u[1, 0] - u[0, 0]
    dv_x, dv_y = v[0, 1] - v[0, 0], v[1, 0] - v[0, 0]
    x, y = cutout.star_x, cutout.star_y
    stars = Points(
        u=u[0, 0] + du_x * x + du_y * y,
        v=v[0, 0] + dv_x * x + dv_y * y,
        flux=cutout.star_flux,
    )
    low, high = line.knot_range
    reach = 9.0 * psf_sigma + 12.0
    return within(stars, (low - reach, high + reach), (_HALF_STRIP + 1.0) * psf_sigma + 1.5)


def _strip(cutout: Cutout, axes: Axes, line: Line, psf_sigma: float, masked: BoolArray) -> Pixels:
    """Pixels about the line and beyond its ends."""
    u, v = axes
    low, high = line.knot_range
    reach = strip_reach(psf_sigma)
    strip = (np.abs(v - line.offset) < _HALF_STRIP * psf_sigma + 1.5) & cutout.is_seen
    strip &= (u > low - reach) & (u < high + reach)
    index = np.flatnonzero(strip.ravel() & ~masked)
    halo_error = GLARE_ERROR * cutout.halo.ravel()[index]
    return Pixels(
        u=u.ravel()[index],
        v=v.ravel()[index],
        value=cutout.values.ravel()[index],
        noise=cutout.noise,
        variance=np.asarray(cutout.noise**2 + halo_error**2, dtype=np.float64),
        index=index,
    )


def _knots(stretch: Ends, psf_sigma: float) -> int:
    """How freely the light may change along the streak, by what its brightness can tell."""
    length = stretch.u_b - stretch.u_a
    for count, least_snr in _KNOTS:
        if stretch.matched_snr > least_snr and length > 4.0 * count * FWHM_PER_SIGMA * psf_sigma:
            return count
    return 1


def uneven_share(cutout: Cutout, axes: Axes, line: Line) -> float:
    """Share of the length where the light differs from the line's by more than half of it.

    Stars that happen to stand in a row are uneven all along; a satellite is where it meets a star.
    """
    u, v = axes
    low, high = line.knot_range
    core = (np.abs(v - line.offset - line.slope * u) < 1.2 * line.sigma) & (u > low) & (u < high)
    at, across, value = u[core], v[core], cutout.values[core]
    model = light_at(at, across, line)
    bins = ((at - low) / _EVEN_PX).astype(int)
    count = np.maximum(np.bincount(bins), 1)
    light = np.bincount(bins, model) / count
    off = np.abs(np.bincount(bins, value - line.sky - model) / count)
    is_off = (off > 0.5 * np.abs(light)) & (off > 3.0 * cutout.noise / np.sqrt(count))
    return float(np.mean(is_off)) if is_off.size else 0.0
