"""Few stars, as through cloud: the last plate shifted onto them, its scale and angle kept.

Pure. A whole plate wants six stars. Where scale, angle and distortion are known of the frames
before and the mount's word brings the plate near, two numbers are left, and three stars that agree
on them within a pixel or two are no chance: of ``n`` stars and ``m`` catalogue stars ``n m pi R^2 /
A`` pairs lie within the reach R of each other by chance, and k - 1 more of them within the
tolerance of one by the law of Poisson. Stars and catalogue stars brightest first, as in
``plate_fit``.
"""

import math

import numpy as np

from rsoconsole.records import FloatArray, Wcs
from rsoconsole.sky import describe, sky_to_pixel
from rsoconsole.vision.stars.plate_fit import IndexArray, PlateFit, in_field
from rsoconsole.vision.stars.plate_move import moved_by_pixels, moved_by_sky

FEWEST_STARS = 3
"""That agree on one shift."""
_MOST_BY_CHANCE = 1e-4
"""How often as many agree by chance, in a frame, at most."""
_BRIGHTEST, _CATALOGUED = 60, 40
"""What cloud leaves are the brightest; the more are asked, the more agree by chance."""
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
    stars = np.asarray(stars_xy_px, float)[:_BRIGHTEST, :2]
    shown = in_field(
        predicted,
        catalogue_deg,
        _CATALOGUED,
        width_px=width_px,
        height_px=height_px,
        margin_px=reach_px,
    )
    if min(len(stars), len(shown)) < FEWEST_STARS:
        return None
    catalogue = np.asarray(catalogue_deg, float)[shown]
    x, y = sky_to_pixel(predicted, catalogue[:, 0], catalogue[:, 1])
    off_px = stars[:, None, :] - np.stack([x, y], axis=1)[None]
    agreed = _agreed(off_px, reach_px)
    if agreed is None:
        return None
    of_stars, of_catalogue = agreed
    shifts = off_px[of_stars, of_catalogue]
    pairs = len(stars) * len(shown) * math.pi * reach_px**2 / (width_px * height_px)
    if _by_chance(pairs, len(shifts), reach_px) > _MOST_BY_CHANCE:
        return None
    shift = shifts.mean(axis=0)
    left2 = float(np.sum((shifts - shift) ** 2)) / (2.0 * (len(shifts) - 1))
    rms = max(scale * math.sqrt(left2), rms_arcsec)
    return PlateFit(
        wcs=moved_by_pixels(predicted, (float(shift[0]), float(shift[1]))),
        matched=len(shifts),
        rms_arcsec=rms,
        sigma_at_centre_arcsec=rms / math.sqrt(len(shifts)),
        star_indices=of_stars,
        catalogue_indices=shown[of_catalogue],
    )


def _agreed(off_px: FloatArray, reach_px: float) -> tuple[IndexArray, IndexArray] | None:
    """Rows and columns of the pairs that share one shift, each star and each partner once."""
    rows, columns = np.nonzero(np.hypot(off_px[..., 0], off_px[..., 1]) <= reach_px)
    near = off_px[rows, columns]
    best = np.zeros(0, dtype=np.intp)
    for centre in near:
        for _ in range(2):  # the first pair is no better centred than the others
            away = np.hypot(*(near - centre).T)
            order = np.argsort(away, kind="stable")
            inside = order[away[order] <= _TOLERANCE_PX]
            inside = _each_once(inside, rows, columns)
            centre = near[inside].mean(axis=0) if len(inside) else centre  # noqa: PLW2901
        if len(inside) > len(best):
            best = inside
    if len(best) < FEWEST_STARS:
        return None
    return rows[best], columns[best]


def _each_once(inside: IndexArray, rows: IndexArray, columns: IndexArray) -> IndexArray:
    """Without the further pairs of what has a nearer one."""
    stars: set[int] = set()
    partners: set[int] = set()
    kept = []
    for each in inside:
        star, partner = int(rows[each]), int(columns[each])
        if star not in stars and partner not in partners:
            stars.add(star)
            partners.add(partner)
            kept.append(each)
    return np.asarray(kept, dtype=np.intp)


def _by_chance(pairs: float, agreeing: int, reach_px: float) -> float:
    """How many sets of so many agreeing pairs chance makes in a frame."""
    beside = pairs * (_TOLERANCE_PX / reach_px) ** 2
    return pairs * beside ** (agreeing - 1) / math.factorial(agreeing - 1)
