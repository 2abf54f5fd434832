"""Passes awaited at a point of the orbit: where, and the offset by the streak. Pure.

Elements are less accurate along the orbit than across it. So the telescope points at one point of
the orbit until the object has surely passed. The first streak gives the object's delay and its
offset across the orbit.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from itertools import chain

import numpy as np

from rsoconsole.config import LimitsConfig
from rsoconsole.orbits import (
    ASSUMED,
    CatalogueEntry,
    ElementErrors,
    KnownOrbit,
    PredictedPosition,
    PredictedSkyPath,
    Satellite,
    StreakEnds,
)
from rsoconsole.pipeline.leaps.leaps import Leap, NoLeap, Telescope, next_leap
from rsoconsole.pipeline.visibility.passes import night_passes
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import (
    LIT_SHARE,
    IntArray,
    LimitName,
    Limits,
    Pose,
    astrometric_places,
    lit_fraction,
    separation_deg,
    site_gcrs,
    unit_to_direction,
    wrap_180,
)
from rsoconsole.words import NS_PER_DAY, NS_PER_S

_MOST = 500
CLOSED_S = 0.05
"""Time from the end of an exposure until the shutter has surely closed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PassPlan:
    """Leaps planned for a pass, on condition that each succeeds."""

    leaps: tuple[Leap, ...]
    end: NoLeap
    """Reason why no leap follows the last one."""

    @property
    def flip_count(self) -> int:
        """Number of times that the mount changes the side of its pier."""
        return sum(each.flips for each in self.leaps)

    @property
    def longest_gap_s(self) -> float:
        """Longest time between two successive mid-exposures; 0 with fewer than two."""
        middles = [each.t_mid_utc_ns for each in self.leaps]
        return float(np.max(np.diff(middles))) / NS_PER_S if len(middles) > 1 else 0.0


def plan_pass(
    path: PredictedSkyPath,
    start: Pose,
    now_utc_ns: int,
    telescope: Telescope,
    *,
    first: Leap | None = None,
    sure_from: int | None = None,
) -> PassPlan:
    """Plan leaps one after another until the satellite sets or a limit ends the pass.

    ``first``: leap under way; None: none. ``sure_from``: number, from 1, of the leap from which on
    the next slew is ordered as the shutter closes, not after read-out; None: always after
    read-out.
    """
    leaps: list[Leap] = []
    pose, now = start, now_utc_ns
    while len(leaps) < _MOST:
        found = next_leap(path, pose, now, telescope) if leaps or first is None else first
        if isinstance(found, NoLeap):
            return PassPlan(leaps=tuple(leaps), end=found)
        leaps.append(found)
        waits = sure_from is None or len(leaps) < sure_from
        pause_s = telescope.terms.readout_s if waits else CLOSED_S
        now = found.t_close_utc_ns + round(pause_s * NS_PER_S)
        ra, dec = found.place.direction_deg
        pose = Pose(t_utc_ns=now, ra_icrs_deg=ra, dec_icrs_deg=dec, pier_side=found.side)
    return PassPlan(leaps=tuple(leaps), end=NoLeap(kind="it sets"))


@dataclass(frozen=True, slots=True, kw_only=True)
class StarePoint:
    """Point of an orbit at which the telescope stares until the object has surely passed it."""

    t_through_utc_ns: int
    from_utc_ns: int
    until_utc_ns: int
    point_gcrs_km: tuple[float, float, float]

    def direction_deg(self, site: Site, t_utc_ns: int) -> tuple[float, float]:
        """ICRS direction (RA, Dec) of the point of the orbit, as seen from the site at an instant.

        Light time and aberration (20 arcsec at most) are left out.
        """
        places, _ = site_gcrs(site, np.array([t_utc_ns]))
        ra, dec = unit_to_direction(np.array(self.point_gcrs_km) - places[0])
        return float(ra), float(dec)


def open_shutter_share(exposure_s: float, latency_s: float, readout_s: float) -> float:
    """Return the fraction of time for which the shutter is open in a series of exposures.

    ``latency_s``: time from the order of an exposure to its beginning; ``readout_s``: from its end
    to the next order.
    """
    return exposure_s / (exposure_s + latency_s + readout_s)


