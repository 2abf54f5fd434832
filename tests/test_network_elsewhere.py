"""The shipped network on frames that this project did not make."""

import json
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.vision.maps import choose_blocks, make_map
from rsoconsole.vision.network import Network

DATA = Path(__file__).parents[2] / "shared" / "data"
TAU = 0.10
pytestmark = [
    pytest.mark.shared_data,
    pytest.mark.skipif(not DATA.exists(), reason=f"{DATA} is absent"),
]


def _fits(path: Path) -> np.ndarray:
    from astropy.io import fits

    with fits.open(path) as hdus:
        pixels = np.asarray(next(h.data for h in hdus if h.data is not None and h.data.ndim == 2))
    return pixels.astype(np.uint16 if pixels.dtype == np.uint16 else np.float32)


def _found(pixels: np.ndarray, scale: float | None = None, exposure: float | None = None):
    block = choose_blocks(pixels.shape[1], pixels.shape[0], scale, exposure)[-1]
    boxes = Network.load(threads=1).run(make_map(pixels, "fast", block))
    return [box for box in boxes if box.confidence > TAU]


@pytest.mark.parametrize("sequence", ["geo_single", "geo_pair_dim", "empty"])
def test_every_satellite_of_an_independent_simulator_is_found_and_nothing_else(sequence):
    folder = DATA / "simulated" / sequence
    frame = json.loads((folder / "truth.json").read_text())["frames"][0]
    boxes = _found(_fits(folder / frame["file"]), 1.264, 10.0)
    assert len(boxes) == len(frame["objects"])
    for true in frame["objects"]:
        middle_errors = [
            np.hypot((b.x_a_px + b.x_b_px) / 2 - true["x"], (b.y_a_px + b.y_b_px) / 2 - true["y"])
            for b in boxes
        ]
        three_cells = 24.0
        assert min(middle_errors) < three_cells


def test_the_long_trail_of_a_real_frame_is_found():
    (box,) = _found(_fits(DATA / "real" / "astride_long.fits"), 3.04, 60.0)
    four_cells = 32.0
    assert abs((box.x_a_px + box.x_b_px) / 2 - 181.0) < four_cells
    assert abs((box.y_a_px + box.y_b_px) / 2 - 323.0) < four_cells
    assert box.length_px == pytest.approx(319.0, rel=0.15)


def test_real_frames_without_satellites_raise_no_candidate():
    import cv2

    assert _found(_fits(DATA / "real" / "pocs_unsolved.fits"), 10.3, 120.0) == []
    for path in sorted((DATA / "real").glob("tetra3*.tiff")):
        assert _found(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)) == [], path.name
