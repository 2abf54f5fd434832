"""One line or a few stars in a row: a short light compared with the frame's star images.

Both models are made of star images along the line and fitted to the pixels about it:

- streak: images close together, whose brightness changes slowly or in one period
- stars: a few images of any brightness; each adds to chi-square the price of a star that happens to
  stand there

Both also fit the sky and the listed stars beside the line. Neither fits a cosmic ray, which did not
come through the optics. Where drift has drawn the stars out or wind has shaken them, a moving
object is a narrower line.
"""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import Detection, FloatArray, PixelArray
from rsoconsole.vision.arrays import BoolArray, Float32Array, IndexArray
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.frame.median import median_of
from rsoconsole.vision.lines.line_or_points import best_pair_of_lights
from rsoconsole.vision.stars.star_image import StarImage, gaussian_star_image, median_star_image
from rsoconsole.vision.stars.star_list import StarList
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA

MAX_FWHM = 20.0
"""Length in star widths up to which a few stars may look like a line."""

_STEP_SIGMAS, _BEYOND_SIGMAS, _MIN_STEP_PX, _MAX_STEP_PX = 0.6, 3.0, 0.7, 2.0
_MAX_PLACES, _MAX_BESIDE, _MIN_SIDE_PX = 160, 30, 5
_MAX_STARS, _MAX_THROUGH = 4, 2
"""Largest number of stars in a row that may look like a line, and of those standing on one."""
_PRICE_OF_A_STAR, _PRICE_OF_A_PERIOD = 12.0, 16.0
"""Prices in chi-square: of a star (place and light), and of a period (depth and phase)."""
_PERIODS = np.linspace(1.0, 8.0, 29)
_AS_WIDE, _NARROWEST_PX = 0.9, 1.5
"""Share of a star's width below which a line counts as narrower, and its least width, px."""
_BESIDE_FWHM = 0.8
"""Distance off the line, in star widths, from which a listed star is beside it."""
_END_STEPS = 2
"""Error of an end, in steps."""
_MIN_LEFT, _MAX_LEFT = 1.0, 25.0
"""Limits of the chi-square that one pixel leaves; the upper one since a hot pixel fits neither."""
_SIGMA_PER_MAD = 1.4826
_SMALLEST = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class LineStarsComparison:
    """Comparison of a short light as one line and as a few stars."""

    over_stars: float
    """Chi-square gain of one line over the best few stars, over a pixel's rest; negative: stars."""
    left: float
    """Chi-square per pixel that the line leaves, each pixel's limited: about 1 for a streak."""


class StarImageComparer:
    """Comparer of a frame's short lights with images of its own stars.

    The star images are made at the first comparison.
    """

    def __init__(self, pixels: PixelArray, sky: Background, stars: StarList) -> None:
        """Take ``pixels`` (height, width), ADU: the camera's own, not a binned frame."""
        self._pixels, self._sky, self._stars = pixels, sky, stars
        self._image: StarImage | None = None
        self._is_made = False

    def compared(self, found: Detection) -> LineStarsComparison | None:
        """Compare one light, given in the camera's pixels, as a line and as stars.

        None where it is too long or too short, and where the frame has too few stars for an image.
        """
        fwhm_px = self._stars.fwhm_at(found.x_px, found.y_px)
        if found.length_px > MAX_FWHM * fwhm_px or found.length_px < 1.0:
            return None
        if not self._is_made:
            self._image = median_star_image(self._pixels, self._sky, self._stars)
            self._is_made = True
        if self._image is None:
            return None
        return self._comparison(self._image, found, fwhm_px)

    def _narrower_px(self, found: Detection, fwhm_px: float) -> float | None:
        """Width of a line that moved on while stars were trailed or shaken, px; None: as theirs."""
        if self._stars.trail is not None:
            return fwhm_px
        return max(found.width_px, _NARROWEST_PX) if found.width_px < _AS_WIDE * fwhm_px else None

    def _comparison(
        self, image: StarImage, found: Detection, fwhm_px: float
    ) -> LineStarsComparison | None:
        sigma, course = fwhm_px / FWHM_PER_SIGMA, _Course.of(found)
        step = max(min(_STEP_SIGMAS * sigma, _MAX_STEP_PX), _MIN_STEP_PX)
        count = int((course.length + 2.0 * _BEYOND_SIGMAS * sigma) / step) + 1
        u = np.asarray((np.arange(count) - 0.5 * (count - 1)) * step, dtype=np.float64)
        if count > _MAX_PLACES:
            return None
        box = _box(self._pixels, self._sky, image, course, 0.5 * count * step)
        if box is None:
            return None
        fit = _Fit(box, course, image, self._stars, fwhm_px)
        x, y = course.at(u)
        of_stars = box.images(image, x, y)
        star_places = fit.columns(of_stars)
        lights = _best_line(star_places, fit.target, u, step, 0.5 * course.length)
        rest, by_line = fit.line_leaves(np.tensordot(lights, of_stars, 1), star_places)
        width_px = self._narrower_px(found, fwhm_px)
        if width_px is not None:
            of_line = box.images(gaussian_star_image(width_px), x, y)
            lights = _best_line(fit.columns(of_line), fit.target, u, step, 0.5 * course.length)
            narrow = fit.line_leaves(np.tensordot(lights, of_line, 1), star_places)
            rest, by_line = min((rest, by_line), narrow, key=lambda each: each[1])
        by_stars = _left_by_stars(fit, star_places, of_stars, step)
        left = float(np.minimum(rest**2, _MAX_LEFT).sum()) / fit.freedom
        over = (by_stars - by_line) / max(left, _MIN_LEFT)
        return LineStarsComparison(over_stars=over, left=left)


