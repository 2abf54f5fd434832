"""Identification of one track: its directions against the places predicted by element sets. Pure.

Each object's offset from the directions is split along and across its own predicted motion, with
the rates at which the offset grows. It is weighed with the covariance of the measurement and of
elements of that age (``element_errors``), once for an object that has kept to its orbit and once
for one that has been moved. An object is named only where no other one is likely.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from rsoconsole.orbits.elements.catalogue import CatalogueEntry, nearest_epoch_entries, states_gcrs
from rsoconsole.orbits.first.directions import MeasuredDirections
from rsoconsole.orbits.identification._catalogue_residuals import (
    CatalogueResiduals,
    compute_catalogue_residuals,
)
from rsoconsole.orbits.identification.element_errors import (
    ASSUMED,
    ElementErrors,
    Regime,
    covariance_rtn,
    manoeuvred_probability,
    orbit_regime,
)
from rsoconsole.records import FloatArray, Site
from rsoconsole.words import NS_PER_DAY, angle, catalogued_name, utc_text

Verdict = Literal["identified", "ambiguous", "unknown"]

GATE_DEG = 0.2
"""Largest offset of an identified object, unless its elements are less certain than that."""
SURE = 0.95
"""Probability from which on an object counts as identified."""
_CREDIBLE = 23.5
"""Squared Mahalanobis distance, 4 degrees of freedom: one in ten thousand lies beyond."""
_OFF_ELEMENTS = 16.0
"""Squared Mahalanobis distance from which on elements no longer describe an undisturbed object."""
_WIDE_DEG = 2.0
"""Largest distance along its track at which a lone object is suspected to have been moved."""
_CLOSE_LOOK_DEG = 3.0
_MAX_MATCHES = 5
_AT_LEAST = 24
"""Nearest candidates compared in full, however far: there is always a runner-up."""
UNCATALOGUED = {4: 2.4e-10, 2: 3.9e-9}
"""Density of objects that no public catalogue knows: 0.05 a square degree, their rates over 4 by
4 arcsec/s; in arcsec and arcsec/s, with and without rates. A fifth of the catalogued density
there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectMatch:
    """One catalogued object compared with the directions, at their middle."""

    norad_id: int
    name: str
    regime: Regime
    separation_arcsec: float
    along_track_arcsec: float
    """Measured minus predicted along the track; positive: the object is ahead of its elements."""
    cross_track_arcsec: float
    """Measured minus predicted across the track; positive to the north of an eastward motion."""
    along_track_s: float
    """``along_track_arcsec`` as time at the apparent motion; positive: ahead of its elements."""
    rate_difference_percent: float | None
    """Measured minus predicted angular speed; None where one direction alone gives no rate."""
    rate_direction_deg: float | None
    """Angle by which the motion is turned, as ``cross_track_arcsec``; None without a rate."""
    tle_epoch_utc_ns: int
    tle_age_days: float
    """Age of the elements; negative where their epoch is after the directions."""
    score: float
    """Mahalanobis distance in sigmas, raised for vague elements; the smallest ranks first."""
    probability: float
    """Probability of this object, among all compared ones and what no catalogue knows."""
    is_within_gate: bool
    sigma_along_arcsec: float
    """One sigma of the offset along the track, if the object was not moved."""
    sigma_cross_arcsec: float
    undisturbed_sigma: float
    """Mahalanobis distance, in sigmas, if the object was not moved."""
    manoeuvred_sigma: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Identification:
    """Result of an identification, with the grounds for it."""

    verdict: Verdict
    reason: str
    hint: str
    """Suspicion of a manoeuvre, in words; usually empty."""
    matches: tuple[ObjectMatch, ...]
    """Best matches in order; the second is the runner-up, within the gate or not."""
    t_utc_ns: int
    gate_deg: float
    catalogued: int
    failed: int
    not_catalogued: float = 0.0
    """Probability that no catalogue knows the object."""
    named_with: int = 0
    """Number of other tracks identified together with this one (``identify_jointly``)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CatalogueComparison:
    """One track compared with the catalogued objects near it."""

    seen: MeasuredDirections
    found: CatalogueResiduals
    scored: tuple[ObjectMatch, ...]
    """Matches, best first; their ``probability`` is a weight that is not yet normalised."""
    unknown_weight: float
    """Weight of an object that no catalogue knows, in the unit of the matches' weights."""
    catalogued: int
    failed: int


def compare_with_catalogue(
    seen: MeasuredDirections,
    site: Site,
    entries: Sequence[CatalogueEntry],
    *,
    gate_deg: float = GATE_DEG,
    errors: ElementErrors = ASSUMED,
) -> CatalogueComparison:
    """Compare the directions of one arc with the predicted places of all catalogued objects.

    ``seen``: one arc of one night. ``gate_deg``: largest offset of an object within the gate.
    ``errors``: errors of the elements.
    """
    nearest = nearest_epoch_entries(entries, seen.epoch_utc_ns)
    close, failed = _close_by(seen, nearest)
    found = compute_catalogue_residuals(seen, site, close, errors)
    matches = (_match(seen, found, n, gate_deg) for n in range(len(found.entries)))
    scored = sorted(matches, key=lambda each: each.score)
    return CatalogueComparison(
        seen=seen,
        found=found,
        scored=tuple(scored),
        unknown_weight=_unknown_weight(found, scored),
        catalogued=len(nearest),
        failed=failed,
    )


