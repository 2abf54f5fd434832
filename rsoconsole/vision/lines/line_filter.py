"""Matched line filter: straight lines too faint or too long for the network's map.

The frame is divided into cells of a few pixels, and the light of each is limited so that a star
counts little. Light is summed along every straight line of 2^k rows (or columns) of cells by the
approximate discrete Radon transform (Brady, SIAM J. Comput. 27, 1998), whose partial sums are lines
of every length (Nir, Zackay & Ofek, AJ 156:229, 2018). For each sum above its threshold the ends of
the line are found; the line's light is then removed, so that it adds nothing to the next line.
"""

import math
from collections import Counter
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.vision.arrays import Float32Array, IndexArray
from rsoconsole.vision.frame.background import Background, resample
from rsoconsole.vision.frame.bins import CELL_PX, median_5x5, perpendicular_line_masks
from rsoconsole.vision.frame.median import median_of
from rsoconsole.vision.lines._line_seeds import LineSeeds, find_seeds, sum_threshold_sigma
from rsoconsole.vision.lines.segments import Ends, length_of, midpoint_of
from rsoconsole.vision.stars.star_list import StarList, lit_radius_px

MIN_SNR = 5.0
"""Least signal to noise of a whole traced line, by the cells' own scatter."""
MAX_LINES = 56
FINEST_PX, _MAX_CELLS = 4, 300_000
_SHORTEST_FWHM = 4.5
_MAX_SEEDS, _MAX_TRACED = 300, 12
_SMALLEST = 1e-9
_LIMIT, _MOST = 2.0, 6.0
"""Limits of a cell, in sigma: for light of no line, and for light of a line."""
_SURELY_LIGHT, _NO_LINE = 4.5, 1.2
"""Sigma of a cell that is a star, and counts as 0, where any line's light is below the second."""
_MAX_GAP, _MIN_GAP, _DARK = 0.3, 6, 0.15
"""Limits of a gap: longest dark share of a streak, least cells, share of level that is dark."""
_OF_A_BAND = 0.6
"""Side of the cells in which a band is one or two cells wide, over its width."""
_MIN_COARSE = 8
_SMOOTHED, _SMOOTHED_NOISE = 0.6, 0.655
"""Sigma of the smoothing, in cells, and noise of a line's sum after it, for 1 sigma a cell."""
_STILL_THERE = 0.7
_REACH = 2
"""Cells to either side of a line that are searched for its course."""
_ACROSS = np.arange(-_REACH, _REACH + 1, dtype=np.float64)[:, None]
_CHUNKS = 8
_MAX_PARTS, _LIT_SHARE, _MIN_LIT = 16, 0.4, 3.0
"""Number of parts of a sum, least share of it in middling ones, least sigma if all were so."""
_BEYOND = 12.0
_LIT = 0.4


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
    sky: Background, squares: Float32Array, side_px: int, stars: StarList
) -> list[CellLine]:
    """Find lines in a frame, in its pixels (0: centre of the first), strongest first.

    ``squares``: means of squares of ``side_px`` (``bins.bin_frame``). The light of ``stars`` is
    masked. Where drift has drawn out the stars, lines found in coarser cells follow the others,
    strongest first again.
    """
    rows, columns = squares.shape
    per_cell = sky.cell_px // side_px
    cells = squares - resample(sky.level, per_cell, rows, columns)
    noise = resample(sky.noise, per_cell, rows, columns)
    cells *= np.divide(np.float32(side_px), noise, out=noise)
    cells = limited_snr(cells)
    cells -= _around(cells, FINEST_PX // side_px)
    _cover(cells, side_px, stars, median_of(sky.noise))
    found = [(line, side_px) for line in find_lines(cells)]
    # What draws the stars out may draw a streak out as far, to a band.
    coarser = 0 if stars.trail is None else round(_OF_A_BAND * stars.trail.length_px / side_px)
    if 1 < coarser <= min(cells.shape) // _MIN_COARSE:
        found += [(line, side_px * coarser) for line in find_lines(_coarse(cells, coarser))]
    return [
        replace(
            line,
            x_a=line.x_a * side - 0.5,
            y_a=line.y_a * side - 0.5,
            x_b=line.x_b * side - 0.5,
            y_b=line.y_b * side - 0.5,
        )
        for line, side in found
        if math.hypot(line.x_b - line.x_a, line.y_b - line.y_a) * side
        > _SHORTEST_FWHM * _star_fwhm_px(line, side, stars)
    ]


def _coarse(cells: Float32Array, times: int) -> Float32Array:
    """Enlarge the cells by a factor, with the same noise; cells covered by a star count as sky."""
    import cv2

    rows, columns = (side // times for side in cells.shape)
    whole = cells[: rows * times, : columns * times]
    means = cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA)
    # What is left of a star counts no more than in the finer ones.
    return np.asarray(np.clip(means * np.float32(times), -_LIMIT, _MOST))


def _star_fwhm_px(line: CellLine, side_px: int, stars: StarList) -> float:
    """Width of a star at the middle of a line in cells, px."""
    x, y = 0.5 * (line.x_a + line.x_b), 0.5 * (line.y_a + line.y_b)
    return stars.fwhm_at(x * side_px - 0.5, y * side_px - 0.5)


def _around(cells: Float32Array, finer: int) -> Float32Array:
    """Median about every cell, of 5 x 5 of the usual size, which are larger by a factor.

    As wide as the stars are, whatever the cells: a streak is never most of it.
    """
    import cv2

    if finer <= 1:
        return median_5x5(cells)
    rows, columns = cells.shape
    coarse = (-(-columns // finer), -(-rows // finer))
    level = median_5x5(cv2.resize(cells, coarse, interpolation=cv2.INTER_AREA))
    return np.asarray(cv2.resize(level, (columns, rows), interpolation=cv2.INTER_LINEAR))


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


def limited_snr(cells: Float32Array) -> Float32Array:
    """Limit the signal to noise of cells, (rows, columns), so that stars count little.

    The limit is ``_LIMIT`` except on lines. A line is the difference of morphological openings
    along and across one of eight directions: nothing is left of a star, but a light five cells long
    in one direction only stays. There the limit is that difference, ``_MOST`` at most. Bright cells
    with hardly any line are stars and become 0.
    """
    import cv2

    line, opened, other = np.zeros_like(cells), np.empty_like(cells), np.empty_like(cells)
    for along, across in perpendicular_line_masks():
        for kernel, out in ((along, opened), (across, other)):
            cv2.morphologyEx(cells, cv2.MORPH_OPEN, kernel, out, borderType=cv2.BORDER_REFLECT_101)
        cv2.max(line, cv2.absdiff(opened, other, other), line)
    is_star = (cells > _SURELY_LIGHT) & (line < _NO_LINE)
    # One limit after the other: numpy clips at arrays several times slower.
    np.minimum(np.maximum(line, _LIMIT, out=line), _MOST, out=line)
    limited = np.maximum(np.minimum(cells, line, out=line), -_LIMIT, out=line)
    limited[is_star] = 0.0
    return limited


def find_lines(cells: Float32Array) -> list[CellLine]:
    """Find lines in a map of limited signal to noise, (rows, columns), strongest first.

    Mean and scatter are measured on the cells themselves, except those set to 0 (stars), since both
    contain the faint stars that long sums add up.
    """
    import cv2

    is_open = cells != 0.0
    shown = cells[is_open]
    scatter = float(shown.std()) if shown.size else 0.0
    if scatter <= 0.0:
        return []
    left = cells - np.float32(shown.mean())
    left /= np.float32(scatter)
    left[~is_open] = 0.0
    # A line between two cells, or where the sums' own course is a cell beside it, counts more so.
    smooth = cv2.GaussianBlur(left, (3, 3), _SMOOTHED)
    smooth /= np.float32(_SMOOTHED_NOISE)
    seeds = find_seeds(smooth)
    lit = [
        seed
        for rows in np.unique(seeds.rows).tolist()
        for seed in _lit_all_along(smooth, seeds, rows)
    ]
    found: list[CellLine] = []
    traced: Counter[tuple[int, bool]] = Counter()
    for seed in sorted(lit, key=lambda each: -each.middling_snr):
        # In a field of stars thousands of short sums stand out, and bad columns are long: all that
        # is alike has its share.
        kind = seed.rows, seed.is_straight
        if traced[kind] == _MAX_TRACED:
            continue
        snr = float(smooth.take(seed.cells).sum()) / math.sqrt(seed.rows)
        if snr < max(_STILL_THERE * seed.snr, sum_threshold_sigma(seed.rows)):
            continue
        traced[kind] += 1
        line = _traced(left, seed.ends)
        if line is not None:
            _erase(left, line)
            _erase(smooth, line)
            if line.snr > MIN_SNR:
                found.append(line)
        if len(found) == MAX_LINES:
            break
    return sorted(found, key=lambda line: -line.snr)


class _LitSeed(NamedTuple):
    """Sum along a straight line of cells whose light is not that of a few bright places."""

    middling_snr: float
    """Signal to noise that its middling parts give the whole."""
    snr: float
    rows: int
    is_straight: bool
    ends: Ends
    cells: IndexArray
    """Its cells inside the map, counted row by row."""


def _lit_all_along(cells: Float32Array, seeds: LineSeeds, rows: int) -> list[_LitSeed]:
    """Sums of one length that are lit all along; of many of a kind those with the most light."""
    alike = seeds.rows == rows
    snr, ends = seeds.snr[alike], seeds.ends[alike]
    is_straight = (ends[:, :2] == ends[:, 2:]).any(axis=1)
    order = np.argsort(-snr, kind="stable")
    kinds = dict.fromkeys(is_straight.tolist())
    best = np.concatenate([order[is_straight[order] == kind][:_MAX_SEEDS] for kind in kinds])
    snr, first, last = snr[best], ends[best, :2], ends[best, 2:]
    along = np.arange(rows) / (rows - 1)
    path = np.rint(first[..., None] + (last - first)[..., None] * along).astype(np.intp)
    inside = np.minimum(np.maximum(path, 0), np.array(cells.shape[::-1])[:, None] - 1)
    is_in = (path == inside).all(axis=1)
    places = inside[:, 1] * cells.shape[1] + inside[:, 0]
    parts = cells.take(places).reshape(len(best), min(max(rows // 2, 4), _MAX_PARTS), -1)
    parts = np.sort(parts.mean(axis=2), axis=1)
    middle = parts.shape[1] // 2
    middling = 0.5 * (parts[:, middle - 1] + parts[:, middle]) * math.sqrt(rows)
    is_lit = middling > np.maximum(_LIT_SHARE * snr, _MIN_LIT)
    return [
        _LitSeed(
            float(middling[i]),
            float(snr[i]),
            rows,
            bool(is_straight[best[i]]),
            (*first[i].tolist(), *last[i].tolist()),
            places[i, is_in[i]],
        )
        for i in np.flatnonzero(is_lit).tolist()
    ]


def _traced(cells: Float32Array, ends: Ends) -> CellLine | None:
    """Trace the lit stretch of a seed's line, which may go on beyond it, along the light itself."""
    x, y = midpoint_of(ends)
    half = 0.5 * length_of(ends) + 0.5
    angle = math.atan2(ends[3] - ends[1], ends[2] - ends[0])
    snr = 0.0
    for _ in range(3):
        about = _about(cells, x, y, angle, half)
        if about is None or about[0].size < 3:
            return None
        offset, slope = _course(*about)
        x, y = x - offset * math.sin(angle), y + offset * math.cos(angle)
        angle += math.atan(slope)
        stretch = _stretch(cells, x, y, angle, half)
        if stretch is None:
            return None
        snr, u_a, u_b = stretch
        x, y = x + 0.5 * (u_a + u_b) * math.cos(angle), y + 0.5 * (u_a + u_b) * math.sin(angle)
        half = 0.5 * (u_b - u_a)
    dx, dy = half * math.cos(angle), half * math.sin(angle)
    # From the first cell's middle to its edge.
    return CellLine(x_a=x - dx + 0.5, y_a=y - dy + 0.5, x_b=x + dx + 0.5, y_b=y + dy + 0.5, snr=snr)


def _about(
    cells: Float32Array, x: float, y: float, angle: float, reach: float
) -> tuple[FloatArray, Float32Array] | None:
    """Values (u, light at every offset across), a cell's length apart, within the map."""
    import cv2

    dx, dy = math.cos(angle), math.sin(angle)
    height, width = cells.shape
    low, high = -reach, reach
    for start, rate, size in ((x, dx, width), (y, dy, height)):
        if abs(rate) > 1e-9:
            ends = sorted((-start / rate, (size - 1 - start) / rate))
            low, high = max(low, ends[0]), min(high, ends[1])
        elif not 0.0 <= start <= size - 1:
            return None
    if high - low < 2.0:
        return None
    u = np.arange(math.ceil(low), math.floor(high) + 1, dtype=np.float64)
    columns = (x + dx * u - dy * _ACROSS).astype(np.float32)
    rows = (y + dy * u + dx * _ACROSS).astype(np.float32)
    light = cv2.remap(cells, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return u, np.asarray(light, dtype=np.float32)


def _course(u: FloatArray, light: Float32Array) -> tuple[float, float]:
    """Offset and slope of the light along a line, from its middles in a few chunks."""
    starts, sizes, middles_of_chunks = _chunks(u.size)
    across = np.add.reduceat(light, starts, axis=1) / sizes
    across = np.maximum(across - np.sort(across, axis=0)[1], 0.0)
    weight = across.sum(axis=0)
    total = float(weight.sum())
    if total <= 0.0:
        return 0.0, 0.0
    middles = _ACROSS[:, 0] @ across / np.maximum(weight, _SMALLEST)
    places = u[0] + middles_of_chunks
    middle, offset = float(weight @ places) / total, float(weight @ middles) / total
    away = places - middle
    spread = float(weight @ away**2)
    slope = 0.0 if starts.size < 2 or spread <= 0.0 else float(weight @ (middles * away)) / spread
    offset -= slope * middle
    # No further than the window shows.
    most = _REACH / max(-u[0], u[-1], 1.0)
    return min(max(offset, -_REACH), _REACH), min(max(slope, -most), most)


@lru_cache(maxsize=256)
def _chunks(count: int) -> tuple[IndexArray, IndexArray, FloatArray]:
    """Starts, sizes and middles of a few chunks of ``count`` places, about as long."""
    chunks = max(1, min(_CHUNKS, count // 4))
    bounds = np.arange(chunks + 1) * count // chunks
    return bounds[:-1], bounds[1:] - bounds[:-1], (bounds[:-1] + bounds[1:] - 1) / 2


def _stretch(
    cells: Float32Array, x: float, y: float, angle: float, half: float
) -> tuple[float, float, float] | None:
    """Find (snr, u_a, u_b) of the stretch of a line with most light above its level's share."""
    about = _about(cells, x, y, angle, 2.0 * half + _BEYOND)
    if about is None:
        return None
    u, light = about
    profile = (light[_REACH - 1] + 2.0 * light[_REACH] + light[_REACH + 1]) * 0.5
    inside = profile[np.abs(u) <= half]
    level = float(inside.sum() / max(inside.size, 1))
    if level <= 0.0:
        return None
    total = _running_sum(np.minimum(profile, 2.0 * level) - _LIT * level)
    end = int(np.argmax(total - np.minimum.accumulate(total)))
    start = int(np.argmin(total[: end + 1]))
    if end - start < 2:
        return None
    start, end = _without_gap(profile, start, end, level)
    snr = float(light[_REACH, start:end].sum()) / math.sqrt(end - start) / _INTERPOLATED
    return snr, float(u[start]) - 0.5, float(u[end - 1]) + 0.5


def _running_sum(values: Float32Array) -> FloatArray:
    """Sums of the values before every place: (n + 1,), first 0."""
    total = np.zeros(values.size + 1)
    total[1:] = np.cumsum(values)
    return total


def _without_gap(profile: Float32Array, start: int, end: int, level: float) -> tuple[int, int]:
    """Stretch, or the brighter of its parts where much between them is dark: two streaks."""
    most = int(_MAX_GAP * (end - start))
    if most < _MIN_GAP:
        return start, end
    # Mean light of every window as long as the longest gap that one streak may have.
    total = _running_sum(np.minimum(np.maximum(profile[start:end], -level), 2.0 * level))
    means = (total[most:] - total[:-most]) / most
    darkest = int(np.argmin(means))
    lit = (float(total[-1]) - float(means[darkest]) * most) / (end - start - most)
    if means[darkest] > _DARK * lit:
        return start, end
    first, second = float(total[darkest]), float(total[-1] - total[darkest + most])
    return (start, start + darkest) if first > second else (start + darkest + most, end)


_INTERPOLATED = 0.75
"""Sigma of a place between cells, on average over them."""


def _erase(cells: Float32Array, line: CellLine) -> None:
    """Remove the light about a line, a cell and a half to either side."""
    import cv2

    x_a, y_a, x_b, y_b = (int(at) for at in (line.x_a, line.y_a, line.x_b, line.y_b))
    cv2.line(cells, (x_a, y_a), (x_b, y_b), 0.0, 3, cv2.LINE_8)
