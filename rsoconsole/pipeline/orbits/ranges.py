"""Distance and solar phase angle of an object at the times of its measurements. Pure.

Angles alone do not measure a distance: it comes from the orbit on record, or from an identified
object's elements. An orbit that does not determine the distance gives none.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rsoconsole.orbits import (
    CatalogueEntry,
    KnownOrbit,
    object_places,
    orbit_from_record,
    predict,
)
from rsoconsole.records import OrbitEstimate, Site
from rsoconsole.sky import SkyPlaces, phase_angle_deg

WITHOUT_RANGE = frozenset(("weak geometry", "not observable"))
"""Labels of orbits whose distance is not to be relied on."""


class RangeAndPhase(NamedTuple):
    """Distance from site to object when the light left, km, and the angle Sun-object-site, deg."""

    range_km: float
    phase_deg: float


def ranges_by_orbit(
    orbit: OrbitEstimate, site: Site, t_utc_ns: Sequence[int]
) -> tuple[RangeAndPhase | None, ...]:
    """Return distance and phase at these instants by a recorded orbit.

    None for each instant where the orbit's label says that its distance is not determined, or where
    the object would have decayed.
    """
    if orbit.label in WITHOUT_RANGE:
        return (None,) * len(t_utc_ns)
    return ranges_by_known_orbit(orbit_from_record(orbit), site, t_utc_ns)


def ranges_by_known_orbit(
    orbit: KnownOrbit, site: Site, t_utc_ns: Sequence[int]
) -> tuple[RangeAndPhase | None, ...]:
    """Return distance and phase at these instants by an orbit whose distance is determined.

    None for each instant where the object would have decayed.
    """
    if not t_utc_ns:
        return ()
    return _of_places(predict(orbit, site, np.array(t_utc_ns, np.int64)).places)


def ranges_by_elements(
    entry: CatalogueEntry, site: Site, t_utc_ns: Sequence[int]
) -> tuple[RangeAndPhase | None, ...]:
    """Return distance and phase at these instants by catalogue elements; None where SGP4 fails."""
    if not t_utc_ns:
        return ()
    return _of_places(object_places(entry, site, np.array(t_utc_ns, np.int64)))


def _of_places(places: SkyPlaces) -> tuple[RangeAndPhase | None, ...]:
    phases = phase_angle_deg(places.position_gcrs_km, places.site_gcrs_km, places.t_utc_ns)
    return tuple(
        RangeAndPhase(float(range_km), float(phase_deg)) if np.isfinite(range_km) else None
        for range_km, phase_deg in zip(places.range_km, phases, strict=True)
    )
