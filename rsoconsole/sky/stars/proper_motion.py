"""Proper motion: catalogue positions of stars moved to another epoch.

A star moves straight on at its angular speed. Its radial velocity is neglected (0.4 arcsec for
Barnard's star in 26 years, nothing for the others), and so is its parallax. Source: Hipparcos and
Tycho Catalogues, ESA SP-1200, 1997, volume 1, section 1.5.5.
"""

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.sky.angles import direction_to_unit, east_and_north, unit_to_direction
from rsoconsole.words import NS_PER_DAY

J2000_JYEAR = 2000.0
FASTEST_ARCSEC_YR = 10.4
"""Largest proper motion, arcsec/yr: Barnard's star."""
_J2000_UTC_NS = 946_728_000 * 1_000_000_000
_RAD_PER_MAS = np.pi / 648_000_000.0


def julian_year(t_utc_ns: int) -> float:
    """Convert UTC ns to a Julian epoch in years; UTC counts as TT, a minute moves no star."""
    return J2000_JYEAR + (t_utc_ns - _J2000_UTC_NS) / NS_PER_DAY / 365.25


def apply_proper_motion(
    ra_icrs_deg: FloatArray,
    dec_icrs_deg: FloatArray,
    pm_ra_mas_yr: FloatArray,
    pm_dec_mas_yr: FloatArray,
    years: float,
) -> tuple[FloatArray, FloatArray]:
    """Move ICRS places (N,), degrees, by ``years`` of proper motion; returns RA and Dec.

    The motion in RA is times cos(dec), as in Tycho-2.
    """
    east, north = east_and_north(ra_icrs_deg, dec_icrs_deg)
    way = pm_ra_mas_yr[:, None] * east + pm_dec_mas_yr[:, None] * north
    return unit_to_direction(
        direction_to_unit(ra_icrs_deg, dec_icrs_deg) + years * _RAD_PER_MAS * way
    )
