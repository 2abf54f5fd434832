"""Where this telescope's pixels really look: the tangent plane, stretched, turned and shifted."""

from dataclasses import replace

import numpy as np

from rsoconsole.records import FloatArray, Wcs
from rsoconsole.sky import pixel_to_sky, sky_to_pixel


def distorted(wcs: Wcs, share: float) -> Wcs:
    """The same plate with its corners drawn out by this share of the radius; 0: itself.

    Radial, growing with the radius cubed, as third-order SIP has it: a solver that fits SIP can
    find it exactly.
    """
    if share == 0.0:
        return wcs
    reach2 = wcs.crpix_x_px**2 + wcs.crpix_y_px**2
    inwards = -share / (1.0 + share) / max(reach2, 1.0)
    return replace(
        wcs,
        sip_a=((3, 0, inwards), (1, 2, inwards)),
        sip_b=((0, 3, inwards), (2, 1, inwards)),
    )


def shifted(wcs: Wcs, image_shift_px: FloatArray) -> Wcs:
    """The plate after the whole image has moved by (dx, dy): the telescope looks elsewhere."""
    ra, dec = pixel_to_sky(
        wcs, wcs.crpix_x_px - image_shift_px[0], wcs.crpix_y_px - image_shift_px[1]
    )
    return replace(wcs, crval_ra_deg=float(ra), crval_dec_deg=float(dec))


def image_shift_px(wcs: Wcs, east_arcsec: FloatArray, north_arcsec: FloatArray) -> FloatArray:
    """(2, n) how the image moves, dx and dy, when the boresight moves east and north."""
    ra, dec = wcs.crval_ra_deg, wcs.crval_dec_deg
    north_deg = np.asarray(north_arcsec) / 3600.0
    east_deg = np.asarray(east_arcsec) / 3600.0 / np.cos(np.radians(dec))
    x, y = sky_to_pixel(wcs, ra + east_deg, dec + north_deg)
    return np.stack([wcs.crpix_x_px - x, wcs.crpix_y_px - y])


def east_px(wcs: Wcs) -> FloatArray:
    """(2,) the direction of east in the middle of the frame, of length 1."""
    moved = image_shift_px(wcs, np.array([30.0]), np.array([0.0]))[:, 0]
    return np.asarray(-moved / np.hypot(*moved), dtype=np.float64)
