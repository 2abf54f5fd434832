"""Directions taken in several passes: which belong together, and orbits that join two. Pure."""

from collections.abc import Iterator

import numpy as np

from rsoconsole.orbit.gooding import Lines, gooding
from rsoconsole.orbit.seeds import LOWEST_KM, State, at_epoch, is_plausible
from rsoconsole.orbit.sightings import Sightings
from rsoconsole.orbit.two_body import MU_EARTH_KM3_S2, period_s
from rsoconsole.sky.times import IntArray

GAP_S = 1800.0
"""A pause so long ends a pass."""
MOST_REVOLUTIONS = 16
"""A day of a satellite that skims the air."""


def passes(seen: Sightings) -> tuple[IntArray, ...]:
    """Indices of each pass: the longest first, then by nearness to it in time."""
    ends = np.flatnonzero(np.diff(seen.t_s) > GAP_S) + 1
    groups = [np.asarray(each, np.int64) for each in np.split(np.arange(len(seen)), ends)]
    first = max(groups, key=lambda each: (len(each) >= 3, _span_s(seen, each), len(each)))
    middle = float(np.mean(seen.t_s[first]))
    return tuple(
        sorted(groups, key=lambda each: (each is not first, abs(seen.t_s[each[0]] - middle)))
    )


def seeds_across(
    known: Sightings, other: Sightings, mu: float = MU_EARTH_KM3_S2
) -> tuple[State, ...]:
    """Starts at the epoch that join a pass to another: however many revolutions lie between.

    Gooding's method on the ends of the known pass and the middle of the other.
    """
    return tuple(_across(known, other, mu))


def _across(known: Sightings, other: Sightings, mu: float) -> Iterator[State]:
    middle = len(other) // 2
    ends = [0, len(known) - 1]
    t = np.concatenate([known.t_s[ends], other.t_s[[middle]]])
    order = np.argsort(t)
    if len(np.unique(t)) < 3:
        return
    lines = Lines(
        t_s=t[order],
        sites_km=np.concatenate([known.sites_km[ends], other.sites_km[[middle]]])[order],
        directions=np.concatenate([known.lines[ends], other.lines[[middle]]])[order],
    )
    span_s = float(lines.t_s[2] - lines.t_s[0])
    most = min(int(span_s / period_s(LOWEST_KM, mu)) + 1, MOST_REVOLUTIONS)
    for orbit in gooding(
        lines, mu=mu, most_revolutions=most, starts_km=(8_000.0, 26_000.0, 42_000.0)
    ):
        state = at_epoch(orbit, lines, mu)
        if is_plausible(*state, mu):
            yield state


def _span_s(seen: Sightings, chosen: IntArray) -> float:
    return float(seen.t_s[chosen[-1]] - seen.t_s[chosen[0]])
