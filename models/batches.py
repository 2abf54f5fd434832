"""Batches out of drawn fields: turned, mirrored, dimmed and cut, the same for the same step."""

from pathlib import Path

import numpy as np
import numpy.typing as npt

from models.dataset import read_shard
from models.fields import FIELD_CELLS, Field
from models.targets import targets_of
from models.turning import turned

Float32Array = npt.NDArray[np.float32]
_SHARE_CUT = 0.15
_SHARE_DIMMED = 0.5


def read_fields(folder: Path, split: str, shards: int) -> list[Field]:
    """All fields of the first shards of a split."""
    return [
        field
        for number in range(shards)
        for field in read_shard(folder / f"{split}-{number:04d}.npz")
    ]


def example(field: Field, rng: np.random.Generator) -> tuple[Float32Array, Float32Array]:
    """One input (192, 192) in 0..1 and its targets (7, 48, 48)."""
    field = turned(field, int(rng.integers(4)), is_mirrored=bool(rng.random() < 0.5))
    values = field.values.astype(np.float32)
    if field.mode == "fast" and rng.random() < _SHARE_DIMMED:
        values = np.clip(values * rng.uniform(0.85, 1.15) + rng.uniform(-6, 6), 0, 255)
    width = height = FIELD_CELLS
    if rng.random() < _SHARE_CUT:
        # A frame narrower than the network's input ends in zeros.
        width, height = (int(n) for n in rng.integers(48, FIELD_CELLS + 1, size=2))
        values = values.copy()
        values[:, width:] = 0
        values[height:, :] = 0
    return values.astype(np.float32) / np.float32(255), targets_of(field, width, height)


def batch(
    fields: list[Field], size: int, seed: int, step: int
) -> tuple[Float32Array, Float32Array]:
    """Batch number ``step``: (size, 1, 192, 192) and (size, 7, 48, 48).

    Every field comes once before any comes twice, in an order drawn anew for each round.
    """
    inputs, targets = [], []
    rng = np.random.default_rng([seed, 7, step])
    for position in range(step * size, (step + 1) * size):
        turn, place = divmod(position, len(fields))
        order = _order(seed, turn, len(fields))
        values, target = example(fields[int(order[place])], rng)
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
