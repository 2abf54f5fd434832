"""Stars of a frame: centroids good to a few hundredths of a pixel, spread over the field.

Candidates are the brightest places of blocks of a few pixels; each is then measured on the raw
pixels with a Gaussian window that moves onto the star: an intensity-weighted centroid which
neighbours and the sky's noise cannot pull (Bertin's XWIN, SExtractor manual, ch. 10).
"""

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.arrays import BoolArray, IndexArray
from rsoconsole.vision.frame.background import Background, local_background, resample
from rsoconsole.vision.frame.bins import (
    FrameBins,
    bin_frame,
    bin_side_px,
    block_maximum,
    mean_of_squares,
)
from rsoconsole.vision.stars.psf_field import MIN_STARS, Psf, PsfField, WidthSource, fit_psf_field
from rsoconsole.vision.stars.star_list import OblongLights, StarList
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA, StarMoments, measure_star_moments
from rsoconsole.vision.stars.trailed_stars import MAX_OBLONG, trailed_stars

MIN_SNR = 7.0
MAX_STARS = 400
STAR_BLOCK_PX = 8
"""Side of the squares whose brightest places are candidates."""

MIN_POINTS, MAX_POINTS = 5, 40
"""Limits of the number of points on one line: of more, a streak's pieces are the smaller part."""
_LARGE_PX = 1024
_CANDIDATE_SIGMA = 5.0
_TILES = (8, 6)
_ASKED_EACH, _MAX_ASKED = 4, 16_000
"""Number of places examined for each candidate wanted, and at most, where half are hot pixels."""
_LONE_SIGMA, _SURE_SIGMA = 2.5, 30.0
"""Limits in sigma of a lone pixel: most for its three brightest neighbours, least for itself."""
_PROBE_STARS = 150
_PROBE_HALF_PX = 10
_PROBE_SIGMA_PX = 2.0
_DEFAULT_FWHM_PX = 2.5
_FEWEST = 5
"""Number of unsaturated stars from which their median width holds."""
_FWHM_PX = (1.2, 12.0)
"""Range of widths that a first look can measure, px."""
_MAX_PEAK_SHARE = 0.6
"""Largest share of one pixel in the light of 3 x 3 pixels; more is a hot pixel or a cosmic ray."""
_MAX_AXIS_RATIO = 1.5
_SHARPEST, _WIDEST = 0.62, 2.5
"""Limits of a width relative to the stars', beyond which it is no star's."""
_OBLONG, _ROUND, _OBLONG_SNR, _HALF_FWHM = 1.25, 1.08, 10.0, 2.0
"""Axis ratios, too long for a star and of round ones by noise; least SNR; half length by width."""
_SHAPE_SEEN_SNR, _MAX_RATIO, _RIM_FWHM = 40.0, 2.0, 2.0
_SATURATED_SHARE = 0.95
_MIN_TRAILS, _MAX_POINTS, _DRAWN_OUT = 12, 0.5, 1.35
"""Limits of trails: number of bright pieces, share of them that are points, axis ratio."""


