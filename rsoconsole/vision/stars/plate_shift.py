"""Few stars, as through cloud: the last plate shifted onto them, its scale and angle kept.

Pure. A whole plate wants six stars. Where scale, angle and distortion are known of the frames
before and the mount's word brings the plate near, two numbers are left, and three stars that agree
on them within a pixel or two are no chance, nor are two of the brightest: of ``n`` stars and ``m``
catalogue stars ``n m pi R^2 / A`` pairs lie within the reach R of each other by chance, and k - 1
more of them within the tolerance of one by the law of Poisson. Cloud leaves the brightest, so the
brightest are asked first: the fewer are asked, the fewer agree by chance. Stars and catalogue stars
brightest first, as in ``plate_fit``.
"""

import math

import numpy as np

from rsoconsole.records import FloatArray, Wcs
from rsoconsole.sky import describe, sky_to_pixel
from rsoconsole.vision.stars.plate_fit import IndexArray, PlateFit, in_field
from rsoconsole.vision.stars.plate_move import moved_by_pixels, moved_by_sky

FEWEST_STARS = 2
"""That agree on one shift."""
_ASKED = ((10, 12), (20, 20), (60, 40))
"""Stars, catalogue stars: one after the other until one of them is no chance."""
_MOST_BY_CHANCE = 1e-4 / len(_ASKED)
"""How often as many agree by chance, in a frame, at most."""
_TOLERANCE_PX = 2.0
"""Of a star's centre in poor light, of the plate between two fields."""


def shifted_onto(
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
    """The plate whose shift against ``previous`` most stars share; None where it may be chance.

    ``shift_deg`` and ``search_arcsec`` as in ``plate_move.refit_from``. ``rms_arcsec``: of the
    previous plate's stars, per axis: that few stars agree better by luck is not believed.
    """
    predicted = moved_by_sky(previous, shift_deg)
    scale = describe(predicted, width_px, height_px).scale_arcsec_px
    reach_px = search_arcsec / scale
    most_stars, most_catalogued = _ASKED[-1]
    stars = np.asarray(stars_xy_px, float)[:most_stars, :2]
    shown = in_field(
        predicted,
        catalogue_deg,
        most_catalogued,
        width_px=width_px,
        height_px=height_px,
        margin_px=reach_px,
    )
    if min(len(stars), len(shown)) < FEWEST_STARS:
        return None
    catalogue = np.asarray(catalogue_deg, float)[shown]
    x, y = sky_to_pixel(predicted, catalogue[:, 0], catalogue[:, 1])
    off_px = stars[:, None, :] - np.stack([x, y], axis=1)[None]
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
        wcs=moved_by_pixels(predicted, (float(shift[0]), float(shift[1]))),
        matched=len(left_px),
        rms_arcsec=rms,
        catalogue_indices=shown[of_catalogue],
    )


def _shift(off_px: FloatArray, reach_px: float, share: float) -> FloatArray | None:
    """What most pairs within the reach agree on, (2,) px; None where chance may have made it.

    ``share``: of the frame that the reach about a place covers.
    """
    rows, columns = np.nonzero(np.hypot(off_px[..., 0], off_px[..., 1]) <= reach_px)
    best: FloatArray | None = None
    most = FEWEST_STARS - 1
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
    if best is None or _by_chance(pairs, most, reach_px) > _MOST_BY_CHANCE:
        return None
    return best


def _agreeing(off_px: FloatArray, shift: FloatArray) -> tuple[IndexArray, IndexArray]:
    """Rows and columns of the pairs that share a shift, each star and each partner once."""
    away = np.hypot(off_px[..., 0] - shift[0], off_px[..., 1] - shift[1])
    nearest, partner = away.argmin(axis=1), away.argmin(axis=0)
    rows = np.arange(len(away))
    is_pair = (partner[nearest] == rows) & (away[rows, nearest] <= _TOLERANCE_PX)
    return rows[is_pair], nearest[is_pair]


def _by_chance(pairs: float, agreeing: int, reach_px: float) -> float:
    """How many sets of as many agreeing pairs chance makes in a frame."""
    beside = pairs * (_TOLERANCE_PX / reach_px) ** 2
    return pairs * beside ** (agreeing - 1) / math.factorial(agreeing - 1)
