"""From directions to an orbit that says how much of it is known. Pure.

A short arc tells a direction and its rates, hardly the range: a free fit then follows the noise. What is
known of a regime (geostationary orbits are nearly circular) may be stated as a prior, and the answer
says so. Labels: ``free`` where the directions alone give the semi-major axis to 100 km; ``constrained
by prior`` where a stated prior gives it to 3 %; ``weak geometry`` where there is an orbit but not that
well, or nothing to check it with; ``not observable`` where the directions do not tell one range from another.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rsoconsole.orbit.fit import Fit, Motion, Prior, fit
from rsoconsole.orbit.forces import Forces
from rsoconsole.orbit.seeds import State, seeds
from rsoconsole.orbit.sightings import Sightings
from rsoconsole.orbit.two_body import MU_EARTH_KM3_S2, elements_of
from rsoconsole.records import FloatArray

Label = Literal["free", "constrained by prior", "weak geometry", "not observable"]
PriorName = Literal["auto", "none", "geo", "meo"]

FREE_SIGMA_A_KM = 100.0
"""More than that and a free orbit is not called one."""
CONSTRAINED_SIGMA_A = 0.03
"""Of the semi-major axis: more than that and a prior has not constrained it."""
PRIORS: dict[str, tuple[Prior, tuple[float, float]]] = {
    "geo": (Prior(sigma_e=2e-3), (40_164.0, 44_164.0)),
    "meo": (Prior(sigma_e=2e-2), (18_000.0, 34_000.0)),
}
"""By regime: what is believed, and between which semi-major axes (km) it is."""
LEAST_SIGHTINGS = 3
WIDEST_RANGE = 0.3
"""Relative sigma of the range from which on nothing is known of it."""
POINT_MASS_S = 900.0
"""Up to so long an arc the Earth is a point: 0.02 arcsec at a geostationary satellite."""
_RIVAL = 9.0
"""Two orbits whose sums of squares differ by less are told apart by nothing."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Orbit:
    """An orbit, and how well it is known."""

    label: Label
    prior: PriorName
    """The one in use: none for a free orbit."""
    reason: str
    """Why it is labelled so, in words."""
    epoch_utc_ns: int
    r_km: FloatArray
    """(3,) GCRS at the epoch"""
    v_km_s: FloatArray
    covariance: FloatArray
    """(6, 6) km and km/s"""
    sigma_a_km: float
    rms_arcsec: float
    """Of the used directions, per axis."""
    observations: int
    outliers: int
    fit: Fit
    rivals: int
    """Other orbits that fit as well."""
    forces: Forces


def determine(
    seen: Sightings, *, prior: PriorName = "auto", start: State | None = None
) -> Orbit | None:
    """The best orbit through ``seen``; None where there are too few directions for any.

    ``start``: a state at the epoch of an earlier orbit of the same object, from which refining is
    quick; without one (or where it leads nowhere) every seed is tried. ``auto`` takes no prior where
    none is needed, else that of the regime in which the orbit lies.
    """
    if len(seen) < LEAST_SIGHTINGS or seen.t_s[-1] <= seen.t_s[0]:
        return None
    forces = Forces(epoch_utc_ns=seen.epoch_utc_ns)
    motion = forces.positions if seen.t_s[-1] - seen.t_s[0] > POINT_MASS_S else None
    starts = (start,) if start is not None else seeds(seen)
    if not starts:
        return None
    free = _best(seen, starts, Prior(), motion) if prior in {"auto", "none"} else None
    if free is not None and (prior == "none" or _sigma_a_km(free[0]) <= FREE_SIGMA_A_KM):
        return _labelled(seen, free, "none", forces)
    for name in _candidates(prior):
        belief, (low, high) = PRIORS[name]
        constrained = _best(seen, starts, belief, motion)
        if constrained is None:
            continue
        a_km = elements_of(constrained[0].r_km, constrained[0].v_km_s).a_km
        if prior == name or low <= a_km <= high:
            return _labelled(seen, constrained, name, forces)
    return None if free is None else _labelled(seen, free, "none", forces)


def _candidates(prior: PriorName) -> tuple[Literal["geo", "meo"], ...]:
    if prior == "auto":
        return ("geo", "meo")
    return (prior,) if prior in {"geo", "meo"} else ()


