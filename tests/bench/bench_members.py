"""What each further member of a slot costs a cycle: fold, orbits, names, detection.

    OPENBLAS_NUM_THREADS=1 python -m tests.bench.bench_members [--only following] [--write]

Run from the project's root. Twelve satellites of one slot (`tests/nights/slot_of_twelve.py`), then
the first of them alone; processor's milliseconds of this thread, so that other work on the machine
counts as little as it may. The bar: association and orbits of twelve no more than 40 ms a cycle
beyond those of one, detection no more than 15 ms for a further streak. Frames in which names are
asked for are given by themselves: a track is asked at 3, 4, 6, 9, 14, 21 ... directions. Prints,
asserts nothing; ``--write`` keeps the figures in ``results/members.json``.
"""

import argparse
import json
import os
import platform
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from rsoconsole.config import Config, DetectorConfig, OpticsConfig
from rsoconsole.pipeline import Orbits
from rsoconsole.records import Frame, Identified
from rsoconsole.simulator import elements_path
from rsoconsole.simulator.camera.psf import add_points
from rsoconsole.tracking import Following, FollowSettings, follow
from rsoconsole.vision import ConfidenceCurve, Network, StreakDetector
from tests.nights.slot_of_twelve import MEMBERS, frames, members
from tests.tracking.test_company import settings
from tests.tracking.test_rivals import config as plain_config

RESULTS = Path(__file__).parent / "results" / "members.json"
STEADY_FROM = 5
STREAKS = (1, 6)


def night(count: int, shown: int, config: Config, follow_with: FollowSettings) -> dict[str, Any]:
    """Of each frame the fold's and the orbits' milliseconds, and whether names were asked for."""
    following, orbits = Following(), Orbits(config)
    fold_ms: list[float] = []
    orbits_ms: list[float] = []
    is_naming: list[bool] = []
    for sight in frames(count, shown):
        began_s = time.thread_time()
        following, records = follow(following, sight, follow_with)
        fold_ms.append((time.thread_time() - began_s) * 1e3)
        began_s = time.thread_time()
        for record in (*sight.measurements, *records):
            orbits.receive(record)
        told = orbits.derive_frame_records()
        orbits_ms.append((time.thread_time() - began_s) * 1e3)
        is_naming.append(any(isinstance(each, Identified) for each in told))
    return {
        "tracks": len(following.tracks),
        "fold_ms": fold_ms,
        "orbits_ms": orbits_ms,
        "is_naming": is_naming,
    }


def figures(nights: list[dict[str, Any]]) -> dict[str, float]:
    """Medians over the steady frames of several nights, each frame at its least."""
    fold = np.min([each["fold_ms"] for each in nights], axis=0)[STEADY_FROM:]
    orbits = np.min([each["orbits_ms"] for each in nights], axis=0)[STEADY_FROM:]
    naming = np.array(nights[0]["is_naming"])[STEADY_FROM:]
    both = fold + orbits
    return {
        "tracks": nights[0]["tracks"],
        "fold_ms": round(median(fold), 1),
        "orbits_ms": round(median(orbits[~naming]), 1),
        "both_ms": round(median(both[~naming]), 1),
        "both_p95_ms": round(float(np.quantile(both[~naming], 0.95)), 1),
        "naming_cycle_ms": round(median(both[naming]), 1) if naming.any() else float("nan"),
    }


def following_figures(count: int, repeats: int) -> dict[str, dict[str, float]]:
    """By number of members; the catalogue is the shared one where there is one, else the slot's."""
    shared = Path(__file__).parents[3] / "shared" / "data" / "tles" / "geo_all_20230622.tle"
    with tempfile.TemporaryDirectory() as folder:
        slot = Path(folder) / "slot.tle"
        lines = [f"{m.name}\n{m.line_1}\n{m.line_2}\n" for m in members()]
        slot.write_text("".join(lines), encoding="ascii")
        files = [slot, shared if shared.exists() else elements_path()]
        site = plain_config().site
        config = Config.model_validate(
            {
                "site": site.model_dump(),
                "catalogue": {"tle_files": [str(each) for each in files]},
            }
        )
        follow_with = settings(MEMBERS)
        found = {}
        for shown in (1, MEMBERS):
            nights = [night(count, shown, config, follow_with) for _ in range(repeats)]
            found[str(shown)] = figures(nights)
        return found


