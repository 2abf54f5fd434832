"""Stars drawn out by the telescope's own drift, all to the same trail.

Each bright light is measured as a whole, out to a fixed share of its brightness: middle, length and
direction by moments. The trail is the length and direction on which most of the bright lights
agree. A light with that length and direction is a star; its middle is its place at mid-exposure.
"""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import PixelArray
from rsoconsole.sky import line_angle_deg
from rsoconsole.vision.arrays import IndexArray
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.frame.bins import mirrored_indices
from rsoconsole.vision.stars.star_list import OblongLights, StarList, StarTrail

MAX_OBLONG = 60


HALF_PX = 40
"""Half the side of the box examined about a bright pixel: it holds trails of up to 60 px whole."""
_LIT_SHARE, _LIT_SIGMA = 0.25, 3.0
"""Thresholds of lit pixels: share of the brightest (smoothed) one, and sigma of the noise."""
_BRIGHTEST = 80
_FEWEST = 8
_MIN_RATIO = 1.4
_SAME_ANGLE_DEG, _SAME_LENGTH = 8.0, 0.25
_AGREE_SHARE = 0.5
_MIN_SNR = 7.0
_MIN_PIXELS = 5
_RIM_PX = 2
_LONG, _LONG_SNR, _MAX_RATIO, _SHAPE_SEEN_SNR = 2.0, 10.0, 4.0, 40.0
"""Least length in star widths and SNR of a long one; axis ratio and SNR that count at most."""


@dataclass(frozen=True, slots=True)
class _Piece:
    """Moments of one lit piece of light."""

    x_px: float
    y_px: float
    flux: float
    snr: float
    along: float
    """Root of the larger moment, px."""
    across: float
    angle_deg: float
    is_whole: bool

    @property
    def length_px(self) -> float:
        """Length of a line of light with these moments, px, without the disc's own width."""
        return math.sqrt(12.0 * max(self.along**2 - self.across**2, 0.0))


def trailed_stars(
    pixels: PixelArray, sky: Background, x0_px: IndexArray, y0_px: IndexArray, saturation_adu: float
) -> StarList | None:
    """Measure stars drawn out to equal trails, brightest first; None without a common trail.

    ``x0_px``, ``y0_px``: bright pixels, each of which may belong to a star.
    """
    pieces: list[_Piece] = []
    seen: set[tuple[int, int]] = set()
    for x0, y0 in zip(x0_px.tolist(), y0_px.tolist(), strict=True):
        piece = _piece(pixels, sky, x0, y0, saturation_adu)
        if piece is None or not piece.is_whole or piece.snr < _MIN_SNR:
            continue
        key = (round(piece.x_px / 4.0), round(piece.y_px / 4.0))
        if key not in seen:
            seen.add(key)
            pieces.append(piece)
    trail = _agreed(sorted(pieces, key=lambda each: -each.flux)[:_BRIGHTEST])
    if trail is None:
        return None
    stars = [each for each in pieces if _is_of(each, trail)]
    stars.sort(key=lambda each: -each.flux)
    if len(stars) < _FEWEST:
        return None
    columns = [(s.x_px, s.y_px, s.flux, s.snr) for s in stars]
    x, y, flux, snr = (np.array(column) for column in zip(*columns, strict=True))
    others = [each for each in pieces if not _is_of(each, trail)]
    return StarList(
        x_px=x,
        y_px=y,
        flux=flux,
        fwhm_px=np.full(len(stars), trail.fwhm_px),
        snr=snr,
        is_saturated=np.zeros(len(stars), bool),
        median_fwhm_px=trail.fwhm_px,
        trail=trail,
        oblong=_long_ones(others, trail.fwhm_px),
    )


def _long_ones(pieces: list[_Piece], fwhm_px: float) -> OblongLights:
    """Pieces longer than a few widths, the surest first."""
    long = [each for each in pieces if each.snr > _LONG_SNR and each.length_px > _LONG * fwhm_px]
    long.sort(key=_sureness, reverse=True)
    columns = [(p.x_px, p.y_px, p.angle_deg, 0.5 * p.length_px, p.snr) for p in long[:MAX_OBLONG]]
    x, y, angle, half, snr = np.array(columns, dtype=np.float64).reshape(-1, 5).T
    return OblongLights(x_px=x, y_px=y, angle_deg=angle, half_px=half, snr=snr)


