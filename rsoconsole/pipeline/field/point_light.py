"""Brightness of points in a frame, and of the points of a mover.

A point is weighed by the image of a star; what a point that moves during the exposure loses by that
is known once its motion is, and made good then.
"""

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.pipeline.comparison.look_back import SolvedField
from rsoconsole.pipeline.photometry.catalogue_fluxes import MAG_PER_LN, catalogue_fluxes
from rsoconsole.pipeline.photometry.zero_point import ZeroPoint
from rsoconsole.records import Band, FloatArray
from rsoconsole.vision import (
    Background,
    PsfField,
    StarImage,
    drawn_out_share,
    fit_star_image,
    star_fluxes,
)

log = logging.getLogger(__name__)

_MIN_SNR = 1.0
"""SNR of a point's light from which it has a magnitude."""
_MIN_SHARE = 0.1
"""Least share of its light by which a moving point is measured as one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PointMagnitude:
    """Light and magnitude of a point."""

    flux_adu: float
    flux_sigma_adu: float
    """One sigma by the noise of the sky, and by how widths differ from star to star."""
    is_saturated: bool
    band: Band
    mag: float | None
    """None where its light is lost in the noise."""
    mag_sigma: float | None
    """One sigma by noise and zero point."""
    zero_sigma_mag: float
    """That of the zero point and a star's scatter, which frames of one field have in common."""
    mag_sigma_colour: float | None
    """One sigma by the object's unknown colour; None without a zero point."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointLight:
    """Light of a frame's points, each taken to stand still; arrays (n,), and its zero point."""

    flux_adu: FloatArray
    sigma_adu: FloatArray
    is_saturated: np.ndarray
    exposure_s: float
    zero: ZeroPoint | None
    width_scatter: float
    image: StarImage
    fwhm_px: float
    psf_field: PsfField | None

    def magnitude(
        self, n: int, place_px: tuple[float, float], way_px: tuple[float, float]
    ) -> PointMagnitude | None:
        """Magnitude of point ``n`` that moved by ``way_px`` (dx, dy) during the exposure.

        None where it cannot be measured: at the frame's rim, or where it is a streak.
        """
        scale = 1.0 if self.psf_field is None else self.psf_field.at(*place_px) / self.fwhm_px
        share = drawn_out_share(self.image, self.fwhm_px, scale, way_px)
        if not math.isfinite(self.flux_adu[n]) or share < _MIN_SHARE:
            return None
        flux = float(self.flux_adu[n]) / share
        sigma = math.hypot(float(self.sigma_adu[n]) / share, self.width_scatter * flux)
        level, level_sigma, by_colour = 0.0, 0.0, None
        if self.zero is not None:
            level, level_sigma = self.zero.along(np.array([place_px]))
            level_sigma = math.hypot(level_sigma, self.zero.star_scatter_mag)
            by_colour = self.zero.colour_sigma_mag
        is_lit = flux > _MIN_SNR * sigma
        return PointMagnitude(
            flux_adu=flux,
            flux_sigma_adu=sigma,
            is_saturated=bool(self.is_saturated[n]),
            band="instrumental" if self.zero is None else "V",
            mag=level - 2.5 * math.log10(flux / self.exposure_s) if is_lit else None,
            mag_sigma=math.hypot(MAG_PER_LN * sigma / flux, level_sigma) if is_lit else None,
            zero_sigma_mag=level_sigma,
            mag_sigma_colour=by_colour if is_lit else None,
        )


def point_light(
    field: SolvedField, background: Background, places_px: FloatArray
) -> PointLight | None:
    """Measure the light of points at ``places_px`` (n, 2) and the zero point; it raises nothing.

    ``field``: with calibrated pixels. None where the frame has no exposure time or no points.
    """
    frame, stars = field.frame, field.stars
    if not frame.exposure_s or not len(places_px) or not len(stars):
        return None
    try:
        image = fit_star_image(frame.pixels, background, stars, frame.saturation_adu)
        known = catalogue_fluxes(field, background, image)
        size_px = frame.width_px, frame.height_px
        zero = None if known is None else known.zero_point(size_px)
        found = star_fluxes(
            frame.pixels,
            background,
            image,
            places_px,
            saturation_adu=frame.saturation_adu,
            psf_field=stars.psf_field,
            fwhm_px=stars.median_fwhm_px,
        )
    except Exception:
        # Brightness must not cost the frame.
        log.exception("%s: the brightness of its points is not measured", frame.name)
        return None
    return PointLight(
        flux_adu=found.flux_adu,
        sigma_adu=found.sigma_adu,
        is_saturated=found.is_saturated,
        exposure_s=frame.exposure_s,
        zero=zero,
        width_scatter=0.0 if known is None else known.width_scatter,
        image=image,
        fwhm_px=stars.median_fwhm_px,
        psf_field=stars.psf_field,
    )


def mean_magnitude(points: Sequence[PointMagnitude | None]) -> PointMagnitude | None:
    """Mean of an object's magnitudes, weighed by their noise; of those in V where there are any.

    Its ``mag_sigma`` has the noise of the mean and the zero point of one frame: frames of one field
    share their stars and what is wrong with them. None where no point has a magnitude.
    """
    lit = [each for each in points if each is not None and each.mag is not None]
    lit = [each for each in lit if each.band == "V"] or lit
    if not lit:
        return None
    mag = np.array([each.mag for each in lit], dtype=np.float64)
    noise = np.array([MAG_PER_LN * each.flux_sigma_adu / each.flux_adu for each in lit])
    share = 1.0 / np.maximum(noise, 1e-4) ** 2
    share /= share.sum()
    zero_sigma = float(np.mean([each.zero_sigma_mag for each in lit]))
    colour = [each.mag_sigma_colour for each in lit if each.mag_sigma_colour is not None]
    return replace(
        lit[0],
        flux_adu=float(np.mean([each.flux_adu for each in lit])),
        is_saturated=any(each.is_saturated for each in lit),
        mag=float(share @ mag),
        mag_sigma=math.hypot(float(np.sqrt(((share * noise) ** 2).sum())), zero_sigma),
        zero_sigma_mag=zero_sigma,
        mag_sigma_colour=float(np.mean(colour)) if colour else None,
    )
