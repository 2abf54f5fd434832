"""What goes on record and into the log of leaps and of the pass that they follow."""

from dataclasses import dataclass

import numpy as np

from rsoconsole.engine.aim import NS, InstrumentController
from rsoconsole.engine.leaps.awaiting import LeapControl
from rsoconsole.engine.leaps.leap_record import LeapSeen, leap_record, pass_record
from rsoconsole.engine.leaps.leap_times import LeapParts, LeapTimes
from rsoconsole.engine.leaps.leap_words import last_words, next_pass_of, orbit_words, pass_words
from rsoconsole.engine.tasks import SessionLog
from rsoconsole.orbits.low import ExpectedPass, LeapTrack, path_of_orbit
from rsoconsole.orbits.motion import KnownOrbit, PointMass
from rsoconsole.pipeline.leaps import FrameStreak, Leap, Telescope, plan_pass
from rsoconsole.records import LeapOrder, LeapResult
from rsoconsole.sky.limits import Pose

_PASS_S, _PASS_STEP_S = 1_200.0, 10.0


@dataclass(slots=True)
class _Begun:
    """Of the pass that is followed."""

    frame_id: int = 0
    """Of its first streak."""
    name: str = ""
    leaps: int = 0
    planned: int = 0
    is_planned: bool = False


class LeapLog:
    """Gathers leap by leap; what takes time is done once nobody waits for it."""

    def __init__(
        self,
        control: LeapControl,
        instrument_controller: InstrumentController,
        session_log: SessionLog,
        times: LeapTimes,
    ) -> None:
        self._control, self._instrument_controller, self._session_log, self._times = (
            control,
            instrument_controller,
            session_log,
            times,
        )
        self._site = control.config.site.to_site()
        self._begun = _Begun()
        self._seen: LeapSeen | None = None
        """What came of the last leap, not on record yet."""
        self._parts: list[LeapParts] = []
        """Of each leap of the pass, what it took."""
        self._frame_id = 0
        """The last one with a leap or a first streak."""

    def begin(self, frame_id: int, name: str) -> None:
        """A first streak, of what was waited for by this name, or of whatever came: empty."""
        self._begun, self._frame_id = _Begun(frame_id=frame_id, name=name), frame_id
        self._seen, self._parts = None, []

    def took(self, leap: Leap, *, waited_for_frame: bool) -> None:
        """The next slew can be ordered."""
        now_ns = self._instrument_controller.now_utc_ns()
        self._parts.append(self._times.parts_of(leap, now_ns, waited_for_frame=waited_for_frame))

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
        if seen is not None and self._parts:
            self._session_log.append(leap_record(seen, self._parts[-1]))

    def plan(
        self, track: LeapTrack, first: Leap, start: Pose, telescope: Telescope, sure_from: int
    ) -> None:
        """Say, once, how the whole pass would go by the likeliest orbit, its first leap under way.

        ``sure_from``: as ``plan_pass`` has it.
        """
        if self._begun.is_planned:
            return
        self._begun.is_planned = True
        best = track.best
        heaviest = int(np.argmax(best.cloud.weight))
        orbit = KnownOrbit(
            epoch_utc_ns=best.cloud.epoch_utc_ns,
            r_km=best.cloud.r_km[heaviest],
            v_km_s=best.cloud.v_km_s[heaviest],
            covariance=np.eye(6) * 1e-6,
            forces=PointMass(),
        )
        t = first.t_order_utc_ns + (np.arange(0.0, _PASS_S, _PASS_STEP_S) * NS).astype(np.int64)
        path = path_of_orbit(orbit, self._site, t)
        if path is None:
            return
        is_early = self._control.config.leap.at_close
        plan = plan_pass(
            path,
            start,
            first.t_order_utc_ns,
            telescope,
            first=first,
            sure_from=sure_from if is_early else None,
        )
        self._begun.planned = len(plan.leaps)
        self._session_log.say("info", pass_words(plan))

    def end(self, track: LeapTrack, why: str) -> None:
        """What is known of what was leapt after."""
        orbit = track.best.orbit
        self._session_log.say("info", f"{why}: {last_words(track, self._parts)}")
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
        self._parts = []
