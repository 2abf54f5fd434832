"""First guesses about a streak in a proposed box: the pixels to look at, its line, its ends."""

from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.arrays import BoolArray, Float32Array, IndexArray
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.frame.median import median_of
from rsoconsole.vision.lines.segments import Box, Ends
from rsoconsole.vision.stars.star_list import StarList, lit_radius_px

_SMALL_BOX_PX = 40.0
_BOX_ERROR_PX = 12.0
_OFFSETS_PX = 10.0
_WINDOW = 5
_PARTS = 6
_ISLAND = 14
_MAX_BINS = 600
_FLICKER_SHARE = 0.06
_CLIP = (-1.5, 4.0)
"""Limits of the smoothed signal to noise, so that a star in the way counts little."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cutout:
    """Part of a frame about a proposal, sky subtracted."""

    x0: int
    y0: int
    values: FloatArray
    """(h, w) light above the sky, ADU."""
    is_good: BoolArray
    """(h, w) False where a star is masked."""
    noise: float
    """One sigma of a pixel, ADU."""
    frame_width: int
    frame_height: int


@dataclass(frozen=True, slots=True, kw_only=True)
class LineGuess:
    """First guess of a line through the cutout: a point in raw pixels and a unit vector."""

    x_px: float
    y_px: float
    dx: float
    dy: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LitPart:
    """Part of a guessed line that is lit; u is the distance along the line from its point, px."""

    u_a: float
    u_b: float
    amplitudes: tuple[float, ...]
    """ADU per pixel of length in equal parts of the stretch, first to last."""
    matched_snr: float
    """Approximate signal to noise of the stretch, matched across."""
    lit_share: float
    """Share of the stretch's length lit at more than a quarter of the amplitude."""
    dark_u: tuple[float | None, float | None]
    """u of a short dark gap near either end: the light beyond it may be a star."""
    reaches_rim: bool
    """True where the stretch runs into the cutout's edge: a larger cutout is needed."""


def cut_out(
    pixels: PixelArray, sky: Background, box: Box, margin_px: float, stars: StarList | None
) -> Cutout:
    """Cut ``box``, grown by ``margin_px`` on each side, out of a frame, and subtract the sky.

    Pixels lit by ``stars`` are masked.
    """
    height, width = pixels.shape
    x0, x1 = _range(box[0] - margin_px, box[2] + margin_px, width)
    y0, y1 = _range(box[1] - margin_px, box[3] + margin_px, height)
    level = _level_at(sky, np.arange(y0, y1), np.arange(x0, x1))
    values = pixels[y0:y1, x0:x1].astype(np.float64) - level
    cells = sky.noise[
        y0 // sky.cell_px : y1 // sky.cell_px + 1, x0 // sky.cell_px : x1 // sky.cell_px + 1
    ]
    is_good = np.ones(values.shape, dtype=bool)
    noise = median_of(cells)
    if stars is not None:
        _mask_stars(is_good, x0, y0, stars, noise)
    return Cutout(
        x0=x0,
        y0=y0,
        values=values,
        is_good=is_good,
        noise=noise,
        frame_width=width,
        frame_height=height,
    )


def _range(low: float, high: float, size: int) -> tuple[int, int]:
    start = int(np.clip(np.floor(low), 0, max(size - 16, 0)))
    return start, int(np.clip(np.ceil(high) + 1, min(start + 16, size), size))


def _level_at(sky: Background, ys: IndexArray, xs: IndexArray) -> FloatArray:
    """Sky level between cell centres, linear, (len(ys), len(xs))."""
    rows = np.clip((ys + 0.5) / sky.cell_px - 0.5, 0, sky.level.shape[0] - 1)
    columns = np.clip((xs + 0.5) / sky.cell_px - 0.5, 0, sky.level.shape[1] - 1)
    r0, c0 = np.floor(rows).astype(int), np.floor(columns).astype(int)
    r1 = np.minimum(r0 + 1, sky.level.shape[0] - 1)
    c1 = np.minimum(c0 + 1, sky.level.shape[1] - 1)
    fr, fc = (rows - r0)[:, None], (columns - c0)[None, :]
    level = sky.level.astype(np.float64)
    upper = level[r0][:, c0] * (1 - fc) + level[r0][:, c1] * fc
    lower = level[r1][:, c0] * (1 - fc) + level[r1][:, c1] * fc
    return np.asarray(upper * (1 - fr) + lower * fr)


