"""Measure the shipped network on fields it has never seen, through the product's own code.

Prints one JSON object: recall against peak signal to noise, false candidates per frame, and what
it finds in image files from elsewhere (FITS or 16-bit TIFF) named on the command line.
"""

import argparse
import json
import math
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from models.batches import read_fields
from models.dataset import FIELDS_PER_SHARD, RUN, SEED
from models.fields import Field
from models.nights import (
    FRAME_CELLS,
    GEO_CELLS,
    SHORT_CELLS,
    TAU,
    TEST_NIGHTS,
    lone_streaks,
    ordinary_nights,
)
from models.scoring import Score, score
from rsoconsole.records import MapMode, PixelArray
from rsoconsole.vision import Network, choose_blocks, make_map

SNR_BANDS = ((1.0, 1.5), (1.5, 2.0), (2.0, 3.0), (3.0, 5.0), (5.0, 10.0), (10.0, 30.0))


def recall_of_all(fields: list[Field], network: Network, logit: float, shortest: float) -> float:
    """Fraction of all streaks longer than ``shortest`` cells that are found above a logit.

    Counts also streaks that are too faint for the detector to be expected to find them.
    """
    asked = [
        replace(f, streaks=tuple(replace(s, is_asked=s.length > shortest) for s in f.streaks))
        for f in fields
    ]
    return round(score(asked, network.answer, logit).recall(logit), 4)


def figures(result: Score, logit: float) -> dict[str, Any]:
    """False candidates by kind of field and recall by SNR, above a logit."""
    kinds = Counter(
        kind
        for kind, value in zip(result.false_kinds, result.false_logits, strict=True)
        if value > logit
    )
    return {
        "frames": round(result.cells / FRAME_CELLS, 1),
        "false": dict(kinds),
        "recall": {
            f"{low}-{high}": round(result.recall(logit, (low, high)), 4)
            for low, high in SNR_BANDS
            if not math.isnan(result.recall(logit, (low, high)))
        },
        "middle_error_cells_median": round(float(np.median(result.middle_errors)), 3)
        if len(result.middle_errors)
        else None,
    }


def read_image(path: Path) -> tuple[PixelArray, float | None, float | None]:
    """Pixels of an image file, exposure (s) and scale (arcsec/px); None where not in the header."""
    if path.suffix.lower() in {".tif", ".tiff", ".png"}:
        import cv2

        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        return np.ascontiguousarray(image if image.ndim == 2 else image[..., 0]), None, None
    from astropy.io import fits

    with fits.open(path) as hdus:
        hdu = next(h for h in hdus if h.data is not None and np.ndim(h.data) == 2)
        pixels = np.nan_to_num(np.asarray(hdu.data), nan=float(np.nanmedian(hdu.data)))
        headers = (hdu.header, hdus[0].header)
        exposure, focal, pitch = (
            next((h[key] for h in headers if key in h), None)
            for key in ("EXPTIME", "FOCALLEN", "XPIXSZ")
        )
    scale = 206.264806 * float(pitch) / float(focal) if focal and pitch else None
    kind = np.uint16 if pixels.dtype == np.uint16 else np.float32
    return pixels.astype(kind), float(exposure) if exposure else None, scale


def look_at(path: Path, network: Network, mode: MapMode) -> dict[str, Any]:
    """Candidates of the network in one image file, most confident first."""
    pixels, exposure_s, scale = read_image(path)
    block = choose_blocks(pixels.shape[1], pixels.shape[0], scale, exposure_s)[-1]
    started = time.perf_counter()
    frame_map = make_map(pixels, mode, block)
    mapped = time.perf_counter()
    boxes = network.run(frame_map)
    ended = time.perf_counter()
    return {
        "block": block,
        "map_ms": round((mapped - started) * 1e3, 1),
        "network_ms": round((ended - mapped) * 1e3, 1),
        "found": [[round(v, 3) for v in (b.confidence, *b.ends_px)] for b in boxes[:6]],
    }


def main() -> None:
    """Run the command line: evaluate the shipped network and print its figures."""
    parser = argparse.ArgumentParser(prog="python -m models.evaluate", description=__doc__)
    parser.add_argument("--run", type=Path, default=RUN)
    parser.add_argument("--model", type=Path, default=None)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--frames", type=int, default=200, help="full frames without satellites")
    parser.add_argument("--images-only", action="store_true")
    parser.add_argument("images", type=Path, nargs="*")
    args = parser.parse_args()
    network = Network.load(args.model, args.threads)
    curve = network.card["calibration"]
    logit = (math.log(TAU / (1 - TAU)) - curve["offset"]) / curve["slope"]
    report: dict[str, Any] = {"network": network.version, "tau": TAU}
    if not args.images_only:
        shards = len(list((args.run / "data").glob("test-*.npz")))
        fields = read_fields(args.run / "data", "test", shards)
        report["test_fields"] = shards * FIELDS_PER_SHARD
        real_shards = len(list((args.run / "data").glob("real-test-*.npz")))
        if real_shards:
            real = read_fields(args.run / "data", "real-test", real_shards)
            report["real_test_fields"] = len(real)
            report["real"] = figures(score(real, network.answer, logit), logit)
        for mode in ("fast", "paper"):
            chosen = [field for field in fields if field.mode == mode]
            report[f"hard_{mode}"] = figures(score(chosen, network.answer, logit), logit)
            nights = ordinary_nights(args.run / "data", args.seed, TEST_NIGHTS, args.frames, mode)
            report[f"nights_{mode}"] = figures(score(nights, network.answer, logit), logit)
            for name, cells in (("geo", (GEO_CELLS, GEO_CELLS + 0.1)), ("short", SHORT_CELLS)):
                report[f"{name}_{mode}"] = {
                    f"{band[0]}-{band[1]}": recall_of_all(
                        lone_streaks(args.seed, band, mode, cells=cells),
                        network,
                        logit,
                        0.9 * cells[0],
                    )
                    for band in SNR_BANDS
                }
    for path in args.images:
        report[path.name] = {mode: look_at(path, network, mode) for mode in ("fast", "paper")}
    print(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
