"""Small images of lines, turned along the rows and scaled to one size: what the verifier looks at.

Across, a row is half a width of a star; along, the line fills the same columns whatever its length.
Values are in units of the frame's noise, so that one network serves every telescope. Channels:

- light whose every sample is limited to a few sigma, summed: a faint line adds up, a star does not
- the plain mean, compressed, which shows stars, rays and flashes as they are
- the images of the listed stars; -1 outside the frame
- the image that a streak between the proposed ends would have
"""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.arrays import Float32Array
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.lines.segments import Ends
from rsoconsole.vision.stars.point_image import PointImage
from rsoconsole.vision.stars.star_list import StarList
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA

LINE_IMAGE_SHAPE = CHANNELS, ROWS, COLUMNS = 4, 24, 64
LINE_FIGURES = 10
"""Number of figures beside an image."""
_MARGIN, _MARGIN_FWHM = 0.25, 6.0
"""Room beyond either end: share of the length, and least widths of a star."""
_ROW_FWHM, _LEAST_FWHM_PX = 0.5, 1.5
_LIMIT = 3.0
_ROUNDING_SIGMA = 12.0**-0.5
"""Noise of whole numbers, ADU."""
_MAX_SUM, _MAX_MEAN = 8.0, 4.0
_MAX_SAMPLES = 24
_STAR_REACH = 4.0
_TRAIL_STEPS = 9
_CROWDED = 1e3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineImages:
    """Images of n lines of one frame, and figures beside them."""

    ends: FloatArray
    """(n, 4) x_a, y_a, x_b, y_b of the lines, px."""
    images: Float32Array
    """(n, channels, rows, columns)."""
    figures: Float32Array
    """(n, ``LINE_FIGURES``): logarithms of length, width, steps, of how drift drew the stars out,
    of how many stars' images the frame would hold (in a large one chance draws more lines), and of
    the share that the listed ones cover."""
    scales: FloatArray
    """(n, 3): first column's place before end a, px; px a column; px a row."""


def line_images(
    pixels: PixelArray, sky: Background, stars: StarList, focus: PointImage, lines: FloatArray
) -> LineImages:
    """Cut out the images of ``lines`` (n, 4: x_a, y_a, x_b, y_b, px) of a frame.

    ``pixels``: (height, width), ADU; ``focus``: of the frame, as the lines in pixels of it.
    """
    count = len(lines)
    images = np.zeros((count, *LINE_IMAGE_SHAPE), dtype=np.float32)
    figures = np.zeros((count, LINE_FIGURES), dtype=np.float32)
    scales = np.zeros((count, 3))
    shown = _ShownStars(stars, sky)
    for i, ends in enumerate(lines.tolist()):
        images[i], figures[i], scales[i] = _image(pixels, sky, shown, focus, tuple(ends))
    return LineImages(ends=lines, images=images, figures=figures, scales=scales)


