"""Places on the sky that an orbit predicts, with their covariance. Pure."""

from dataclasses import dataclass

import numpy as np

from rsoconsole.orbits.motion.forces import PerturbedPropagator, Propagator
from rsoconsole.orbits.motion.two_body import propagate, propagate_with_slopes
from rsoconsole.records import FloatArray, OrbitEstimate, Site
from rsoconsole.sky import (
    ARCSEC_RAD,
    IntArray,
    SkyPlaces,
    astrometric_places,
    east_and_north,
    unit_to_direction,
    wrap_180,
)
from rsoconsole.words import NS_PER_S


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KnownOrbit:
    """Orbit: a state at an epoch, its covariance and the forces that move the object."""

    epoch_utc_ns: int
    r_km: FloatArray
    """Position (3,), GCRS, at the epoch."""
    v_km_s: FloatArray
    covariance: FloatArray
    """Covariance (6, 6), km and km/s."""
    forces: Propagator

    def states(self, t_utc_ns: IntArray) -> tuple[FloatArray, FloatArray]:
        """GCRS positions and velocities (N, 3) at instants (N,): km, km/s."""
        t = np.atleast_1d(np.asarray(t_utc_ns, np.int64))
        return self.forces.states(self.r_km, self.v_km_s, (t - self.epoch_utc_ns) / NS_PER_S)


def orbit_from_record(estimate: OrbitEstimate) -> KnownOrbit:
    """Make an orbit from a recorded estimate."""
    return KnownOrbit(
        epoch_utc_ns=estimate.epoch_utc_ns,
        r_km=np.array(estimate.r_gcrs_km),
        v_km_s=np.array(estimate.v_gcrs_km_s),
        covariance=np.array(estimate.covariance),
        forces=PerturbedPropagator(epoch_utc_ns=estimate.epoch_utc_ns),
    )


