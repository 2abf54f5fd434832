"""The horizon of walls and trees, as the operator drew it."""

from collections.abc import Sequence

import numpy as np

from rsoconsole.records import FloatArray


def horizon_altitude_deg(
    mask: Sequence[tuple[float, float]], azimuth_deg: FloatArray
) -> FloatArray:
    """Altitude of the mask at azimuths: straight lines between its points, round through north.

    mask: (azimuth, altitude) in degrees, at least one point.
    """
    azimuths_deg, altitudes_deg = zip(*mask, strict=True)
    return np.asarray(np.interp(azimuth_deg, azimuths_deg, altitudes_deg, period=360.0))
