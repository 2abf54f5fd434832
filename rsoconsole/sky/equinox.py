"""Directions on old star charts turned to ICRS, by astropy."""

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.sky.times import NS_PER_S, IntArray


def chart_to_icrs(
    ra_deg: FloatArray, dec_deg: FloatArray, equinox_year: int | None, t_utc_ns: IntArray
) -> tuple[FloatArray, FloatArray]:
    """(N,) degrees of directions seen at (N,) instants, on charts of one equinox.

    ``equinox_year``: 2000 and later of FK5, before 1984 of FK4; None: that of date.
    """
    if equinox_year == 2000:
        return ra_deg, dec_deg  # FK5 differs from ICRS by 0.02 arcsec
    from astropy.coordinates import FK4, FK5, SkyCoord
    from astropy.time import Time

    date = Time(t_utc_ns / NS_PER_S, format="unix")
    if equinox_year is None:
        frame = FK5(equinox=date)
    elif equinox_year < 1984:
        frame = FK4(equinox=Time(equinox_year, format="byear"), obstime=date)
    else:
        frame = FK5(equinox=Time(equinox_year, format="jyear"))
    found = SkyCoord(ra_deg, dec_deg, unit="deg", frame=frame).icrs
    return np.asarray(found.ra.deg), np.asarray(found.dec.deg)
