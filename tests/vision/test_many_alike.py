"""Many satellites of one slot in a frame that another program drew, rows of the sensor beside them.

Each further satellite is the light of the frame's own one, moved; noise of rows is added.
"""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.config import DetectorConfig
from rsoconsole.instruments import read_frame
from rsoconsole.records import Frame
from rsoconsole.vision import ConfidenceCurve, Network, StreakDetector
from tests.tiers import plain_first

FOLDER = Path(__file__).resolve().parents[3] / "shared" / "data" / "simulated" / "geo_single"
pytestmark = [
    pytest.mark.shared_data,
    pytest.mark.skipif(not FOLDER.exists(), reason="../shared/data is not here"),
]
Place = tuple[float, float]


def field_of(count: int, rows_sigma: float) -> tuple[Frame, list[Place]]:
    """A frame with ``count`` satellites and their middles; rows in units of a pixel's noise."""
    truth = json.loads((FOLDER / "truth.json").read_text())["frames"][0]
    frame = read_frame(FOLDER / truth["file"], 1)
    (one,) = truth["objects"]
    x0, y0, x1, y1 = (one[key] for key in ("x_start", "y_start", "x_end", "y_end"))
    middle = (0.5 * (x0 + x1), 0.5 * (y0 + y1))
    pixels = frame.pixels.astype(np.float32)
    half_x, half_y = math.ceil(abs(x1 - x0) / 2) + 6, math.ceil(abs(y1 - y0) / 2) + 6
    left, top = round(middle[0]) - half_x, round(middle[1]) - half_y
    box = pixels[top : top + 2 * half_y, left : left + 2 * half_x].copy()
    light = box - np.median(box)
    places = [middle]
    for number in range(1, count):
        right, down = 260 * (number % 4) - 400, 170 * (number // 4) - 250
        x, y = left + right, top + down
        pixels[y : y + 2 * half_y, x : x + 2 * half_x] += light
        places.append((middle[0] + right, middle[1] + down))
    noise = 1.4826 * float(np.median(np.abs(np.diff(pixels[::16], axis=1)))) / math.sqrt(2.0)
    rng = np.random.default_rng(5)
    pixels += rng.normal(0.0, rows_sigma * noise, (pixels.shape[0], 1)).astype(np.float32)
    drawn = np.clip(np.rint(pixels), 0, 65535).astype(np.uint16)
    return replace(frame, pixels=drawn), places


@pytest.mark.parametrize(
    ("count", "rows_sigma"), plain_first(1, [(4, 1.7), (4, 0.0), (12, 0.0), (12, 1.7)])
)
def test_every_satellite_of_a_slot_is_found(count, rows_sigma):
    network = Network.load(None, 1)
    curve = ConfidenceCurve.from_card(network.card)
    frame, places = field_of(count, rows_sigma)
    found = StreakDetector(network, DetectorConfig(threads=1), curve).detect(frame)
    seen = [(d.x_px, d.y_px) for d in found.detections]
    missed = [(x, y) for x, y in places if not any(math.hypot(x - u, y - v) < 5.0 for u, v in seen)]
    assert missed == []
