"""photutils: sources by segmentation of a smoothed image, those long enough kept.

Bradley et al., photutils; the steps are those of its documentation's section on segmentation.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from rsoconsole.records import Frame
from tests.bench.peers.scoring import Candidate, Line

SETTINGS: Mapping[str, Any] = {
    "sigmas": 1.0,
    "kernel_fwhm_px": 5.0,
    "pixels": 25,
    "elongation": 4.0,
    "rank": "elongation",
}
GRID: tuple[Mapping[str, Any], ...] = (
    {"sigmas": 1.5, "kernel_fwhm_px": 3.0},
    {"kernel_fwhm_px": 3.0},
    {"sigmas": 0.8},
    {"sigmas": 1.3},
    {"elongation": 3.0},
    {"rank": "signal"},
)
BOX_PX = 64
SHORTEST_PX = 12.0
"""Boxes of stars are smaller: measuring tens of thousands of them would only cost time."""


def open_peer(settings: Mapping[str, Any]) -> Callable[[Frame], list[Candidate]]:
    """Background, smoothing, threshold, labels, moments, elongation cut."""
    from photutils.background import Background2D, MedianBackground
    from photutils.segmentation import (
        SegmentationImage,
        SourceCatalog,
        detect_sources,
        make_2dgaussian_kernel,
    )
    from scipy.ndimage import convolve

    chosen = {**SETTINGS, **settings}
    side = int(2 * round(chosen["kernel_fwhm_px"]) + 1)
    kernel = make_2dgaussian_kernel(chosen["kernel_fwhm_px"], size=side).array

    def find(frame: Frame) -> list[Candidate]:
        pixels = frame.pixels.astype(np.float32)
        sky = Background2D(pixels, (BOX_PX, BOX_PX), bkg_estimator=MedianBackground())
        pixels -= sky.background.astype(np.float32)
        rms = sky.background_rms.astype(np.float32)
        smooth = convolve(pixels, kernel.astype(np.float32))
        segments = detect_sources(smooth, chosen["sigmas"] * rms, n_pixels=chosen["pixels"])
        if segments is None:
            return []
        labels = _long_labels(segments)
        if not len(labels):
            return []
        kept = SegmentationImage(
            np.where(_table(segments, labels)[segments.data], segments.data, 0)
        )
        catalogue = SourceCatalog(pixels, kept, convolved_data=smooth, error=rms)
        return _candidates(catalogue, chosen)

    return find


def _long_labels(segments: Any) -> npt.NDArray[np.int64]:
    sides = [np.hypot(s[0].stop - s[0].start, s[1].stop - s[1].start) for s in segments.slices]
    labels: npt.NDArray[np.int64] = np.asarray(segments.labels)[np.array(sides) >= SHORTEST_PX]
    return labels


def _table(segments: Any, labels: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    table = np.zeros(int(segments.max_label) + 1, dtype=bool)
    table[labels] = True
    return table


def _candidates(catalogue: Any, chosen: Mapping[str, Any]) -> list[Candidate]:
    elongation = np.atleast_1d(catalogue.elongation.value)
    half = np.atleast_1d(catalogue.semimajor_axis.value) * np.sqrt(3.0)
    angle = np.radians(np.atleast_1d(catalogue.orientation.to_value("deg")))
    x, y = np.atleast_1d(catalogue.x_centroid), np.atleast_1d(catalogue.y_centroid)
    signal = np.atleast_1d(catalogue.segment_flux / catalogue.segment_flux_err)
    score = elongation if chosen["rank"] == "elongation" else signal
    good = np.isfinite(elongation) & np.isfinite(half) & (elongation >= chosen["elongation"])
    return [
        Candidate(
            line=Line(
                x_a_px=float(x[i] - half[i] * np.cos(angle[i])),
                y_a_px=float(y[i] - half[i] * np.sin(angle[i])),
                x_b_px=float(x[i] + half[i] * np.cos(angle[i])),
                y_b_px=float(y[i] + half[i] * np.sin(angle[i])),
            ),
            score=float(score[i]),
        )
        for i in np.flatnonzero(good)
    ]
