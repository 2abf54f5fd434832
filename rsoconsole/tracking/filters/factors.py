"""The operator's factors on Q and R, as a bank of filters uses them. Pure."""

from dataclasses import dataclass

import numpy as np

from rsoconsole.config import FilterConfig
from rsoconsole.records import FloatArray


@dataclass(frozen=True, eq=False)
class NoiseFactors:
    """The operator's factors on the noise of every filter of a bank."""

    process_roots: FloatArray
    """(6,) square roots of the factors on the process noise, in the order of a motion."""
    measured_roots: FloatArray
    """(2,) square roots of the factors on all of the measured noise, east and north."""
    is_held: bool
    """True where what is believed of the measured noise does not learn from measurements."""

    def of_process(self, noise: FloatArray) -> FloatArray:
        """Return a process noise (..., 6, 6) with the factors."""
        return np.asarray(noise * np.outer(self.process_roots, self.process_roots))

    def of_measured(self, noise: FloatArray) -> FloatArray:
        """Return a measured noise (..., 2, 2) with the factors."""
        return np.asarray(noise * np.outer(self.measured_roots, self.measured_roots))


NO_FACTORS = NoiseFactors(np.ones(6), np.ones(2), False)


def noise_factors(settings: FilterConfig) -> NoiseFactors:
    """Return the operator's factors on Q and R, for a bank."""
    ra, ra_rate, dec, dec_rate = q_multipliers(settings)
    process = np.array([ra, dec, ra_rate, dec_rate, 1.0, 1.0]) * settings.q_multiplier
    measured = np.array([settings.r_ra_multiplier, settings.r_dec_multiplier])
    return NoiseFactors(
        np.sqrt(process), np.sqrt(measured * settings.r_multiplier), settings.is_noise_held
    )


def q_multipliers(settings: FilterConfig) -> tuple[float, float, float, float]:
    """Return the operator's factors on Q: of right ascension, its rate, declination, its rate."""
    return (
        settings.q_ra_multiplier,
        settings.q_ra_rate_multiplier,
        settings.q_dec_multiplier,
        settings.q_dec_rate_multiplier,
    )