def find_stars(
    pixels: PixelArray,
    background: Background | None = None,
    max_stars: int = MAX_STARS,
    saturation_adu: float = 65535.0,
    *,
    bins: FrameBins | None = None,
    expected: Psf | None = None,
    block_px: int = STAR_BLOCK_PX,
    may_be_trails: bool = True,
) -> StarList:
    """Measure up to ``max_stars`` stars of ``pixels`` (height, width), ADU.

    Left out are streaks (elongated), cosmic rays and hot pixels (sharper than stars) and blends;
    saturated stars are listed and flagged. Each part of the field gives its brightest, so that no
    corner is empty.

    - background, bins: those of the same frame; None: they are computed
    - saturation_adu: level at which the camera saturates
    - expected: width of stars in earlier frames, for a frame with too few stars to measure it
    - block_px: side of the blocks whose brightest places are candidates; of 3 x 3 blocks at most
      one
    - may_be_trails: False where drift cannot have drawn out all stars
    """
    if bins is None or block_px not in bins.brightest:
        bins = bin_frame(pixels, (block_px,))
    sky = background or local_background(pixels, bins=bins)
    x_px, y_px = _candidates(pixels, sky, bins, 2 * max_stars, block_px)
    probe = (x_px[:_PROBE_STARS], y_px[:_PROBE_STARS])
    probed_px, is_drawn_out = _psf_fwhm(pixels, sky, *probe, saturation_adu)
    if is_drawn_out and may_be_trails:
        trailed = trailed_stars(pixels, sky, x_px, y_px, saturation_adu)
        if trailed is not None:
            return trailed.chosen(_spread(trailed.x_px, trailed.y_px, sky, max_stars))
    fwhm_px, source = _known_fwhm(probed_px, expected)
    sigma_px = fwhm_px / FWHM_PER_SIGMA
    half_px = max(5, int(np.ceil(4.0 * sigma_px)))
    found = measure_star_moments(pixels, sky, x_px, y_px, sigma_px=sigma_px, half_px=half_px)
    is_saturated = found.peak_adu >= _SATURATED_SHARE * saturation_adu
    is_star = _is_point(found, is_saturated)
    is_star &= found.shift_px < np.where(is_saturated, half_px, 1.5 + 0.5 * fwhm_px)
    is_good = _without_streak(found, is_star & ~is_saturated)
    if np.count_nonzero(is_good) >= _FEWEST:
        fwhm_px, source = float(np.median(found.fwhm_px[is_good])), "measured"
    field = _psf_field(found, is_good, expected, pixels.shape, is_level_known=source != "measured")
    local_px = fwhm_px if field is None else field.all_at(found.x_px, found.y_px)
    is_star &= is_saturated | (
        (found.fwhm_px > _SHARPEST * local_px) & (found.fwhm_px < _WIDEST * local_px)
    )
    kept = np.flatnonzero(is_star)
    kept = kept[np.argsort(-found.flux[kept], kind="stable")]
    kept = _apart(found, kept, 2.0 * fwhm_px)
    kept = kept[_spread(found.x_px[kept], found.y_px[kept], sky, max_stars)]
    return StarList(
        x_px=found.x_px[kept],
        y_px=found.y_px[kept],
        flux=found.flux[kept],
        fwhm_px=found.fwhm_px[kept],
        snr=found.snr[kept],
        is_saturated=is_saturated[kept],
        median_fwhm_px=fwhm_px,
        psf_field=field,
        width_source=source,
        oblong=_oblong(found, is_good, is_saturated, local_px, pixels.shape),
    )


def _candidates(
    pixels: PixelArray, sky: Background, bins: FrameBins, count: int, block_px: int
) -> tuple[IndexArray, IndexArray]:
    """Brightest pixels of blocks that stand out of the sky and of their eight neighbours."""
    import cv2

    height, width = pixels.shape
    rows, columns = height // block_px, width // block_px
    binning = bin_side_px(block_px) if min(height, width) >= _LARGE_PX else 1
    if binning > 1:
        brightest = bins.brightest[block_px][:rows, :columns]
    else:
        whole = pixels[: rows * block_px, : columns * block_px]
        brightest = block_maximum(whole, block_px).astype(np.float32)
    per_cell = sky.cell_px // block_px
    excess = brightest - resample(sky.level, per_cell, rows, columns)
    excess *= binning / resample(sky.noise, per_cell, rows, columns)
    is_peak = (excess > _CANDIDATE_SIGMA) & (excess >= cv2.dilate(excess, np.ones((3, 3))))
    row, column = np.divmod(np.flatnonzero(is_peak), columns)
    if row.size == 0:
        return column, row
    order = np.argsort(-excess[row, column], kind="stable")
    row, column = row[order], column[order]
    for asked in (_ASKED_EACH * count, _MAX_ASKED):
        chosen = _spread(column * block_px, row * block_px, sky, asked)
        x_px, y_px = _brightest_pixels(pixels, row[chosen], column[chosen], binning, block_px)
        is_light = ~_is_lone_pixel(pixels, sky, x_px, y_px)
        x_px, y_px = x_px[is_light], y_px[is_light]
        if 2 * len(x_px) >= len(chosen) or len(chosen) == row.size:
            break
    chosen = _spread(x_px, y_px, sky, count)
    return x_px[chosen], y_px[chosen]


def _is_lone_pixel(
    pixels: PixelArray, sky: Background, x_px: IndexArray, y_px: IndexArray
) -> BoolArray:
    """True for the brightest places that are one pixel alone, as hot ones are."""
    height, width = pixels.shape
    inside = (x_px >= 2) & (x_px < width - 2) & (y_px >= 2) & (y_px < height - 2)
    x, y = np.clip(x_px, 2, width - 3), np.clip(y_px, 2, height - 3)
    around = sliding_window_view(pixels, (5, 5))[y - 2, x - 2].reshape(len(x), 25)
    level, noise = (sky.all_at(small, x, y) for small in (sky.level, sky.noise))
    is_lone = inside & (around.max(axis=1) - level > _SURE_SIGMA * noise)
    excess = np.sort(around[is_lone].astype(np.float32) - level[is_lone, None], axis=1)
    is_lone[is_lone] = excess[:, -4:-1].mean(axis=1) < _LONE_SIGMA * noise[is_lone]
    return np.asarray(is_lone)


