"""Limits on where a telescope may look and turn: checked for every slew and motion, at 1 Hz.

Hour angles are of date, altitudes without refraction (a little lower than the apparent ones: on the
safe side). The Sun's cone is checked unless the Sun is more than 6 deg below the horizon. Near a
pole the hour angle has no meaning and is not checked.
"""

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from rsoconsole.config import LimitsConfig, MountConfig
from rsoconsole.records import FloatArray, Site, SlewRefusal
from rsoconsole.sky.epoch import HourlySky, hourly_sky
from rsoconsole.sky.frames import PierSide
from rsoconsole.sky.limits import _sun_passage, refusals
from rsoconsole.sky.limits._sun_passage import SlewPath, slew_paths, sun_passage
from rsoconsole.sky.limits.margins import (
    SUN_HARMLESS_DEG,
    Margin,
    TrackedPose,
    hour_angle_deg,
    parking_margins,
    slewing_margins,
    sun_altitude_deg,
    tracking_margins,
)
from rsoconsole.sky.limits.refusals import LimitName, Refusal
from rsoconsole.sky.limits.way_ahead import (
    SIDEREAL_DEG_S,
    MountRates,
    extrapolate_path,
    keeps_to_slew_path,
    path_ahead_margins,
)
from rsoconsole.sky.times import IntArray, iso_to_utc_ns
from rsoconsole.words import NS_PER_S, utc_ns_to_iso

__all__ = ["LimitName", "Limits", "PierSide", "Pose", "Refusal"]

