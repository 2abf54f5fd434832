"""Directions of one object, reduced to what an orbit is fitted to. Pure.

A plate solution measures astrometric places: relative to stars whose annual aberration is taken
out. The satellite rides with the Earth, so u = r(t - tau) - r_site(t) - v_earth tau points where
the plate says; everything in it but the orbit is computed once, here. Kilometres along ICRS axes.
"""

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import (
    ARCSEC_RAD,
    LIGHT_KM_S,
    NS_PER_S,
    IntArray,
    direction_to_unit,
    earth_velocity_km_s,
    east_and_north,
    line_of_sight_gcrs,
    site_gcrs,
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sightings:
    """N directions in order of time, each with its site's place; every array starts with N."""

    t_utc_ns: IntArray
    t_s: FloatArray
    """Seconds since the epoch."""
    epoch_utc_ns: int
    """Of the orbit: the instant of the sighting nearest to the middle of them."""
    ra_icrs_deg: FloatArray
    dec_icrs_deg: FloatArray
    whitening: FloatArray
    """(N, 2, 2): turns a residual (d alpha cos delta, d delta) in arcsec into unit variances."""
    sites_km: FloatArray
    """(N, 3) GCRS"""
    sites_km_s: FloatArray
    earth_km_s: FloatArray
    """(N, 3) velocity of the Earth's centre about the barycentre."""
    lines: FloatArray
    """(N, 3) unit vectors from site to object, freed of the Earth's motion."""
    east: FloatArray
    """(N, 3) on the sky, at the measured direction."""
    north: FloatArray
    towards: FloatArray
    """(N, 3) the measured direction itself."""

    def __len__(self) -> int:
        return len(self.t_s)

    def residuals_arcsec(self, positions_km: FloatArray) -> FloatArray:
        """Measured minus predicted (..., N, 2) on the sky, for places (..., N, 3) at t - tau.

        On the tangent plane of the measured direction; far off it is far off.
        """
        u = positions_km - self.sites_km
        tau_s = np.sqrt(np.sum(u * u, axis=-1, keepdims=True)) / LIGHT_KM_S
        u = u - self.earth_km_s * tau_s
        ahead = np.sum(u * self.towards, axis=-1)
        size = np.sqrt(np.sum(u * u, axis=-1))
        depth = np.maximum(ahead, 0.05 * size)
        off = np.stack([np.sum(u * self.east, axis=-1), np.sum(u * self.north, axis=-1)], axis=-1)
        return np.asarray(-off / depth[..., None] / ARCSEC_RAD)

    def residual_slopes(self, positions_km: FloatArray) -> FloatArray:
        """(N, 2, 3) arcsec/km: residuals by the places (N, 3), but for the Earth's motion."""
        u = positions_km - self.sites_km
        ahead = np.sum(u * self.towards, axis=-1)
        depth = np.maximum(ahead, 0.05 * np.sqrt(np.sum(u * u, axis=-1)))[:, None]
        slopes = []
        for axis in (self.east, self.north):
            off = np.sum(u * axis, axis=-1)[:, None]
            slopes.append((off / depth * self.towards - axis) / depth)
        return np.stack(slopes, axis=-2) / ARCSEC_RAD

    def of(self, chosen: npt.NDArray[Any]) -> "Sightings":
        """Some of them, about the same epoch."""
        arrays = {
            each.name: getattr(self, each.name)[chosen]
            for each in fields(self)
            if each.name != "epoch_utc_ns"
        }
        return replace(self, **arrays)

    def whitened(self, residuals_arcsec: FloatArray) -> FloatArray:
        """Residuals (..., N, 2) in units of their own sigma, without correlation."""
        return np.asarray(np.einsum("nij,...nj->...ni", self.whitening, residuals_arcsec))

    def light_times_s(self, positions_km: FloatArray) -> FloatArray:
        """(..., N) from places (..., N, 3) to the site."""
        return np.asarray(np.linalg.norm(positions_km - self.sites_km, axis=-1) / LIGHT_KM_S)


def sightings(
    site: Site,
    t_utc_ns: IntArray,
    ra_icrs_deg: FloatArray,
    dec_icrs_deg: FloatArray,
    cov_sky_arcsec2: FloatArray,
) -> Sightings:
    """Reduce N measured directions; ``cov_sky_arcsec2`` (N, 3): east-east, east-north, north-north.

    Put into order of time. Raises ValueError for a covariance that is none and for a direction
    that is no number.
    """
    if not (np.all(np.isfinite(ra_icrs_deg)) and np.all(np.isfinite(dec_icrs_deg))):
        raise ValueError("a direction is not a number")
    order = np.argsort(t_utc_ns, kind="stable")
    t = np.asarray(t_utc_ns, np.int64)[order]
    ra, dec = np.asarray(ra_icrs_deg, float)[order], np.asarray(dec_icrs_deg, float)[order]
    cov = np.asarray(cov_sky_arcsec2, float)[order]
    epoch = int(t[np.argmin(np.abs(t - t[0] - (t[-1] - t[0]) // 2))]) if len(t) else 0
    sites_km, sites_km_s = site_gcrs(site, t)
    towards = direction_to_unit(ra, dec)
    east, north = east_and_north(ra, dec)
    return Sightings(
        t_utc_ns=t,
        t_s=(t - epoch) / NS_PER_S,
        epoch_utc_ns=epoch,
        ra_icrs_deg=ra,
        dec_icrs_deg=dec,
        whitening=_whitening(cov),
        sites_km=sites_km,
        sites_km_s=sites_km_s,
        earth_km_s=earth_velocity_km_s(t),
        lines=line_of_sight_gcrs(ra, dec, t),
        east=east,
        north=north,
        towards=towards,
    )


def _whitening(cov: FloatArray) -> FloatArray:
    """(N, 2, 2) inverse Cholesky factors of the covariances (N, 3)."""
    ee, en, nn = cov.T
    if not (np.all(ee > 0.0) and np.all(ee * nn - en * en > 0.0)):
        raise ValueError("a covariance on the sky must be positive definite")
    matrices = np.stack([np.stack([ee, en], -1), np.stack([en, nn], -1)], -2)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(matrices)))
