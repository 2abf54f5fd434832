"""Fields of ordinary nights of the paper's telescope, for setting tau and for the figures."""

import math
from pathlib import Path

from models.dataset import FIELDS_PER_SHARD, read_shard, write_fields
from models.field_scene import draw_field, draw_sensor
from models.fields import FIELD_CELLS, Conditions, Field
from rsoconsole.records import MapMode
from rsoconsole.simulator import frame_rng

TAU = 0.10
FRAME_CELLS = 582 * 440
ORDINARY_FRAMES = 200
GEO_CELLS = 14.8
"""Length in cells of a geostationary streak: 10 s at 1.264 arcsec/px, 8 pixels per cell."""
CALIBRATION_NIGHTS = 4
TEST_NIGHTS = 5
_LONE_NIGHTS = 6
"""Number in the seed of each set, beside those of ``dataset.SPLITS``."""


def ordinary_nights(
    folder: Path, seed: int, split: int, frames: int, mode: MapMode = "fast"
) -> list[Field]:
    """Fields without satellites, together as large as ``frames`` frames; cached in ``folder``."""
    count = math.ceil(frames * FRAME_CELLS / FIELD_CELLS**2)
    fields: list[Field] = []
    for number in range(math.ceil(count / FIELDS_PER_SHARD)):
        path = folder / f"nights-{split}-{mode}-{number:04d}.npz"
        if not path.exists():
            write_fields(path, _draw_nights(seed, split, number, mode))
        fields += read_shard(path)
    return fields[:count]


def _draw_nights(seed: int, split: int, number: int, mode: MapMode) -> list[Field]:
    rng = frame_rng(seed, split, number)
    sensor = draw_sensor(8, rng, is_hard=False)
    wanted = Conditions(kind="empty", mode=mode, is_hard=False)
    return [draw_field(sensor, 8, wanted, rng) for _ in range(FIELDS_PER_SHARD)]


SHORT_CELLS = (30 / 8, 60 / 8)
"""Lengths in cells of streaks of 30 to 60 px at 8 pixels per cell."""


def lone_streaks(
    seed: int,
    band: tuple[float, float],
    mode: MapMode,
    *,
    cells: tuple[float, float] = (GEO_CELLS, GEO_CELLS + 0.1),
    fields: int = 100,
    is_hard: bool = False,
) -> list[Field]:
    """Fields with one streak each, of a peak SNR within ``band`` and a length within ``cells``."""
    key = int(band[0] * 100), int(mode == "paper"), int(is_hard), int(cells[0] * 100)
    rng = frame_rng(seed, _LONE_NIGHTS, *key)
    sensor = draw_sensor(8, rng, is_hard=is_hard)
    wanted = Conditions(
        kind="ordinary",
        mode=mode,
        peak_snr=band,
        streak_cells=cells,
        streaks=(1, 1),
        is_hard=is_hard,
    )
    return [draw_field(sensor, 8, wanted, rng) for _ in range(fields)]
