"""Matched line filter: straight lines too faint or too long for the network's map.

The frame is divided into cells no wider than a star; light of listed and of other bright points is
removed, the rest is limited so that a point counts little. Light is summed along every straight
line of 2^k rows (or columns) of cells by the approximate discrete Radon transform (Brady, SIAM J.
Comput. 27, 1998), whose partial sums are lines of every length (Nir, Zackay & Ofek, AJ 156:229,
2018). Each sum above its threshold is moved, turned, and cut or prolonged until the light along it
stands out most; of those that lie on one another the best is left.
"""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.vision.arrays import BoolArray, Float32Array, IndexArray
from rsoconsole.vision.frame.background import Background, resample
from rsoconsole.vision.frame.bins import CELL_PX, perpendicular_line_masks
from rsoconsole.vision.frame.median import median_of
from rsoconsole.vision.frame.workers import CALLER_ALONE, Workers
from rsoconsole.vision.lines._line_seeds import find_seeds
from rsoconsole.vision.stars.star_list import StarList, lit_radius_px
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA

MIN_SNR = 5.5
"""Least signal to noise of a line, by the cells' own scatter."""
MAX_LINES = 64
FINEST_PX, _MAX_CELLS = 4, 300_000
_SHORTEST_FWHM = 4.5
_MAX_SEEDS = 4000
_LIMIT, _MOST = 3.0, 12.0
"""Limits of a cell's signal to noise: where lines are summed, and where points are looked for."""
_CODES = 12.0
"""Steps of a byte in one sigma."""
_POINT, _OF_LINE = 4.5, 0.3
"""Sigma of a cell that is a star where any line's light is below this share of it."""
_LEVEL_CELLS, _CALM_STEP, _CALM_SQUARES = 8, 4, 16
"""Sides of the squares that give a level, and a scatter, in cells; and how many of these count."""
_OF_A_BAND = 0.6
"""Side of the cells in which a band is one or two cells wide, over its width."""
_MIN_COARSE = 8
_SAMPLES, _BINS = 48, 24
_STRETCHES = (4, 5, 6, 7, 8, 10, 12, 14, 16, 18, 20, 22, 24, 27, 30, 34, 38, 42, 48, 56, 64, 72)
"""Lengths tried for the lit stretch, in parts of a seed's length over ``_BINS``."""
_CLASSES = 3
_ON_LINE_CELLS, _TURN = 2.5, 0.35
_MORE_LIGHT, _MORE_SIGMA = 1.3, 2.5
"""SNR of a piece over what even light would have there, from which it may be a line of its own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CellLine:
    """Line of light by its ends, in cells (0: left edge of the first cell) or in pixels."""

    x_a: float
    y_a: float
    x_b: float
    y_b: float
    snr: float
    """Signal to noise of the light along the line, each cell's light limited."""
    is_light: bool = False
    """True for a light of the star search (``short_lines``), False for a sum along cells."""


def cell_side_px(height: int, width: int, finest_px: int = FINEST_PX) -> int:
    """Return the side of the cells, px: ``finest_px``, doubled while cells are too many."""
    side = finest_px
    while height * width > _MAX_CELLS * side**2 and side < CELL_PX:
        side *= 2
    return side


def propose_lines(
    sky: Background,
    squares: Float32Array,
    side_px: int,
    stars: StarList,
    workers: Workers = CALLER_ALONE,
) -> list[CellLine]:
    """Find lines in a frame, in its pixels (0: centre of the first), most promising first.

    ``squares``: means of squares of ``side_px`` (``bins.bin_frame``). The light of ``stars`` is
    masked. Where drift has drawn out the stars, lines found in coarser cells follow the others,
    most promising first again.
    """
    rows, columns = squares.shape
    per_cell = sky.cell_px // side_px
    cells = squares - resample(sky.level, per_cell, rows, columns)
    noise = resample(sky.noise, per_cell, rows, columns)
    cells *= np.divide(np.float32(side_px), noise, out=noise)
    cells = snr_without_points(cells, stars.median_fwhm_px / side_px)
    _cover(cells, side_px, stars, median_of(sky.noise))
    found = [(line, side_px) for line in find_lines(cells, workers)]
    # What draws the stars out may draw a streak out as far, to a band.
    coarser = 0 if stars.trail is None else round(_OF_A_BAND * stars.trail.length_px / side_px)
    if 1 < coarser <= min(cells.shape) // _MIN_COARSE:
        found += [
            (line, side_px * coarser) for line in find_lines(_coarse(cells, coarser), workers)
        ]
    return [
        CellLine(
            x_a=line.x_a * side - 0.5,
            y_a=line.y_a * side - 0.5,
            x_b=line.x_b * side - 0.5,
            y_b=line.y_b * side - 0.5,
            snr=line.snr,
        )
        for line, side in found
        if math.hypot(line.x_b - line.x_a, line.y_b - line.y_a) * side
        > _SHORTEST_FWHM * _star_fwhm_px(line, side, stars)
    ]


