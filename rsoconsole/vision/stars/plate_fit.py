"""Least-squares plate from matched stars: the last step of every solution, full or moved.

Pure: arrays in, a ``PlateFit`` out. Stars (N, 2) are pixels x, y and catalogue stars (M, 2) are RA,
Dec in ICRS degrees, both **brightest first**. The plate is linear in its coefficients on the
tangent plane about the image centre: 3 per axis for TAN, 6 or 10 with SIP of order 2 or 3. A higher
order is used only where it lowers the leave-one-out residual (PRESS), so that few stars never lead
to a false distortion. Sources: Greisen & Calabretta 2002 (TAN); Shupe et al. 2005 (SIP); Allen 1974
(PRESS).
"""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray, PlatePath, Solution, Wcs
from rsoconsole.sky import describe_field, pixel_to_sky, separation_deg, sky_to_pixel
from rsoconsole.vision.arrays import IndexArray
from rsoconsole.vision.frame.median import median_of
from rsoconsole.vision.stars.star_pairs import MIN_MATCHED, mutual_nearest, squared_distances

MAX_STARS = 400
_ROUNDS = 8
_TIGHT_TOLERANCE_PX = 1.5
_PRESS_GAIN = 0.9
"""Share of a lower order's leave-one-out residual below which a higher order must bring it."""
_STARS_PER_TERM = 3.0
_MAX_SIP_ORDER = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class PlateFit:
    """A plate fitted to matched stars."""

    wcs: Wcs
    matched: int
    rms_arcsec: float
    """Root mean square residual of one matched star, per axis."""
    catalogue_indices: IndexArray
    """Rows of the matched stars in the catalogue given."""


def refit(
    stars_xy_px: FloatArray,
    catalogue_deg: FloatArray,
    wcs_start: Wcs,
    *,
    width_px: int,
    height_px: int,
    tolerance_px: float | None = None,
) -> PlateFit | None:
    """Match stars to the catalogue one to one, from a starting plate, and fit the plate to them.

    Matches lie within a tolerance that starts at ``tolerance_px`` (default 0.8 % of the longer
    side, for a start without distortion) and shrinks with the residuals. None when too few stars
    match for the match to be more than chance.
    """
    stars = np.asarray(stars_xy_px, float)[:MAX_STARS, :2]
    shown = catalogue_stars_in_frame(
        wcs_start, catalogue_deg, 2 * len(stars) + 20, width_px=width_px, height_px=height_px
    )
    if len(stars) < MIN_MATCHED or len(shown) < MIN_MATCHED:
        return None
    catalogue = np.asarray(catalogue_deg, float)[shown]
    long_side = max(width_px, height_px)
    tolerance = max(3.0, 0.008 * long_side) if tolerance_px is None else tolerance_px
    wcs, pairs = wcs_start, (np.empty(0, np.intp), np.empty(0, np.intp))
    for round_number in range(_ROUNDS):
        x, y = sky_to_pixel(wcs, catalogue[:, 0], catalogue[:, 1])
        predicted = np.stack([x, y], axis=1)
        pairs = mutual_nearest(squared_distances(stars, predicted), tolerance**2)
        if len(pairs[0]) < MIN_MATCHED:
            return None
        # The first rounds only straighten the start: distortion is fitted to settled matches.
        order = 1 if round_number == 0 else _MAX_SIP_ORDER
        wcs, pairs, sigma_px = _robust_fit(
            stars, catalogue, pairs, wcs, width_px=width_px, height_px=height_px, max_order=order
        )
        smaller = float(np.clip(4.0 * sigma_px, _TIGHT_TOLERANCE_PX, 0.6 * tolerance))
        if smaller >= tolerance or tolerance <= _TIGHT_TOLERANCE_PX:
            break
        tolerance = max(smaller, _TIGHT_TOLERANCE_PX)
    expected_by_chance = len(stars) * len(shown) * math.pi * tolerance**2 / (width_px * height_px)
    if len(pairs[0]) < MIN_MATCHED + 2.0 * expected_by_chance:
        return None
    xy, radec = stars[pairs[0]], catalogue[pairs[1]]
    at = np.stack(pixel_to_sky(wcs, xy[:, 0], xy[:, 1]), axis=1)
    centre_deg = wcs.crval_ra_deg, wcs.crval_dec_deg
    residual = _to_plane(radec, *centre_deg) - _to_plane(at, *centre_deg)
    return PlateFit(
        wcs=wcs,
        matched=len(xy),
        rms_arcsec=3600.0 * float(np.sqrt(np.sum(residual**2) / (2 * len(xy)))),
        catalogue_indices=shown[pairs[1]],
    )