def _brightest_pixels(
    pixels: PixelArray, row: IndexArray, column: IndexArray, binning: int, block_px: int
) -> tuple[IndexArray, IndexArray]:
    """Largest bin of each block, then its largest pixel: (x_px, y_px)."""
    windows = sliding_window_view(pixels, (block_px, block_px))
    blocks = windows[row * block_px, column * block_px].astype(np.float32)
    n = block_px // binning
    bins = mean_of_squares(blocks.reshape(-1, block_px), binning)
    best = np.argmax(bins.reshape(-1, n * n), axis=1)
    bin_y, bin_x = np.divmod(best, n)
    return (
        column * block_px + bin_x * binning + (binning - 1) // 2,
        row * block_px + bin_y * binning + (binning - 1) // 2,
    )


def _spread(x_px: npt.ArrayLike, y_px: npt.ArrayLike, sky: Background, count: int) -> IndexArray:
    """Indices of up to ``count`` entries, the best of every tile first served, order kept.

    Entries come best first. In each round every tile gives its next best.
    """
    # A centroid may lie a little beyond the frame.
    across = np.clip(np.asarray(x_px) * _TILES[0] // sky.width_px, 0, _TILES[0] - 1)
    down = np.clip(np.asarray(y_px) * _TILES[1] // sky.height_px, 0, _TILES[1] - 1)
    # 8 and 16 bits: NumPy's stable sort then counts instead of comparing.
    tile = (down * _TILES[0] + across).astype(np.uint8)
    by_tile = np.argsort(tile, kind="stable")
    first = np.searchsorted(tile[by_tile], np.arange(_TILES[0] * _TILES[1]))
    rank = np.empty(tile.size, dtype=np.uint16)
    rank[by_tile] = np.minimum(np.arange(tile.size) - first[tile[by_tile]], 65535)
    return np.sort(np.argsort(rank, kind="stable")[:count])


def _psf_fwhm(
    pixels: PixelArray, sky: Background, x_px: IndexArray, y_px: IndexArray, saturation_adu: float
) -> tuple[float | None, bool]:
    """Median width of bright unsaturated stars, from a window wide enough for poor seeing.

    None where there are fewer than five. The second value: True where most bright lights, hot
    pixels aside, are longer than wide.
    """
    probe = measure_star_moments(
        pixels, sky, x_px, y_px, sigma_px=_PROBE_SIGMA_PX, half_px=_PROBE_HALF_PX
    )
    is_saturated = probe.peak_adu >= _SATURATED_SHARE * saturation_adu
    is_good = _is_point(probe, is_saturated) & ~is_saturated & (probe.snr > 2 * MIN_SNR)
    is_good = _without_streak(probe, is_good)
    is_light = ~is_saturated & (probe.snr > 2 * MIN_SNR) & (probe.peak_share < _MAX_PEAK_SHARE)
    lit, good = np.count_nonzero(is_light), np.count_nonzero(is_good)
    is_drawn_out = bool(
        lit >= _MIN_TRAILS
        and good < _MAX_POINTS * lit
        and np.median(probe.axis_ratio[is_light]) > _DRAWN_OUT
    )
    if good < _FEWEST:
        return None, is_drawn_out
    return float(np.clip(np.median(probe.fwhm_px[is_good]), *_FWHM_PX)), is_drawn_out


def _known_fwhm(probed_px: float | None, expected: Psf | None) -> tuple[float, WidthSource]:
    """Width to search for stars with, px, and its source."""
    if probed_px is not None:
        return probed_px, "measured"
    if expected is not None:
        return float(np.clip(expected.fwhm_px, *_FWHM_PX)), "remembered"
    return _DEFAULT_FWHM_PX, "guessed"


def _psf_field(
    found: StarMoments,
    is_good: BoolArray,
    expected: Psf | None,
    shape: tuple[int, ...],
    *,
    is_level_known: bool,
) -> PsfField | None:
    """Width over the frame: by its stars, or the expected one where they are too few.

    ``is_level_known``: whether the frame's width is the expected one's too.
    """
    is_fit = is_good & (found.snr > 2 * MIN_SNR)
    if np.count_nonzero(is_fit) >= MIN_STARS:
        stars = found.x_px[is_fit], found.y_px[is_fit], found.fwhm_px[is_fit]
        return fit_psf_field(*stars, (shape[0], shape[1]))
    if expected is None or expected.field is None:
        return None
    if np.count_nonzero(is_good) < _FEWEST:
        return expected.field if is_level_known else None
    stars = found.x_px[is_good], found.y_px[is_good], found.fwhm_px[is_good]
    return expected.field.through(*stars)


def _without_streak(found: StarMoments, is_good: BoolArray) -> BoolArray:
    """True for good stars off any one line: where few are seen, pieces of a streak may be most."""
    if not _FEWEST <= np.count_nonzero(is_good) <= MAX_POINTS:
        return is_good
    good = np.flatnonzero(is_good)
    reach_px = 0.5 * float(np.median(found.fwhm_px[good]))
    is_free = is_good.copy()
    is_free[good[is_on_one_line(found.x_px[good], found.y_px[good], reach_px)]] = False
    return is_free


def is_on_one_line(x_px: FloatArray, y_px: FloatArray, reach_px: float) -> BoolArray:
    """Return True for points, (n,), on the line through two of them that holds most points.

    Points within ``reach_px`` are on the line. All False where it holds fewer than ``MIN_POINTS``
    or no more than half of the points, or where there are more than ``MAX_POINTS``.
    """
    count = x_px.size
    none = np.zeros(count, dtype=bool)
    if not MIN_POINTS <= count <= MAX_POINTS:
        return none
    first, second = np.triu_indices(count, 1)
    dx, dy = x_px[second] - x_px[first], y_px[second] - y_px[first]
    length = np.maximum(np.hypot(dx, dy), 1e-6)
    off_x, off_y = x_px[:, None] - x_px[first], y_px[:, None] - y_px[first]
    is_on = np.abs(off_x * dy - off_y * dx) < reach_px * length
    on = is_on[:, int(np.argmax(is_on.sum(axis=0)))]
    most = np.count_nonzero(on)
    return on if most >= MIN_POINTS and 2 * most > count else none


def _oblong(
    found: StarMoments,
    is_good: BoolArray,
    is_saturated: BoolArray,
    fwhm_px: float | FloatArray,
    shape: tuple[int, ...],
) -> OblongLights:
    """Lights surely longer than the frame's stars and no sharper.

    Guiding or coma may draw all of them out a little. A star that the frame's rim cuts is longer
    than wide, too. ``fwhm_px``: of a star, one for all or one for each place.
    """
    typical = float(np.median(found.axis_ratio[is_good])) if is_good.any() else 1.0
    ratio = found.axis_ratio / max(typical / _ROUND, 1.0)
    is_long = (found.snr > _OBLONG_SNR) & (ratio > _OBLONG) & ~is_saturated
    is_long &= (found.peak_share < _MAX_PEAK_SHARE) & (found.fwhm_px > _SHARPEST * fwhm_px)
    width_px = np.broadcast_to(np.asarray(fwhm_px, dtype=np.float64), ratio.shape)
    for place, side in ((found.x_px, shape[1]), (found.y_px, shape[0])):
        is_long &= (place > _RIM_FWHM * width_px) & (place < side - 1 - _RIM_FWHM * width_px)
    kept = np.flatnonzero(is_long)
    # What is bright enough for its shape to be seen is no surer for being brighter.
    seen = np.minimum(found.snr[kept], _SHAPE_SEEN_SNR)
    longer = np.minimum(ratio[kept], _MAX_RATIO) - 1.0
    kept = kept[np.argsort(-longer * seen, kind="stable")]
    apart_px = float(np.median(width_px)) if width_px.size else 0.0
    kept = _apart(found, kept, apart_px)[:MAX_OBLONG]
    return OblongLights(
        x_px=found.x_px[kept],
        y_px=found.y_px[kept],
        angle_deg=found.angle_deg[kept],
        half_px=_HALF_FWHM * width_px[kept],
        snr=found.snr[kept],
    )


def _is_point(found: StarMoments, is_saturated: BoolArray) -> BoolArray:
    ok = (found.snr >= MIN_SNR) & (found.flux > 0) & np.isfinite(found.x_px + found.y_px)
    ok &= (found.axis_ratio < _MAX_AXIS_RATIO) | is_saturated
    ok &= (found.peak_share < _MAX_PEAK_SHARE) | is_saturated
    return np.asarray(ok)


def _apart(found: StarMoments, kept: IndexArray, distance_px: float) -> IndexArray:
    """Drop the fainter of two centroids that are the same star; ``kept`` is brightest first."""
    x_px, y_px = found.x_px[kept], found.y_px[kept]
    order = np.argsort(x_px, kind="stable")
    is_double = np.zeros(kept.size, dtype=bool)
    for step in range(1, 9):
        a, b = order[:-step], order[step:]
        close = np.hypot(x_px[a] - x_px[b], y_px[a] - y_px[b]) < distance_px
        is_double[np.maximum(a, b)[close]] = True
    return kept[~is_double]
