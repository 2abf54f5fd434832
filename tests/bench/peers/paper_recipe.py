"""The paper's recipe to the letter: a full-resolution black-and-white JPEG, the box's centre.

Jordan et al. (arXiv 2304.06227). Their weights are not public: the product's network stands in.
It looks at the JPEG pixel by pixel, in tiles (``reduce`` "no"), or at the JPEG brought to its
input's size as image libraries do it ("linear", "area").
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from rsoconsole.records import Frame
from rsoconsole.vision import FrameMap, Network, NetworkBox, local_background, resample
from tests.bench.peers.scoring import Candidate, Line

SETTINGS: Mapping[str, Any] = {"white_sigma": 2.0, "quality": 95, "reduce": "area"}
GRID: tuple[Mapping[str, Any], ...] = (
    {"reduce": "no"},
    {"reduce": "no", "white_sigma": 3.0},
    {"reduce": "no", "white_sigma": 4.0},
    {"reduce": "linear", "white_sigma": 3.0},
    {"white_sigma": 3.0},
)
BLACK, PER_SIGMA = 50.0, 10.0
REDUCED_BLOCK = 8
REDUCING = {"linear": cv2.INTER_LINEAR, "area": cv2.INTER_AREA}


def stretched(frame: Frame) -> npt.NDArray[np.uint8]:
    """Eight bits: the local sky at 50, ten steps a sigma."""
    sky = local_background(frame.pixels)
    shape = frame.pixels.shape
    level = resample(sky.level, sky.cell_px, *shape)
    gain = np.float32(PER_SIGMA) / resample(sky.noise, sky.cell_px, *shape)
    bright = (frame.pixels.astype(np.float32) - level) * gain + np.float32(BLACK)
    out: npt.NDArray[np.uint8] = np.clip(bright, 0, 255).astype(np.uint8)
    return out


def through_jpeg(values: npt.NDArray[np.uint8], quality: int) -> npt.NDArray[np.uint8]:
    """What is left after a JPEG on disk."""
    with TemporaryDirectory() as folder:
        path = str(Path(folder) / "frame.jpg")
        cv2.imwrite(path, values, [cv2.IMWRITE_JPEG_QUALITY, quality])
        back = cv2.imread(path, cv2.IMREAD_GRAYSCALE)
    assert back is not None, "OpenCV could not read what it had written"
    return np.asarray(back, dtype=np.uint8)


def open_peer(settings: Mapping[str, Any]) -> Callable[[Frame], list[Candidate]]:
    """Stretch, JPEG, threshold, JPEG, network, centre of the box."""
    network = Network.load(None, 2)
    white_above = BLACK + PER_SIGMA * settings["white_sigma"]

    def find(frame: Frame) -> list[Candidate]:
        grey = through_jpeg(stretched(frame), settings["quality"])
        _, white = cv2.threshold(grey, white_above, 255, cv2.THRESH_BINARY)
        values = through_jpeg(white, settings["quality"])
        _, values = cv2.threshold(values, 127, 255, cv2.THRESH_BINARY)
        block = 1 if settings["reduce"] == "no" else REDUCED_BLOCK
        if block > 1:
            size = frame.width_px // block, frame.height_px // block
            values = cv2.resize(values, size, interpolation=REDUCING[settings["reduce"]])
        whole = FrameMap(
            values=np.asarray(values, dtype=np.uint8),
            block=block,
            mode="paper",
            width_px=frame.width_px,
            height_px=frame.height_px,
        )
        return [_at_box_centre(box) for box in network.run(whole)]

    return find


def _at_box_centre(box: NetworkBox) -> Candidate:
    (x0, y0, x1, y1), (x_a, y_a, x_b, y_b) = box.corners_px, box.ends_px
    x, y, dx, dy = (x0 + x1) / 2, (y0 + y1) / 2, (x_b - x_a) / 2, (y_b - y_a) / 2
    line = Line(x_a_px=x - dx, y_a_px=y - dy, x_b_px=x + dx, y_b_px=y + dy)
    return Candidate(line=line, score=box.confidence)