def _mask_stars(is_good: BoolArray, x0: int, y0: int, stars: StarList, noise: float) -> None:
    """Mark as bad every pixel that a listed star still lights by half a sigma."""
    height, width = is_good.shape
    half_trail = 0.5 * stars.trail.length_px if stars.trail is not None else 0.0
    angle = np.radians(stars.trail.angle_deg) if stars.trail is not None else 0.0
    room = 40.0 + half_trail
    near = (stars.x_px > x0 - room) & (stars.x_px < x0 + width + room)
    near &= (stars.y_px > y0 - room) & (stars.y_px < y0 + height + room)
    radii = lit_radius_px(stars, noise)
    for i in np.flatnonzero(near):
        radius = radii[i]
        cx, cy = stars.x_px[i] - x0, stars.y_px[i] - y0
        reach_x = radius + half_trail * abs(np.cos(angle))
        reach_y = radius + half_trail * abs(np.sin(angle))
        ya, yb = max(0, int(cy - reach_y)), min(height, int(cy + reach_y) + 2)
        xa, xb = max(0, int(cx - reach_x)), min(width, int(cx + reach_x) + 2)
        if ya >= yb or xa >= xb:
            continue
        yy, xx = np.mgrid[ya:yb, xa:xb]
        dx, dy = xx - cx, yy - cy
        if half_trail:
            along = dx * np.cos(angle) + dy * np.sin(angle)
            across = dy * np.cos(angle) - dx * np.sin(angle)
            beyond = np.maximum(np.abs(along) - half_trail, 0.0)
            is_good[ya:yb, xa:xb] &= beyond**2 + across**2 > radius**2
        else:
            is_good[ya:yb, xa:xb] &= dx**2 + dy**2 > radius**2


def find_line(
    cutout: Cutout, box: Box, psf_sigma: float, ends: Ends | None = None
) -> LineGuess | None:
    """Find the brightest line through the box; None where all lines lie outside the cutout.

    ``ends`` (x_a, y_a, x_b, y_b) narrows the search to directions near theirs; without it both
    diagonals of the box are tested, in a small box all directions.
    """
    smooth = _smooth_snr(cutout, psf_sigma)
    x0, y0, x1, y1 = ends or box
    length = max(float(np.hypot(x1 - x0, y1 - y0)), 6.0)
    centre = (0.5 * (x0 + x1) - cutout.x0, 0.5 * (y0 + y1) - cutout.y0)
    step = 1.5 / length
    if ends is None or length < _SMALL_BOX_PX / 2:
        angles = _fan(x1 - x0, y1 - y0, length, step)
    else:
        spread = min(10.0 / length + 2 * step, np.pi / 4)
        angle = float(np.arctan2(y1 - y0, x1 - x0))
        angles = np.arange(angle - spread, angle + spread + step / 2, step)
    reach = min(_OFFSETS_PX, 4.0 + 0.1 * length)
    offsets = np.arange(-reach, reach + 0.5, 1.0)
    best = _best_line(np.clip(smooth, *_CLIP), centre, angles, offsets, 0.5 * length)
    if best is None:
        return None
    for spacing in (0.5, 0.125):
        # A bright streak is flat where it is clipped: look again with its own level as limit.
        level = median_of(_along(smooth, centre, *best, 0.5 * length))
        limited = np.clip(smooth, _CLIP[0], max(_CLIP[1], 1.5 * level))
        near = spacing * np.arange(-4.0, 5.0)
        found = _best_line(limited, centre, near * step + best[0], near + best[1], 0.5 * length)
        best = found or best
    dx, dy = float(np.cos(best[0])), float(np.sin(best[0]))
    return LineGuess(
        x_px=centre[0] + cutout.x0 - dy * best[1],
        y_px=centre[1] + cutout.y0 + dx * best[1],
        dx=dx,
        dy=dy,
    )


def _fan(width: float, height: float, length: float, step: float) -> FloatArray:
    """Directions that a box of this shape may hold, rad; all directions for a small box."""
    if max(width, height) < _SMALL_BOX_PX:
        return np.arange(0.0, np.pi, step)
    error = min(_BOX_ERROR_PX, 0.5 * length)
    flattest = np.arctan2(max(height - error, 0.0), width + error)
    steepest = np.arctan2(height + error, max(width - error, 0.0))
    up = np.arange(flattest, steepest + step, step)
    return np.concatenate([up, -up])


def _smooth_snr(cutout: Cutout, psf_sigma: float) -> Float32Array:
    """Signal to noise matched to the stars, by its own noise; 0 where a star is masked."""
    import cv2

    good = cutout.is_good.astype(np.float32)
    values = (cutout.values * good).astype(np.float32)
    total = cv2.GaussianBlur(values, (0, 0), psf_sigma)
    share = cv2.GaussianBlur(good, (0, 0), psf_sigma)
    gain = 2.0 * np.sqrt(np.pi) * psf_sigma / max(cutout.noise, 1e-9)
    return np.where(share > 0.3, total / np.maximum(share, 0.3) * gain, 0.0).astype(np.float32)


