"""SENPAI: a bank of filters along lines, what answers at one angle alone kept (Gazak et al. 2026).

Its search for streaks in a frame that follows the stars, which it sets in motion once it has a
plate and a star catalogue; without them here, the stars that it subtracts are those that it finds.
"""

import logging
import math
from collections.abc import Callable, Mapping
from typing import Any

from rsoconsole.records import Frame
from tests.bench.peers.joining import joined
from tests.bench.peers.scoring import Candidate, Line

SETTINGS: Mapping[str, Any] = {
    "stars": 3000,
    "background": True,
    "detection_sigma": 5.0,
    "min_fractional_excess": 0.5,
}
GRID: tuple[Mapping[str, Any], ...] = (
    {"stars": 0},
    {"stars": 500},
    {"background": False},
    {"detection_sigma": 4.0},
    {"min_fractional_excess": 0.3},
)


def open_peer(settings: Mapping[str, Any]) -> Callable[[Frame], list[Candidate]]:
    """Its preprocessing, its star list and width of a star, its streaks; its peak SNR ranks."""
    from astropy.io import fits
    from senpai.engine.detection.point.sidereal import extract_point_sources
    from senpai.engine.detection.streak.sidereal_streak import detect_streaks_in_sidereal
    from senpai.engine.models.images import ProcessedFitsImage
    from senpai.engine.models.metadata import DetectionMetadata
    from senpai.engine.models.starfield import StarField, StarInSpace
    from senpai.engine.utils.preprocessing import remove_background, remove_column_and_row_medians

    logging.disable(logging.WARNING)
    chosen = {**SETTINGS, **settings}
    stars, background = chosen.pop("stars"), chosen.pop("background")

    def find(frame: Frame) -> list[Candidate]:
        image = remove_column_and_row_medians(
            ProcessedFitsImage.from_fits(fits.PrimaryHDU(frame.pixels))
        )
        if background:
            image = remove_background(image)
        sources, fwhm_px = extract_point_sources(image, max_detections=max(stars, 1))
        field = StarField(
            detections=[],
            image_metadata=image.metadata,
            wcs=None,
            detection_metadata=DetectionMetadata(pixel_fwhm=fwhm_px),
            # Only their places in the image are used.
            catalog_stars=[
                StarInSpace(ra=0.0, dec=0.0, x=star.x, y=star.y)
                for star in sources.detections[:stars]
            ],
        )
        # Where nothing passes its thresholds it answers two values, not three.
        streaks = detect_streaks_in_sidereal(image.data, field, **chosen)[0]
        return joined([_as_candidate(each) for each in streaks])

    return find


def _as_candidate(streak: Any) -> Candidate:
    angle = math.radians(streak.angle_deg)
    dx, dy = (0.5 * streak.length_pixels * each for each in (math.cos(angle), math.sin(angle)))
    x, y = streak.x, streak.y
    line = Line(x_a_px=x - dx, y_a_px=y - dy, x_b_px=x + dx, y_b_px=y + dy)
    return Candidate(line=line, score=streak.peak_snr)
