"""Residuals of directions against many element sets, all at once. Pure.

Offsets are taken along and across each object's own predicted apparent motion. Along the track
they are counted in time, across it in kilometres, and only then fitted by an offset and a rate: an
object that is late is late by the same time at both ends of a pass, though its motion changes
tenfold in between.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from rsoconsole.orbits.elements.catalogue import CatalogueEntry, states_gcrs
from rsoconsole.orbits.first.directions import MeasuredDirections
from rsoconsole.orbits.identification.element_errors import ASSUMED, ElementErrors
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import ARCSEC_RAD, LIGHT_KM_S, IntArray, earth_velocity_km_s, site_gcrs
from rsoconsole.words import NS_PER_S

_BESIDE_S = 1.0
"""Offset from the middle at which slopes are computed, seconds."""
_SLOWEST_RAD_S = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CatalogueResiduals:
    """Offsets of directions from the places of M objects, at the middle of the directions.

    D is 4 (along, across, and their rates; arcsec, arcsec/s), or 2 where all directions are of one
    instant.
    """

    entries: tuple[CatalogueEntry, ...]
    offsets: FloatArray
    """Offsets (M, D), measured minus predicted."""
    covariance: FloatArray
    """Measurement covariance (M, D, D), widened where even the best object leaves more scatter."""
    by_errors: FloatArray
    """Slopes (M, D, 6) by the errors of the elements, as ``element_errors`` counts them."""
    rate_arcsec_s: FloatArray
    """Predicted apparent speeds (M,)."""
    range_km: FloatArray
    mean_motion_rad_s: FloatArray
    errors: ElementErrors = ASSUMED
    """Errors of elements with which the offsets are weighed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _ExpectedPlaces:
    """Expected places of M objects at N instants; unit vectors and rates (M, N, ...)."""

    towards: FloatArray
    along: FloatArray
    across: FloatArray
    rate_rad_s: FloatArray
    range_km: FloatArray
    r_km: FloatArray
    v_km_s: FloatArray


def compute_catalogue_residuals(
    seen: MeasuredDirections,
    site: Site,
    entries: Sequence[CatalogueEntry],
    errors: ElementErrors = ASSUMED,
) -> CatalogueResiduals:
    """Compute the offsets of directions from all entries for which SGP4 succeeds."""
    beside_ns = round(_BESIDE_S * NS_PER_S)
    about = seen.epoch_utc_ns + np.array([-beside_ns, 0, beside_ns])
    expected = _expected(entries, site, np.concatenate([seen.t_utc_ns, about]))
    is_good = np.all(np.isfinite(expected.towards), axis=(1, 2))
    expected = _some(expected, is_good)
    followed = tuple(each for each, good in zip(entries, is_good, strict=True) if good)
    offsets, covariance, misfit = _offsets(seen, expected)
    widening = max(1.0, float(np.min(misfit))) if misfit.size else 1.0
    middle = len(seen) + 1
    return CatalogueResiduals(
        entries=followed,
        offsets=offsets,
        covariance=covariance * widening,
        by_errors=_by_errors(expected, len(seen))[:, : offsets.shape[1]],
        rate_arcsec_s=expected.rate_rad_s[:, middle] / ARCSEC_RAD,
        range_km=expected.range_km[:, middle],
        mean_motion_rad_s=np.array([each.record.no_kozai / 60.0 for each in followed]),
        errors=errors,
    )


def _expected(entries: Sequence[CatalogueEntry], site: Site, t_utc_ns: IntArray) -> _ExpectedPlaces:
    """Expected places as in ``sky.places.astrometric_places``.

    During the light time the motion is straight to a mm.
    """
    r, v = states_gcrs(entries, t_utc_ns)
    site_km, site_km_s = site_gcrs(site, t_utc_ns)
    v_earth = earth_velocity_km_s(t_utc_ns)
    tau_s = np.linalg.norm(r - site_km, axis=-1, keepdims=True) / LIGHT_KM_S
    for _ in range(2):
        u = r - v * tau_s - site_km - v_earth * tau_s
        tau_s = np.linalg.norm(u, axis=-1, keepdims=True) / LIGHT_KM_S
    range_km = tau_s * LIGHT_KM_S
    towards = u / range_km
    tau_rate = np.sum(towards * (v - site_km_s), axis=-1, keepdims=True) / LIGHT_KM_S
    u_rate = v * (1.0 - tau_rate) - site_km_s - v_earth * tau_rate
    turn = (u_rate - np.sum(u_rate * towards, axis=-1, keepdims=True) * towards) / range_km
    rate = np.maximum(np.linalg.norm(turn, axis=-1, keepdims=True), _SLOWEST_RAD_S)
    along = turn / rate
    return _ExpectedPlaces(
        towards=towards,
        along=along,
        across=np.cross(towards, along),
        rate_rad_s=rate[..., 0],
        range_km=range_km[..., 0],
        r_km=r,
        v_km_s=v,
    )


