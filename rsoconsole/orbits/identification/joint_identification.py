"""Identification of all tracks of a field together: an object is one track at most. Pure.

Tracks seen at the same time are of different objects: a catalogued object that fits two of them can
be only one. All assignments of tracks to objects, or to none in a catalogue, are weighed against
each other (``assignments``), with an error that the elements may have in common
(``_shared_errors``): where all objects of a slot are off their elements, their relative places
distinguish them. A track's probabilities are sums over the assignments.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from rsoconsole.orbits.elements.catalogue import CatalogueEntry
from rsoconsole.orbits.first.directions import MeasuredDirections
from rsoconsole.orbits.identification._assignments import Assignment, best_assignments
from rsoconsole.orbits.identification._shared_errors import (
    CASES,
    ObjectPair,
    SharedErrorModel,
    make_pair,
)
from rsoconsole.orbits.identification.element_errors import ASSUMED, ElementErrors
from rsoconsole.orbits.identification.single import (
    GATE_DEG,
    SURE,
    UNCATALOGUED,
    CatalogueComparison,
    Identification,
    ObjectMatch,
    compare_with_catalogue,
    identify_alone,
    make_identification,
)
from rsoconsole.records import FloatArray, Site
from rsoconsole.words import NS_PER_S, catalogued_name

GAP_S = 600.0
"""Longest gap within a stretch of a track: in a longer one the object may have been lost."""


def simultaneous_tracks(tracks: Sequence[MeasuredDirections]) -> npt.NDArray[np.bool_]:
    """Return a matrix (T, T), True where two tracks were observed at the same time.

    A track counts as not observed during its gaps longer than `GAP_S`.
    """
    stretches = [_stretches(each) for each in tracks]
    found = np.zeros((len(tracks), len(tracks)), bool)
    for one, (begins, ends) in enumerate(stretches):
        for other in range(one + 1):
            starts, lasts = stretches[other]
            overlaps = (begins[:, None] <= lasts[None, :]) & (starts[None, :] <= ends[:, None])
            found[one, other] = found[other, one] = bool(np.any(overlaps))
    return found


def _stretches(seen: MeasuredDirections) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """First and last instants of each stretch."""
    t = np.asarray(seen.t_utc_ns, np.int64)
    cuts = np.flatnonzero(np.diff(t) > GAP_S * NS_PER_S)
    return np.concatenate([t[:1], t[cuts + 1]]), np.concatenate([t[cuts], t[-1:]])


_CREDIBLE = 36.0
"""Squared Mahalanobis distance up to which an object is a candidate for a track."""
_MAX_OBJECTS = 12
_ANCHORS = 2
"""Number of tracks, those with most directions, that give the common error of elements."""
_EACH = 12
"""Number of assignments weighed for each such guess."""
_WITHIN = 30.0
"""Range of log likelihood below the best assignment of a guess within which others are weighed."""
_LIKELIEST = 3
"""Number of the weighed assignments that refine the common error of elements."""


def identify_jointly(
    tracks: Sequence[MeasuredDirections],
    site: Site,
    entries: Sequence[CatalogueEntry],
    *,
    gate_deg: float = GATE_DEG,
    errors: ElementErrors = ASSUMED,
) -> tuple[Identification, ...]:
    """Identify all tracks of a field together: one answer for each, in their order.

    For each object the element set nearest in epoch is used. ``gate_deg``: largest offset of an
    identified object. ``errors``: those of the elements.
    """
    compared = [
        compare_with_catalogue(each, site, entries, gate_deg=gate_deg, errors=errors)
        for each in tracks
    ]
    return identify_compared_tracks(compared, gate_deg=gate_deg)


def identify_compared_tracks(
    compared: Sequence[CatalogueComparison], *, gate_deg: float = GATE_DEG
) -> tuple[Identification, ...]:
    """Identify tracks already compared with the catalogue: one answer each, in their order."""
    found: dict[int, Identification] = {}
    for group in _groups(compared):
        members = [compared[n] for n in group]
        answers = _named(members, gate_deg)
        found.update(zip(group, answers, strict=True))
    return tuple(found[n] for n in range(len(compared)))


def _groups(compared: Sequence[CatalogueComparison]) -> list[list[int]]:
    """Groups of tracks that compete for an object, directly or by others.

    A track that does not compete is a group of its own.
    """
    candidates = [{each.norad_id for each in _candidates(one)} for one in compared]
    groups: list[tuple[set[int], list[int]]] = []
    for n, own in enumerate(candidates):
        joined, members = set(own), [n]
        rest = []
        for objects, others in groups:
            if objects & joined:
                joined |= objects
                members = [*others, *members]
            else:
                rest.append((objects, others))
        groups = [*rest, (joined, members)]
    return [sorted(members) for _, members in groups]


def _candidates(compared: CatalogueComparison) -> list[ObjectMatch]:
    near = [
        each
        for each in compared.scored
        if min(each.undisturbed_sigma, each.manoeuvred_sigma) ** 2 <= _CREDIBLE
    ]
    return near[:_MAX_OBJECTS]


def _named(members: Sequence[CatalogueComparison], gate_deg: float) -> list[Identification]:
    if len(members) == 1:
        return [identify_alone(members[0], gate_deg)]
    objects = sorted({each.norad_id for one in members for each in _candidates(one)})
    assignments, probabilities = _weighed(members, objects)
    marginals = np.zeros((len(members), len(objects) + 1))
    for assignment, share in zip(assignments, probabilities, strict=True):
        marginals[np.arange(len(members)), list(assignment)] += share
    best = assignments[0]
    answers = []
    for t, one in enumerate(members):
        shares = dict(zip(objects, marginals[t], strict=False))
        matches = tuple(
            sorted(
                (replace(m, probability=shares.get(m.norad_id, 0.0)) for m in one.scored),
                key=lambda each: (-round(each.probability, 6), each.score),
            )
        )
        answer = make_identification(one, matches, float(marginals[t, -1]), gate_deg)
        answer = replace(answer, named_with=len(members) - 1)
        if answer.not_catalogued >= SURE and best[t] == len(objects):
            answer = _taken_by_others(answer)
        answers.append(answer)
    return answers


def _taken_by_others(answer: Identification) -> Identification:
    """Answer "unknown", because the nearest object is another track's."""
    if answer.verdict == "unknown":
        return answer
    near = min(answer.matches, key=lambda each: each.score)
    name = catalogued_name(near.name, near.norad_id)
    reason = f"no catalogued object is left for it: {name}, the nearest, is another track's"
    return replace(answer, verdict="unknown", reason=reason)


