"""Middle of a streak whose image shook during the exposure, from its ends and its light.

Wind moves the image of stars and satellite alike. Stars show the mean position over the exposure,
but an end of a streak the position at one instant: its error is as large as the image shook, and
that of the middle of two ends 0.7 times as large. The light helps: a steady light shaken along its
path is brighter where it is slow and fainter where it is fast.

The profile is therefore fitted as a steady light whose position along its path is even motion plus
a wander w(t) with mean 0 over the exposure. The model is linear in w; seeing blurs everything
finer, so that some ten cosines describe w. Size and speed of the wander are unknown: several are
tested and weighted by their likelihood (least squares under a Gaussian prior, Rasmussen & Williams
2006, 2.2). Where nothing shook, the result follows from the ends alone.
"""

import logging
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from rsoconsole.records import Detection, FloatArray, PixelArray
from rsoconsole.vision.arrays import BoolArray, IndexArray
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.frame.median import median_of
from rsoconsole.vision.lines.line_strip import (
    INTERPOLATED_VARIANCE,
    LineStrip,
    StripLine,
    cut_out_strip,
    profile_of,
    subtract_sky_beside,
)
from rsoconsole.vision.lines.line_texture import surroundings_scatter_ratio
from rsoconsole.vision.lines.segments import Ends, length_of
from rsoconsole.vision.stars.star_list import StarList
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA

log = logging.getLogger(__name__)

_WANDERS = (0.02, 0.25, 0.5, 1.0, 2.0)
"""One sigma of the wander, in sigmas of the stars' disc."""
_LASTS = (0.05, 0.2)
"""Share of the exposure after which the wander is uncorrelated."""
_UNSTEADY = 0.03
"""Relative sigma by which a steady light becomes brighter from middle to end; also of bulges."""
_BEYOND = 4.0
"""Distance beyond the ends, in sigmas of the disc, up to which there is light."""
_FINEST, _MAX_COSINES, _MAX_SOURCES = 1.5, 32, 400
_MIN_SOURCES, _MIN_COLUMNS = 6, 8
_LOOKS, _MAX_MOVED, _CLOSE = 2, 2.0, 0.05
"""Number of looks, largest move of the middle, and move at which ends stay, in disc sigmas."""
_MAX_MISFIT = 2.5
"""Largest chi-square of a column: above it an unlisted star lies on the streak."""
_JITTER, _SMALLEST = 1e-6, 1e-9
_ACROSS, _ALONG = 1.25, 0.85
"""Sigma across of the summing Gaussian, and of the disc at an instant, in the stars' sigmas."""
_MAX_ASIDE, _MAX_STEPS = 3.0, 120
"""Largest distance of the path from the line, in disc sigmas, and largest number of steps."""
_STRAIGHT, _SMOOTH = 0.01, 0.2
"""Costs over typical light: of a sigma off the line, of a turn by one sigma to the next column."""
_SOUGHT, _WANDER = (1, 2), 3
"""Indices of the terms: shift and stretch; the first cosine."""
_BELIEVED = 4.0
"""Number of samples of the sky beside it that the noise of pixels counts as."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StreakMiddle:
    """Position of a streak's middle along the streak, from its ends and its light together."""

    offset_px: float
    """Distance from the midpoint of the given ends, px; positive towards the second end."""
    sigma_px: float
    length_px: float
    """Length that even motion covers during the exposure, px."""
    sigma_length_px: float


def with_middle_by_light(
    pixels: PixelArray, sky: Background, stars: StarList, streak: Detection
) -> Detection:
    """Return the streak with its middle's offset by ends and light, where it is found.

    Unchanged where an end is outside the frame, where the streak was not measured as a line, and
    where ``find_middle`` finds nothing or fails: the failure is logged, not raised.
    """
    if streak.kind != "streak" or streak.method != "line":
        return streak
    ends = streak.x_a_px, streak.y_a_px, streak.x_b_px, streak.y_b_px
    try:
        found = find_middle(pixels, sky, ends, stars, stars.fwhm_at(streak.x_px, streak.y_px))
    except Exception:
        # What is told beside a detection must not cost it.
        log.exception("frame %d: no middle by light for %s", streak.frame_id, streak)
        return streak
    if found is None:
        return streak
    return replace(
        streak,
        light_offset_px=found.offset_px,
        light_sigma_px=found.sigma_px,
        light_length_px=found.length_px,
        light_length_sigma_px=found.sigma_length_px,
    )