STALE_S = 300.0
AHEAD_S = 2 * 3600.0
UNTIL_S = 4 * 3600.0
FIRST_UTC_NS = iso_to_utc_ns("2000-01-01T00:00:00Z")
LAST_UTC_NS = iso_to_utc_ns("2100-01-01T00:00:00Z")
LESS_BAD_DEG = 0.002
"""Growth of an excess, deg, that does not count as worse: reported positions are noisy."""
LOWER_DEG = 1.0
"""How much lower, deg, a motion that began below a least altitude may go before it rises."""
_SLEW_STEP_S = 2.0
_SUN_STEP_S = 300.0
_WATCH_STEP_S = 5.0
_WATCH_FINE_S = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Reported position of a mount at one instant; ``pier_side`` None: unknown, or a fork."""

    t_utc_ns: int
    ra_icrs_deg: float
    dec_icrs_deg: float
    pier_side: PierSide | None


class Limits:
    """Limits of one site and mount: which slews, poses and motions they refuse, and why.

    Keeps no state between calls; quick enough to check before every slew.
    """

    def __init__(self, site: Site, limits: LimitsConfig, mount: MountConfig) -> None:
        self._site = site
        self._limits = limits
        self._mount = mount

    def refuse_slew(
        self,
        start: Pose,
        ra_icrs_deg: float,
        dec_icrs_deg: float,
        *,
        t_aim_utc_ns: int,
        t_until_utc_ns: int,
        lifted: Collection[LimitName] = (),
    ) -> Refusal | None:
        """Return the reason to refuse this slew; None when all of it is safe.

        ``start`` is where the mount stands now. Checked are:

        - the instants: the aim at most 5 min ago and 2 h ahead; the end neither before now or the
          aim nor more than 4 h ahead; the clock between 2000 and 2100
        - the directions: finite and in range
        - the target, from arrival at full slew rate until ``t_until_utc_ns``, on the side of the
          pier that the mount will choose (where that is unknown, on both)
        - the Sun's cone along the path (``sun_passage``), unless the Sun is more than 6 deg below
          the horizon; a path that begins inside the cone may only lead away from the Sun, and out
        - twilight

        Limits in ``lifted`` are not checked; instants and directions always are.
        """
        fault = _slew_times_fault(start.t_utc_ns, t_aim_utc_ns, t_until_utc_ns) or (
            _direction_fault(start.ra_icrs_deg, start.dec_icrs_deg)
            or _direction_fault(ra_icrs_deg, dec_icrs_deg)
        )
        if fault is not None:
            return fault
        epoch = hourly_sky(start.t_utc_ns)
        target = self._track(epoch, ra_icrs_deg, dec_icrs_deg, None)
        candidates = list(self._ways(epoch, start, target))
        shortest_deg = min(max(way.travel_deg) for way, _ in candidates)
        travel_ns = round(shortest_deg / self._mount.slew_rate_deg_s * NS_PER_S)
        arrival_ns = start.t_utc_ns + travel_ns
        t_ns = _instants(arrival_ns, max(arrival_ns, t_until_utc_ns), _SLEW_STEP_S)
        for side in dict.fromkeys(side for _, side in candidates):
            track = self._track(epoch, ra_icrs_deg, dec_icrs_deg, side)
            for margin in self._while_tracking(track, t_ns, lifted, is_level_held=False):
                worst = int(np.argmax(margin.excess_deg))
                if margin.excess_deg[worst] > 0.0:
                    return margin.refusal_at(worst, (int(t_ns[worst]) - start.t_utc_ns) / NS_PER_S)
        if "Sun" not in lifted:
            fault = self._sun_on(epoch, (way for way, _ in candidates), start.t_utc_ns)
        if fault is None and "twilight" not in lifted:
            fault = self._twilight(epoch, start.t_utc_ns, int(t_ns[-1]))
        return fault

    def arrival_side(
        self, start: Pose, ra_icrs_deg: float, dec_icrs_deg: float, t_utc_ns: int
    ) -> PierSide | None:
        """Side of the pier after a slew commanded at this instant; None: a fork, or unknown.

        The side changes only where the target is at least ``flip_hysteresis_deg`` from the
        meridian.
        """
        fault = _instant_fault(t_utc_ns) or _direction_fault(ra_icrs_deg, dec_icrs_deg)
        if fault is not None or self._mount.type == "fork":
            return None
        track = self._track(hourly_sky(t_utc_ns), ra_icrs_deg, dec_icrs_deg, None)
        ha_deg = self._hour_angle_at(track, t_utc_ns)
        return _sun_passage.pier_side_after_slew(
            ha_deg, start.pier_side, self._mount.flip_hysteresis_deg
        )

    def travel_deg(
        self, start: Pose, ra_icrs_deg: float, dec_icrs_deg: float
    ) -> tuple[float, float]:
        """Travel of the polar and the declination axis, degrees, in a slew begun at ``start``.

        The longest possible path counts where the side of the pier, or at a pole the polar axis, is
        unknown.
        """
        epoch = hourly_sky(start.t_utc_ns)
        target = self._track(epoch, ra_icrs_deg, dec_icrs_deg, None)
        turns = (way.travel_deg for way, _ in self._ways(epoch, start, target))
        return max(turns, key=max, default=(0.0, 0.0))

    def refuse_pose(
        self,
        pose: Pose,
        *,
        is_slewing: bool,
        is_parking: bool = False,
        lifted: Collection[LimitName] = (),
        before: Pose | None = None,
    ) -> Refusal | None:
        """Return the limit that a reported pose violates; None when it violates none.

        What is checked depends on what the mount does:

        - slewing, in a slew that ``refuse_slew`` has allowed: the Sun's cone, and how far the polar
          axis has turned (a fork: its hour angle); the altitude is not checked
        - slewing to its park position: the same, and no more than 5 deg below the level horizon
        - tracking or standing: all but twilight, and the pier's limit only where the side is known

        ``before`` is the pose reported last: in a slew, a limit violated then and not worse now is
        not reported, so that the mount can leave the forbidden place.
        """
        fault = _instant_fault(pose.t_utc_ns) or _direction_fault(
            pose.ra_icrs_deg, pose.dec_icrs_deg
        )
        if fault is not None:
            return fault
        was_deg: dict[LimitName, float] = {}
        hold = self._parking_at if is_parking else self._slewing_at
        if not (is_slewing or is_parking):
            hold = self._tracking_at
        elif before is not None and _instant_fault(before.t_utc_ns) is None:
            was_deg = _excesses_deg(hold(before, lifted))
        for margin in hold(pose, lifted):
            excess_deg = margin.excess_deg[0]
            before_deg = was_deg.get(margin.limit, 0.0)
            is_way_out = before_deg > 0.0 and excess_deg <= before_deg + LESS_BAD_DEG
            if excess_deg > 0.0 and not is_way_out:
                return margin.refusal_at(0)
        return None

    def refuse_motion(
        self,
        pose: Pose,
        rates: MountRates | None,
        ahead_s: float,
        *,
        lifted: Collection[LimitName] = (),
        before: Pose | None = None,
        rested: Pose | None = None,
    ) -> Refusal | None:
        """Return the reason to stop a motion whose end is unknown; None while it may go on.

        - rates: the motion is extrapolated at these for ``ahead_s`` seconds; None: unknown, only
          the pose itself is checked
        - lifted: limits that are not checked; twilight never is
        - before: pose reported last; a limit violated there counts only if it is worse now, so
          that the mount can leave a forbidden place
        - rested: pose where the motion began; from below a least altitude it may first go a little
          lower
        """
        fault = _instant_fault(pose.t_utc_ns) or _direction_fault(
            pose.ra_icrs_deg, pose.dec_icrs_deg
        )
        if fault is not None:
            return fault
        last_deg = _excesses_deg(self._moving(before, None, 0.0, lifted)[1])
        first_deg = _excesses_deg(self._moving(rested, None, 0.0, lifted)[1])
        later_s, margins = self._moving(pose, rates, ahead_s, lifted)
        for margin in margins:
            excess_deg = margin.excess_deg
            allowed_deg = last_deg.get(margin.limit, 0.0)
            began_deg = first_deg.get(margin.limit, 0.0)
            if margin.limit in ("altitude", "horizon") and began_deg > 0.0:
                allowed_deg = max(allowed_deg, began_deg + LOWER_DEG)
            if excess_deg[0] > 0.0 and not 0.0 < excess_deg[0] <= allowed_deg + LESS_BAD_DEG:
                return margin.refusal_at(0)
            if excess_deg[0] <= 0.0:
                allowed_deg = 0.0
            beyond = np.flatnonzero(excess_deg > max(allowed_deg + LESS_BAD_DEG, 0.0))
            if beyond.size:
                index = int(beyond[0])
                return margin.refusal_at(index, float(later_s[index]))
        return None

    def is_on_slew_path(
        self, start: Pose, to_icrs_deg: tuple[float, float], pose: Pose, rates: MountRates | None
    ) -> bool:
        """True where a mount is on the path of a slew begun at ``start``, and moves to its end.

        ``refuse_slew`` has allowed only such a motion. ``pose``: where the mount is now. ``rates``
        None: unknown, only the position is checked.
        """
        for one in (start, pose):
            if _instant_fault(one.t_utc_ns) or _direction_fault(one.ra_icrs_deg, one.dec_icrs_deg):
                return False
        epoch = hourly_sky(start.t_utc_ns)
        target, place = self._track(epoch, *to_icrs_deg, None), self._pose_track(pose)
        # While it slews the mount turns with the sky: its way is one of the first instant.
        ha_deg = self._hour_angle_at(place, start.t_utc_ns)
        return any(
            keeps_to_slew_path(way, place, ha_deg, rates, self._site.latitude_deg)
            for way, _ in self._ways(epoch, start, target)
        )

    def _moving(
        self,
        pose: Pose | None,
        rates: MountRates | None,
        ahead_s: float,
        lifted: Collection[LimitName],
    ) -> tuple[FloatArray, Iterable[Margin]]:
        """Seconds until each place ahead, and every limit there; nothing for no pose."""
        if pose is None or _instant_fault(pose.t_utc_ns) is not None:
            return np.zeros(1), ()
        rates = rates or MountRates(ra_deg_s=SIDEREAL_DEG_S, dec_deg_s=0.0)
        way = extrapolate_path(self._site, self._pose_track(pose), pose.t_utc_ns, rates, ahead_s)
        return way.later_s, path_ahead_margins(
            self._site, self._limits, self._mount, way, lifted=lifted
        )

    def margins_deg(self, pose: Pose) -> tuple[tuple[LimitName, float], ...]:
        """Degrees left to each limit for a mount that tracks at this pose, the least first.

        Negative beyond the limit. The pier's limit is left out where the side is unknown. Empty
        where the instant or the direction is invalid.
        """
        fault = _instant_fault(pose.t_utc_ns) or _direction_fault(
            pose.ra_icrs_deg, pose.dec_icrs_deg
        )
        if fault is not None:
            return ()
        margin = self._tracking_at(pose, ())
        margins = ((each.limit, -float(each.excess_deg[0])) for each in margin)
        return tuple(sorted(margins, key=lambda margin: margin[1]))

    def next_limit(
        self, pose: Pose, horizon_s: float = 6 * 3600.0, *, lifted: Collection[LimitName] = ()
    ) -> tuple[int, Refusal] | None:
        """Find the first instant (to 0.1 s) at which tracking from this pose violates a limit.

        Returns the instant and the refusal; None where there is none within ``horizon_s``. Twilight
        is not checked. The edge of the Sun's cone is good to an arcsecond: half a minute of the
        Sun's own motion. A German mount that does not report its side of the pier is taken to be
        west of it up to the hour angle ``past_meridian_deg``, and east of it beyond.
        """
        fault = _instant_fault(pose.t_utc_ns) or _direction_fault(
            pose.ra_icrs_deg, pose.dec_icrs_deg
        )
        if fault is not None:
            return pose.t_utc_ns, fault
        track = self._pose_track(pose)
        if track.side is None:
            is_west = self._hour_angle_at(track, pose.t_utc_ns) <= self._limits.past_meridian_deg
            track = self._pose_track(pose, "west" if is_west else "east")
        t_ns = _instants(pose.t_utc_ns, pose.t_utc_ns + round(horizon_s * NS_PER_S), _WATCH_STEP_S)
        first = _first_violation(self._while_tracking(track, t_ns, lifted))
        if first is not None and first[0] > 0:
            t_ns = _instants(int(t_ns[first[0] - 1]), int(t_ns[first[0]]), _WATCH_FINE_S)
            first = _first_violation(self._while_tracking(track, t_ns, lifted))
        if first is None:
            return None
        t_utc_ns = int(t_ns[first[0]])
        return t_utc_ns, first[1].refusal_at(first[0], (t_utc_ns - pose.t_utc_ns) / NS_PER_S)

    def _track(
        self, epoch: HourlySky, ra_icrs_deg: float, dec_icrs_deg: float, side: PierSide | None
    ) -> TrackedPose:
        ra_deg, dec_deg = epoch.icrs_to_apparent_deg(ra_icrs_deg, dec_icrs_deg)
        return TrackedPose(epoch=epoch, ra_deg=ra_deg, dec_deg=dec_deg, side=side)

    def _pose_track(self, pose: Pose, side: PierSide | None = None) -> TrackedPose:
        epoch = hourly_sky(pose.t_utc_ns)
        return self._track(epoch, pose.ra_icrs_deg, pose.dec_icrs_deg, side or pose.pier_side)

    def _hour_angle_at(self, track: TrackedPose, t_utc_ns: int) -> float:
        return float(hour_angle_deg(self._site, track, np.array([t_utc_ns]))[0])

    def _ways(
        self, epoch: HourlySky, start: Pose, target: TrackedPose
    ) -> Iterator[tuple[SlewPath, PierSide | None]]:
        here = self._track(epoch, start.ra_icrs_deg, start.dec_icrs_deg, start.pier_side)
        return slew_paths(
            self._mount,
            self._limits,
            self._site.latitude_deg,
            (self._hour_angle_at(here, start.t_utc_ns), here.dec_deg, here.side),
            (self._hour_angle_at(target, start.t_utc_ns), target.dec_deg),
        )

    def _while_tracking(
        self,
        track: TrackedPose,
        t_ns: IntArray,
        lifted: Collection[LimitName],
        *,
        is_level_held: bool = True,
    ) -> Iterator[Margin]:
        return tracking_margins(
            self._site,
            self._limits,
            self._mount,
            track,
            t_ns,
            lifted=lifted,
            is_level_held=is_level_held,
        )

    def _tracking_at(self, pose: Pose, lifted: Collection[LimitName]) -> Iterator[Margin]:
        return self._while_tracking(self._pose_track(pose), np.array([pose.t_utc_ns]), lifted)

    def _slewing_at(self, pose: Pose, lifted: Collection[LimitName]) -> Iterator[Margin]:
        track, t_ns = self._pose_track(pose), np.array([pose.t_utc_ns])
        return slewing_margins(self._site, self._limits, self._mount, track, t_ns, lifted=lifted)

    def _parking_at(self, pose: Pose, lifted: Collection[LimitName]) -> Iterator[Margin]:
        track, t_ns = self._pose_track(pose), np.array([pose.t_utc_ns])
        return parking_margins(self._site, self._limits, self._mount, track, t_ns, lifted=lifted)

    def _sun_on(
        self, epoch: HourlySky, candidates: Iterable[SlewPath], t_utc_ns: int
    ) -> Refusal | None:
        if sun_altitude_deg(self._site, epoch, np.array([t_utc_ns]))[0] <= SUN_HARMLESS_DEG:
            return None
        sun_ra_deg, sun_dec_deg = epoch.sun_apparent_deg(t_utc_ns)
        sun_ha_deg = float(epoch.sidereal_deg(self._site.longitude_deg, t_utc_ns) - sun_ra_deg)
        cone_deg, rate_deg_s = self._limits.sun_cone_deg, self._mount.slew_rate_deg_s
        for way in candidates:
            near = sun_passage(way, sun_ha_deg, float(sun_dec_deg), cone_deg, rate_deg_s)
            if near is not None:
                return refusals.sun_passage_refusal(
                    near.from_sun_deg, near.kept_deg, is_way_out=near.is_way_out
                )
        return None

    def _twilight(self, epoch: HourlySky, from_ns: int, to_ns: int) -> Refusal | None:
        t_ns = _instants(from_ns, to_ns, _SUN_STEP_S)
        altitude_deg = float(np.max(sun_altitude_deg(self._site, epoch, t_ns)))
        if altitude_deg <= self._limits.twilight_deg:
            return None
        return refusals.beyond_bound_refusal("twilight", altitude_deg, self._limits.twilight_deg)


def _instants(from_ns: int, to_ns: int, step_s: float) -> IntArray:
    """Instants from one end to the other, both included, in steps of at most ``step_s``."""
    steps = max(1, int(np.ceil((to_ns - from_ns) / (step_s * NS_PER_S))))
    return np.asarray(from_ns + (to_ns - from_ns) * np.arange(steps + 1) // steps, np.int64)


def _excesses_deg(margins: Iterable[Margin]) -> dict[LimitName, float]:
    """Excess over each limit at the first instant, deg."""
    return {margin.limit: float(margin.excess_deg[0]) for margin in margins}


def _first_violation(margin: Iterable[Margin]) -> tuple[int, Margin] | None:
    """Find the earliest instant at which any limit is violated; of two at once the graver."""
    violated = [(int(np.argmax(one.excess_deg > 0.0)), one) for one in margin]
    violated = [(index, one) for index, one in violated if one.excess_deg[index] > 0.0]
    return min(violated, key=lambda found: found[0]) if violated else None


def _direction_fault(ra_icrs_deg: float, dec_icrs_deg: float) -> Refusal | None:
    if 0.0 <= ra_icrs_deg < 360.0 and -90.0 <= dec_icrs_deg <= 90.0:  # NaN fails too
        return None
    return refusals.invalid_direction_refusal(ra_icrs_deg, dec_icrs_deg)


def _instant_fault(t_utc_ns: int) -> Refusal | None:
    if FIRST_UTC_NS <= t_utc_ns < LAST_UTC_NS:
        return None
    try:
        said = utc_ns_to_iso(t_utc_ns, 0)
    except (ValueError, OverflowError, TypeError):
        said = f"{t_utc_ns} ns"
    return refusals.instant_refusal(SlewRefusal(kind="clock", detail=said))


def _slew_times_fault(now_ns: int, aim_ns: int, until_ns: int) -> Refusal | None:
    """Return the refusal of impossible instants, checked in the order now, aim, until."""
    fault = _instant_fault(now_ns) or _instant_fault(aim_ns) or _instant_fault(until_ns)
    if fault is not None:
        return fault
    aim_s, until_s = (aim_ns - now_ns) / NS_PER_S, (until_ns - now_ns) / NS_PER_S
    if aim_s < -STALE_S:
        return refusals.instant_refusal(SlewRefusal.by_instant("aimed before", aim_s))
    if aim_s > AHEAD_S:
        return refusals.instant_refusal(SlewRefusal.by_instant("aimed ahead", aim_s))
    if until_s < 0.0 or until_ns < aim_ns:
        return refusals.instant_refusal(SlewRefusal(kind="ends before"))
    if until_s > UNTIL_S:
        return refusals.instant_refusal(SlewRefusal.by_instant("ends ahead", until_s))
    return None
