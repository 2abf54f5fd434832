"""Evenness of a short line's light and path: a cosmic ray bends, and is lumpy in its charge."""

import math

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.vision.lines.segments import Ends, length_of
from rsoconsole.vision.lines.streak_search import Cutout

_SMOOTHED_PX, _INTERPOLATED_PX = 0.6, 0.5
"""Sigma of the smoothing, px, and of linear interpolation, added to it in quadrature."""
_REACH_PX, _END_PX = 6, 3
"""Pixels examined to either side of the line, and pixels left out at either end."""
_FEWEST, _MIN_SEEN = 9, 0.4
"""Fewest usable columns, and their least share of a line."""
_BRIGHTNESS_BY_NOISE, _PLACE_BY_NOISE = 0.66, 0.95
"""Scatter by noise of an even line's brightness, as a share, and of its place, in sigmas of a star;
times sqrt(length) over its signal to noise. Measured on drawn lines of 2 to 4 px width."""
_BRIGHTNESS_FLOOR, _BEND_FLOOR_PX, _WAVER_FLOOR_PX = 0.08, 0.10, 0.15
"""Variation by the air of a satellite's brightness (a share), bend and waver (px)."""
_BEND_LEEWAY = 1.5
"""Leeway of the logarithm of a bend of two terms."""
_STANDS_ALONE = 0.7
"""Share of the columns that are independent after the smoothing."""


def lumpiness_and_bend(
    cutout: Cutout, ends: Ends, psf_sigma: float, snr: float
) -> tuple[float, float]:
    """Measure the lumpiness of a line's light and the bend of its path; return both.

    Each is the natural logarithm of a variance along the line over the variance expected from noise
    and air; 0 where these explain it, and where too little of the line is in the frame. ``ends``
    (x_a, y_a, x_b, y_b) in raw pixels, ``snr`` of the whole line. Parts touched by masked stars are
    left out, unless they are most of the line.

    Of 135 pieces of cosmic rays in the calibration split 116 came above 0.5, of 31 satellites as
    short none, and of 1,200 even lines drawn at 2, 5 and 30 sigma a pixel one.
    """
    measured = _light_and_place(cutout, ends, psf_sigma)
    if measured is None:
        return 0.0, 0.0
    along, light, place_px = measured
    columns, noise = along.size, math.sqrt(length_of(ends)) / max(snr, 1.0)
    by_noise_px = _PLACE_BY_NOISE * noise * psf_sigma
    # Straight, then what a bend and an S make of it, then the rest.
    terms, _ = np.linalg.qr(np.vander(along, 4, increasing=True))
    bend = terms[:, 2:].T @ place_px
    straight = terms[:, :2] @ (terms[:, :2].T @ place_px)
    alone = _STANDS_ALONE * columns
    scatter = 2.0 * math.sqrt(4.0 / columns)
    light_excess = (
        _log(float(light.var()), (_BRIGHTNESS_BY_NOISE * noise) ** 2 + _BRIGHTNESS_FLOOR**2)
        - scatter
    )
    waver = (
        _log(float(np.mean((place_px - straight) ** 2)), by_noise_px**2 + _WAVER_FLOOR_PX**2)
        - scatter
    )
    bent = (
        _log(float(bend @ bend) / columns, 2.0 * by_noise_px**2 / alone + _BEND_FLOOR_PX**2)
        - _BEND_LEEWAY
    )
    return max(0.0, light_excess), max(0.0, waver, bent)


def _light_and_place(
    cutout: Cutout, ends: Ends, psf_sigma: float
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Place along (-1 to 1), brightness over its mean, and place across, px; (columns,) each."""
    import cv2

    x_a, y_a, x_b, y_b = ends
    length = length_of(ends)
    count = int(length) + 1
    if count < _FEWEST + 2 * _END_PX:
        return None
    dx, dy = (x_b - x_a) / length, (y_b - y_a) / length
    u = np.arange(count) - 0.5 * (count - 1)
    v = np.arange(-_REACH_PX, _REACH_PX + 1)[:, None]
    x = 0.5 * (x_a + x_b) - cutout.x0 + dx * u - dy * v
    y = 0.5 * (y_a + y_b) - cutout.y0 + dy * u + dx * v
    height, width = cutout.values.shape
    is_there = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    columns, rows = x.astype(np.float32), y.astype(np.float32)
    values = cv2.remap(cutout.values.astype(np.float32), columns, rows, cv2.INTER_LINEAR)
    strip = cv2.GaussianBlur(values, (0, 0), _SMOOTHED_PX)
    nearest = (
        np.clip(np.rint(y), 0, height - 1).astype(int),
        np.clip(np.rint(x), 0, width - 1).astype(int),
    )
    is_good = cutout.is_good[nearest]
    profile = np.exp(-0.5 * v**2 / (psf_sigma**2 + _SMOOTHED_PX**2 + _INTERPOLATED_PX**2))
    in_core = np.abs(v[:, 0]) <= 2.0 * psf_sigma
    is_inner = is_there[in_core].all(axis=0)
    is_inner[:_END_PX] = is_inner[-_END_PX:] = False
    is_seen = is_inner & is_good[in_core].all(axis=0)
    if is_seen.sum() < max(_FEWEST, _MIN_SEEN * is_inner.sum()):
        is_seen = is_inner
    light = (profile * strip).sum(axis=0)[is_seen]
    if light.size < _FEWEST or not light.mean() > 0.0:
        return None
    # Weighted by its own profile a line shows half of how far off it is.
    place_px = 2.0 * (profile * v * strip).sum(axis=0)[is_seen] / light.mean()
    return np.linspace(-1.0, 1.0, count)[is_seen], light / light.mean(), place_px


def _log(variance: float, expected: float) -> float:
    return math.log(max(variance, 1e-9) / expected)
