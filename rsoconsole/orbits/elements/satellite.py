"""A catalogued satellite: where an element set puts it, and how bright it is there."""

import numpy as np
from sgp4.api import Satrec

from rsoconsole.errors import OrbitError
from rsoconsole.orbits.elements.catalogue import CatalogueEntry
from rsoconsole.orbits.elements.elements import ElementSet
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import (
    IntArray,
    Places,
    astrometric_places,
    jd_utc,
    lit_fraction,
    phase_angle_deg,
    teme_to_gcrs_rotation,
)

STANDARD_RANGE_KM = 36_000.0


class Satellite:
    """SGP4 for one element set, with places as a plate solution measures them.

    Raises OrbitError where SGP4 refuses the elements. Instants at which SGP4 fails (decayed)
    come out as NaN.
    """

    def __init__(
        self, element_set: ElementSet | CatalogueEntry, standard_magnitude: float = 11.0
    ) -> None:
        """``standard_magnitude``: fully lit, at 36,000 km."""
        self.element_set = element_set
        self.standard_magnitude = standard_magnitude
        self.record = _record_of(element_set)
        if self.record.error:
            raise OrbitError(
                f"satellite {element_set.norad_id}: SGP4 refuses its elements "
                f"(error {self.record.error}); fetch a newer set"
            )

    def position_gcrs(self, t_utc_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        """GCRS position (N, 3) km and velocity (N, 3) km/s."""
        t = np.atleast_1d(np.asarray(t_utc_ns, np.int64))
        jd_1, jd_2 = jd_utc(t)
        failed, r_teme, v_teme = self.record.sgp4_array(
            np.ascontiguousarray(jd_1), np.ascontiguousarray(jd_2)
        )
        rotation = teme_to_gcrs_rotation(t)
        r = np.einsum("nij,nj->ni", rotation, r_teme)
        v = np.einsum("nij,nj->ni", rotation, v_teme)
        is_good = (failed == 0)[:, None]
        return np.where(is_good, r, np.nan), np.where(is_good, v, np.nan)

    def astrometric_place(self, site: Site, t_utc_ns: IntArray) -> Places:
        """Places, ranges and rates at instants (N,): what measured directions are compared to."""
        return astrometric_places(self.position_gcrs, site, t_utc_ns)

    def magnitude(self, places: Places) -> FloatArray:
        """Brightness (N,) of a diffuse sphere at the places; inf in the umbra."""
        lit = lit_fraction(places.position_gcrs_km, places.t_utc_ns)
        phase = phase_angle_deg(places.position_gcrs_km, places.site_gcrs_km, places.t_utc_ns)
        return magnitude(self.standard_magnitude, places.range_km, phase, lit)


def _record_of(element_set: ElementSet | CatalogueEntry) -> Satrec:
    if isinstance(element_set, CatalogueEntry):
        return element_set.record
    try:
        return Satrec.twoline2rv(element_set.line_1, element_set.line_2)
    except ValueError as error:
        raise OrbitError(f"satellite {element_set.norad_id}: {error}; fetch it again") from error


def magnitude(
    standard_magnitude: float,
    range_km: FloatArray,
    phase_angle_deg: FloatArray,
    lit_fraction: FloatArray,
) -> FloatArray:
    """Magnitude of a diffuse (Lambert) sphere, ``standard_magnitude`` full at 36,000 km."""
    phase = np.radians(phase_angle_deg)
    shine = ((np.pi - phase) * np.cos(phase) + np.sin(phase)) / np.pi * lit_fraction
    with np.errstate(divide="ignore"):
        dimming = -2.5 * np.log10(np.maximum(shine, 0.0))
    return np.asarray(standard_magnitude + 5.0 * np.log10(range_km / STANDARD_RANGE_KM) + dimming)
