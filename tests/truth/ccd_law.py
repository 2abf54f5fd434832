"""How INDI's CCD simulator draws, as numbers: light, seeing disc, noise and where a star falls.

Read off drivers/ccd/ccd_simulator.cpp of INDI 1.9.9, Debian 12's. What matters to a measurement:

- The whole frame is drawn when the shutter opens, from one call of ``gsc``; nothing is smeared.
- Directions are J2000 and are read as single precision (0.1 arcsec at worst); the mount's place of
  date becomes J2000 by libnova, aberration and nutation counted.
- A star falls on a whole pixel: its centre loses its fraction, and so does each pixel's light.
- The seeing disc is a Gaussian whose peak, not whose sum, is held to 1 / (sigma sqrt(2 pi)).
- Brightness is no magnitude: saturation and limit set the slope, 0.75 of Pogson's by default.
- Noise is a whole number from 0 to SIM_NOISE - 1, each as likely; light has none of its own.
- A field with a half diagonal beyond 1 degree is asked for to magnitude 11, any other to the
  limit.
"""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray

ARCSEC_RAD = 206.3
"""What the simulator takes for the arcseconds of a milliradian, in the disc's size alone."""
FWHM_PER_SIGMA = 2.0 * math.sqrt(2.0 * math.log(2.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class CcdLaw:
    """One setting of the simulator; all but the sensor's size and the optics as it comes."""

    width_px: int = 4656
    height_px: int = 3520
    pixel_um: float = 3.8
    focal_length_mm: float = 650.0
    """A little longer than the paper's, whose field would be asked for to magnitude 11 only."""
    rotation_deg: float = 0.0
    seeing_arcsec: float = 3.5
    max_adu: float = 65000.0
    saturation_mag: float = 1.0
    limiting_mag: float = 17.0
    noise_adu: int = 10
    gain: float = 90.0

    @property
    def scale_arcsec_px(self) -> float:
        """Of the disc; the projection has the exact one."""
        return ARCSEC_RAD * self.pixel_um / self.focal_length_mm

    @property
    def fwhm_px(self) -> float:
        """Of the seeing disc."""
        return self.seeing_arcsec / self.scale_arcsec_px

    @property
    def radius_arcmin(self) -> float:
        """What ``gsc`` is asked for: half the diagonal."""
        return self.scale_arcsec_px * math.hypot(self.width_px, self.height_px) / 120.0

    @property
    def slope(self) -> float:
        """Brightness per magnitude in units of Pogson's law."""
        return 2.5 * math.log10(self.max_adu) / (self.limiting_mag - self.saturation_mag)

    @property
    def noise_sigma_adu(self) -> float:
        """Of the even distribution over whole numbers."""
        return math.sqrt((self.noise_adu**2 - 1) / 12.0)

    def flux_adu(self, magnitude: float, exposure_s: float) -> float:
        """What the simulator multiplies its disc with."""
        per_second = 10.0 ** ((self.limiting_mag - magnitude) * self.slope / 2.5)
        return float(per_second * exposure_s * (1.0 + math.sqrt(self.gain)))

    def point_magnitude(self, magnitude: float, points: int) -> float:
        """Of each of so many points that shine as brightly together."""
        return magnitude + 2.5 * math.log10(points) / self.slope

    def disc_adu(self, flux_adu: float) -> FloatArray:
        """One star as the simulator adds it to the frame, whole numbers (side, side)."""
        reach = int(3.0 * self.fwhm_px) + 1
        sigma = self.seeing_arcsec / FWHM_PER_SIGMA
        offset = np.arange(-reach, reach + 1) * self.scale_arcsec_px
        distance2 = offset[:, None] ** 2 + offset[None, :] ** 2
        peak = flux_adu / (sigma * math.sqrt(2.0 * math.pi))
        return np.asarray(np.floor(peak * np.exp(-distance2 / (2.0 * sigma**2))))

    def pixel(
        self,
        ra_deg: FloatArray,
        dec_deg: FloatArray,
        centre_deg: tuple[float, float],
        is_pier_east: bool = False,
    ) -> tuple[FloatArray, FloatArray]:
        """Where directions fall; the simulator then drops the fraction."""
        turn = math.radians(270.0 + self.rotation_deg - (180.0 if is_pier_east else 0.0))
        px_rad = self.focal_length_mm / self.pixel_um * 1000.0
        east, north = tangent(ra_deg, dec_deg, centre_deg)
        x = math.cos(turn) * east - math.sin(turn) * north
        y = -math.sin(turn) * east - math.cos(turn) * north
        return self.width_px // 2 - px_rad * x, self.height_px // 2 + px_rad * y

    def on_sensor(self, x_px: FloatArray, y_px: FloatArray) -> FloatArray:
        """Whether the simulator draws a point there."""
        is_inside = (x_px >= 0) & (x_px < self.width_px) & (y_px >= 0) & (y_px < self.height_px)
        return np.asarray(is_inside)

    def drawn_adu(self, x_px: FloatArray, y_px: FloatArray, flux_adu: float) -> FloatArray:
        """Points of equal light on an empty patch that holds them all, without noise."""
        disc = self.disc_adu(flux_adu)
        side = disc.shape[0]
        columns = np.floor(x_px).astype(int) - int(np.floor(x_px.min()))
        rows = np.floor(y_px).astype(int) - int(np.floor(y_px.min()))
        patch = np.zeros((int(rows.max()) + side, int(columns.max()) + side))
        for row, column in zip(rows, columns, strict=True):
            patch[row : row + side, column : column + side] += disc
        return patch

    def snr_integrated(self, patch_adu: FloatArray) -> float:
        """Matched: every pixel weighted by what is drawn there, over the noise of the sum."""
        return float(np.sqrt(np.sum(patch_adu**2)) / self.noise_sigma_adu)


def tangent(
    ra_deg: FloatArray, dec_deg: FloatArray, centre_deg: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """(east, north) on the tangent plane, radians."""
    ra0, dec0 = (math.radians(each) for each in centre_deg)
    ra, dec = np.radians(ra_deg), np.radians(dec_deg)
    depth = math.cos(dec0) * np.cos(dec) * np.cos(ra - ra0) + math.sin(dec0) * np.sin(dec)
    east = np.cos(dec) * np.sin(ra - ra0) / depth
    north = (math.cos(dec0) * np.sin(dec) - math.sin(dec0) * np.cos(dec) * np.cos(ra - ra0)) / depth
    return east, north