def _along(
    smooth: Float32Array,
    centre: tuple[float, float],
    angle: float,
    offset: float,
    half_length: float,
) -> Float32Array:
    """Samples of one line, nearest pixels; 0 outside."""
    u = np.arange(-half_length, half_length + 0.1, 1.5)
    x = centre[0] + np.cos(angle) * u - np.sin(angle) * offset
    y = centre[1] + np.sin(angle) * u + np.cos(angle) * offset
    column, row = np.rint(x).astype(np.int32), np.rint(y).astype(np.int32)
    inside = (column >= 0) & (column < smooth.shape[1]) & (row >= 0) & (row < smooth.shape[0])
    values = np.zeros(u.size, dtype=np.float32)
    values[inside] = smooth[row[inside], column[inside]]
    return values


def _best_line(
    smooth: Float32Array,
    centre: tuple[float, float],
    angles: FloatArray,
    offsets: FloatArray,
    half_length: float,
) -> tuple[float, float] | None:
    """Return (angle, offset) whose samples are brightest on average; None where all lie outside."""
    height, width = smooth.shape
    u = np.arange(-half_length, half_length + 0.1, 1.5)
    cos, sin = np.cos(angles)[:, None, None], np.sin(angles)[:, None, None]
    x = centre[0] + cos * u - sin * offsets[:, None]
    y = centre[1] + sin * u + cos * offsets[:, None]
    column, row = np.rint(x).astype(np.int32), np.rint(y).astype(np.int32)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    if not inside.any():
        return None
    flat = np.where(inside, row * width + column, 0)
    score = (smooth.ravel()[flat] * inside).sum(axis=-1)
    i, j = np.unravel_index(int(np.argmax(score)), score.shape)
    return float(angles[i]), float(offsets[j])


def find_ends(cutout: Cutout, guess: LineGuess, psf_sigma: float) -> LitPart | None:
    """Find the lit part of a guessed line; None where no light stands out.

    It is the part with the largest sum of light above about half of the typical level. Light counts
    up to one and a half times that level, so that a bright piece does not pull the ends.
    """
    profile, is_known, noise, first = _profile(cutout, guess, psf_sigma)
    if np.count_nonzero(is_known) < 5:
        return None
    level = _typical_level(profile, is_known, noise)
    if level is None:
        return None
    capped = np.where(is_known, np.minimum(profile, 1.5 * level) - 0.45 * level, 0.0)
    smooth = _smoothed(np.where(is_known, profile, 0.0), is_known)
    a, b = _largest_sum(capped)
    a, b = _extended(smooth > max(0.1 * level, 2.0 * noise / np.sqrt(_WINDOW)), a, b)
    if np.count_nonzero(is_known[a : b + 1]) < 3:
        return None
    inside = smooth[a : b + 1]
    known = np.flatnonzero(is_known)
    parts = np.array_split(inside, min(_PARTS, inside.size))
    return LitPart(
        u_a=float(first + a) - 0.5,
        u_b=float(first + b) + 0.5,
        amplitudes=tuple(max(median_of(part), 0.05 * level) for part in parts),
        matched_snr=float(np.sqrt(inside.size) * np.mean(inside) / noise),
        lit_share=float(np.mean(inside > 0.25 * level)),
        dark_u=_gaps(np.where(is_known, profile, level)[a : b + 1], noise, first + a),
        reaches_rim=bool(a <= known[0] + 4 or b >= known[-1] - 4),
    )


def _smoothed(profile: FloatArray, is_known: BoolArray) -> FloatArray:
    """Running mean over the known bins of a few pixels; 0 where none is known."""
    window = np.ones(_WINDOW)
    count = np.convolve(is_known.astype(np.float64), window, mode="same")
    return np.asarray(np.convolve(profile, window, mode="same") / np.maximum(count, 1.0))


def _gaps(profile: FloatArray, noise: float, first: int) -> tuple[float | None, float | None]:
    """u of a dark gap within a few bins of either end of a stretch; None where there is none.

    Where the light flickers all along, a gap near an end says nothing.
    """
    calm = np.convolve(profile, np.ones(3) / 3.0, mode="same")
    if calm.size < 4 * _ISLAND:
        return None, None
    inside = calm[_ISLAND:-_ISLAND]
    if float(np.mean(inside < 0.6 * np.median(inside))) > _FLICKER_SHARE:
        return None, None
    a, b = _gap(calm, noise), _gap(calm[::-1], noise)
    return (
        None if a is None else float(first + a),
        None if b is None else float(first + calm.size - 1 - b),
    )


