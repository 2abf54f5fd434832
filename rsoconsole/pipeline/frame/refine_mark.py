"""Refinement of an operator's rough mark to the streak under it. Pure.

A line is traced near the two marked ends, which may be off by one square of the picture. A short
line is then fitted as a streak. The result has the sigma of its own measurement; where no line is
found, the mark stays as the operator made it.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from rsoconsole.pipeline.frame.plate import FramePart
from rsoconsole.records import Detection, PixelArray
from rsoconsole.vision import (
    Background,
    Ends,
    LineTrace,
    StarList,
    StreakFit,
    find_stars,
    fit_streak,
    local_background,
    trace_line,
    with_fit,
    with_trace,
)

MARGIN_PX = 80.0
LARGEST_SIDE_PX = 2200
"""Largest side of the examined piece: a mark across more of the frame stays rough."""
MIN_SNR, MIN_QUARTILE_SNR, MAX_ROUGH = 8.0, 3.0, 0.9
"""Limits for a believed line: SNR, its lower quartile, and roughness (the unexplained share)."""
MIN_SNR_FAR, FAR_SIGMA_PX = 12.0, 8.0
"""Lowest SNR where the mark's sigma exceeds ``FAR_SIGMA_PX``: more sky holds more false lines."""
OFFS_PX = (4.0, 8.0, 16.0, 32.0, 64.0)
"""Distances of line from mark, px, nearest first; after the first within 1.5 of mark's sigma."""
ENDS_SIGMAS = 2.5
TURNS_DEG = (0.0, 30.0, -30.0, 60.0, -60.0, 90.0)
"""Turns from the marked direction that are examined where the mark is as rough as it is long."""
SURE_DIRECTION = 3.0
"""Ratio of the mark's length to its sigma from which its ends give the line's direction."""
LONGEST_FIT_PX = 450.0


@dataclass(frozen=True, slots=True, kw_only=True)
class _Piece:
    """Piece of the frame with its background and stars."""

    pixels: PixelArray
    sky: Background
    stars: StarList
    place: FramePart


def refined_mark(
    pixels: PixelArray, mark: Detection, *, star_fwhm_px: float | None = None
) -> Detection | None:
    """Return the streak under a mark, measured; None where no line stands out there.

    ``pixels``: (height, width) ADU; ``mark``: as made by hand, with the sigma of its ends;
    ``star_fwhm_px``: FWHM of the frame's stars; None: not known.
    """
    sigma = max(mark.sigma_along_px, mark.sigma_across_px)
    piece = _piece_of(pixels, mark, sigma)
    if piece is None:
        return None
    fwhm = star_fwhm_px or piece.stars.median_fwhm_px
    best: LineTrace | None = None
    for off_px in _offs(sigma):
        for ends in _proposals(mark, sigma):
            trace = trace_line(
                piece.pixels, piece.sky, _shifted(ends, piece), piece.stars, fwhm, off_px=off_px
            )
            if (
                trace is None
                or not _is_believed(trace, sigma)
                or not _is_meant(trace, piece, mark, sigma)
            ):
                continue
            if best is None or trace.snr > best.snr:
                best = trace
    return None if best is None else _measured(best, piece, mark, fwhm)


def _offs(sigma: float) -> Iterator[float]:
    yield OFFS_PX[0]
    yield from (off for off in OFFS_PX[1:] if off <= 1.5 * sigma)


def _proposals(mark: Detection, sigma: float) -> Iterator[Ends]:
    """Yield the marked line, and turned ones where its ends do not fix the direction."""
    is_sure = mark.length_px >= SURE_DIRECTION * sigma
    half = 0.5 * mark.length_px
    angle = math.atan2(mark.y_b_px - mark.y_a_px, mark.x_b_px - mark.x_a_px)
    for turn in TURNS_DEG[:1] if is_sure else TURNS_DEG:
        dx, dy = (half * f(angle + math.radians(turn)) for f in (math.cos, math.sin))
        yield mark.x_px - dx, mark.y_px - dy, mark.x_px + dx, mark.y_px + dy


def _piece_of(pixels: PixelArray, mark: Detection, sigma: float) -> _Piece | None:
    height, width = pixels.shape
    far = MARGIN_PX + ENDS_SIGMAS * sigma
    x0 = max(math.floor(min(mark.x_a_px, mark.x_b_px) - far), 0)
    y0 = max(math.floor(min(mark.y_a_px, mark.y_b_px) - far), 0)
    x1 = min(math.ceil(max(mark.x_a_px, mark.x_b_px) + far) + 1, width)
    y1 = min(math.ceil(max(mark.y_a_px, mark.y_b_px) + far) + 1, height)
    if max(x1 - x0, y1 - y0) > LARGEST_SIDE_PX:
        return None
    piece = pixels[y0:y1, x0:x1]
    sky = local_background(piece)
    place = FramePart(x0_px=x0, y0_px=y0, size_px=(x1 - x0, y1 - y0))
    return _Piece(pixels=piece, sky=sky, stars=find_stars(piece, sky), place=place)


def _shifted(ends: Ends, piece: _Piece) -> Ends:
    x0, y0 = piece.place.x0_px, piece.place.y0_px
    return ends[0] - x0, ends[1] - y0, ends[2] - x0, ends[3] - y0


def _is_believed(trace: LineTrace, sigma: float) -> bool:
    return (
        trace.snr >= (MIN_SNR if sigma <= FAR_SIGMA_PX else MIN_SNR_FAR)
        and trace.lower_quartile_snr >= MIN_QUARTILE_SNR
        and trace.roughness <= MAX_ROUGH
    )


def _is_meant(trace: LineTrace, piece: _Piece, mark: Detection, sigma: float) -> bool:
    """True where the traced ends agree with the marked ones within the mark's sigma."""
    reach = ENDS_SIGMAS * sigma + OFFS_PX[0]
    x0, y0 = piece.place.x0_px, piece.place.y0_px
    a = trace.x_a_px + x0, trace.y_a_px + y0
    b = trace.x_b_px + x0, trace.y_b_px + y0
    marked = (mark.x_a_px, mark.y_a_px), (mark.x_b_px, mark.y_b_px)
    return any(
        math.dist(one, marked[0]) <= reach and math.dist(other, marked[1]) <= reach
        for one, other in ((a, b), (b, a))
    )


def _measured(trace: LineTrace, piece: _Piece, mark: Detection, fwhm: float) -> Detection:
    found = with_trace(mark, trace, least_open_px=0.5 * math.hypot(*trace.sigma_end_px))
    if found.length_px <= LONGEST_FIT_PX and not found.is_clipped:
        ends = trace.x_a_px, trace.y_a_px, trace.x_b_px, trace.y_b_px
        (left, right), (top, bottom) = sorted(ends[::2]), sorted(ends[1::2])
        fit = fit_streak(
            piece.pixels,
            piece.sky,
            (left, top, right, bottom),
            stars=piece.stars,
            psf_fwhm_px=fwhm,
            ends=ends,
        )
        middle = found.x_px, found.y_px
        if (
            isinstance(fit, StreakFit)
            and math.dist((fit.x_px, fit.y_px), middle) <= found.length_px
        ):
            found = with_fit(found, fit)
    return replace(piece.place.streak_in_frame_px(found), box_px=mark.box_px)
