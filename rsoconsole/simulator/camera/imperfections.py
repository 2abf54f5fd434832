"""What keeps real astrometry from being as good as a renderer's: wrong places, air, shutters.

Without these the reducer would meet stars at exactly the places its own catalogue gives, and
would look better than it is.
"""

import math

import numpy as np

from rsoconsole.records import FloatArray

CATALOGUE_SIGMA_ARCSEC = 0.45
"""A star against the place its proper motion gives: several times what Tycho-2 leaves (0.1)."""
SHUTTER_SIGMA_S = 0.015
"""True opening of the shutter against what the driver writes."""


def catalogue_errors_arcsec(
    ra_icrs_deg: FloatArray,
    dec_icrs_deg: FloatArray,
    sigma_arcsec: float = CATALOGUE_SIGMA_ARCSEC,
) -> tuple[FloatArray, FloatArray]:
    """(east, north) by which each star misses its catalogue's place; always the same.

    Drawn from the place at J2000.0, so that neither the order of asking nor a seed matters: the sky
    is one.
    """
    micro_deg = 1e6
    key = np.rint(ra_icrs_deg * micro_deg).astype(np.uint64) * np.uint64(400_000_007)
    key += np.rint((dec_icrs_deg + 90.0) * micro_deg).astype(np.uint64)
    radius = np.sqrt(-2.0 * np.log(_uniform(key, 1)))
    angle = 2.0 * math.pi * _uniform(key, 2)
    return (
        sigma_arcsec * radius * np.cos(angle),
        sigma_arcsec * radius * np.sin(angle),
    )


def air_sigma_arcsec(exposure_s: float) -> float:
    """Wander of one direction against another half a degree off, on each axis.

    1.3 arcsec theta^0.25 T^-0.5 with theta in radians. Source: Lindegren 1980.
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
