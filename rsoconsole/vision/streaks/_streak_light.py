"""Light along a streak: its rise and fall from end to end, and its pulse.

A satellite in sunlight shines from one end of the exposure to the other, a meteor flares up and
dies away, an aircraft's strobes and the facets of a tumbling body flash at regular intervals.
"""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.frame.median import median_of, quantiles_of
from rsoconsole.vision.lines.line_columns import running_mean
from rsoconsole.vision.lines.segments import Ends, length_of
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA

MIN_COLUMNS = 16
MIN_PERIODS = 4.0
_SHORTEST_PERIOD = 1.4
"""Shortest period searched, in star widths: faster changes are blurred to evenness."""
_FALSE_ALARM = 1e-4
_ALONE_FWHM = 0.9
"""Widths along a streak that a periodogram's sample is worth."""
_MIN_DEPTH = 0.08
_OVERSAMPLED = 4
_ABOVE_OTHERS = 6.0
"""Factor over the median power of the frequencies about it that a regular pulse must have."""
_BEYOND, _CALM, _LONGEST_WINDOW = 1.0 / 3.0, 0.1, 0.2
_FULL, _DARK = 0.7, 0.2
"""Shares of a streak's level between which its light grows and dies."""
_LEFT = 0.7
"""Share of the variance of noise left after interpolation between neighbours."""
_CORE, _GAP, _SIDE_PX = 1.0, 1.6, 6
"""Half width of the summed core and distance of the sky beside it, in widths; rows of that sky."""
_STAR_FOLD = 4.0
"""Ratio of light to the 84th percentile, both above the median, that makes a star."""
_TREND = 4
"""Degree of the polynomial by which slow changes are subtracted."""
_PHASES = 8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StreakLight:
    """Light along a streak from end a to end b, in columns of one pixel of length."""

    light_adu: FloatArray
    """(columns,) light above the sky beside the streak, ADU per px of length."""
    sigma_adu: float
    """One sigma of a column by the sky's noise alone."""
    fwhm_px: float
    """Full width at half maximum of the streak across, px."""
    first_px: float = 0.0
    """Distance from end a to the first column, px; large where the frame's rim cuts the streak."""

    @property
    def mean_adu(self) -> float:
        """Mean light, ADU per px of length, at least 0."""
        return max(float(self.light_adu.mean()), 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Fading:
    """Lengths over which a streak's light rises and falls at its ends, without the blur."""

    shorter_px: float
    """Length at the end where it is shorter, px: from 0.2 to 0.7 of the level between them."""
    longer_px: float
    length_px: float
    gap_share: float = 0.0
    """Share of the length between the first and the last full light that is dark."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Modulation:
    """Regular rise and fall of the light along a streak: flashes, or a tumbling body."""

    periods: float
    period_px: float
    depth: float
    """(most - least) / (most + least) of the mean period, 0 to 1, with the blur in it."""
    sharpness: float
    """First harmonic over the mean, the blur undone: 1 at most for a sine, 2 for mere flashes."""


def light_along(
    pixels: PixelArray, sky: Background, ends: Ends, width_px: float
) -> StreakLight | None:
    """Measure the light along a streak between ``ends`` (x_a, y_a, x_b, y_b); None if too short.

    Ends are in raw pixels. Light is summed across, ``width_px`` (full width at half maximum) to
    either side; from it the level of the pixels beside the streak, smoothed along it, is
    subtracted. Columns outside the frame are left out.
    """
    import cv2

    length, fwhm = length_of(ends), max(width_px, 1.5)
    count = int(length) + 1
    if count < MIN_COLUMNS:
        return None
    dx, dy = (ends[2] - ends[0]) / length, (ends[3] - ends[1]) / length
    core_px = max(math.ceil(_CORE * fwhm), 2)
    near_px = max(math.ceil(_GAP * fwhm), core_px + 1)
    u = np.arange(count) + 0.5 * (length - count + 1)
    v = np.arange(-near_px - _SIDE_PX, near_px + _SIDE_PX + 1)[:, None]
    x = (ends[0] + dx * u - dy * v).astype(np.float32)
    y = (ends[1] + dy * u + dx * v).astype(np.float32)
    height, width = pixels.shape
    low, high = int(max(y.min() - 2, 0)), int(min(y.max() + 3, height))
    left, right = int(max(x.min() - 2, 0)), int(min(x.max() + 3, width))
    if high - low < 2 or right - left < 2:
        return None
    piece = np.ascontiguousarray(pixels[low:high, left:right], dtype=np.float32)
    strip = cv2.remap(piece, x - left, y - low, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    is_core = np.abs(v[:, 0]) <= core_px
    is_inside = ((x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1))[is_core].all(axis=0)
    beside = strip[np.abs(v[:, 0]) >= near_px]
    level = _smoothed(np.median(beside, axis=0), 2 * math.ceil(2.0 * fwhm) + 1)
    light = (strip[is_core] - level).sum(axis=0)[is_inside].astype(np.float64)
    if light.size < MIN_COLUMNS:
        return None
    noise = max(sky.at(sky.noise, 0.5 * (ends[0] + ends[2]), 0.5 * (ends[1] + ends[3])), 1e-6)
    sigma = noise * math.sqrt(float(is_core.sum()) * _LEFT)
    return StreakLight(
        light_adu=light, sigma_adu=sigma, fwhm_px=fwhm, first_px=float(u[is_inside][0])
    )


def fading_of(pixels: PixelArray, sky: Background, ends: Ends, width_px: float) -> Fading | None:
    """Measure how gradually the light begins and ends; None where noise would hide it.

    The line is examined beyond either of its ``ends`` by a third of its length, since fading light
    lies partly there. The light is smoothed until its noise is a tenth of its level.
    """
    along = light_along(pixels, sky, _lengthened(ends, _BEYOND), width_px)
    if along is None:
        return None
    light = _without_stars(along.light_adu)
    count, length = light.size, length_of(ends)
    begins_at = round(_BEYOND * length - along.first_px)
    inner = slice(max(begins_at, 0), max(begins_at + round(length), 0))
    if light[inner].size < MIN_COLUMNS or not light[inner].mean() > 0.0:
        return None
    noise = (along.sigma_adu / (_CALM * float(light[inner].mean()))) ** 2
    window = 2 * int(0.5 * max(noise, along.fwhm_px)) + 1
    if window > _LONGEST_WINDOW * light[inner].size:
        return None
    calm = _smoothed(light, window)
    (level,) = quantiles_of(calm[inner], (0.8,))
    is_full = calm[inner] > _FULL * level
    if level <= 0.0 or not is_full.any():
        return None
    lit = np.flatnonzero(is_full) + inner.start
    first, last = int(lit[0]), int(lit[-1])
    dark = np.flatnonzero(calm < _DARK * level)
    before, after = dark[dark < first], dark[dark > last]
    begins = int(before[-1]) + 1 if before.size else 0
    ends_at = int(after[0]) - 1 if after.size else count - 1
    gaps = np.count_nonzero((dark > first) & (dark < last)) / max(last - first, 1)
    by_blur = 0.5 * math.hypot(along.fwhm_px, window)
    ways = sorted(max(way - by_blur, 0.0) for way in (first - begins, ends_at - last))
    return Fading(
        shorter_px=ways[0],
        longer_px=ways[1],
        length_px=float(ends_at - begins + 1),
        gap_share=float(gaps),
    )


def _lengthened(ends: Ends, share: float) -> Ends:
    dx, dy = share * (ends[2] - ends[0]), share * (ends[3] - ends[1])
    return ends[0] - dx, ends[1] - dy, ends[2] + dx, ends[3] + dy


def modulation_of(along: StreakLight) -> Modulation | None:
    """Find the regular pulse of the light; None where noise explains the highest peak.

    The peak is that of the periodogram of the light without its slow trend, normalised by the
    variance of the data, with its false alarm probability: Zechmeister & Kuerster 2009 (A&A 496,
    577). The grid is even, so that the sums are a discrete Fourier transform. Columns within the
    blur of each other count as one sample. The peak must also exceed its neighbours, since clouds
    and stars put power into all of them.
    """
    light = _without_stars(along.light_adu)
    count, mean = light.size, along.mean_adu
    place = np.linspace(-1.0, 1.0, count)
    terms, _ = np.linalg.qr(np.vander(place, _TREND + 1, increasing=True))
    rest = light - terms @ (terms.T @ light)
    total = float(rest @ rest)
    if mean <= 0.0 or total <= 0.0:
        return None
    size = 1 << (_OVERSAMPLED * count - 1).bit_length()
    wave = np.fft.rfft(rest, size)
    power = np.abs(wave) ** 2 * 2.0 / (count * total)
    frequency = np.arange(power.size) / size
    is_asked = (frequency >= MIN_PERIODS / count) & (
        frequency <= 1.0 / (_SHORTEST_PERIOD * along.fwhm_px)
    )
    if not is_asked.any():
        return None
    asked = np.flatnonzero(is_asked)
    at = int(asked[np.argmax(power[asked])])
    if at == asked[0]:
        return None  # the flank of something slower
    period_px = size / at
    alone = count / max(_ALONE_FWHM * along.fwhm_px, 1.0)
    tries = max(count * (frequency[asked[-1]] - frequency[asked[0]]), 1.0)
    single = (1.0 - min(float(power[at]), 0.999999)) ** (0.5 * max(alone - 6.0, 1.0))
    false_alarm = min(tries * single, 1.0)
    # Clouds and stars put more into the slow ones: neighbours within an octave are compared.
    is_other = (np.abs(asked - at) > 1.5 * _OVERSAMPLED) & (asked > 0.5 * at) & (asked < 2.0 * at)
    others = power[asked[is_other]]
    typical = median_of(others) if others.size > 2 * _OVERSAMPLED else 0.0
    if false_alarm > _FALSE_ALARM or float(power[at]) < _ABOVE_OTHERS * typical:
        return None
    sigma = along.fwhm_px / FWHM_PER_SIGMA
    kept = math.exp(-2.0 * (math.pi * sigma / period_px) ** 2)
    first = 2.0 * float(np.abs(wave[at])) / count / mean
    depth = _depth(light, period_px)
    if min(depth, first) < _MIN_DEPTH:
        return None
    return Modulation(
        periods=count / period_px,
        period_px=period_px,
        depth=depth,
        sharpness=min(first / max(kept, 0.05), 2.5),
    )


def _depth(light: FloatArray, period_px: float) -> float:
    """(most - least) / (most + least) of the light folded by a period."""
    phase = ((np.arange(light.size) / period_px) % 1.0 * _PHASES).astype(int)
    folded = np.bincount(phase, light, _PHASES) / np.maximum(np.bincount(phase, None, _PHASES), 1)
    most, least = float(folded.max()), max(float(folded.min()), 0.0)
    return (most - least) / (most + least) if most > 0.0 else 0.0


def _without_stars(light: FloatArray) -> FloatArray:
    """Cut single high places of the light back to the level of the rest."""
    middle, upper = quantiles_of(light, (0.5, 0.84))
    return np.minimum(light, middle + _STAR_FOLD * max(upper - middle, 0.0))


def _smoothed(values: FloatArray, window: int) -> FloatArray:
    """Running mean over ``window`` (odd), the ends repeated."""
    return running_mean(values, min(window, 2 * values.size - 1))
