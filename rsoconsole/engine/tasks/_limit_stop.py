"""Ends a motion that is not allowed, and reports whether the mount has stopped.

A motion that goes on after its ABORT gets another ABORT twice a minute, and the alarm stays. How
far the mount moves after an ABORT shows how far this mount needs to stop.
"""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from rsoconsole.base import RsoconsoleError
from rsoconsole.engine.aim.instrument_controller import NS
from rsoconsole.engine.tasks._observed_motion import How, ObservedMotion
from rsoconsole.instruments import Instruments, MountAbilities, MountReport, StopResult
from rsoconsole.records import Event
from rsoconsole.sky import Pose, StoppingDistance, wrap_180

AGAIN_S = 30.0
ENOUGH = 20
"""Number of orders to end one motion, over ten minutes; after them a person must act."""
MEASURED_BY_S = 10.0
"""Time after ABORT at which it is reported that the mount is not known to rest, s."""
LEARNS_WITHIN_S = 30.0
PARK_WAITS_S = 10.0
"""Greatest wait of a park for the loop to notice the limit, s; the loop then sends ABORT."""
PARKS_S = 900.0


@dataclass(slots=True)
class _Ended:
    """An order to end a motion, until the mount is measured to rest."""

    t_utc_ns: int
    place: tuple[float, float]
    """Right ascension and declination when the order went out, deg."""
    rate_deg_s: float
    how: How
    is_known: bool
    """True where its result is reported elsewhere, or has been reported."""


