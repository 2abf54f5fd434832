"""Lights that resemble a satellite: aircraft, stars trailed by wind, wide cosmic rays.

For frames of calibration and measurement; training draws its own in ``models.extras``.
"""

import math
from dataclasses import replace

import numpy as np

from rsoconsole.simulator import FWHM_PER_SIGMA, FieldContent, FloatArray, Streak, straight_streak

_APERTURE_M, _FOCAL_M, _PIXEL_M = 0.28, 0.62, 3.8e-6
_PX_PER_RAD = _FOCAL_M / _PIXEL_M
_DISTANCE_M = 4_000.0, 30_000.0
_SPEED_M_S = 70.0, 250.0
_SPAN_M = 17.0
_FLASH_S, _FLASHES_PER_S = (0.05, 0.2), (0.7, 1.5)
_DIM_SIGMA = 0.15
_STEP_PX = 0.8


def passing_aircraft(
    width_px: int, height_px: int, fwhm_px: float, noise_e: float, rng: np.random.Generator
) -> tuple[Streak, ...]:
    """One random aircraft: 1 or 2 steady lights and up to 3 flashing ones, on parallel lines.

    Each trail has the width of a light 4 to 30 km away in a telescope focused at infinity. A flash
    is drawn as a dash, since the aircraft moves during it. One aircraft in five begins or ends in
    the frame.
    """
    angle = float(rng.uniform(0.0, 2.0 * math.pi))
    along, across = _axes(angle)
    distance_m = float(np.exp(rng.uniform(*np.log(_DISTANCE_M))))
    blur_px = _APERTURE_M / distance_m * _PX_PER_RAD
    metre_px = _PX_PER_RAD / distance_m
    speed_px_s = float(rng.uniform(*_SPEED_M_S)) * metre_px
    middle = rng.uniform(0.15, 0.85, size=2) * np.array([width_px, height_px])
    reach = 1.2 * math.hypot(width_px, height_px)
    begins = float(rng.uniform(-0.3, 0.1)) * width_px if rng.random() < 0.2 else -reach
    steady_snr = float(np.exp(rng.uniform(math.log(1.0), math.log(40.0))))
    lamps = [(steady_snr, False)] * int(rng.integers(1, 3))
    for _ in range(int(rng.integers(0, 4))):
        lamps.append((steady_snr * float(np.exp(rng.uniform(0.0, math.log(15.0)))), True))
    trails: list[Streak] = []
    for peak_snr, is_flashing in lamps:
        centre = middle + across * float(rng.uniform(-_SPAN_M, _SPAN_M)) * metre_px
        centre = centre + along * float(rng.uniform(-_SPAN_M, _SPAN_M)) * metre_px
        per_px = peak_snr * noise_e * _width_px(fwhm_px, blur_px)
        stretches = [(begins, reach)]
        if is_flashing:
            period = speed_px_s / float(rng.uniform(*_FLASHES_PER_S))
            dash = speed_px_s * float(rng.uniform(*_FLASH_S))
            first = begins + float(rng.uniform(0.0, period))
            stretches = [(at, at + dash) for at in np.arange(first, reach, period)]
        for stretch in stretches:
            trails += _blurred(
                centre, angle, stretch, blur_px=blur_px, per_px=per_px, fwhm_px=fwhm_px
            )
    return tuple(each for each in trails if _is_seen(each, width_px, height_px))


def _axes(angle: float) -> tuple[FloatArray, FloatArray]:
    along = np.array([math.cos(angle), math.sin(angle)])
    return along, np.array([-along[1], along[0]])


def _width_px(fwhm_px: float, blur_px: float) -> float:
    """Light per pixel of length over that of the brightest pixel, of a blurred trail."""
    sigma_px = math.sqrt((fwhm_px / FWHM_PER_SIGMA) ** 2 + 1.0 / 12.0 + (blur_px / 4.0) ** 2)
    return math.sqrt(2.0 * math.pi) * sigma_px


