"""Standard magnitude of an object by the magnitudes of one of its tracks. Pure.

Distance and phase come from the object's elements, or from the track's own orbit. Magnitudes are
those of the sky above the air, as the stars of the same frame give them.
"""

import math
from collections.abc import Sequence

import numpy as np

from rsoconsole.orbits import (
    CatalogueEntry,
    KnownOrbit,
    StandardMagnitude,
    reduced_magnitude,
    standard_magnitude,
)
from rsoconsole.pipeline.orbits.ranges import (
    RangeAndPhase,
    ranges_by_elements,
    ranges_by_known_orbit,
)
from rsoconsole.pipeline.orbits.track_measurements import TrackLight
from rsoconsole.records import Site
from rsoconsole.sky import site_gcrs

MIN_LIGHTS = 2
"""Fewest magnitudes of a track that give a standard magnitude."""
_MAG_PER_SHARE = 5.0 / math.log(10.0)
"""Change of a magnitude by a relative change of the distance."""


def standard_magnitude_by_elements(
    lights: Sequence[TrackLight], entry: CatalogueEntry, site: Site
) -> StandardMagnitude | None:
    """Return the standard magnitude of a catalogued object; None where too few magnitudes are."""
    return _standard(lights, ranges_by_elements(entry, site, [each.t_utc_ns for each in lights]))


def standard_magnitude_by_orbit(
    lights: Sequence[TrackLight], orbit: KnownOrbit, site: Site
) -> StandardMagnitude | None:
    """Return the standard magnitude by an orbit, whose error of the distance is in its sigma.

    None where too few magnitudes are.
    """
    ranges = ranges_by_known_orbit(orbit, site, [each.t_utc_ns for each in lights])
    return _standard(lights, ranges, _MAG_PER_SHARE * _relative_range_sigma(orbit, site))


def _relative_range_sigma(orbit: KnownOrbit, site: Site) -> float:
    """One sigma of the distance at the orbit's epoch, as a share of it."""
    line_km = orbit.r_km - site_gcrs(site, np.array([orbit.epoch_utc_ns]))[0][0]
    range_km = float(np.linalg.norm(line_km))
    along = line_km / range_km
    variance = float(along @ np.asarray(orbit.covariance)[:3, :3] @ along)
    return math.sqrt(max(variance, 0.0)) / range_km


def _standard(
    lights: Sequence[TrackLight],
    ranges: Sequence[RangeAndPhase | None],
    sigma_range_mag: float = 0.0,
) -> StandardMagnitude | None:
    found = [
        (reduced, math.hypot(light.sigma_mag, sigma_range_mag))
        for light, at in zip(lights, ranges, strict=True)
        if at is not None
        and (reduced := reduced_magnitude(light.mag, at.range_km, at.phase_deg)) is not None
    ]
    if len(found) < MIN_LIGHTS:
        return None
    mags, sigmas = zip(*found, strict=True)
    return standard_magnitude(mags, sigmas)
