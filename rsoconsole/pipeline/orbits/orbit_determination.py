"""Orbit of one object from all its directions, in one arc or over many nights. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from rsoconsole.base import OrbitError
from rsoconsole.orbits import (
    MIN_SIGHTINGS,
    GoodingOrbit,
    MeanElements,
    MeasuredDirections,
    Orbit,
    PriorName,
    TrackletOrbit,
    common_error_arcsec,
    determine_orbit,
    determine_orbit_with_wider_errors,
    fit_mean_elements,
    gooding_orbits,
    is_plausible_orbit,
    joint_orbit,
    log_odds_of_joining,
    merged_tracklets,
    osculating_elements,
    probability_from_log_odds,
    propagate,
    propagated_state,
    semi_major_axis_sigma_km,
    state_at_line_epoch,
    three_sight_lines,
    tracklet_orbit,
)
from rsoconsole.pipeline.orbits.track_measurements import ObservedTrack, split_into_arcs
from rsoconsole.words import NS_PER_S, count_words

Method = Literal["least squares", "gooding"]
SAME_OBJECT = 0.9
"""Probability from which another track of a session is used as the same object's."""
_MAX_TRACKS = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class OrbitArc:
    """Arc of directions, and whether the orbit was determined with it."""

    name: str
    observations: int
    t_first_utc_ns: int
    t_last_utc_ns: int
    is_used: bool
    probability: float | None
    """Probability that it is; None for the first, and where it is too short to compute."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FoundOrbit:
    """Result of an orbit determination."""

    method: Method
    orbit: Orbit | None
    reason: str
    seen: MeasuredDirections
    """All directions that were used."""
    observed: ObservedTrack
    """Track with the longest arc."""
    parts: tuple[OrbitArc, ...]
    solutions: tuple[GoodingOrbit, ...] = ()
    """Gooding's solutions: every orbit through the three lines that does not meet the ground."""
    not_used: tuple[str, ...] = ()
    """Lines of the files that gave no direction, each with its place and why."""


def find_orbit(
    observed: Sequence[ObservedTrack],
    *,
    prior: PriorName = "auto",
    others: Sequence[ObservedTrack] = (),
) -> FoundOrbit:
    """Determine the orbit of one object from all directions of ``observed``.

    ``others``: tracks that may be of the same object, such as further tracks of the session. Their
    arcs are used where the probability of this is ``SAME_OBJECT`` or more.
    """
    given = [(each, arc) for each in observed for arc in split_into_arcs(each.seen)]
    first = max(given, key=lambda pair: len(pair[1]))
    middle = first[1].epoch_utc_ns
    rest = [(*pair, True) for pair in given if pair is not first]
    rest += [
        (each, arc, False) for each in others[:_MAX_TRACKS] for arc in split_into_arcs(each.seen)
    ]
    rest.sort(key=lambda each: abs(each[1].epoch_utc_ns - middle))
    used, parts = [first[1]], [_part(*first, is_used=True, probability=None)]
    start = tracklet_orbit(first[1], prior) if rest else None
    for each, arc, is_given in rest:
        probability = _probability(start, used, arc, prior)
        is_used = is_given or (probability is not None and probability >= SAME_OBJECT)
        parts.append(_part(each, arc, is_used=is_used, probability=probability))
        if is_used:
            used.append(arc)
    seen, _ = merged_tracklets(used)
    orbit = _determined(seen, used, start, prior)
    return FoundOrbit(
        method="least squares",
        orbit=orbit,
        reason=_why_none(seen) if orbit is None else orbit.reason,
        seen=seen,
        observed=first[0],
        parts=tuple(sorted(parts, key=lambda part: part.t_first_utc_ns)),
        not_used=tuple(line for each in observed for line in each.not_used),
    )


def find_by_gooding(observed: ObservedTrack) -> FoundOrbit:
    """Determine the orbit through the first, the middlemost and the last direction, with no prior.

    Of several such orbits, that which fits all directions best is returned.
    """
    seen = observed.seen
    nothing = FoundOrbit(
        method="gooding",
        orbit=None,
        reason=_why_none(seen),
        seen=seen,
        observed=observed,
        parts=(_part(observed, seen, is_used=True, probability=None),),
        not_used=observed.not_used,
    )
    if len(seen) < MIN_SIGHTINGS or seen.t_s[-1] <= seen.t_s[0]:
        return nothing
    lines = three_sight_lines(seen)
    three = seen.subset(np.searchsorted(seen.t_s, lines.t_s))
    fits: list[tuple[float, Orbit, GoodingOrbit]] = []
    for each in gooding_orbits(lines):
        start = state_at_line_epoch(each, lines)
        orbit = (
            determine_orbit(three, prior="none", start=start)
            if is_plausible_orbit(*start)
            else None
        )
        if orbit is not None:
            fits.append((_misfit(seen, orbit), orbit, each))
    if not fits:
        return replace(nothing, reason="no bound orbit passes through the three directions")
    fits.sort(key=lambda each: each[0])
    others = "no other orbit" if len(fits) == 1 else f"each of {len(fits)} orbits"
    return replace(
        nothing,
        orbit=fits[0][1],
        reason=f"{fits[0][1].reason}; {others} passes through the three",
        solutions=tuple(each for _, _, each in fits),
    )


