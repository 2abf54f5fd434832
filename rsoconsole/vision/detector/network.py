"""The trained streak detector: TensorFlow Lite in, candidate streaks in raw pixels out.

The network's answer has six values for every location (one in 4 x 4 cells of the map): confidence
as a logit, the offset of the midpoint (two values), ln(length / 16 cells), and cos 2 theta, sin 2
theta of the direction. Both ends follow from them; the box encloses the ends.
"""

import contextlib
import hashlib
import itertools
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rsoconsole.base import ModelError, model_file_path, parse_json, read_foreign_text
from rsoconsole.vision.arrays import ByteArray, Float32Array
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
ANOTHER_NETWORK = "or name another network in detector.model"
_REINSTALL = f"reinstall rsoconsole, {ANOTHER_NETWORK}"


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


@dataclass(frozen=True, slots=True, kw_only=True)
class MapStreak:
    """One candidate of the network in cells of the map (0: left edge of the first cell)."""

    logit: float
    x_a: float
    y_a: float
    x_b: float
    y_b: float

    @property
    def middle(self) -> tuple[float, float]:
        """Column and row of the midpoint."""
        return (self.x_a + self.x_b) / 2, (self.y_a + self.y_b) / 2

    @property
    def length(self) -> float:
        """Length from end to end, cells."""
        return float(np.hypot(self.x_b - self.x_a, self.y_b - self.y_a))


