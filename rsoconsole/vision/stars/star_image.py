"""Image of a star in a frame, whatever its shape: disc, ring, comet or trail.

The median of the frame's own stars: bright ones that stand alone, each scaled to a total light of 1
and moved so that its middle lies at the centre of a pixel.
"""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.arrays import Float32Array, IndexArray
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.stars.star_list import StarList
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA

_FEWEST, _MOST = 8, 60
_MIN_SNR, _ALONE_FWHM, _REACH_FWHM, _MIN_REACH_PX = 20.0, 3.0, 1.5, 5
_MIN_MISFIT, _MAX_MISFIT = 0.02, 0.2
_BRIGHT_SHARE = 0.3
_ROOM_PX = 2
_SMALLEST = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StarImage:
    """Image of a point source whose light adds up to 1."""

    pixels: Float32Array
    """(2 reach + 1, 2 reach + 1); the point lies at the centre of the middle pixel."""
    misfit: float = 0.0
    """How far single stars differ from this image beyond their noise, as a share of its peak."""

    @property
    def reach(self) -> int:
        """Number of pixels from the middle pixel to the edge of the image."""
        return int(self.pixels.shape[0] // 2)

    def at(self, x_px: float, y_px: float) -> tuple[int, int, Float32Array]:
        """Return the image of a point at a place of the frame, shifted by the fraction of a pixel.

        As (column, row, pixels): column and row are the place of its first pixel in the frame.
        """
        import cv2

        column, row = round(x_px), round(y_px)
        shift = np.array([[1.0, 0.0, x_px - column], [0.0, 1.0, y_px - row]])
        side = self.pixels.shape[0]
        moved = cv2.warpAffine(
            self.pixels, shift, (side, side), flags=cv2.INTER_LANCZOS4, borderValue=0.0
        )
        return column - self.reach, row - self.reach, np.asarray(moved)


def gaussian_star_image(fwhm_px: float) -> StarImage:
    """Return the image of a Gaussian star, by its full width at half maximum."""
    import cv2

    reach = max(math.ceil(_REACH_FWHM * fwhm_px) + 1, _MIN_REACH_PX)
    line = cv2.getGaussianKernel(2 * reach + 1, fwhm_px / FWHM_PER_SIGMA)
    return StarImage(pixels=(line @ line.T).astype(np.float32))


def median_star_image(pixels: PixelArray, sky: Background, stars: StarList) -> StarImage | None:
    """Return the median image of a frame's stars; None where too few of them stand alone.

    ``pixels``: (height, width), ADU.
    """
    half_trail = 0.0 if stars.trail is None else 0.5 * stars.trail.length_px
    size_px = stars.median_fwhm_px + half_trail
    reach = max(math.ceil(_REACH_FWHM * stars.median_fwhm_px + half_trail) + 1, _MIN_REACH_PX)
    shape = pixels.shape[0], pixels.shape[1]
    images, errors = [], []
    for i in _alone(stars, _ALONE_FWHM * size_px, reach + _ROOM_PX + 1, shape)[:_MOST].tolist():
        image = _centred(pixels, float(stars.x_px[i]), float(stars.y_px[i]), reach)
        light = float(image.sum())
        if light > 0.0:
            images.append(image / light)
            at = round(float(stars.x_px[i])), round(float(stars.y_px[i]))
            errors.append(sky.at(sky.noise, *at) / light)
    if len(images) < _FEWEST:
        return None
    stack = np.array(images, dtype=np.float64)
    middle = np.median(stack, axis=0)
    middle /= max(float(middle.sum()), _SMALLEST)
    misfit = _misfit(stack, middle, np.array(errors))
    return StarImage(pixels=middle.astype(np.float32), misfit=misfit)


def _centred(pixels: PixelArray, x_px: float, y_px: float, reach: int) -> Float32Array:
    """Pixels about a star above its rim's median, moved by the fraction of a pixel it is off."""
    import cv2

    side = 2 * reach + 1
    left, top = round(x_px) - reach - _ROOM_PX, round(y_px) - reach - _ROOM_PX
    box = pixels[top : top + side + 2 * _ROOM_PX, left : left + side + 2 * _ROOM_PX]
    shift = np.array([[1.0, 0.0, reach - (x_px - left)], [0.0, 1.0, reach - (y_px - top)]])
    image = cv2.warpAffine(box.astype(np.float32), shift, (side, side), flags=cv2.INTER_LANCZOS4)
    rim = np.concatenate([image[0], image[-1], image[1:-1, 0], image[1:-1, -1]])
    return np.asarray(image - np.median(rim), dtype=np.float32)


def _alone(stars: StarList, apart_px: float, rim_px: int, shape: tuple[int, int]) -> IndexArray:
    """Indices of bright stars without neighbours, brightest first."""
    x, y = stars.x_px, stars.y_px
    is_good = (stars.snr > _MIN_SNR) & ~stars.is_saturated
    is_good &= (x > rim_px) & (x < shape[1] - 1 - rim_px)
    is_good &= (y > rim_px) & (y < shape[0] - 1 - rim_px)
    away = np.hypot(x[:, None] - x, y[:, None] - y)
    np.fill_diagonal(away, np.inf)
    is_good &= away.min(axis=1, initial=np.inf) > apart_px
    return np.flatnonzero(is_good)


def _misfit(stack: FloatArray, middle: FloatArray, errors: FloatArray) -> float:
    """Scatter of the stars about the middle one where it is bright, without their noise."""
    peak = max(float(middle.max()), _SMALLEST)
    bright = middle > _BRIGHT_SHARE * peak
    scatter = np.sqrt(((stack[:, bright] - middle[bright]) ** 2).mean(axis=1))
    beyond = np.sqrt(np.maximum(scatter**2 - errors**2, 0.0)) / peak
    return float(np.clip(np.median(beyond), _MIN_MISFIT, _MAX_MISFIT))