def solution_from(
    fit: PlateFit, *, frame_id: int, width_px: int, height_px: int, path: PlatePath, ms: float
) -> Solution:
    """Return the record of a fitted plate, evaluated at the image centre.

    ``path`` and ``ms``: how it was solved, and the time that took.
    """
    field = describe_field(fit.wcs, width_px, height_px)
    return Solution(
        frame_id=frame_id,
        wcs=fit.wcs,
        ra_icrs_deg=field.ra_icrs_deg,
        dec_icrs_deg=field.dec_icrs_deg,
        scale_arcsec_px=field.scale_arcsec_px,
        rotation_deg=field.rotation_deg,
        is_flipped=field.is_flipped,
        matched=fit.matched,
        rms_arcsec=fit.rms_arcsec,
        path=path,
        ms=ms,
    )


def catalogue_stars_in_frame(
    wcs: Wcs,
    catalogue_deg: FloatArray,
    most: int,
    *,
    width_px: int,
    height_px: int,
    margin_px: float = 0.0,
) -> IndexArray:
    """Return rows of the ``most`` brightest catalogue stars that the plate puts on the frame.

    ``margin_px``: distance beyond the edges up to which stars count too.
    """
    x, y = sky_to_pixel(wcs, catalogue_deg[:, 0], catalogue_deg[:, 1])
    with np.errstate(invalid="ignore"):
        is_inside = (np.abs(x - (width_px - 1) / 2) <= width_px / 2 + margin_px) & (
            np.abs(y - (height_px - 1) / 2) <= height_px / 2 + margin_px
        )
    return np.flatnonzero(is_inside)[:most]


def _robust_fit(
    stars: FloatArray,
    catalogue: FloatArray,
    pairs: tuple[IndexArray, IndexArray],
    wcs: Wcs,
    *,
    width_px: int,
    height_px: int,
    max_order: int,
) -> tuple[Wcs, tuple[IndexArray, IndexArray], float]:
    """Fit, drop what lies beyond 4 robust sigma, fit again; also the robust sigma in pixels."""
    keep = np.ones(len(pairs[0]), bool)
    fitted, sigma_px = wcs, 0.0
    for _ in range(3):
        used = (pairs[0][keep], pairs[1][keep])
        fitted = _fit(
            stars[used[0]],
            catalogue[used[1]],
            wcs,
            width_px=width_px,
            height_px=height_px,
            max_order=max_order,
        )
        x, y = sky_to_pixel(fitted, catalogue[pairs[1], 0], catalogue[pairs[1], 1])
        miss_px = np.nan_to_num(
            np.hypot(x - stars[pairs[0], 0], y - stars[pairs[0], 1]), nan=np.inf
        )
        # The median of a Rayleigh distribution is 1.177 sigma.
        sigma_px = median_of(miss_px[keep]) / 1.177
        good = miss_px <= max(4.0 * sigma_px, 0.05)
        if good.sum() < MIN_MATCHED or np.array_equal(good, keep):
            break
        keep = good
    return fitted, (pairs[0][keep], pairs[1][keep]), sigma_px


