"""Independent frames, altered as ordinary nights alter them: their satellites are found still.

SatSim drew the frames; here they are blurred, drawn out, striped or binned, then given the noise
of a sensor again. Whatever blurs the whole image blurs the satellite's streak too.
"""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from rsoconsole.config import DetectorConfig
from rsoconsole.instruments import read_frame
from rsoconsole.records import Detection, Frame, PixelArray
from rsoconsole.sky import line_angle_deg
from rsoconsole.vision import ConfidenceCurve, Network, StreakDetector, local_background
from tests.tiers import plain_first

FOLDER = Path(__file__).resolve().parents[3] / "shared" / "data" / "simulated" / "geo_single"
pytestmark = [
    pytest.mark.shared_data,
    pytest.mark.skipif(not FOLDER.exists(), reason="../shared/data is not here"),
]
HALF_PX = (900, 700)
Alter = Callable[[PixelArray, np.random.Generator], PixelArray]


def _convolved(kernel: np.ndarray) -> Alter:
    kernel = (kernel / kernel.sum()).astype(np.float32)

    def alter(pixels: PixelArray, rng: np.random.Generator) -> PixelArray:
        noise = float(np.median(local_background(pixels).noise))
        blurred = cv2.filter2D(pixels.astype(np.float32), -1, kernel, borderType=cv2.BORDER_REFLECT)
        # The image's own noise is blurred with it: as much as that took away comes again.
        left = noise * math.sqrt(float((kernel**2).sum()))
        return blurred + rng.normal(0.0, math.sqrt(noise**2 - left**2), blurred.shape)

    return alter


def _disc(sigma: float) -> np.ndarray:
    across = cv2.getGaussianKernel(2 * math.ceil(4 * sigma) + 1, sigma)
    return np.asarray(across @ across.T)


def _trail(length: float, angle_deg: float) -> np.ndarray:
    reach = math.ceil(length / 2) + 3
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1))
    for at in np.linspace(-0.5, 0.5, round(40 * length)) * length:
        x, y = at * math.cos(math.radians(angle_deg)), at * math.sin(math.radians(angle_deg))
        kernel[round(y) + reach, round(x) + reach] += 1.0
    return cv2.GaussianBlur(kernel, (0, 0), 0.4)


def _striped(pixels: PixelArray, rng: np.random.Generator) -> PixelArray:
    noise = float(np.median(local_background(pixels).noise))
    rows = rng.normal(0.0, 1.5 * noise, (pixels.shape[0], 1))
    columns = rng.normal(0.0, 0.7 * noise, (1, pixels.shape[1]))
    return pixels + rows + columns


ALTERATIONS: dict[str, Alter] = {
    "as it is": lambda pixels, _: pixels,
    "blurred by 2 px": _convolved(_disc(2.0)),
    "stars trailed by 12 px": _convolved(_trail(12.0, 115.0)),
    "rows and columns": _striped,
}


@pytest.fixture(scope="module")
def detector() -> StreakDetector:
    network = Network.load(None, 2)
    return StreakDetector(network, DetectorConfig(), ConfidenceCurve.from_card(network.card))


@pytest.fixture(scope="module")
def frames() -> list[tuple[Frame, tuple[float, float, float, float]]]:
    """Parts of the frames about each satellite, and its ends in them."""
    told = json.loads((FOLDER / "truth.json").read_text(encoding="utf-8"))
    found = []
    for number, one in enumerate(told["frames"][:2]):
        whole, true = read_frame(FOLDER / one["file"], number), one["objects"][0]
        x, y = round(true["x"]), round(true["y"])
        x0, y0 = max(x - HALF_PX[0], 0), max(y - HALF_PX[1], 0)
        part = whole.pixels[y0 : y + HALF_PX[1], x0 : x + HALF_PX[0]]
        frame = Frame(
            frame_id=number,
            name=one["file"],
            pixels=np.ascontiguousarray(part),
            exposure_s=10.0,
            scale_arcsec_px=told["scale_arcsec"],
        )
        ends = (true["x_start"] - x0, true["y_start"] - y0, true["x_end"] - x0, true["y_end"] - y0)
        found.append((frame, ends))
    return found


def _is_on(found: Detection, ends: tuple[float, ...]) -> bool:
    middle = 0.5 * (ends[0] + ends[2]), 0.5 * (ends[1] + ends[3])
    angle = math.degrees(math.atan2(ends[3] - ends[1], ends[2] - ends[0])) % 180.0
    is_near = math.hypot(found.x_px - middle[0], found.y_px - middle[1]) < 8.0
    return is_near and line_angle_deg(found.angle_deg, angle) < 4.0


@pytest.mark.parametrize("name", plain_first(1, ALTERATIONS))
def test_the_satellite_is_found_and_nothing_else(name: str, detector: Any, frames: Any) -> None:
    for frame, ends in frames:
        pixels = ALTERATIONS[name](frame.pixels, np.random.default_rng(frame.frame_id))
        stored = np.clip(np.rint(pixels), 0, 65535).astype(np.uint16)
        altered = Frame(
            frame_id=frame.frame_id,
            name=name,
            pixels=stored,
            exposure_s=frame.exposure_s,
            scale_arcsec_px=frame.scale_arcsec_px,
        )
        found = detector.detect(altered, tau=0.1).detections
        assert [_is_on(each, ends) for each in found] == [True]


@pytest.mark.parametrize(
    "kernel",
    [_disc(4.0), _trail(30.0, 30.0)],
    ids=["blurred by 4 px", "stars trailed by 30 px"],
)
def test_where_it_is_not_believed_it_is_measured_all_the_same(
    kernel: np.ndarray, detector: Any, frames: Any
) -> None:
    """What confidence does not reach tau is on record with its place, and close to the truth."""
    frame, ends = frames[0]
    pixels = _convolved(kernel)(frame.pixels, np.random.default_rng(1))
    stored = np.clip(np.rint(pixels), 0, 65535).astype(np.uint16)
    altered = Frame(
        frame_id=9, name="f", pixels=stored, exposure_s=10.0, scale_arcsec_px=frame.scale_arcsec_px
    )
    analysis = detector.analyse(altered, 0.1)
    placed = [analysis.working.original_detection(each.found) for each in analysis.candidates]
    assert any(_is_on(each, ends) for each in placed)
