"""Measurement of a line of light of any length, however its brightness varies.

The pixels about a proposed line are turned so that it runs along the rows; summed across with the
frame's own point-spread function as weight they make a profile along it. It gives:

- course of the line: from the middles of its parts
- ends: from the edges of the lit stretch
- line or stars in a row: from the darkest parts, and from the variation of the light that no slow
  change and no single period explains
"""

import math

import numpy as np

from rsoconsole.records import PixelArray
from rsoconsole.vision.arrays import IndexArray
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.frame.median import median_of
from rsoconsole.vision.lines.line_strip import (
    INTERPOLATED_VARIANCE,
    MIN_KNOWN,
    OFF_PX,
    LineProfile,
    LineStrip,
    StripLine,
    cut_out_strip,
    gaussian_across,
    profile_of,
    rows_about,
    subtract_sky_beside,
)
from rsoconsole.vision.lines.segments import Ends, length_of
from rsoconsole.vision.stars.star_list import StarList
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA
from rsoconsole.vision.streaks.traced_line import CLIP, TIMES_LEVEL, LineTrace, describe_line

_PARTS = 16
_LIT = 0.4
_TIMES_TYPICAL, _MAX_SLOPE = 1.5, 0.45
_ENOUGH_COLUMNS = 24
_OUT_SIGMA, _MAX_OUT = 5.0, 0.4
_BRIGHT_SIGMA, _NEARER, _MAX_LOOKS = 6.0, 1e-3, 3
_NOT_NOISE = 2.5
_SMALLEST = 1e-9


def trace_line(
    pixels: PixelArray,
    sky: Background,
    ends: Ends,
    stars: StarList,
    psf_fwhm_px: float,
    *,
    off_px: float = OFF_PX,
) -> LineTrace | None:
    """Measure the light of a line proposed between ``ends`` (x_a, y_a, x_b, y_b).

    ``pixels`` (height, width), ADU. ``off_px``: largest distance of the true line from the proposed
    one, at its middle and at its ends. None where no line stands out there.
    """
    sigma = math.sqrt((psf_fwhm_px / FWHM_PER_SIGMA) ** 2 + INTERPOLATED_VARIANCE)
    strip = cut_out_strip(pixels, sky, ends, stars, sigma)
    found, goes_on = _looked(strip, ends, sigma, off_px)
    for _ in range(_MAX_LOOKS):
        if found is None or not goes_on:
            break
        ends = found.x_a_px, found.y_a_px, found.x_b_px, found.y_b_px
        strip = cut_out_strip(pixels, sky, ends, stars, sigma)
        further, goes_on = _looked(strip, ends, sigma, off_px)
        if further is None or further.snr < found.snr:
            break
        found = further
    return found


def _looked(
    strip: LineStrip | None, ends: Ends, sigma: float, off_px: float
) -> tuple[LineTrace | None, bool]:
    """Trace of one look at a strip, and True where the light goes on at the strip's end."""
    if strip is None:
        return None, False
    length = length_of(ends)
    count = strip.values.shape[1]
    # Where the frame cuts the strip its middle is not the line's.
    first = (ends[0] - strip.x0_px) * strip.dx + (ends[1] - strip.y0_px) * strip.dy
    inside = slice(max(math.ceil(first), 0), min(math.floor(first + length) + 1, count))
    if inside.stop - inside.start < 4:
        return None, False
    _mask_bright(strip, inside, sigma, off_px)
    course = _course(strip, inside, sigma, off_px)
    subtract_sky_beside(strip, course, sigma)
    lit = 0.0, 0.0
    for _ in range(2):
        profile = profile_of(strip, course, sigma)
        stretch = _lit_stretch(profile, course.middle, 0.5 * length)
        if stretch is None:
            return None, False
        lit = stretch
        _mask_what_stands_out(strip, profile, lit)
        inside = slice(int(lit[0]), int(lit[1]) + 1)
        length = max(lit[1] - lit[0], 1.0)
        course = _better(strip, inside, course, sigma)
    rim = FWHM_PER_SIGMA * sigma
    goes_on = (lit[0] < rim and not strip.is_cut[0]) or (
        lit[1] > count - 1 - rim and not strip.is_cut[1]
    )
    profile = profile_of(strip, course, sigma)
    return describe_line(strip, inside, course, profile), goes_on