def _weighed(
    members: Sequence[CatalogueComparison], objects: Sequence[int]
) -> tuple[list[Assignment], FloatArray]:
    """Assignments worth weighing, the likeliest first, and their probabilities.

    By every case of shared errors.
    """
    pairs = [_pairs(one, objects) for one in members]
    unknown = np.array([np.log(UNCATALOGUED[one.found.offsets.shape[1]]) for one in members])
    rivals = simultaneous_tracks([one.seen for one in members])
    anchors = sorted(range(len(members)), key=lambda t: -len(members[t].seen))[:_ANCHORS]
    cases = [SharedErrorModel(case, pairs, unknown) for case in CASES]
    proposed: set[Assignment] = set()
    for case in cases:
        for common in case.trial_common_errors(anchors):
            proposed.update(best_assignments(case.log_densities(common), rivals, _EACH, _WITHIN))
    for case in cases:
        known = sorted(proposed)
        heights, places = case.log_evidence(known)
        for k in np.argsort(-heights)[:_LIKELIEST]:
            proposed.update(best_assignments(case.log_densities(places[k]), rivals, _EACH, _WITHIN))
    known = sorted(proposed)
    total = np.logaddexp.reduce([case.log_evidence(known)[0] for case in cases])
    shares = np.exp(total - np.max(total))
    order = np.argsort(-shares, kind="stable")
    return [known[k] for k in order], shares[order] / np.sum(shares)


def _pairs(one: CatalogueComparison, objects: Sequence[int]) -> list[ObjectPair | None]:
    near = {each.norad_id for each in _candidates(one)}
    place = {entry.norad_id: n for n, entry in enumerate(one.found.entries)}
    return [
        make_pair(one.found, place[number], one.seen.epoch_utc_ns) if number in near else None
        for number in objects
    ]
