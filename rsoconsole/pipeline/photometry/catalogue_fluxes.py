"""Catalogue stars of a solved frame, measured: what its zero point is fitted to."""

import logging
import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.base import RsoconsoleError
from rsoconsole.pipeline.comparison.fixed_light import catalogue_stars
from rsoconsole.pipeline.comparison.look_back import SolvedField, star_positions_px
from rsoconsole.pipeline.photometry.zero_point import (
    MAX_STARS,
    MIN_STARS,
    ZeroPoint,
    ZeroPointStars,
    fit_zero_point,
)
from rsoconsole.records import FloatArray
from rsoconsole.sky import Stars
from rsoconsole.vision import Background, StarImage, match_stars, star_fluxes

log = logging.getLogger(__name__)

MAG_PER_LN = 2.5 / math.log(10.0)
_MAX_CATALOGUE = 1200
_BRIGHTEST = 250
_MAX_UNLISTED = 3 * MAX_STARS
_NEIGHBOURS_FWHM = 6.0
_MIN_SNR = 5.0
_UNKNOWN_SIGMA_MAG = 0.1
"""One sigma of a catalogue magnitude whose error is not known."""
_UNLISTED_REACH_FWHM = 1.5
"""Distance within which a listed star is the same as one of the catalogue."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CatalogueFluxes:
    """Measured catalogue stars of a frame; arrays over them (n,)."""

    known_px: FloatArray
    """Pixels (m, 2) of all stars of the catalogue in the frame."""
    stars: ZeroPointStars
    vt_mag: FloatArray
    flux_sigma_adu: float
    """Median sigma of a star's light by the noise of the sky."""
    width_scatter: float
    """One sigma of widths from star to star, as a share: that of a point's light by its width."""

    def zero_point(self, size_px: tuple[int, int]) -> ZeroPoint | None:
        """Fit the zero point of the frame of ``size_px`` (width, height); None with few stars."""
        return fit_zero_point(self.stars, size_px)


def catalogue_fluxes(
    field: SolvedField, background: Background, image: StarImage
) -> CatalogueFluxes | None:
    """Measure catalogue stars in a frame by ``image``, with the width of each bright one fitted.

    Listed stars come first; where nearly all of those are saturated, as in a dense field, stars
    are measured that are not listed, at their catalogue places. None where the field is too wide,
    the catalogue unreadable or no star measurable.
    """
    frame = field.frame
    if not frame.exposure_s or not len(field.stars):
        return None
    try:
        known = catalogue_stars(frame, field.solution, _MAX_CATALOGUE)
    except RsoconsoleError as error:
        log.warning("frame %d: no zero point: %s", frame.frame_id, error)
        return None
    if known is None:
        return None
    found = None
    for stars_of in (_listed, _unlisted):
        places_px, numbers = stars_of(field, known)
        if len(numbers):
            found = _measured(field, background, image, known, places_px, numbers) or found
        if found is not None and len(found.vt_mag) >= MIN_STARS:
            break
    return found


def _listed(field: SolvedField, known: tuple[FloatArray, Stars]) -> tuple[FloatArray, np.ndarray]:
    """Places of the brightest unsaturated listed stars, and their numbers in the catalogue."""
    stars = field.stars
    usable = np.flatnonzero(~stars.is_saturated & (stars.flux > 0.0))[:_BRIGHTEST]
    mine_px = star_positions_px(stars)[usable]
    mine, theirs = match_stars(mine_px, known[0], max(stars.median_fwhm_px, 2.0))
    order = np.argsort(known[1].magnitude[theirs], kind="stable")[:MAX_STARS]
    return mine_px[mine[order]], theirs[order]


def _unlisted(field: SolvedField, known: tuple[FloatArray, Stars]) -> tuple[FloatArray, np.ndarray]:
    """Catalogue places in the frame without a listed star, and their numbers, brightest first."""
    known_px, listed_px = known[0], star_positions_px(field.stars)
    size_px = np.array([field.frame.width_px, field.frame.height_px])
    is_inside = ((known_px > 0.0) & (known_px < size_px - 1.0)).all(axis=1)
    reach_px = _UNLISTED_REACH_FWHM * field.stars.median_fwhm_px
    apart_px = np.hypot(*(known_px[:, None] - listed_px[None]).transpose(2, 0, 1)).min(axis=1)
    numbers = np.flatnonzero(is_inside & (apart_px > reach_px))[:_MAX_UNLISTED]
    return known_px[numbers], numbers


def _measured(  # noqa: PLR0917 - the frame, how it is measured, and which stars
    field: SolvedField,
    background: Background,
    image: StarImage,
    known: tuple[FloatArray, Stars],
    places_px: FloatArray,
    numbers: np.ndarray,
) -> CatalogueFluxes | None:
    """Measure stars at places with these numbers in the catalogue; None where none is good."""
    frame, count = field.frame, len(numbers)
    found = star_fluxes(
        frame.pixels,
        background,
        image,
        _with_neighbours(field, image, places_px),
        saturation_adu=frame.saturation_adu,
        psf_field=field.stars.psf_field,
        fwhm_px=field.stars.median_fwhm_px,
        fits_shapes=True,
    )
    flux, sigma = found.flux_adu[:count], found.sigma_adu[:count]
    with np.errstate(invalid="ignore"):
        good = np.flatnonzero((flux > _MIN_SNR * sigma) & ~found.is_saturated[:count])[:MAX_STARS]
    if not len(good):
        return None
    stars, chosen = known[1], numbers[good]
    flux, by_noise = flux[good], MAG_PER_LN * sigma[good] / flux[good]
    by_shape = MAG_PER_LN * found.shape_error[:count][good]
    by_catalogue = np.nan_to_num(stars.sigma_mag[chosen], nan=_UNKNOWN_SIGMA_MAG)
    return CatalogueFluxes(
        known_px=known[0],
        stars=ZeroPointStars(
            places_px=places_px[good],
            zero_mag=stars.magnitude[chosen] + 2.5 * np.log10(flux / (frame.exposure_s or 1.0)),
            sigma_mag=np.sqrt(by_noise**2 + by_shape**2 + by_catalogue**2),
            colour_mag=stars.colour_mag[chosen],
        ),
        vt_mag=stars.magnitude[chosen],
        flux_sigma_adu=float(np.nanmedian(sigma)),
        width_scatter=found.width_scatter,
    )


def _with_neighbours(field: SolvedField, image: StarImage, places_px: FloatArray) -> FloatArray:
    """Places of stars, followed by those of all listed ones that are near them."""
    everything = star_positions_px(field.stars)
    reach = _NEIGHBOURS_FWHM * field.stars.median_fwhm_px + image.trail_px
    apart = np.abs(everything[:, None] - places_px[None]).max(axis=2)
    others = everything[(apart < reach).any(axis=1) & (apart > 1e-6).all(axis=1)]
    return np.concatenate([places_px, others])