def snr_without_points(cells: Float32Array, fwhm_cells: float) -> Float32Array:
    """Smooth, level and limit a map of signal to noise (rows, columns) so that points count little.

    Smoothed so that cell and smoothing together are as wide as a star. Bright cells with hardly any
    line through them are stars and become 0. A line is the difference of morphological openings
    along and across one of eight directions: nothing is left of a star.
    """
    import cv2

    np.minimum(np.maximum(cells, -0.5 * _MOST, out=cells), _MOST, out=cells)
    # A cell and the steps of a sum across cells blur by a quarter of its side squared.
    sigma = math.sqrt(max((fwhm_cells / FWHM_PER_SIGMA) ** 2 - 0.25, 0.0625))
    smooth = cv2.GaussianBlur(cells, (0, 0), sigma)
    sample = smooth[::5, ::5]
    level = median_of(sample)
    smooth -= np.float32(level)
    smooth /= np.float32(max(1.4826 * median_of(np.abs(sample - level)), 1e-6))
    np.maximum(smooth, -0.5 * _MOST, out=smooth)
    # In bytes: OpenCV is several times faster at them.
    coded = cv2.convertScaleAbs(smooth, alpha=_CODES, beta=0.5 * _MOST * _CODES)
    line, opened, other = np.zeros_like(coded), np.empty_like(coded), np.empty_like(coded)
    for along, across in perpendicular_line_masks():
        for kernel, out in ((along, opened), (across, other)):
            cv2.morphologyEx(coded, cv2.MORPH_OPEN, kernel, out, borderType=cv2.BORDER_REFLECT_101)
        cv2.max(line, cv2.absdiff(opened, other, other), line)
    is_point = (smooth > _POINT) & (line < _OF_LINE * _CODES * smooth)
    np.minimum(np.maximum(smooth, -_LIMIT, out=smooth), _LIMIT, out=smooth)
    smooth -= _around(smooth)
    smooth[cv2.dilate(is_point.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0] = 0.0
    return np.asarray(smooth)


def _around(cells: Float32Array) -> Float32Array:
    """Level about every cell: the median of 5 x 5 squares of some cells. A streak is never most."""
    import cv2

    rows, columns = cells.shape
    small = (-(-columns // _LEVEL_CELLS), -(-rows // _LEVEL_CELLS))
    level = cv2.medianBlur(cv2.resize(cells, small, interpolation=cv2.INTER_AREA), 5)
    return np.asarray(cv2.resize(level, (columns, rows), interpolation=cv2.INTER_LINEAR))


def _coarse(cells: Float32Array, times: int) -> Float32Array:
    """Enlarge the cells by a factor, with the same noise; cells covered by a star count as sky."""
    import cv2

    rows, columns = (side // times for side in cells.shape)
    whole = cells[: rows * times, : columns * times]
    means = cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA)
    # What is left of a star counts no more than in the finer ones.
    return np.asarray(np.clip(means * np.float32(times), -_LIMIT, _LIMIT))


def _star_fwhm_px(line: CellLine, side_px: int, stars: StarList) -> float:
    """Width of a star at the middle of a line in cells, px."""
    x, y = 0.5 * (line.x_a + line.x_b), 0.5 * (line.y_a + line.y_b)
    return stars.fwhm_at(x * side_px - 0.5, y * side_px - 0.5)


def _cover(cells: Float32Array, side_px: int, stars: StarList, noise: float) -> None:
    """Remove the light of listed stars."""
    import cv2

    room = lit_radius_px(stars, noise) / side_px + 0.5
    half, angle = 0.0, 0.0
    if stars.trail is not None:
        half, angle = 0.5 * stars.trail.length_px / side_px, math.radians(stars.trail.angle_deg)
    x, y = (stars.x_px + 0.5) / side_px - 0.5, (stars.y_px + 0.5) / side_px - 0.5
    dx, dy = half * math.cos(angle), half * math.sin(angle)
    # OpenCV draws on sixteenths of a cell.
    ends = np.rint(16.0 * np.stack([x - dx, y - dy, x + dx, y + dy], axis=1)).astype(int).tolist()
    radii = np.rint(16.0 * room).astype(int).tolist()
    for (x_a, y_a, x_b, y_b), radius in zip(ends, radii, strict=True):
        cv2.circle(cells, (x_a, y_a), radius, 0.0, -1, cv2.LINE_8, 4)
        if half:
            cv2.circle(cells, (x_b, y_b), radius, 0.0, -1, cv2.LINE_8, 4)
            cv2.line(cells, (x_a, y_a), (x_b, y_b), 0.0, max(radius // 8, 1), cv2.LINE_8, 4)


def find_lines(cells: Float32Array, workers: Workers = CALLER_ALONE) -> list[CellLine]:
    """Find lines in a map of limited signal to noise, (rows, columns), most promising first.

    The scatter is measured on the cells themselves, except those set to 0 (stars), since it holds
    the faint stars that long sums add up.
    """
    left = _at_one_scatter(cells)
    if left is None:
        return []
    ends, snr = find_seeds(left, workers)
    if len(snr) > _MAX_SEEDS:
        best = np.argsort(-snr)[:_MAX_SEEDS]
        ends = ends[best]
    ends, snr, worth = _refined(left, ends)
    is_clear = snr > MIN_SNR
    ends, snr, worth = ends[is_clear], snr[is_clear], worth[is_clear]
    chosen = _in_turn(_distinct(ends, snr, worth), ends)[:MAX_LINES]
    return [
        CellLine(x_a=x_a + 0.5, y_a=y_a + 0.5, x_b=x_b + 0.5, y_b=y_b + 0.5, snr=sure)
        for (x_a, y_a, x_b, y_b), sure in zip(
            ends[chosen].tolist(), snr[chosen].tolist(), strict=True
        )
    ]


def _at_one_scatter(cells: Float32Array) -> Float32Array | None:
    """The cells less their mean and over their scatter about each place; None where none is lit."""
    import cv2

    rows, columns = cells.shape
    small = (max(columns // _CALM_STEP, 1), max(rows // _CALM_STEP, 1))

    def about(values: Float32Array) -> Float32Array:
        means = cv2.resize(values, small, interpolation=cv2.INTER_AREA)
        side = (min(_CALM_SQUARES, small[0]), min(_CALM_SQUARES, small[1]))
        return np.asarray(cv2.blur(means, side))

    is_open = (cells != 0.0).astype(np.float32)
    share = np.maximum(about(is_open), np.float32(0.05))
    mean = about(cells) / share
    variance = about(cells * cells) / share - mean * mean
    typical = float(np.median(variance))
    if typical <= 0.0:
        return None
    scale = 1.0 / np.sqrt(np.maximum(variance, np.float32(0.25 * typical)))
    mean, scale = (
        cv2.resize(each, (columns, rows), interpolation=cv2.INTER_LINEAR) for each in (mean, scale)
    )
    left = cells - mean
    left *= scale
    left *= is_open
    return np.asarray(left)


def _along(cells: Float32Array, a: FloatArray, b: FloatArray, count: int) -> Float32Array:
    """Values at ``count`` places from a to b, (n, 2) each: (n, count); 0 outside the map."""
    import cv2

    t = (np.arange(count) + 0.5) / count
    x, y = ((a[:, k, None] + (b[:, k] - a[:, k])[:, None] * t).astype(np.float32) for k in (0, 1))
    parts = [
        cv2.remap(cells, x[i : i + 8192], y[i : i + 8192], cv2.INTER_LINEAR)
        for i in range(0, len(a), 8192)
    ]
    return np.concatenate(parts) if parts else np.zeros((0, count), dtype=np.float32)


def _refined(cells: Float32Array, seeds: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Move, turn, cut or prolong lines (n, 4) until their light stands out most.

    Returns their ends, their SNR, and the mean of that and of the SNR that the middling of their
    parts gives, which is low for a few stars in a row.
    """
    count, places = len(seeds), np.arange(len(seeds))
    a, b = seeds[:, :2].copy(), seeds[:, 2:].copy()
    way = b - a
    across = np.stack([-way[:, 1], way[:, 0]], axis=1)
    across /= np.maximum(np.hypot(*across.T), 1.0)[:, None]
    for step in (1.0, 0.5):
        tries = [(i * step, k * step) for i in (0, -1, 1) for k in (0, -1, 1)]
        light = np.stack(
            [_along(cells, a + i * across, b + k * across, _SAMPLES).mean(axis=1) for i, k in tries]
        )
        moved = np.array(tries)[light.argmax(axis=0)]
        a, b = a + moved[:, :1] * across, b + moved[:, 1:] * across
    way = b - a
    parts = _along(cells, a - way, b + way, 9 * _BINS).reshape(count, 3 * _BINS, 3).mean(axis=2)
    part_cells = np.hypot(*way.T) / _BINS
    total = np.zeros((count, 3 * _BINS + 1))
    np.cumsum(parts, axis=1, out=total[:, 1:])
    best, first, length = np.full(count, -np.inf), np.zeros(count, int), np.zeros(count, int)
    for each in _STRETCHES:
        means = (total[:, each:] - total[:, :-each]) / math.sqrt(each)
        start = means.argmax(axis=1)
        value = means[places, start]
        is_better = value > best
        best[is_better], first[is_better] = value[is_better], start[is_better]
        length[is_better] = each
    scale = np.sqrt(part_cells) / _sigma_of_lines(cells)
    inside = (np.arange(3 * _BINS) >= first[:, None]) & (
        np.arange(3 * _BINS) < (first + length)[:, None]
    )
    middling = np.nanmedian(np.where(inside, parts, np.nan), axis=1) if count else best
    snr = best * scale
    worth = 0.5 * (snr + middling * np.sqrt(length) * scale)
    low = (first / _BINS - 1.0)[:, None]
    high = ((first + length) / _BINS - 1.0)[:, None]
    return np.concatenate([a + low * way, a + high * way], axis=1), snr, worth


def _sigma_of_lines(cells: Float32Array) -> float:
    """Scatter of the light along lines anywhere, over the root of their length in cells."""
    rng = np.random.default_rng(1)
    height, width = cells.shape
    reach = 0.5 * min(40.0, height, width)
    middle = rng.uniform(0.0, 1.0, (1500, 2)) * np.array([width - 1.0, height - 1.0])
    angle = rng.uniform(0.0, 2.0 * math.pi, 1500)
    half = reach * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    light = _along(cells, middle - half, middle + half, 120).mean(axis=1) * math.sqrt(2.0 * reach)
    low, high = np.quantile(light, [0.16, 0.84])
    return max(0.5 * float(high - low), 1e-6)


def _distinct(ends: FloatArray, snr: FloatArray, worth: FloatArray) -> IndexArray:
    """Indices of the lines that lie on no better one, best first.

    A piece with much more than its share of a line's light stays: it may be one of several in a
    row.
    """
    middle, way = 0.5 * (ends[:, :2] + ends[:, 2:]), ends[:, 2:] - ends[:, :2]
    length = np.maximum(np.hypot(*way.T), 1.0)
    way = way / length[:, None]
    is_free: BoolArray = np.ones(len(ends), dtype=bool)
    kept = []
    for i in np.argsort(-worth).tolist():
        if not is_free[i]:
            continue
        kept.append(i)
        if len(kept) == 6 * MAX_LINES:
            break
        off = middle - middle[i]
        along = np.abs(off @ way[i])
        across = np.abs(off[:, 1] * way[i, 0] - off[:, 0] * way[i, 1])
        turn = np.abs(way[:, 0] * way[i, 1] - way[:, 1] * way[i, 0])
        share = snr[i] * np.sqrt(np.minimum(length / length[i], 1.0))
        is_free &= (
            (along > 0.5 * length[i] + 2.0)
            | (across - 0.5 * length[i] * turn > _ON_LINE_CELLS)
            | (turn > _TURN)
            | (snr > np.maximum(_MORE_LIGHT * share, share + _MORE_SIGMA))
        )
    return np.array(kept, dtype=np.intp)


def _in_turn(chosen: IndexArray, ends: FloatArray) -> IndexArray:
    """The best of the short, the middling and the long in turn: stars in a row are mostly short."""
    length = np.hypot(*(ends[chosen, 2:] - ends[chosen, :2]).T)
    kind = np.clip(np.floor(np.log2(np.maximum(length, 1.0) / 16.0)), 0, _CLASSES - 1)
    place = np.zeros(len(chosen), dtype=np.intp)
    for each in range(_CLASSES):
        place[kind == each] = np.arange(np.count_nonzero(kind == each))
    return chosen[np.argsort(place, kind="stable")]
