"""Stares where low satellites come by, and leaps ahead of one until it sets.

The telescope exposes where it looks, one frame after another. A streak fast enough for a low orbit
begins a track (`orbit.leap_track`); from then on the track gives the place and time of each
exposure. Once another frame would hardly improve the orbit, the next slew is ordered as the shutter
closes, and the camera reads out during the slew. Before that, the slew is ordered as soon as a
quick search in the middle of the frame has found the streak. Frames are measured and recorded as
usual, as a whole; this module only decides where the next frame is.
"""

import time
from collections.abc import Callable
from dataclasses import replace

from rsoconsole.config import Config
from rsoconsole.engine.aim.instrument_controller import NS, AimPlan
from rsoconsole.engine.leaps._leap_camera import LeapCamera
from rsoconsole.engine.leaps._leap_log import LeapLog
from rsoconsole.engine.leaps._leap_times import LeapTimes
from rsoconsole.engine.leaps._staring import Staring
from rsoconsole.engine.leaps.awaiting import PassFinder, first_streak_words, successful_leap_words
from rsoconsole.engine.operator.by_hand import Parts
from rsoconsole.engine.operator.handlers import LoopControl
from rsoconsole.instruments import MountReport
from rsoconsole.orbits import (
    LeapTrack,
    TimingErrors,
    begin_leap_track,
    leap_track_after_miss,
    update_leap_track,
)
from rsoconsole.pipeline import (
    FrameStreak,
    Glance,
    Leap,
    NoLeap,
    Reduction,
    Telescope,
    frame_streaks,
    is_in_earth_shadow,
    measured_pass_offset,
    mid_exposure_utc_ns,
    next_leap,
    timing_uncertainty,
)
from rsoconsole.records import Frame, LeapOrder, LeapResult, SlewRefusal, Solution
from rsoconsole.sky import Pose
from rsoconsole.words import text

LEAP_POLL_NS = NS // 10
"""Interval between the mount's reports while a leap's arrival is waited for, ns."""
_AHEAD_S, _STEP_S = 150.0, 3.0
"""Length and step of the path in which the next leap is sought, s; long enough for a pier flip."""
SURE_STREAKS = 3
"""Number of streaks from which on the next slew need not wait for the frame."""
SURE_WITHIN, SURE_PROBABILITY = 0.98, 0.99
"""Least probability that both ends are in the next field, and that the track's sense is right."""
_GLANCE_NS = NS // 10
"""Assumed time of the quick search in a frame's middle, in the simulated observatory, ns."""

LookAt = Callable[[Frame, float], Glance | None]
"""Searches for streaks in a frame's middle, within a distance of its centre, px; None: none."""


