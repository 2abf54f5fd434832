"""Fast path of solving: the last plate moved onto a new frame's stars, without a sky search.

Pure. The mount's commanded shift brings the plate near; all pairs of star and catalogue star then
vote for one offset, and the plate is fitted again. Stars and catalogue stars brightest first, as in
``plate_fit``.
"""

import math
from dataclasses import replace

import numpy as np

from rsoconsole.records import FloatArray, Wcs
from rsoconsole.sky import describe_field, pixel_to_sky, sky_to_pixel
from rsoconsole.vision.arrays import IndexArray
from rsoconsole.vision.stars.plate_fit import MAX_STARS, PlateFit, catalogue_stars_in_frame, refit
from rsoconsole.vision.stars.star_pairs import MIN_MATCHED, mutual_nearest, squared_distances

_VOTE_BIN_PX = 6.0


def refit_moved_plate(
    previous: Wcs,
    stars_xy_px: FloatArray,
    catalogue_deg: FloatArray,
    *,
    width_px: int,
    height_px: int,
    shift_deg: tuple[float, float] = (0.0, 0.0),
    search_arcsec: float = 120.0,
) -> PlateFit | None:
    """Fit the plate of a frame, starting from an earlier frame's; None where it fails.

    ``shift_deg`` is the commanded move of the telescope since, as (RA, Dec) differences in degrees;
    the camera keeps its angle to the pole. The remaining offset, up to ``search_arcsec``, is the
    one on which most pairs of star and catalogue star agree. None also without a clear majority,
    and where scale or angle differ from the previous plate's.
    """
    predicted = plate_after_mount_move(previous, shift_deg)
    scale = describe_field(predicted, width_px, height_px).scale_arcsec_px
    reach_px = max(search_arcsec / scale, 2.0 * _VOTE_BIN_PX)
    stars = np.asarray(stars_xy_px, float)[:MAX_STARS, :2]
    size_px = (width_px, height_px)
    shown, places_px = _shown(predicted, catalogue_deg, 2 * len(stars) + 20, size_px, reach_px)
    if len(stars) < MIN_MATCHED or len(shown) < MIN_MATCHED:
        return None
    offset = _voted_offset(stars[:150], places_px[:300], reach_px)
    if offset is None:
        return None
    start = plate_shifted_px(predicted, offset)
    fit = refit(
        stars,
        np.asarray(catalogue_deg, float)[shown],
        start,
        width_px=width_px,
        height_px=height_px,
        tolerance_px=_VOTE_BIN_PX,
    )
    if fit is None or not _is_same_camera(previous, fit.wcs, width_px, height_px):
        return None
    if fit.matched < 0.3 * min(len(stars), len(shown)):
        return None
    return replace(fit, catalogue_indices=shown[fit.catalogue_indices])


def _shown(
    plate: Wcs, catalogue_deg: FloatArray, most: int, size_px: tuple[int, int], margin_px: float
) -> tuple[IndexArray, FloatArray]:
    """Rows of the brightest catalogue stars on the frame or just beside it, and their pixels."""
    width_px, height_px = size_px
    shown = catalogue_stars_in_frame(
        plate, catalogue_deg, most, width_px=width_px, height_px=height_px, margin_px=margin_px
    )
    catalogue = np.asarray(catalogue_deg, float)[shown]
    return shown, np.stack(sky_to_pixel(plate, catalogue[:, 0], catalogue[:, 1]), axis=1)


def plate_after_mount_move(wcs: Wcs, shift_deg: tuple[float, float]) -> Wcs:
    """Return the plate after the mount moved by (RA, Dec) degrees: only its tangent point moves."""
    dec_deg = float(np.clip(wcs.crval_dec_deg + shift_deg[1], -90.0, 90.0))
    return replace(
        wcs, crval_ra_deg=(wcs.crval_ra_deg + shift_deg[0]) % 360.0, crval_dec_deg=dec_deg
    )


def plate_shifted_px(wcs: Wcs, offset_px: tuple[float, float]) -> Wcs:
    """Return the plate on which every star lies ``offset_px`` (x, y) further on the frame."""
    ra, dec = pixel_to_sky(wcs, wcs.crpix_x_px - offset_px[0], wcs.crpix_y_px - offset_px[1])
    shift = (float(ra) - wcs.crval_ra_deg, float(dec) - wcs.crval_dec_deg)
    return plate_after_mount_move(wcs, shift)


def _voted_offset(
    stars: FloatArray, predicted: FloatArray, reach_px: float
) -> tuple[float, float] | None:
    """Offset (star minus prediction) that most pairs agree on; None without a clear majority."""
    one, other = np.nonzero(squared_distances(stars, predicted) <= reach_px**2)
    near = stars[one] - predicted[other]
    if len(near) < MIN_MATCHED:
        return None
    half = math.ceil(reach_px / _VOTE_BIN_PX) + 1
    cells = np.floor(near / _VOTE_BIN_PX).astype(int) + half
    votes = np.zeros((2 * half + 2, 2 * half + 2))
    np.add.at(votes, (cells[:, 0], cells[:, 1]), 1.0)
    # A true offset may straddle cells: count 2 x 2 blocks.
    blocks = votes[:-1, :-1] + votes[1:, :-1] + votes[:-1, 1:] + votes[1:, 1:]
    at = np.unravel_index(int(blocks.argmax()), blocks.shape)
    by_chance = 4.0 * len(near) / (math.pi * (reach_px / _VOTE_BIN_PX) ** 2)
    if blocks[at] < MIN_MATCHED + by_chance + 4.0 * math.sqrt(by_chance):
        return None
    corner = (np.array(at) - half + 1) * _VOTE_BIN_PX
    agreeing = near[np.max(np.abs(near - corner), axis=1) <= _VOTE_BIN_PX]
    median = np.median(agreeing, axis=0)
    return float(median[0]), float(median[1])