def decode_candidates(answer: Float32Array, lowest_logit: float) -> list[MapStreak]:
    """Decode a network's output (6, rows, columns) into candidates, most confident first.

    Only those above ``lowest_logit``; overlapping ones are not merged (see ``keep_distinct``).
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
    return [
        MapStreak(logit=float(g), x_a=float(a), y_a=float(b), x_b=float(c), y_b=float(d))
        for g, a, b, c, d in zip(logits, x - ux, y - uy, x + ux, y + uy, strict=True)
    ]


def keep_distinct(candidates: list[MapStreak]) -> list[MapStreak]:
    """Remove candidates that lie on a more confident one; return the rest, surest first.

    Two lie on one another when the midpoint of one is within 4 cells of the other's line and
    between its ends. Parallel neighbours further apart both stay.
    """
    ordered = sorted(candidates, key=lambda c: -c.logit)
    x_a, y_a, x_b, y_b = (
        np.array([(c.x_a, c.y_a, c.x_b, c.y_b) for c in ordered], dtype=np.float32).reshape(-1, 4).T
    )
    dx, dy = x_b - x_a, y_b - y_a
    length = np.maximum(np.hypot(dx, dy), np.float32(1e-6))
    cos, sin, reach = (dx / length)[:, None], (dy / length)[:, None], (length / 2 + 1)[:, None]
    x, y = (x_a + x_b) / 2, (y_a + y_b) / 2
    # Row i: how far every midpoint lies along and across line i.
    away_x, away_y = x - x[:, None], y - y[:, None]
    is_on = np.abs(away_y * cos - away_x * sin) < _SAME_LINE_CELLS
    is_on &= np.abs(away_x * cos + away_y * sin) < reach
    is_same = is_on | is_on.T
    is_open = np.ones(len(ordered), dtype=bool)
    kept: list[MapStreak] = []
    for i, candidate in enumerate(ordered):
        if is_open[i]:
            kept.append(candidate)
            is_open &= ~is_same[i]
    return kept


class Network:
    """Loaded network; not for use by two threads at once.

    Takes maps of any size: smaller ones are padded to its input, larger ones tiled.
    ``interpreter``: of TensorFlow Lite, with its tensors allocated.
    """

    def __init__(self, interpreter: Any, card: Mapping[str, Any]) -> None:
        self.card = card
        """Content of the .json file beside the network."""
        self._interpreter = interpreter
        self._input = interpreter.get_input_details()[0]
        self._output = interpreter.get_output_details()[0]
        self._slope = float(card["calibration"]["slope"])
        self._offset = float(card["calibration"]["offset"])

    @classmethod
    def load(cls, path: Path | None = None, threads: int = 0) -> "Network":
        """Load the network at ``path`` (None: the shipped one) and check it against its .json.

        ``threads``: 0 for as many as ``workers.threads_for`` gives; the network's results do not
        depend on it. Raises ModelError when a file is missing, damaged, or not a network of this
        form.
        """
        model, card_path = _files_of(path)
        card = _read_card(card_path)
        try:
            content = model.read_bytes()
        except OSError as error:
            raise ModelError(
                f"the network {model} cannot be read ({error}): {_REINSTALL}"
            ) from error
        digest = hashlib.sha256(content).hexdigest()
        if digest != card["sha256"]:
            raise ModelError(
                f"the network {model} is not the one its {card_path.name} describes "
                f"(SHA-256 {digest[:12]}... instead of {card['sha256'][:12]}...): {_REINSTALL}"
            )
        with _quiet_stderr():
            interpreter = _interpreter(content, threads_for(threads), model)
        _check_form(interpreter, model)
        return cls(interpreter, card)

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
        candidates: list[MapStreak] = []
        height, width = frame_map.values.shape
        tops = _tile_starts(height, NETWORK_HEIGHT_CELLS)
        lefts = _tile_starts(width, NETWORK_WIDTH_CELLS)
        for top, left in itertools.product(tops, lefts):
            answer = self.answer(frame_map.values, top, left)
            found = keep_distinct(decode_candidates(answer, lowest_logit))
            candidates += _moved_into_frame(found, top, left, width, height)
        if len(tops) * len(lefts) > 1:
            candidates = keep_distinct(candidates)
        return tuple(self._to_box(streak, frame_map) for streak in candidates)

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

    def _to_box(self, streak: MapStreak, frame_map: FrameMap) -> NetworkBox:
        to_px = frame_map.to_px
        xs, ys = sorted((streak.x_a, streak.x_b)), sorted((streak.y_a, streak.y_b))
        # The box reaches half a cell beyond the line on every side.
        return NetworkBox(
            confidence=float(1.0 / (1.0 + np.exp(-(self._slope * streak.logit + self._offset)))),
            corners_px=(
                max(to_px(xs[0] - 0.5), -0.5),
                max(to_px(ys[0] - 0.5), -0.5),
                min(to_px(xs[1] + 0.5), frame_map.width_px - 0.5),
                min(to_px(ys[1] + 0.5), frame_map.height_px - 0.5),
            ),
            ends_px=(to_px(streak.x_a), to_px(streak.y_a), to_px(streak.x_b), to_px(streak.y_b)),
        )


def _moved_into_frame(
    found: list[MapStreak], top: int, left: int, width: int, height: int
) -> list[MapStreak]:
    """Return a tile's candidates in cells of the whole map, without those cut by the tile's edge.

    The neighbouring tile overlaps by more than a streak and holds such a one whole.
    """
    right, bottom = left + NETWORK_WIDTH_CELLS, top + NETWORK_HEIGHT_CELLS
    moved = []
    for s in found:
        x0, x1 = min(s.x_a, s.x_b) + left, max(s.x_a, s.x_b) + left
        y0, y1 = min(s.y_a, s.y_b) + top, max(s.y_a, s.y_b) + top
        mx, my = s.middle
        if mx + left > width or my + top > height:
            continue
        is_cut = (left > 0 and x0 < left + 3) or (right < width and x1 > right - 3)
        is_cut |= (top > 0 and y0 < top + 3) or (bottom < height and y1 > bottom - 3)
        if not is_cut:
            moved.append(
                replace(s, x_a=s.x_a + left, y_a=s.y_a + top, x_b=s.x_b + left, y_b=s.y_b + top)
            )
    return moved


def _tile_starts(size: int, tile: int) -> list[int]:
    """First cells of the tiles that cover ``size`` cells."""
    if size <= tile:
        return [0]
    count = int(np.ceil((size - tile) / (tile - _TILE_OVERLAP_CELLS))) + 1
    # Multiples of 4 keep the head's grid the same in every tile.
    return [round(i * (size - tile) / (count - 1) / 4) * 4 for i in range(count)]


def _files_of(path: Path | None) -> tuple[Path, Path]:
    if path is not None:
        return path, path.with_suffix(".json")
    try:
        model = model_file_path(MODEL_NAME)
        return model, model_file_path(Path(MODEL_NAME).with_suffix(".json").name)
    except FileNotFoundError as error:
        raise ModelError(f"{error}; {ANOTHER_NETWORK}") from error


def _read_card(path: Path) -> dict[str, Any]:
    try:
        card = parse_json(read_foreign_text(path))
    except (OSError, ValueError) as error:
        raise ModelError(
            f"{path}, which describes the network, cannot be read ({error}): {_REINSTALL}"
        ) from error
    needed = {"name", "version", "sha256", "calibration"}
    if not isinstance(card, dict) or not needed <= card.keys():
        raise ModelError(f"{path} does not describe a network of this program: {_REINSTALL}")
    if card.get("input", {}).get("map") != MAP_KIND:
        raise ModelError(
            f"the network that {path} describes was trained on another kind of map than this "
            f"program makes ({MAP_KIND}): train it again (models/README.md), or {_REINSTALL}"
        )
    return card


def _interpreter(content: bytes, threads: int, model: Path) -> Any:
    try:
        from ai_edge_litert.interpreter import Interpreter
    except ImportError:
        try:
            from tflite_runtime.interpreter import Interpreter
        except ImportError as error:
            raise ModelError(
                "no TensorFlow Lite runtime is installed: pip install ai-edge-litert"
            ) from error
    try:
        interpreter = Interpreter(model_content=content, num_threads=threads)
        interpreter.allocate_tensors()
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"the network {model} cannot be loaded ({error}): {_REINSTALL}") from error
    return interpreter


def _check_form(interpreter: Any, model: Path) -> None:
    given = [int(n) for n in interpreter.get_input_details()[0]["shape"]]
    answered = [int(n) for n in interpreter.get_output_details()[0]["shape"]]
    wanted = [1, ANSWERS, NETWORK_HEIGHT_CELLS // STRIDE_CELLS, NETWORK_WIDTH_CELLS // STRIDE_CELLS]
    size = NETWORK_HEIGHT_CELLS * NETWORK_WIDTH_CELLS
    if int(np.prod(given)) != size or answered != wanted:
        raise ModelError(
            f"the network {model} takes {given} and answers {answered}, not {wanted}: {_REINSTALL}"
        )


@contextlib.contextmanager
def _quiet_stderr() -> Iterator[None]:
    """Keep what the runtime's C++ prints while loading away from the terminal."""
    try:
        saved = os.dup(2)
    except OSError:
        yield
        return
    try:
        with Path(os.devnull).open("wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
