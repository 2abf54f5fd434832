"""Stars and hot pixels in a streak's strip: modelled where they can be, masked where not.

A star on a streak's tip or beside it is light with a place and a flux of its own. Taken for part
of the streak it would move the end; masked, it would hide it.
"""

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray
from rsoconsole.vision.streak_model import (
    BoolArray,
    IntArray,
    LineFit,
    Pixels,
    Points,
)
from rsoconsole.vision.streak_noise import variance_of

Axes = tuple[FloatArray, FloatArray]
"""u along and v across of every pixel of a cutout, (h, w) each."""

BRIGHTEST_MODELLED = 60.0
"""Peak over the sky's sigma up to which a star is a disc that we know well enough."""
_STAR_SIGMA = 4.0
_LONE_PIXEL_SIGMA = 5.5
_LONE_SHARE = 0.75
"""Of the light in 3 x 3 pixels; more in one pixel is no star."""
_MOST_AT_ONCE = 6
MOST_STARS = 14


def joined(one: Points, other: Points) -> Points:
    """Both lists."""
    return Points(
        u=np.concatenate([one.u, other.u]),
        v=np.concatenate([one.v, other.v]),
        flux=np.concatenate([one.flux, other.flux]),
    )


def within(points: Points, strip: tuple[float, float], half_width: float) -> Points:
    """Those near the strip from u = strip[0] to strip[1]."""
    near = (points.u > strip[0]) & (points.u < strip[1]) & (np.abs(points.v) < half_width)
    chosen = np.flatnonzero(near)
    chosen = chosen[np.argsort(-points.flux[chosen])][:MOST_STARS]
    return Points(u=points.u[chosen], v=points.v[chosen], flux=points.flux[chosen])


def unexplained(
    axes: Axes,
    pixels: Pixels,
    fit: LineFit,
    psf_sigma: float,
    least_sigma: float = 0.0,
) -> tuple[Points, IntArray]:
    """Stars that the fit leaves unexplained, brightest first, and pixels to be masked.

    least_sigma: how much a star must stand out at least, if more than usual.
    Masked is what no star explains, and a star too bright to be modelled.

    The pixels are places in the flattened cutout.
    """
    import cv2

    shape = axes[0].shape
    variance = variance_of(pixels.variance, fit.light, fit.glare, fit.noise)
    residual = pixels.value - fit.line.sky - fit.light - fit.glare
    deviation = np.zeros(shape, dtype=np.float32)
    deviation.ravel()[pixels.index] = residual / np.sqrt(variance)
    smooth = cv2.GaussianBlur(deviation, (0, 0), psf_sigma, borderType=cv2.BORDER_CONSTANT)
    smooth *= 2.0 * np.sqrt(np.pi) * psf_sigma
    is_peak = (smooth > max(_STAR_SIGMA, least_sigma)) & (
        smooth >= cv2.dilate(smooth, np.ones((3, 3)))
    )
    lone = _lone_pixels(deviation)
    rows, columns = np.nonzero(is_peak & ~cv2.dilate(lone.astype(np.uint8), np.ones((3, 3))) > 0)
    order = np.argsort(-smooth[rows, columns])[:_MOST_AT_ONCE]
    rows, columns = rows[order], columns[order]
    sigma = np.zeros(shape, dtype=np.float32)
    sigma.ravel()[pixels.index] = np.sqrt(variance)
    # Of a star, the smoothed peak is half the peak, times the gain.
    peak = smooth[rows, columns] * sigma[rows, columns] / (np.sqrt(np.pi) * psf_sigma)
    is_too_bright = peak > BRIGHTEST_MODELLED * pixels.noise
    masked = cv2.dilate(lone.astype(np.uint8), np.ones((3, 3), dtype=np.uint8))
    for row, column, height in zip(
        rows[is_too_bright], columns[is_too_bright], peak[is_too_bright], strict=True
    ):
        radius = 1.5 * psf_sigma * np.sqrt(2.0 * np.log(2.0 * height / pixels.noise))
        cv2.circle(masked, (int(column), int(row)), int(np.ceil(radius)), 1, -1)
    rows, columns = rows[~is_too_bright], columns[~is_too_bright]
    found = Points(
        u=axes[0][rows, columns],
        v=axes[1][rows, columns],
        flux=peak[~is_too_bright] * (2.0 * np.pi * psf_sigma**2),
    )
    return found, np.flatnonzero(masked)


def _lone_pixels(deviation: npt.NDArray[np.float32]) -> BoolArray:
    """Pixels far too bright for what surrounds them: hot ones and cosmic rays; (h, w)."""
    import cv2

    nine = cv2.boxFilter(np.maximum(deviation, 0.0), -1, (3, 3), normalize=False)
    return np.asarray((deviation > _LONE_PIXEL_SIGMA) & (deviation > _LONE_SHARE * nine))
