"""acstools' satdet: Canny edges and a probabilistic Hough transform (Borncamp and Lim 2016).

``is_whole_trail`` True: its public call, which accepts only trails that cross the frame. False:
its own steps in its own order without that last demand, since satellites here end in the frame.
It gives no score; the segment's length ranks.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt

from rsoconsole.records import Frame
from tests.bench.peers.joining import joined
from tests.bench.peers.scoring import Candidate, Line

SETTINGS: Mapping[str, Any] = {
    "is_whole_trail": True,
    "sigma": 2.0,
    "low_thresh": 0.1,
    "h_thresh": 0.5,
    "small_edge": 60,
    "line_len": 200,
    "line_gap": 75,
    "percentile": (4.5, 93.0),
}
"""As documented."""
SHORT_SETTINGS: Mapping[str, Any] = {
    **SETTINGS,
    "is_whole_trail": False,
    "sigma": 2.0,
    "h_thresh": 0.25,
    "small_edge": 40,
    "line_len": 25,
    "line_gap": 5,
    "percentile": (4.5, 99.5),
}
GRID: tuple[Mapping[str, Any], ...] = (
    {"h_thresh": 0.2},
    {"percentile": (4.5, 99.6), "h_thresh": 0.15},
    {"percentile": (4.5, 99.8), "h_thresh": 0.12, "low_thresh": 0.08},
    {"percentile": (4.5, 99.8), "h_thresh": 0.15},
    {"percentile": (4.5, 99.8), "h_thresh": 0.15, "small_edge": 60},
)
VOTES = 210
"""satdet's own threshold of the transform; a shorter trail cannot gather so many."""


def open_peer(settings: Mapping[str, Any]) -> Callable[[Frame], list[Candidate]]:
    """satdet's public call, or its steps for trails that end in the frame."""
    chosen = {**SETTINGS, **settings}
    is_whole_trail = chosen.pop("is_whole_trail")

    def find(frame: Frame) -> list[Candidate]:
        pixels = frame.pixels.astype(np.float32)
        segments = _whole(pixels, chosen) if is_whole_trail else _short(pixels, chosen)
        ends = np.asarray(segments, dtype=np.float64).reshape(-1, 4)
        found = [Line(x_a_px=a, y_a_px=b, x_b_px=c, y_b_px=d) for a, b, c, d in ends.tolist()]
        return joined([Candidate(line=line, score=line.length_px) for line in found])

    return find


def _whole(pixels: npt.NDArray[np.float32], chosen: Mapping[str, Any]) -> Any:
    from acstools.satdet import detsat
    from astropy.io import fits

    with TemporaryDirectory() as folder:
        path = Path(folder) / "frame.fits"
        fits.HDUList([fits.PrimaryHDU(), fits.ImageHDU(pixels)]).writeto(path)
        results, errors = detsat(str(path), chips=[1], n_processes=1, verbose=False, **chosen)
    if errors:
        raise RuntimeError(f"satdet: {next(iter(errors.values()))}")
    return next(iter(results.values()))


def _short(pixels: npt.NDArray[np.float32], chosen: Mapping[str, Any]) -> Any:
    from skimage import exposure, feature, morphology, transform

    low, high = np.percentile(pixels, chosen["percentile"])
    scaled = exposure.rescale_intensity(pixels, in_range=(low, high), out_range=(0.0, 1.0))
    edges = feature.canny(
        scaled,
        sigma=chosen["sigma"],
        low_threshold=chosen["low_thresh"],
        high_threshold=chosen["h_thresh"],
    )
    edges = morphology.remove_small_objects(
        edges, connectivity=2, max_size=chosen["small_edge"] - 1
    )
    return transform.probabilistic_hough_line(
        edges,
        threshold=min(VOTES, chosen["line_len"] // 2),
        line_length=chosen["line_len"],
        line_gap=chosen["line_gap"],
        theta=np.radians(np.arange(2, 178, 0.5)),
        rng=1,
    )
