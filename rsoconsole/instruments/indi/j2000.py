"""Mounts whose drivers know places of the epoch J2000 alone (EQUATORIAL_COORD).

Their coordinates are taken for those of date (EQUATORIAL_EOD_COORD), converted, where INDI's
messages come in and go out; so nothing else knows of the difference. J2000's axes are those of the
ICRS within 0.02 arcsec.
"""

from collections.abc import Mapping
from typing import Any

from rsoconsole.sky import deg_to_hours, hours_to_deg, icrs_to_jnow, jnow_to_icrs


def to_date(values: Mapping[str, Any], t_utc_ns: int) -> dict[str, Any]:
    """Convert RA (hours) and Dec (deg) of J2000 to those of date; other members stay."""
    ra_deg, dec_deg = icrs_to_jnow(hours_to_deg(values["RA"]), values["DEC"], t_utc_ns)
    return {**values, "RA": deg_to_hours(float(ra_deg)), "DEC": float(dec_deg)}


def from_date(values: Mapping[str, float], t_utc_ns: int) -> dict[str, float]:
    """Convert RA (hours) and Dec (deg) of date to those of J2000."""
    ra_deg, dec_deg = jnow_to_icrs(hours_to_deg(values["RA"]), values["DEC"], t_utc_ns)
    return {**values, "RA": deg_to_hours(float(ra_deg)), "DEC": float(dec_deg)}
