"""Fit the curve that turns a measured candidate into a probability, and judge it on other frames.

    python -m models.confidence [--frames 400] [--seed 7]

Draws whole frames of the simulated telescope on the real sky, half of them with streaks of every
brightness, angle and length, runs the product's detector over them, and fits the logistic curve
of ``vision.confidence`` to what was true. Frames of odd number fit, those of even number judge.
The constant is then moved so that no more than one false candidate in ``FRAMES_PER_FALSE`` of all
these frames lies above tau = 0.10: streaks are far rarer in a real night than here, so tau is a
setting of false alarms, not the prevalence of this set; and it was set on these very frames.
Writes ``measured_confidence`` into the network's card.
"""

import argparse
import json
import math
import multiprocessing
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from rsoconsole.config import DetectorConfig
from rsoconsole.records import Detection, Frame
from rsoconsole.simulator.render import Streak, frame_rng, render, straight_streak
from rsoconsole.simulator.scenarios import scenario_named
from rsoconsole.simulator.scene import Scene
from rsoconsole.sky.wcs import tan_wcs
from rsoconsole.vision.confidence import FEATURES, confidence_features
from rsoconsole.vision.detector import StreakDetector
from rsoconsole.vision.network import Network

FloatArray = npt.NDArray[np.float64]
Row = tuple[int, bool, float, tuple[float, ...]]
"""Frame, truth, peak SNR of the truth (0 for a false candidate), features."""

CARD = Path(__file__).parent / "streak_ssd.json"
_NIGHTS = ("intelsat-14", "intelsat-21")
_SAME_PX = 12.0
_RIDGE = 0.1
TAU = 0.10
FRAMES_PER_FALSE = 400


def draw(number: int, seed: int) -> tuple[Frame, list[tuple[Streak, float]]]:
    """One frame somewhere on the belt, and the streaks in it with their peak SNR."""
    rng = frame_rng(seed, number, 91)
    scenario = scenario_named(_NIGHTS[int(rng.integers(len(_NIGHTS)))])
    scene = Scene(scenario, seed + number)
    sensor = scene.sensor
    t_utc_ns = scenario.t_start_utc_ns + int(rng.uniform(0.0, 1200.0)) * 1_000_000_000
    wcs = tan_wcs(
        float(rng.uniform(280.0, 340.0)),
        float(rng.uniform(-10.0, 10.0)),
        scale_arcsec_px=sensor.scale_arcsec_px,
        rotation_deg=float(rng.uniform(0.0, 360.0)),
        is_flipped=False,
        width_px=sensor.width_px,
        height_px=sensor.height_px,
    )
    content = scene.field_content(wcs, t_utc_ns, 10.0)
    streaks = []
    for _ in range(int(rng.integers(0, 3)) if number % 4 < 2 else 0):
        peak_snr = float(np.exp(rng.uniform(math.log(0.6), math.log(15.0))))
        length_px = float(rng.choice([118.5, np.exp(rng.uniform(math.log(20.0), math.log(300.0)))]))
        angle = float(rng.uniform(0.0, 2.0 * math.pi))
        x, y = rng.uniform(200, sensor.width_px - 200), rng.uniform(200, sensor.height_px - 200)
        half = 0.5 * length_px * np.array([math.cos(angle), math.sin(angle)])
        noise_e = math.sqrt(content.sky_electrons_px + sensor.read_noise_e**2 + 4.0)
        sigma_px = math.sqrt((content.fwhm_px / 2.3548) ** 2 + 1.0 / 12.0)
        electrons = peak_snr * noise_e * sigma_px * math.sqrt(2.0 * math.pi) * length_px
        ends = (float(x - half[0]), float(y - half[1])), (float(x + half[0]), float(y + half[1]))
        streaks.append((straight_streak(*ends, electrons), peak_snr))
    content = replace(content, streaks=tuple(streak for streak, _ in streaks))
    pixels = render(sensor, content, frame_rng(seed, number, 92))
    frame = Frame(
        frame_id=number,
        name=str(number),
        pixels=pixels,
        exposure_s=10.0,
        scale_arcsec_px=sensor.scale_arcsec_px,
        saturation_adu=sensor.saturation_adu,
    )
    return frame, streaks


def rows_of(number: int, seed: int) -> tuple[list[Row], list[tuple[float, bool]]]:
    """Candidates of one frame with their truth; peak SNR of its streaks and whether measured."""
    frame, streaks = draw(number, seed)
    analysis = _detector().analyse(frame, tau=0.0)
    rows: list[Row] = []
    met: set[int] = set()
    for detection in analysis.detections.detections:
        index = _truth_of(detection, streaks)
        if index is not None:
            met.add(index)
        features = confidence_features(detection, analysis.stars.median_fwhm_px)
        peak_snr = 0.0 if index is None else streaks[index][1]
        rows.append((number, index is not None, peak_snr, features))
    return rows, [(snr, i in met) for i, (_, snr) in enumerate(streaks)]