def find_middle(
    pixels: PixelArray, sky: Background, ends: Ends, stars: StarList, fwhm_px: float
) -> StreakMiddle | None:
    """Find the middle of a streak between ``ends`` (x_a, y_a, x_b, y_b), by ends and light.

    ``fwhm_px``: width of stars. None where the frame cuts the streak, and where stars hide it or
    are part of its light. The errors hold for a steady light only, not for one that flashes or
    tumbles.
    """
    sigma = math.hypot(fwhm_px / FWHM_PER_SIGMA, math.sqrt(INTERPOLATED_VARIANCE))
    strip = cut_out_strip(pixels, sky, ends, stars, sigma)
    return None if strip is None else _in_strip(strip, ends, sigma)


def _in_strip(strip: LineStrip, ends: Ends, sigma: float) -> StreakMiddle | None:
    first = (ends[0] - strip.x0_px) * strip.dx + (ends[1] - strip.y0_px) * strip.dy
    last = first + length_of(ends)
    room = _BEYOND * sigma
    if first < room or last > strip.values.shape[1] - 1 - room:
        return None
    course = StripLine(0.5 * (first + last), 0.0, 0.0, 0.0, 0.0)
    subtract_sky_beside(strip, course, sigma)
    way = _way(strip, first, last, sigma)
    profile = profile_of(strip, way, _ACROSS * sigma)
    used = profile.is_known_between(first - room, last + room)
    if np.count_nonzero(profile.is_known_between(first, last)) < _MIN_COLUMNS:
        return None
    error = surroundings_scatter_ratio(strip, used, course, sigma) * profile.error[used]
    u = profile.columns[used].astype(np.float64)
    settled = _settled(u, profile.light[used], error, (first, last), sigma)
    if settled is None:
        return None
    a, b, found = settled
    offset = 0.5 * (a + b - first - last)
    if not (found.misfit <= _MAX_MISFIT and abs(offset) <= _MAX_MOVED * sigma):
        return None
    # Faint stars count by where they are: one near an end pulls more than many in the middle.
    beside = np.array([found.weights @ each for each in _beside(strip, used, way, sigma)])
    noise = found.weights**2 @ error**2
    seen = (_BELIEVED * noise + np.sum(beside**2, axis=0)) / (_BELIEVED + len(beside))
    variance = found.variance + np.maximum(seen - noise, 0.0)
    return StreakMiddle(
        offset_px=offset,
        sigma_px=math.sqrt(variance[0]),
        length_px=b - a,
        sigma_length_px=2.0 * math.sqrt(variance[1]),
    )


def _settled(
    u: FloatArray, light: FloatArray, error: FloatArray, ends: tuple[float, float], sigma: float
) -> "tuple[float, float, _Look] | None":
    """Return the ends of the even motion, and the last look at them; None where there is none."""
    a, b = ends
    found = None
    for _ in range(_LOOKS):
        found = _look(u, light, error, (a, b), _ALONG * sigma)
        if found is None:
            return None
        shift, stretch = np.clip(found.value, -_MAX_MOVED * sigma, _MAX_MOVED * sigma).tolist()
        a, b = a + shift - stretch, b + shift + stretch
        if b - a < sigma:
            return None
        if max(abs(shift), abs(stretch)) < _CLOSE * sigma:
            break
    return None if found is None else (a, b, found)


@dataclass(frozen=True, slots=True)
class _Wandering:
    """Path that the image drew as it shook."""

    rows: FloatArray
    """Row of the path in each column of a strip."""
    away: float = 0.0
    """Offset beside the path, rows."""

    def at(self, columns: IndexArray) -> FloatArray:
        return np.asarray(self.rows[columns] + self.away)


def _way(strip: LineStrip, first: float, last: float, sigma: float) -> _Wandering:
    """Find the brightest path from end to end that bends little (Viterbi 1967)."""
    import cv2

    rim = math.ceil(_MAX_ASIDE * sigma)
    kernel = cv2.getGaussianKernel(2 * math.ceil(1.5 * sigma) + 1, 0.5 * sigma)
    calm = cv2.sepFilter2D(np.where(strip.is_good, strip.values, 0.0), cv2.CV_64F, kernel, kernel)
    stride = max(1, math.ceil((last - first) / _MAX_STEPS))
    columns = np.arange(round(first), round(last) + 1, stride)
    light = calm[strip.reach - rim : strip.reach + rim + 1, columns]
    typical = max(median_of(light.max(axis=0)), _SMALLEST)
    row = np.arange(-rim, rim + 1) / sigma
    light = light / typical - _STRAIGHT * row[:, None] ** 2
    turning = _SMOOTH / stride * (row[:, None] - row) ** 2
    best = [light[:, 0]]
    for column in light.T[1:]:
        best.append(np.maximum.reduce(best[-1] - turning, axis=1) + column)
    places = [int(best.pop().argmax())]
    for before in reversed(best):
        places.append(int((before - turning[places[-1]]).argmax()))
    rows = np.interp(strip.columns, columns, np.array(places[::-1], np.float64) - rim)
    calmer = cv2.GaussianBlur(rows[None], (0, 0), 0.5 * sigma, borderType=cv2.BORDER_REPLICATE)
    return _Wandering(np.asarray(calmer[0]))