def _blurred(
    centre: FloatArray,
    angle: float,
    stretch_px: tuple[float, float],
    *,
    blur_px: float,
    per_px: float,
    fwhm_px: float,
) -> list[Streak]:
    """A trail of a disc ``blur_px`` wide: parallel lines with the chords of a circle as weights."""
    count = max(1, math.ceil(blur_px / max(0.7 * fwhm_px, 1.0)))
    offsets = (np.arange(count) + 0.5) / count - 0.5
    weights = np.sqrt(1.0 - (2.0 * offsets) ** 2)
    weights /= weights.sum()
    along, across = _axes(angle)
    low, high = stretch_px
    drawn = []
    for offset, weight in zip(offsets * blur_px, weights, strict=True):
        (x_a, y_a), (x_b, y_b) = (centre + across * offset + along * u for u in (low, high))
        light = per_px * float(weight) * (high - low)
        drawn.append(straight_streak((float(x_a), float(y_a)), (float(x_b), float(y_b)), light))
    return drawn


def _is_seen(streak: Streak, width_px: int, height_px: int) -> bool:
    margin = 40.0
    return bool(
        streak.x_px.max() > -margin
        and streak.x_px.min() < width_px + margin
        and streak.y_px.max() > -margin
        and streak.y_px.min() < height_px + margin
    )


def drawn_out_stars(
    content: FieldContent, noise_e: float, rng: np.random.Generator
) -> FieldContent:
    """The field with every star trailed along the same random path of 3 to 40 px.

    Stars whose trail is fainter than ``_DIM_SIGMA`` noises of a pixel are left out.
    """
    path_x, path_y = _path_of_wind(float(np.exp(rng.uniform(math.log(3.0), math.log(40.0)))), rng)
    points = len(path_x)
    faintest = _DIM_SIGMA * noise_e * 2.4 * content.fwhm_px / FWHM_PER_SIGMA * points * _STEP_PX
    is_kept = content.star_electrons > faintest
    x, y = content.star_x_px[is_kept], content.star_y_px[is_kept]
    return replace(
        content,
        star_x_px=(x[:, None] + path_x).ravel(),
        star_y_px=(y[:, None] + path_y).ravel(),
        star_electrons=np.repeat(content.star_electrons[is_kept] / points, points),
    )


def _path_of_wind(reach_px: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Pointing of the telescope at equal steps of time, px: a drift, a swing, or a curve."""
    shape = int(rng.integers(3))
    angle = float(rng.uniform(0.0, 2.0 * math.pi))
    count = max(4, math.ceil((2.0 if shape == 1 else 1.0) * reach_px / _STEP_PX))
    time = (np.arange(count) + 0.5) / count
    bow = np.zeros(count)
    if shape == 0:
        along = time
    elif shape == 1:
        along = 0.5 - 0.5 * np.cos(2.0 * math.pi * time)
        bow = float(rng.uniform(0.0, 0.15)) * np.sin(2.0 * math.pi * time)
    else:
        along = time
        bow = float(rng.uniform(-0.3, 0.3)) * 4.0 * time * (1.0 - time)
    u, v = reach_px * (along - 0.5), reach_px * bow
    cos, sin = math.cos(angle), math.sin(angle)
    return u * cos - v * sin, u * sin + v * cos


def wide_cosmic_rays(width_px: int, height_px: int, rng: np.random.Generator) -> tuple[Streak, ...]:
    """Cosmic-ray tracks whose charge has spread in the silicon, so that they are as wide as a star.

    Of muons (short, straight) and electrons (curled), uneven along their length, as the renderer's
    narrow tracks.
    """
    area = width_px * height_px / (4656 * 3520)
    expected = area * math.exp(rng.uniform(math.log(10.0), math.log(80.0)))
    rays = []
    for _ in range(int(rng.poisson(expected))):
        is_curled = rng.random() < 0.35
        length = float(rng.uniform(8.0, 40.0) if is_curled else 1.0 + rng.exponential(5.0))
        count = max(3, int(length))
        turns = rng.normal(0.0, 0.25 if is_curled else 0.0, size=count)
        heading = float(rng.uniform(0.0, 2.0 * math.pi)) + np.cumsum(turns)
        x = float(rng.uniform(0, width_px)) + np.cumsum(np.cos(heading)) * length / count
        y = float(rng.uniform(0, height_px)) + np.cumsum(np.sin(heading)) * length / count
        electrons = float(np.exp(rng.normal(math.log(450.0), 0.7))) * length
        rays.append(
            Streak(x_px=x, y_px=y, electrons=electrons, brightness=rng.gamma(4.0, 0.25, size=count))
        )
    return tuple(rays)
