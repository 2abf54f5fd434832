"""The product's own detector, and the paper's recipe in the form the product offers it."""

from collections.abc import Callable, Mapping
from typing import Any

from rsoconsole.config import DetectorConfig
from rsoconsole.records import Detection, Frame
from rsoconsole.vision import ConfidenceCurve, Network, StreakDetector
from tests.bench.peers.scoring import Candidate, Line

SETTINGS: Mapping[str, Any] = {"map_mode": "fast", "centroid": "line", "threads": 2}
PAPER_SETTINGS: Mapping[str, Any] = {"map_mode": "paper", "centroid": "box", "threads": 2}
GRID: tuple[Mapping[str, Any], ...] = ()


def open_peer(settings: Mapping[str, Any]) -> Callable[[Frame], list[Candidate]]:
    """The detector with nothing held back: tau 0, so that its ranking can be judged."""
    config = DetectorConfig(**settings)
    network = Network.load(config.model, config.threads)
    detector = StreakDetector(network, config, ConfidenceCurve.from_card(network.card))

    def find(frame: Frame) -> list[Candidate]:
        return [_as_candidate(d) for d in detector.detect(frame, tau=0.0).detections]

    return find


def _as_candidate(detection: Detection) -> Candidate:
    """Ends of the line, shifted onto the centroid where that is the box's centre."""
    dx = detection.x_px - (detection.x_a_px + detection.x_b_px) / 2
    dy = detection.y_px - (detection.y_a_px + detection.y_b_px) / 2
    line = Line(
        x_a_px=detection.x_a_px + dx,
        y_a_px=detection.y_a_px + dy,
        x_b_px=detection.x_b_px + dx,
        y_b_px=detection.y_b_px + dy,
    )
    return Candidate(line=line, score=detection.confidence)
