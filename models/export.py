"""The trained network as TensorFlow Lite with its card: calibrated, checked, hashed."""

import argparse
import hashlib
import json
import math
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import torch

from models.batches import BATCH, read_fields
from models.dataset import FIELDS_PER_SHARD, RUN, SEED, SHARDS
from models.nights import CALIBRATION_NIGHTS, FRAME_CELLS, ORDINARY_FRAMES, TAU, ordinary_nights
from models.precision import INT8, choose, judged, network_at, quantise
from models.scoring import Score, fit_platt, logit_for_rate, score
from models.streak_net import StreakNet
from rsoconsole.vision import (
    CODES_PER_SIGMA,
    LENGTH_UNIT_CELLS,
    LOWEST_SIGMA,
    MAP_KIND,
    MODEL_NAME,
    NETWORK_HEIGHT_CELLS,
    NETWORK_WIDTH_CELLS,
    STRIDE_CELLS,
)

VERSION = "3"
LOG_NAME = "training_log.jsonl"
_FRAMES_PER_FALSE = 400


def calibration(hard: Score, ordinary: Score) -> dict[str, float]:
    """Slope and offset from logits to confidence, such that false candidates above TAU are rare.

    The slope is that of Platt's curve on the ``hard`` set. The offset puts TAU at the logit with
    one false candidate in 400 frames of ``ordinary`` nights, or at Platt's own logit if that is
    higher.
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
    """Write ``net`` as float32 TensorFlow Lite; return the largest difference of both outputs."""
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


def write_networks(net: StreakNet, run: Path, threads: int) -> tuple[Path, dict[str, Any]]:
    """Write the float32 and both int8 networks into the run's folder.

    Returns the path of the network chosen for shipping, and the figures of all three.
    """
    fields = read_fields(run / "data", "calibrate", SHARDS["calibrate"])
    paths = {"float32": run / "float32.tflite"}
    difference = convert(net, paths["float32"])
    for name, recipe in INT8.items():
        paths[name] = run / f"{name}.tflite"
        quantise(paths["float32"], paths[name], fields[::25], recipe)
    figures = {name: judged(path, fields, threads) for name, path in paths.items()}
    chosen = choose(figures)
    return paths[chosen], {
        "chosen": chosen,
        "conversion_difference": difference,
        "on_calibration_split": figures,
    }


def export(
    run: Path, seed: int, threads: int, folder: Path | None = None, precision: str | None = None
) -> None:
    """Calibrate a run's network; write ``streak_ssd.tflite``, its ``.json`` and its log.

    ``folder``: where to write. ``precision``: "float32" or a name of ``INT8``; None: the better one
    on the calibration split.
    """
    torch.set_num_threads(threads)
    folder = folder or Path(__file__).parent
    net, step = load_average(run)
    source, precisions = write_networks(net, run, threads)
    if precision is not None:
        source, precisions["chosen"] = run / f"{precision}.tflite", precision
    path = folder / MODEL_NAME
    shutil.copyfile(source, path)
    answer = network_at(path, threads).answer
    hard = score(read_fields(run / "data", "calibrate", SHARDS["calibrate"]), answer)
    ordinary = score(
        ordinary_nights(run / "data", seed, CALIBRATION_NIGHTS, ORDINARY_FRAMES), answer
    )
    curve = calibration(hard, ordinary)
    card = {
        "name": "streak_ssd",
        "version": VERSION,
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "input": {
            "shape": [1, 1, NETWORK_HEIGHT_CELLS, NETWORK_WIDTH_CELLS],
            "map": MAP_KIND,
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
            "fields_on_real_sky": len(list((run / "data").glob("real-train-*.npz")))
            * FIELDS_PER_SHARD,
            "fields_seen": step * BATCH,
            "parameters": sum(p.numel() for p in net.parameters()),
        },
        "precision": precisions,
    }
    path.with_suffix(".json").write_text(json.dumps(card, indent=1) + "\n", encoding="utf-8")
    shutil.copyfile(run / "log.jsonl", folder / LOG_NAME)
    print(json.dumps({"calibration": curve, "precision": precisions}, indent=1))


def main() -> None:
    """Run the command line: export the last checkpoint of a run, finished or not."""
    parser = argparse.ArgumentParser(prog="python -m models.export", description=__doc__)
    parser.add_argument("--run", type=Path, default=RUN)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--folder", type=Path, default=None, help="where to; default: models/")
    parser.add_argument("--precision", choices=("float32", *INT8), help="default: the better one")
    args = parser.parse_args()
    export(args.run, args.seed, args.threads, args.folder, args.precision)


if __name__ == "__main__":
    main()
