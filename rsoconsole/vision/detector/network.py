"""The trained streak detector: TensorFlow Lite in, candidate streaks in raw pixels out.

The network's answer has six values for every location (one in 4 x 4 cells of the map): confidence
as a logit, the offset of the midpoint (two values), ln(length / 16 cells), and cos 2 theta, sin 2
theta of the direction. Both ends follow from them; the box encloses the ends.
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rsoconsole.base import ModelError
from rsoconsole.records import FloatArray
from rsoconsole.vision.arrays import ByteArray, Float32Array
from rsoconsole.vision.detector.network_file import REINSTALL, load_interpreter
from rsoconsole.vision.detector.verifier import Verifier
from rsoconsole.vision.frame.maps import (
    MAP_KIND,
    NETWORK_HEIGHT_CELLS,
    NETWORK_WIDTH_CELLS,
    FrameMap,
)
from rsoconsole.vision.frame.workers import threads_for
from rsoconsole.vision.lines.segments import Box, Ends, midpoint_of

MODEL_NAME = "streak_ssd.tflite"
STRIDE_CELLS = 4
LENGTH_UNIT_CELLS = 16.0
ANSWERS = 6
LOWEST_CONFIDENCE = 1e-5
"""Lowest confidence of a candidate, far below any tau: the measurement on the frame decides."""

_SAME_LINE_CELLS = 4.0
_LONGEST_CELLS = 160.0
_TILE_OVERLAP_CELLS = 128
_MAX_CANDIDATES = 600


@dataclass(frozen=True, slots=True, kw_only=True)
class NetworkBox:
    """One candidate of the network, in pixels of the raw frame (0 = centre of the first)."""

    confidence: float
    """Calibrated confidence, 0 to 1: share of such training candidates that are satellites."""
    corners_px: Box
    ends_px: Ends
    """Ends of the streak, to about half a cell; one frame does not show which came first."""

    @property
    def length_px(self) -> float:
        """Length from end to end, px."""
        x_a, y_a, x_b, y_b = self.ends_px
        return float(np.hypot(x_b - x_a, y_b - y_a))

    @property
    def angle_deg(self) -> float:
        """Direction in the array, x towards y, modulo 180 deg."""
        x_a, y_a, x_b, y_b = self.ends_px
        return float(np.degrees(np.arctan2(y_b - y_a, x_b - x_a)) % 180.0)

    @property
    def middle_px(self) -> tuple[float, float]:
        """Column and row of the midpoint between the ends."""
        return midpoint_of(self.ends_px)


def decode_candidates(answer: Float32Array, lowest_logit: float) -> FloatArray:
    """Decode a network's output (6, rows, columns) into candidates, most confident first.

    Returns (n, 5): logit, then both ends (x_a, y_a, x_b, y_b) in cells of the map (0: left edge of
    the first). Only those above ``lowest_logit``; overlapping ones are not merged (see
    ``keep_distinct``).
    """
    rows, columns = np.nonzero(answer[0] > lowest_logit)
    logits = answer[0][rows, columns]
    order = np.argsort(-logits, kind="stable")[:_MAX_CANDIDATES]
    rows, columns, logits = rows[order], columns[order], logits[order]
    dx, dy, log_length, cos2, sin2 = answer[1:, rows, columns]
    x = (columns + 0.5 + dx) * STRIDE_CELLS
    y = (rows + 0.5 + dy) * STRIDE_CELLS
    length = np.minimum(np.exp(np.minimum(log_length, 5.0)) * LENGTH_UNIT_CELLS, _LONGEST_CELLS)
    theta = 0.5 * np.arctan2(sin2, cos2)
    ux, uy = 0.5 * length * np.cos(theta), 0.5 * length * np.sin(theta)
    return np.stack([logits, x - ux, y - uy, x + ux, y + uy], axis=1).astype(np.float64)


def keep_distinct(candidates: FloatArray) -> FloatArray:
    """Remove candidates (n, 5) that lie on a more confident one; return the rest, surest first.

    Two lie on one another when the midpoint of one is within 4 cells of the other's line and
    between its ends. Parallel neighbours further apart both stay.
    """
    ordered = candidates[np.argsort(-candidates[:, 0], kind="stable")]
    x_a, y_a, x_b, y_b = ordered[:, 1:].T.astype(np.float32)
    dx, dy = x_b - x_a, y_b - y_a
    length = np.maximum(np.hypot(dx, dy), np.float32(1e-6))
    cos, sin, reach = (dx / length)[:, None], (dy / length)[:, None], (length / 2 + 1)[:, None]
    x, y = (x_a + x_b) / 2, (y_a + y_b) / 2
    # Row i: how far every midpoint lies along and across line i.
    away_x, away_y = x - x[:, None], y - y[:, None]
    across = away_y * cos
    across -= away_x * sin
    away_x *= cos
    away_y *= sin
    along = np.add(away_x, away_y, out=away_x)
    is_on = np.abs(across, out=across) < _SAME_LINE_CELLS
    is_on &= np.abs(along, out=along) < reach
    is_free = ~(is_on | is_on.T)
    is_open, kept = np.ones(len(ordered), dtype=bool), []
    for i in range(len(ordered)):
        if is_open[i]:
            kept.append(i)
            is_open &= is_free[i]
    return ordered[kept]


class Network:
    """Loaded network; not for use by two threads at once.

    Takes maps of any size: smaller ones are padded to its input, larger ones tiled.
    ``interpreter``: of TensorFlow Lite, with its tensors allocated.
    """

    def __init__(
        self, interpreter: Any, card: Mapping[str, Any], verifier: Verifier | None = None
    ) -> None:
        self.card = card
        """Content of the .json file beside the network."""
        self.verifier = verifier
        self._interpreter = interpreter
        self._input = interpreter.get_input_details()[0]
        self._output = interpreter.get_output_details()[0]
        self._slope = float(card["calibration"]["slope"])
        self._offset = float(card["calibration"]["offset"])

    @classmethod
    def load(cls, path: Path | None = None, threads: int = 0) -> "Network":
        """Load the network at ``path`` (None: the shipped one) and check it against its .json.

        ``threads``: of the detector, one of which looks for stars and lines meanwhile; 0 for as
        many as ``workers.threads_for`` gives. The results do not depend on it.
        Raises ModelError when a file is missing, damaged, or not a network of this form.
        """
        model, card, interpreter = load_interpreter(
            MODEL_NAME, path, max(threads_for(threads) - 1, 1)
        )
        if card.get("input", {}).get("map") != MAP_KIND:
            raise ModelError(
                f"the network that {model.with_suffix('.json')} describes was trained on another "
                f"kind of map than this program makes ({MAP_KIND}): train it again "
                f"(models/README.md), or {REINSTALL}"
            )
        _check_form(interpreter, model)
        return cls(interpreter, card, Verifier.load())

    @property
    def version(self) -> str:
        """Name, version and beginning of the digest, for logs."""
        return f"{self.card['name']} {self.card['version']} ({self.card['sha256'][:8]})"

    def run(
        self, frame_map: FrameMap, lowest_confidence: float = LOWEST_CONFIDENCE
    ) -> tuple[NetworkBox, ...]:
        """Find the candidates in one map above a confidence, most confident first.

        Each streak appears once.
        """
        lowest = min(max(lowest_confidence, 1e-6), 1.0 - 1e-6)
        lowest_logit = (np.log(lowest / (1.0 - lowest)) - self._offset) / self._slope
        height, width = frame_map.values.shape
        tops = _tile_starts(height, NETWORK_HEIGHT_CELLS)
        lefts = _tile_starts(width, NETWORK_WIDTH_CELLS)
        found = []
        for top, left in itertools.product(tops, lefts):
            answer = self.answer(frame_map.values, top, left)
            distinct = keep_distinct(decode_candidates(answer, lowest_logit))
            found.append(_moved_into_frame(distinct, top, left, width, height))
        return self._boxes(
            keep_distinct(np.concatenate(found)) if len(found) > 1 else found[0], frame_map
        )

    def answer(self, values: ByteArray, top: int = 0, left: int = 0) -> Float32Array:
        """Return the network's raw output (6, 112, 152) for one tile of a map.

        ``top``, ``left``: the tile's first row and column of cells.
        """
        tile = values[top : top + NETWORK_HEIGHT_CELLS, left : left + NETWORK_WIDTH_CELLS]
        padded = np.zeros((NETWORK_HEIGHT_CELLS, NETWORK_WIDTH_CELLS), dtype=np.float32)
        np.multiply(tile, np.float32(1 / 255), out=padded[: tile.shape[0], : tile.shape[1]])
        self._interpreter.set_tensor(self._input["index"], padded.reshape(self._input["shape"]))
        self._interpreter.invoke()
        answer: Float32Array = self._interpreter.get_tensor(self._output["index"])[0]
        return answer

    def _boxes(self, candidates: FloatArray, frame_map: FrameMap) -> tuple[NetworkBox, ...]:
        confidence = 1.0 / (1.0 + np.exp(-(self._slope * candidates[:, 0] + self._offset)))
        ends = candidates[:, 1:] * frame_map.block - 0.5
        x, y = ends[:, ::2], ends[:, 1::2]
        # The box reaches half a cell beyond the line on every side.
        beyond = 0.5 * frame_map.block
        corners = (
            np.maximum(x.min(axis=1) - beyond, -0.5),
            np.maximum(y.min(axis=1) - beyond, -0.5),
            np.minimum(x.max(axis=1) + beyond, frame_map.width_px - 0.5),
            np.minimum(y.max(axis=1) + beyond, frame_map.height_px - 0.5),
        )
        return tuple(
            NetworkBox(confidence=sure, corners_px=(x0, y0, x1, y1), ends_px=(x_a, y_a, x_b, y_b))
            for sure, x0, y0, x1, y1, x_a, y_a, x_b, y_b in np.column_stack(
                [confidence, *corners, ends]
            ).tolist()
        )


def _moved_into_frame(
    found: FloatArray, top: int, left: int, width: int, height: int
) -> FloatArray:
    """Return a tile's candidates in cells of the whole map, without those cut by the tile's edge.

    The neighbouring tile overlaps by more than a streak and holds such a one whole.
    """
    moved: FloatArray = found + np.array([0, left, top, left, top])
    is_whole = np.ones(len(moved), dtype=bool)
    for place, start, tile, size in (
        (moved[:, 1::2], left, NETWORK_WIDTH_CELLS, width),
        (moved[:, 2::2], top, NETWORK_HEIGHT_CELLS, height),
    ):
        is_whole &= place.mean(axis=1) <= size
        if start > 0:
            is_whole &= place.min(axis=1) >= start + 3
        if start + tile < size:
            is_whole &= place.max(axis=1) <= start + tile - 3
    return moved[is_whole]


def _tile_starts(size: int, tile: int) -> list[int]:
    """First cells of the tiles that cover ``size`` cells."""
    if size <= tile:
        return [0]
    count = int(np.ceil((size - tile) / (tile - _TILE_OVERLAP_CELLS))) + 1
    # Multiples of 4 keep the head's grid the same in every tile.
    return [round(i * (size - tile) / (count - 1) / 4) * 4 for i in range(count)]


def _check_form(interpreter: Any, model: Path) -> None:
    given = [int(n) for n in interpreter.get_input_details()[0]["shape"]]
    answered = [int(n) for n in interpreter.get_output_details()[0]["shape"]]
    wanted = [1, ANSWERS, NETWORK_HEIGHT_CELLS // STRIDE_CELLS, NETWORK_WIDTH_CELLS // STRIDE_CELLS]
    size = NETWORK_HEIGHT_CELLS * NETWORK_WIDTH_CELLS
    if int(np.prod(given)) != size or answered != wanted:
        raise ModelError(
            f"the network {model} takes {given} and answers {answered}, not {wanted}: {REINSTALL}"
        )
