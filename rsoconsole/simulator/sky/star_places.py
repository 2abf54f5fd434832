"""Where the catalogue's stars stand in the simulated sky on the day of the frame."""

import math

import erfa
import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.sky import JD_UNIX, NS_PER_DAY
from rsoconsole.sky.stars import Stars


def places_now(stars: Stars, t_utc_ns: int) -> tuple[FloatArray, FloatArray]:
    """(RA, Dec) of stars given at J2000.0, by SOFA's space motion and not the reduction's own."""
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
