"""Match of the streaks of a frame with the objects that can have crossed its field. Pure.

A line (streak) fits an object where it lies near the object's path, runs along it and has the
length given by rate and exposure; its place along the path gives the object's lead in seconds. Each
fit has a likelihood ratio against a line of an object in no catalogue. All one-to-one assignments
of lines to objects are weighed against each other (``assignments``); a line is ambiguous where
another choice has a probability of one twentieth or more.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import ndtr

from rsoconsole.orbits.elements.sky_paths import Exposure, ObjectPlaces
from rsoconsole.orbits.identification._assignments import best_assignments
from rsoconsole.orbits.identification.field_crossings import (
    GATE_SIGMAS,
    Candidate,
    FieldOfView,
    across_track_components,
    across_track_sigmas,
)
from rsoconsole.orbits.identification.single import Verdict
from rsoconsole.records import FloatArray
from rsoconsole.sky import ARCSEC_RAD

SURE = 20.0 / 21.0
"""Probability from which a line is identified: twenty to one against all other choices."""
WORTH_SAYING = 0.05
_MAX_ASSIGNMENTS = 60
_SEEN = 0.8
"""Rough share of the objects crossing a frame that are bright enough."""
_LOG_LENGTHS = 4.0
"""Range of the logarithm of lengths of lines that are in no catalogue."""
_DIRECTION_DEG, _LENGTH_SHARE = 0.1, 0.01
"""Errors of the predicted direction and rate, beside the line's own errors."""
_FADED, _FADED_LOG = 0.05, 2.5
"""Share of lines not visible all along, and how much shorter they may be, as a logarithm."""
_MAX_LENGTH_SIGMAS = 5.0
Shape = Literal["placed", "faded", "open"]
"""Kind of a line: placed (an end gives place and time), faded (a part missing), open (both cut)."""
_TOO_LONG = 1.05
_MAX_TURN_SIGMAS = 5.0
_NEWTON = 3
_WIDER = 1.1
"""Factor by which a measured lead may exceed the gate."""
_MIN_ROOM_S = 0.1
_MIN_PACE = 1e-3 * ARCSEC_RAD
"""Least angular speed by a second of lead, rad/s."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StreakLine:
    """A streak of one exposure: unit vectors of its ends and middle, and its errors.

    The errors are those of the midpoint, the direction and the length.
    """

    a: FloatArray
    """Unit vector (3,) of one end; ``b`` is that of the other."""
    b: FloatArray
    middle: FloatArray
    """Unit vector (3,) of the midpoint: of mid-exposure where both ends are in the frame."""
    is_end_a: bool
    """True where the object was at ``a`` at opening or closing; False: the rim cut the line."""
    is_end_b: bool
    is_ordered: bool
    """True where the object is known to have moved from ``a`` to ``b``."""
    after_s: float
    """Delay of the exposure at the line's row after that at the frame's first row."""
    cov_sky_rad2: tuple[float, float, float]
    """Covariance of the midpoint: east-east, east-north, north-north."""
    sigma_direction_rad: float
    sigma_length_rad: float
    strangers: float = 0.3
    """Mean number of lines of objects in no catalogue that a frame shows."""

    @property
    def length_rad(self) -> float:
        """Angle between the two ends."""
        return _angle_rad(self.a, self.b)


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateFit:
    """Offsets of a line from a candidate's path, and the likelihood of the match."""

    along_s: float
    """Lead of the object over its elements, s; below 0 it is behind."""
    sigma_along_s: float
    """One sigma of ``along_s``, by the measurement alone."""
    across_rad: float
    """Offset across the path; positive to the north for an eastward motion."""
    sigma_across_rad: float
    """One sigma of ``across_rad``, by the measurement alone."""
    range_km: float
    speed_km_s: float
    across_by: tuple[float, float]
    """Change across its path by an error of a kilometre along the radius, and off the plane, km."""
    direction_deg: float
    """Angle from the predicted direction of the motion to that of the line."""
    length_ratio: float | None
    """Length of the line, measured over predicted; None where an end is outside the frame."""
    log_ratio: float
    """Logarithm of the likelihood of the match over that of a line in no catalogue."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LineChoice:
    """One possible answer for a line: a candidate's index, or None for no catalogued object."""

    candidate: int | None
    probability: float
    fit: CandidateFit | None


