"""Orbit determination from directions, with a statement of how well the orbit is known. Pure.

A short arc determines a direction and its rates, hardly the range: a free fit then follows the
noise. Knowledge of a regime (geostationary orbits are nearly circular) may be stated as a prior,
and the answer names the prior. Its label is one of these:

- ``free``: the directions alone give the semi-major axis to 100 km, and no prior would halve that;
- ``constrained by prior``: a stated prior gives the semi-major axis to 3 %;
- ``weak geometry``: there is an orbit, but a less certain one, or nothing to check it with;
- ``not observable``: the directions do not distinguish one range from another.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.orbits.determination.fit import OrbitFit, Prior, fit_orbit, formal_covariances
from rsoconsole.orbits.determination.regimes import (
    AUTOMATIC,
    FREE_SIGMA_A_KM,
    REGIMES,
    Label,
    PriorName,
    Regime,
    eccentricity_sigma,
    is_consistent_with_regime,
    is_prediction_unambiguous,
    orbit_label,
    semi_major_axis_sigma_km,
    split_into_passes,
    starting_states_for_pass,
    widened_covariance,
)
from rsoconsole.orbits.first.directions import (
    INWARD,
    MeasuredDirections,
    State,
    is_plausible_orbit,
    starting_states,
)
from rsoconsole.orbits.motion.forces import J2, PerturbedPropagator, Propagator
from rsoconsole.orbits.motion.prediction import KnownOrbit
from rsoconsole.orbits.motion.two_body import MU_EARTH_KM3_S2, axis_and_inclination, propagate
from rsoconsole.records import FloatArray
from rsoconsole.sky import ARCSEC_RAD, EARTH_RADIUS_KM

MIN_SIGHTINGS = 3
POINT_MASS_S = 900.0
"""Longest arc fitted by two-body motion; its error is 0.02 arcsec at a geostationary satellite."""
_POINT_MASS_ARCSEC = 0.1
"""Error of two-body motion, as of low orbits, from which on a short arc is fitted with forces."""
_RIVAL = 9.0
"""Difference of two sums of squares below which both orbits fit alike."""
_HELPED = 2.0
"""Factor by which a prior must narrow axis or eccentricity to be used."""
_MAX_STARTS = 4
_NEAR_A_REGIME = 1.4
"""Factor by which the semi-major axes of starts may miss a regime and still belong to it."""
_WIDER = (3.0, 10.0, 30.0)
"""Factors on stated errors to try where no orbit fits within them."""
_ASTRAY = 9.0
"""Mean square residual from which on a start has led nowhere."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Orbit(KnownOrbit):
    """Orbit determined from directions, with its label and accuracy."""

    label: Label
    prior: PriorName
    """Name of the prior in use; ``none`` for a free orbit."""
    reason: str
    sigma_a_km: float
    rms_arcsec: float
    """RMS residual of the used directions, per axis, arcsec."""
    observations: int
    outlier_utc_ns: tuple[int, ...]
    """Times of the directions that the fit leaves out."""
    fit: OrbitFit
    rivals: int
    """Number of other, distinct orbits that fit as well."""
    is_astray: bool = False
    """True where the orbit misses its directions by far: no start led to one through them."""

    @property
    def outliers(self) -> int:
        """Number of directions that the fit leaves out."""
        return len(self.outlier_utc_ns)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Found:
    """The best fit of several, and how many others are as good."""

    fit: OrbitFit
    rivals: int
    prior: PriorName

    @property
    def state(self) -> State:
        return self.fit.r_km, self.fit.v_km_s


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Asked:
    """Prior and forces of a determination."""

    prior: PriorName
    forces: Propagator


def determine_orbit(
    seen: MeasuredDirections,
    *,
    prior: PriorName = "auto",
    start: State | None = None,
    tries_seeds: bool = True,
) -> Orbit | None:
    """Determine the best orbit through directions; None if they are too few or no orbit fits.

    ``start``: state of an earlier orbit at the epoch of ``seen``; refining it is a hundred times
    faster than trying all seeds, which is done without a start or where it leads to no good orbit
    (not if ``tries_seeds`` is False). ``prior``: name of a prior; ``auto`` is the prior of the
    orbit's regime, or none where the directions need none.
    """
    if len(seen) < MIN_SIGHTINGS or seen.t_s[-1] <= seen.t_s[0]:
        return None
    asked = _Asked(prior=prior, forces=PerturbedPropagator(epoch_utc_ns=seen.epoch_utc_ns))
    found = _found(seen, start, asked, tries_seeds=tries_seeds)
    if found is not None and np.any(seen.time_sigma_s > 0.0):
        # The first fit knows the motion along which errors of time count only roughly.
        seen = seen.with_rates(_rates_arcsec_s(seen, found.state, asked))
        found = _found(seen, start, asked, tries_seeds=tries_seeds) or found
    return None if found is None else _labelled(seen, found, asked)