def _best(
    seen: Sightings, starts: tuple[State, ...], prior: Prior, motion: Motion | None
) -> tuple[Fit, int] | None:
    """The cheapest fit from any start, and how many others are as good."""
    fits = [fit(seen, each, prior=prior) for each in starts]
    sound = [each for each in fits if each.is_converged and _is_bound(each)]
    if not sound:
        return None
    best = min(sound, key=lambda each: each.cost)
    distance = float(np.linalg.norm(best.r_km))
    rivals = sum(
        each.cost < best.cost + _RIVAL
        and float(np.linalg.norm(each.r_km - best.r_km)) > 0.05 * distance
        for each in sound
    )
    if motion is not None:
        # The point mass has found the place; only there is the real Earth worth its price.
        best = fit(seen, (best.r_km, best.v_km_s), prior=prior, motion=motion)
    return best, rivals


def _is_bound(found: Fit) -> bool:
    radius = float(np.linalg.norm(found.r_km))
    return float(found.v_km_s @ found.v_km_s) / 2.0 < MU_EARTH_KM3_S2 / radius


def _labelled(seen: Sightings, found: tuple[Fit, int], prior: PriorName, forces: Forces) -> Orbit:
    best, rivals = found
    covariance = best.covariance * _inflation(best)
    sigma_a = _sigma_a_km(best, covariance)
    label, reason = _label(seen, best, covariance, prior, sigma_a, rivals)
    used = best.residuals_arcsec[best.is_used]
    return Orbit(
        label=label,
        prior=prior,
        reason=reason,
        epoch_utc_ns=seen.epoch_utc_ns,
        r_km=best.r_km,
        v_km_s=best.v_km_s,
        covariance=covariance,
        sigma_a_km=sigma_a,
        rms_arcsec=float(np.sqrt(np.mean(used**2))) if used.size else float("nan"),
        observations=len(seen),
        outliers=len(seen) - int(np.sum(best.is_used)),
        fit=best,
        rivals=rivals,
        forces=forces,
    )


def _inflation(found: Fit) -> float:
    """Where directions scatter more than they claim to, their claims are widened; never narrowed."""
    from scipy.special import chdtri

    dof = found.degrees_of_freedom
    if dof <= 0 or found.chi2 <= float(chdtri(dof, 0.01)):
        return 1.0
    return found.chi2 / dof


def _label(
    seen: Sightings,
    found: Fit,
    covariance: FloatArray,
    prior: PriorName,
    sigma_a_km: float,
    rivals: int,
) -> tuple[Label, str]:
    site = seen.sites_km[int(np.argmin(np.abs(seen.t_s)))]
    line = found.r_km - site
    distance = float(np.linalg.norm(line))
    line = line / distance
    sigma_range = float(np.sqrt(max(line @ covariance[:3, :3] @ line, 0.0)))
    if not sigma_range < WIDEST_RANGE * distance:
        minutes = (seen.t_s[-1] - seen.t_s[0]) / 60.0
        return "not observable", f"{len(seen)} directions over {minutes:.1f} min tell no range"
    if rivals:
        return "weak geometry", f"{rivals + 1} orbits fit alike: more directions will tell"
    if found.degrees_of_freedom <= 0:
        return "weak geometry", f"{len(seen)} directions fit some orbit always: nothing checks it"
    a_km = elements_of(found.r_km, found.v_km_s).a_km
    if sigma_a_km > (FREE_SIGMA_A_KM if prior == "none" else CONSTRAINED_SIGMA_A * a_km):
        return "weak geometry", f"sigma of a is {sigma_a_km:.0f} km: a longer arc is needed"
    if prior == "none":
        return "free", f"sigma of a is {sigma_a_km:.1f} km from the directions alone"
    sigma_e = PRIORS[prior][0].sigma_e
    return "constrained by prior", f"eccentricity believed to be 0 with sigma {sigma_e:g} ({prior})"


def _sigma_a_km(found: Fit, covariance: FloatArray | None = None) -> float:
    """Formal sigma of the semi-major axis: 2 a^2 (r/r^3, v/mu) through the covariance."""
    covariance = found.covariance if covariance is None else covariance
    radius = float(np.linalg.norm(found.r_km))
    a = elements_of(found.r_km, found.v_km_s).a_km
    slope = 2.0 * a * a * np.concatenate([found.r_km / radius**3, found.v_km_s / MU_EARTH_KM3_S2])
    return float(np.sqrt(max(slope @ covariance @ slope, 0.0)))
