"""OpenCV's line segment detector on the stretched frame (von Gioi et al. 2012)."""

from collections.abc import Callable, Mapping
from typing import Any

import cv2
import numpy as np

from rsoconsole.records import Frame
from tests.bench.peers.joining import joined
from tests.bench.peers.paper_recipe import stretched
from tests.bench.peers.scoring import Candidate, Line

SETTINGS: Mapping[str, Any] = {
    "binning": 1,
    "scale": 0.5,
    "sigma_scale": 0.6,
    "shortest_px": 20.0,
    "rank": "nfa",
}
GRID: tuple[Mapping[str, Any], ...] = (
    {"scale": 0.8},
    {"scale": 0.4},
    {"rank": "length"},
    {"scale": 0.8, "binning": 2},
    {"scale": 1.0, "binning": 2},
    {"sigma_scale": 0.9},
)


def open_peer(settings: Mapping[str, Any]) -> Callable[[Frame], list[Candidate]]:
    """Segments with their number of false alarms; the two edges of a streak are joined."""
    chosen = {**SETTINGS, **settings}
    detector = cv2.createLineSegmentDetector(
        cv2.LSD_REFINE_ADV, scale=chosen["scale"], sigma_scale=chosen["sigma_scale"]
    )

    def find(frame: Frame) -> list[Candidate]:
        grey, bins = stretched(frame), chosen["binning"]
        if bins > 1:
            size = frame.width_px // bins, frame.height_px // bins
            grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
            sky = float(np.median(grey))
            grey = np.clip((grey.astype(np.float32) - sky) * bins + 50.0, 0, 255).astype(np.uint8)
        lines, _, _, nfa = detector.detect(grey)
        if lines is None:
            return []
        ends = lines.reshape(-1, 4).astype(np.float64) * bins + (bins - 1) / 2
        length = np.hypot(ends[:, 2] - ends[:, 0], ends[:, 3] - ends[:, 1])
        score = length if chosen["rank"] == "length" else np.asarray(nfa, dtype=float).ravel()
        found = [
            Candidate(line=Line(x_a_px=a, y_a_px=b, x_b_px=c, y_b_px=d), score=float(score[i]))
            for i, (a, b, c, d) in enumerate(ends.tolist())
            if length[i] >= chosen["shortest_px"]
        ]
        return joined(found)

    return find
