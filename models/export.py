"""The trained network as TensorFlow Lite with its card: calibrated, checked, hashed."""

import argparse
import hashlib
import json
import math
from pathlib import Path

import numpy as np
import torch

from models.batches import read_fields
from models.dataset import FIELDS_PER_SHARD, RUN, SEED, SHARDS
from models.nights import CALIBRATION_NIGHTS, FRAME_CELLS, ORDINARY_FRAMES, TAU, ordinary_nights
from models.scoring import Score, fit_platt, logit_for_rate, score
from models.streak_net import StreakNet
from rsoconsole.vision.maps import (
    CODES_PER_SIGMA,
    LOWEST_SIGMA,
    NETWORK_HEIGHT_CELLS,
    NETWORK_WIDTH_CELLS,
)
from rsoconsole.vision.network import LENGTH_UNIT_CELLS, MODEL_NAME, STRIDE_CELLS

VERSION = "1"
_FRAMES_PER_FALSE = 400


def calibration(hard: Score, ordinary: Score) -> dict[str, float]:
    """Slope and offset that make ``TAU`` the point of rare false candidates.

    The slope is that of Platt's curve on the hard set. The offset puts TAU where ordinary nights
    give one false candidate in 400 frames, or where Platt's own curve has it if that is higher.
    """
    slope, offset = fit_platt(hard.true_logits, hard.false_logits)
    at_tau = math.log(TAU / (1.0 - TAU))
    wanted = ordinary.cells / FRAME_CELLS / _FRAMES_PER_FALSE
    by_platt = (at_tau - offset) / slope
    by_rate = logit_for_rate(ordinary.false_logits, wanted)
    logit = max(by_platt, by_rate)
    return {
        "slope": slope,
        "offset": at_tau - slope * logit,
        "logit_at_tau": logit,
        "logit_by_platt": by_platt,
        "logit_by_rate": by_rate,
    }


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
    from models.train import BATCH, answer_with

    torch.set_num_threads(threads)
    folder = folder or Path(__file__).parent
    net, step = load_average(run)
    answer = answer_with(net.to(memory_format=torch.channels_last))
    hard = score(read_fields(run / "data", "calibrate", SHARDS["calibrate"]), answer)
    ordinary = score(
        ordinary_nights(run / "data", seed, CALIBRATION_NIGHTS, ORDINARY_FRAMES), answer
    )
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
    parser.add_argument("--run", type=Path, default=RUN)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--folder", type=Path, default=None, help="where to; default: models/")
    args = parser.parse_args()
    export(args.run, args.seed, args.threads, args.folder)


if __name__ == "__main__":
    main()
