"""What goes on record and into the log of leaps and of the pass that they follow."""

from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.engine.aim import NS
from rsoconsole.engine.leaps.leap_record import LeapSeen, leap_record, pass_record
from rsoconsole.engine.leaps.leap_times import LeapParts, LeapTimes
from rsoconsole.engine.leaps.leap_words import (
    last_words,
    next_pass_of,
    orbit_words,
    pass_words,
    rest_words,
)
from rsoconsole.engine.operator import Control, Parts
from rsoconsole.orbits.low import ExpectedPass, LeapTrack, path_of_orbit
from rsoconsole.orbits.motion import KnownOrbit, PointMass
from rsoconsole.pipeline.leaps import FrameStreak, Leap, Telescope, plan_pass
from rsoconsole.records import LeapOrder, LeapResult
from rsoconsole.sky import IntArray, lit_fraction
from rsoconsole.sky.limits import Pose

_PASS_S, _PASS_STEP_S = 1_200.0, 10.0
_AGAIN_AT = (6, 15)
"""Streaks with which the rest of a pass is planned once more: one streak tells it badly."""
_SURE = np.eye(6) * 1e-6
"""As if it were known: later leaps will know it better than it is known now."""


@dataclass(slots=True)
class _Begun:
    """Of the pass that is followed."""

    frame_id: int = 0
    """Of its first streak."""
    name: str = ""
    leaps: int = 0
    planned: int = 0
    planned_at: int = 0
    """How many streaks there were when the pass was planned last; 0: it was not."""


class LeapLog:
    """Gathers leap by leap; what takes time is done once nobody waits for it."""

    def __init__(self, control: Control, parts: Parts, times: LeapTimes) -> None:
        self._control, self._times = control, times
        self._instrument_controller = parts.instrument_controller
        self._session_log = parts.session_log
        self._site = control.config.site.to_site()
        self._begun = _Begun()
        self._seen: LeapSeen | None = None
        """What came of the last leap, not on record yet."""
        self._spent: list[LeapParts] = []
        """Of each leap of the pass, what it took."""
        self._frame_id = 0
        """The last one with a leap or a first streak."""

    def begin(self, frame_id: int, name: str) -> None:
        """A first streak, of what was waited for by this name, or of whatever came: empty."""
        self._begun, self._frame_id = _Begun(frame_id=frame_id, name=name), frame_id
        self._seen, self._spent = None, []

    def took(self, leap: Leap, *, waited_for_frame: bool) -> None:
        """The next slew can be ordered."""
        now_ns = self._instrument_controller.now_utc_ns()
        self._spent.append(self._times.parts_of(leap, now_ns, waited_for_frame=waited_for_frame))

    def came(
        self,
        leap: Leap,
        order: LeapOrder,
        result: LeapResult,
        *,
        frame_id: int,
        before: LeapTrack,
        streak: FrameStreak | None = None,
    ) -> None:
        """What came of a leap, by its frame; ``before``: what was followed until then."""
        self._begun.leaps += 1
        self._frame_id = frame_id
        self._seen = LeapSeen(
            frame_id=frame_id,
            begun_frame_id=self._begun.frame_id,
            number=self._begun.leaps,
            leap=leap,
            order=order,
            result=result,
            before=before,
            ends=None if streak is None else streak.ends,
        )

    def record(self) -> None:
        """The last leap."""
        seen, self._seen = self._seen, None
        if seen is not None and self._spent:
            self._session_log.append(leap_record(seen, self._spent[-1]))

    def plan(
        self, track: LeapTrack, first: Leap, start: Pose, telescope: Telescope, sure_from: int
    ) -> None:
        """Say how the pass would go: by its first streak, its first leap under way, and again.

        By one streak that is the likeliest of many orbits; by some more its own, and then the
        Earth's shadow ends it too. ``sure_from``: as ``plan_pass`` has it.
        """
        streaks, best = len(track.best.streaks), track.best
        is_first = not self._begun.planned_at
        is_again = streaks in _AGAIN_AT and streaks != self._begun.planned_at
        orbit = (
            _likeliest(track) if is_first else best.orbit and replace(best.orbit, covariance=_SURE)
        )
        if orbit is None or not (is_first or is_again):
            return
        self._begun.planned_at = streaks
        t = first.t_order_utc_ns + (np.arange(0.0, _PASS_S, _PASS_STEP_S) * NS).astype(np.int64)
        lit = t if is_first else t[: _lit_instants(orbit, t)]
        path = path_of_orbit(orbit, self._site, lit) if len(lit) > 1 else None
        if path is None:
            return
        is_early = self._control.config.leap.at_close
        plan = plan_pass(
            path,
            start,
            first.t_order_utc_ns,
            telescope,
            first=first,
            sure_from=(sure_from if is_first else 0) if is_early else None,
        )
        if is_first:
            self._begun.planned = len(plan.leaps)
        is_dark = len(lit) < len(t) and plan.end.kind == "it sets"
        words = pass_words(plan) if is_first else rest_words(plan, is_dark=is_dark)
        self._session_log.say("info", words)

    def end(self, track: LeapTrack, why: str) -> None:
        """What is known of what was leapt after."""
        orbit = track.best.orbit
        self._session_log.say("info", f"{why}: {last_words(track, self._spent)}")
        later: ExpectedPass | None = None
        if orbit is not None:
            now_ns = self._instrument_controller.now_utc_ns()
            least_deg = self._control.config.limits.min_altitude_deg
            later = next_pass_of(orbit, self._site, now_ns, least_deg)
            for line in orbit_words(orbit, later):
                self._session_log.say("info", line)
        self._record_pass(track, why, later)

    def cut_off(self, track: LeapTrack, why: str) -> None:
        """Something else has ended a pass in its middle."""
        self._record_pass(track, why, None)

    def _record_pass(self, track: LeapTrack, end: str, later: ExpectedPass | None) -> None:
        self.record()
        self._session_log.append(
            pass_record(
                track,
                frame_id=self._frame_id,
                begun_frame_id=self._begun.frame_id,
                name=self._begun.name,
                end=end,
                planned_leaps=self._begun.planned,
                next_pass=later,
            )
        )
        self._spent = []


def _likeliest(track: LeapTrack) -> KnownOrbit:
    """Of the orbits that its streaks allow."""
    cloud = track.best.cloud
    heaviest = int(np.argmax(cloud.weight))
    return KnownOrbit(
        epoch_utc_ns=cloud.epoch_utc_ns,
        r_km=cloud.r_km[heaviest],
        v_km_s=cloud.v_km_s[heaviest],
        covariance=_SURE,
        forces=PointMass(),
    )


def _lit_instants(orbit: KnownOrbit, t_utc_ns: IntArray) -> int:
    """How many there are before it goes into the Earth's shadow."""
    lit = lit_fraction(orbit.states(t_utc_ns)[0], t_utc_ns) > 0.0
    return int(np.argmin(lit)) if not np.all(lit) else len(lit)
