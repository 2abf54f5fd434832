"""Quantities of one hour for frequent queries: apparent places, sidereal time and the Sun.

Within half an hour aberration, precession and nutation move a place by less than 0.02 arcsec, so
that slow quantities are computed once an hour. The Sun's place is taken to move evenly: good to an
arcsecond for hours.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import erfa
import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.sky.angles import wrap_180
from rsoconsole.sky.bodies import sun_icrs
from rsoconsole.sky.frames import icrs_to_jnow
from rsoconsole.sky.times import TimeLike, gast_deg, jd_tt
from rsoconsole.words import NS_PER_S

HOUR_NS = 3600 * NS_PER_S
SIDEREAL_DEG_S = 360.98564736629 / 86_400.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HourlySky:
    """Parameters of one hour that give apparent places, sidereal time and the Sun's place.

    Frame: true equator and equinox of date. Good to 0.1 arcsec for some hours around.
    """

    t_utc_ns: int
    """Middle of the hour, UTC ns."""
    astrom: Any
    """Parameters of erfa (``apci13``) for many places at one instant."""
    equation_of_origins_deg: float
    gast_deg: float
    sun_ra_deg: float
    """Apparent right ascension of the Sun's centre, of date, at ``t_utc_ns``."""
    sun_dec_deg: float
    sun_ra_rate_deg_s: float
    sun_dec_rate_deg_s: float

    def icrs_to_apparent_deg(self, ra_icrs_deg: float, dec_icrs_deg: float) -> tuple[float, float]:
        """Convert an ICRS direction to apparent RA (0 to 360) and declination of date."""
        ra, dec = erfa.atciqz(np.radians(ra_icrs_deg), np.radians(dec_icrs_deg), self.astrom)
        ra_deg = (np.degrees(ra) - self.equation_of_origins_deg) % 360.0
        return float(ra_deg), float(np.degrees(dec))

    def sidereal_deg(self, longitude_deg: float, t_utc_ns: TimeLike) -> FloatArray:
        """Local apparent sidereal time, 0 to 360; longitude east positive."""
        turned_deg = SIDEREAL_DEG_S * self._since_s(t_utc_ns)
        return np.asarray((self.gast_deg + longitude_deg + turned_deg) % 360.0)

    def sun_apparent_deg(self, t_utc_ns: TimeLike) -> tuple[FloatArray, FloatArray]:
        """Apparent right ascension (not wrapped) and declination of date of the Sun's centre."""
        since_s = self._since_s(t_utc_ns)
        return (
            self.sun_ra_deg + self.sun_ra_rate_deg_s * since_s,
            self.sun_dec_deg + self.sun_dec_rate_deg_s * since_s,
        )

    def _since_s(self, t_utc_ns: TimeLike) -> FloatArray:
        return np.asarray((np.asarray(t_utc_ns, np.int64) - self.t_utc_ns) / NS_PER_S)


def hourly_sky(t_utc_ns: int) -> HourlySky:
    """Return the ``HourlySky`` of the UTC hour that holds this instant; cached."""
    return _epoch(t_utc_ns // HOUR_NS)


@lru_cache(maxsize=64)
def _epoch(hour: int) -> HourlySky:
    middle_ns = hour * HOUR_NS + HOUR_NS // 2
    astrom, equation_of_origins = erfa.apci13(*jd_tt(middle_ns))
    before, middle, after = (
        icrs_to_jnow(*sun_icrs(t_ns), t_ns)
        for t_ns in (middle_ns - HOUR_NS, middle_ns, middle_ns + HOUR_NS)
    )
    return HourlySky(
        t_utc_ns=middle_ns,
        astrom=astrom,
        equation_of_origins_deg=float(np.degrees(equation_of_origins)),
        gast_deg=float(gast_deg(middle_ns)),
        sun_ra_deg=middle[0],
        sun_dec_deg=middle[1],
        sun_ra_rate_deg_s=wrap_180(after[0] - before[0]) / 7200.0,
        sun_dec_rate_deg_s=(after[1] - before[1]) / 7200.0,
    )
