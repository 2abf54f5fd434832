"""A pass that is waited for: where the telescope stares until it comes, and what came. Pure.

Elements are off along the orbit more than across it. So the telescope looks at one point of the
orbit until the object has surely gone through there, early or late; how late it was says the first
streak, and how far across.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np

from rsoconsole.config import LimitsConfig
from rsoconsole.orbits.elements import CatalogueEntry, Satellite
from rsoconsole.orbits.identification import ASSUMED, ElementErrors
from rsoconsole.orbits.low import StreakEnds
from rsoconsole.orbits.motion import KnownOrbit, SkyAhead
from rsoconsole.pipeline.leaps.leap_pass import Stare
from rsoconsole.pipeline.outlook import night_passes
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import (
    LIT_SHARE,
    NS_PER_DAY,
    NS_PER_S,
    IntArray,
    astrometric_places,
    lit_fraction,
    separation_deg,
    site_gcrs,
    unit_to_direction,
    wrap_180,
)
from rsoconsole.sky.limits import LimitName, Limits, Pose

StatesOf = Callable[[IntArray], tuple[FloatArray, FloatArray]]
"""GCRS positions and velocities (N, 3) at instants (N,): km, km/s."""
SIGMAS = 3.0
_STEP_S = 5.0
_TURN_DEG, _SPEED = 15.0, 0.2
"""By how much a streak's direction and speed may differ from the elements' and be its own."""
_FINE_S = 0.05
_FARTHEST_DEG = 3.0
"""Across its way: elements are off by arc minutes there."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Awaited:
    """One pass, and where it is waited for."""

    name: str
    states: StatesOf
    stare: Stare
    set_utc_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Came:
    """What a first streak says of the elements."""

    late_s: float
    across_arcmin: float
    """To the left of the motion."""


def next_of(
    entry: CatalogueEntry,
    site: Site,
    now_utc_ns: int,
    *,
    limits: LimitsConfig,
    held: Limits,
    late_sigma_s: float,
    lifted: Collection[LimitName] = (),
    errors: ElementErrors = ASSUMED,
) -> Awaited | None:
    """The next pass of a catalogued object within a day on which it is lit where it is met."""
    satellite = Satellite(entry)
    span = (now_utc_ns, now_utc_ns + NS_PER_DAY)
    found = [
        each
        for _, some in night_passes([entry], site, span, limits, is_low_only=False, errors=errors)
        for each in some
    ]
    for each in found:
        if each.lit_from_utc_ns is None:
            continue
        awaited = awaited_on(
            each.name,
            satellite.position_gcrs,
            site,
            up_utc_ns=(each.rise.t_utc_ns, each.set.t_utc_ns),
            sigma_s=max(late_sigma_s, each.sigma_s),
            held=held,
            now_utc_ns=now_utc_ns,
            lifted=lifted,
        )
        if awaited is not None:
            return awaited
    return None


def awaited_on(
    name: str,
    states: StatesOf,
    site: Site,
    *,
    up_utc_ns: tuple[int, int],
    sigma_s: float,
    held: Limits,
    now_utc_ns: int,
    lifted: Collection[LimitName] = (),
) -> Awaited | None:
    """The earliest point of a pass that the telescope may look at all the time, and that is lit."""
    span_ns = round(SIGMAS * sigma_s * NS_PER_S)
    for t in range(up_utc_ns[0], up_utc_ns[1], round(_STEP_S * NS_PER_S)):
        point = states(np.array([t]))[0]
        # Where it may come is looked at in time for the earliest that it may be.
        if not np.all(np.isfinite(point)) or t - span_ns < now_utc_ns:
            continue
        if lit_fraction(point, np.array([t]))[0] < LIT_SHARE:
            continue
        x, y, z = point[0].tolist()
        stare = Stare(
            t_through_utc_ns=t,
            from_utc_ns=t - span_ns,
            until_utc_ns=t + span_ns,
            point_gcrs_km=(x, y, z),
        )
        if all(_may_look(stare, site, at, held, lifted) for at in _instants(stare)):
            return Awaited(name=name, states=states, stare=stare, set_utc_ns=up_utc_ns[1])
    return None


