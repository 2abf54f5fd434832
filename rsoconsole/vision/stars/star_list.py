"""List of the stars of one frame, with their width: the result of the searches for stars."""

from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.vision.arrays import BoolArray, IndexArray
from rsoconsole.vision.stars.psf_field import PsfField, WidthSource
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OblongLights:
    """Lights of one frame that are longer than wide, the surest first; arrays (n,)."""

    x_px: FloatArray
    y_px: FloatArray
    angle_deg: FloatArray
    """Direction, x towards y, 0 to 180 deg."""
    half_px: FloatArray
    """Half the length, roughly, px; too small for lights longer than a few star widths."""
    snr: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class StarTrail:
    """Trail of every star of a frame, drawn out by drift."""

    length_px: float
    """Length from end to end, px, without the disc's own width."""
    angle_deg: float
    """Direction, x towards y, 0 to 180 deg."""
    fwhm_px: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StarList:
    """Point sources of one frame, brightest first; every array has one entry for each star."""

    x_px: FloatArray
    """Column of the centroid; 0 is the centre of the left pixel."""
    y_px: FloatArray
    flux: FloatArray
    """Light above the sky, ADU; too small for a saturated star."""
    fwhm_px: FloatArray
    snr: FloatArray
    is_saturated: BoolArray
    median_fwhm_px: float
    """Median width of unsaturated stars, px (fewer than five: ``width_source``); trails: across."""
    trail: StarTrail | None = None
    """Trail of every star; None where they are points."""
    psf_field: PsfField | None = None
    """Width over the frame; None where it is the median everywhere."""
    width_source: WidthSource = "measured"
    """Source of the width; "guessed" stands for 2.5 px."""
    oblong: OblongLights | None = None
    """Lights longer than wide, listed as stars or not; None where they were not searched for."""

    def fwhm_at(self, x_px: float, y_px: float) -> float:
        """Expected width of a star at a place of the frame, px."""
        return self.median_fwhm_px if self.psf_field is None else self.psf_field.at(x_px, y_px)

    def expected_fwhm_px(self) -> FloatArray | float:
        """Width that each star should have, px, (n,); a float where it is the same everywhere."""
        if self.psf_field is None:
            return self.median_fwhm_px
        return self.psf_field.all_at(self.x_px, self.y_px)

    def chosen(self, index: IndexArray) -> "StarList":
        """Return the list of the stars with these indices, in this order."""
        return replace(
            self,
            x_px=self.x_px[index],
            y_px=self.y_px[index],
            flux=self.flux[index],
            fwhm_px=self.fwhm_px[index],
            snr=self.snr[index],
            is_saturated=self.is_saturated[index],
        )

    def __len__(self) -> int:
        """Number of stars."""
        return int(self.x_px.size)


def lit_radius_px(stars: StarList, noise_adu: float) -> FloatArray:
    """Return the radius, px, (n,), to which each star adds half a sigma or more to a pixel.

    ``noise_adu``: one sigma of a pixel. For trails, the distance across. At most 40 px.
    """
    sigma = np.maximum(stars.fwhm_px, stars.expected_fwhm_px()) / FWHM_PER_SIGMA
    area = 2.0 * np.pi * sigma**2
    if stars.trail is not None:
        area += np.sqrt(2.0 * np.pi) * sigma * stars.trail.length_px
    peak = stars.flux / area / max(noise_adu, 1e-9)
    radius = sigma * np.sqrt(2.0 * np.log(np.maximum(2.0 * peak, 2.0)))
    # A saturated one is brighter than its flux says.
    return np.asarray(np.minimum(radius * np.where(stars.is_saturated, 2.0, 1.15), 40.0))
