"""Equality of records, apart from rounding by another processor. Pure."""

import math
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from typing import Any

from rsoconsole.records import Mixture, TrackState

ROUNDING = 1e-7
"""Relative tolerance: after a night processors differ by 1e-12, other settings by 1e-3."""
_DIRECTION_DEG = 1e-9
"""Tolerance of a direction: four millionths of an arcsecond, below any record's precision."""


def are_nearly_equal(ours: Sequence[Any], theirs: Sequence[Any]) -> bool:
    """True where two lists of records agree, apart from a processor's rounding."""
    return len(ours) == len(theirs) and all(map(is_nearly_equal, ours, theirs))


def is_nearly_equal(one: Any, other: Any) -> bool:
    """True where two records, or two values of records, agree apart from rounding."""
    if one == other or type(one) is not type(other):
        return bool(one == other)
    if isinstance(one, TrackState):
        return _is_same_track(one, other)
    if isinstance(one, Mixture):
        return _is_same_mixture(one, other)
    if is_dataclass(one):
        names = (field.name for field in fields(one))
        return all(is_nearly_equal(getattr(one, name), getattr(other, name)) for name in names)
    if isinstance(one, tuple):
        return are_nearly_equal(one, other)
    return isinstance(one, float) and math.isclose(one, other, rel_tol=ROUNDING)


def _is_same_mixture(one: Mixture, other: Mixture) -> bool:
    """True where probabilities agree, and what has a sigma in units of that; it may be near 0."""
    of_acceleration = abs(one.acceleration_arcsec_s2 - other.acceleration_arcsec_s2)
    if of_acceleration > ROUNDING * one.acceleration_sigma_arcsec_s2:
        return False
    if abs(one.turn - other.turn) > ROUNDING * one.turn_sigma:
        return False
    if [name for name, _ in one.motion_probabilities] != [n for n, _ in other.motion_probabilities]:
        return False
    pairs = zip(one.motion_probabilities, other.motion_probabilities, strict=True)
    if any(abs(ours - theirs) > ROUNDING for (_, ours), (_, theirs) in pairs):
        return False
    apart = {"motion_probabilities", "acceleration_arcsec_s2", "turn"}
    plain = (f.name for f in fields(one) if f.name not in apart)
    return all(is_nearly_equal(getattr(one, name), getattr(other, name)) for name in plain)


def _is_same_track(one: TrackState, other: TrackState) -> bool:
    """True where places agree beyond what is measurable, covariances in units of their diagonal."""
    plain = (f.name for f in fields(one) if f.name not in {"x", "P", "innovation_arcsec"})
    if not all(is_nearly_equal(getattr(one, name), getattr(other, name)) for name in plain):
        return False
    sigma = [math.sqrt(one.P[n][n]) for n in range(4)]
    largest = max(_DIRECTION_DEG, ROUNDING * max(sigma))
    if any(abs(a - b) > largest for a, b in zip(one.x, other.x, strict=True)):
        return False
    if (one.innovation_arcsec is None) != (other.innovation_arcsec is None):
        return False
    innovations = zip(one.innovation_arcsec or (), other.innovation_arcsec or (), strict=True)
    if any(abs(a - b) > largest * 3600.0 for a, b in innovations):
        return False
    return all(
        abs(one.P[i][j] - other.P[i][j]) <= ROUNDING * sigma[i] * sigma[j]
        for i in range(4)
        for j in range(4)
    )
