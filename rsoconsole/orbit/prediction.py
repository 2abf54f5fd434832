"""Where an orbit puts the object, and how sure that is. Pure."""

from dataclasses import dataclass

import numpy as np

from rsoconsole.orbit.determine import Orbit
from rsoconsole.orbit.two_body import propagate, propagate_with_slopes
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky.places import Places, astrometric_places
from rsoconsole.sky.times import ARCSEC_RAD, NS_PER_S, IntArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prediction:
    """Places at N instants, as a plate solution would measure them."""

    places: Places
    cov_sky_arcsec2: FloatArray
    """(N, 3): east-east, east-north, north-north."""

    @property
    def sigma_arcsec(self) -> FloatArray:
        """(N,) half the longer axis of the one-sigma ellipse."""
        ee, en, nn = self.cov_sky_arcsec2.T
        middle, half = (ee + nn) / 2.0, np.hypot((ee - nn) / 2.0, en)
        return np.asarray(np.sqrt(np.maximum(middle + half, 0.0)))


def predict(orbit: Orbit, site: Site, t_utc_ns: IntArray) -> Prediction:
    """Astrometric places (ICRS) seen from a site at instants (N,), with their covariance.

    The orbit's covariance is carried by the two-body motion: its slopes are all that is asked of
    it. NaN where the object has come down.
    """
    t = np.atleast_1d(np.asarray(t_utc_ns, np.int64))
    since_s = (t - orbit.epoch_utc_ns) / NS_PER_S
    r, v = orbit.forces.states(orbit.r_km, orbit.v_km_s, since_s)

    def position_of(at: IntArray) -> tuple[FloatArray, FloatArray]:
        # Light takes a moment: in it forces beside the Earth's centre do nothing.
        return propagate(r, v, (at - t) / NS_PER_S)

    places = astrometric_places(position_of, site, t)
    _, _, slopes = propagate_with_slopes(orbit.r_km, orbit.v_km_s, since_s)
    ra, dec = np.radians(places.ra_icrs_deg), np.radians(places.dec_icrs_deg)
    zero = np.zeros_like(ra)
    east = np.stack([-np.sin(ra), np.cos(ra), zero], axis=-1)
    north = np.stack([-np.sin(dec) * np.cos(ra), -np.sin(dec) * np.sin(ra), np.cos(dec)], axis=-1)
    across = np.stack([east, north], axis=-2) / places.range_km[:, None, None] / ARCSEC_RAD
    on_sky = across @ slopes
    cov = on_sky @ orbit.covariance @ np.swapaxes(on_sky, -1, -2)
    return Prediction(
        places=places,
        cov_sky_arcsec2=np.stack([cov[:, 0, 0], cov[:, 0, 1], cov[:, 1, 1]], axis=-1),
    )