def _mask_bright(strip: LineStrip, inside: slice, sigma: float, off_px: float) -> None:
    """Mask pixels far brighter than most of the line, and a star's width about them.

    Stars that touch another light are on no list. Where they are much of the line they are its
    flashes and stay.
    """
    import cv2

    ridge = cv2.blur(strip.values, (3, 1))
    near = slice(max(round(strip.reach - off_px), 0), round(strip.reach + off_px) + 1)
    known = np.where(strip.is_good[near, inside], ridge[near, inside], -np.inf).max(axis=0)
    known = known[np.isfinite(known)]
    if known.size < _ENOUGH_COLUMNS // 2:
        return
    typical = median_of(known)
    is_bright = (ridge > max(TIMES_LEVEL * typical, typical + _BRIGHT_SIGMA)) & strip.is_good
    side = 2 * round(FWHM_PER_SIGMA * sigma) + 1
    about = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    is_bright = cv2.dilate(is_bright.astype(np.uint8), about) > 0
    if np.mean(is_bright[near, inside].any(axis=0)) < _MAX_OUT:
        strip.is_good[is_bright] = False


def _mask_what_stands_out(strip: LineStrip, profile: LineProfile, lit: tuple[float, float]) -> None:
    """Mask points on the line far brighter than most of it: stars that are on no list."""
    inside = profile.is_known_between(*lit)
    if np.count_nonzero(inside) < _ENOUGH_COLUMNS:
        return
    typical = max(median_of(profile.light[inside]), 0.0)
    window = max(round(FWHM_PER_SIGMA * profile.sigma), 1)
    kernel = np.full(window, 1.0 / window)
    calm = np.convolve(profile.light, kernel, mode="same")
    noise = median_of(profile.error[inside]) / math.sqrt(window)
    bright = calm > max(TIMES_LEVEL * typical, typical + _OUT_SIGMA * noise)
    bright = np.convolve(bright, np.ones(2 * window + 1), mode="same") > 0.5
    if np.count_nonzero(bright & inside) < _MAX_OUT * np.count_nonzero(inside):
        strip.is_good[:, bright] = False


def _course(strip: LineStrip, inside: slice, sigma: float, off_px: float) -> StripLine:
    """Find the line on which the limited light of a proposal's parts adds up to most."""
    import cv2

    lit = strip.columns[inside]
    middle = float(lit.mean())
    weight = cv2.getGaussianKernel(2 * math.ceil(3.0 * sigma) + 1, sigma).astype(np.float32)
    starts = _starts_of_parts(lit.size)
    good = strip.is_good[:, inside].astype(np.float32)
    known = np.maximum(np.add.reduceat(good, starts, axis=1), 1.0)
    row = np.add.reduceat(strip.values[:, inside] * good, starts, axis=1) / np.sqrt(known)
    smooth = cv2.filter2D(row, -1, weight, borderType=cv2.BORDER_REFLECT_101)
    light = (smooth / float(np.sqrt((weight**2).sum()))).T
    place = np.add.reduceat(lit, starts) / np.diff(starts, append=lit.size)
    # Of a bright line all that is near it would be alike: most of its parts tell how bright it is.
    typical = median_of(light.max(axis=1))
    light = np.clip(light, -2.0, max(CLIP, _TIMES_TYPICAL * typical))
    half = max(0.5 * lit.size, 1.0)
    offsets = np.arange(-off_px, off_px + 0.25, 0.5)
    slopes = np.arange(-off_px, off_px + 0.25, 0.5) / max(half, off_px / _MAX_SLOPE)
    rows = offsets[:, None, None] + slopes[:, None] * (place - middle) + strip.reach
    rows = np.clip(np.rint(rows), 0, light.shape[1] - 1).astype(np.intp)
    total = light[np.arange(place.size), rows].sum(axis=-1)
    # Of courses alike, the one nearest to what was proposed.
    far = np.abs(offsets)[:, None] / off_px + np.abs(slopes) / max(float(slopes[-1]), _SMALLEST)
    total = total - _NEARER * np.abs(total).max() * far
    best = np.unravel_index(int(np.argmax(total)), total.shape)
    return StripLine(middle, float(offsets[best[0]]), float(slopes[best[1]]), 0.5, 0.5 / half)