class LimitStop:
    """Orders the end of a motion at a limit, and reports the measured result."""

    def __init__(self, instruments: Instruments, say: Callable[[Event], None]) -> None:
        """``say``: puts a line on the record, from any thread."""
        self._instruments = instruments
        self._say = say
        self.distance = StoppingDistance()
        self._how: How | None = None
        """Kind of the motion that was ordered to end; None: there is none."""
        self._orders = 0
        self._ordered_ns = 0
        self._ended: _Ended | None = None
        self._park_due_ns: int | None = None
        self._parks_since_ns: int | None = None
        self._last: tuple[Pose, ObservedMotion] | None = None

    @property
    def is_parking(self) -> bool:
        """True while the mount moves to its park position because it could not be stopped."""
        return self._parks_since_ns is not None

    def forget_motion(self) -> None:
        """Forget the motion that was to end, so that a later one counts as new."""
        self._how, self._orders = None, 0

    def is_due(self, how: How, now_ns: int) -> bool:
        """True where an order to end this kind of motion is due now."""
        since_s = (now_ns - self._ordered_ns) / NS
        if how != self._how:
            return True
        return self._orders < ENOUGH and not 0.0 <= since_s < AGAIN_S

    def is_first(self, how: How) -> bool:
        """Return True where no order to end this kind of motion has been given yet."""
        return how != self._how

    def words(self, how: How, *, parks: bool) -> str:
        """Return the orders that ``end`` gives, in words."""
        able = self._abilities()
        if how == "slews":
            lacks = "" if able.can_abort else "it knows no ABORT"
        else:
            lacks = "" if able.can_set_tracking else "it cannot be told not to track"
        if not lacks:
            return "ABORT sent" if how == "slews" else "ABORT sent and tracking switched off"
        if able.can_park and parks:
            return f"ABORT sent and, because {lacks}, the order to park"
        return f"ABORT sent, but {lacks}: park it, or cut its power"

    def end(self, how: How, now_ns: int, *, parks: bool) -> StopResult:
        """Send ABORT; then stop tracking, or park a mount that cannot be ordered to stand.

        ``how``: the kind of motion; ``parks``: whether the mount may be parked, which it may not
        where autonomy will move it away.
        """
        mount = self._instruments.mount
        if how != self._how:
            self._how, self._orders = how, 0
        self._orders, self._ordered_ns = self._orders + 1, now_ns
        self._note(now_ns, how, is_known=self._orders > 1)
        result = mount.abort()
        able = self._abilities()
        if how != "slews" and able.can_set_tracking:
            with contextlib.suppress(RsoconsoleError):
                mount.set_tracking(False)
        can = able.can_abort if how == "slews" else able.can_set_tracking
        if parks and able.can_park and not can:
            self._park_due_ns = now_ns
        return result

    def note_abort(self, now_ns: int) -> None:
        """Note an ABORT sent and reported by another part of the engine; from any thread."""
        last = self._last
        if last is not None and last[1].how == "slews":
            self._note(now_ns, "slews", is_known=True)

    def _note(self, now_ns: int, how: How, *, is_known: bool) -> None:
        if self._last is None:
            return
        pose, seen = self._last
        place, rate_deg_s = (pose.ra_icrs_deg, pose.dec_icrs_deg), 0.0
        if seen.how == "slews" and seen.rates is not None:
            since_s = max((now_ns - pose.t_utc_ns) / NS, 0.0)
            rate_deg_s = seen.rates.fastest_deg_s(pose.dec_icrs_deg)
            place = (
                place[0] + seen.rates.ra_deg_s * since_s,
                place[1] + seen.rates.dec_deg_s * since_s,
            )
        self._ended = _Ended(
            t_utc_ns=now_ns, place=place, rate_deg_s=rate_deg_s, how=how, is_known=is_known
        )

    def forget_park(self, ordered_utc_ns: int) -> None:
        """Forget a park due for a limit, where the order at ``ordered_utc_ns`` came later."""
        if self._park_due_ns is not None and ordered_utc_ns > self._park_due_ns:
            self._park_due_ns = None

    def look(
        self, report: MountReport, pose: Pose, seen: ObservedMotion, *, is_heeded: bool
    ) -> None:
        """Use a look at the mount: learn the stopping distance, report, and park where due.

        ``seen``: the motion at this look; ``is_heeded``: the loop has acted on all its alarms.
        """
        self._last = pose, seen
        self._see_to_park(report, is_heeded=is_heeded)
        ended = self._ended
        if ended is None:
            return
        since_s = (pose.t_utc_ns - ended.t_utc_ns) / NS
        rests = report.motion.kind in (
            ("stands", "tracks") if ended.how == "slews" else ("stands",)
        )
        if rests and since_s > 0.0:
            self._ended = None
            self._has_come_to_rest(ended, report, pose, since_s)
        elif since_s > MEASURED_BY_S and not ended.is_known:
            ended.is_known = True
            self._say(_late_words(seen))

    def _has_come_to_rest(
        self, ended: _Ended, report: MountReport, pose: Pose, since_s: float
    ) -> None:
        way_deg = max(
            abs(wrap_180(pose.ra_icrs_deg - ended.place[0])),
            abs(pose.dec_icrs_deg - ended.place[1]),
        )
        is_fast = ended.how == "slews" and ended.rate_deg_s > 0.0
        if is_fast and since_s < LEARNS_WITHIN_S and abs(pose.dec_icrs_deg) < 80.0:
            self.distance.learn(way_deg, ended.rate_deg_s)
        if ended.is_known:
            return
        on = f", {way_deg:.1f} deg on" if is_fast else ""
        does = "stands" if report.motion.kind == "stands" else "tracks"
        self._say(_event("warning", f"after ABORT at the limit the mount {does} (measured){on}"))

    def _see_to_park(self, report: MountReport, *, is_heeded: bool) -> None:
        since_ns = self._parks_since_ns
        if since_ns is not None and (
            report.is_parked or not 0 <= report.t_utc_ns - since_ns < PARKS_S * NS
        ):
            self._parks_since_ns = None
        due_ns = self._park_due_ns
        if due_ns is None:
            return
        waited_s = (report.t_utc_ns - due_ns) / NS
        if not is_heeded and 0.0 <= waited_s < PARK_WAITS_S:
            return
        self._park_due_ns = None
        if report.is_parked or report.is_parking:
            return
        try:
            self._instruments.mount.park()
            self._parks_since_ns = report.t_utc_ns
        except RsoconsoleError as error:
            self._say(_event("alarm", f"the mount does not park: {error}; park it by hand"))

    def _abilities(self) -> MountAbilities:
        try:
            return self._instruments.mount.abilities()
        except RsoconsoleError:
            return MountAbilities()


def _late_words(seen: ObservedMotion) -> Event:
    since = f"{MEASURED_BY_S:.0f} s after ABORT at the limit"
    if seen.how == "stands":
        return _event("warning", f"nobody can tell whether the mount stands, {since}: look at it")
    does = "still tracks"
    if seen.how == "slews":
        at = ""
        if seen.rates is not None:
            fastest_deg_s = max(abs(seen.rates.ra_deg_s), abs(seen.rates.dec_deg_s))
            at = f" at {fastest_deg_s:.1f} deg/s"
        does = f"still moves{at}"
    return _event("alarm", f"the mount {does}, {since}: cut its power")


def _event(level: Literal["warning", "alarm"], text: str) -> Event:
    return Event(level=level, text=text)
