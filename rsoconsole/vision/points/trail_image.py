"""Image of a point in a frame of trailed stars, from the cross-section of their trails.

The cross-section of a line of light tells the widths and shares of the Gaussians of a round image.
"""

import numpy as np

from rsoconsole.vision.photometry.star_image import WIDTHS, StarImage
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA
from rsoconsole.vision.stars.trail_section import TrailSection


def image_of_section(section: TrailSection) -> StarImage | None:
    """Fit the image of a point, not drawn out, to a cross-section; None where it fits none."""
    from scipy.optimize import nnls

    sigmas = WIDTHS * (section.fwhm_px / FWHM_PER_SIGMA)
    unit = StarImage(shares=np.ones(1), sigmas_px=np.ones(1))
    columns = np.stack([unit.across(section.distance_px, float(s)) for s in sigmas])
    shares, _ = nnls(columns.T, section.light)
    is_lit = shares > 0.0
    if not is_lit.any():
        return None
    return StarImage(shares=shares[is_lit] / shares.sum(), sigmas_px=sigmas[is_lit])