def identify_alone(compared: CatalogueComparison, gate_deg: float) -> Identification:
    """Identify one track by itself, without regard to other tracks."""
    total = sum(each.probability for each in compared.scored) + compared.unknown_weight
    unknown = compared.unknown_weight / total if total > 0.0 else 1.0
    shares = tuple(
        replace(each, probability=each.probability / total if total > 0.0 else 0.0)
        for each in compared.scored
    )
    return make_identification(compared, shares, unknown, gate_deg)


def make_identification(
    compared: CatalogueComparison,
    matches: tuple[ObjectMatch, ...],
    not_catalogued: float,
    gate_deg: float,
) -> Identification:
    """Return the identification of a track from its matches with their final probabilities.

    ``matches``: best first. ``not_catalogued``: probability that no catalogue has the object.
    """
    verdict, reason = _verdict(matches, gate_deg)
    return Identification(
        verdict=verdict,
        reason=reason,
        hint=_hint(matches, verdict, gate_deg),
        matches=matches[:_MAX_MATCHES],
        t_utc_ns=compared.seen.epoch_utc_ns,
        gate_deg=gate_deg,
        catalogued=compared.catalogued,
        failed=compared.failed,
        not_catalogued=not_catalogued,
    )


def _close_by(
    seen: MeasuredDirections, entries: Sequence[CatalogueEntry]
) -> tuple[list[CatalogueEntry], int]:
    """Entries worth a closer look, and the number of entries without a place.

    By their places at the middle of the directions.
    """
    middle = int(np.argmin(np.abs(seen.t_s)))
    r, _ = states_gcrs(entries, seen.t_utc_ns[middle : middle + 1])
    u = r[:, 0] - seen.sites_km[middle]
    cosine = u @ seen.towards[middle] / np.linalg.norm(u, axis=-1)
    away_deg = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    has_place = np.isfinite(away_deg)
    order = np.argsort(np.where(has_place, away_deg, np.inf), kind="stable")
    count = max(int(np.sum(away_deg < _CLOSE_LOOK_DEG)), min(_AT_LEAST, int(np.sum(has_place))))
    return [entries[n] for n in order[:count]], int(np.sum(~has_place))


def _match(
    seen: MeasuredDirections, found: CatalogueResiduals, n: int, gate_deg: float
) -> ObjectMatch:
    """Compute one match, whose ``probability`` is a weight as yet."""
    entry, offset = found.entries[n], found.offsets[n]
    age_days = (seen.epoch_utc_ns - entry.epoch_utc_ns) / NS_PER_DAY
    regime = orbit_regime(entry.revolutions_a_day, entry.eccentricity)
    undisturbed = _covariance(found, n, age_days, is_moved=False)
    moved = _covariance(found, n, age_days, is_moved=True)
    fresh = _covariance(found, n, 0.0, is_moved=False)
    squared = [float(offset @ np.linalg.solve(each, offset)) for each in (undisturbed, moved)]
    share = manoeuvred_probability(regime, age_days)
    log_density = np.logaddexp(
        np.log1p(-share) - squared[0] / 2.0 - _log_size(undisturbed),
        np.log(max(share, 1e-300)) - squared[1] / 2.0 - _log_size(moved),
    )
    score_2 = max(-2.0 * (float(log_density) + _log_size(fresh)), 0.0)
    rate = float(found.rate_arcsec_s[n])
    sigma = np.sqrt(np.diag(undisturbed)[:2])
    has_rate = len(offset) == 4
    along, across = float(offset[0]), float(offset[1])
    gate_along = max(gate_deg * 3600.0, 3.0 * float(sigma[0]))
    is_near = abs(along) <= gate_along and abs(across) <= gate_deg * 3600.0
    return ObjectMatch(
        norad_id=entry.norad_id,
        name=entry.name,
        regime=regime,
        separation_arcsec=float(np.hypot(along, across)),
        along_track_arcsec=along,
        cross_track_arcsec=across,
        along_track_s=along / rate,
        rate_difference_percent=100.0 * float(offset[2]) / rate if has_rate else None,
        rate_direction_deg=(
            float(np.degrees(np.arctan2(offset[3], rate + offset[2]))) if has_rate else None
        ),
        tle_epoch_utc_ns=entry.epoch_utc_ns,
        tle_age_days=age_days,
        score=float(np.sqrt(score_2)),
        probability=float(np.exp(-score_2 / 2.0)),
        is_within_gate=is_near and min(squared) <= _CREDIBLE,
        sigma_along_arcsec=float(sigma[0]),
        sigma_cross_arcsec=float(sigma[1]),
        undisturbed_sigma=float(np.sqrt(squared[0])),
        manoeuvred_sigma=float(np.sqrt(squared[1])),
    )