@dataclass(frozen=True, slots=True)
class _Course:
    """Line by its middle, direction and length."""

    x: float
    y: float
    dx: float
    dy: float
    length: float

    @classmethod
    def of(cls, found: Detection) -> "_Course":
        length = max(found.length_px, _SMALLEST)
        return cls(
            0.5 * (found.x_a_px + found.x_b_px),
            0.5 * (found.y_a_px + found.y_b_px),
            (found.x_b_px - found.x_a_px) / length,
            (found.y_b_px - found.y_a_px) / length,
            length,
        )

    def at(self, along: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Places on it, x and y."""
        return self.x + along * self.dx, self.y + along * self.dy

    def along(self, x: FloatArray | IndexArray, y: FloatArray | IndexArray) -> FloatArray:
        """Distance from its middle along it, px."""
        return np.asarray((x - self.x) * self.dx + (y - self.y) * self.dy)

    def away(self, x: FloatArray | IndexArray, y: FloatArray | IndexArray) -> FloatArray:
        """Distance from the nearest place between its ends, px."""
        across = (y - self.y) * self.dx - (x - self.x) * self.dy
        beyond = np.maximum(np.abs(self.along(x, y)) - 0.5 * self.length, 0.0)
        return np.asarray(np.hypot(beyond, across))


@dataclass(frozen=True, slots=True, eq=False)
class _Box:
    """Pixels about a line; the used ones form one column, each over its error."""

    left: int
    top: int
    is_used: BoolArray
    """(rows, columns) True for the pixels used."""
    white: FloatArray
    """(used,) inverse error of each pixel."""
    value: FloatArray
    """(used,) light over its error."""

    @property
    def x(self) -> IndexArray:
        """(1, columns) columns of the frame."""
        return np.arange(self.is_used.shape[1])[None] + self.left

    @property
    def y(self) -> IndexArray:
        """(rows, 1) rows of the frame."""
        return np.arange(self.is_used.shape[0])[:, None] + self.top

    def images(self, image: StarImage, x_px: FloatArray, y_px: FloatArray) -> Float32Array:
        """Images of points of unit light at n places, (n, rows, columns)."""
        rows, columns = self.is_used.shape
        out = np.zeros((len(x_px), rows, columns), dtype=np.float32)
        for each, x, y in zip(out, x_px.tolist(), y_px.tolist(), strict=True):
            column, row, pixels = image.at(x - self.left, y - self.top)
            top, bottom = max(row, 0), min(row + pixels.shape[0], rows)
            left, right = max(column, 0), min(column + pixels.shape[1], columns)
            if top < bottom and left < right:
                each[top:bottom, left:right] = pixels[
                    top - row : bottom - row, left - column : right - column
                ]
        return out

    def columns(self, images: FloatArray | Float32Array) -> FloatArray:
        """Images (n, rows, columns) over the pixels' errors, (used, n)."""
        return np.asarray((images[:, self.is_used] * self.white).T, dtype=np.float64)


def _box(
    pixels: PixelArray, sky: Background, image: StarImage, course: _Course, reach: float
) -> _Box | None:
    """Pixels within a star's reach of the line, and ``reach`` px more; None: too few."""
    import cv2

    x, y = course.at(np.array([-reach, reach]))
    room = image.reach
    left, top = max(math.floor(x.min()) - room, 0), max(math.floor(y.min()) - room, 0)
    box = pixels[top : math.ceil(y.max()) + room + 1, left : math.ceil(x.max()) + room + 1]
    if min(box.shape) < _MIN_SIDE_PX:
        return None
    at = round(left + 0.5 * box.shape[1]), round(top + 0.5 * box.shape[0])
    light = box.astype(np.float32) - np.float32(sky.at(sky.level, *at))
    noise = max(sky.at(sky.noise, *at), _scatter_below(light), _SMALLEST)
    columns, rows = np.arange(box.shape[1])[None] + left, np.arange(box.shape[0])[:, None] + top
    is_used = course.away(columns, rows) < room
    calm = cv2.GaussianBlur(light, (0, 0), 1.0)[is_used].astype(np.float64)
    white = 1.0 / np.hypot(noise, image.misfit * np.maximum(calm, 0.0))
    return _Box(left, top, is_used, white, light[is_used] * white)


def _scatter_below(light: Float32Array) -> float:
    """Scatter of the darker pixels: a colour camera's grid scatters more than noise does."""
    off = median_of(light) - light
    return _SIGMA_PER_MAD * median_of(off[off >= 0.0])


class _Fit:
    """Fit of one light, without what sky and listed stars beside it explain."""

    def __init__(
        self, box: _Box, course: _Course, image: StarImage, stars: StarList, fwhm_px: float
    ) -> None:
        away = course.away(stars.x_px, stars.y_px)
        beside = np.flatnonzero((away > _BESIDE_FWHM * fwhm_px) & (away < 2.0 * image.reach))
        beside = beside[:_MAX_BESIDE]
        images = box.images(image, stars.x_px[beside], stars.y_px[beside])
        free = np.concatenate([box.white[:, None], box.columns(images)], axis=1)
        self._free, _ = np.linalg.qr(free)
        self._box, self._course = box, course
        self.target = self._without(box.value)
        self.freedom = max(self.target.size - free.shape[1] - 6, 1)

    def columns(self, images: FloatArray | Float32Array) -> FloatArray:
        """Images (n, rows, columns) as columns, without what is explained anyway, (used, n)."""
        return self._without(self._box.columns(images))

    def _without(self, columns: FloatArray) -> FloatArray:
        return np.asarray(columns - self._free @ (self._free.T @ columns))

    def line_leaves(self, line: FloatArray, places: FloatArray) -> tuple[FloatArray, float]:
        """Fit an image of a line to the pixels; return the residuals and their penalised
        chi-square.

        The line may move across and turn a little; a few stars at some of the ``places`` (used,
        n) may be added to it, each at a penalty.
        """
        down, right = np.gradient(line)
        across = down * self._course.dx - right * self._course.dy
        along = self._course.along(self._box.x, self._box.y) / self._course.length
        columns = self.columns(np.stack([line, across, across * along]))
        own = np.maximum((places**2).sum(axis=0), _SMALLEST)
        best, least = self.target, math.inf
        for count in range(_MAX_THROUGH + 1):
            weights, *_ = np.linalg.lstsq(columns, self.target, rcond=None)
            rest = self.target - columns @ weights
            left = float(rest @ rest) + count * _PRICE_OF_A_STAR
            if left < least:
                best, least = rest, left
            one = int(np.argmax(np.maximum(rest @ places, 0.0) ** 2 / own))
            columns = np.concatenate([columns, places[:, one : one + 1]], axis=1)
        return np.asarray(best), least

    def stars_leave(self, images: Float32Array, lights: FloatArray, step: float) -> float:
        """Chi-square that stars leave, each moved a little between and beside the searched places.

        One sigma of a move is half a ``step``.
        """
        lit = lights > 0.0
        if not lit.any():
            return float(self.target @ self.target)
        down, right = np.gradient(images[lit], axis=(1, 2))
        columns = self.columns(np.concatenate([images[lit], down, right]))
        held = np.concatenate([np.zeros(lit.sum()), *(2 * [2.0 / (step * lights[lit])])])
        columns = np.concatenate([columns, np.diag(held)])
        wanted = np.concatenate([self.target, np.zeros(held.size)])
        weights, *_ = np.linalg.lstsq(columns, wanted, rcond=None)
        rest = wanted - columns @ weights
        return float(rest @ rest)


def _best_line(
    places: FloatArray, target: FloatArray, u: FloatArray, step: float, half: float
) -> FloatArray:
    """Lights of the places, (n,), for the line that leaves least: its ends, slope and period."""
    gram, projected = places.T @ places, places.T @ target
    moved = np.arange(-_END_STEPS, _END_STEPS + 1) * step
    a, b = (each.ravel() for each in np.meshgrid(-half + moved, half + moved))
    is_line = b - a > step
    shapes = _shapes(u, step, a[is_line, None], b[is_line, None])
    gains, lights = _fitted(gram, projected, shapes[..., :2])
    best = int(np.argmax(gains))
    phase = math.pi * _PERIODS[:, None] * shapes[best, :, 2]
    waves = np.stack([np.cos(phase), np.sin(phase)], axis=-1) * shapes[best, :, :1]
    plain = np.broadcast_to(shapes[best, :, :2], waves.shape)
    of_period, periodic = _fitted(gram, projected, np.concatenate([plain, waves], axis=-1))
    at = int(np.argmax(of_period))
    is_periodic = of_period[at] - _PRICE_OF_A_PERIOD > gains[best]
    return np.asarray(periodic[at] if is_periodic else lights[best])


def _shapes(u: FloatArray, step: float, low: FloatArray, high: FloatArray) -> FloatArray:
    """Shapes (lines, n, 3): share of a place's step between the ends, it times t (-1 to 1), t."""
    inside = np.minimum(u + 0.5 * step, high) - np.maximum(u - 0.5 * step, low)
    box = np.clip(inside / step, 0.0, 1.0)
    t = (u - 0.5 * (low + high)) / (0.5 * (high - low))
    return np.stack([box, box * t, t], axis=-1)


def _fitted(
    gram: FloatArray, projected: FloatArray, shapes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Chi-square that shapes (tries, n, k) explain, and lights of the places then, (tries, n)."""
    turned = shapes.transpose(0, 2, 1)
    g, h = turned @ gram @ shapes, turned @ projected
    k = np.arange(g.shape[1])
    g[:, k, k] = g[:, k, k] * (1.0 + 1e-6) + _SMALLEST
    weights = np.linalg.solve(g, h[..., None])
    return (h * weights[..., 0]).sum(axis=1), (shapes @ weights)[..., 0]


def _left_by_stars(fit: _Fit, places: FloatArray, images: Float32Array, step: float) -> float:
    """Chi-square of the best few stars with their price: the best pair, then one more each."""
    gram, projected = places.T @ places, places.T @ fit.target
    own = np.maximum(np.diag(gram), _SMALLEST)
    single = np.maximum(projected, 0.0) ** 2 / own
    chosen = [int(np.argmax(single))]
    left = math.inf
    for count in range(1, _MAX_STARS + 1):
        if count == 2:
            chosen = best_pair_of_lights(gram, projected)
        elif count > 2:
            chosen.append(_next(gram, projected, own, chosen))
            for i in range(count):
                chosen[i] = _next(gram, projected, own, chosen[:i] + chosen[i + 1 :])
        rest = fit.stars_leave(images[chosen], _lights(gram, projected, chosen), step)
        left = min(left, rest + count * _PRICE_OF_A_STAR)
    return left


def _next(gram: FloatArray, projected: FloatArray, own: FloatArray, chosen: list[int]) -> int:
    """Index of the place where one more star explains most."""
    rest = projected - gram[:, chosen] @ _lights(gram, projected, chosen)
    return int(np.argmax(np.maximum(rest, 0.0) ** 2 / own))


def _lights(gram: FloatArray, projected: FloatArray, chosen: list[int]) -> FloatArray:
    """Lights of the chosen stars, none of them negative."""
    from scipy.optimize import nnls

    g = gram[np.ix_(chosen, chosen)] + _SMALLEST * np.eye(len(chosen))
    root = np.linalg.cholesky(g + 1e-6 * float(np.trace(g)) * np.eye(len(chosen)))
    lights, _ = nnls(root.T, np.linalg.solve(root, projected[chosen]))
    return np.asarray(lights)