def _lit_stretch(profile: LineProfile, middle: float, half: float) -> tuple[float, float] | None:
    """First and last column of the stretch whose light above a share of its level is most."""
    typical: float | None = None
    span = (middle - half, middle + half)
    for _ in range(2):
        inside = profile.is_known_between(*span)
        if np.count_nonzero(inside) < 4:
            return None
        noise = median_of(profile.error[inside])
        limit = 6.0 * noise if typical is None else max(2.5 * typical, _NOT_NOISE * noise)
        typical = float(np.mean(np.minimum(profile.light[inside], limit)))
        if typical <= 0.0:
            return None
        # A star is held down to the line's own light; what noise does must not be, one-sidedly.
        limit = max(2.0 * typical, _NOT_NOISE * noise)
        gain = np.minimum(profile.light, limit) - _LIT * typical
        total = np.concatenate([[0.0], np.cumsum(np.where(profile.is_known, gain, 0.0))])
        end = int(np.argmax(total - np.minimum.accumulate(total)))
        start = int(np.argmin(total[: end + 1]))
        if end - start < 4:
            return None
        span = (float(start), float(end - 1))
    return span


def _better(strip: LineStrip, inside: slice, course: StripLine, sigma: float) -> StripLine:
    """Fit the line through the middles of the lit parts, with its errors."""
    chosen = strip.columns[inside]
    middle = float(chosen.mean())
    start = StripLine(
        middle, float(course.at(middle)), course.slope, course.sigma_offset, course.sigma_slope
    )
    starts = _starts_of_parts(chosen.size)
    centres = np.add.reduceat(chosen, starts) / np.diff(starts, append=chosen.size) - middle
    for _ in range(3):
        path = start.at(chosen).astype(np.float32)
        rows = rows_about(strip.reach, path, sigma)
        off = strip.rows[rows] - path
        weight = gaussian_across(off, sigma)
        nominal = (weight * weight).sum(axis=0)
        weight *= strip.is_good[rows, inside]
        # What a mask leaves of a column is a star's wing, not the line.
        weight *= (weight * weight).sum(axis=0) > MIN_KNOWN * nominal
        lights = weight * strip.values[rows, inside]
        of_columns = np.array(
            [
                (lights * off).sum(axis=0),
                ((weight * off) ** 2).sum(axis=0),
                lights.sum(axis=0),
                (weight * weight).sum(axis=0),
            ],
            dtype=np.float64,
        )
        moment, spread, light, known = np.add.reduceat(of_columns, starts, axis=1)
        typical = max(float(light.sum()) / max(float(known.sum()), _SMALLEST), _SMALLEST)
        is_seen = spread > 0.0
        if not is_seen.any():
            return start
        # Matched to the slope of the profile: moment of g'(v) over that of g g'' .
        amplitude = np.maximum(light / np.maximum(known, _SMALLEST), 0.3 * typical)[is_seen]
        moment, spread, u = moment[is_seen], spread[is_seen], centres[is_seen]
        offsets = np.clip(moment / spread / amplitude * sigma**2, -2.0 * sigma, 2.0 * sigma)
        errors = sigma**2 / (amplitude * np.sqrt(spread))
        # A part that a star pulls away says little.
        away = np.maximum(np.abs(offsets - median_of(offsets)) - 3.0 * errors, 0.0)
        w = 1.0 / (errors**2 + away**2)
        s0, s1, s2 = float(w.sum()), float(w @ u), float(w @ u**2)
        det = s0 * s2 - s1**2
        if u.size < 3 or det <= _SMALLEST * s0 * max(s2, 1.0):
            shift, turn = float(w @ offsets) / s0, 0.0
            errors_of = (1.0 / math.sqrt(s0), start.sigma_slope)
        else:
            p0, p1 = float(w @ offsets), float(w @ (offsets * u))
            shift, turn = (s2 * p0 - s1 * p1) / det, (s0 * p1 - s1 * p0) / det
            errors_of = (math.sqrt(s2 / det), math.sqrt(s0 / det))
        start = StripLine(middle, start.offset + shift, start.slope + turn, *errors_of)
        if abs(shift) < 0.02:
            break
    return start


def _starts_of_parts(count: int) -> IndexArray:
    """First index of each part of ``count`` columns: 16 parts, or fewer of six columns each."""
    parts = min(_PARTS, max(count // 6, 1))
    size, more = divmod(count, parts)
    part = np.arange(parts)
    return part * size + np.minimum(part, more)