def _covariance(
    found: CatalogueResiduals, n: int, age_days: float, *, is_moved: bool
) -> FloatArray:
    """Covariance (D, D) of the offsets of one object: measurement and elements."""
    entry = found.entries[n]
    regime = orbit_regime(entry.revolutions_a_day, entry.eccentricity)
    spread = found.errors.spread_for(regime, is_moved=is_moved)
    errors = covariance_rtn(spread, age_days, float(found.mean_motion_rad_s[n]))
    slopes = found.by_errors[n]
    return np.asarray(found.covariance[n] + slopes @ errors @ slopes.T)


def _log_size(covariance: FloatArray) -> float:
    """Minus the logarithm of a normal density at its middle."""
    return float(np.linalg.slogdet(2.0 * np.pi * covariance)[1]) / 2.0


def _unknown_weight(found: CatalogueResiduals, scored: Sequence[ObjectMatch]) -> float:
    """Weight of objects that no catalogue knows, in the unit of the matches' weights."""
    if not scored:
        return 1.0
    n = next(i for i, each in enumerate(found.entries) if each.norad_id == scored[0].norad_id)
    fresh = _covariance(found, n, 0.0, is_moved=False)
    return UNCATALOGUED[len(found.offsets[n])] * float(np.exp(_log_size(fresh)))


def _verdict(matches: Sequence[ObjectMatch], gate_deg: float) -> tuple[Verdict, str]:
    near = [each for each in matches if each.is_within_gate]
    if not near:
        return "unknown", _unknown_words(matches, gate_deg)
    best = near[0]
    rivals = [each for each in matches if each is not best and each.probability > 1.0 - SURE]
    if best is matches[0] and best.probability >= SURE:
        return ("identified", f"{_name(best)} {_off_words(best)}, {_next_words(matches)}")
    if best is matches[0] and not rivals:
        return "ambiguous", (
            f"{_name(best)} is the nearest: it {_off_words(best)}, which is as likely to be chance"
        )
    names = " and ".join(_name(each) for each in (best, *rivals)[:3])
    return "ambiguous", f"{names} fit alike: a longer arc or fresher elements may tell"


def _unknown_words(matches: Sequence[ObjectMatch], gate_deg: float) -> str:
    words = f"no catalogued object within {gate_deg:g} deg moves like this"
    if not matches:
        return words
    nearest = min(matches, key=lambda each: each.separation_arcsec)
    return f"{words}; the nearest, {_name(nearest)}, {_off_words(nearest)}"


def _next_words(matches: Sequence[ObjectMatch]) -> str:
    if len(matches) < 2:
        return "and the catalogue has no other"
    return f"the runner-up {_name(matches[1])} {_off_words(matches[1])}"


def _name(match: ObjectMatch) -> str:
    return catalogued_name(match.name, match.norad_id)


def _off_words(match: ObjectMatch) -> str:
    words = f"is {angle(match.separation_arcsec, 'cell')}"
    rate = match.rate_difference_percent
    if rate is not None and (abs(rate) >= 1.0 or abs(match.rate_direction_deg or 0.0) >= 1.0):
        return f"{words} off and its motion {_motion_words(match)}"
    return f"{words} off"


def _motion_words(match: ObjectMatch) -> str:
    turned = abs(match.rate_direction_deg or 0.0)
    return f"by {abs(match.rate_difference_percent or 0.0):.0f} % and {turned:.0f} deg"


def _hint(matches: Sequence[ObjectMatch], verdict: Verdict, gate_deg: float) -> str:
    """Hint at a manoeuvre: a known object, the right motion, off its elements, nothing else
    near.
    """
    if verdict == "identified" and matches[0].undisturbed_sigma ** 2 > _OFF_ELEMENTS:
        return _moved_words(matches[0])
    if verdict != "unknown":
        return ""
    suspects = [
        each
        for each in matches
        if each.manoeuvred_sigma**2 <= _CREDIBLE
        and abs(each.cross_track_arcsec) <= gate_deg * 3600.0
        and abs(each.along_track_arcsec) <= _WIDE_DEG * 3600.0
    ]
    return f"perhaps {_moved_words(suspects[0])}" if len(suspects) == 1 else ""


def _moved_words(match: ObjectMatch) -> str:
    epoch = utc_text(match.tle_epoch_utc_ns, "dated minute", "")
    way = "ahead of" if match.along_track_arcsec > 0.0 else "behind"
    between = "since" if match.tle_age_days >= 0.0 else "before"
    return (
        f"{_name(match)} has the right motion,"
        f" {angle(match.along_track_arcsec, 'cell')} ({abs(match.along_track_s):.0f} s) {way} its"
        f" elements and {angle(match.cross_track_arcsec, 'cell')} across: manoeuvred {between}"
        f" their epoch {epoch}"
    )