def _some(expected: _ExpectedPlaces, chosen: npt.NDArray[np.bool_]) -> _ExpectedPlaces:
    return _ExpectedPlaces(
        **{each.name: getattr(expected, each.name)[chosen] for each in fields(_ExpectedPlaces)}
    )


def _offsets(
    seen: MeasuredDirections, expected: _ExpectedPlaces
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Offsets (M, D) at the middle with covariance (M, D, D), and chi2 a degree of freedom (M,)."""
    count, middle = len(seen), len(seen) + 1
    axes = np.stack([expected.along, expected.across], axis=-2)[:, :count]
    off = np.einsum("mnki,mni->mnk", axes, _arc(expected.towards[:, :count], seen.towards))
    scale = np.stack(
        [
            expected.rate_rad_s[:, :count] / expected.rate_rad_s[:, middle, None],
            expected.range_km[:, middle, None] / expected.range_km[:, :count],
        ],
        axis=-1,
    )
    sky = np.stack([seen.east, seen.north], axis=-2)
    turned = np.einsum("nij,njc,mnkc->mnik", seen.whitening, sky, axes)
    rows = turned * scale[:, :, None, :]
    if seen.t_s[-1] > seen.t_s[0]:
        rows = np.concatenate([rows, rows * seen.t_s[:, None, None]], axis=-1)
    values = np.einsum("mnik,mnk->mni", turned, off / ARCSEC_RAD)
    normal = np.einsum("mnip,mniq->mpq", rows, rows)
    covariance = np.linalg.inv(normal)
    solved = np.einsum("mpq,mniq,mni->mp", covariance, rows, values)
    left = values - np.einsum("mnip,mp->mni", rows, solved)
    freedom = 2 * count - rows.shape[-1]
    misfit = np.sum(left**2, axis=(1, 2)) / freedom if freedom > 0 else np.ones(len(solved))
    return solved, covariance, misfit


def _arc(start: FloatArray, end: FloatArray) -> FloatArray:
    """Vector in the tangent plane from one direction to another, as long as the angle, rad."""
    cosine = np.sum(start * end, axis=-1, keepdims=True)
    aside = end - cosine * start
    sine = np.linalg.norm(aside, axis=-1, keepdims=True)
    return np.asarray(aside / np.maximum(sine, 1e-300) * np.arctan2(sine, cosine))


def _by_errors(expected: _ExpectedPlaces, count: int) -> FloatArray:
    """Slopes (M, 4, 6) of the offsets by errors of the state.

    Errors: radial, along, across, and their rates.
    """
    before, at, after = (
        _moved_by(expected, count + n, since_s)
        for n, since_s in enumerate((-_BESIDE_S, 0.0, _BESIDE_S))
    )
    middle = count + 1
    for place, slopes in ((count, before), (count + 2, after)):
        slopes[:, 0] *= (expected.rate_rad_s[:, middle] / expected.rate_rad_s[:, place])[:, None]
        slopes[:, 1] *= (expected.range_km[:, place] / expected.range_km[:, middle])[:, None]
    return np.concatenate([at, (after - before) / (2.0 * _BESIDE_S)], axis=1)


def _moved_by(expected: _ExpectedPlaces, place: int, since_s: float) -> FloatArray:
    """Changes (M, 2, 6) along and across in arcsec at one instant, ``since_s`` after the middle."""
    r, v = expected.r_km[:, place], expected.v_km_s[:, place]
    radial = r / np.linalg.norm(r, axis=-1, keepdims=True)
    pole = np.cross(r, v)
    pole = pole / np.linalg.norm(pole, axis=-1, keepdims=True)
    frame = np.stack([radial, np.cross(pole, radial), pole], axis=-1)
    axes = np.stack([expected.along[:, place], expected.across[:, place]], axis=-2)
    by_place = axes @ frame / expected.range_km[:, place, None, None] / ARCSEC_RAD
    return np.concatenate([by_place, by_place * since_s], axis=-1)
