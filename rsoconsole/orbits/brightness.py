"""Magnitudes at a common distance and phase, as of a diffuse (Lambert) sphere. Pure.

An apparent magnitude says little of an object until its distance and the side that the Sun lights
are taken out. The sphere is a convention: a real satellite has panels and flashes, so that a
reduced magnitude is given beside the apparent one, never in its place.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

REFERENCE_RANGE_KM = 1000.0
REFERENCE_PHASE_DEG = 90.0
GEO_RANGE_KM = 36_000.0
"""Distance to which magnitudes of geostationary satellites are usually reduced."""
_SIGMA_PER_MAD = 1.4826
"""Sigma of a normal distribution by its median absolute deviation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StandardMagnitude:
    """Magnitude of an object at 1000 km and a phase angle of 90 deg, as of a diffuse sphere."""

    mag: float
    sigma_mag: float
    """Scatter of single magnitudes about it, at least the error of one."""


def standard_magnitude(
    reduced_mags: Sequence[float], sigmas_mag: Sequence[float]
) -> StandardMagnitude | None:
    """Return the median of reduced magnitudes with their robust scatter; None where there are none.

    ``sigmas_mag``: one sigma of each. By few magnitudes the scatter may be small by chance: it is
    never below the median of these.
    """
    if not reduced_mags:
        return None
    middle = median(reduced_mags)
    scatter = _SIGMA_PER_MAD * median(abs(each - middle) for each in reduced_mags)
    return StandardMagnitude(mag=middle, sigma_mag=max(scatter, median(sigmas_mag)))


def reduced_magnitude(mag: float, range_km: float, phase_deg: float) -> float | None:
    """Return the magnitude at 1000 km and a phase angle of 90 deg.

    ``mag``: apparent magnitude; ``range_km``: from site to object; ``phase_deg``: angle at the
    object between Sun and site, 0 to 180. None at 180 deg, where the sphere shows no light.
    """
    brightness = lambert_phase_function(phase_deg)
    if brightness <= 0.0:
        return None
    change = brightness / lambert_phase_function(REFERENCE_PHASE_DEG)
    return magnitude_at_range(mag, range_km, REFERENCE_RANGE_KM) + 2.5 * math.log10(change)


def apparent_magnitude(standard_mag: float, range_km: float, phase_deg: float) -> float | None:
    """Return the apparent magnitude of an object by its magnitude at 1000 km and 90 deg.

    The inverse of ``reduced_magnitude``; None at a phase angle of 180 deg.
    """
    brightness = lambert_phase_function(phase_deg)
    if brightness <= 0.0:
        return None
    change = brightness / lambert_phase_function(REFERENCE_PHASE_DEG)
    mag = magnitude_at_range(standard_mag, REFERENCE_RANGE_KM, range_km)
    return mag - 2.5 * math.log10(change)


def magnitude_at_range(mag: float, range_km: float, to_km: float = GEO_RANGE_KM) -> float:
    """Return the magnitude at another distance and the same phase; default: 36,000 km."""
    return mag - 5.0 * math.log10(range_km / to_km)


def lambert_phase_function(phase_deg: float) -> float:
    """Return the light of a diffuse sphere at a phase angle: pi at 0 deg, 1 at 90, 0 at 180."""
    phase = math.radians(min(max(phase_deg, 0.0), 180.0))
    light = (math.pi - phase) * math.cos(phase) + math.sin(phase)
    return light if light > 1e-12 else 0.0