def frame_with(streaks: int) -> Frame:
    """Sky, 4,000 stars and so many streaks of 118 px; stars and noise are the same in each."""
    optics = OpticsConfig()
    rng = np.random.default_rng(1)
    light = np.zeros((optics.height_px, optics.width_px), dtype=np.float32)
    count = 4000
    flux = (38.0 * 10 ** rng.uniform(1, 3.5, count)).astype(np.float32)
    x, y = rng.uniform(0, optics.width_px, count), rng.uniform(0, optics.height_px, count)
    add_points(light, x, y, flux, sigma_px=0.95, faintest_e=0.1)
    light += 730 + 38 * rng.standard_normal(light.shape, dtype=np.float32)
    t = (np.arange(600) + 0.5) / 600
    for number in range(streaks):
        x = 2000.0 + 60.0 * number + 118.0 * t
        y = 1200.0 + 150.0 * number + 12.0 * t
        add_points(light, x, y, np.full(600, 180.0, np.float32), sigma_px=0.95, faintest_e=0.01)
    pixels = np.clip(np.rint(light / 16) * 16, 0, 65520).astype(np.uint16)
    return Frame(
        frame_id=1,
        name="bench",
        pixels=pixels,
        exposure_s=10.0,
        scale_arcsec_px=optics.scale_arcsec_px,
        saturation_adu=65520.0,
    )


def detection_figures(repeats: int) -> dict[str, dict[str, Any]]:
    """By number of streaks: found, milliseconds in all and of measuring them."""
    settings_of = DetectorConfig(threads=1)
    network = Network.load(settings_of.model, settings_of.threads)
    detector = StreakDetector(network, settings_of, ConfidenceCurve.from_card(network.card))
    found: dict[str, dict[str, Any]] = {}
    shown = {number: frame_with(number) for number in STREAKS}
    taken: dict[int, list[tuple[float, float, int]]] = {number: [] for number in STREAKS}
    for _ in range(repeats + 1):
        for number, frame in shown.items():
            began_s = time.process_time()
            seen = detector.detect(replace(frame))
            whole_ms = (time.process_time() - began_s) * 1e3
            fit_ms = seen.stage_ms["fit"] + seen.stage_ms["class"]
            taken[number].append((whole_ms, fit_ms, len(seen.detections)))
    for number, rows in taken.items():
        steady = rows[1:]
        found[str(number)] = {
            "detected": steady[0][2],
            "whole_ms": round(median(row[0] for row in steady), 1),
            "measuring_ms": round(median(row[1] for row in steady), 1),
        }
    few, many = STREAKS
    found["a further streak"] = {
        key: round((found[str(many)][key] - found[str(few)][key]) / (many - few), 1)
        for key in ("whole_ms", "measuring_ms")
    }
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--only", choices=["following", "detection"])
    parser.add_argument("--write", action="store_true", help=f"keep the figures in {RESULTS.name}")
    given = parser.parse_args()
    kept: dict[str, Any] = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    if given.only in {None, "following"}:
        kept["following"] = following_figures(given.frames, given.repeats)
        for name, row in kept["following"].items():
            print(f"{name:>2} members: {row}")
        one, twelve = (kept["following"][str(each)] for each in (1, MEMBERS))
        more = {key: round(twelve[key] - one[key], 1) for key in one if key != "tracks"}
        print(f"more with twelve: {more}")
    if given.only in {None, "detection"}:
        kept["detection"] = detection_figures(given.repeats)
        for name, row in kept["detection"].items():
            print(f"{name:>2} streaks: {row}")
    kept["machine"] = f"{platform.machine()}, {os.cpu_count()} cores"
    if given.write:
        RESULTS.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
