"""The shipped network on frames that this project did not make: what it believes in most.

What the product makes of the same frames is asked in ``test_independent_frames``.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.vision import Network, choose_blocks, make_map

DATA = Path(__file__).parents[3] / "shared" / "data"
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


def _proposed(pixels: np.ndarray, scale: float | None = None, exposure: float | None = None):
    block = choose_blocks(pixels.shape[1], pixels.shape[0], scale, exposure)[-1]
    return Network.load(threads=1).run(make_map(pixels, "fast", block))


@pytest.mark.nightly("many independent frames")
@pytest.mark.parametrize("sequence", ["geo_single", "geo_pair_dim"])
def test_it_believes_in_an_independent_simulators_satellites_most(sequence):
    folder = DATA / "simulated" / sequence
    frame = json.loads((folder / "truth.json").read_text())["frames"][0]
    boxes = _proposed(_fits(folder / frame["file"]), 1.264, 10.0)[: len(frame["objects"])]
    for true in frame["objects"]:
        middle_errors = [
            np.hypot(b.middle_px[0] - true["x"], b.middle_px[1] - true["y"]) for b in boxes
        ]
        three_cells = 24.0
        assert min(middle_errors) < three_cells


def test_it_believes_in_the_long_trail_of_a_real_frame_most():
    box, *rest = _proposed(_fits(DATA / "real" / "astride_long.fits"), 3.04, 60.0)
    four_cells = 32.0
    assert abs(box.middle_px[0] - 181.0) < four_cells
    assert abs(box.middle_px[1] - 323.0) < four_cells
    assert box.length_px == pytest.approx(319.0, rel=0.25)
    assert all(box.confidence > 5.0 * other.confidence for other in rest)


def test_it_does_not_believe_in_real_frames_without_satellites():
    import cv2

    frames = [_proposed(_fits(DATA / "real" / "pocs_unsolved.fits"), 10.3, 120.0)]
    for path in sorted((DATA / "real").glob("tetra3*.tiff")):
        frames.append(_proposed(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)))
    assert len(frames) > 3
    assert all(box.confidence < TAU for boxes in frames for box in boxes)
