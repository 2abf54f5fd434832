"""How long vision takes from a frame in memory to measured streaks, and how much memory.

    python -m tests.bench.bench_vision [--repeats 9] [--threads 1 2] [--frames 6] [--write]

Run from the project's root. The detector is made as the product makes it, with the confidence
curve of the network's card, and sees 4656 x 3520 frames of 16 bits: one of noise, stars and one
streak, and some drawn by the simulated telescope on the real sky, one of every kind. Every
number of threads has a process of its own; memory is measured in yet another. Prints medians,
asserts nothing; ``--write`` keeps the figures in ``results/vision.json``.
"""

import argparse
import json
import multiprocessing
import os
import pickle
import platform
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from models.frames import KINDS, draw
from rsoconsole.cli import ONE_THREAD
from rsoconsole.config import DetectorConfig, OpticsConfig
from rsoconsole.records import Frame
from rsoconsole.simulator.camera.psf import add_points
from rsoconsole.vision import ConfidenceCurve, Network, StreakDetector

RESULTS = Path(__file__).parent / "results" / "vision.json"
START_PX, END_PX = (2000.0, 1500.0), (2118.0, 1512.0)
FIRST = 900_000
"""Number of the first frame drawn: far beyond those that the curve was fitted on."""
STAGES = ("background", "map", "stars", "network", "fit")
WARM_PX = 512
REST_S = 1.0
_MB = 1024.0 * 1024.0


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


def save_frame(number: int, path: Path) -> str:
    """Draw a frame, 0 being the one of noise and stars; returns what it is called."""
    if number == 0:
        frame, name = bench_frame(OpticsConfig()), "noise, stars, a streak"
    else:
        kind = KINDS[(number - 1) % len(KINDS)]
        frame = draw("calibrate", kind, FIRST + number).frame
        name = f"drawn: {kind}"
    np.save(path.with_suffix(".npy"), frame.pixels)
    path.write_bytes(pickle.dumps(replace(frame, name=name, pixels=frame.pixels[:1])))
    return name


def time_stages(paths: list[Path], threads: int, repeats: int) -> dict[str, Any]:
    """Medians in ms by frame and stage, by the wall's clock and by the processor's.

    "cold": the frame looked at for the first time, after ``REST_S`` without work, as at night.
    """
    detector, _ = _detector(threads)
    detector.analyse(_load(paths[0]))
    figures: dict[str, Any] = {}
    for path in paths:
        frame = _load(path)
        time.sleep(REST_S)
        began = time.perf_counter()
        detector.analyse(frame)
        cold_s = time.perf_counter() - began
        rows: list[dict[str, float]] = []
        for _ in range(repeats):
            began, began_cpu = time.perf_counter(), time.process_time()
            analysis = detector.analyse(frame)
            whole = {
                "all": time.perf_counter() - began,
                "all, CPU": time.process_time() - began_cpu,
            }
            rows.append(dict(analysis.detections.stage_ms) | {k: s * 1e3 for k, s in whole.items()})
        figures[frame.name] = {
            name: round(median(row[name] for row in rows), 2)
            for name in (*STAGES, "all", "all, CPU")
        } | {
            "cold": round(cold_s * 1e3, 2),
            "largest": round(max(row["all"] for row in rows), 2),
            "detections": len(analysis.detections.detections),
            "rejected": len(analysis.detections.rejected),
            "stars found": len(analysis.stars),
        }
    return figures


def measure_memory(paths: list[Path], threads: int) -> dict[str, float]:
    """Most that one frame needs beyond the loaded program and the frame itself, in MB.

    "resident" is the kernel's count of the whole process, "arrays" what Python and NumPy asked
    for. The program is loaded and warm: a small cut of a frame has been through it.
    """
    detector, _ = _detector(threads)
    first = _load(paths[0])
    small = np.ascontiguousarray(first.pixels[:WARM_PX, :WARM_PX])
    detector.analyse(replace(first, pixels=small))
    most = {"resident": 0.0, "arrays": 0.0}
    for path in paths:
        frame = _load(path)
        most["resident"] = max(most["resident"], _peak_mb(lambda: detector.analyse(frame)))  # noqa: B023 # called at once
    tracemalloc.start()
    for path in paths:
        frame = _load(path)
        tracemalloc.reset_peak()
        before, _ = tracemalloc.get_traced_memory()
        detector.analyse(frame)
        most["arrays"] = max(most["arrays"], (tracemalloc.get_traced_memory()[1] - before) / _MB)
    return {name: round(value, 1) for name, value in most.items()}


def _peak_mb(action: Callable[[], object]) -> float:
    """By how much the process grows at most while ``action`` runs (Linux)."""
    Path("/proc/self/clear_refs").write_text("5")
    before_mb = _resident_mb()
    action()
    return _resident_mb() - before_mb


def _resident_mb() -> float:
    rows = Path("/proc/self/status").read_text().splitlines()
    return next(float(row.split()[1]) / 1024.0 for row in rows if row.startswith("VmHWM"))


def _detector(threads: int) -> tuple[StreakDetector, Network]:
    settings = DetectorConfig(threads=threads)
    network = Network.load(settings.model, settings.threads)
    return StreakDetector(network, settings, ConfidenceCurve.from_card(network.card)), network


def _load(path: Path) -> Frame:
    return replace(pickle.loads(path.read_bytes()), pixels=np.load(path.with_suffix(".npy")))


def _apart(work: Callable[..., Any], *arguments: Any) -> Any:
    """The answer of ``work`` from a process of its own, which reads its environment again."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(work, arguments)


def main() -> None:
    """Measure, print, and write when asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument(
        "--frames", type=int, default=len(KINDS), help="drawn ones, beside the other"
    )
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")
    figures: dict[str, Any] = {
        "network": Network.load().version,
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "load_before": round(os.getloadavg()[0], 1),
        "repeats": options.repeats,
        "unit": "ms",
    }
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / str(number) for number in range(options.frames + 1)]
        for number, path in enumerate(paths):
            _apart(save_frame, number, path)
        for threads in options.threads:
            stages = _apart(time_stages, paths, threads, options.repeats)
            memory_mb = _apart(measure_memory, paths, threads)
            figures[f"threads {threads}"] = {"frames": stages, "extra_memory_mb": memory_mb}
            print_table(threads, stages, memory_mb)
    figures["load_after"] = round(os.getloadavg()[0], 1)
    print(f"load {figures['load_before']} before, {figures['load_after']} after")
    if options.write:
        RESULTS.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


def print_table(threads: int, stages: dict[str, Any], memory_mb: dict[str, float]) -> None:
    """One row a frame."""
    columns = (*STAGES, "all", "largest", "all, CPU", "detections", "rejected", "stars found")
    print(f"{threads} thread(s); medians in ms; the stars' time runs beside map and network")
    print(f"{'':24s}" + "".join(f"{name:>12s}" for name in columns))
    for name, row in stages.items():
        print(f"{name:24s}" + "".join(f"{row[column]:12.4g}" for column in columns))
    words = ", ".join(f"{name} {value:.0f}" for name, value in memory_mb.items())
    print(f"extra memory at most, MB: {words}")


if __name__ == "__main__":
    main()
