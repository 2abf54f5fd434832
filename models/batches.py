"""Batches of drawn fields, turned, mirrored, dimmed and cropped; fixed by seed and step."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from models.dataset import read_shard
from models.fields import Field
from models.targets import targets_of
from models.turning import cropped, turned

Float32Array = npt.NDArray[np.float32]
BATCH = 16
"""Number of crops in one batch, i.e. per step of training."""
CROP_CELLS = 128
"""Side of a crop in cells of the map: a multiple of 32."""
_SHARE_CUT = 0.12
_SHARE_AIMED = 0.5
_SHARE_DIMMED = 0.5


def read_fields(folder: Path, split: str, shards: int) -> list[Field]:
    """All fields of the first ``shards`` shards of a split."""
    return [
        field
        for number in range(shards)
        for field in read_shard(folder / f"{split}-{number:04d}.npz")
    ]


def example(field: Field, side: int, rng: np.random.Generator) -> tuple[Float32Array, Float32Array]:
    """A random crop of a field: input (side, side) in 0..1, targets (7, side / 4, side / 4)."""
    field = turned(_crop(field, side, rng), int(rng.integers(4)), is_mirrored=rng.random() < 0.5)
    values = field.values.astype(np.float32)
    if field.mode == "fast" and rng.random() < _SHARE_DIMMED:
        values = np.clip(values * rng.uniform(0.85, 1.15) + rng.uniform(-6, 6), 0, 255)
    width = height = side
    if rng.random() < _SHARE_CUT:
        # A frame narrower than the network's input ends in zeros.
        width, height = (int(n) for n in rng.integers(48, side + 1, size=2))
        values = values.copy()
        values[:, width:] = 0
        values[height:, :] = 0
    return values.astype(np.float32) / np.float32(255), targets_of(field, width, height)


def _crop(field: Field, side: int, rng: np.random.Generator) -> Field:
    """A square of the field, more often than not with the middle of a streak in it."""
    spare = field.values.shape[0] - side
    left, top = (int(n) for n in rng.integers(0, spare + 1, size=2))
    asked = [s for s in field.streaks if s.is_asked]
    if asked and rng.random() < _SHARE_AIMED:
        aim = asked[int(rng.integers(len(asked)))]
        left = _start(aim.x_a, aim.x_b, side, spare, rng)
        top = _start(aim.y_a, aim.y_b, side, spare, rng)
    return cropped(field, left, top, side)


def _start(one: float, other: float, side: int, spare: int, rng: np.random.Generator) -> int:
    """Start of a crop with the middle of a streak in it; a long one whole, where it fits."""
    first = last = int((one + other) / 2)
    if side / 2 < abs(one - other) < side - 2:
        first, last = int(min(one, other)), int(max(one, other)) + 1
    lowest = min(max(0, last - side + 1), spare)
    return int(rng.integers(lowest, max(lowest, min(spare, first)) + 1))


def batch(
    fields: Sequence[Field], size: int, seed: int, step: int, side: int = CROP_CELLS
) -> tuple[Float32Array, Float32Array]:
    """Inputs (size, 1, side, side) and targets (size, 7, side / 4, side / 4) of batch ``step``.

    Every field is used once before any is used twice, in a new random order for each round.
    """
    inputs, targets = [], []
    rng = np.random.default_rng([seed, 7, step])
    for position in range(step * size, (step + 1) * size):
        turn, place = divmod(position, len(fields))
        order = _order(seed, turn, len(fields))
        values, target = example(fields[int(order[place])], side, rng)
        inputs.append(values)
        targets.append(target)
    return np.stack(inputs)[:, None], np.stack(targets)


_orders: dict[tuple[int, int, int], npt.NDArray[np.int64]] = {}


def _order(seed: int, turn: int, count: int) -> npt.NDArray[np.int64]:
    key = (seed, turn, count)
    if key not in _orders:
        _orders.clear()
        _orders[key] = np.random.default_rng([seed, 11, turn]).permutation(count)
    return _orders[key]