def _fit(
    xy: FloatArray, radec: FloatArray, wcs: Wcs, *, width_px: int, height_px: int, max_order: int
) -> Wcs:
    """Linear least squares on the tangent plane about the image centre; order chosen by PRESS."""
    centre = np.array([(width_px - 1) / 2.0, (height_px - 1) / 2.0])
    unit_px = max(width_px, height_px) / 2.0
    u, v = ((xy - centre) / unit_px).T
    ra0, dec0 = (float(a) for a in pixel_to_sky(wcs, centre[0], centre[1]))
    plane = _to_plane(radec, ra0, dec0)
    terms = [(d - q, q) for d in range(max_order + 1) for q in range(d + 1)]
    powers_u, powers_v = (np.vander(each, max_order + 1, increasing=True) for each in (u, v))
    design = powers_u[:, [p for p, _ in terms]] * powers_v[:, [q for _, q in terms]]
    count = _best_count(design, plane, max_order)
    terms, to_coefficients = terms[:count], np.linalg.pinv(design[:, :count])
    coefficients = to_coefficients @ plane
    for _ in range(3):
        # Moving the tangent point onto the centre leaves no constant in the plate.
        shifted = pixel_to_sky(_unit_plane(ra0, dec0), coefficients[0, 0], coefficients[0, 1])
        ra0, dec0 = float(shifted[0]), float(shifted[1])
        coefficients = to_coefficients @ _to_plane(radec, ra0, dec0)
    cd = coefficients[1:3].T / unit_px
    sip = np.linalg.solve(cd, coefficients[3:].T)
    named = [
        tuple(
            (p, q, float(c) / unit_px ** (p + q)) for (p, q), c in zip(terms[3:], row, strict=True)
        )
        for row in sip
    ]
    return Wcs(
        crpix_x_px=float(centre[0]),
        crpix_y_px=float(centre[1]),
        crval_ra_deg=ra0 % 360.0,
        crval_dec_deg=dec0,
        cd=(float(cd[0, 0]), float(cd[0, 1]), float(cd[1, 0]), float(cd[1, 1])),
        sip_a=named[0],
        sip_b=named[1],
    )


def _best_count(design: FloatArray, plane: FloatArray, max_order: int) -> int:
    """Number of terms of the order chosen by PRESS; ``design``: lower orders come first."""
    # Its first columns are the orthogonal ones of the lower orders.
    q_matrix, _ = np.linalg.qr(design)
    best, best_press = 0, math.inf
    for order in range(1, max_order + 1):
        count = (order + 1) * (order + 2) // 2
        if order > 1 and len(design) < _STARS_PER_TERM * count:
            break
        own = q_matrix[:, :count]
        residual = plane - own @ (own.T @ plane)
        leverage = np.clip(np.sum(own**2, axis=1), 0.0, 0.999)
        press = float(np.sqrt(np.mean((residual / (1.0 - leverage[:, None])) ** 2)))
        if not best or press < _PRESS_GAIN * best_press:
            best, best_press = count, press
    return best


def _unit_plane(ra0_deg: float, dec0_deg: float) -> Wcs:
    """Return the tangent plane itself, one degree a 'pixel'."""
    return Wcs(
        crpix_x_px=0.0,
        crpix_y_px=0.0,
        crval_ra_deg=ra0_deg,
        crval_dec_deg=dec0_deg,
        cd=(1.0, 0.0, 0.0, 1.0),
    )


def _to_plane(radec: FloatArray, ra0_deg: float, dec0_deg: float) -> FloatArray:
    return np.stack(sky_to_pixel(_unit_plane(ra0_deg, dec0_deg), radec[:, 0], radec[:, 1]), axis=1)


def field_radius_deg(wcs: Wcs, width_px: int, height_px: int) -> float:
    """Distance from the image centre to its farthest corner, deg."""
    x = np.array([0.0, width_px - 1.0, 0.0, width_px - 1.0])
    y = np.array([0.0, 0.0, height_px - 1.0, height_px - 1.0])
    ra, dec = pixel_to_sky(wcs, x, y)
    centre = pixel_to_sky(wcs, (width_px - 1) / 2.0, (height_px - 1) / 2.0)
    return float(np.max(separation_deg(float(centre[0]), float(centre[1]), ra, dec)))
