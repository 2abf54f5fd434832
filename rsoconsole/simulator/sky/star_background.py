"""Synthetic stars fainter than the catalogue's limit: realistic counts, the same every night.

The stars of each cell of the sky come from a generator seeded by the cell, so that overlapping
frames agree. Counts: Allen's Astrophysical Quantities, 4th ed., table 19.10 (V, rounded),
interpolated between the galactic pole and plane.
"""

import math
from functools import lru_cache

import erfa
import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.simulator.camera.rendering import frame_rng
from rsoconsole.sky import JD_UNIX, Stars, separation_deg
from rsoconsole.words import NS_PER_DAY

CELL_DEG = 0.5
BRIGHTEST_MAG = 11.0
_SKY = 2000
_POLE_RA_DEG, _POLE_DEC_DEG = 192.85948, 27.12825
_COUNT_MAG = np.array([11.0, 12.0, 13.0, 14.0, 15.0, 16.0, 17.0, 18.0, 19.0, 20.0])
_LOG_COUNT_POLE = np.array([1.10, 1.47, 1.81, 2.13, 2.43, 2.70, 2.94, 3.16, 3.35, 3.52])
"""log10 of stars a square degree brighter than the magnitude, at the galactic pole."""
_LOG_COUNT_PLANE = np.array([1.67, 2.12, 2.56, 2.99, 3.38, 3.75, 4.09, 4.41, 4.70, 4.97])
_LATITUDE_SCALE_DEG = 29.0


def galactic_latitude_deg(ra_icrs_deg: float, dec_icrs_deg: float) -> float:
    """Galactic latitude of a direction, -90 to 90."""
    return 90.0 - separation_deg(_POLE_RA_DEG, _POLE_DEC_DEG, ra_icrs_deg, dec_icrs_deg)


def faint_stars(
    ra_icrs_deg: float, dec_icrs_deg: float, radius_deg: float, faintest_magnitude: float
) -> Stars:
    """Synthetic stars in all cells that a cone touches; some stars lie outside the cone."""
    cells = [(np.zeros(0), np.zeros(0), np.zeros(0))]
    lowest = math.floor((max(dec_icrs_deg - radius_deg, -90.0) + 90.0) / CELL_DEG)
    highest = math.floor((min(dec_icrs_deg + radius_deg, 89.999) + 90.0) / CELL_DEG)
    for band in range(lowest, highest + 1):
        count = _cells_in_band(band)
        width_deg = 360.0 / count
        dec_far = min(abs(dec_icrs_deg) + radius_deg, 89.9)
        reach_deg = min(radius_deg / math.cos(math.radians(dec_far)), 180.0 - width_deg)
        first = math.floor((ra_icrs_deg - reach_deg) / width_deg)
        last = math.floor((ra_icrs_deg + reach_deg) / width_deg)
        numbers = sorted({each % count for each in range(first, last + 1)})
        cells += [_cell(band, cell, faintest_magnitude) for cell in numbers]
    ra, dec, magnitude = (np.concatenate(column) for column in zip(*cells, strict=True))
    return Stars.without_proper_motion(ra, dec, magnitude)


def _cells_in_band(band: int) -> int:
    dec = -90.0 + (band + 0.5) * CELL_DEG
    return max(1, round(360.0 * math.cos(math.radians(dec)) / CELL_DEG))


@lru_cache(maxsize=400)
def _cell(
    band: int, cell: int, faintest_magnitude: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """RA, Dec and magnitude of the stars of one cell."""
    rng = frame_rng(_SKY, band, cell)
    width_deg = 360.0 / _cells_in_band(band)
    dec_low = -90.0 + band * CELL_DEG
    ra_mid, dec_mid = (cell + 0.5) * width_deg, dec_low + 0.5 * CELL_DEG
    area_deg2 = width_deg * CELL_DEG * math.cos(math.radians(dec_mid))
    log_count = _log_count(galactic_latitude_deg(ra_mid, dec_mid))
    grid = np.linspace(BRIGHTEST_MAG, faintest_magnitude, 120)
    cumulative = 10.0 ** np.interp(grid, _COUNT_MAG, log_count)
    total = int(rng.poisson(area_deg2 * (cumulative[-1] - cumulative[0])))
    magnitude = np.interp(rng.uniform(cumulative[0], cumulative[-1], total), cumulative, grid)
    ra = (cell + rng.random(total)) * width_deg
    dec = dec_low + rng.random(total) * CELL_DEG
    # The catalogue thins out between 11.2 and 12.8: only what it lacks is added.
    is_added = rng.random(total) < np.clip((magnitude - 11.2) / 1.6, 0.0, 1.0)
    return ra[is_added] % 360.0, dec[is_added], magnitude[is_added]


def _log_count(latitude_deg: float) -> FloatArray:
    towards_plane = math.exp(-abs(latitude_deg) / _LATITUDE_SCALE_DEG)
    return np.asarray(_LOG_COUNT_POLE + (_LOG_COUNT_PLANE - _LOG_COUNT_POLE) * towards_plane)


def star_positions_at(stars: Stars, t_utc_ns: int) -> tuple[FloatArray, FloatArray]:
    """Return RA and Dec, deg, of stars moved from J2000.0 to an instant by proper motion.

    By SOFA's routine, independent of the code that reduces measurements.
    """
    arcsec = math.radians(1.0 / 3600.0)
    zero = np.zeros(len(stars))
    pm_ra = stars.pm_ra_mas_yr * arcsec / 1e3 / np.cos(np.radians(stars.dec_icrs_deg))
    # The plain function warns of every star without a parallax.
    ra, dec, *_ = erfa.ufunc.pmsafe(
        np.radians(stars.ra_icrs_deg),
        np.radians(stars.dec_icrs_deg),
        pm_ra,
        stars.pm_dec_mas_yr * arcsec / 1e3,
        zero,
        zero,
        erfa.DJ00,
        0.0,
        JD_UNIX,
        t_utc_ns / NS_PER_DAY,
    )
    return np.degrees(ra) % 360.0, np.degrees(dec)
