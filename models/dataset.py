"""Shards of fields drawn once and kept on disk, so that training need not draw them.

Each split has its own seeds; a shard is a pure function of (seed, split, number) and holds 50
fields of one sensor. Where there are pictures of the real sky (``backgrounds.py``), there are
further shards of fields on them, one camera per shard.
"""

import multiprocessing
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from models import backgrounds
from models.backgrounds import SPLITS as REAL_SPLITS
from models.backgrounds import Split
from models.field_scene import draw_field, draw_sensor
from models.fields import KINDS, Conditions, Field, TrueStreak
from models.real_fields import draw_real_fields
from rsoconsole.simulator import frame_rng

FIELDS_PER_SHARD = 50
SEED = 20261121
SHARDS = {"train": 300, "calibrate": 20, "test": 20}
REAL_SHARDS = {"real-train": 24, "real-test": 8}
"""Number of shards per split that are drawn on pictures of the real sky, if there are any."""
SPLITS = {"train": 1, "calibrate": 2, "test": 3, "real-train": 11, "real-test": 12}
BLOCKS = (8, 4, 8, 2, 8, 8, 4, 8, 8, 8, 8, 4, 8, 2, 8, 8, 16, 8, 8, 8)
"""Pixels per cell of the map in successive shards: mostly 8, as for the paper's telescope."""
RUN = Path("models/runs/third")
"""Default folder of training: drawn fields, checkpoints and networks."""


def shard_path(folder: Path, split: str, number: int) -> Path:
    """Path of one shard's file."""
    return folder / f"{split}-{number:04d}.npz"


def real_shards(folder: Path | None) -> dict[str, int]:
    """Number of shards of each split of real pictures in ``folder``; empty for None.

    Prints which pictures are used and which are not.
    """
    if folder is None:
        return {}
    _, unknown = backgrounds.find(folder)
    counts: dict[str, int] = {}
    for split in REAL_SPLITS:
        cameras = backgrounds.cameras(folder, split)
        print(f"{split}: " + (", ".join(cameras) or "no camera"), flush=True)
        if cameras:
            counts[split] = REAL_SHARDS[split]
    if unknown:
        print("not in models/backgrounds.py, skipped: " + ", ".join(unknown), flush=True)
    return counts


def draw_shard(seed: int, split: str, number: int) -> list[Field]:
    """Draw the fields of one shard."""
    rng = frame_rng(seed, SPLITS[split], number)
    block = BLOCKS[number % len(BLOCKS)]
    # One shard in three is of ordinary nights: what the telescope meets most of the time.
    is_hard = number % 3 != 1
    sensor = draw_sensor(block, rng, is_hard=is_hard)
    wanted = Conditions(is_hard=is_hard)
    return [draw_field(sensor, block, wanted, rng) for _ in range(FIELDS_PER_SHARD)]


def draw_real_shard(seed: int, split: Split, number: int, folder: Path) -> list[Field]:
    """Draw the fields of one shard on the pictures in ``folder``."""
    rng = frame_rng(seed, SPLITS[split], number)
    return draw_real_fields(folder, split, number, FIELDS_PER_SHARD, rng)


def write_shard(
    folder: Path, seed: int, split: str, number: int, pictures: Path | None = None
) -> None:
    """Draw one shard and write it unless its file exists.

    ``pictures``: folder of pictures of the real sky, for the splits that need them.
    """
    path = shard_path(folder, split, number)
    if path.exists():
        return
    for real in REAL_SPLITS:
        if split == real:
            assert pictures is not None
            write_fields(path, draw_real_shard(seed, real, number, pictures))
            return
    write_fields(path, draw_shard(seed, split, number))


def write_fields(path: Path, fields: list[Field]) -> None:
    """Write fields to a file, atomically."""
    rows = [
        (i, s.x_a, s.y_a, s.x_b, s.y_b, s.peak_snr, s.integrated_snr, float(s.is_asked))
        for i, field in enumerate(fields)
        for s in field.streaks
    ]
    partial = path.with_suffix(".part.npz")
    np.savez(
        partial,
        values=np.stack([field.values for field in fields]),
        streaks=np.array(rows, dtype=np.float32).reshape(-1, 8),
        kind=np.array([KINDS.index(field.kind) for field in fields], dtype=np.uint8),
        is_paper=np.array([field.mode == "paper" for field in fields]),
        block=np.array([field.block for field in fields], dtype=np.uint8),
    )
    partial.replace(path)


def read_shard(path: Path) -> list[Field]:
    """The fields that a shard's file holds."""
    with np.load(path) as shard:
        values, rows = shard["values"], shard["streaks"]
        kinds, is_paper, blocks = shard["kind"], shard["is_paper"], shard["block"]
    return [
        Field(
            values=values[i],
            kind=KINDS[int(kinds[i])],
            mode="paper" if is_paper[i] else "fast",
            block=int(blocks[i]),
            streaks=tuple(_true_streak(row) for row in rows[rows[:, 0] == i]),
        )
        for i in range(len(values))
    ]


def _true_streak(row: npt.NDArray[np.float32]) -> TrueStreak:
    return TrueStreak(
        x_a=float(row[1]),
        y_a=float(row[2]),
        x_b=float(row[3]),
        y_b=float(row[4]),
        peak_snr=float(row[5]),
        integrated_snr=float(row[6]),
        is_asked=bool(row[7]),
    )


def _write_one(task: tuple[Path, int, str, int, Path | None]) -> None:
    write_shard(*task)


def write_shards(
    folder: Path,
    seed: int,
    counts: Mapping[str, int],
    processes: int,
    pictures: Path | None = None,
) -> Iterator[tuple[int, int]]:
    """Draw all missing shards of the splits in ``counts``; yields (done, all) after each.

    ``pictures``: folder of pictures of the real sky; None: none.
    """
    folder.mkdir(parents=True, exist_ok=True)
    tasks = [
        (folder, seed, split, n, pictures) for split, count in counts.items() for n in range(count)
    ]
    missing = [task for task in tasks if not shard_path(folder, *task[2:4]).exists()]
    with multiprocessing.get_context("spawn").Pool(processes, _one_thread) as pool:
        for done, _ in enumerate(pool.imap_unordered(_write_one, missing), start=1):
            yield done, len(missing)


def _one_thread() -> None:
    import cv2

    cv2.setNumThreads(1)
