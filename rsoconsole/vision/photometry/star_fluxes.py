"""Light of stars at known places, neighbours measured together with them."""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.arrays import BoolArray
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.photometry.star_image import StarImage
from rsoconsole.vision.stars.psf_field import PsfField

_STAMP_FWHM, _MIN_STAMP_PX = 2.0, 3
_SATURATED = 0.95


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StarFluxes:
    """Light of stars, in the order of their places; arrays (n,)."""

    flux_adu: FloatArray
    """Above the sky, ADU; NaN where the stamp reaches beyond the frame."""
    sigma_adu: FloatArray
    """One sigma by the noise of the sky."""
    is_saturated: BoolArray


def star_fluxes(
    pixels: PixelArray,
    sky: Background,
    image: StarImage,
    places_px: FloatArray,
    *,
    saturation_adu: float,
    psf_field: PsfField | None = None,
    fwhm_px: float,
) -> StarFluxes:
    """Measure the light of stars at ``places_px`` (n, 2), one image for all, neighbours included.

    Each star is weighed by its own image less the image's mean over its stamp, which leaves an even
    sky out; what neighbours add to that sum is solved for all stars together. Those that matter as
    neighbours must be among the places. ``fwhm_px``: median width that belongs to ``psf_field``.
    """
    count = len(places_px)
    half = max(math.ceil(_STAMP_FWHM * fwhm_px), _MIN_STAMP_PX) + math.ceil(0.5 * image.trail_px)
    scales = np.ones(count)
    if psf_field is not None:
        scales = psf_field.all_at(places_px[:, 0], places_px[:, 1]) / fwhm_px
    right, sigma = np.full(count, np.nan), np.full(count, np.nan)
    mixing = np.eye(count)
    is_saturated = np.zeros(count, bool)
    height, width = pixels.shape
    offset = np.arange(-half, half + 1)
    for n, (x, y) in enumerate(places_px):
        column, row = round(float(x)), round(float(y))
        if not (half <= column < width - half and half <= row < height - half):
            continue
        box = pixels[row - half : row + half + 1, column - half : column + half + 1]
        light = box.astype(np.float64)
        xs, ys = offset[None, :] + column, offset[:, None] + row
        own = image.at(xs - x, ys - y, scales[n])
        weight = own - own.mean()
        norm = float((weight * own).sum())
        right[n] = float((weight * light).sum()) / norm
        sigma[n] = sky.at(sky.noise, x, y) * math.sqrt(float((weight**2).sum())) / norm
        core = box[half - 2 : half + 3, half - 2 : half + 3]
        is_saturated[n] = float(core.max()) > _SATURATED * saturation_adu
        near = np.flatnonzero(
            np.abs(places_px - places_px[n]).max(axis=1) < 2.2 * half + image.trail_px
        )
        for m in near[near != n]:
            other = image.at(xs - places_px[m, 0], ys - places_px[m, 1], scales[m])
            mixing[n, m] = float((weight * other).sum()) / norm
    is_known = np.isfinite(right)
    flux = np.full(count, np.nan)
    if is_known.any():
        among = mixing[np.ix_(is_known, is_known)]
        flux[is_known] = np.linalg.lstsq(among, right[is_known], rcond=1e-6)[0]
    return StarFluxes(flux_adu=flux, sigma_adu=sigma, is_saturated=is_saturated)
