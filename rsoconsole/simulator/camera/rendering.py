"""Rendering of the sources in a field to the pixels that the camera stores, any frame size.

``render(sensor, content, rng)`` is a pure function of its arguments: the same generator state
gives the same pixels. It knows nothing of the sky; ``scene`` fills its content from catalogue and
orbits, the training of the detector fills it at random.
"""

import math
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from rsoconsole.simulator.camera.psf import (
    FWHM_PER_SIGMA,
    add_points,
    add_sources,
    annulus,
    image_motion_kernel,
)
from rsoconsole.simulator.camera.sensor import (
    SensorModel,
    amplifier_glow,
    apply_blooming,
    flat_field,
    pixel_defects,
)

Float32Array = npt.NDArray[np.float32]
FloatArray = npt.NDArray[np.float64]
FramePixels = npt.NDArray[np.uint16]

STREAK_STEP_PX = 0.5
"""Spacing of the points as which a streak is drawn: far finer than any seeing disc."""
_ROWS_AT_ONCE = 64
_TURN_SEEN_PX = 0.05
_POISSON_BELOW_E = 30.0
"""Mean above which a Gaussian stands for the Poisson law (skewness below 0.19)."""
_EMPTY: FloatArray = np.zeros(0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Streak:
    """A moving source's path in pixels and its brightness during one exposure."""

    x_px: FloatArray
    """Places, (n >= 2,), at equal steps of time from opening to closing; straight in between."""
    y_px: FloatArray
    electrons: float
    """Electrons of the whole streak at relative brightness 1 under a clear sky."""
    brightness: FloatArray | None = None
    """Relative brightness, (m,), at equal steps of time, both ends included; None: steady."""
    fwhm_px: float | None = None
    """FWHM of this source's disc, for wide or defocused sources; None: the field's."""


def straight_streak(
    start_px: tuple[float, float],
    end_px: tuple[float, float],
    electrons: float,
    brightness: FloatArray | None = None,
    fwhm_px: float | None = None,
) -> Streak:
    """A streak along the straight line from the start to the end, both (x, y).

    ``electrons``, ``brightness`` and ``fwhm_px`` as in ``Streak``.
    """
    return Streak(
        x_px=np.array([start_px[0], end_px[0]], dtype=np.float64),
        y_px=np.array([start_px[1], end_px[1]], dtype=np.float64),
        electrons=electrons,
        brightness=brightness,
        fwhm_px=fwhm_px,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FieldContent:
    """Light and disturbances of one exposure; pixels are 0-based, x = column, y = row."""

    exposure_s: float = 10.0
    fwhm_px: float = 2.2
    """FWHM of the seeing disc before the pixels integrate it."""
    defocus_px: float = 0.0
    """Radius of the ring as which an obstructed mirror shows a defocused point; 0: in focus."""
    sky_electrons_px: float = 132.0
    """Mean sky in one pixel over the exposure, in the centre of the field."""
    sky_gradient: tuple[float, float] = (0.0, 0.0)
    """Relative change of the sky from left to right and from top to bottom of the frame."""
    star_x_px: FloatArray = field(default_factory=lambda: _EMPTY)
    star_y_px: FloatArray = field(default_factory=lambda: _EMPTY)
    star_electrons: FloatArray = field(default_factory=lambda: _EMPTY)
    """Electrons of the stars, (n,), under a clear sky in the centre of the field."""
    star_path_px: FloatArray | None = None
    """Displacement of all stars, x and y (2, m >= 2), at equal steps of time; None: still."""
    stands: FloatArray | None = None
    """Places of the image, (4, n): dx, dy (px), turn (rad), time share; None: it stood still."""
    streaks: tuple[Streak, ...] = ()
    cloud_transmission: Float32Array | None = None
    """Transmission of clouds, 0 to 1: a coarse map (rows, columns) of the frame; None: clear."""
    cloud_glow: float = 0.35
    """Brightness that an opaque cloud adds to the sky, as a fraction of the clear sky's."""
    cosmic_rays: float = 0.0
    cosmic_ray_sigma_px: tuple[float, float] = (0.28, 0.28)
    """Sigma of the narrowest and the widest track; in a thick sensor they are as wide as stars."""
    cosmic_ray_stretch: float = 1.0
    """Length of cosmic-ray tracks relative to a thin sensor's."""
    blur_variance_px2: float = 0.0
    """Variance by which motion and defocus widen a streak; for the truth's SNR alone, not drawn."""
    row_offsets_e: Float32Array | None = None
    """Offset, (height,), that the electronics add to each row as it is read."""
    column_offsets_e: Float32Array | None = None


def render(sensor: SensorModel, content: FieldContent, rng: np.random.Generator) -> FramePixels:
    """One frame as the camera stores it, uint16 (height, width).

    ``rng``: made by ``frame_rng`` (SFC64 is the fastest generator for this many normal numbers).
    """
    mean_e = expected_electrons(sensor, content)
    _add_cosmic_rays(mean_e, content, rng)
    if sensor.blooming > 0.0:
        apply_blooming(mean_e, sensor.full_well_e, sensor.blooming)
    return _read_out(sensor, mean_e, _pattern(sensor, content), rng)


def frame_rng(*key: int) -> np.random.Generator:
    """A fast random generator seeded by any number of non-negative integers."""
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence(key)))


