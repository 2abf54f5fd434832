"""First guesses about a streak in a proposed box: the pixels to look at, and its line."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.background import Background
from rsoconsole.vision.stars import StarList
from rsoconsole.vision.streak_glare import Layers, clear_of_stars

BoolArray = npt.NDArray[np.bool_]
Box = tuple[float, float, float, float]

_SMALL_BOX_PX = 40.0
_BOX_ERROR_PX = 12.0
_OFFSETS_PX = 10.0
_ANGLE_ERROR_RAD = 0.13
"""The direction of a network's line is trusted no better than so."""
_CLIP = (-1.5, 4.0)
"""Of the smoothed signal to noise, so that a star in the way counts little."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cutout:
    """Part of a frame about a proposal, sky taken away."""

    x0: int
    y0: int
    values: FloatArray
    """(h, w) ADU above the sky and above ``halo``."""
    halo: npt.NDArray[np.float32]
    """(h, w) ADU that giant stars shed here."""
    is_good: BoolArray
    """(h, w) False where a listed star shines: for what knows of no stars."""
    is_seen: BoolArray
    """(h, w) False only where a star is too bright to be modelled, or saturated."""
    star_x: FloatArray
    """Other listed stars in and about the cutout, (n,), pixels of the cutout."""
    star_y: FloatArray
    star_flux: FloatArray
    """ADU."""
    noise: float
    """One sigma of a pixel, ADU."""
    frame_width: int
    frame_height: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Guess:
    """A line through the cutout: raw pixel coordinates, direction as a unit vector."""

    x_px: float
    y_px: float
    dx: float
    dy: float
    half_length_px: float


def cut_out(
    pixels: PixelArray, sky: Background, box: Box, margin_px: float, stars: StarList | None
) -> Cutout:
    """Raw pixels of ``box`` grown by ``margin_px`` on each side, as far as the frame goes."""
    height, width = pixels.shape
    x0, x1 = _range(box[0] - margin_px, box[2] + margin_px, width)
    y0, y1 = _range(box[1] - margin_px, box[3] + margin_px, height)
    values = pixels[y0:y1, x0:x1].astype(np.float64)
    values -= _level_at(sky, np.arange(y0, y1), np.arange(x0, x1))
    cells = sky.noise[
        y0 // sky.cell_px : y1 // sky.cell_px + 1, x0 // sky.cell_px : x1 // sky.cell_px + 1
    ]
    noise = max(float(np.median(cells)), 1e-9)
    layers = Layers(
        values=values,
        halo=np.zeros(values.shape, dtype=np.float32),
        is_good=np.ones(values.shape, dtype=bool),
        is_seen=np.ones(values.shape, dtype=bool),
    )
    modelled = [] if stars is None else clear_of_stars(layers, (x0, y0), stars, noise)
    return Cutout(
        x0=x0,
        y0=y0,
        values=layers.values,
        halo=layers.halo,
        is_good=layers.is_good,
        is_seen=layers.is_seen,
        star_x=np.zeros(0) if stars is None else stars.x_px[modelled] - x0,
        star_y=np.zeros(0) if stars is None else stars.y_px[modelled] - y0,
        star_flux=np.zeros(0) if stars is None else stars.flux[modelled],
        noise=noise,
        frame_width=width,
        frame_height=height,
    )


def _range(low: float, high: float, size: int) -> tuple[int, int]:
    start = int(np.clip(np.floor(low), 0, max(size - 16, 0)))
    return start, int(np.clip(np.ceil(high) + 1, min(start + 16, size), size))


def _level_at(sky: Background, ys: npt.NDArray[np.int_], xs: npt.NDArray[np.int_]) -> FloatArray:
    """Sky level between cell centres, linear, (len(ys), len(xs))."""
    rows = np.clip((ys + 0.5) / sky.cell_px - 0.5, 0, sky.level.shape[0] - 1)
    columns = np.clip((xs + 0.5) / sky.cell_px - 0.5, 0, sky.level.shape[1] - 1)
    r0, c0 = np.floor(rows).astype(int), np.floor(columns).astype(int)
    level = sky.level[r0[0] : r0[-1] + 2, c0[0] : c0[-1] + 2].astype(np.float64)
    r0, rows, c0, columns = r0 - r0[0], rows - r0[0], c0 - c0[0], columns - c0[0]
    r1, c1 = np.minimum(r0 + 1, level.shape[0] - 1), np.minimum(c0 + 1, level.shape[1] - 1)
    along = level[r0] + (level[r1] - level[r0]) * (rows - r0)[:, None]
    return np.asarray(along[:, c0] + (along[:, c1] - along[:, c0]) * (columns - c0))


def find_line(cutout: Cutout, box: Box, psf_sigma: float, ends: Box | None = None) -> Guess | None:
    """Best line through the box among those its shape allows.

    ``ends`` (x_a, y_a, x_b, y_b) narrows the search; without it both diagonals are tried.
    """
    smooth = _smooth_snr(cutout, psf_sigma)
    x0, y0, x1, y1 = ends or box
    length = max(float(np.hypot(x1 - x0, y1 - y0)), 6.0)
    centre = (0.5 * (x0 + x1) - cutout.x0, 0.5 * (y0 + y1) - cutout.y0)
    step = 1.5 / length
    if ends is None or length < _SMALL_BOX_PX / 2:
        angles = _fan(x1 - x0, y1 - y0, length, step)
    else:
        spread = min(max(10.0 / length + 2 * step, _ANGLE_ERROR_RAD), np.pi / 4)
        angle = float(np.arctan2(y1 - y0, x1 - x0))
        angles = np.arange(angle - spread, angle + spread + step / 2, step)
    reach = min(_OFFSETS_PX, 4.0 + 0.1 * length)
    offsets = np.arange(-reach, reach + 0.5, 1.0)
    best = _best_line(np.clip(smooth, *_CLIP), centre, angles, offsets, 0.5 * length)
    if best is None:
        return None
    for spacing in (0.5, 0.125):
        # A bright streak is flat where it is clipped: look again with its own level as limit.
        level = float(np.median(_along(smooth, centre, *best, 0.5 * length)))
        limited = np.clip(smooth, _CLIP[0], max(_CLIP[1], 1.5 * level))
        near = spacing * np.arange(-4.0, 5.0)
        found = _best_line(limited, centre, near * step + best[0], near + best[1], 0.5 * length)
        best = found or best
    dx, dy = float(np.cos(best[0])), float(np.sin(best[0]))
    return Guess(
        x_px=centre[0] + cutout.x0 - dy * best[1],
        y_px=centre[1] + cutout.y0 + dx * best[1],
        dx=dx,
        dy=dy,
        half_length_px=0.5 * length,
    )


def _fan(width: float, height: float, length: float, step: float) -> FloatArray:
    """Directions that a box of this shape may hold, rad; all of them for a small box."""
    if max(width, height) < _SMALL_BOX_PX:
        return np.arange(0.0, np.pi, step)
    error = min(_BOX_ERROR_PX, 0.5 * length)
    flattest = np.arctan2(max(height - error, 0.0), width + error)
    steepest = np.arctan2(height + error, max(width - error, 0.0))
    up = np.arange(flattest, steepest + step, step)
    return np.concatenate([up, -up])


def _smooth_snr(cutout: Cutout, psf_sigma: float) -> npt.NDArray[np.float32]:
    """Matched to the stars, in units of its own noise; 0 where a star is masked."""
    import cv2

    good = cutout.is_good.astype(np.float32)
    values = (cutout.values * good).astype(np.float32)
    total = cv2.GaussianBlur(values, (0, 0), psf_sigma)
    share = cv2.GaussianBlur(good, (0, 0), psf_sigma)
    gain = 2.0 * np.sqrt(np.pi) * psf_sigma / max(cutout.noise, 1e-9)
    return np.where(share > 0.3, total / np.maximum(share, 0.3) * gain, 0.0).astype(np.float32)


def _along(
    smooth: npt.NDArray[np.float32],
    centre: tuple[float, float],
    angle: float,
    offset: float,
    half_length: float,
) -> npt.NDArray[np.float32]:
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
    smooth: npt.NDArray[np.float32],
    centre: tuple[float, float],
    angles: FloatArray,
    offsets: FloatArray,
    half_length: float,
) -> tuple[float, float] | None:
    """(angle, offset) whose samples are brightest on average; None where all lie outside."""
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
