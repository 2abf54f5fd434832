"""acstools' findsat_mrt: sources in the median Radon transform (Stark et al. 2022).

A trail must fill more than half of a line through the image to change its median: whole frames
(binned, as its documentation advises) suit trails that cross them. ``tile_px`` cuts the frame
into tiles that a satellite here can fill.
"""

import logging
import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from rsoconsole.records import Frame
from rsoconsole.vision import local_background, resample
from tests.bench.peers.joining import joined
from tests.bench.peers.scoring import Candidate, Line

SETTINGS: Mapping[str, Any] = {
    "binning": 8,
    "tile_bins": None,
    "step_deg": 0.5,
    "threshold": 5.0,
    "min_length": 25,
    "max_width": 75,
    "buffer": 250,
    "check_persistence": True,
}
"""As documented, the frame binned until the transform ends within the time-out."""
TILE_SETTINGS: Mapping[str, Any] = {
    **SETTINGS,
    "binning": 4,
    "tile_bins": 24,
    "step_deg": 4.0,
    "threshold": 5.0,
    "min_length": 12,
    "max_width": 8,
    "buffer": 12,
    "check_persistence": False,
}
GRID: tuple[Mapping[str, Any], ...] = ({"threshold": 4.0}, {"binning": 2, "tile_bins": 32})


def open_peer(settings: Mapping[str, Any]) -> Callable[[Frame], list[Candidate]]:
    """Signal to noise over the local sky, binned, whole or in tiles; its own SNR ranks."""
    logging.disable(logging.WARNING)
    # Lines that miss the image have no median: it says so for each.
    warnings.simplefilter("ignore", RuntimeWarning)
    chosen = {**SETTINGS, **settings}

    def find(frame: Frame) -> list[Candidate]:
        bins = chosen["binning"]
        found = [
            candidate
            for left, top, tile in _tiles(_binned(frame, bins), chosen["tile_bins"])
            for candidate in _trails(tile, left, top, chosen)
        ]
        return joined(found)

    return find


def _binned(frame: Frame, bins: int) -> npt.NDArray[np.float32]:
    sky = local_background(frame.pixels)
    level = resample(sky.level, sky.cell_px, *frame.pixels.shape)
    noise = resample(sky.noise, sky.cell_px, *frame.pixels.shape)
    excess = (frame.pixels.astype(np.float32) - level) / noise
    size = frame.width_px // bins, frame.height_px // bins
    out: npt.NDArray[np.float32] = cv2.resize(excess, size, interpolation=cv2.INTER_AREA)
    return out * np.float32(bins)


def _tiles(
    image: npt.NDArray[np.float32], side: int | None
) -> Iterator[tuple[int, int, npt.NDArray[np.float32]]]:
    if side is None:
        yield 0, 0, image
        return
    for top in range(0, image.shape[0] - side // 2, side):
        for left in range(0, image.shape[1] - side // 2, side):
            yield left, top, np.ascontiguousarray(image[top : top + side, left : left + side])


def _trails(
    tile: npt.NDArray[np.float32], left: int, top: int, chosen: Mapping[str, Any]
) -> list[Candidate]:
    from acstools.findsat_mrt import TrailFinder

    finder = TrailFinder(
        tile.astype(np.float64),
        processes=1,
        theta=np.arange(0, 180, chosen["step_deg"]),
        threshold=chosen["threshold"],
        min_length=chosen["min_length"],
        max_width=chosen["max_width"],
        buffer=chosen["buffer"],
        check_persistence=chosen["check_persistence"],
        save_catalog=False,
        save_diagnostic=False,
    )
    finder.run_mrt()
    if finder.find_mrt_sources() is None:
        return []
    trails = finder.filter_sources()
    bins, found = chosen["binning"], []
    for trail in trails:
        # 1: bright and narrow enough; 2: persistent along the whole line too.
        if trail["status"] < (2 if chosen["check_persistence"] else 1):
            continue
        (x_a, y_a), (x_b, y_b) = (
            ((float(x) + left + 0.5) * bins - 0.5, (float(y) + top + 0.5) * bins - 0.5)
            for x, y in trail["endpoints"]
        )
        line = Line(x_a_px=x_a, y_a_px=y_a, x_b_px=x_b, y_b_px=y_b)
        found.append(Candidate(line=line, score=float(trail["snr"])))
    return found