def expected_electrons(sensor: SensorModel, content: FieldContent) -> Float32Array:
    """Mean electrons in every pixel before noise and saturation, float32 (height, width)."""
    image_e = _sky(sensor, content)
    x, y = content.star_x_px, content.star_y_px
    # A star's light is dimmed where it lands; the pixels' own response comes with the flat.
    electrons = content.star_electrons * transmission_at(sensor, content.cloud_transmission, x, y)
    if content.star_path_px is not None:
        x, y, electrons = _wandering(x, y, electrons, content.star_path_px)
    if content.stands is None:
        add_sources(image_e, x, y, electrons, fwhm_px=content.fwhm_px)
    elif _is_turned(sensor, content.stands):
        x, y, electrons = _spread(sensor, x, y, electrons, content.stands)
        add_sources(image_e, x, y, electrons, fwhm_px=content.fwhm_px)
    else:
        _add_shaken(image_e, x, y, electrons, content)
    for streak in content.streaks:
        points = streak_points(sensor, content, streak)
        fwhm_px = content.fwhm_px if streak.fwhm_px is None else streak.fwhm_px
        add_sources(image_e, *points, fwhm_px=fwhm_px, faintest_e=0.004)
    if content.defocus_px > 0.0:
        kernel = annulus(content.defocus_px)
        image_e = cv2.filter2D(image_e, -1, kernel, borderType=cv2.BORDER_REFLECT_101)
    image_e *= flat_field(sensor)
    defects = pixel_defects(sensor)
    image_e += np.float32(sensor.dark_e_s * content.exposure_s)
    if sensor.glow_e_s > 0.0:
        image_e += amplifier_glow(sensor) * np.float32(content.exposure_s)
    image_e.reshape(-1)[defects.index] += defects.electrons_s * np.float32(content.exposure_s)
    return image_e


