"""Alterations of a frame by imperfect conditions, over wide ranges, for the network's hard fields.

The fields resemble the detector's working frame (``vision/detector/working_frame.py``), from which
its maps are made: pixels are binned where stars are wide, so that discs and rings stay small;
offsets of rows and columns are mostly removed; trailed stars may have been covered with sky, which
leaves residuals of them.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from models.extras import Canvas, FloatArray, Points
from models.light import log_uniform
from rsoconsole.simulator import (
    FWHM_PER_SIGMA,
    WIND_TAU_S,
    ImageMotion,
    SensorModel,
    Streak,
    straight_streak,
)

FWHM_PX = (1.0, 5.5)
"""Range of the stars' full width at half maximum in the working frame."""
RING_PX = (1.0, 3.0)
"""Range of the radius of a defocused star's ring in the working frame."""
_FINE_FWHM_PX = 3.5
"""Largest FWHM at a block of 2: a wider star would fill the map."""
_DRIFT_UNITS, _WIND_UNITS = (0.1, 1.2), (0.05, 0.4)
"""Lengths of paths; longer ones draw stars out to trails: fields of the kind ``trailed stars``."""
_EXPOSURE_S = 10.0
_STEPS = 129
_STRIPES_SIGMA = (0.1, 2.0)
_MOONLIGHT, _MAX_OF_WELL = (3.0, 15.0), 0.3
_STEEPEST = 1.2
_GLOW_E_S = (10.0, 200.0)
_HOT_SHARE = (1e-4, 3e-3)
_MAX_COLUMNS = 20
_STEP_8_BIT_E = (6.0, 20.0)
_CROSSING_SNR = (3.0, 30.0)
_COVERED_ABOVE_SNR, _LEFT_OF_COVERED = (1.5, 5.0), 0.1


