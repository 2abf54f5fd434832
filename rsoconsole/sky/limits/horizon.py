"""The horizon of walls and trees, as the operator drew it."""

from collections.abc import Sequence

import numpy as np

from rsoconsole.config import LimitsConfig
from rsoconsole.records import FloatArray


def horizon_altitude_deg(
    mask: Sequence[tuple[float, float]], azimuth_deg: FloatArray
) -> FloatArray:
    """Altitude of the mask at azimuths: straight lines between its points, round through north.

    mask: (azimuth, altitude) in degrees, at least one point.
    """
    azimuths_deg, altitudes_deg = zip(*mask, strict=True)
    return np.asarray(np.interp(azimuth_deg, azimuths_deg, altitudes_deg, period=360.0))


def level_deg(limits: LimitsConfig) -> float:
    """The horizon without walls: altitude 0, or lower where the telescope may look lower."""
    return min(0.0, limits.min_altitude_deg)


def lowest_altitude_deg(limits: LimitsConfig, azimuth_deg: FloatArray) -> FloatArray:
    """What nobody may look below: the mask, or the level horizon where none was drawn."""
    if limits.horizon:
        return horizon_altitude_deg(limits.horizon, azimuth_deg)
    return np.full(azimuth_deg.shape, level_deg(limits))