def _gap(calm: FloatArray, noise: float) -> int | None:
    """Index of the darkest bin near the start that has light on both sides."""
    inner = median_of(calm[_ISLAND : 3 * _ISLAND])
    dark = []
    for at in range(3, _ISLAND):
        side = min(float(calm[1:at].max()), inner)
        if calm[at] < 0.6 * side and side - calm[at] > 2.5 * noise / np.sqrt(3.0):
            dark.append(at)
    return min(dark, key=lambda at: float(calm[at])) if dark else None


def _extended(is_lit: BoolArray, a: int, b: int) -> tuple[int, int]:
    """Extend the stretch a..b by light without a gap on either side: a fading end is part of it."""
    while a > 0 and is_lit[a - 1]:
        a -= 1
    while b < is_lit.size - 1 and is_lit[b + 1]:
        b += 1
    # The running mean is lit half a window beyond the light itself.
    trim = _WINDOW // 2
    return (a + trim, b - trim) if b - a > 4 * trim else (a, b)


def _profile(
    cutout: Cutout, guess: LineGuess, psf_sigma: float
) -> tuple[FloatArray, BoolArray, float, int]:
    """Light per pixel of length, True where it is known, its typical noise, u of the first bin."""
    yy, xx = np.mgrid[0 : cutout.values.shape[0], 0 : cutout.values.shape[1]]
    x, y = xx + (cutout.x0 - guess.x_px), yy + (cutout.y0 - guess.y_px)
    u, v = x * guess.dx + y * guess.dy, y * guess.dx - x * guess.dy
    near = np.abs(v) < 3.0 * psf_sigma + 0.5
    if not near.any():
        return np.zeros(0), np.zeros(0, dtype=bool), cutout.noise, 0
    bins = np.rint(u[near]).astype(int)
    first = int(bins.min())
    across = np.exp(-0.5 * (v[near] / psf_sigma) ** 2) / (np.sqrt(2 * np.pi) * psf_sigma)
    good = cutout.is_good[near]
    count = int(bins.max()) - first + 1
    nominal = 1.0 / (2.0 * np.sqrt(np.pi) * psf_sigma)
    total = np.bincount(bins - first, across * cutout.values[near] * good, count)
    share = np.bincount(bins - first, across**2 * good, count)
    is_known = share > 0.4 * nominal
    profile = np.where(is_known, total / np.maximum(share, 1e-9), 0.0)
    return profile, is_known, float(cutout.noise / np.sqrt(nominal)), first


def _typical_level(profile: FloatArray, is_known: BoolArray, noise: float) -> float | None:
    """Mean of the stretch that is least likely to be plain sky; None when none stands out."""
    group = -(-profile.size // _MAX_BINS)
    if group > 1:
        size = profile.size // group * group
        count = is_known[:size].reshape(-1, group).sum(axis=1)
        total = np.where(is_known, profile, 0.0)[:size].reshape(-1, group).sum(axis=1)
        profile, is_known = total / np.maximum(count, 1), 2 * count > group
        noise /= float(np.sqrt(group))
    known = np.concatenate([[0.0], np.cumsum(is_known.astype(np.float64))])
    counts = np.maximum(known[None, :] - known[:, None], 1.0)
    is_short = np.tri(known.size, k=3, dtype=bool)
    level: float | None = None
    for _ in range(2):
        cap = 6.0 * noise if level is None else 1.5 * level
        capped = np.where(is_known, np.clip(profile, -3.0 * noise, max(cap, noise)), 0.0)
        total = np.concatenate([[0.0], np.cumsum(capped)])
        sums = np.maximum(total[None, :] - total[:, None], 0.0)
        gain = sums**2 / counts
        gain[is_short] = 0.0
        a, b = np.unravel_index(int(np.argmax(gain)), gain.shape)
        if gain[a, b] < (4.0 * noise) ** 2:
            return None
        values = profile[a:b][is_known[a:b]]
        level = median_of(values) if values.size else None
        if level is None or level <= 0:
            return None
    return level


def _largest_sum(values: FloatArray) -> tuple[int, int]:
    """First and last index of the stretch with the largest sum (Kadane)."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    lowest = np.minimum.accumulate(total)
    end = int(np.argmax(total[1:] - lowest[:-1]))
    start = int(np.argmin(total[: end + 1]))
    return start, end