def is_dark(orbit: KnownOrbit, t_utc_ns: int) -> bool:
    """Whether the Sun does not shine on it at all."""
    at = np.array([t_utc_ns])
    return bool(lit_fraction(orbit.states(at)[0], at)[0] <= 0.0)


def _instants(stare: Stare) -> Sequence[int]:
    return (stare.from_utc_ns, stare.t_through_utc_ns, stare.until_utc_ns)


def _may_look(
    stare: Stare, site: Site, t_utc_ns: int, held: Limits, lifted: Collection[LimitName]
) -> bool:
    ra, dec = stare.direction_deg(site, t_utc_ns)
    pose = Pose(t_utc_ns=t_utc_ns, ra_icrs_deg=ra, dec_icrs_deg=dec, pier_side=None)
    return held.refuse_pose(pose, is_slewing=False, lifted=lifted) is None


def expected_at(awaited: Awaited, site: Site, t_utc_ns: int, late_s: float) -> SkyAhead:
    """Where it would be at an instant if it were so late."""
    moved_ns = round(late_s * NS_PER_S)

    def states(t: IntArray) -> tuple[FloatArray, FloatArray]:
        return awaited.states(t - moved_ns)

    seen = astrometric_places(states, site, np.array([t_utc_ns]))
    dec = float(seen.dec_icrs_deg[0])
    east = float(seen.ra_rate_deg_s[0]) * np.cos(np.radians(dec))
    return SkyAhead(
        t_utc_ns=t_utc_ns,
        ra_icrs_deg=float(seen.ra_icrs_deg[0]),
        dec_icrs_deg=dec,
        rate_arcsec_s=3600.0 * np.array([east, float(seen.dec_rate_deg_s[0])]),
        covariance_arcsec2=np.eye(2),
    )


def came(awaited: Awaited, site: Site, streak: StreakEnds) -> tuple[Came, StreakEnds] | None:
    """How late and how far across it is by one whole streak, taken in its sense.

    None for one that is nowhere on its way within the window, or that goes another way or at
    another speed than it would there.
    """
    stare = awaited.stare
    span_s = (stare.until_utc_ns - stare.from_utc_ns) / NS_PER_S
    t = streak.t_mid_utc_ns
    late = np.arange(-span_s / 2.0 - _FINE_S, span_s / 2.0 + 2.0 * _FINE_S, _FINE_S)
    states = awaited.states(t - np.rint(late * NS_PER_S).astype(np.int64))
    lines = states[0] - site_gcrs(site, np.array([t]))[0][0]
    ra, dec = unit_to_direction(lines)
    middle_ra, middle_dec = _middle(streak)
    away = np.asarray(separation_deg(ra, dec, middle_ra, middle_dec))
    if not np.all(np.isfinite(away)):
        return None
    best = int(np.argmin(away))
    if best in (0, len(late) - 1) or away[best] > _FARTHEST_DEG:
        return None
    place = expected_at(awaited, site, t, float(late[best]))
    rate = streak.rate_arcsec_s
    speed, expected = float(np.hypot(*rate)), place.speed_arcsec_s
    cosine = float(rate @ place.rate_arcsec_s) / (speed * expected)
    if abs(speed / expected - 1.0) > _SPEED or abs(cosine) < np.cos(np.radians(_TURN_DEG)):
        return None
    east = wrap_180(middle_ra - place.ra_icrs_deg)
    off = np.array([east * np.cos(np.radians(middle_dec)), middle_dec - place.dec_icrs_deg])
    ahead = place.rate_arcsec_s / expected
    along_s = 3600.0 * float(off @ ahead) / expected
    found = Came(
        late_s=float(late[best]) - along_s,
        across_arcmin=60.0 * float(off[1] * ahead[0] - off[0] * ahead[1]),
    )
    return found, streak if cosine > 0.0 else streak.reversed


def _middle(streak: StreakEnds) -> tuple[float, float]:
    turn = float(np.diff(streak.ra_icrs_deg)[0])
    ra = float(streak.ra_icrs_deg[0]) + wrap_180(turn) / 2.0
    return ra % 360.0, float(np.mean(streak.dec_icrs_deg))
