"""A glance along a line: is there light all along it, and does it go on?

A glance costs a thirtieth of a fit and so decides what is worth one. Most of what the network
faintly believes in are a few stars in a row: bright here and there, dark between. Light is limited
to a few sigmas before it is summed, so that stars count little and an unbroken line in full.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from rsoconsole.records import PixelArray
from rsoconsole.vision.background import Background
from rsoconsole.vision.stars import FWHM_PER_SIGMA
from rsoconsole.vision.streak_search import Box

Float32Array = npt.NDArray[np.float32]

_LIMITS = (-1.5, 4.0)
"""Of the smoothed signal to noise of a place on the line."""
_OFFSET_PX = 10
_TURN_PX = 7
"""How far off a proposal's line may be in its middle, and by its direction at its ends."""
_RIM_PX = 4
_REACH_PX = _OFFSET_PX + _TURN_PX + _RIM_PX
_STEP_PX = 2
_LONGEST_PX = 400
"""Of a longer proposal its middle is looked at."""
_SHORTEST_PX = 12
_COUNTS = 4
"""Places along a line come in steps of so many: fewer tables of lines to keep."""
_NEEDED, _FREE_LOGIT, _NEEDED_PER_LOGIT = 9.0, -4.0, 1.0
"""A fit is worth its time from here on; more for each unit of the network's log-odds below -4.
Measured on frames of the calibration split: no streak that came above tau had less than 1.3 times
as much, and a frame has two or three chance candidates that have more."""
_NEEDED_OF_MOST = 0.9
"""Of what a line so short can give at most."""
_SMALLEST = 1e-7
_BEYOND_PX = (30.0, 150.0)
"""How far at least and at most is looked beyond an end."""
_LIKE, _SURE = 0.5, 3.0
"""Light beyond an end is more of the same from this share of its level and so many sigmas on."""
_SPREAD_OF_NOISE, _SPREAD_OF_LIGHT = 2.4, 1.45
"""Of the middle half of a line's places: most that noise makes (1.35 on average), and times the
level what a brightness that comes and goes as a sine makes."""
_FADING, _MOST_FADING = 0.6, 10.0
"""Share of its level below which a line fades towards an end, and what that can make of a sigma."""
_ALONG_RAY_PX, _RAY_REACH_PX, _RAY_END_PX = 0.6, 6, 3
_PATCHY_PER_NOISE, _BENT_PER_NOISE, _GRID_PX = 1.3, 2.0, 0.17
_MOST_PATCHY, _MOST_BENT_PX = 0.17, 0.3
"""Relative unevenness and bends beyond those of noise: of 11 short cosmic rays of the calibration
split that came near tau all but two have more, of 30 short streaks one that a star lies on."""
_DARK, _GAP_WIDTHS = 0.25, 3.0
"""Share of a line's level below which it is dark, and the widths of a star from which on a dark
stretch is a gap."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LineSignal:
    """What a glance saw."""

    value: float
    """Signal to noise of light along the best line, limited; the noise is that of plain sky."""
    most: float
    """What a line as long, bright all along, would have given."""

    def is_worth_a_fit(self, network_confidence: float) -> bool:
        """Whether there is light enough; the less the network believes, the more is asked for."""
        p = min(max(network_confidence, _SMALLEST), 1.0 - _SMALLEST)
        doubt = max(0.0, _FREE_LOGIT - math.log(p / (1.0 - p)))
        needed = min(_NEEDED + _NEEDED_PER_LOGIT * doubt, _NEEDED_OF_MOST * self.most)
        return self.value >= needed > 0.0


def line_signal(pixels: PixelArray, sky: Background, ends: Box, psf_sigma: float) -> LineSignal:
    """Light along the best line near ``ends`` (x_a, y_a, x_b, y_b); nothing outside the frame."""
    length = float(np.clip(_length(ends), _SHORTEST_PX, _LONGEST_PX))
    count = max(int(length) // _STEP_PX // _COUNTS, 1) * _COUNTS + 1
    smooth, is_inside = _smoothed(
        pixels, sky, ends, psf_sigma, columns=_STEP_PX * (count - 1) + 1, reach=_REACH_PX
    )
    limited = np.clip(smooth[:, ::_STEP_PX], *_LIMITS)
    lines = _lines(count)
    total = limited.ravel().take(lines).sum(axis=-1)
    seen = np.full(total.shape, count)
    if not is_inside.all():
        seen = is_inside[:, ::_STEP_PX].ravel().take(lines).sum(axis=-1)
        total[seen * _STEP_PX < _SHORTEST_PX] = 0.0
    if not total.any():
        return LineSignal(value=0.0, most=0.0)
    # Neighbours along share the light that the smoothing spread.
    alike = math.fsum(math.exp(-((k * _STEP_PX / psf_sigma) ** 2) / 4.0) for k in range(1, 6))
    places = np.maximum(seen, 1)
    each = total / np.sqrt(places * (1.0 + 2.0 * alike))
    best = int(np.argmax(each))
    most = _LIMITS[1] * math.sqrt(float(places[best]) / (1.0 + 2.0 * alike))
    return LineSignal(value=float(each[best]), most=most)


def is_broken(pixels: PixelArray, sky: Background, ends: Box, psf_sigma: float) -> bool:
    """Whether what lies between ``ends`` is no one line: a few stars, or light with a gap in it.

    Stars spread the middle half of the places further than a tumbling satellite's light does; a
    gap is a dark stretch longer than stars are wide. Both are held against what noise makes.
    """
    ridge = _ridge(pixels, sky, ends, psf_sigma)
    widths_px = FWHM_PER_SIGMA * psf_sigma
    window = max(round(widths_px), 1)
    if ridge.size < 4 * window:
        return False
    low, level, high = (float(each) for each in np.percentile(ridge, (25.0, 50.0, 75.0)))
    if high - low > _SPREAD_OF_NOISE + _SPREAD_OF_LIGHT * max(level, 0.0):
        return True
    # Smoothed by the stars' width already, the mean of a window is hardly calmer than one place.
    calm = np.convolve(ridge, np.full(window, 1.0 / window), mode="valid")
    is_dark = calm < min(_DARK * level, level - _SURE)
    edges = np.diff(np.concatenate([[0], is_dark.astype(np.int8), [0]]))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    longest = int((stops - starts).max(initial=0))
    return longest > 0 and longest + window > _GAP_WIDTHS * widths_px


def fading_factor(pixels: PixelArray, sky: Background, ends: Box, psf_sigma: float) -> float:
    """How many times fainter than typical a line is towards its fainter end; 1.0 where it is not.

    The fit takes a faint line for an even one, and believes to know ends that it can hardly see.
    """
    ridge = _ridge(pixels, sky, ends, psf_sigma)
    part = ridge.size // 6
    level = float(np.median(ridge)) if ridge.size else 0.0
    if part < 2 or level <= 0.0:
        return 1.0
    faintest = min(float(np.median(ridge[:part])), float(np.median(ridge[-part:])))
    if faintest > _FADING * level:
        return 1.0
    return level / max(faintest, level / _MOST_FADING)


def is_patchy(pixels: PixelArray, sky: Background, ends: Box, psf_sigma: float, snr: float) -> bool:
    """Whether a short line is too patchy or too crooked for its signal to noise ``snr``.

    A cosmic ray loses its charge in lumps, and an electron's path bends; a satellite that is in
    sight for so short a way has neither the time to tumble nor a reason to turn.
    """
    length = _length(ends)
    strip, is_inside = _smoothed(
        pixels, sky, ends, _ALONG_RAY_PX, columns=int(length) + 1, reach=_RAY_REACH_PX
    )
    inner = strip[:, _RAY_END_PX:-_RAY_END_PX]
    if not is_inside.all() or inner.shape[1] < 3 * _RAY_END_PX:
        return False
    across = np.arange(-_RAY_REACH_PX, _RAY_REACH_PX + 1)[:, None]
    light = np.clip(inner, 0.0, None) * (np.abs(across) <= 2.0 * FWHM_PER_SIGMA * psf_sigma)
    total = np.maximum(light.sum(axis=0), 1e-6)
    place = (light * across).sum(axis=0) / total
    along = np.arange(place.size)
    bent = place - np.polyval(np.polyfit(along, place, 1), along)
    # What noise and the pixels' own grid make of an even, straight line: measured.
    noise = math.sqrt(length) / max(snr, 1.0)
    unevenness = float(total.std() / total.mean()) ** 2 - (_PATCHY_PER_NOISE * noise) ** 2
    bends_px = float(np.mean(bent**2)) - _GRID_PX**2 - (_BENT_PER_NOISE * noise) ** 2
    return unevenness > _MOST_PATCHY**2 or bends_px > _MOST_BENT_PX**2


def goes_on_beyond(pixels: PixelArray, sky: Background, ends: Box, psf_sigma: float) -> bool:
    """Whether the light of a line from a to b goes on beyond b, typically half as bright or more.

    Typical is the median along the line, so that stars in the way say nothing.
    """
    x_a, y_a, x_b, y_b = ends
    length = max(_length(ends), 1.0)
    dx, dy = (x_b - x_a) / length, (y_b - y_a) / length
    near = 3.0 * psf_sigma + 2.0
    far = near + float(np.clip(0.5 * length, *_BEYOND_PX))
    further = (x_b + near * dx, y_b + near * dy, x_b + far * dx, y_b + far * dy)
    inside = _ridge(pixels, sky, ends, psf_sigma)
    beyond = _ridge(pixels, sky, further, psf_sigma)
    if beyond.size < _BEYOND_PX[0] - 2 or not inside.size:
        return False
    typical, level = float(np.median(beyond)), float(np.median(inside))
    # Of a median of smoothed places: 1.25 / sqrt(n), n as many as stand alone.
    error = 1.25 / math.sqrt(beyond.size / (2.0 * math.sqrt(math.pi) * psf_sigma))
    return typical > _LIKE * level and typical > _SURE * error


def _length(ends: Box) -> float:
    return math.hypot(ends[2] - ends[0], ends[3] - ends[1])


def _ridge(pixels: PixelArray, sky: Background, ends: Box, psf_sigma: float) -> Float32Array:
    """Smoothed signal to noise at every pixel along a line, as far as it is in the frame."""
    columns = int(min(_length(ends), float(_LONGEST_PX))) + 1
    smooth, is_inside = _smoothed(pixels, sky, ends, psf_sigma, columns=columns, reach=_RIM_PX)
    ridge: Float32Array = smooth[_RIM_PX][is_inside[_RIM_PX]]
    return ridge


def _smoothed(
    pixels: PixelArray,
    sky: Background,
    ends: Box,
    psf_sigma: float,
    *,
    columns: int,
    reach: int,
) -> tuple[Float32Array, npt.NDArray[np.bool_]]:
    """Pixels about a line's middle, turned so that it runs along the rows, and which exist.

    Matched to the stars, in units of its own noise: (2 reach + 1, columns) each.
    """
    import cv2

    x_a, y_a, x_b, y_b = ends
    x, y, angle = 0.5 * (x_a + x_b), 0.5 * (y_a + y_b), math.atan2(y_b - y_a, x_b - x_a)
    u = np.arange(columns, dtype=np.float32) - np.float32(0.5 * (columns - 1))
    v = np.arange(-reach, reach + 1, dtype=np.float32)[:, None]
    cos, sin = np.float32(math.cos(angle)), np.float32(math.sin(angle))
    column, row = np.float32(x) + cos * u - sin * v, np.float32(y) + sin * u + cos * v
    height, width = pixels.shape
    is_inside = (column > -0.5) & (column < width - 0.5) & (row > -0.5) & (row < height - 0.5)
    columns_px = np.clip(np.rint(column), 0, width - 1).astype(np.intp)
    rows_px = np.clip(np.rint(row), 0, height - 1).astype(np.intp)
    strip = pixels[rows_px, columns_px].astype(np.float32)
    along = 0.5 * (columns - 1)
    dx, dy = along * math.cos(angle), along * math.sin(angle)
    levels = [sky.at(sky.level, x + k * dx, y + k * dy) for k in (-1, 0, 1)]
    strip -= np.interp(u, [-along, 0.0, along], levels).astype(np.float32)
    strip *= is_inside
    noise = max(sky.at(sky.noise, x, y), 1e-9)
    smooth = cv2.GaussianBlur(strip, (0, 0), psf_sigma)
    smooth *= np.float32(2.0 * math.sqrt(math.pi) * psf_sigma / noise)
    return np.asarray(smooth, dtype=np.float32), is_inside


@lru_cache(maxsize=16)
def _lines(count: int) -> npt.NDArray[np.intp]:
    """Index in a strip of every place of every line that is tried: (lines, places)."""
    places = np.arange(count)
    along = np.linspace(-1.0, 1.0, count)
    turns = np.arange(-_TURN_PX, _TURN_PX + 1)[:, None, None]
    offsets = np.arange(-_OFFSET_PX, _OFFSET_PX + 1)[:, None]
    rows = np.rint(turns * along + offsets).astype(np.intp) + _REACH_PX
    lines = (rows * count + places).reshape(-1, count)
    lines.setflags(write=False)
    return lines
