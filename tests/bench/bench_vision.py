"""How long each stage of vision takes on a frame of the paper's camera.

Run from the project's root: ``python -m tests.bench.bench_vision [--repeats 9] [--threads 1]``.
Prints the median and the largest of the repeats; asserts nothing.
"""

import argparse
import time
from collections.abc import Callable
from statistics import median

import cv2
import numpy as np

from rsoconsole.config import DetectorConfig, OpticsConfig
from rsoconsole.errors import ModelError
from rsoconsole.records import Frame
from rsoconsole.simulator.psf import add_points
from rsoconsole.vision.background import local_background
from rsoconsole.vision.detector import Proposer, StreakDetector
from rsoconsole.vision.maps import FrameMap, make_map
from rsoconsole.vision.network import Network, NetworkBox
from rsoconsole.vision.stars import find_stars
from rsoconsole.vision.streak_fit import fit_streak

START_PX, END_PX = (2000.0, 1500.0), (2118.0, 1512.0)


class OneProposal:
    """Stands in where no trained network is installed."""

    def run(self, frame_map: FrameMap) -> tuple[NetworkBox, ...]:
        """The one streak of the benchmark's frame."""
        return (
            NetworkBox(
                confidence=0.9,
                x0_px=START_PX[0] - 5,
                y0_px=START_PX[1] - 5,
                x1_px=END_PX[0] + 5,
                y1_px=END_PX[1] + 5,
                x_a_px=START_PX[0] + 3,
                y_a_px=START_PX[1] - 2,
                x_b_px=END_PX[0] + 2,
                y_b_px=END_PX[1] + 2,
            ),
        )


def bench_frame(optics: OpticsConfig) -> Frame:
    """Sky, 4,000 stars and a GEO streak whose brightest pixel stands 5 sigma out."""
    rng = np.random.default_rng(1)
    light = np.zeros((optics.height_px, optics.width_px), dtype=np.float32)
    count = 4000
    flux = (38.0 * 10 ** rng.uniform(1, 3.5, count)).astype(np.float32)
    x, y = rng.uniform(0, optics.width_px, count), rng.uniform(0, optics.height_px, count)
    add_points(light, x, y, flux, sigma_px=0.95, faintest_e=0.1)
    t = (np.arange(600) + 0.5) / 600
    x = START_PX[0] + (END_PX[0] - START_PX[0]) * t
    y = START_PX[1] + (END_PX[1] - START_PX[1]) * t
    add_points(light, x, y, np.full(600, 90.0, np.float32), sigma_px=0.95, faintest_e=0.01)
    light += 730 + 38 * rng.standard_normal(light.shape, dtype=np.float32)
    pixels = np.clip(np.rint(light / 16) * 16, 0, 65520).astype(np.uint16)
    return Frame(
        frame_id=1,
        name="bench",
        pixels=pixels,
        exposure_s=10.0,
        scale_arcsec_px=optics.scale_arcsec_px,
        saturation_adu=65520.0,
    )


def timed_ms(action: Callable[[], object], repeats: int) -> list[float]:
    """Wall times after one run that warms up."""
    action()
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        action()
        times.append((time.perf_counter() - began) * 1e3)
    return times


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    cv2.setNumThreads(options.threads)
    frame = bench_frame(OpticsConfig())
    network: Proposer = OneProposal()
    named = "a stand-in that answers at once"
    try:
        loaded = Network.load(threads=options.threads)
        network, named = loaded, loaded.version
    except ModelError as error:
        print(f"no trained network: {error}")
    sky = local_background(frame.pixels)
    stars = find_stars(frame.pixels, sky)
    fast = make_map(frame.pixels, "fast", 8)
    box = (START_PX[0] - 5, START_PX[1] - 5, END_PX[0] + 5, END_PX[1] + 5)
    detector = StreakDetector(network, DetectorConfig(threads=options.threads))
    stages: dict[str, Callable[[], object]] = {
        "background": lambda: local_background(frame.pixels),
        "stars": lambda: find_stars(frame.pixels, sky, saturation_adu=frame.saturation_adu),
        "map, fast": lambda: make_map(frame.pixels, "fast", 8),
        "map, paper": lambda: make_map(frame.pixels, "paper", 8),
        "network": lambda: network.run(fast),
        "fit of one streak": lambda: fit_streak(frame.pixels, sky, box, stars=stars),
        "detector, all stages": lambda: detector.detect(frame),
    }
    print(f"{frame.width_px} x {frame.height_px} uint16, {options.threads} thread(s), {named}")
    print(f"{'stage':22s}{'median ms':>10s}{'largest ms':>12s}   of {options.repeats}")
    for name, action in stages.items():
        times = timed_ms(action, options.repeats)
        print(f"{name:22s}{median(times):10.1f}{max(times):12.1f}")


if __name__ == "__main__":
    main()
