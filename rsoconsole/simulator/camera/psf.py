"""Point sources on pixels: a seeing disc integrated over each pixel that it covers.

The disc is a sum of round Gaussians (a core, and the wings that every telescope has): each is
separable, so that the exact integral over a pixel is a product of two differences of erf.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.special import erf

from rsoconsole.records import FloatArray, Wcs
from rsoconsole.sky import pixel_to_sky, sky_to_pixel

Float32Array = npt.NDArray[np.float32]

FWHM_PER_SIGMA = 2.3548200450309493
WINGS = ((0.875, 1.0), (0.105, 2.2), (0.016, 6.0), (0.004, 20.0))
"""Share of light, and width in core sigmas, of Gaussians: close to a Moffat disc of beta 3.5."""

FAINTEST_E = 0.04
"""Electrons in a pixel below which the light of a point source is not drawn."""
_STAMP_VALUES = 2_000_000
_RADII = np.array([2, 3, 4, 5, 6, 8, 11, 15, 20, 28, 40, 56, 80, 120, 180])


def add_points(
    image_e: Float32Array,
    x_px: FloatArray,
    y_px: FloatArray,
    electrons: FloatArray,
    *,
    sigma_px: float,
    faintest_e: float = FAINTEST_E,
) -> None:
    """Add point sources spread by one round Gaussian, integrated over the pixels, in place.

    x, y, electrons: (n,). Each source is drawn out to the radius where a pixel would get less than
    ``faintest_e`` electrons, and at least to 2.6 sigma. Light outside the image is lost.
    """
    if len(x_px) == 0:
        return
    peak = np.maximum(electrons, 1e-9) / (2.0 * np.pi * sigma_px**2)
    reach = sigma_px * np.sqrt(2.0 * np.log(np.maximum(peak / faintest_e, 1.0)))
    radius = _RADII[
        np.minimum(np.searchsorted(_RADII, np.maximum(reach, 2.6 * sigma_px)), len(_RADII) - 1)
    ]
    height, width = image_e.shape
    seen = (x_px > -radius - 1) & (x_px < width + radius)
    seen &= (y_px > -radius - 1) & (y_px < height + radius)
    seen &= electrons > 0
    for r in np.unique(radius[seen]):
        of_size = np.flatnonzero(seen & (radius == r))
        step = max(1, _STAMP_VALUES // int(2 * r + 1) ** 2)
        for first in range(0, len(of_size), step):
            part = of_size[first : first + step]
            _add_stamps(
                image_e, x_px[part], y_px[part], electrons[part], sigma_px=sigma_px, radius=int(r)
            )


def _add_stamps(
    image_e: Float32Array,
    x_px: FloatArray,
    y_px: FloatArray,
    electrons: FloatArray,
    *,
    sigma_px: float,
    radius: int,
) -> None:
    height, width = image_e.shape
    column = np.floor(x_px + 0.5).astype(np.int64)
    row = np.floor(y_px + 0.5).astype(np.int64)
    share_x = _pixel_shares(x_px - column, sigma_px, radius)
    share_y = _pixel_shares(y_px - row, sigma_px, radius) * electrons[:, None].astype(np.float32)
    stamps = share_y[:, :, None] * share_x[:, None, :]
    offset = np.arange(-radius, radius + 1, dtype=np.int64)
    rows, columns = row[:, None] + offset, column[:, None] + offset
    flat = image_e.reshape(-1)
    index = rows[:, :, None] * width + columns[:, None, :]
    if (
        column.min() >= radius
        and row.min() >= radius
        and column.max() < width - radius
        and row.max() < height - radius
    ):
        np.add.at(flat, index.ravel(), stamps.ravel())
        return
    inside = ((rows >= 0) & (rows < height))[:, :, None]
    inside = inside & ((columns >= 0) & (columns < width))[:, None, :]
    np.add.at(flat, index[inside], stamps[inside])


def _pixel_shares(offset_px: FloatArray, sigma_px: float, radius: int) -> Float32Array:
    """Integral of a unit Gaussian at ``offset_px`` over the pixels -radius..radius: (n, 2r+1)."""
    edges = np.arange(-radius - 0.5, radius + 1.0, 1.0)
    at_edges = erf((edges[None, :] - offset_px[:, None]) / (np.sqrt(2.0) * sigma_px))
    return np.asarray(0.5 * np.diff(at_edges, axis=1), dtype=np.float32)


def add_sources(
    image_e: Float32Array,
    x_px: FloatArray,
    y_px: FloatArray,
    electrons: FloatArray,
    *,
    fwhm_px: float,
    faintest_e: float = FAINTEST_E,
) -> None:
    """Add point sources with all the Gaussians of the disc (``WINGS``), in place.

    x, y, electrons: (n,). The light of a wing too faint to be drawn goes into the core, so that the
    sum of electrons is kept.
    """
    x = np.asarray(x_px, dtype=np.float64)
    y = np.asarray(y_px, dtype=np.float64)
    core = np.asarray(electrons, dtype=np.float64).copy()
    total = core.copy()
    sigma = fwhm_px / FWHM_PER_SIGMA
    for share, widening in WINGS[1:]:
        sigma_wing = sigma * widening
        drawn = total * share / (2.0 * np.pi * sigma_wing**2) > faintest_e * 4.0
        core[drawn] -= total[drawn] * share
        light = total[drawn] * share
        add_points(image_e, x[drawn], y[drawn], light, sigma_px=sigma_wing, faintest_e=faintest_e)
    add_points(image_e, x, y, core, sigma_px=sigma, faintest_e=faintest_e)


def annulus(radius_px: float, obstruction: float = 0.45) -> Float32Array:
    """Image of a defocused point: a ring of unit sum, square, of side 2 ceil(radius_px) + 3.

    ``radius_px``: outer radius. ``obstruction``: radius of the dark middle as a fraction of it. The
    edges are smoothed over one pixel.
    """
    reach = int(np.ceil(radius_px)) + 1
    fine = (np.arange((2 * reach + 1) * 5) + 0.5) / 5 - reach - 0.5
    r = np.hypot(fine[:, None], fine[None, :])
    lit = ((r <= radius_px) & (r >= obstruction * radius_px)).astype(np.float64)
    side = 2 * reach + 1
    ring = lit.reshape(side, 5, side, 5).mean(axis=(1, 3))
    if ring.sum() == 0.0:
        ring[reach, reach] = 1.0
    return np.asarray(ring / ring.sum(), dtype=np.float32)


def image_motion_kernel(stands: FloatArray) -> Float32Array:
    """Return the convolution kernel of an image's motion: square, odd side, unit sum.

    ``stands``: (4, n) positions as in ``FieldContent.stands``; their rotation is ignored. A
    position between pixels is spread over 4 x 4 pixels by the cubic weights of Keys (1981, a =
    -1/2), which keep the mean and the width of the path.
    """
    dx, dy, _, share = stands
    reach = int(np.ceil(np.abs([dx, dy]).max())) + 2
    side = 2 * reach + 1
    kernel = np.zeros((side, side))
    column, row = np.floor(dx).astype(np.int64), np.floor(dy).astype(np.int64)
    for i in range(-1, 3):
        along_y = _keys(dy - row - i) * share
        for j in range(-1, 3):
            weight = along_y * _keys(dx - column - j)
            np.add.at(kernel, (row + i + reach, column + j + reach), weight)
    return np.asarray(kernel / share.sum(), dtype=np.float32)


def _keys(offset: FloatArray) -> FloatArray:
    """Cubic convolution weights of Keys with a = -1/2 at these offsets, (n,)."""
    at = np.abs(offset)
    near = (1.5 * at - 2.5) * at**2 + 1.0
    far = ((-0.5 * at + 2.5) * at - 4.0) * at + 2.0
    return np.where(at <= 1.0, near, np.where(at < 2.0, far, 0.0))


def with_radial_distortion(wcs: Wcs, share: float) -> Wcs:
    """Return the plate with a radial distortion proportional to the radius cubed.

    ``share``: outward displacement of a corner, as a fraction of its distance from the centre. The
    distortion is third-order SIP, so that a SIP fit can match it exactly.
    """
    if share == 0.0:
        return wcs
    reach2 = wcs.crpix_x_px**2 + wcs.crpix_y_px**2
    inwards = -share / (1.0 + share) / max(reach2, 1.0)
    return replace(
        wcs, sip_a=((3, 0, inwards), (1, 2, inwards)), sip_b=((0, 3, inwards), (2, 1, inwards))
    )


def with_shifted_image(wcs: Wcs, image_shift_px: FloatArray) -> Wcs:
    """The plate after the whole image has moved by (dx, dy) px: its central direction changes."""
    ra, dec = pixel_to_sky(
        wcs, wcs.crpix_x_px - image_shift_px[0], wcs.crpix_y_px - image_shift_px[1]
    )
    return replace(wcs, crval_ra_deg=float(ra), crval_dec_deg=float(dec))


def image_shift_px(wcs: Wcs, east_arcsec: FloatArray, north_arcsec: FloatArray) -> FloatArray:
    """Return the image's shift (dx, dy), (2, n) px, for a boresight that moves on the sky.

    ``east_arcsec``, ``north_arcsec``: (n,) motion of the boresight.
    """
    ra, dec = wcs.crval_ra_deg, wcs.crval_dec_deg
    north_deg = np.asarray(north_arcsec) / 3600.0
    east_deg = np.asarray(east_arcsec) / 3600.0 / np.cos(np.radians(dec))
    x, y = sky_to_pixel(wcs, ra + east_deg, dec + north_deg)
    return np.stack([wcs.crpix_x_px - x, wcs.crpix_y_px - y])


def east_unit_vector_px(wcs: Wcs) -> FloatArray:
    """Unit vector (dx, dy) that points east in the middle of the frame, (2,)."""
    moved = image_shift_px(wcs, np.array([30.0]), np.array([0.0]))[:, 0]
    return np.asarray(-moved / np.hypot(*moved), dtype=np.float64)
