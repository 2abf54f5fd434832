"""Which of many satellites may cross one exposure, before their places are computed exactly."""

from collections.abc import Sequence

import numpy as np
from sgp4.api import SatrecArray

from rsoconsole.orbits.elements import Satellite
from rsoconsole.records import Site
from rsoconsole.sky import direction_to_unit, jd_utc, site_gcrs, teme_to_gcrs_rotation

_MARGIN_DEG = 0.05
"""For light time, aberration and the wander of the air."""
_MARGIN_S = 2.0
"""For the shutter, and for rates that grow along the exposure."""
_RATE_GROWTH = 2.0


class Nearby:
    """The satellites of a night, asked together: a whole catalogue costs a few milliseconds."""

    def __init__(self, satellites: Sequence[Satellite]) -> None:
        self._records = SatrecArray([each.record for each in satellites]) if satellites else None

    def indices(
        self,
        site: Site,
        t_mid_utc_ns: int,
        exposure_s: float,
        centre_icrs_deg: tuple[float, float],
        radius_deg: float,
    ) -> list[int]:
        """Those that come within ``radius_deg`` of the direction during the exposure, or nearly.

        Never too few: how fast each one moves widens the circle. Where SGP4 fails there is none.
        """
        if self._records is None:
            return []
        t = np.array([t_mid_utc_ns], dtype=np.int64)
        jd_1, jd_2 = jd_utc(t)
        failed, r_teme, v_teme = self._records.sgp4(
            np.ascontiguousarray(jd_1), np.ascontiguousarray(jd_2)
        )
        rotation = teme_to_gcrs_rotation(t)[0]
        site_km, site_km_s = site_gcrs(site, t)
        line = r_teme[:, 0] @ rotation.T - site_km[0]
        motion = v_teme[:, 0] @ rotation.T - site_km_s[0]
        with np.errstate(invalid="ignore", divide="ignore"):
            range_km = np.linalg.norm(line, axis=-1)
            cosine = line @ direction_to_unit(*centre_icrs_deg) / range_km
            apart_deg = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
            rate_deg_s = np.degrees(np.linalg.norm(motion, axis=-1) / range_km)
            reach_deg = _RATE_GROWTH * rate_deg_s * (exposure_s / 2.0 + _MARGIN_S)
            is_near = apart_deg <= radius_deg + reach_deg + _MARGIN_DEG
        return [int(i) for i in np.flatnonzero(is_near & (failed[:, 0] == 0))]
