"""Directions predicted by an orbit, used where the filter's are worse or missing."""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.config import AimConfig, Config
from rsoconsole.orbits import KnownOrbit, predict
from rsoconsole.pipeline import OnlineOrbit, may_orbit_guide, with_aim_offsets
from rsoconsole.records import FloatArray, Measurement, Site
from rsoconsole.sky import IntArray, separation_deg
from rsoconsole.words import NS_PER_S

_STEP_S = 10
_STEPS = 90
"""Number of steps of the predicted path, which is a quarter of an hour long."""
SHARE_OF_FIELD = 0.25
"""Greatest 3-sigma error of a predicted direction, in units of the field's smaller side."""
SAME_PLACE = 0.05
"""Share of the field's smaller side within which a measurement counts as the lost track's."""


class Guide:
    """Predicts directions by the orbit of the lead track, or of the last track."""

    def __init__(self, orbit: OnlineOrbit, config: Config) -> None:
        self._orbit = orbit
        self._config = config
        self._site = config.site.to_site()
        self._way: PredictedPath | None = None

    def configure(self, config: Config) -> None:
        """Use a new configuration from now on."""
        self._config = config

    def track_direction(
        self, t_mid_utc_ns: int, aim: AimConfig | None = None
    ) -> tuple[float, float] | None:
        """Return the lead track's direction by its orbit, ICRS degrees.

        None where the filter's prediction is to be used. ``aim``: offset from the prediction; None:
        the configured offset.
        """
        return self._direction(t_mid_utc_ns, aim) if self._orbit.is_lead_orbit_preferred else None

    def lost_track_direction(self, t_mid_utc_ns: int) -> tuple[float, float] | None:
        """Return the direction in which to wait for a lost track, ICRS degrees.

        None where no orbit predicts it well enough, or ``orbit.wait_min`` has passed.
        """
        seen = self._orbit.lead_directions
        if not may_orbit_guide(self._config) or seen is None:
            return None
        since_s = (t_mid_utc_ns - int(seen.t_utc_ns[-1])) / NS_PER_S
        is_time = 0.0 <= since_s <= 60.0 * self._config.orbit.wait_min
        return self._direction(t_mid_utc_ns) if is_time else None

    def may_be_lost_object(self, seen: Measurement) -> bool:
        """Return True where a measurement lies near the predicted direction of the lost track."""
        at = self.lost_track_direction(seen.t_mid_utc_ns)
        if at is None:
            return False
        near_deg = SAME_PLACE * min(self._config.optics.field_deg)
        return separation_deg(*at, seen.ra_icrs_deg, seen.dec_icrs_deg) < near_deg

    def last_track_direction(self, t_utc_ns: int) -> tuple[float, float] | None:
        """Return the last track's direction by its orbit, ICRS degrees, however old the track is.

        None where no orbit predicts the direction well enough.
        """
        return self._direction(t_utc_ns) if may_orbit_guide(self._config) else None

    def precompute_path(self, now_utc_ns: int) -> None:
        """Compute the predicted path of the next minutes now, while no frame has to wait."""
        orbit = self._orbit.lead_orbit
        if orbit is None or not may_orbit_guide(self._config):
            self._way = None
        elif (
            self._way is None
            or self._way.orbit is not orbit
            or not self._way.has_minutes_left(now_utc_ns)
        ):
            self._way = PredictedPath.of(orbit, self._site, now_utc_ns)

    def _direction(
        self, t_mid_utc_ns: int, aim: AimConfig | None = None
    ) -> tuple[float, float] | None:
        orbit, aim = self._orbit.lead_orbit, aim or self._config.aim
        if orbit is None or orbit.label == "not observable":
            return None
        t_utc_ns = t_mid_utc_ns + round(aim.lead_s * 1e9)
        way = self._way
        if way is None or way.orbit is not orbit or not way.contains(t_utc_ns):
            way = PredictedPath.of(orbit, self._site, t_utc_ns)
        direction, rate, sigma_deg = way.at(t_utc_ns)
        # Not a number where the orbit has come down.
        if not 3.0 * sigma_deg < SHARE_OF_FIELD * min(self._config.optics.field_deg):
            return None
        return with_aim_offsets(direction, rate, aim)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PredictedPath:
    """The directions predicted by an orbit over some minutes, interpolated between instants."""

    orbit: KnownOrbit
    t_utc_ns: IntArray
    """Instants of the path, UTC ns: (N,), every ``_STEP_S``."""
    ra_dec_deg: FloatArray
    """Directions, ICRS degrees: (N, 2); right ascension has no jump at 0h."""
    rates_deg_s: FloatArray
    """Rates in right ascension and declination, deg/s: (N, 2)."""
    sigma_deg: FloatArray
    """One sigma of the direction, deg: (N,)."""

    @classmethod
    def of(cls, orbit: KnownOrbit, site: Site, t_utc_ns: int) -> "PredictedPath":
        """Predict the path of the 15 minutes that begin at ``t_utc_ns``."""
        t = t_utc_ns + np.arange(_STEPS + 1) * _STEP_S * NS_PER_S
        ahead = predict(orbit, site, t)
        places = ahead.places
        ra_deg = np.degrees(np.unwrap(np.radians(places.ra_icrs_deg)))
        return cls(
            orbit=orbit,
            t_utc_ns=t,
            ra_dec_deg=np.stack([ra_deg, places.dec_icrs_deg], axis=-1),
            rates_deg_s=np.stack([places.ra_rate_deg_s, places.dec_rate_deg_s], axis=-1),
            sigma_deg=ahead.sigma_arcsec / 3600.0,
        )

    def contains(self, t_utc_ns: int) -> bool:
        """True where an instant is within the path."""
        return bool(self.t_utc_ns[0] <= t_utc_ns < self.t_utc_ns[-1])

    def has_minutes_left(self, t_utc_ns: int) -> bool:
        """Return True in the first half of the path, while minutes of it are left."""
        return bool(self.t_utc_ns[0] <= t_utc_ns < self.t_utc_ns[_STEPS // 2])

    def at(self, t_utc_ns: int) -> tuple[tuple[float, float], tuple[float, float], float]:
        """Return direction (RA, Dec; deg), motion (east, north; arcsec/s) and one sigma (deg).

        Interpolated with cubic polynomials.
        """
        n, rest_ns = divmod(int(t_utc_ns - self.t_utc_ns[0]), _STEP_S * NS_PER_S)
        s = rest_ns / (_STEP_S * NS_PER_S)
        before, after = self.ra_dec_deg[n], self.ra_dec_deg[n + 1]
        slope, next_slope = self.rates_deg_s[n] * _STEP_S, self.rates_deg_s[n + 1] * _STEP_S
        # Hermite's, by the values and slopes at both ends.
        bend = 3.0 * (after - before) - 2.0 * slope - next_slope
        twist = 2.0 * (before - after) + slope + next_slope
        ra_deg, dec_deg = before + s * (slope + s * (bend + s * twist))
        ra_rate, dec_rate = (slope + s * (2.0 * bend + 3.0 * s * twist)) / _STEP_S * 3600.0
        sigma_deg = (1.0 - s) * self.sigma_deg[n] + s * self.sigma_deg[n + 1]
        east = float(ra_rate) * math.cos(math.radians(float(dec_deg)))
        return (float(ra_deg) % 360.0, float(dec_deg)), (east, float(dec_rate)), float(sigma_deg)