_ENDS = 3.0**0.5
"""Sigmas at which two points give a normal error's second order (Julier & Uhlmann 2004)."""
_MOMENT_S = 5
"""Time within which the slopes of a place change in proportion to time."""
_TAIL = 0.5
"""Factor on the squared bend: a third is a squared error's variance, the rest for its tails."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prediction:
    """Predicted places at N instants, as a plate solution would measure them."""

    places: SkyPlaces
    cov_sky_arcsec2: FloatArray
    """Covariances (N, 3): east-east, east-north, north-north."""

    @property
    def sigma_arcsec(self) -> FloatArray:
        """Half the longer axis (N,) of the one-sigma ellipse."""
        ee, en, nn = self.cov_sky_arcsec2.T
        middle, half = (ee + nn) / 2.0, np.hypot((ee - nn) / 2.0, en)
        return np.asarray(np.sqrt(np.maximum(middle + half, 0.0)))


def predict(orbit: KnownOrbit, site: Site, t_utc_ns: IntArray) -> Prediction:
    """Predict astrometric places (ICRS) seen from a site at instants (N,), with their covariance.

    The covariance is propagated by two-body motion, to the second order along the line of its
    largest error. NaN where the object has decayed.
    """
    t = np.atleast_1d(np.asarray(t_utc_ns, np.int64))
    since_s = (t - orbit.epoch_utc_ns) / NS_PER_S
    r, v = orbit.forces.states(orbit.r_km, orbit.v_km_s, since_s)

    def position_of(at: IntArray) -> tuple[FloatArray, FloatArray]:
        # Light takes a moment: in it forces beside the Earth's centre do nothing.
        return propagate(r, v, (at - t) / NS_PER_S)

    places = astrometric_places(position_of, site, t)
    plain, on_sky = _carried(orbit, places)
    cov = on_sky @ orbit.covariance @ np.swapaxes(on_sky, -1, -2)
    bend = _bend_arcsec(orbit, places, since_s, (plain, on_sky, cov))
    cov = cov + _TAIL * bend[:, :, None] * bend[:, None, :]
    return Prediction(
        places=places, cov_sky_arcsec2=np.stack([cov[:, 0, 0], cov[:, 0, 1], cov[:, 1, 1]], axis=-1)
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkyMotion:
    """Predicted place and motion at one instant, as a plate solution would measure them."""

    ra_icrs_deg: float
    dec_icrs_deg: float
    rate_arcsec_s: tuple[float, float]
    """Rate east and north."""
    covariance: FloatArray
    """Covariance (4, 4) of east, its rate, north, its rate: arcsec and arcsec/s."""


def predict_motion(orbit: KnownOrbit, site: Site, t_utc_ns: int) -> SkyMotion | None:
    """Predict place, rates and their covariance, from which a filter can restart.

    None where nothing can be predicted.
    """
    instants = t_utc_ns + _MOMENT_S * NS_PER_S * np.array([-1, 0, 1])
    ahead = predict(orbit, site, instants)
    places = ahead.places
    _, on_sky = _carried(orbit, places)
    rates = (on_sky[2] - on_sky[0]) / (2 * _MOMENT_S)
    rows = np.stack([on_sky[1, 0], rates[0], on_sky[1, 1], rates[1]])
    covariance = rows @ orbit.covariance @ rows.T
    # Of the place also what a bent way adds.
    ee, en, nn = ahead.cov_sky_arcsec2[1]
    covariance[np.ix_([0, 2], [0, 2])] = [[ee, en], [en, nn]]
    if not np.all(np.isfinite(covariance)):
        return None
    dec_deg = float(places.dec_icrs_deg[1])
    east = float(places.ra_rate_deg_s[1]) * np.cos(np.radians(dec_deg)) * 3600.0
    return SkyMotion(
        ra_icrs_deg=float(places.ra_icrs_deg[1]),
        dec_icrs_deg=dec_deg,
        rate_arcsec_s=(float(east), float(places.dec_rate_deg_s[1]) * 3600.0),
        covariance=covariance,
    )


def _carried(orbit: KnownOrbit, places: SkyPlaces) -> tuple[FloatArray, FloatArray]:
    """Positions (N, 3) km by the two-body motion, and the slopes (N, 2, 6) of the places.

    East and north in arcsec, by the state at the epoch.
    """
    since_s = (places.t_utc_ns - orbit.epoch_utc_ns) / NS_PER_S
    plain, _, slopes = propagate_with_slopes(orbit.r_km, orbit.v_km_s, since_s)
    axes = np.stack(east_and_north(places.ra_icrs_deg, places.dec_icrs_deg), axis=-2)
    return plain, axes / places.range_km[:, None, None] / ARCSEC_RAD @ slopes


def _bend_arcsec(
    orbit: KnownOrbit,
    places: SkyPlaces,
    since_s: FloatArray,
    linear: tuple[FloatArray, FloatArray, FloatArray],
) -> FloatArray:
    """Distances (N, 2) of the ends of a long error from its chord, east and north.

    The path across the sky is bent, and its error after a day is long and thin.
    """
    plain, on_sky, cov = linear
    is_known = np.all(np.isfinite(cov), axis=(-2, -1))
    values, vectors = np.linalg.eigh(np.where(is_known[:, None, None], cov, np.eye(2)))
    sigma = np.sqrt(np.maximum(values[:, -1], 1e-12))
    step = np.einsum("ij,nkj,nk->ni", orbit.covariance, on_sky, vectors[:, :, -1])
    step = _ENDS * step / sigma[:, None]
    line = places.position_gcrs_km - places.site_gcrs_km
    total = np.zeros_like(sigma[:, None] * vectors[:, :, -1])
    for sign in (-1.0, 1.0):
        r, v = orbit.r_km + sign * step[:, :3], orbit.v_km_s + sign * step[:, 3:]
        ra_deg, dec_deg = unit_to_direction(line + propagate(r, v, since_s)[0] - plain)
        ra0, dec0 = unit_to_direction(line)
        east = wrap_180(ra_deg - ra0) * np.cos(np.radians(dec0))
        total = total + 1800.0 * np.stack([east, dec_deg - dec0], axis=-1)
    return np.where(np.isfinite(total), total, 0.0)
