"""Targets of every location of the network, made from true streaks.

A location (row, column) of the head is centred on the point (4 column + 2, 4 row + 2) of the map.
Its answers are: confidence as a logit; offset of the midpoint in units of 4 cells; ln(length / 16
cells); cos 2 theta and sin 2 theta of the direction, which are equal for a line's two senses.
"""

import numpy as np
import numpy.typing as npt

from models.fields import Field, Kind, clip_to_box, cut_ends, is_asked_for
from rsoconsole.vision import LENGTH_UNIT_CELLS, STRIDE_CELLS

Float32Array = npt.NDArray[np.float32]
TARGET_CHANNELS = 7
"""Number of channels: heat, two offsets, log length, cos, sin, weight of the confidence's loss."""
_SIGMA_ACROSS = 2.4
_SIGMA_ALONG_SHARE = 0.08
_FLAT_TOP = 1.6
"""Factor on the heat before it is cut at 1: locations within one sigma count alike.

The offsets give the position of the midpoint.
"""
_MIN_CUT_CELLS = 6.0
"""Least visible length of a cut streak that is asked for."""
_REFUSED: dict[Kind, float] = {"aircraft": 3.0, "trailed stars": 3.0, "rays": 2.0, "meteor": 2.0}
"""Factor on the loss of a false candidate where something else draws lines."""


def targets_of(
    field: Field, width: float | None = None, height: float | None = None
) -> Float32Array:
    """Targets (7, side / 4, side / 4) of a field.

    ``width``, ``height``: part of the field that is shown, in cells; None: all of it.
    """
    rows, columns = (side // STRIDE_CELLS for side in field.values.shape)
    height, width = height or field.values.shape[0], width or field.values.shape[1]
    target = np.zeros((TARGET_CHANNELS, rows, columns), dtype=np.float32)
    target[6] = _REFUSED.get(field.kind, 1.0)
    gx, gy = np.meshgrid(
        (np.arange(columns) + 0.5) * STRIDE_CELLS, (np.arange(rows) + 0.5) * STRIDE_CELLS
    )
    for streak in field.streaks:
        seen = clip_to_box((streak.x_a, streak.y_a, streak.x_b, streak.y_b), width, height)
        if seen is None:
            continue
        x_a, y_a, x_b, y_b = seen
        length = max(float(np.hypot(x_b - x_a, y_b - y_a)), 1e-3)
        cos, sin = (x_b - x_a) / length, (y_b - y_a) / length
        dx, dy = (x_a + x_b) / 2 - gx, (y_a + y_b) / 2 - gy
        along, across = dx * cos + dy * sin, dy * cos - dx * sin
        cuts = cut_ends(seen, width, height)
        is_asked = streak.is_asked and cuts < 2
        is_asked &= cuts == 0 or length >= _MIN_CUT_CELLS
        seen_snr = streak.integrated_snr * float(np.sqrt(min(length / max(streak.length, 1e-3), 1)))
        snrs = streak.peak_snr, seen_snr
        if not (is_asked and is_asked_for(*snrs, length, field.mode, field.block)):
            is_near = (np.abs(along) < length / 2 + 4) & (np.abs(across) < 5)
            target[6][is_near & (target[0] == 0)] = 0.0
            continue
        sigma_along = max(_SIGMA_ACROSS, _SIGMA_ALONG_SHARE * length)
        heat = np.exp(-0.5 * ((along / sigma_along) ** 2 + (across / _SIGMA_ACROSS) ** 2))
        heat = np.minimum(_FLAT_TOP * heat / heat.max(), 1.0)
        heat[heat < 0.05] = 0.0
        is_best = heat > target[0]
        values = (
            heat,
            dx / STRIDE_CELLS,
            dy / STRIDE_CELLS,
            np.full_like(dx, np.log(length / LENGTH_UNIT_CELLS)),
            np.full_like(dx, cos * cos - sin * sin),
            np.full_like(dx, 2 * cos * sin),
            np.ones_like(dx),
        )
        for channel, value in enumerate(values):
            target[channel][is_best] = value[is_best]
    return target
