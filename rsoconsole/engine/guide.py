"""Where the telescope goes by the orbit: instead of the filter's prediction, and without one."""

import math

import numpy as np

from rsoconsole.config import Config
from rsoconsole.orbit.prediction import predict
from rsoconsole.pipeline.aim import beside
from rsoconsole.pipeline.orbit_online import OnlineOrbit
from rsoconsole.sky.times import NS_PER_S

SHARE_OF_FIELD = 0.25
"""Three sigma of the place must be within so much of the field's smaller side."""


class Guide:
    """Asks the orbit of what is, or was last, followed."""

    def __init__(self, orbit: OnlineOrbit, config: Config) -> None:
        self._orbit = orbit
        self._config = config
        self._site = config.site.to_site()

    def configure(self, config: Config) -> None:
        """Take new tunables."""
        self._config = config

    def of_track(self, t_mid_utc_ns: int) -> tuple[float, float] | None:
        """Where what is followed will be, ICRS; None where the filter knows better."""
        return self._direction(t_mid_utc_ns) if self._orbit.is_guide else None

    def of_lost(self, t_mid_utc_ns: int) -> tuple[float, float] | None:
        """Where what the filter has lost is to be waited for; None where it is not."""
        config, seen = self._config.orbit, self._orbit.seen
        if config.guide == "never" or seen is None:
            return None
        since_s = (t_mid_utc_ns - int(seen.t_utc_ns[-1])) / NS_PER_S
        return self._direction(t_mid_utc_ns) if 0.0 <= since_s <= 60.0 * config.wait_min else None

    def of_last(self, t_utc_ns: int) -> tuple[float, float] | None:
        """Where what was followed last is by its orbit, however long ago that was."""
        return None if self._config.orbit.guide == "never" else self._direction(t_utc_ns)

    def _direction(self, t_mid_utc_ns: int) -> tuple[float, float] | None:
        orbit, aim = self._orbit.orbit, self._config.aim
        if orbit is None or orbit.label == "not observable":
            return None
        ahead = predict(orbit, self._site, np.array([t_mid_utc_ns + round(aim.lead_s * 1e9)]))
        sigma_deg = float(ahead.sigma_arcsec[0]) / 3600.0
        # Not a number where the orbit has come down.
        if not 3.0 * sigma_deg < SHARE_OF_FIELD * min(self._config.optics.field_deg):
            return None
        places = ahead.places
        ra_deg, dec_deg = float(places.ra_icrs_deg[0]), float(places.dec_icrs_deg[0])
        rate = (
            float(places.ra_rate_deg_s[0]) * math.cos(math.radians(dec_deg)) * 3600.0,
            float(places.dec_rate_deg_s[0]) * 3600.0,
        )
        return beside((ra_deg, dec_deg), rate, aim)
