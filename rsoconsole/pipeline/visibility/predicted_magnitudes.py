"""How bright an object is now, or will be at the best moment of its pass or crossing. Pure.

As a diffuse sphere at that distance and phase angle, above the air. Panels and glints make a real
satellite brighter or fainter than that: its own scatter is in the sigma, a glint is not.
"""

from collections.abc import Mapping

from rsoconsole.orbits import StandardMagnitude, apparent_magnitude
from rsoconsole.pipeline.visibility.crossings import FieldCrossing
from rsoconsole.pipeline.visibility.passes import NightPass, VisibleSatellite


def predicted_magnitude(
    one: NightPass | FieldCrossing | VisibleSatellite, standard: Mapping[int, StandardMagnitude]
) -> tuple[float, float] | None:
    """Return the apparent magnitude and its sigma at the top of a pass, or nearest to the centre.

    ``standard``: standard magnitudes by NORAD id. None where the object has none there, and where
    it is in the Earth's shadow.
    """
    known = standard.get(one.norad_id)
    if known is None or not one.is_lit:
        return None
    mag = apparent_magnitude(known.mag, one.range_km, one.phase_deg)
    return None if mag is None else (mag, known.sigma_mag)