def _determined(
    seen: MeasuredDirections,
    used: Sequence[MeasuredDirections],
    start: TrackletOrbit | None,
    prior: PriorName,
) -> Orbit | None:
    """Determine an orbit over several arcs, from the longest on: no seed finds it at once."""
    if len(used) == 1 or start is None:
        orbit = determine_orbit(seen, prior=prior)
        if orbit is None and prior != "none":
            orbit = determine_orbit_with_wider_errors(seen, prior)
        return orbit
    state, epoch, grown = start.state, start.seen.epoch_utc_ns, None
    for count in range(2, len(used) + 1):
        grown = joint_orbit(used[:count], state, epoch, start.population)
        if grown is not None:
            state, epoch = grown.state, grown.epoch_utc_ns
    begun = propagated_state(state, epoch, seen.epoch_utc_ns)
    orbit = determine_orbit(seen, prior=prior, start=begun)
    if orbit is not None:
        return orbit
    # The nights part by more than the directions' own errors: forces that nobody knows.
    apart_arcsec = common_error_arcsec(seen)
    orbit = determine_orbit(seen.with_added_error(apart_arcsec), prior=prior, start=begun)
    if orbit is None or grown is None:
        return orbit
    words = f'the arcs agree only to some {apart_arcsec:.0f}": unknown forces, or a manoeuvre'
    return replace(
        orbit,
        r_km=grown.state[0],
        v_km_s=grown.state[1],
        covariance=grown.covariance,
        sigma_a_km=semi_major_axis_sigma_km(grown.state, grown.covariance),
        reason=f"{orbit.reason}; {words}",
    )


def _probability(
    start: TrackletOrbit | None,
    used: Sequence[MeasuredDirections],
    arc: MeasuredDirections,
    prior: PriorName,
) -> float | None:
    """Return the probability that an arc is of the same object as those used."""
    more = tracklet_orbit(arc, prior) if start is not None else None
    if start is None or more is None:
        return None
    return probability_from_log_odds(log_odds_of_joining(start, used[1:], more))


def _part(
    observed: ObservedTrack, arc: MeasuredDirections, *, is_used: bool, probability: float | None
) -> OrbitArc:
    return OrbitArc(
        name=observed.name,
        observations=len(arc),
        t_first_utc_ns=int(arc.t_utc_ns[0]),
        t_last_utc_ns=int(arc.t_utc_ns[-1]),
        is_used=is_used,
        probability=probability,
    )


def _why_none(seen: MeasuredDirections) -> str:
    if len(seen) < MIN_SIGHTINGS:
        return f"{count_words(len(seen), 'direction')}: at least {MIN_SIGHTINGS} are needed"
    if seen.t_s[-1] <= seen.t_s[0]:
        return "all directions are of one instant: they tell no motion"
    return "no bound orbit fits the directions"


def _misfit(seen: MeasuredDirections, orbit: Orbit) -> float:
    """Return the sum of squares over all directions, in units of variance."""
    since_s = (seen.t_utc_ns - orbit.epoch_utc_ns) / NS_PER_S
    places, _ = propagate(orbit.r_km, orbit.v_km_s, since_s)
    places, _ = propagate(orbit.r_km, orbit.v_km_s, since_s - seen.light_times_s(places))
    return float(np.sum(seen.whitened(seen.residuals_arcsec(places)) ** 2))


def orbit_record_fields(orbit: Orbit) -> dict[str, Any]:
    """Return the fields of an orbit, by name, that records and ledger have in common."""
    elements = osculating_elements(orbit.r_km, orbit.v_km_s)
    return {
        "label": orbit.label,
        "prior": orbit.prior,
        "epoch_utc_ns": orbit.epoch_utc_ns,
        "r_gcrs_km": tuple(map(float, orbit.r_km)),
        "v_gcrs_km_s": tuple(map(float, orbit.v_km_s)),
        "covariance": tuple(tuple(map(float, row)) for row in orbit.covariance),
        "a_km": elements.a_km,
        "e": elements.e,
        "i_deg": elements.i_deg,
        "sigma_a_km": orbit.sigma_a_km,
        "rms_arcsec": orbit.rms_arcsec,
    }


WORTH_WRITING = ("free", "constrained by prior")
"""Labels of orbits that may be written as element sets, which state no errors."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedElements:
    """Mean elements fitted to an orbit, or the reason why there are none."""

    mean: MeanElements | None
    tle: tuple[str, str] | None
    """Two lines of the element set; None also where they have no room for the catalogue number."""
    reason: str


def orbit_elements(
    found: FoundOrbit, *, norad_id: int, name: str, cospar: str = ""
) -> FittedElements:
    """Fit mean elements to the directions and the orbit; where SGP4 fails, return the reason."""
    if found.orbit is None or found.orbit.label not in WORTH_WRITING:
        label = "not observable" if found.orbit is None else found.orbit.label
        return FittedElements(mean=None, tle=None, reason=f"the orbit is labelled {label}")
    try:
        fitted = fit_mean_elements(found.orbit, found.seen, norad_id=norad_id, name=name)
        fitted = replace(fitted, cospar=cospar)
    except OrbitError as error:
        return FittedElements(mean=None, tle=None, reason=str(error))
    try:
        lines = fitted.element_set()
    except OrbitError as error:
        return FittedElements(mean=fitted, tle=None, reason=str(error))
    return FittedElements(mean=fitted, tle=(lines.line_1, lines.line_2), reason="")