def _image(
    pixels: PixelArray, sky: Background, stars: "_ShownStars", focus: PointImage, ends: Ends
) -> tuple[Float32Array, list[float], list[float]]:
    import cv2

    x_a, y_a, x_b, y_b = ends
    length = max(math.hypot(x_b - x_a, y_b - y_a), 1.0)
    dx, dy = (x_b - x_a) / length, (y_b - y_a) / length
    here = focus.at(0.5 * (x_a + x_b), 0.5 * (y_a + y_b))
    fwhm = max(here.fwhm_px, _LEAST_FWHM_PX)
    widest = max(here.widest_streak_px(math.degrees(math.atan2(dy, dx))), fwhm)
    margin = max(_MARGIN * length, _MARGIN_FWHM * fwhm)
    column_px = (length + 2.0 * margin) / COLUMNS
    row_px = max(_ROW_FWHM * fwhm, widest / 8.0)
    along = min(max(math.ceil(column_px), 1), _MAX_SAMPLES)
    across = max(math.ceil(row_px - 0.25), 1)
    u = (np.arange(COLUMNS * along, dtype=np.float32) + 0.5) * (column_px / along) - margin
    v = ((np.arange(ROWS * across, dtype=np.float32) + 0.5) / across - 0.5 * ROWS) * row_px
    x = np.float32(x_a) + np.float32(dx) * u - np.float32(dy) * v[:, None]
    y = np.float32(y_a) + np.float32(dy) * u + np.float32(dx) * v[:, None]
    height, width = pixels.shape
    left, right = max(int(x.min()) - 1, 0), min(int(x.max()) + 3, width)
    low, high = max(int(y.min()) - 1, 0), min(int(y.max()) + 3, height)
    out = np.zeros(LINE_IMAGE_SHAPE, dtype=np.float32)
    figures = [
        math.log2(length / fwhm) / 4.0,
        math.log2(fwhm),
        math.log2(column_px) / 2.0,
        math.log2(here.joined),
        math.log1p(here.trail_px / fwhm),
        math.log2(widest / fwhm),
        math.log2(length + 2.0 * margin) / 8.0,
        math.log2(row_px),
        math.log2(pixels.size / fwhm**2) / 16.0,
        math.log2(1.0 + _CROWDED * stars.count * fwhm**2 / pixels.size) / 4.0,
    ]
    scales = [margin, column_px, row_px]
    if right - left < 2 or high - low < 2:
        out[2] = -1.0
        return out, figures, scales
    piece = pixels[low:high, left:right]
    if piece.dtype not in (np.uint8, np.uint16, np.float32):
        piece = piece.astype(np.float32)
    place_x, place_y = x - np.float32(left), y - np.float32(low)
    light = cv2.remap(piece, place_x, place_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    light = light.astype(np.float32)
    is_in = (x > -0.5) & (x < width - 0.5) & (y > -0.5) & (y < height - 0.5)
    cells = ((x + 0.5) / sky.cell_px - 0.5, (y + 0.5) / sky.cell_px - 0.5)
    rim = cv2.BORDER_REPLICATE
    floor = 1e-6 if pixels.dtype.kind == "f" else _ROUNDING_SIGMA
    light -= cv2.remap(sky.level, *cells, cv2.INTER_LINEAR, borderMode=rim)
    light /= np.maximum(cv2.remap(sky.noise, *cells, cv2.INTER_LINEAR, borderMode=rim), floor)
    light *= is_in
    if here.fwhm_px < _LEAST_FWHM_PX:
        light = _widened(light, here.fwhm_px, (column_px / along, row_px / across))
    root = np.float32(math.sqrt(max(column_px * row_px, 1.0)))
    limited = np.minimum(np.maximum(light, -_LIMIT), _LIMIT)
    out[0] = np.clip(_means(limited, across, along) * root, -_MAX_SUM, _MAX_SUM) / 4.0
    out[1] = np.clip(np.arcsinh(_means(light, across, along)) / 2.0, -_MAX_MEAN, _MAX_MEAN)
    v_rows = (np.arange(ROWS, dtype=np.float64) + 0.5 - 0.5 * ROWS) * row_px
    u_columns = (np.arange(COLUMNS, dtype=np.float64) + 0.5) * column_px - margin
    out[2] = np.arcsinh(stars.drawn(ends, (dx, dy), u_columns, v_rows, column_px)) / 2.0
    out[2] -= 1.0 - _means(is_in.astype(np.float32), across, along)
    sigma = math.hypot(widest / FWHM_PER_SIGMA, 0.3 * row_px)
    inside = np.clip(np.minimum(u_columns, length - u_columns) / column_px + 0.5, 0.0, 1.0)
    out[3] = np.exp(-0.5 * (v_rows / sigma) ** 2)[:, None] * inside
    return out, figures, scales


def _widened(light: Float32Array, fwhm_px: float, step_px: tuple[float, float]) -> Float32Array:
    """Light as wider stars would show it: a streak of sharp ones looks like a cosmic ray.

    ``step_px``: from sample to sample along and across.
    """
    import cv2

    sigma = math.sqrt(_LEAST_FWHM_PX**2 - fwhm_px**2) / FWHM_PER_SIGMA
    wide = cv2.GaussianBlur(light, (0, 0), sigma / step_px[0], None, sigma / step_px[1])
    # In units of what is left of a pixel's noise.
    return np.asarray(wide * np.float32(max(2.0 * math.sqrt(math.pi) * sigma, 1.0)))


def _means(samples: Float32Array, across: int, along: int) -> Float32Array:
    """Means of groups of samples: (rows x across, columns x along) to (rows, columns)."""
    import cv2

    if across == along == 1:
        return samples
    return np.asarray(cv2.resize(samples, (COLUMNS, ROWS), interpolation=cv2.INTER_AREA))


class _ShownStars:
    """Images of a frame's listed stars, peak in units of a pixel's noise."""

    def __init__(self, stars: StarList, sky: Background) -> None:
        self.count = len(stars)
        fwhm = np.maximum(stars.fwhm_px, stars.expected_fwhm_px())
        self._sigma = np.maximum(fwhm, 1.0) / FWHM_PER_SIGMA
        area = 2.0 * np.pi * self._sigma**2
        self._x, self._y, self._trail = stars.x_px, stars.y_px, stars.trail
        if stars.trail is not None:
            area += np.sqrt(2.0 * np.pi) * self._sigma * stars.trail.length_px
        self._peak = stars.flux / area / max(float(np.median(sky.noise)), 1e-6)

    def drawn(
        self,
        ends: Ends,
        way: tuple[float, float],
        u: FloatArray,
        v: FloatArray,
        column_px: float,
    ) -> FloatArray:
        """Light of the stars at columns ``u`` and rows ``v`` of a line from ``ends``."""
        dx, dy = way
        reach = _STAR_REACH * float(self._sigma.max(initial=1.0))
        reach += 0.0 if self._trail is None else 0.5 * self._trail.length_px
        off_x, off_y = self._x - ends[0], self._y - ends[1]
        at_u, at_v = off_x * dx + off_y * dy, off_y * dx - off_x * dy
        near = (at_u > u[0] - reach) & (at_u < u[-1] + reach) & (np.abs(at_v) < v[-1] + reach)
        chosen = np.flatnonzero(near)
        if not chosen.size:
            return np.zeros((v.size, u.size))
        at_u, at_v = at_u[chosen], at_v[chosen]
        sigma, peak = self._sigma[chosen], self._peak[chosen]
        if self._trail is not None:
            turn = math.radians(self._trail.angle_deg) - math.atan2(dy, dx)
            steps = np.linspace(-0.5, 0.5, _TRAIL_STEPS) * self._trail.length_px
            at_u = (at_u[:, None] + steps * math.cos(turn)).ravel()
            at_v = (at_v[:, None] + steps * math.sin(turn)).ravel()
            sigma = np.repeat(sigma, _TRAIL_STEPS)
            apart = self._trail.length_px / (_TRAIL_STEPS - 1)
            peak = np.repeat(peak, _TRAIL_STEPS) * np.minimum(apart / (2.5 * sigma), 1.0)
        wide = np.hypot(sigma, 0.3 * column_px)
        columns = np.exp(-0.5 * ((u - at_u[:, None]) / wide[:, None]) ** 2)
        columns *= (peak * sigma / wide)[:, None]
        rows = np.exp(-0.5 * ((v - at_v[:, None]) / sigma[:, None]) ** 2)
        return np.asarray(rows.T @ columns)
