"""Fields on pictures of the real sky: altered, with new noise and added satellites.

A crop is turned, mirrored, rescaled, and blurred or moved. The satellites' streaks are drawn by the
simulator's renderer with the width that the picture's stars then have.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from models import alterations, backgrounds
from models.backgrounds import Ends, Float32Array, Plane
from models.extras import Canvas, FloatArray
from models.field_scene import unasked
from models.fields import FIELD_CELLS, Conditions, Field, Kind, TrueStreak
from models.light import log_uniform
from models.satellites import Satellites
from rsoconsole.records import MapMode
from rsoconsole.simulator import (
    FWHM_PER_SIGMA,
    FieldContent,
    SensorModel,
    add_sources,
    image_motion_kernel,
    straight_streak,
    streak_points,
)
from rsoconsole.vision import find_row_column_pattern, local_background, make_map

_BLOCKS = (2, 4)
_ZOOM = (0.8, 1.6)
_SATELLITES_SHARE = 0.7
_BLURRED_SHARE = 0.3
_NOISIER = (1.0, 1.6)
_SKY_E = (25.0, 700.0)
"""Electrons a pixel that the picture's noise is taken for."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Crop:
    """A square of a picture at its final scale."""

    pixels: Float32Array
    fwhm_px: float
    trails: tuple[Ends, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Sky:
    """Picture to which satellites are added."""

    image_e: Float32Array
    full_e: float
    """Saturation level of the picture in electrons."""
    e_per_adu: float
    sky_e: float
    canvas: Canvas
    motion_px: FloatArray | None


def draw_real_fields(
    folder: Path, split: backgrounds.Split, number: int, count: int, rng: np.random.Generator
) -> list[Field]:
    """``count`` fields on pictures of one camera of the split, chosen by ``number`` in turn."""
    cameras = backgrounds.cameras(folder, split)
    planes = backgrounds.planes(folder, cameras[number % len(cameras)])
    return [draw_on(planes[int(rng.integers(len(planes)))], rng) for _ in range(count)]


def draw_on(plane: Plane, rng: np.random.Generator, conditions: Conditions | None = None) -> Field:
    """One random field on this picture."""
    wanted = conditions or Conditions()
    usable = [each for each in _BLOCKS if _least_zoom(plane, each) <= _ZOOM[1]]
    block = usable[int(rng.integers(len(usable)))]
    mode: MapMode = wanted.mode or ("paper" if rng.random() < 0.1 else "fast")
    crop = _cropped(plane, block, rng)
    sky = _sky_of(crop, block, rng)
    truth = [
        each
        for ends in crop.trails
        for each in unasked(straight_streak(ends[:2], ends[2:], 1.0), block)
    ]
    kind: Kind = "empty"
    image_e = sky.image_e
    if wanted.streaks is not None or rng.random() < _SATELLITES_SHARE:
        kind = "ordinary"
        light_e, seen = _satellites(sky, mode, block, wanted, rng)
        image_e = image_e + light_e
        truth += seen
    pixels = (np.minimum(image_e, sky.full_e) / sky.e_per_adu).astype(np.float32)
    pattern = find_row_column_pattern(pixels)
    values = make_map(pixels if pattern is None else pattern.removed(pixels), mode, block).values
    return Field(values=values, kind=kind, mode=mode, block=block, streaks=tuple(truth))


def _sky_of(crop: _Crop, block: int, rng: np.random.Generator) -> _Sky:
    """The crop blurred or moved, its noise made good and more, in electrons.

    How many electrons an ADU was is not known: the noise is taken for that of some sky.
    """
    sky_e = log_uniform(rng, *_SKY_E)
    noise_adu, level_adu = _noise_and_level(crop.pixels)
    e_per_adu = math.sqrt(sky_e) / noise_adu
    crop, motion_px = _moved(_blurred(crop, rng), block, rng)
    left_e = e_per_adu * _noise_and_level(crop.pixels)[0]
    image_e = (crop.pixels - np.float32(level_adu)) * np.float32(e_per_adu) + np.float32(sky_e)
    full_e, side = float(image_e.max()), image_e.shape[0]
    noise_e = math.sqrt(sky_e) * float(rng.uniform(*_NOISIER))
    fresh_e = np.float32(math.sqrt(max(noise_e**2 - left_e**2, 0.0)))
    image_e += _ramp(side, sky_e, rng)
    image_e += rng.standard_normal(image_e.shape, dtype=np.float32) * fresh_e
    canvas = Canvas(
        width_px=side,
        height_px=side,
        fwhm_px=crop.fwhm_px,
        noise_e=noise_e,
        unit_px=float(block),
    )
    offsets = alterations.stripes(canvas, rng)
    if offsets:
        image_e += offsets["row_offsets_e"][:, None] + offsets["column_offsets_e"]
    return _Sky(
        image_e=image_e,
        full_e=full_e,
        e_per_adu=e_per_adu,
        sky_e=sky_e,
        canvas=canvas,
        motion_px=motion_px,
    )


def _satellites(
    sky: _Sky, mode: MapMode, block: int, wanted: Conditions, rng: np.random.Generator
) -> tuple[Float32Array, list[TrueStreak]]:
    """Electrons of their streaks with the photon noise, and their truth."""
    canvas = sky.canvas
    sensor = SensorModel(
        width_px=canvas.width_px, height_px=canvas.height_px, vignetting_corner=0.0
    )
    content = FieldContent(fwhm_px=canvas.fwhm_px, sky_electrons_px=sky.sky_e)
    satellites = Satellites(
        sensor=sensor,
        canvas=canvas,
        content=content,
        mode=mode,
        block=block,
        conditions=wanted,
        rng=rng,
        motion_px=sky.motion_px,
    )
    trails, truth = satellites.draw(None)
    light_e = np.zeros_like(sky.image_e)
    for trail in trails:
        points = streak_points(sensor, content, trail)
        add_sources(light_e, *points, fwhm_px=canvas.fwhm_px, faintest_e=0.004)
    noise = rng.standard_normal(light_e.shape, dtype=np.float32)
    return light_e + noise * np.sqrt(light_e), truth


def _least_zoom(plane: Plane, block: int) -> float:
    """Factor from the picture's short side to the field's."""
    return float(FIELD_CELLS * block / min(plane.pixels.shape))


def _cropped(plane: Plane, block: int, rng: np.random.Generator) -> _Crop:
    """A square anywhere in the picture, turned, mirrored and brought to the field's size."""
    side, least = FIELD_CELLS * block, _least_zoom(plane, block)
    # Stars wider than a working frame's would not have been left so.
    most = max(least, min(_ZOOM[1], alterations.FWHM_PX[1] / plane.fwhm_px))
    zoom = float(rng.uniform(max(_ZOOM[0], least), max(_ZOOM[0], most)))
    size = min(round(side / zoom), *plane.pixels.shape)
    left, top = (int(rng.integers(0, n - size + 1)) for n in plane.pixels.shape[::-1])
    pixels = plane.pixels[top : top + size, left : left + size]
    zoom = side / size
    is_smaller = zoom < 1.0
    way = cv2.INTER_AREA if is_smaller else cv2.INTER_LINEAR
    pixels = cv2.resize(np.ascontiguousarray(pixels), (side, side), interpolation=way)
    places = [
        [((v - (left, top)[i % 2]) + 0.5) * zoom - 0.5 for i, v in enumerate(ends)]
        for ends in plane.trails
    ]
    turns, is_mirrored = int(rng.integers(4)), rng.random() < 0.5
    pixels = np.rot90(pixels, turns)
    for _ in range(turns):
        places = [[y_a, side - 1 - x_a, y_b, side - 1 - x_b] for x_a, y_a, x_b, y_b in places]
    if is_mirrored:
        pixels = pixels[:, ::-1]
        places = [[side - 1 - x_a, y_a, side - 1 - x_b, y_b] for x_a, y_a, x_b, y_b in places]
    return _Crop(
        pixels=np.ascontiguousarray(pixels),
        fwhm_px=plane.fwhm_px * zoom,
        trails=tuple((x_a, y_a, x_b, y_b) for x_a, y_a, x_b, y_b in places),
    )


def _blurred(crop: _Crop, rng: np.random.Generator) -> _Crop:
    widest = alterations.FWHM_PX[1]
    if rng.random() >= _BLURRED_SHARE or crop.fwhm_px >= widest:
        return crop
    fwhm_px = float(rng.uniform(crop.fwhm_px, widest))
    sigma_px = math.sqrt(fwhm_px**2 - crop.fwhm_px**2) / FWHM_PER_SIGMA
    pixels = cv2.GaussianBlur(crop.pixels, (0, 0), max(sigma_px, 0.1))
    return replace(crop, pixels=pixels, fwhm_px=fwhm_px)


def _moved(crop: _Crop, block: int, rng: np.random.Generator) -> tuple[_Crop, FloatArray | None]:
    """The picture smeared by drift or wind, and the path; satellites take it too."""
    side = crop.pixels.shape[0]
    canvas = Canvas(
        width_px=side, height_px=side, fwhm_px=crop.fwhm_px, noise_e=1.0, unit_px=float(block)
    )
    path_px = alterations.motion(canvas, rng)
    if path_px is None:
        return crop, None
    kernel = image_motion_kernel(alterations.stands(path_px, canvas))
    # OpenCV correlates: turned by half a circle it convolves.
    border = cv2.BORDER_REFLECT_101
    pixels = cv2.filter2D(crop.pixels, -1, kernel[::-1, ::-1], borderType=border)
    return replace(crop, pixels=pixels), path_px


def _noise_and_level(pixels: Float32Array) -> tuple[float, float]:
    """One sigma of a pixel, and the sky, ADU: medians over the picture."""
    sky = local_background(pixels)
    return max(float(np.median(sky.noise)), 1e-6), float(np.median(sky.level))


def _ramp(side: int, sky_e: float, rng: np.random.Generator) -> Float32Array:
    """Light that a gradient adds to the sky."""
    along = ((np.arange(side) + 0.5) / side - 0.5).astype(np.float32)
    slope_x, slope_y = (np.float32(sky_e * slope) for slope in alterations.gradient(rng))
    return slope_x * along[None, :] + slope_y * along[:, None]