def _is_same_camera(before: Wcs, after: Wcs, width_px: int, height_px: int) -> bool:
    """True where two plates share hand, scale (0.3 %) and angle to the pole (1 deg)."""
    a, b = (describe_field(wcs, width_px, height_px) for wcs in (before, after))
    turned = (b.rotation_deg - a.rotation_deg + 180.0) % 360.0 - 180.0
    return (
        a.is_flipped == b.is_flipped
        and abs(b.scale_arcsec_px / a.scale_arcsec_px - 1.0) < 0.003
        and abs(turned) < 1.0
    )


MIN_SHIFT_STARS = 2
_ASKED = ((10, 12), (20, 20), (60, 40))
"""Numbers of stars and of catalogue stars, used in turn until their agreement is no chance."""
_MAX_BY_CHANCE = 1e-4 / len(_ASKED)
"""Highest number of chance agreements of as many stars, a frame."""
_TOLERANCE_PX = 2.0
"""Tolerance of a star's place, px: error of its centre and of the plate between two fields."""


def shift_plate(
    previous: Wcs,
    stars_xy_px: FloatArray,
    catalogue_deg: FloatArray,
    *,
    width_px: int,
    height_px: int,
    shift_deg: tuple[float, float] = (0.0, 0.0),
    search_arcsec: float = 120.0,
    rms_arcsec: float,
) -> PlateFit | None:
    """Shift a plate by the offset on which most stars agree; None where that may be chance.

    For fields with too few stars for a fit. ``shift_deg`` and ``search_arcsec``: commanded move and
    largest remaining offset. ``rms_arcsec``: residual of the previous plate's stars, per axis; the
    result's is at least as large, since few stars may agree better by chance.
    """
    predicted = plate_after_mount_move(previous, shift_deg)
    scale = describe_field(predicted, width_px, height_px).scale_arcsec_px
    reach_px = search_arcsec / scale
    most_stars, most_catalogued = _ASKED[-1]
    stars = np.asarray(stars_xy_px, float)[:most_stars, :2]
    size_px = (width_px, height_px)
    shown, places_px = _shown(predicted, catalogue_deg, most_catalogued, size_px, reach_px)
    if min(len(stars), len(shown)) < MIN_SHIFT_STARS:
        return None
    off_px = stars[:, None, :] - places_px[None]
    share = math.pi * reach_px**2 / (width_px * height_px)
    shift = next(
        (
            found
            for n, m in _ASKED
            if (found := _shift(off_px[:n, :m], reach_px, share)) is not None
        ),
        None,
    )
    if shift is None:
        return None
    of_stars, of_catalogue = _agreeing(off_px, shift)
    left_px = off_px[of_stars, of_catalogue] - shift
    rms = scale * math.sqrt(float(np.sum(left_px**2)) / (2.0 * (len(left_px) - 1)))
    rms = max(rms, rms_arcsec)
    return PlateFit(
        wcs=plate_shifted_px(predicted, (float(shift[0]), float(shift[1]))),
        matched=len(left_px),
        rms_arcsec=rms,
        catalogue_indices=shown[of_catalogue],
    )


def _shift(off_px: FloatArray, reach_px: float, share: float) -> FloatArray | None:
    """Shift that most pairs within the reach agree on, (2,) px; None where it may be chance.

    ``share``: of the frame that the reach about a place covers.
    """
    rows, columns = np.nonzero(np.hypot(off_px[..., 0], off_px[..., 1]) <= reach_px)
    best: FloatArray | None = None
    most = MIN_SHIFT_STARS - 1
    for shift in off_px[rows, columns]:
        for _ in range(2):  # the first pair is no better centred than the others
            of_stars, of_catalogue = _agreeing(off_px, shift)
            if not len(of_stars):
                break
            shift = off_px[of_stars, of_catalogue].mean(axis=0)  # noqa: PLW2901
        agreeing = len(_agreeing(off_px, shift)[0])
        if agreeing > most:
            best, most = shift, agreeing
    pairs = off_px.shape[0] * off_px.shape[1] * share
    if best is None or _by_chance(pairs, most, reach_px) > _MAX_BY_CHANCE:
        return None
    return best


def _agreeing(off_px: FloatArray, shift: FloatArray) -> tuple[IndexArray, IndexArray]:
    """Rows and columns of the pairs that share a shift, each star and each partner once."""
    away = np.hypot(off_px[..., 0] - shift[0], off_px[..., 1] - shift[1])
    return mutual_nearest(away, _TOLERANCE_PX)


def _by_chance(pairs: float, agreeing: int, reach_px: float) -> float:
    """Expected number of chance sets of as many agreeing pairs in a frame."""
    beside = pairs * (_TOLERANCE_PX / reach_px) ** 2
    return pairs * beside ** (agreeing - 1) / math.factorial(agreeing - 1)