def _beside(
    strip: LineStrip, used: BoolArray, way: _Wandering, sigma: float
) -> Iterator[FloatArray]:
    """Yield profiles of the sky beside the streak, in its columns; 0 where stars are masked."""
    for away in (3.5 * sigma + 2.0, 5.5 * sigma + 3.0):
        for sense in (-1.0, 1.0):
            aside = replace(way, away=sense * away)
            yield profile_of(strip, aside, _ACROSS * sigma).light[used]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Look:
    """Shift of the middle, and stretch of either end: (2,) each, px."""

    value: FloatArray
    variance: FloatArray
    weights: FloatArray
    """(2, columns) weights of the light in them."""
    misfit: float
    """Chi-square left in a column."""


def _look(
    u: FloatArray, light: FloatArray, error: FloatArray, ends: tuple[float, float], sigma: float
) -> _Look | None:
    """Fit even motion between these ends, and a wander, to the profile."""
    a, b = ends
    sources = int(np.clip(round(b - a), _MIN_SOURCES, _MAX_SOURCES))
    cosines = int(np.clip(round((b - a) / (_FINEST * sigma)), 2, _MAX_COSINES))
    share, wander, inverses, log_sizes = _wanders(sources, cosines)
    step, along = (b - a) / sources, 2.0 * share - 1.0
    away = u[:, None] - (a + share * (b - a))
    seen = np.exp(-0.5 * (away / sigma) ** 2) * (step / (math.sqrt(2.0 * math.pi) * sigma))
    pushed = seen * away / sigma**2
    shape, weight = seen.sum(axis=1), error**-2.0
    flux = float((weight * light) @ shape) / float((weight * shape) @ shape)
    if not flux > 0.0:
        return None
    terms = np.concatenate(
        [
            np.stack([shape, flux * pushed.sum(axis=1), flux * (pushed @ along)], axis=1),
            flux * (pushed @ wander),
            flux * np.stack([seen @ along, seen @ (1.5 * along**2 - 0.5)], axis=1),
        ],
        axis=1,
    )
    weighed = (terms * weight[:, None]).T
    right, normal = weighed @ light, weighed @ terms
    steady = slice(_WANDER + cosines, len(normal))
    normal[steady, steady] += np.eye(2) / _UNSTEADY**2
    # Each way of wandering: information on the terms, and what its prior weighs.
    fars = np.array(_WANDERS) * sigma
    every = np.tile(normal, (len(_LASTS), len(fars), 1, 1))
    at = slice(_WANDER, _WANDER + cosines)
    every[:, :, at, at] += inverses[:, None] / (fars**2)[:, None, None]
    every = every.reshape(-1, *normal.shape)
    sizes = (log_sizes[:, None] + 2.0 * cosines * np.log(fars)).ravel()
    asked = np.stack([right, *np.eye(len(right))[list(_SOUGHT)]], axis=1)
    solved = np.linalg.solve(every, np.tile(asked, (len(every), 1, 1)))
    values, rows = solved[:, _SOUGHT, 0], np.swapaxes(solved[:, :, 1:], 1, 2)
    explained = solved[:, :, 0] @ right
    likely = 0.5 * (explained - np.linalg.slogdet(every)[1] - sizes)
    chances = np.exp(likely - likely.max())
    chances /= chances.sum()
    value = chances @ values
    own = np.stack([rows[:, n, each] for n, each in enumerate(_SOUGHT)], axis=1)
    return _Look(
        value=value,
        variance=chances @ (own + (values - value) ** 2),
        weights=np.einsum("g,gij->ij", chances, rows) @ weighed,
        misfit=(float(weight @ light**2) - float(chances @ explained)) / len(light),
    )


@lru_cache(maxsize=32)
def _wanders(sources: int, cosines: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Shares (sources,) of the exposure, the cosines there, and the prior of their sizes.

    The prior: for each of ``_LASTS`` the inverse of its covariance and the logarithm of its
    determinant, for a wander of sigma 1.
    """
    share = (np.arange(sources) + 0.5) / sources
    wander = np.cos(np.pi * share[:, None] * np.arange(1, cosines + 1))
    to_cosines = 2.0 / sources * wander
    inverses, log_sizes = [], []
    for lasts in _LASTS:
        alike = np.exp(-np.abs(share[:, None] - share) / lasts)
        covariance = to_cosines.T @ alike @ to_cosines
        covariance += _JITTER * np.trace(covariance) / cosines * np.eye(cosines)
        inverses.append(np.linalg.inv(covariance))
        log_sizes.append(np.linalg.slogdet(covariance)[1])
    return share, wander, np.array(inverses), np.array(log_sizes)