def determine_orbit_with_wider_errors(
    seen: MeasuredDirections, prior: PriorName = "auto"
) -> Orbit | None:
    """Determine an orbit with errors wider than stated; None where none fits then either.

    For directions that no orbit fits: errors that are stated much too small overrule every prior.
    The reason of the label says by which factor.
    """
    for times in _WIDER:
        orbit = determine_orbit(seen.with_wider_errors(times), prior=prior)
        if orbit is not None and not orbit.is_astray:
            words = f"errors taken {times:.0f} times as wide as stated: nothing fits them"
            return replace(orbit, reason=f"{orbit.reason}; {words}")
    return None


def _found(
    seen: MeasuredDirections, start: State | None, asked: _Asked, *, tries_seeds: bool
) -> _Found | None:
    found = None
    if start is not None:
        found = _settled(seen, (start,), asked)
    if tries_seeds and (found is None or _is_astray(found)):
        found = _from_nothing(seen, asked)
    return found


def _rates_arcsec_s(seen: MeasuredDirections, state: State, asked: _Asked) -> FloatArray:
    """Rates (N, 2) east and north of an orbit as seen, arcsec/s."""
    if _is_short(seen):
        return seen.rates_arcsec_s(*propagate(*state, seen.t_s))
    return seen.rates_arcsec_s(*asked.forces.states(*state, seen.t_s))


def _is_short(seen: MeasuredDirections) -> bool:
    return bool(seen.t_s[-1] - seen.t_s[0] <= POINT_MASS_S)


def _from_nothing(seen: MeasuredDirections, asked: _Asked) -> _Found | None:
    """Determine without a start: from the longest pass to all of them, the nearest in time
    first.
    """
    known, *others = split_into_passes(seen)
    found = _first_pass(seen.subset(known), asked)
    while others and found is not None:
        covariance = widened_covariance(found.fit)
        added = [
            each
            for each in others
            if is_prediction_unambiguous(found.state, covariance, seen.subset(each))
        ]
        starts: tuple[State, ...] = (found.state,)
        if not added:
            added = others[:1]
            starts = starting_states_for_pass(found.state, covariance, seen.subset(others[0]))
        known = np.sort(np.concatenate([known, *added]))
        others = [each for each in others if not any(each is one for one in added)]
        starts = _sifted(seen.subset(known), starts, _belief(found.prior))
        found = _settled(seen.subset(known), starts, asked)
    return found


def _sifted(seen: MeasuredDirections, starts: tuple[State, ...], prior: Prior) -> tuple[State, ...]:
    """The few of many starts that are worth the forces' price."""
    if len(starts) <= _MAX_STARTS:
        return starts
    fits = sorted(
        (fit_orbit(seen, each, prior=prior) for each in starts), key=lambda each: each.cost
    )
    sifted: list[OrbitFit] = []
    for each in fits:
        if is_plausible_orbit(each.r_km, each.v_km_s) and _is_apart(each, sifted):
            sifted.append(each)
    return tuple((each.r_km, each.v_km_s) for each in sifted[:_MAX_STARTS])


def _is_apart(found: OrbitFit, others: Iterable[OrbitFit]) -> bool:
    """True where the orbit differs from each of the others, by 5 % of its distance."""
    size = 0.05 * float(np.linalg.norm(found.r_km))
    return all(float(np.linalg.norm(found.r_km - each.r_km)) > size for each in others)


def _first_pass(seen: MeasuredDirections, asked: _Asked) -> _Found | None:
    """Orbit through the longest pass.

    Where seeds through the outer directions lead astray, through inner ones.
    """
    best: _Found | None = None
    for inward in INWARD:
        found = _settled(seen, starting_states(seen, inward), asked)
        if found is not None and (best is None or found.fit.cost < best.fit.cost):
            best = found
        if best is not None and not _is_astray(best):
            break
    return best


def _settled(seen: MeasuredDirections, starts: tuple[State, ...], asked: _Asked) -> _Found | None:
    """Best fit: with a prior where one is requested or needed, without where the directions
    suffice.
    """
    if asked.prior in REGIMES:
        return _best(seen, starts, asked.prior, asked)
    is_refining = len(starts) == 1
    if asked.prior == "none" or (is_refining and _needs_no_prior(seen, starts[0])):
        return _best(seen, starts, "none", asked)
    against: list[_Found] = []
    for name in AUTOMATIC:
        if not _is_near(REGIMES[name], starts):
            continue
        constrained = _best(seen, starts, name, asked)
        if constrained is None:
            continue
        if not is_consistent_with_regime(constrained.fit, REGIMES[name]):
            against.append(constrained)
            continue
        # Of an orbit that is refined that was asked where it began.
        if is_refining or not _needs_no_prior(seen, constrained.state):
            return constrained
        return _best(seen, (constrained.state, *starts), "none", asked) or constrained
    free = _best(seen, starts, "none", asked)
    if free is None and against:
        # Nothing else fits: an orbit against its prior, and labelled so.
        return min(against, key=lambda each: each.fit.cost)
    return free


