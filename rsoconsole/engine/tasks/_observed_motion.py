"""The mount's motion at one report: measured where possible, else assumed cautiously.

The driver's own states (slewing, tracking, parked) may be wrong. Motions that this program has
ordered are distinguished from others.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from rsoconsole.engine.aim.instrument_controller import FAR_OFF_DEG, NS, Ordered
from rsoconsole.instruments import SIDEREAL_ARCSEC_S, MountReport
from rsoconsole.sky import Limits, MountRates, Pose, separation_deg, wrap_180

How = Literal["stands", "tracks", "slews"]
Own = Literal["slew", "park"]

MOVED_ARCSEC = 200.0
"""Turn between two looks, arcsec, that counts as a slew: above the coarsest driver's step."""
LONGEST_APART_S = 10.0
STARTS_WITHIN_S = 30.0
"""Time after an order within which a mount that follows the order starts to move, s."""
PARKS_WITHIN_S = 900.0
TURNS_WITHIN_S = 3.0
"""Time after an order in which an axis may still move the old way before it turns round, s."""
FRESH_S = 5.0
PARKED_S = 5.0
"""Time in which a mount that reports to be parked may still come to rest, s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservedMotion:
    """The mount's motion at one report: its kind, and its rates during a slew."""

    how: How
    rates: MountRates | None = None
    """Rates of the axes during a slew; None where they are not known."""


def pose_of(report: MountReport) -> Pose:
    """Return the direction and pier side of a mount's report as a pose."""
    return Pose(
        t_utc_ns=report.t_utc_ns,
        ra_icrs_deg=report.ra_icrs_deg,
        dec_icrs_deg=report.dec_icrs_deg,
        pier_side=report.pier_side,
    )


def observed_motion(report: MountReport, before: MountReport | None) -> ObservedMotion:
    """Return the mount's motion from its report; ``before``: the report of the look before.

    A slow motion that was measured counts as tracking. A motion not measured yet is a slew where
    the direction has changed since the last look or the driver reports a slew; it is tracking where
    the driver reports that.
    """
    motion = report.motion
    if motion.kind == "moves":
        if not motion.is_fast:
            return ObservedMotion(how="tracks")
        rates = MountRates(
            ra_deg_s=motion.ra_rate_arcsec_s / 3600.0, dec_deg_s=motion.dec_rate_arcsec_s / 3600.0
        )
        return ObservedMotion(how="slews", rates=rates)
    if motion.kind != "unknown":
        return ObservedMotion(how=motion.kind)
    rates_seen = _rates_between(before, report)
    if rates_seen is not None or report.is_slewing:
        return ObservedMotion(how="slews", rates=rates_seen)
    return ObservedMotion(how="tracks" if report.is_tracking else "stands")


def _rates_between(before: MountReport | None, report: MountReport) -> MountRates | None:
    """Return the rates between two looks; None where they do not show a slew."""
    if before is None:
        return None
    apart_s = (report.t_utc_ns - before.t_utc_ns) / NS
    if not 0.2 <= apart_s <= LONGEST_APART_S or _turned_arcsec(before, report) <= MOVED_ARCSEC:
        return None
    return MountRates(
        ra_deg_s=wrap_180(report.ra_icrs_deg - before.ra_icrs_deg) / apart_s,
        dec_deg_s=(report.dec_icrs_deg - before.dec_icrs_deg) / apart_s,
    )


def _turned_arcsec(before: MountReport, report: MountReport) -> float:
    """Return the larger turn of both axes, arcsec.

    In right ascension it is the smaller of the turns against a tracking and a standing mount.
    """
    apart_s = (report.t_utc_ns - before.t_utc_ns) / NS
    ra_arcsec = wrap_180(report.ra_icrs_deg - before.ra_icrs_deg) * 3600.0
    dec_arcsec = (report.dec_icrs_deg - before.dec_icrs_deg) * 3600.0
    return max(min(abs(ra_arcsec), abs(ra_arcsec - SIDEREAL_ARCSEC_S * apart_s)), abs(dec_arcsec))


class OwnMotion:
    """Follows the motion that this program ordered last, until it is over."""

    def __init__(self, ordered: Callable[[], Ordered | None]) -> None:
        self._ordered = ordered
        self._of: Ordered | None = None
        self._start: Pose | None = None
        self._last: Pose | None = None
        self._is_over = False

    def update(self, report: MountReport, pose: Pose, seen: ObservedMotion) -> None:
        """Process one report of the mount."""
        ordered = self._ordered()
        if ordered is not self._of:
            last = self._last
            is_fresh = last is not None and 0 <= pose.t_utc_ns - last.t_utc_ns < FRESH_S * NS
            self._of, self._start, self._is_over = ordered, last if is_fresh else pose, False
        self._last = pose
        if ordered is None or self._is_over:
            return
        since_s = (pose.t_utc_ns - ordered.t_utc_ns) / NS
        to = ordered.to_icrs_deg
        is_there = (
            report.is_parked and report.motion.is_at_rest
            if to is None
            else separation_deg(pose.ra_icrs_deg, pose.dec_icrs_deg, *to) < FAR_OFF_DEG
        )
        if seen.how != "slews":
            self._is_over = is_there or since_s > STARTS_WITHIN_S
        elif to is None:
            self._is_over = since_s > PARKS_WITHIN_S

    def kind(self, pose: Pose, seen: ObservedMotion, limits: Limits) -> Own | None:
        """Return which order a slew carries out; None where this program did not order it."""
        ordered, start = self._of, self._start
        if ordered is None or start is None or self._is_over:
            return None
        if ordered.to_icrs_deg is None:
            return "park"
        if 0 <= pose.t_utc_ns - ordered.t_utc_ns < TURNS_WITHIN_S * NS:
            return "slew"
        is_own = limits.is_on_slew_path(start, ordered.to_icrs_deg, pose, seen.rates)
        return "slew" if is_own else None


class ParkedMotion:
    """Detects motion of a mount that reports to be parked."""

    def __init__(self) -> None:
        self._looks: deque[MountReport] = deque()
        """Reports of the last seconds since the mount has reported to be parked."""
        self._since_ns = 0

    def motion_while_parked(self, report: MountReport) -> Literal["tracks", "moves"] | None:
        """Process a report; return how a parked mount moves.

        None where the mount rests, is not parked, or was not observed for long enough.
        """
        if not report.is_parked:
            self._looks.clear()
            return None
        if not self._looks or report.t_utc_ns < self._looks[-1].t_utc_ns:
            self._looks.clear()
            self._since_ns = report.t_utc_ns
        self._looks.append(report)
        window_ns = report.t_utc_ns - round(PARKED_S * NS)
        while len(self._looks) > 1 and self._looks[1].t_utc_ns <= window_ns:
            self._looks.popleft()
        first = self._looks[0]
        if first.t_utc_ns > window_ns or self._since_ns > window_ns:
            return None
        if report.motion.kind == "tracks":
            return "tracks" if all(e.motion.kind == "tracks" for e in self._looks) else None
        is_turned = _turned_arcsec(first, report) > MOVED_ARCSEC
        halfway = self._looks[len(self._looks) // 2]
        is_turning = is_turned and _turned_arcsec(halfway, report) > MOVED_ARCSEC / 2.0
        return "moves" if is_turning and report.motion.kind != "stands" else None