def altered_sensor(sensor: SensorModel, block: int, rng: np.random.Generator) -> SensorModel:
    """The sensor, at random with a mosaic, 8 bits, glow, many hot pixels or bad columns.

    ``block``: pixels per cell of the map.
    """
    changes: dict[str, Any] = {}
    if rng.random() < 0.06 and block > 2:
        changes["is_bayer"] = True
    if rng.random() < 0.06:
        step_e = float(rng.uniform(*_STEP_8_BIT_E))
        changes |= {"adc_bits": 8, "stored_shift_bits": 0, "e_per_adu12": step_e}
        changes |= {"offset_adu12": 4.0, "full_well_e": 256.0 * step_e}
    if rng.random() < 0.1:
        changes["glow_e_s"] = log_uniform(rng, *_GLOW_E_S)
    if rng.random() < 0.1:
        changes["hot_fraction"] = log_uniform(rng, *_HOT_SHARE) * (8 / block) ** 0.7
    if rng.random() < 0.1:
        bad, partial, dark = (int(n) for n in rng.integers(0, _MAX_COLUMNS // 3, size=3))
        changes |= {"bad_columns": bad, "partial_columns": partial, "dark_columns": dark}
    return replace(sensor, **changes)


def seeing(block: int, rng: np.random.Generator) -> tuple[float, float]:
    """Random FWHM of the stars and radius of their ring (0: in focus), px.

    ``block``: pixels per cell of the map.
    """
    if block > 2 and rng.random() < 0.1:
        return float(rng.uniform(1.2, 2.5)), float(rng.uniform(*RING_PX))
    if rng.random() < 0.5:
        return float(rng.uniform(1.6, 3.4)), 0.0
    return log_uniform(rng, FWHM_PX[0], FWHM_PX[1] if block > 2 else _FINE_FWHM_PX), 0.0


def sky_electrons(sensor: SensorModel, rng: np.random.Generator) -> float:
    """Random mean sky in one pixel, electrons; one time in ten moonlit."""
    sky_e = log_uniform(rng, 25.0, 700.0)
    if rng.random() < 0.1:
        sky_e *= log_uniform(rng, *_MOONLIGHT)
    full_e = min(
        sensor.full_well_e, (2**sensor.adc_bits - 1 - sensor.offset_adu12) * sensor.e_per_adu12
    )
    return min(sky_e, _MAX_OF_WELL * full_e)


def gradient(rng: np.random.Generator) -> tuple[float, float]:
    """Random relative change of the sky along x and y: slight, one time in seven steep."""
    if rng.random() < 1 / 7:
        slope, angle = rng.uniform(0.2, _STEEPEST), rng.uniform(0.0, 2.0 * math.pi)
        return float(slope * math.cos(angle)), float(slope * math.sin(angle))
    return float(rng.normal(0, 0.15)), float(rng.normal(0, 0.15))


def stripes(canvas: Canvas, rng: np.random.Generator) -> dict[str, Any]:
    """Random offsets of rows and half as large ones of columns; empty in six fields of seven.

    As fields of ``FieldContent``.
    """
    if rng.random() >= 1 / 7:
        return {}
    sigma_e = log_uniform(rng, *_STRIPES_SIGMA) * canvas.noise_e
    rows = rng.normal(0.0, sigma_e, canvas.height_px).astype(np.float32)
    columns = rng.normal(0.0, 0.5 * sigma_e, canvas.width_px).astype(np.float32)
    if rng.random() < 0.3:
        rows, columns = columns[: len(rows)], rows[: len(columns)]
    return {"row_offsets_e": rows, "column_offsets_e": columns}


def motion(canvas: Canvas, rng: np.random.Generator) -> FloatArray | None:
    """Random path (2, m) of the whole image during the exposure, px; None in four fields of five.

    A drift along a line, or wind: an Ornstein-Uhlenbeck process as in
    ``simulator/camera/motion.py``. The mean of the path is 0.
    """
    if rng.random() >= 0.2:
        return None
    if rng.random() < 0.5:
        length_px = canvas.unit_px * log_uniform(rng, *_DRIFT_UNITS)
        angle, along = rng.uniform(0.0, 2.0 * math.pi), np.linspace(-0.5, 0.5, _STEPS)
        return np.stack([along * math.cos(angle), along * math.sin(angle)]) * length_px
    # What is blurred wider than the working frame allows would have its pixels joined.
    widest_px = math.sqrt(max(FWHM_PX[1] ** 2 - canvas.fwhm_px**2, 0.0)) / FWHM_PER_SIGMA
    rms_px = min(canvas.unit_px * log_uniform(rng, *_WIND_UNITS), max(widest_px, 0.2))
    kept = math.exp(-_EXPOSURE_S / _STEPS / WIND_TAU_S)
    kicks = rng.normal(0.0, math.sqrt(1.0 - kept**2), size=(2, _STEPS))
    path = np.empty((2, _STEPS))
    at = rng.normal(size=2)
    for step in range(_STEPS):
        at = kept * at + kicks[:, step]
        path[:, step] = at
    path -= path.mean(axis=1, keepdims=True)
    return path * rms_px


def stands(path_px: FloatArray, canvas: Canvas) -> FloatArray:
    """Positions of an image that moves along this path (2, m), as ``FieldContent.stands``."""
    moved = ImageMotion(dx_px=path_px[0], dy_px=path_px[1], turn_rad=np.zeros(path_px.shape[1]))
    return moved.positions_with_dwell(canvas.fwhm_px / FWHM_PER_SIGMA, 0.5 * canvas.diagonal_px)


def crossings(canvas: Canvas, rng: np.random.Generator) -> list[Streak]:
    """Random narrow steady trails from edge to edge; none in eleven fields of twelve."""
    if rng.random() >= 1 / 12:
        return []
    trails = []
    for _ in range(int(rng.integers(1, 4))):
        middle, angle = canvas.place(rng), rng.uniform(0.0, math.pi)
        reach = canvas.diagonal_px * np.array([math.cos(angle), math.sin(angle)])
        light = canvas.line_e_per_px(log_uniform(rng, *_CROSSING_SNR)) * 2.0 * canvas.diagonal_px
        trails.append(straight_streak(tuple(middle - reach), tuple(middle + reach), light))
    return trails


def covered(stars: Points, path_px: FloatArray, canvas: Canvas, rng: np.random.Generator) -> Points:
    """Trailed stars after they have been covered with sky: faint ones whole, residuals of bright.

    ``stars``: x, y and electrons. ``path_px``: their trail, (2, m).
    """
    x, y, electrons = stars
    length_px = float(np.hypot(*np.diff(path_px, axis=1)).sum())
    per_px = canvas.line_e_per_px(log_uniform(rng, *_COVERED_ABOVE_SNR))
    # A trail shorter than the disc is as high as the star.
    is_seen = electrons > per_px * max(length_px, canvas.fwhm_px)
    rest = rng.uniform(0.0, _LEFT_OF_COVERED, len(electrons)) * rng.random(len(electrons))
    return x, y, np.where(is_seen, rest * electrons, electrons)


def gaps(length_cells: float, rng: np.random.Generator) -> FloatArray:
    """Relative brightness (m,) of a satellite's streak, with gaps under covered star trails.

    ``length_cells``: length of the streak in cells of the map.
    """
    steps = 256
    curve = np.ones(steps)
    for _ in range(int(rng.poisson(0.08 * min(length_cells, 60.0)))):
        width = max(1, round(steps * rng.uniform(0.5, 2.5) / max(length_cells, 4.0)))
        start = int(rng.integers(0, steps))
        curve[start : start + width] = 0.0
    return curve
