"""Stars drawn out by the telescope's own drift, all to the same trail.

Each bright light is measured as a whole, out to a fixed share of its brightness: middle, length and
direction by moments. The trail is the length and direction on which most of the bright lights
agree. A light with that length and direction is a star; its middle is its place at mid-exposure.
Trails too long for the box about a bright pixel are measured with pixels joined.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.records import PixelArray
from rsoconsole.sky import line_angle_deg
from rsoconsole.vision.arrays import IndexArray
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.frame.bins import mirrored_indices
from rsoconsole.vision.stars.star_list import OblongLights, StarList, StarTrail
from rsoconsole.vision.stars.trail_places import place_along_trails
from rsoconsole.vision.stars.trail_section import measure_trail_section

MAX_OBLONG = 60


HALF_PX = 40
"""Half the side of the box examined about a bright pixel: it holds trails of up to 60 px whole."""
_JOINED_SIDES = (2, 4, 8)
"""Sides of the squares of pixels that are joined for longer trails, px, in turn."""
_JOINED_HALF_PX = 75
"""Half the side of their box, joined px: it holds trails of up to 140 joined px."""
_SMOOTH_PX = 1.0
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Boxes:
    """What the boxes about bright pixels are cut from."""

    pixels: PixelArray
    sky: Background
    saturation_adu: float
    half_px: int = HALF_PX
    is_smooth: bool = False


def trailed_stars(
    pixels: PixelArray, sky: Background, x0_px: IndexArray, y0_px: IndexArray, saturation_adu: float
) -> StarList | None:
    """Measure stars drawn out to equal trails, brightest first; None without a common trail.

    ``x0_px``, ``y0_px``: bright pixels, each of which may belong to a star.
    """
    boxes = _Boxes(pixels=pixels, sky=sky, saturation_adu=saturation_adu)
    found = _stars_of(_pieces(boxes, x0_px, y0_px))
    for side in _JOINED_SIDES:
        if found is not None or min(pixels.shape) < 4 * _JOINED_HALF_PX * side:
            break
        found = _long_trails(boxes, x0_px, y0_px, side)
    return found


def _long_trails(boxes: _Boxes, x0_px: IndexArray, y0_px: IndexArray, side: int) -> StarList | None:
    """Measure stars with squares of pixels joined; their width is that of the pixels as they are.

    ``side``: side of the squares, px.
    """
    import cv2

    pixels, sky = boxes.pixels, boxes.sky
    height, width = (each // side for each in pixels.shape)
    whole = pixels[: height * side, : width * side].astype(np.float32)
    joined = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
    joined_sky = replace(
        sky,
        noise=sky.noise / np.float32(side),
        cell_px=sky.cell_px // side,
        width_px=width,
        height_px=height,
    )
    places = np.unique(np.minimum(y0_px // side, height - 1) * width + x0_px // side)
    y0, x0 = np.divmod(places, width)
    wide = _Boxes(
        pixels=cv2.GaussianBlur(joined, (0, 0), _SMOOTH_PX),
        sky=joined_sky,
        saturation_adu=boxes.saturation_adu,
        half_px=_JOINED_HALF_PX,
        is_smooth=True,
    )
    found = _stars_of(_pieces(wide, x0, y0))
    if found is None or found.trail is None:
        return None
    trail = replace(
        found.trail,
        length_px=found.trail.length_px * side,
        fwhm_px=found.trail.fwhm_px * side,
    )
    stars = replace(
        found,
        x_px=(found.x_px + 0.5) * side - 0.5,
        y_px=(found.y_px + 0.5) * side - 0.5,
        flux=found.flux * side**2,
        oblong=None,
        trail=trail,
    )
    section = measure_trail_section(pixels, sky, stars, boxes.saturation_adu)
    if section is None:
        return stars
    trail = replace(trail, fwhm_px=section.fwhm_px, angle_deg=section.direction_deg)
    return place_along_trails(
        pixels,
        replace(
            stars,
            fwhm_px=np.full(len(stars), section.fwhm_px),
            median_fwhm_px=section.fwhm_px,
            trail=trail,
        ),
    )


def _pieces(boxes: _Boxes, x0_px: IndexArray, y0_px: IndexArray) -> list[_Piece]:
    """Measure all lights about bright pixels that the boxes hold whole, each once."""
    pieces: list[_Piece] = []
    seen: set[tuple[int, int]] = set()
    for x0, y0 in zip(x0_px.tolist(), y0_px.tolist(), strict=True):
        piece = _piece(boxes, x0, y0)
        if piece is None or not piece.is_whole or piece.snr < _MIN_SNR:
            continue
        key = (round(piece.x_px / 4.0), round(piece.y_px / 4.0))
        if key not in seen:
            seen.add(key)
            pieces.append(piece)
    return pieces


def _stars_of(pieces: list[_Piece]) -> StarList | None:
    """Choose the stars among lights, brightest first; None without a common trail."""
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


def _piece(boxes: _Boxes, x0: int, y0: int) -> _Piece | None:
    """Measure the light connected with one bright pixel."""
    import cv2

    pixels, sky, half_px = boxes.pixels, boxes.sky, boxes.half_px
    height, width = pixels.shape
    first_x, first_y = x0 - half_px, y0 - half_px
    if first_x >= 0 and first_y >= 0 and x0 + half_px < width and y0 + half_px < height:
        box = pixels[first_y : y0 + half_px + 1, first_x : x0 + half_px + 1].astype(np.float32)
    else:
        ys = mirrored_indices(np.arange(first_y, y0 + half_px + 1), height)
        xs = mirrored_indices(np.arange(first_x, x0 + half_px + 1), width)
        box = pixels[np.ix_(ys, xs)].astype(np.float32)
    if float(box[half_px, half_px]) > 0.95 * boxes.saturation_adu:
        return None
    noise = sky.at(sky.noise, x0, y0)
    box -= np.float32(sky.at(sky.level, x0, y0))
    smooth = box if boxes.is_smooth else cv2.GaussianBlur(box, (0, 0), _SMOOTH_PX)
    threshold = max(_LIT_SHARE * float(smooth[half_px, half_px]), _LIT_SIGMA * noise * 0.3)
    lit = (smooth > threshold).astype(np.uint8)
    if not lit[half_px, half_px]:
        return None
    count, _, _, (left, top, wide, high) = cv2.floodFill(lit, None, (half_px, half_px), 2, flags=8)
    within = slice(top, top + high), slice(left, left + wide)
    light = cv2.moments(np.where(lit[within] == 2, smooth[within], np.float32(0.0)))
    flux = light["m00"]
    if flux <= 0.0 or count < _MIN_PIXELS:
        return None
    x, y = left + light["m10"] / flux, top + light["m01"] / flux
    xx, yy, xy = (light[each] / flux for each in ("mu20", "mu02", "mu11"))
    mean, gap = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    edge = 2 * half_px - _RIM_PX
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
