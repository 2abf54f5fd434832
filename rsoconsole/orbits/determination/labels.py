"""What an orbit may be called, and how sure it is. Pure."""

from typing import Literal

import numpy as np

from rsoconsole.orbits.determination.fit import Fit
from rsoconsole.orbits.determination.regimes import REGIMES, PriorName, Regime
from rsoconsole.orbits.first import Sightings, State
from rsoconsole.orbits.motion import axis_and_inclination, eccentricity_vector, semi_major_axis
from rsoconsole.records import FloatArray

Label = Literal["free", "constrained by prior", "weak geometry", "not observable"]

FREE_SIGMA_A_KM = 100.0
"""More than that and a free orbit is not called one."""
CONSTRAINED_SIGMA_A = 0.03
"""Of the semi-major axis: more than that and a prior has not constrained it."""
WIDEST_RANGE = 0.3
"""Relative sigma of the range from which on nothing is known of it."""
_SURPRISE = {2: 11.83, 3: 14.16}
"""Chi-square above which a prior of that dimension is contradicted: three sigma."""
_MUCH = 2.5
"""Scatter over claimed sigma from which on it is worth a word."""


def widened_covariance(found: Fit) -> FloatArray:
    """(6, 6), widened where directions scatter more than they claim to; never narrowed."""
    from scipy.special import chdtri

    dof = found.degrees_of_freedom
    if dof <= 0 or found.chi2 <= float(chdtri(dof, 0.01)):
        return found.covariance
    return found.covariance * (found.chi2 / dof)


def label_of(seen: Sightings, found: Fit, prior: PriorName, rivals: int) -> tuple[Label, str]:
    """What the orbit may be called, and why, in words."""
    doubt = _doubt(seen, found, prior, rivals)
    if doubt is not None:
        return doubt
    times = float(np.sqrt(found.chi2 / found.degrees_of_freedom))
    scatter = f"; directions scatter {times:.0f} times what they claim" if times > _MUCH else ""
    if prior == "none":
        sigma_a_km = sigma_of_a_km((found.r_km, found.v_km_s), widened_covariance(found))
        return "free", f"sigma of a is {sigma_a_km:.1f} km from the directions alone" + scatter
    return "constrained by prior", f"{REGIMES[prior].words} ({prior})" + scatter


def is_of_its_regime(found: Fit, regime: Regime) -> bool:
    """Whether the orbit is where its prior applies, and does not contradict it."""
    limit = _SURPRISE[regime.dimensions]
    return regime.holds((found.r_km, found.v_km_s)) and found.prior_chi2 < limit


def _doubt(seen: Sightings, found: Fit, prior: PriorName, rivals: int) -> tuple[Label, str] | None:
    covariance = widened_covariance(found)
    minutes = (seen.t_s[-1] - seen.t_s[0]) / 60.0
    state = (found.r_km, found.v_km_s)
    sigma_a_km = sigma_of_a_km(state, covariance)
    enough_km = FREE_SIGMA_A_KM
    if prior != "none":
        enough_km = CONSTRAINED_SIGMA_A * axis_and_inclination(*state)[0]
    doubt: tuple[Label, str] | None = None
    if not _relative_sigma_of_range(seen, found, covariance) < WIDEST_RANGE:
        doubt = "not observable", f"{len(seen)} directions over {minutes:.1f} min tell no range"
    elif rivals:
        doubt = "weak geometry", f"{rivals + 1} orbits fit alike: more directions will tell"
    elif found.degrees_of_freedom <= 0:
        doubt = "weak geometry", f"some orbit fits any {len(seen)} directions: nothing checks it"
    elif prior != "none" and not is_of_its_regime(found, REGIMES[prior]):
        doubt = "weak geometry", f"the directions speak against the prior ({prior})"
    elif sigma_a_km > enough_km:
        doubt = "weak geometry", f"sigma of a is {sigma_a_km:.0f} km: a longer arc is needed"
    return doubt


def _relative_sigma_of_range(seen: Sightings, found: Fit, covariance: FloatArray) -> float:
    line = found.r_km - seen.sites_km[int(np.argmin(np.abs(seen.t_s)))]
    distance = float(np.linalg.norm(line))
    line = line / distance
    return float(np.sqrt(max(line @ covariance[:3, :3] @ line, 0.0))) / distance


def sigma_of_a_km(state: State, covariance: FloatArray) -> float:
    """Formal sigma of the semi-major axis."""
    _, slope = semi_major_axis(*state)
    return float(np.sqrt(max(float(slope @ covariance @ slope), 0.0)))


def sigma_of_e(state: State, covariance: FloatArray) -> float:
    """Formal sigma of the eccentricity's vector, all its components together."""
    _, slopes = eccentricity_vector(*state)
    return float(np.sqrt(max(float(np.trace(slopes @ covariance @ slopes.T)), 0.0)))
