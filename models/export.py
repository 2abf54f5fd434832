"""The trained network as TensorFlow Lite with its card: calibrated, checked, hashed."""

import argparse
import hashlib
import json
import math
from pathlib import Path

import numpy as np
import torch

from models.batches import read_fields
from models.dataset import FIELDS_PER_SHARD
from models.fields import Conditions, Field, draw_field, draw_sensor
from models.scoring import Score, fit_platt, score
from models.streak_net import StreakNet
from rsoconsole.records import MapMode
from rsoconsole.simulator.render import frame_rng
from rsoconsole.vision.maps import (
    CODES_PER_SIGMA,
    LOWEST_SIGMA,
    NETWORK_HEIGHT_CELLS,
    NETWORK_WIDTH_CELLS,
)
from rsoconsole.vision.network import LENGTH_UNIT_CELLS, MODEL_NAME, STRIDE_CELLS

VERSION = "1"
TAU = 0.10
FRAME_CELLS = 582 * 440
ORDINARY_FRAMES = 200
CALIBRATION_NIGHTS = 4
TEST_NIGHTS = 5
"""Beside ``dataset.SPLITS``: which seeds the nights without satellites are drawn from."""
_HARD_FRAMES_PER_FALSE = 20
"""In the hard set every frame has a fault of the sky: a false candidate in 20 is allowed."""


def ordinary_nights(seed: int, split: int, frames: int, mode: MapMode = "fast") -> list[Field]:
    """Fields of the paper's telescope on ordinary nights without satellites, ``frames`` in area."""
    count = math.ceil(frames * FRAME_CELLS / 192**2)
    fields = []
    for number in range(math.ceil(count / FIELDS_PER_SHARD)):
        rng = frame_rng(seed, split, number)
        sensor = draw_sensor(8, rng, is_hard=False)
        wanted = Conditions(kind="empty", mode=mode, is_hard=False)
        fields += [draw_field(sensor, 8, wanted, rng) for _ in range(FIELDS_PER_SHARD)]
    return fields[:count]


def calibration(hard: Score, ordinary: Score) -> dict[str, float]:
    """Slope and offset that make ``TAU`` the point of rare false candidates.

    The slope is that of Platt's curve on the hard set. The offset puts TAU where the ordinary
    nights give no false candidate and the hard set one in 20 frames, or where Platt's own
    curve has it if that is higher.
    """
    slope, offset = fit_platt(hard.true_logits, hard.false_logits)
    at_tau = math.log(TAU / (1.0 - TAU))
    allowed = int(hard.cells / FRAME_CELLS / _HARD_FRAMES_PER_FALSE)
    candidates = (
        (at_tau - offset) / slope,
        ordinary.logit_for_false(0) + 0.25,
        hard.logit_for_false(allowed),
    )
    logit = max(candidates)
    return {"slope": slope, "offset": at_tau - slope * logit, "logit_at_tau": logit}


def convert(net: StreakNet, path: Path) -> float:
    """Write ``net`` as float32 TensorFlow Lite; returns the largest difference of an answer."""
    import litert_torch

    example = torch.rand(
        1,
        1,
        NETWORK_HEIGHT_CELLS,
        NETWORK_WIDTH_CELLS,
        generator=torch.Generator().manual_seed(1),
    )
    net = net.eval().to(memory_format=torch.contiguous_format)
    converted = litert_torch.convert(net, (example,))
    converted.export(str(path))
    with torch.inference_mode():
        wanted = net(example).numpy()
    return float(np.abs(np.asarray(converted(example)) - wanted).max())


def load_average(run: Path) -> tuple[StreakNet, int]:
    """The averaged network of a run's last checkpoint, and its step."""
    state = torch.load(run / "checkpoint.pt", weights_only=True)
    net = StreakNet()
    net.load_state_dict(state["average"])
    return net.eval(), int(state["step"])


def export(run: Path, seed: int, threads: int, folder: Path | None = None) -> None:
    """Calibrate a run's network and write ``streak_ssd.tflite`` and ``.json`` beside the code."""
    from models.train import BATCH, SHARDS, answer_with

    torch.set_num_threads(threads)
    folder = folder or Path(__file__).parent
    net, step = load_average(run)
    answer = answer_with(net.to(memory_format=torch.channels_last))
    hard = score(read_fields(run / "data", "calibrate", SHARDS["calibrate"]), answer)
    ordinary = score(ordinary_nights(seed, CALIBRATION_NIGHTS, ORDINARY_FRAMES), answer)
    curve = calibration(hard, ordinary)
    path = folder / MODEL_NAME
    difference = convert(net, path)
    card = {
        "name": "streak_ssd",
        "version": VERSION,
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "input": {
            "shape": [1, 1, NETWORK_HEIGHT_CELLS, NETWORK_WIDTH_CELLS],
            "meaning": "byte of the map / 255; zeros beyond the frame",
            "lowest_sigma": LOWEST_SIGMA,
            "codes_per_sigma": CODES_PER_SIGMA,
        },
        "output": {
            "stride_cells": STRIDE_CELLS,
            "length_unit_cells": LENGTH_UNIT_CELLS,
            "channels": ["logit", "dx/stride", "dy/stride", "ln(length/unit)", "cos 2t", "sin 2t"],
            "prior": "one per location, centred in its 4 x 4 cells",
        },
        "calibration": curve,
        "training": {
            "seed": seed,
            "steps": step,
            "fields": len(list((run / "data").glob("train-*.npz"))) * FIELDS_PER_SHARD,
            "fields_seen": step * BATCH,
            "parameters": sum(p.numel() for p in net.parameters()),
            "conversion_difference": difference,
        },
    }
    path.with_suffix(".json").write_text(json.dumps(card, indent=1) + "\n", encoding="utf-8")
    print(json.dumps({"calibration": curve, "conversion_difference": difference}))


def main() -> None:
    """Command line: export the last checkpoint of a run, finished or not."""
    parser = argparse.ArgumentParser(prog="python -m models.export", description=__doc__)
    parser.add_argument("--run", type=Path, default=Path("models/runs/first"))
    parser.add_argument("--seed", type=int, default=20261120)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--folder", type=Path, default=None, help="where to; default: models/")
    args = parser.parse_args()
    export(args.run, args.seed, args.threads, args.folder)


if __name__ == "__main__":
    main()