def streak_points(
    sensor: SensorModel, content: FieldContent, streak: Streak
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A streak as points x, y and electrons, each (n,), dimmed by its light curve and clouds."""
    length = float(np.hypot(np.diff(streak.x_px), np.diff(streak.y_px)).sum())
    step_px = STREAK_STEP_PX
    if streak.fwhm_px is not None:
        step_px = max(step_px, 0.5 * streak.fwhm_px / FWHM_PER_SIGMA)
    count = max(2, int(np.ceil(length / step_px)))
    time = (np.arange(count) + 0.5) / count
    nodes = np.linspace(0.0, 1.0, len(streak.x_px))
    x = np.interp(time, nodes, streak.x_px)
    y = np.interp(time, nodes, streak.y_px)
    electrons = np.full(count, streak.electrons / count)
    if streak.brightness is not None:
        shape = np.asarray(streak.brightness, dtype=np.float64)
        electrons *= np.interp(time, np.linspace(0.0, 1.0, len(shape)), shape)
    electrons *= transmission_at(sensor, content.cloud_transmission, x, y)
    return x, y, electrons


def _wandering(
    x_px: FloatArray, y_px: FloatArray, electrons: FloatArray, path_px: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Stars as points along their paths, closer to each other than any seeing disc."""
    length = float(np.hypot(*np.diff(path_px, axis=1)).sum())
    count = max(2, int(np.ceil(length / (1.6 * STREAK_STEP_PX))))
    time, nodes = (np.arange(count) + 0.5) / count, np.linspace(0.0, 1.0, path_px.shape[1])
    dx, dy = np.interp(time, nodes, path_px[0]), np.interp(time, nodes, path_px[1])
    return (
        (np.asarray(x_px)[:, None] + dx).ravel(),
        (np.asarray(y_px)[:, None] + dy).ravel(),
        np.repeat(electrons / count, count),
    )


def _is_turned(sensor: SensorModel, stands: FloatArray) -> bool:
    """True where a corner of the frame moved differently from its middle."""
    reach_px = 0.5 * math.hypot(sensor.width_px, sensor.height_px)
    return bool(np.abs(stands[2]).max() * reach_px > _TURN_SEEN_PX)


def _add_shaken(
    image_e: Float32Array,
    x_px: FloatArray,
    y_px: FloatArray,
    electrons: FloatArray,
    content: FieldContent,
) -> None:
    """Add stars that all moved alike: drawn once, on a wider frame, and smeared along the way."""
    assert content.stands is not None
    kernel = image_motion_kernel(content.stands)
    reach = kernel.shape[0] // 2
    height, width = image_e.shape
    still = np.zeros((height + 2 * reach, width + 2 * reach), dtype=np.float32)
    add_sources(still, x_px + reach, y_px + reach, electrons, fwhm_px=content.fwhm_px)
    # OpenCV correlates: turned by half a circle it convolves.
    moved = cv2.filter2D(still, -1, kernel[::-1, ::-1], borderType=cv2.BORDER_CONSTANT)
    image_e += moved[reach : reach + height, reach : reach + width]


def _spread(
    sensor: SensorModel,
    x_px: FloatArray,
    y_px: FloatArray,
    electrons: FloatArray,
    stands: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Stars at each place where the image stood, with its share of the light."""
    dx, dy, turn, share = stands
    cx, cy = (sensor.width_px - 1) / 2.0, (sensor.height_px - 1) / 2.0
    rx, ry = np.asarray(x_px)[:, None] - cx, np.asarray(y_px)[:, None] - cy
    return (
        (cx + rx * np.cos(turn) - ry * np.sin(turn) + dx).ravel(),
        (cy + rx * np.sin(turn) + ry * np.cos(turn) + dy).ravel(),
        (np.asarray(electrons)[:, None] * share).ravel(),
    )


def transmission_at(
    sensor: SensorModel, transmission: Float32Array | None, x_px: FloatArray, y_px: FloatArray
) -> FloatArray:
    """Return the clouds' transmission (n,) at pixels; off the frame, at its nearest edge."""
    x, y = np.asarray(x_px, dtype=np.float64), np.asarray(y_px, dtype=np.float64)
    if transmission is None:
        return np.ones(len(x))
    rows, columns = transmission.shape
    u = np.clip((x + 0.5) * columns / sensor.width_px - 0.5, 0.0, columns - 1.0)
    v = np.clip((y + 0.5) * rows / sensor.height_px - 0.5, 0.0, rows - 1.0)
    i, j = np.floor(v).astype(np.int64), np.floor(u).astype(np.int64)
    i2, j2 = np.minimum(i + 1, rows - 1), np.minimum(j + 1, columns - 1)
    fv, fu = v - i, u - j
    grid = transmission.astype(np.float64)
    top = grid[i, j] * (1 - fu) + grid[i, j2] * fu
    bottom = grid[i2, j] * (1 - fu) + grid[i2, j2] * fu
    return np.asarray(top * (1 - fv) + bottom * fv, dtype=np.float64)


def _sky(sensor: SensorModel, content: FieldContent) -> Float32Array:
    """Sky, its gradient and the glow of clouds: a coarse grid spread over the frame."""
    grid = content.cloud_transmission
    rows, columns = (16, 16) if grid is None else grid.shape
    glow = np.ones((rows, columns)) if grid is None else 1 + content.cloud_glow * (1.0 - grid)
    along_x = content.sky_gradient[0] * ((np.arange(columns) + 0.5) / columns - 0.5)
    along_y = content.sky_gradient[1] * ((np.arange(rows) + 0.5) / rows - 0.5)
    coarse = content.sky_electrons_px * glow * (1.0 + along_x[None, :] + along_y[:, None])
    size = (sensor.width_px, sensor.height_px)
    spread = cv2.resize(coarse.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(spread, dtype=np.float32)


def _add_cosmic_rays(
    image_e: Float32Array, content: FieldContent, rng: np.random.Generator
) -> None:
    """Tracks of muons (short, straight) and of electrons (curled): mostly narrower than a star."""
    height, width = image_e.shape
    narrowest, widest = content.cosmic_ray_sigma_px
    for _ in range(int(rng.poisson(content.cosmic_rays))):
        is_curled = rng.random() < 0.35
        length = rng.uniform(8.0, 40.0) if is_curled else 1.0 + rng.exponential(5.0)
        length *= content.cosmic_ray_stretch
        count = max(2, int(length * 3))
        turns = rng.normal(0.0, 0.12 if is_curled else 0.0, size=count)
        heading = rng.uniform(0.0, 2.0 * np.pi) + np.cumsum(turns)
        x = rng.uniform(0, width) + np.cumsum(np.cos(heading)) * length / count
        y = rng.uniform(0, height) + np.cumsum(np.sin(heading)) * length / count
        electrons_px = np.exp(rng.normal(np.log(450.0), 0.7))
        weight = rng.gamma(4.0, 0.25, size=count) * electrons_px * length / count
        sigma_px = rng.uniform(narrowest, widest) if widest > narrowest else narrowest
        add_points(image_e, x, y, weight, sigma_px=sigma_px)


def _pattern(
    sensor: SensorModel, content: FieldContent
) -> tuple[Float32Array, Float32Array] | None:
    """Offsets of rows (height, 1) and columns (width,); None without any."""
    rows, columns = content.row_offsets_e, content.column_offsets_e
    if rows is None and columns is None:
        return None
    none = np.zeros(1, dtype=np.float32)
    return (
        np.broadcast_to(none if rows is None else rows, sensor.height_px)[:, None],
        none if columns is None else columns,
    )


def _read_out(
    sensor: SensorModel,
    mean_e: Float32Array,
    pattern_e: tuple[Float32Array, Float32Array] | None,
    rng: np.random.Generator,
) -> FramePixels:
    """Photon and read noise, full well, converter; block by block to stay in the cache."""
    height, width = mean_e.shape
    pixels = np.empty((height, width), dtype=np.uint16)
    normal = np.empty((min(_ROWS_AT_ONCE, height), width), dtype=np.float32)
    read_variance = np.float32(sensor.read_noise_e**2)
    ceiling = np.float32(sensor.largest_value_adu12)
    for top in range(0, height, _ROWS_AT_ONCE):
        mean = mean_e[top : top + _ROWS_AT_ONCE]
        noise = normal[: len(mean)]
        rng.standard_normal(dtype=np.float32, out=noise)
        value = noise * np.sqrt(np.maximum(mean, 0) + read_variance)
        value += mean
        if mean.min() < _POISSON_BELOW_E:
            few = mean < _POISSON_BELOW_E
            counted = rng.poisson(np.maximum(mean[few], 0)).astype(np.float32)
            value[few] = counted + noise[few] * np.float32(sensor.read_noise_e)
        if pattern_e is not None:
            value += pattern_e[0][top : top + len(mean)] + pattern_e[1]
        value *= np.float32(1.0 / sensor.e_per_adu12)
        value += np.float32(sensor.offset_adu12 + 0.5)
        np.clip(value, 0.0, ceiling, out=value)
        pixels[top : top + len(mean)] = value.astype(np.uint16) << sensor.stored_shift_bits
    return pixels
