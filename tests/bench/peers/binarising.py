"""Does binarising lift the network's confidence, as the paper says, or what does?

One network, the same satellites, the same candidates' rule; only the map it sees differs.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from rsoconsole.vision import FrameMap, Network, local_background, make_map, resample
from rsoconsole.vision.frame.bins import block_maximum, mean_of_squares
from rsoconsole.vision.frame.maps import to_map_bytes
from tests.bench.peers.frames import SNR_BINS, BenchFrame
from tests.bench.peers.paper_recipe import BLACK, PER_SIGMA, stretched, through_jpeg
from tests.bench.peers.scoring import Candidate, Judged, Line, judge, summary

ByteArray = npt.NDArray[np.uint8]
BLOCK, QUALITY = 8, 95
FALSE_PER_FRAME = (0.1, 1.0)


def maps_of(bench: BenchFrame) -> Mapping[str, ByteArray]:
    """The same frame as the network may see it: one step changed at a time."""
    pixels = bench.frame.pixels
    high, wide = (side // BLOCK for side in pixels.shape)
    pixels = pixels[: high * BLOCK, : wide * BLOCK]
    low, top = np.percentile(pixels[::4, ::4], (0.5, 99.5))
    plain = np.clip((pixels.astype(np.float32) - low) * (255 / (top - low)), 0, 255)
    grey = through_jpeg(stretched(bench.frame), QUALITY)[: high * BLOCK, : wide * BLOCK]
    maps = {
        "grey, plain stretch, mean of a block": _mean(plain.astype(np.uint8)),
        "grey, plain stretch, maximum of a block": block_maximum(plain.astype(np.uint8), BLOCK),
        "grey, local sky, mean of a block": _mean(grey),
        "grey, local sky, maximum of a block": block_maximum(grey, BLOCK),
    }
    for sigmas in (2.0, 3.0, 4.0, 5.0):
        white = ((grey > BLACK + PER_SIGMA * sigmas) * 255).astype(np.uint8)
        maps[f"binary at {sigmas:g} sigma, maximum of a block"] = block_maximum(white, BLOCK)
    white = ((grey > BLACK + PER_SIGMA * 4.0) * 255).astype(np.uint8)
    maps["binary at 4 sigma, mean of a block"] = _mean(white)
    maps["graded signal to noise, bins of 1 pixel"] = _graded(pixels, 1)
    maps["graded signal to noise, bins of 2"] = _graded(pixels, 2)
    lines = make_map(pixels, "fast", BLOCK).values
    maps["graded signal to noise of lines, bins of 2 (the product's)"] = lines
    maps["the last, binarised at 4 sigma"] = ((lines > to_map_bytes(_four())[0, 0]) * 255).astype(
        np.uint8
    )
    return maps


def _four() -> npt.NDArray[np.float32]:
    return np.full((1, 1), 4.0, dtype=np.float32)


def _mean(values: ByteArray) -> ByteArray:
    size = values.shape[1] // BLOCK, values.shape[0] // BLOCK
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _graded(pixels: npt.NDArray[Any], binning: int) -> ByteArray:
    bins = mean_of_squares(pixels.astype(np.float32), binning)
    sky = local_background(pixels)
    level = resample(sky.level, sky.cell_px // binning, *bins.shape)
    noise = resample(sky.noise, sky.cell_px // binning, *bins.shape) / np.float32(binning)
    return to_map_bytes(block_maximum((bins - level) / noise, BLOCK // binning))


def compare(frames: Iterable[BenchFrame]) -> dict[str, Any]:
    """For every map: median confidence of each range of SNR (0 where missed), and its figures."""
    network = Network.load(None, 2)
    judged: dict[str, list[Judged]] = {}
    for bench in frames:
        for name, values in maps_of(bench).items():
            frame_map = FrameMap(
                values=values,
                block=BLOCK,
                mode="fast",
                width_px=values.shape[1] * BLOCK,
                height_px=values.shape[0] * BLOCK,
            )
            candidates = []
            for box in network.run(frame_map):
                x_a, y_a, x_b, y_b = box.ends_px
                line = Line(x_a_px=x_a, y_a_px=y_a, x_b_px=x_b, y_b_px=y_b)
                candidates.append(Candidate(line=line, score=box.confidence))
            judged.setdefault(name, []).append(judge(candidates, bench.truth))
    return {
        name: {
            "confidence": {
                f"{low:g}-{high:g}": _median_confidence(each, low, high) for low, high in SNR_BINS
            },
            "figures": summary(each, SNR_BINS, FALSE_PER_FRAME),
        }
        for name, each in judged.items()
    }


def _median_confidence(judged: list[Judged], low: float, high: float) -> float:
    scores = [score or 0.0 for j in judged for t, score, _ in j.found if low <= t.snr < high]
    return float(np.median(scores)) if scores else float("nan")