@dataclass(frozen=True, slots=True, kw_only=True)
class LineMatch:
    """Result of the match for one line."""

    verdict: Verdict
    choices: tuple[LineChoice, ...]
    """Choices with a probability of 5 % at least, the likeliest first; never empty."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldMatch:
    """Results of the match for all lines of an exposure and all candidates."""

    lines: tuple[LineMatch, ...]
    taken: tuple[float, ...]
    """For each candidate the probability that one of the lines is its streak."""


def match_field(
    view: FieldOfView, candidates: Sequence[Candidate], lines: Sequence[StreakLine]
) -> FieldMatch:
    """Match the lines of a frame with candidates: at most one line for each candidate."""
    if not lines:
        return FieldMatch(lines=(), taken=(0.0,) * len(candidates))
    exposure = Exposure(view.site, view.t_mid_utc_ns, view.exposure_s)
    fits = [[_fitted(view, exposure, each, line) for each in candidates] for line in lines]
    scores = np.zeros((len(lines), len(candidates) + 1))
    for row, of_line in enumerate(fits):
        scores[row, :-1] = [-np.inf if each is None else each.log_ratio for each in of_line]
    shares = _shares(scores)
    return FieldMatch(
        lines=tuple(_matched(shares[row], fits[row]) for row in range(len(lines))),
        taken=tuple(np.minimum(shares[:, :-1].sum(axis=0), 1.0).tolist()),
    )


def _shares(scores: FloatArray) -> FloatArray:
    """Probabilities (T, N + 1) over the best assignments."""
    used = np.flatnonzero(np.isfinite(scores).any(axis=0))
    small = scores[:, used]
    rivals = np.ones((len(scores), len(scores)), bool)
    best = best_assignments(small, rivals, _MAX_ASSIGNMENTS)
    rows = np.arange(len(scores))
    totals = np.array([small[rows, list(each)].sum() for each in best])
    weights = np.exp(totals - totals.max())
    weights /= weights.sum()
    found = np.zeros_like(scores)
    for each, weight in zip(best, weights, strict=True):
        found[rows, used[list(each)]] += weight
    return found


def _matched(shares: FloatArray, fits: Sequence[CandidateFit | None]) -> LineMatch:
    order = np.argsort(-shares, kind="stable")
    none = len(shares) - 1
    choices = tuple(
        LineChoice(
            candidate=None if n == none else int(n),
            probability=float(shares[n]),
            fit=None if n == none else fits[n],
        )
        for place, n in enumerate(order)
        if place == 0 or shares[n] >= WORTH_SAYING
    )
    best = choices[0]
    if best.probability < SURE and len(choices) > 1:
        verdict: Verdict = "ambiguous"
    else:
        verdict = "unknown" if best.candidate is None else "identified"
    return LineMatch(verdict=verdict, choices=choices)


def _fitted(
    view: FieldOfView, exposure: Exposure, candidate: Candidate, line: StreakLine
) -> CandidateFit | None:
    """Fit of a line to a candidate's path; None where it lies outside the gates."""
    met = _met(view, exposure, candidate, line)
    if met is None:
        return None
    opening, middle, closing = met.three
    predicted = _angle_rad(opening, closing)
    direction = _direction_rad(line, middle.by_time[0, 0], met.seen.u[0, 0])
    sigma_direction = np.hypot(line.sigma_direction_rad, np.radians(_DIRECTION_DEG))
    shapes = _log_lengths(line, predicted)
    if abs(direction) > _MAX_TURN_SIGMAS * sigma_direction or not shapes:
        return None
    log_direction = -0.5 * (direction / sigma_direction) ** 2 - np.log(
        sigma_direction * np.sqrt(2.0 * np.pi) / np.pi
    )
    speed_km_s = float(np.linalg.norm(met.seen.v_km_s[0, 0]))
    along_sigmas = np.hypot(candidate.spread.along_km[0] / speed_km_s, met.sigma_along_s)
    room_s = max((predicted - line.length_rad) / 2.0 / met.pace, _MIN_ROOM_S)
    scores = {
        shape: log_length + _log_place(candidate, met, along_sigmas, (shape, room_s), view)
        for shape, log_length in shapes.items()
    }
    likeliest = max(scores, key=lambda shape: scores[shape])
    spare_s = 0.0 if likeliest == "placed" else room_s / np.sqrt(3.0)
    missed = np.log(max(1.0 - _SEEN * candidate.chance, 1e-3))
    prior = np.log(_SEEN) - missed - np.log(line.strangers)
    is_whole = line.is_end_a and line.is_end_b
    return CandidateFit(
        along_s=met.lead_s,
        sigma_along_s=float(np.hypot(met.sigma_along_s, spare_s)),
        across_rad=met.across_rad,
        sigma_across_rad=met.sigma_across_rad,
        range_km=float(met.seen.range_km[0, 0]),
        speed_km_s=speed_km_s,
        across_by=met.across_by,
        direction_deg=float(np.degrees(direction)),
        length_ratio=line.length_rad / max(predicted, 1e-12) if is_whole else None,
        log_ratio=float(prior + log_direction + np.logaddexp.reduce(list(scores.values()))),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _PathAtLine:
    """Path of a candidate at the lead that brings it nearest to a line."""

    three: tuple[FloatArray, ObjectPlaces, FloatArray]
    """Unit vectors at opening and closing, and all places at the middle."""
    seen: ObjectPlaces
    """Places at the instant at which a place of the line is known."""
    lead_s: float
    sigma_along_s: float
    pace: float
    """Angular speed by a second of lead, rad."""
    across_rad: float
    sigma_across_rad: float
    across_by: tuple[float, float]
    across_sigmas: FloatArray
    """One sigma across the path by case, the line's own error included."""


def _met(
    view: FieldOfView, exposure: Exposure, candidate: Candidate, line: StreakLine
) -> _PathAtLine | None:
    """Path at the line's lead; None where the line is outside the gates along and across."""
    start = int(np.argmax(candidate.u @ line.middle))
    if candidate.u[start] @ line.middle < np.cos(4.0 * view.radius_rad + candidate.gate_across_rad):
        return None
    place: FloatArray | None = None
    lead_s = float(candidate.lead_s[start])
    for turn in range(_NEWTON + 1):
        three = exposure.places_through_exposure(candidate.satellite, np.array([lead_s]))
        if place is None:
            place, when = _known_place(line, three[1].by_time[0, 0])
        seen = three[when]
        off = place - seen.by_time[0, 0] * line.after_s - seen.u[0, 0]
        along = seen.by_lead[0, 0]
        pace = max(float(np.linalg.norm(along)), _MIN_PACE)
        if not np.isfinite(pace) or not np.all(np.isfinite(off)):
            return None
        if turn < _NEWTON:
            lead_s += float(off @ along) / pace**2
    across, sigmas = across_track_sigmas(candidate.spread, seen)
    own = _sigma_towards(line, seen.u[0, 0], across[0, 0])
    _, by_radial, by_pole = across_track_components(seen)
    across_rad = float(off @ across[0, 0])
    across_sigmas = np.hypot(sigmas[0, 0], own)
    is_off = abs(across_rad) > GATE_SIGMAS * float(across_sigmas.max())
    if is_off or abs(lead_s) > _WIDER * candidate.gate_s:
        return None
    return _PathAtLine(
        three=(three[0].u[0, 0], three[1], three[2].u[0, 0]),
        seen=seen,
        lead_s=lead_s,
        sigma_along_s=_sigma_towards(line, seen.u[0, 0], along / pace) / pace,
        pace=pace,
        across_rad=across_rad,
        sigma_across_rad=own,
        across_by=(float(by_radial[0, 0]), float(by_pole[0, 0])),
        across_sigmas=across_sigmas,
    )


def _known_place(line: StreakLine, by_time: FloatArray) -> tuple[FloatArray, int]:
    """Place of a line whose instant is known, and which that is: 0 opening, 1 middle, 2 closing.

    For a line that the rim cuts: the end in the frame, opening or closing by the direction of
    motion.
    """
    if line.is_end_a == line.is_end_b:
        return line.middle, 1
    inner, outer = (line.a, line.b) if line.is_end_a else (line.b, line.a)
    return inner, 0 if (outer - inner) @ by_time > 0.0 else 2


def _direction_rad(line: StreakLine, by_time: FloatArray, u: FloatArray) -> float:
    """Angle from the predicted direction to the line's, to the north of an eastward motion.

    For a line of unknown sense the smaller one of two.
    """
    way = line.b - line.a
    side = np.cross(u, by_time)
    angle = float(np.arctan2(way @ side, way @ by_time))
    if line.is_ordered:
        return angle
    return (angle + np.pi / 2.0) % np.pi - np.pi / 2.0


def _log_lengths(line: StreakLine, predicted_rad: float) -> dict[Shape, float]:
    """Log densities of a line's length over that of a line in no catalogue, by kind.

    Empty where the length does not fit.
    """
    length = max(line.length_rad, 1e-12)
    if not (line.is_end_a and line.is_end_b):
        if length > predicted_rad * _TOO_LONG + 5.0 * line.sigma_length_rad:
            return {}
        return {"placed" if line.is_end_a or line.is_end_b else "open": 0.0}
    ratio = np.log(length / max(predicted_rad, 1e-12))
    sigma = float(np.hypot(line.sigma_length_rad / max(predicted_rad, 1e-12), _LENGTH_SHARE))
    found: dict[Shape, float] = {}
    if abs(ratio) < _MAX_LENGTH_SIGMAS * sigma:
        log_normal = -0.5 * (ratio / sigma) ** 2 - np.log(sigma * np.sqrt(2.0 * np.pi))
        found["placed"] = float(np.log((1.0 - _FADED) * _LOG_LENGTHS) + log_normal)
    if -_FADED_LOG < ratio < 0.0:
        found["faded"] = float(np.log(_FADED / _FADED_LOG * _LOG_LENGTHS))
    return found


def _log_place(
    candidate: Candidate,
    met: _PathAtLine,
    along_sigmas: FloatArray,
    shape_and_room_s: tuple[Shape, float],
    view: FieldOfView,
) -> float:
    """Logarithm of the density of its place over that of a line that lies anywhere in the frame.

    ``shape_and_room_s``: the kind of the line, and the unmeasurable part of the lead either way
    where the line is not placed along the path.
    """
    shape, room_s = shape_and_room_s
    off = met.across_rad / met.across_sigmas
    aside = np.exp(-0.5 * off**2) / met.across_sigmas / np.sqrt(2.0 * np.pi)
    lead_s = met.lead_s
    anyhow = 1.0 / view.area_rad2
    if shape == "placed":
        ahead = np.exp(-0.5 * (lead_s / along_sigmas) ** 2) / along_sigmas / np.sqrt(2.0 * np.pi)
        ahead = ahead / met.pace
    else:
        ahead = ndtr((lead_s + room_s) / along_sigmas) - ndtr((lead_s - room_s) / along_sigmas)
        if shape == "open":
            anyhow = np.sqrt(anyhow)
        else:
            ahead = ahead / (2.0 * room_s * met.pace)
    density = float(candidate.spread.share[0] @ (aside * ahead))
    return float(np.log(max(density, 1e-300) / anyhow))


def _angle_rad(a: FloatArray, b: FloatArray) -> float:
    """Angle between unit vectors, exact for small ones too."""
    return float(2.0 * np.arcsin(min(float(np.linalg.norm(a - b)) / 2.0, 1.0)))


def _sigma_towards(line: StreakLine, u: FloatArray, direction: FloatArray) -> float:
    """One sigma of its middle along a unit vector, rad."""
    east = np.array([-u[1], u[0], 0.0]) / max(float(np.hypot(u[0], u[1])), 1e-12)
    north = np.cross(u, east)
    a, b = float(direction @ east), float(direction @ north)
    ee, en, nn = line.cov_sky_rad2
    return float(np.sqrt(max(a * a * ee + 2.0 * a * b * en + b * b * nn, 0.0)))
