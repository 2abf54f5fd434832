"""Sensors of altered frames, and telescopes at random, far beyond the paper's."""

import math
from dataclasses import dataclass, replace

from models.light import log_uniform
from rsoconsole.simulator import SensorModel, frame_rng

FULL, QUARTER = SensorModel(), SensorModel(width_px=2328, height_px=1760)
TELESCOPES = 1_000_000
_SEED = 5008
_SCALE_ARCSEC_PX, _EXPOSURE_S, _FWHM_PX = (0.3, 10.0), (0.05, 60.0), (1.2, 8.0)
_AREA_PX, _SHAPE = (3e5, 6.1e7), (0.7, 1.5)
_BITS = (8, 10, 12, 14, 16)


@dataclass(frozen=True, slots=True, kw_only=True)
class Telescope:
    """A sensor behind an optic, how long it is exposed and how it shows stars."""

    sensor: SensorModel
    exposure_s: float
    fwhm_px: float


def telescope(number: float) -> Telescope:
    """Telescope ``number`` of ``TELESCOPES``, each a pure function of its number."""
    rng = frame_rng(_SEED, round(number))
    scale, area = log_uniform(rng, *_SCALE_ARCSEC_PX), log_uniform(rng, *_AREA_PX)
    shape, bits = float(rng.uniform(*_SHAPE)), int(rng.choice(_BITS))
    pixel_um, full_well_e = float(rng.uniform(2.4, 9.0)), log_uniform(rng, 8e3, 1e5)
    read_noise_e = log_uniform(rng, 1.0, 12.0)
    # With few bits the gain is set so that the converter still sees the noise.
    step_e = min(full_well_e / 2.0**bits, float(rng.uniform(0.7, 2.0)) * read_noise_e)
    sensor = SensorModel(
        width_px=int(math.sqrt(area * shape)),
        height_px=int(math.sqrt(area / shape)),
        pixel_um=pixel_um,
        focal_length_mm=206.264806 * pixel_um / scale,
        zero_point_mag=float(rng.uniform(19.0, 23.0)),
        e_per_adu12=step_e,
        offset_adu12=4.0 if bits == 8 else 2.0 ** (bits - 7),
        read_noise_e=read_noise_e,
        full_well_e=full_well_e,
        adc_bits=bits,
        stored_shift_bits=0 if bits == 8 or rng.random() < 0.5 else 16 - bits,
        vignetting_corner=float(rng.uniform(0.0, 0.4)),
        prnu=float(rng.uniform(0.001, 0.01)),
        hot_fraction=log_uniform(rng, 1e-5, 1e-3),
        seed=int(rng.integers(1 << 30)),
    )
    exposure_s, fwhm_px = log_uniform(rng, *_EXPOSURE_S), log_uniform(rng, *_FWHM_PX)
    return Telescope(sensor=sensor, exposure_s=exposure_s, fwhm_px=fwhm_px)


def joined(factor: float) -> SensorModel:
    """Sensor whose pixels are binned by this factor, with the same number of pixels."""
    n = round(factor)
    return replace(
        QUARTER,
        pixel_um=QUARTER.pixel_um * n,
        e_per_adu12=QUARTER.e_per_adu12 * n**2,
        full_well_e=QUARTER.full_well_e * n**2,
        read_noise_e=QUARTER.read_noise_e * n,
        dark_e_s=QUARTER.dark_e_s * n**2,
        prnu=QUARTER.prnu / n,
    )


def of_8_bits(electrons: float) -> SensorModel:
    return replace(
        QUARTER, adc_bits=8, stored_shift_bits=0, e_per_adu12=electrons, offset_adu12=4.0
    )