def _belief(name: PriorName) -> Prior:
    return REGIMES[name].prior if name in REGIMES else Prior()


def _is_near(regime: Regime, starts: tuple[State, ...]) -> bool:
    axes_km = [axis_and_inclination(*state)[0] for state in starts]
    low, high = regime.lowest_a_km / _NEAR_A_REGIME, regime.highest_a_km * _NEAR_A_REGIME
    return any(low <= each <= high for each in axes_km)


def _needs_no_prior(seen: MeasuredDirections, state: State) -> bool:
    """True where the directions alone give axis and eccentricity hardly worse than with a prior."""
    near = [each.prior for each in REGIMES.values() if each.contains(state)]
    constrained, free = formal_covariances(seen, state, near[0] if near else Prior())
    sigma_a_km, sigma_e = semi_major_axis_sigma_km(state, free), eccentricity_sigma(state, free)
    return sigma_a_km <= min(
        FREE_SIGMA_A_KM, _HELPED * semi_major_axis_sigma_km(state, constrained)
    ) and sigma_e <= _HELPED * eccentricity_sigma(state, constrained)


def _is_astray(found: _Found) -> bool:
    used, chi2 = found.fit.is_used, found.fit.chi2
    return bool(np.mean(used) < 0.7 or chi2 > _ASTRAY * max(found.fit.degrees_of_freedom, 1))


def _best(
    seen: MeasuredDirections, starts: Iterable[State], name: PriorName, asked: _Asked
) -> _Found | None:
    """The cheapest fit from any start, and how many others are as good."""
    motion = None if _is_short(seen) else asked.forces
    fits = [fit_orbit(seen, each, prior=_belief(name), motion=motion) for each in starts]
    distinct = _distinct(fits)
    if distinct and motion is None and _bulge_arcsec(seen, distinct[0]) > _POINT_MASS_ARCSEC:
        states = [(each.r_km, each.v_km_s) for each in distinct]
        again = [fit_orbit(seen, each, prior=_belief(name), motion=asked.forces) for each in states]
        distinct = _distinct(again) or distinct
    if not distinct:
        return None
    return _Found(fit=distinct[0], rivals=len(distinct) - 1, prior=name)


def _distinct(fits: Iterable[OrbitFit]) -> list[OrbitFit]:
    """The cheapest of the sound fits, and the others that are as good and apart from it."""
    sound = sorted(
        (each for each in fits if each.is_converged and is_plausible_orbit(each.r_km, each.v_km_s)),
        key=lambda each: each.cost,
    )
    found: list[OrbitFit] = []
    for each in sound:
        if each.cost < sound[0].cost + _RIVAL and _is_apart(each, found):
            found.append(each)
    return found


def _bulge_arcsec(seen: MeasuredDirections, found: OrbitFit) -> float:
    """Order of magnitude of what J2 does to an arc as seen, arcsec."""
    radius_km = float(np.linalg.norm(found.r_km))
    nearest = int(np.argmin(np.abs(seen.t_s)))
    range_km = float(np.linalg.norm(found.r_km - seen.sites_km[nearest]))
    pull = 1.5 * J2 * MU_EARTH_KM3_S2 * EARTH_RADIUS_KM**2 / radius_km**4
    half_s = (seen.t_s[-1] - seen.t_s[0]) / 2.0
    return float(pull * half_s**2 / 2.0 / range_km / ARCSEC_RAD)


def _labelled(seen: MeasuredDirections, found: _Found, asked: _Asked) -> Orbit:
    best = found.fit
    covariance = widened_covariance(best)
    sigma_a = semi_major_axis_sigma_km(found.state, covariance)
    label, reason = orbit_label(seen, best, found.prior, found.rivals)
    used = best.residuals_arcsec[best.is_used]
    return Orbit(
        label=label,
        prior=found.prior,
        reason=reason,
        epoch_utc_ns=seen.epoch_utc_ns,
        r_km=best.r_km,
        v_km_s=best.v_km_s,
        covariance=covariance,
        sigma_a_km=sigma_a,
        rms_arcsec=float(np.sqrt(np.mean(used**2))),
        observations=len(seen),
        outlier_utc_ns=tuple(map(int, seen.t_utc_ns[~best.is_used])),
        fit=best,
        rivals=found.rivals,
        is_astray=_is_astray(found),
        forces=asked.forces,
    )
