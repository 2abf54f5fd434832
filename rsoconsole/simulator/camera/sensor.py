"""The camera's sensor: conversion of photons to numbers, and the defects of its pixels."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray

Float32Array = npt.NDArray[np.float32]
IndexArray = npt.NDArray[np.int64]

MOSAIC_RGGB = (0.45, 0.60, 0.60, 0.40)
"""Fraction of a star's light transmitted by the red, the two green and the blue filters."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorModel:
    """A CMOS sensor behind a telescope; defaults: ASI1600MM-Pro on an 11-inch RASA, gain 0.

    Read noise, full well and conversion are the maker's figures; the zero point is that of the
    independent simulator whose frames lie in ``data/simulated``. For another frame size:
    ``dataclasses.replace(sensor, width_px=..., height_px=...)``.
    """

    width_px: int = 4656
    height_px: int = 3520
    pixel_um: float = 3.8
    focal_length_mm: float = 620.0
    zero_point_mag: float = 21.812
    """Magnitude of a source of one electron per second, at the zenith under a clear sky."""
    e_per_adu12: float = 20000.0 / 4096.0
    offset_adu12: float = 21.0
    read_noise_e: float = 1.7
    full_well_e: float = 20000.0
    dark_e_s: float = 0.006
    adc_bits: int = 12
    stored_shift_bits: int = 4
    """Left shift with which the driver stores the ADC's number: full scale is near 65535."""
    vignetting_corner: float = 0.07
    """Fraction of light lost in the corners; grows with the distance from the centre squared."""
    prnu: float = 0.004
    """One sigma of the pixels' response relative to 1 (photo-response non-uniformity)."""
    hot_fraction: float = 2.5e-5
    bad_columns: int = 0
    partial_columns: int = 0
    """Number of columns that are bright from a random row on."""
    dark_columns: int = 0
    """Number of columns with a reduced response to light, from a random row on."""
    blooming: float = 0.0
    """Fraction of the charge above the full well that spills along the column."""
    glow_e_s: float = 0.0
    """Amplifier glow of the last pixel (e/s); it falls to 1/e over a tenth of the diagonal."""
    is_bayer: bool = False
    """True: the sensor has a colour mosaic, RGGB."""
    seed: int = 1600
    """Seed of this copy of the sensor: its hot pixels, bad columns and pixel response."""

    def __post_init__(self) -> None:
        """Raises ValueError for values that no sensor can have."""
        if self.width_px < 1 or self.height_px < 1:
            raise ValueError("a sensor has at least one pixel each way")
        if self.adc_bits + self.stored_shift_bits > 16:
            raise ValueError("the stored number must fit 16 bits: lower the shift")
        if min(self.e_per_adu12, self.full_well_e) <= 0 or self.read_noise_e < 0:
            raise ValueError("conversion and full well must be positive, read noise not negative")

    @property
    def scale_arcsec_px(self) -> float:
        """Plate scale at the centre of the field."""
        return 206.264806 * self.pixel_um / self.focal_length_mm

    @property
    def mean_filter_transmission(self) -> float:
        """Mean fraction of light transmitted by a colour mosaic's filters; 1 without a mosaic."""
        return sum(MOSAIC_RGGB) / 4.0 if self.is_bayer else 1.0

    @property
    def largest_value_adu12(self) -> float:
        """Largest converter output, before the shift to 16 bits: its limit or the full well."""
        full_well_adu12 = self.offset_adu12 + self.full_well_e / self.e_per_adu12
        return min(2.0**self.adc_bits - 1.0, full_well_adu12)

    @property
    def saturation_adu(self) -> float:
        """Stored value of a saturated pixel."""
        return float(int(self.largest_value_adu12) << self.stored_shift_bits)

    def electrons(
        self, magnitude: float | npt.NDArray[np.floating], exposure_s: float
    ) -> npt.NDArray[np.float64]:
        """Electrons from a source of this magnitude in one exposure, in the centre of the field."""
        gain = 0.4 * (self.zero_point_mag - np.asarray(magnitude, dtype=np.float64))
        return np.asarray(exposure_s * 10.0**gain, dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class PixelDefects:
    """Hot pixels as flat indices, and the electrons per second that each adds."""

    index: IndexArray
    electrons_s: Float32Array


def _defect_rng(sensor: SensorModel, purpose: int) -> np.random.Generator:
    key = np.random.SeedSequence([sensor.seed, sensor.width_px, sensor.height_px, purpose])
    return np.random.Generator(np.random.SFC64(key))


@lru_cache(maxsize=8)
def pixel_defects(sensor: SensorModel) -> PixelDefects:
    """Return the hot pixels and bad columns of a sensor; equal models have equal defects."""
    rng = _defect_rng(sensor, 1)
    total = sensor.width_px * sensor.height_px
    count = int(rng.binomial(total, sensor.hot_fraction))
    hot = rng.integers(0, total, size=count, dtype=np.int64)
    rates = np.exp(rng.uniform(np.log(3.0), np.log(1500.0), size=count))
    columns = rng.integers(0, sensor.width_px, size=sensor.bad_columns, dtype=np.int64)
    rows = np.arange(sensor.height_px, dtype=np.int64)
    lines = (rows[:, None] * sensor.width_px + columns[None, :]).ravel()
    line_rates = np.tile(rng.uniform(3.0, 30.0, size=sensor.bad_columns), sensor.height_px)
    places, electrons_s = [hot, lines], [rates, line_rates]
    for _ in range(sensor.partial_columns):
        first, column = int(rng.integers(sensor.height_px)), int(rng.integers(sensor.width_px))
        places.append(rows[first:] * sensor.width_px + column)
        electrons_s.append(np.full(sensor.height_px - first, rng.uniform(3.0, 30.0)))
    return PixelDefects(np.concatenate(places), np.concatenate(electrons_s).astype(np.float32))


def vignetting(
    sensor: SensorModel, x_px: npt.NDArray[np.floating], y_px: npt.NDArray[np.floating]
) -> npt.NDArray[np.float64]:
    """Fraction of the light that reaches these pixels, (n,); 1 in the centre of the field."""
    cx, cy = (sensor.width_px - 1) / 2.0, (sensor.height_px - 1) / 2.0
    reach2 = max(cx * cx + cy * cy, 1.0)
    return np.asarray(
        1.0 - sensor.vignetting_corner * ((x_px - cx) ** 2 + (y_px - cy) ** 2) / reach2,
        dtype=np.float64,
    )


@lru_cache(maxsize=2)
def flat_field(sensor: SensorModel) -> Float32Array:
    """Relative response of every pixel: vignetting times pixel response, (height, width)."""
    x = np.arange(sensor.width_px, dtype=np.float64)
    flat = np.empty((sensor.height_px, sensor.width_px), dtype=np.float32)
    rng = _defect_rng(sensor, 2)
    for y in range(sensor.height_px):
        flat[y] = vignetting(sensor, x, np.array([y], dtype=np.float64))
        flat[y] *= 1.0 + sensor.prnu * rng.standard_normal(sensor.width_px, dtype=np.float32)
    dark = _defect_rng(sensor, 3)
    for _ in range(sensor.dark_columns):
        first, column = int(dark.integers(sensor.height_px)), int(dark.integers(sensor.width_px))
        flat[first:, column] *= np.float32(dark.uniform(0.0, 0.9))
    if sensor.is_bayer:
        for index, share in enumerate(MOSAIC_RGGB):
            flat[index // 2 :: 2, index % 2 :: 2] *= np.float32(share)
    flat.setflags(write=False)
    return flat


@lru_cache(maxsize=2)
def amplifier_glow(sensor: SensorModel) -> Float32Array:
    """Amplifier glow in electrons per second, (height, width); brightest at the last pixel."""
    diagonal_px = float(np.hypot(sensor.width_px, sensor.height_px))
    x = np.arange(sensor.width_px)[None, :] - (sensor.width_px - 1)
    y = np.arange(sensor.height_px)[:, None] - (sensor.height_px - 1)
    glow = (sensor.glow_e_s * np.exp(-np.hypot(x, y) / (0.1 * diagonal_px))).astype(np.float32)
    glow.setflags(write=False)
    return glow


def apply_blooming(image_e: Float32Array, full_well_e: float, share: float) -> None:
    """Move a fraction of the charge above the full well up and down its column, in place.

    ``share``: that fraction, ``SensorModel.blooming``.
    """
    for column in np.flatnonzero((image_e > full_well_e).any(axis=0)):
        values = image_e[:, column]
        edges = np.diff((values > full_well_e).astype(np.int8), prepend=0, append=0)
        starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
        for start, end in zip(starts, ends, strict=True):
            charge = share * float((values[start:end] - full_well_e).sum()) / 2.0
            for beside in (values[end:], values[:start][::-1]):
                room = np.maximum(full_well_e - beside, 0.0)
                before = np.cumsum(room) - room
                np.add(beside, np.clip(charge - before, 0.0, room), out=beside)


CATALOGUE_SIGMA_ARCSEC = 0.45
"""One sigma of the catalogue's error of a star's position; Tycho-2's own is about 0.1."""
SHUTTER_SIGMA_S = 0.015
"""One sigma of the delay between the driver's start time and the shutter's true opening."""


def catalogue_errors_arcsec(
    ra_icrs_deg: FloatArray, dec_icrs_deg: FloatArray, sigma_arcsec: float = CATALOGUE_SIGMA_ARCSEC
) -> tuple[FloatArray, FloatArray]:
    """Errors (east, north), each (n,), of the stars' positions in the catalogue.

    Fixed by each star's position at J2000.0 alone: no seed and no order of calls changes them.
    """
    micro_deg = 1e6
    key = np.rint(ra_icrs_deg * micro_deg).astype(np.uint64) * np.uint64(400_000_007)
    key += np.rint((dec_icrs_deg + 90.0) * micro_deg).astype(np.uint64)
    radius = np.sqrt(-2.0 * np.log(_uniform(key, 1)))
    angle = 2.0 * math.pi * _uniform(key, 2)
    return (sigma_arcsec * radius * np.cos(angle), sigma_arcsec * radius * np.sin(angle))


def atmospheric_shift_sigma_arcsec(exposure_s: float) -> float:
    """Return one sigma, per axis, of the air's shift of one direction relative to another.

    For directions half a degree apart: 1.3 arcsec theta^0.25 T^-0.5, theta in radians, exposure T
    in seconds. Source: Lindegren 1980.
    """
    return float(1.3 * math.radians(0.5) ** 0.25 / math.sqrt(max(exposure_s, 0.01)))


def _uniform(key: np.ndarray[tuple[int, ...], np.dtype[np.uint64]], salt: int) -> FloatArray:
    """Numbers in (0, 1) from 64-bit keys. Source: splitmix64, Steele, Lea & Flood 2014."""
    with np.errstate(over="ignore"):
        z = key + np.uint64(salt) * np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z ^= z >> np.uint64(31)
    return np.asarray(((z >> np.uint64(11)).astype(np.float64) + 0.5) / 2.0**53)