def fit(features: FloatArray, is_true: npt.NDArray[np.bool_]) -> FloatArray:
    """Weights of the logistic curve by maximum likelihood, a little held back to zero."""
    sign = np.where(is_true, 1.0, -1.0)

    def cost(weights: FloatArray) -> float:
        margin = np.logaddexp(0.0, -sign * (features @ weights))
        return float(margin.sum() + _RIDGE * (weights[1:] ** 2).sum())

    return np.asarray(minimize(cost, np.zeros(features.shape[1])).x)


def judge(
    rows: Sequence[Row], streaks: Sequence[tuple[float, bool]], weights: FloatArray, frames: int
) -> dict[str, Any]:
    """Figures at tau = 0.10 on frames that did not fit the curve."""
    truth = np.array([row[1] for row in rows])
    p = 1.0 / (1.0 + np.exp(-np.array([row[3] for row in rows]) @ weights))
    snr = np.array([row[2] for row in rows])
    figures: dict[str, Any] = {
        "frames": frames,
        "candidates": len(rows),
        "true": int(truth.sum()),
        "false_above_tau": int(((p > TAU) & ~truth).sum()),
        "recall": {},
        "reliability": {},
    }
    for low, high in ((0.6, 1.0), (1.0, 1.5), (1.5, 2.5), (2.5, 4.0), (4.0, 15.0)):
        asked = sum(low <= s < high for s, _ in streaks)
        found = int(((p > TAU) & truth & (snr >= low) & (snr < high)).sum())
        figures["recall"][f"{low}-{high}"] = [found, asked]
    for low, high in ((0.0, 0.1), (0.1, 0.5), (0.5, 0.9), (0.9, 1.0)):
        inside = (p >= low) & (p <= high)
        if inside.any():
            share, said = float(truth[inside].mean()), float(p[inside].mean())
            figures["reliability"][f"{low}-{high}"] = [
                int(inside.sum()),
                round(said, 3),
                round(share, 3),
            ]
    return figures


def _truth_of(detection: Detection, streaks: list[tuple[Streak, float]]) -> int | None:
    for index, (streak, _) in enumerate(streaks):
        middle = np.array([streak.x_px.mean(), streak.y_px.mean()])
        along = np.array([streak.x_px[-1] - streak.x_px[0], streak.y_px[-1] - streak.y_px[0]])
        length = float(np.hypot(*along))
        off = np.array([detection.x_px, detection.y_px]) - middle
        across = abs(float(np.cross(along / length, off)))
        if across < _SAME_PX and abs(float(off @ along) / length) < length / 2.0:
            return index
    return None


def _detector() -> StreakDetector:
    if not _made:
        _made.append(StreakDetector(Network.load(None, 1), DetectorConfig(threads=1)))
    return _made[0]


_made: list[StreakDetector] = []


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m models.confidence", description=__doc__)
    parser.add_argument("--frames", type=int, default=400)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    with multiprocessing.get_context("spawn").Pool(args.workers) as pool:
        work = [(number, args.seed) for number in range(args.frames)]
        results = pool.starmap(rows_of, work, chunksize=8)
    halves: list[list[Row]] = [[], []]
    asked: list[list[tuple[float, bool]]] = [[], []]
    for number, (rows, streaks) in enumerate(results):
        halves[number % 2] += rows
        asked[number % 2] += streaks
    fitted = np.array([row[3] for row in halves[1]])
    is_true = np.array([row[1] for row in halves[1]])
    weights = fit(fitted, is_true)
    false_z = sorted(
        (float(np.dot(row[3], weights)) for rows in halves for row in rows if not row[1]),
        reverse=True,
    )
    allowed = args.frames // FRAMES_PER_FALSE
    at_rate = false_z[allowed] if len(false_z) > allowed else -math.inf
    weights[0] += min(0.0, math.log(TAU / (1.0 - TAU)) - at_rate)
    figures = judge(halves[0], asked[0], weights, args.frames // 2)
    card = json.loads(CARD.read_text(encoding="utf-8"))
    card["measured_confidence"] = {
        "weights": dict(zip(FEATURES, (round(float(w), 6) for w in weights), strict=True)),
        "seed": args.seed,
        "judged": figures,
    }
    CARD.write_text(json.dumps(card, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(card["measured_confidence"], indent=1))


if __name__ == "__main__":
    main()