def _sureness(piece: _Piece) -> float:
    """Measure of how surely it is one narrow light: a blend of stars is bright and wide."""
    ratio = min(piece.along / piece.across, _MAX_RATIO)
    return ratio * min(piece.snr, _SHAPE_SEEN_SNR)


def _agreed(pieces: list[_Piece]) -> StarTrail | None:
    """Length and direction that most of them agree on."""
    long = [each for each in pieces if each.along > _MIN_RATIO * each.across]
    if len(long) < max(_FEWEST, _AGREE_SHARE * len(pieces)):
        return None
    # Direction as a vector of twice the angle: 179 and 1 degree are neighbours.
    doubled = np.radians([2.0 * each.angle_deg for each in long])
    angle = 0.5 * math.degrees(
        math.atan2(float(np.sin(doubled).mean()), float(np.cos(doubled).mean()))
    )
    alike = [
        each for each in long if line_angle_deg(each.angle_deg, angle % 180.0) < _SAME_ANGLE_DEG
    ]
    if len(alike) < max(_FEWEST, _AGREE_SHARE * len(pieces)):
        return None
    along = float(np.median([each.along for each in alike]))
    across = float(np.median([each.across for each in alike]))
    return StarTrail(
        length_px=math.sqrt(12.0 * max(along**2 - across**2, 0.0)),
        angle_deg=angle % 180.0,
        fwhm_px=2.3548 * across,
    )


def _is_of(piece: _Piece, trail: StarTrail) -> bool:
    is_long = abs(piece.length_px - trail.length_px) < _SAME_LENGTH * trail.length_px + 1.0
    # A short trail's direction is known the worse.
    leeway_deg = _SAME_ANGLE_DEG + math.degrees(trail.fwhm_px / 4.0 / max(trail.length_px, 1.0))
    return is_long and line_angle_deg(piece.angle_deg, trail.angle_deg) < leeway_deg


def _piece(
    pixels: PixelArray, sky: Background, x0: int, y0: int, saturation_adu: float
) -> _Piece | None:
    """Measure the light connected with one bright pixel."""
    import cv2

    height, width = pixels.shape
    first_x, first_y = x0 - HALF_PX, y0 - HALF_PX
    if first_x >= 0 and first_y >= 0 and x0 + HALF_PX < width and y0 + HALF_PX < height:
        box = pixels[first_y : y0 + HALF_PX + 1, first_x : x0 + HALF_PX + 1].astype(np.float32)
    else:
        ys = mirrored_indices(np.arange(first_y, y0 + HALF_PX + 1), height)
        xs = mirrored_indices(np.arange(first_x, x0 + HALF_PX + 1), width)
        box = pixels[np.ix_(ys, xs)].astype(np.float32)
    if float(box[HALF_PX, HALF_PX]) > 0.95 * saturation_adu:
        return None
    noise = sky.at(sky.noise, x0, y0)
    box -= np.float32(sky.at(sky.level, x0, y0))
    smooth = cv2.GaussianBlur(box, (0, 0), 1.0)
    threshold = max(_LIT_SHARE * float(smooth[HALF_PX, HALF_PX]), _LIT_SIGMA * noise * 0.3)
    lit = (smooth > threshold).astype(np.uint8)
    if not lit[HALF_PX, HALF_PX]:
        return None
    count, _, _, (left, top, wide, high) = cv2.floodFill(lit, None, (HALF_PX, HALF_PX), 2, flags=8)
    within = slice(top, top + high), slice(left, left + wide)
    light = cv2.moments(np.where(lit[within] == 2, smooth[within], np.float32(0.0)))
    flux = light["m00"]
    if flux <= 0.0 or count < _MIN_PIXELS:
        return None
    x, y = left + light["m10"] / flux, top + light["m01"] / flux
    xx, yy, xy = (light[each] / flux for each in ("mu20", "mu02", "mu11"))
    mean, gap = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    edge = 2 * HALF_PX - _RIM_PX
    return _Piece(
        x_px=first_x + x,
        y_px=first_y + y,
        flux=flux,
        snr=flux / (noise * math.sqrt(count)),
        along=math.sqrt(max(mean + gap, 1e-3)),
        across=math.sqrt(max(mean - gap, 1e-3)),
        angle_deg=0.5 * math.degrees(math.atan2(2.0 * xy, xx - yy)) % 180.0,
        is_whole=min(left, top) > _RIM_PX
        and max(left + wide, top + high) <= edge
        and first_x + left >= 0
        and first_x + left + wide <= width
        and first_y + top >= 0
        and first_y + top + high <= height,
    )
