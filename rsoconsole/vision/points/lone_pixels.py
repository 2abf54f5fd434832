"""Single bright pixels, which stay in place as a geostationary satellite does, and are no light.

A hot pixel or a cosmic ray is sharper than any image of a point: its neighbours are dark.
"""

import numpy as np

from rsoconsole.vision.arrays import Float32Array
from rsoconsole.vision.photometry.star_image import StarImage

MIN_SIGMA = 6.0
"""Least height of a lone pixel, sigma of the noise of a pixel: fainter ones pass for no point."""
_DARK_SHARE = 0.5
"""Largest light of a lone pixel's neighbours, by that of the neighbours of a star's brightest."""
_MIN_NEIGHBOUR_SHARE = 0.25
"""Least light of the neighbours of a star's brightest pixel for which shape tells them apart."""


def neighbour_share(image: StarImage) -> float:
    """Return the mean light of the eight neighbours of a centred star's pixel, by that pixel's."""
    dy, dx = np.mgrid[-1:2, -1:2].astype(np.float64)
    light = image.at(dx, dy)
    return float((light.sum() - light[1, 1]) / 8.0 / light[1, 1])


def is_shape_known(image: StarImage) -> bool:
    """Return whether a point's image is wide enough to be told from a single pixel."""
    return neighbour_share(image) >= _MIN_NEIGHBOUR_SHARE


def repair_lone_pixels(light: Float32Array, image: StarImage) -> int:
    """Replace lone pixels by the median of their neighbours, in place; return their number.

    ``light``: (height, width) above the sky, in sigma of the noise. Nothing is done where shape
    does not tell them from stars.
    """
    if not is_shape_known(image):
        return 0
    height, width = light.shape
    y, x = np.divmod(np.flatnonzero(light.ravel() > MIN_SIGMA), width)
    inside = (x > 0) & (x < width - 1) & (y > 0) & (y < height - 1)
    y, x = y[inside], x[inside]
    around = [light[y + j, x + i] for j in (-1, 0, 1) for i in (-1, 0, 1) if i or j]
    mean = np.sum(around, axis=0) / np.float32(8.0)
    # Beside a star all neighbours together are as bright as its own would be.
    is_lone = mean < _DARK_SHARE * neighbour_share(image) * light[y, x]
    # The median: another bad one may be among them.
    light[y[is_lone], x[is_lone]] = np.median(np.array(around)[:, is_lone], axis=0)
    return int(np.count_nonzero(is_lone))
