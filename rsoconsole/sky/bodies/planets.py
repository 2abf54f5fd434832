"""Where the planets stand, near enough to point a telescope."""

from types import MappingProxyType

import erfa
import numpy as np

from rsoconsole.sky import AU_KM, NS_PER_S, jd_tt, sun_gcrs_km, unit_to_direction

LIGHT_KM_S = 299_792.458
PLANETS = MappingProxyType(
    {"Mercury": 1, "Venus": 2, "Mars": 4, "Jupiter": 5, "Saturn": 6, "Uranus": 7, "Neptune": 8}
)
"""Name -> number in the theory; the third is the Earth."""


def planet_icrs(name: str, t_utc_ns: int) -> tuple[float, float]:
    """Astrometric RA and Dec in degrees from the Earth's centre, to some 2 arcmin.

    ``name``: a key of ``PLANETS``; KeyError for another. The parallax of a site is below an
    arcminute. Source: Simon et al. 1994, A&A 282, 663, by IAU SOFA (erfa.plan94).
    """
    number = PLANETS[name]
    sun_km = sun_gcrs_km(t_utc_ns)
    light_s = 0.0
    for _ in range(2):
        t = t_utc_ns - round(light_s * NS_PER_S)
        to_planet_km = sun_km + np.asarray(erfa.plan94(*jd_tt(t), number)["p"]) * AU_KM
        light_s = float(np.linalg.norm(to_planet_km)) / LIGHT_KM_S
    ra_deg, dec_deg = unit_to_direction(to_planet_km)
    return float(ra_deg), float(dec_deg)