StatesOf = Callable[[IntArray], tuple[FloatArray, FloatArray]]
"""GCRS positions (km) and velocities (km/s), (N, 3) each, at instants (N,) in UTC ns."""
SIGMAS = 3.0
_STEP_S = 5.0
_TURN_DEG, _SPEED = 15.0, 0.2
"""Largest turn, and relative difference in speed, of a streak from the elements' prediction."""
_FINE_S = 0.05
_FARTHEST_DEG = 3.0
"""Largest distance across its way: elements are off by arc minutes there."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AwaitedPass:
    """Pass of an object, and the point at which the telescope stares for it."""

    name: str
    states: StatesOf
    stare: StarePoint
    set_utc_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class PassOffset:
    """Offset of a pass from its elements, measured by the first streak."""

    late_s: float
    across_arcmin: float
    """Offset across the motion, positive to the left of it (north where it moves east)."""


def next_awaited_pass(
    entry: CatalogueEntry,
    site: Site,
    now_utc_ns: int,
    *,
    limits: LimitsConfig,
    held: Limits,
    late_sigma_s: float,
    lifted: Collection[LimitName] = (),
    errors: ElementErrors = ASSUMED,
) -> AwaitedPass | None:
    """Return the first pass within a day that the telescope can await; None without one.

    The object must be sunlit where it is awaited. ``held``: the telescope's limits; ``lifted``:
    those of them that do not apply; ``late_sigma_s``: lowest sigma, s, of the object's time along
    its orbit; a larger one by ``errors`` of its elements replaces it.
    """
    satellite = Satellite(entry)
    span = (now_utc_ns, now_utc_ns + NS_PER_DAY)
    passes = night_passes([entry], site, span, limits, is_low_only=False, errors=errors)
    for each in chain.from_iterable(some for _, some, _ in passes):
        if each.lit_from_utc_ns is None:
            continue
        awaited = awaited_pass(
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


def awaited_pass(
    name: str,
    states: StatesOf,
    site: Site,
    *,
    up_utc_ns: tuple[int, int],
    sigma_s: float,
    held: Limits,
    now_utc_ns: int,
    lifted: Collection[LimitName] = (),
) -> AwaitedPass | None:
    """Return a pass with the earliest point at which it can be awaited; None without one.

    At that point the object is sunlit, and the telescope within the limits ``held`` (but for those
    ``lifted``) from ``SIGMAS`` times ``sigma_s`` before the predicted time until as long after it.
    ``up_utc_ns``: start and end of the pass.
    """
    span_ns = round(SIGMAS * sigma_s * NS_PER_S)
    for t in range(up_utc_ns[0], up_utc_ns[1], round(_STEP_S * NS_PER_S)):
        point = states(np.array([t]))[0]
        # Where it may come is looked at in time for the earliest that it may be.
        if not np.all(np.isfinite(point)) or t - span_ns < now_utc_ns:
            continue
        if lit_fraction(point, np.array([t]))[0] < LIT_SHARE:
            continue
        x, y, z = point[0].tolist()
        stare = StarePoint(
            t_through_utc_ns=t,
            from_utc_ns=t - span_ns,
            until_utc_ns=t + span_ns,
            point_gcrs_km=(x, y, z),
        )
        if all(_may_look(stare, site, at, held, lifted) for at in (t - span_ns, t, t + span_ns)):
            return AwaitedPass(name=name, states=states, stare=stare, set_utc_ns=up_utc_ns[1])
    return None


def is_in_earth_shadow(orbit: KnownOrbit, t_utc_ns: int) -> bool:
    """True where the object is wholly in the Earth's shadow."""
    at = np.array([t_utc_ns])
    return bool(lit_fraction(orbit.states(at)[0], at)[0] <= 0.0)


def _may_look(
    stare: StarePoint, site: Site, t_utc_ns: int, held: Limits, lifted: Collection[LimitName]
) -> bool:
    ra, dec = stare.direction_deg(site, t_utc_ns)
    pose = Pose(t_utc_ns=t_utc_ns, ra_icrs_deg=ra, dec_icrs_deg=dec, pier_side=None)
    return held.refuse_pose(pose, is_slewing=False, lifted=lifted) is None


def expected_position(
    awaited: AwaitedPass, site: Site, t_utc_ns: int, late_s: float
) -> PredictedPosition:
    """Return the predicted position of an object that is late by ``late_s``, at an instant.

    Its covariance is a placeholder, 1 arcsec^2 on each axis.
    """
    moved_ns = round(late_s * NS_PER_S)

    def states(t: IntArray) -> tuple[FloatArray, FloatArray]:
        return awaited.states(t - moved_ns)

    seen = astrometric_places(states, site, np.array([t_utc_ns]))
    dec = float(seen.dec_icrs_deg[0])
    east = float(seen.ra_rate_deg_s[0]) * np.cos(np.radians(dec))
    return PredictedPosition(
        t_utc_ns=t_utc_ns,
        ra_icrs_deg=float(seen.ra_icrs_deg[0]),
        dec_icrs_deg=dec,
        rate_arcsec_s=3600.0 * np.array([east, float(seen.dec_rate_deg_s[0])]),
        covariance_arcsec2=np.eye(2),
    )


def measured_pass_offset(
    awaited: AwaitedPass, site: Site, streak: StreakEnds
) -> tuple[PassOffset, StreakEnds] | None:
    """Return a pass's offset by one streak, and the streak with its ends in order of time.

    None where the streak is not on the object's path within the time of waiting, or differs from
    the predicted motion in direction or speed.
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
    place = expected_position(awaited, site, t, float(late[best]))
    rate = streak.rate_arcsec_s
    speed, expected = float(np.hypot(*rate)), place.speed_arcsec_s
    cosine = float(rate @ place.rate_arcsec_s) / (speed * expected)
    if abs(speed / expected - 1.0) > _SPEED or abs(cosine) < np.cos(np.radians(_TURN_DEG)):
        return None
    east = wrap_180(middle_ra - place.ra_icrs_deg)
    off = np.array([east * np.cos(np.radians(middle_dec)), middle_dec - place.dec_icrs_deg])
    ahead = place.rate_arcsec_s / expected
    along_s = 3600.0 * float(off @ ahead) / expected
    found = PassOffset(
        late_s=float(late[best]) - along_s,
        across_arcmin=60.0 * float(off[1] * ahead[0] - off[0] * ahead[1]),
    )
    return found, streak if cosine > 0.0 else streak.reversed


def _middle(streak: StreakEnds) -> tuple[float, float]:
    turn = float(np.diff(streak.ra_icrs_deg)[0])
    ra = float(streak.ra_icrs_deg[0]) + wrap_180(turn) / 2.0
    return ra % 360.0, float(np.mean(streak.dec_icrs_deg))