class Leaping:
    """Follows a low satellite by leaps: decides where and when it is photographed next."""

    def __init__(self, control: LoopControl, parts: Parts, look_at: LookAt) -> None:
        self._control = control
        self._parts = parts
        self._site = control.config.site.to_site()
        self._look_at = look_at
        self.track: LeapTrack | None = None
        """Track of the satellite that is followed; None while staring."""
        self._leap: Leap | None = None
        self._misses = 0
        self._next: Leap | None = None
        """The next leap, found while the shutter is open, to be ordered when it closes."""
        self._order_by: LeapOrder = "by the frame"
        self._early: tuple[AimPlan, Leap, LeapOrder] | None = None
        """Plan, leap and trigger of the next leap, where its slew is ordered already."""
        self._stage_ms: dict[str, float] = {}  # of the look at the last frame's middle, the order
        self._exposing = (0, 0)
        """Number of the frame under way, and the time of its order, UTC ns."""
        self.times = LeapTimes(lambda: control.config, parts.instrument_controller, parts.watch)
        self._camera = LeapCamera(control, parts)
        self._awaiting = PassFinder(control, parts)
        self._staring = Staring(control, parts, self.times, self._camera, self._awaiting)
        self._log = LeapLog(control, parts, self.times)

    @property
    def is_on(self) -> bool:
        """True where ``leap.enabled`` is set."""
        return self._control.config.leap.enabled

    def forget(self, why: str = "autonomy has lost the mount") -> None:
        """End the leaps, with the reason ``why``; stares then begin where the mount points."""
        if self.track is not None:
            self._log.record_interrupted_pass(self.track, why)
        self.track = self._leap = None
        self.forget_next_leap()
        self.times.forget_slew()
        self._staring.forget()
        self._awaiting.forget_pass()
        self._misses = 0
        self._camera.restore_settings()

    def forget_times(self) -> None:
        """End the leaps and forget all learned times of the camera, because the clock was set."""
        self.forget("the clock was set")
        self.times.forget_camera_times()
        self._awaiting.forget_orbit()

    def forget_next_leap(self) -> None:
        """Forget the next leap, found or ordered before the frame was measured."""
        self._next = self._early = None

    def configure(self, before: Config) -> None:
        """Note that settings have changed from ``before``; end the leaps where switched off."""
        after = self._control.config
        if before.leap.pass_norad != after.leap.pass_norad:
            self._awaiting.forget_elements()
        self._camera.apply_new_settings(before)
        self.times.apply_new_settings(before)
        if before.leap.enabled and not after.leap.enabled:
            self.forget("leaps were switched off")

    def telescope(self) -> Telescope:
        """Return the telescope's motion, times and limits, as learned so far."""
        return self.times.telescope(self._camera.binning)

    # --- an exposure of a leap

    def opened(self, frame_id: int, opened_utc_ns: int) -> None:
        """Find the next leap while the exposure ordered at ``opened_utc_ns`` is under way."""
        self._exposing, self._next = (frame_id, opened_utc_ns), None
        leap, track = self._leap, self.track
        if leap is None or track is None or not self._is_sure(track):
            return
        exposure_s = self._control.config.exposure.exposure_s
        closed_s = self.times.shutter_closed_after_s(exposure_s, track.best_hypothesis.scatter_s)
        if closed_s is None:
            return
        t_close_ns = opened_utc_ns + round(closed_s * NS)
        pose = self._parts.planner.pose(t_close_ns)
        if pose is None:
            return
        found = self._likeliest_leap(track, pose, t_close_ns)
        if isinstance(found, Leap) and found.within >= SURE_WITHIN:
            self._next = found

    def closed(self) -> MountReport | None:
        """Send the mount on as the shutter closes, where the orbit is known well enough for that.

        Returns the mount's report from just before; None where the mount stays. Raises what
        ``Slews.order`` raises.
        """
        found, self._next = self._next, None
        if found is None or not self._may_order():
            return None
        self._parts.instrument_controller.wait_until(found.t_order_utc_ns)
        looked = self._parts.instrument_controller.mount_report()
        return looked if self._order_early(found, waited_for_frame=False) else None

    def order_leap_after_readout(self, frame: Frame) -> None:
        """Learn a frame's times, and order the next slew if its middle already shows the streak.

        Raises what ``Slews.order`` raises.
        """
        self.times.learn_shutter_delay(frame, self._exposing[1])
        leap, track = self._leap, self.track
        if self._early is not None or leap is None or track is None or not self._may_order():
            return
        began_s = time.perf_counter()
        reach_px = leap.streak_reach_px(self.telescope().terms)
        seen = None if self._misses else self._look_at(frame, reach_px)
        self._stage_ms["glance"] = (time.perf_counter() - began_s) * 1e3
        if seen is None:
            return
        if self._parts.instrument_controller.instruments.clock.is_simulated:
            self._parts.instrument_controller.wait_until(
                self._parts.instrument_controller.now_utc_ns() + _GLANCE_NS
            )
        began_s = time.perf_counter()
        exposure = self._control.config.exposure
        for each in frame_streaks(seen.detections, seen.solution, frame, exposure):
            after = update_leap_track(track, each.ends) if each.ends.is_whole else None
            now_ns = self._parts.instrument_controller.now_utc_ns()
            pose = self._parts.planner.pose(now_ns)
            if after is None or pose is None:
                continue
            found = self._likeliest_leap(after, pose, now_ns)
            if isinstance(found, Leap) and self._order_early(found, waited_for_frame=True):
                self._stage_ms["ahead"] = (time.perf_counter() - began_s) * 1e3
            return

    def take_stage_ms(self) -> dict[str, float]:
        """Return the times of the quick search and the order made from it, ms, and forget them."""
        taken, self._stage_ms = self._stage_ms, {}
        return taken

    def _is_sure(self, track: LeapTrack) -> bool:
        return self._control.config.leap.at_close and self._is_known(track)

    def _is_known(self, track: LeapTrack) -> bool:
        best = track.best_hypothesis
        return (
            self._misses == 0
            and best.orbit is not None
            and len(best.streaks) >= SURE_STREAKS
            and best.probability >= SURE_PROBABILITY
        )

    def _may_order(self) -> bool:
        return self.is_on and self._control.may_move

    def _order_early(self, found: Leap, *, waited_for_frame: bool) -> bool:
        now_ns = self._parts.instrument_controller.now_utc_ns()
        pose = self._parts.planner.pose(now_ns)
        if pose is None or not isinstance(plan := self._order(found, pose, now_ns), AimPlan):
            return False  # the whole frame says how it goes on
        if waited_for_frame:
            self.times.learn_processing_time(now_ns)
        if self._leap is not None:
            self._log.note_leap_times(self._leap, waited_for_frame=waited_for_frame)
        self._early = plan, found, "by a look" if waited_for_frame else "at close"
        return True

    # --- what a frame shows

    def follow_frame(self, frame: Frame, reduction: Reduction) -> None:
        """Update the satellite's track with a frame, or begin one with a streak of the frame."""
        if not self.is_on:
            return
        leap, self._leap = self._leap, None
        self._learn(leap, reduction)
        solution = reduction.solution
        if not isinstance(solution, Solution):
            if self.track is not None:
                self._note_leap(leap, "not solved")
                self._miss("the frame is not solved")
            return
        exposure = self._control.config.exposure
        found = frame_streaks(reduction.detections, solution, frame, exposure)
        if self.track is None:
            first = self._first_of(found, timing_uncertainty(frame, exposure))
            if first is not None:
                self._begin(first, frame.frame_id)
            return
        for each in found:
            after = update_leap_track(self.track, each.ends)
            if after is not None:
                self._note_leap(leap, "met", each)
                self.track, self._misses = after, 0
                self._parts.session_log.say("info", successful_leap_words(after, each, leap))
                return
        self._note_leap(leap, "another streak" if found else "not in the frame")
        if self._begins_again(found, timing_uncertainty(frame, exposure), frame.frame_id):
            return
        centre = solution.ra_icrs_deg, solution.dec_icrs_deg
        orbit = self.track.best_hypothesis.orbit
        t_mid_ns = mid_exposure_utc_ns(frame, exposure)
        if t_mid_ns is not None:
            if orbit is not None and is_in_earth_shadow(orbit, t_mid_ns):
                self._end("it has gone into the Earth's shadow")
                return
            half_deg = min(self._control.config.optics.field_deg) / 2.0 * self._camera.share
            self.track = leap_track_after_miss(self.track, t_mid_ns, centre, half_deg)
        self._miss("it is not in the frame" if not found else "no streak of the frame is its")

    def _learn(self, leap: Leap | None, reduction: Reduction) -> None:
        """Learn the last leap's times, and from the stars whether the mount had settled."""
        if self._early is None:
            self.times.learn_processing_time(self._parts.instrument_controller.now_utc_ns())
            if leap is not None:
                self._log.note_leap_times(leap, waited_for_frame=True)
        if words := self.times.add_star_width(reduction.fwhm_px):
            self._parts.session_log.say("info", words)

    def _note_leap(
        self, leap: Leap | None, result: LeapResult, streak: FrameStreak | None = None
    ) -> None:
        assert self.track is not None
        if leap is not None:
            self._log.note_leap_result(
                leap,
                self._order_by,
                result,
                frame_id=self._exposing[0],
                before=self.track,
                streak=streak,
            )

    def _first_of(
        self, found: tuple[FrameStreak, ...], timing: TimingErrors
    ) -> tuple[LeapTrack, str, str] | None:
        """Return a track that begins with one of these streaks, its name and words for the log."""
        config = self._control.config
        for each in found:
            ends = each.ends
            if not each.may_begin_track or ends.speed_arcsec_s < config.leap.least_rate_arcsec_s:
                continue
            awaited = self._awaiting.awaited
            known = None if awaited is None else measured_pass_offset(awaited, self._site, ends)
            if awaited is not None and known is None:
                self._parts.session_log.say("info", f"a low satellite that is not {awaited.name}")
                continue
            ends = ends if known is None else known[1]
            track = begin_leap_track(self._site, ends, timing, is_turned=known is not None)
            if track is None:
                continue
            name = "" if awaited is None else awaited.name
            return track, name, first_streak_words(track, awaited, known and known[0])
        return None

    def _begin(self, first: tuple[LeapTrack, str, str], frame_id: int) -> None:
        self.track, name, words = first
        self._misses = 0
        self._log.begin(frame_id, name)
        self._parts.session_log.say("info", words)

    def _begins_again(
        self, found: tuple[FrameStreak, ...], timing: TimingErrors, frame_id: int
    ) -> bool:
        """Begin again with a later streak that contradicts a track of a single one.

        The first streak of a satellite that flashes or fades may have shown only a part.
        """
        if self.track is None or self.track.best_hypothesis.orbit is not None:
            return False
        first = self._first_of(found, timing)
        if first is None:
            return False
        self._log.record_last_leap()
        self._log.record_interrupted_pass(self.track, "its next streak says otherwise")
        self._begin(first, frame_id)
        return True

    def record_last_leap(self) -> None:
        """Record the last leap and log the plan of the pass; called while no frame has to wait."""
        self._log.record_last_leap()
        if self.track is None or self._leap is None:
            return
        start = self._parts.planner.pose(self._leap.t_order_utc_ns)
        if start is not None:
            self._log.log_pass_plan(self.track, self._leap, start, self.telescope(), SURE_STREAKS)

    def _miss(self, why: str) -> None:
        self._misses += 1
        most = self._control.config.leap.most_misses
        self._parts.session_log.say("info", f"leap missed ({self._misses} of {most}): {why}")
        if self._misses >= most:
            self._end("given up")

    def _end(self, why: str) -> None:
        """End the track: its results go into the log."""
        track, self.track, self._misses = self.track, None, 0
        if track is None:
            return
        self._awaiting.note_pass_over(track.best_hypothesis.orbit)
        self._log.end(track, why)

    # --- where the next one is

    def order_next(self, *, is_held: bool) -> AimPlan:
        """Plan the next exposure and order its slew; the mount is on its way when this returns.

        Raises what ``Slews.order`` raises.
        """
        if self._camera.share == 1.0:
            self.times.learn_whole_readout_time(self._parts.instrument_controller.now_utc_ns())
        plan = self._next_plan(is_held=is_held)
        self._read_what_shows_it()
        return plan

    def _read_what_shows_it(self) -> None:
        """Read a part of the sensor, ordered during the slew, where the next leap is sure."""
        leap, track, share = self._leap, self.track, 1.0
        if leap is not None and track is not None and self._is_known(track):
            share = self.times.subframe_for(leap)
        if self._camera.set_subframe(share):
            self.times.forget_readouts()
        self._leap = leap and replace(leap, share=self._camera.share)

    def _next_plan(self, *, is_held: bool) -> AimPlan:
        now_ns = self._parts.instrument_controller.now_utc_ns()
        early, self._early = self._early, None
        pose = self._parts.planner.pose(now_ns)
        if is_held or pose is None:
            self._leap = None
            return self._staring.plan_in_place(now_ns)
        if self._camera.begin():
            self.times.forget_camera_times()
        if early is not None:
            # Also where that is over by this frame: a mount on its way arrives first.
            plan, leap, self._order_by = early
            self._camera.set_exposure(leap.exposure_s)
            self._leap = None if self.track is None else leap
            return plan
        if self.track is not None:
            plan_ahead = self._leap_from(self.track, pose, now_ns)
            if plan_ahead is not None:
                return plan_ahead
        self._leap = None
        return self._staring.next_plan(pose, now_ns)

    def _leap_from(self, track: LeapTrack, pose: Pose, now_ns: int) -> AimPlan | None:
        """Order the next leap and return its plan; None where there is none any more."""
        found = self._likeliest_leap(track, pose, now_ns)
        if isinstance(found, NoLeap):
            words = found.kind if found.refusal is None else found.refusal.text
            self._end(words)
            return None
        ordered = self._order(found, pose, now_ns)
        if not isinstance(ordered, AimPlan):
            self._end(text(ordered))
            return None
        self._camera.set_exposure(found.exposure_s)
        self._leap, self._order_by = found, "by the frame"
        return ordered

    def _order(self, found: Leap, pose: Pose, now_ns: int) -> AimPlan | SlewRefusal:
        """Order a leap's slew; return its plan or the refusal. Raises what ``Slews.order`` does."""
        direction = found.place.direction_deg
        plan = self._parts.planner.plan_exposure_at(
            direction,
            found.t_expose_utc_ns,
            "leap",
            now_ns,
            t_mid_utc_ns=found.t_mid_utc_ns,
            frame_id=self._exposing[0],
        )
        refused = self._parts.slews.order(plan, t_until_utc_ns=found.t_close_utc_ns)
        if refused is not None:
            return refused
        self.times.ordered(self.telescope().limits.travel_deg(pose, *direction), now_ns)
        return plan

    def _likeliest_leap(self, track: LeapTrack, pose: Pose, now_ns: int) -> Leap | NoLeap:
        """Return the leap for the likeliest sense that can be met; else the reason against."""
        why: NoLeap | None = None
        for number in range(len(track.hypotheses)):
            path = track.predicted_path(now_ns, _AHEAD_S, number, step_s=_STEP_S)
            found: Leap | NoLeap = NoLeap(kind="it sets")
            if path is not None:
                found = next_leap(path, pose, now_ns, self.telescope())
            if isinstance(found, Leap):
                return found
            why = why or found
        return why or NoLeap(kind="it sets")
