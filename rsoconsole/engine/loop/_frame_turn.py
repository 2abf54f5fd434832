"""One frame of the loop: expose, reduce, follow, order the next slew, then record."""

import time
from collections.abc import Callable

from rsoconsole.engine.aim.instrument_controller import POLL_NS, AimPlan
from rsoconsole.engine.aim.states import Followed, NotPointing, Resumed
from rsoconsole.engine.leaps.leaping import LEAP_POLL_NS, Leaping
from rsoconsole.engine.operator.arming import pointing_check
from rsoconsole.engine.operator.by_hand import ByHand, Parts
from rsoconsole.engine.operator.handlers import LoopControl
from rsoconsole.engine.tasks.exposures import Exposures
from rsoconsole.engine.tasks.faults import Faults
from rsoconsole.engine.tasks.field_tracks import AimAhead, aim_ahead
from rsoconsole.engine.tasks.frame_lights import FrameLights
from rsoconsole.engine.tasks.glint_watch import GlintWatch
from rsoconsole.engine.tasks.pace import Pace, TemporarySettings
from rsoconsole.engine.tasks.preview import CloseupPlaces
from rsoconsole.pipeline import Cycle, Orbits, Reduction, frame_taken_record
from rsoconsole.records import (
    ChartStar,
    CycleTiming,
    Frame,
    Photometry,
    SlewRefusal,
    Solution,
    TrackState,
)
from rsoconsole.tracking.filters import estimator

CLEAR_FRAMES = 2
"""Number of frames in a row with their stars after which the sky counts as clear."""


class FrameTurn:
    """Takes each exposure through the loop, and keeps the state that the next exposure needs."""

    def __init__(
        self,
        control: LoopControl,
        parts: Parts,
        *,
        exposures: Exposures,
        cycle: Cycle,
        orbits: Orbits,
        leaping: Leaping,
        by_hand: ByHand,
        faults: Faults,
        forgive: Callable[[], None],
        on_cycle: Callable[[Reduction], None],
    ) -> None:
        """``forgive``: called when instruments work again; ``on_cycle``: after each frame."""
        self._control = control
        self._parts = parts
        self._exposures, self._cycle, self._orbits = exposures, cycle, orbits
        self._leaping, self._by_hand, self._faults = leaping, by_hand, faults
        self._forgive, self._on_cycle = forgive, on_cycle
        self._plan: AimPlan | None = None
        self._is_first_look = False
        self._must_check_pointing = True
        self.clear_frames = 0
        """Number of frames in a row, up to the last one, in which stars were seen."""
        self.last_track: TrackState | None = None
        self.ahead: AimAhead | None = None
        """Where the telescope looks in the exposure after the next one."""
        self.lights = FrameLights()
        """Brightness of the last frame and of what is followed."""
        self._pace = Pace()
        self.temporary = TemporarySettings(self._pace.config_before_track)
        self._places = CloseupPlaces()
        self._glints = GlintWatch()

    def begin_search(self, *, checks_pointing: bool) -> None:
        """Start a search; the next exposure is taken where the telescope points.

        ``checks_pointing``: the stars in that frame must agree with the mount's report.
        """
        self._is_first_look, self._must_check_pointing = True, checks_pointing
        self._parts.planner.start_search(
            self._parts.instrument_controller.mount_report(),
            self._parts.instrument_controller.now_utc_ns(),
        )

    def forget_plan(self) -> None:
        """Drop the planned exposure, because something outside the loop has changed."""
        self._plan = self._exposures.next_start_utc_ns = None

    def end_autonomy(self) -> None:
        """Reset for the next arming: no slew, no leaps, the night's own exposure and cadence."""
        self._is_first_look = False
        self._parts.slews.forget()
        self._leaping.forget()
        self.set_exposure_and_cadence(None)

    def look_ahead(self) -> None:
        """Compute where the exposure after the next one looks, before the mount goes there."""
        ahead = None
        if self._control.authority.is_autonomous:
            now_ns = self._parts.instrument_controller.now_utc_ns()
            ahead = self._parts.planner.aim_after_plan(self._control.following, self._plan, now_ns)
        self.ahead = aim_ahead(ahead, self._control.following, self._control.config)

    def note_light(self, record: Photometry) -> None:
        """Note a frame's photometry, for the status; called where it has been recorded."""
        self.lights.note(record, self._control.following)

    def one_exposure(self) -> None:
        """Run one frame: wait for the mount, expose, reduce, follow, order the next slew,
        record.
        """
        plan = self._plan or self._order_next()
        self._plan = None
        poll_ns, settle_s = POLL_NS, None
        if self._leaping.is_on:
            poll_ns, settle_s = LEAP_POLL_NS, self._leaping.times.settle_s()
        is_held = self._control.authority.is_held
        if self._parts.slews.wait_for_slew(
            plan, is_held=is_held, poll_ns=poll_ns, settle_s=settle_s
        ):
            self._cycle.forget_plate()
        self._leaping.times.learn_slew_time()
        place_px: tuple[float, float] | None = None
        stars: tuple[ChartStar, ...] | None = None
        frame: Frame | None = None
        try:
            frame, read_ms = self._exposures.take(plan)
            self._exposures.simulate_readout_time(frame)
            self._leaping.order_leap_after_readout(frame)
            self._exposures.simulate_processing_time()
            reduction = self._reduce_and_go_on(frame, read_ms, plan.blocked)
            stars = reduction.chart_stars
            place_px = self._places.of(frame, reduction, self._control.following)
        finally:
            self._leaping.forget_next_leap()
            # Also the frame that could not be used: it is the one somebody will want to see.
            if frame is not None:
                self._exposures.keep(frame, self._control.following.state, place_px, stars)

    def _order_next(self) -> AimPlan:
        """Plan the next exposure and order its slew; the mount is on its way when this returns."""
        if self._is_first_look:
            return self._parts.planner.plan_exposure_here(
                self._parts.instrument_controller.now_utc_ns()
            )
        if self._leaping.is_on:
            return self._leaping.order_next(is_held=self._control.authority.is_held)
        return self._parts.slews.order_next(
            self._control.following, is_held=self._control.authority.is_held
        )

    def one_look(self) -> None:
        """Run one frame without autonomy: measure and record it, and follow nothing."""
        if self._by_hand.move is not None:
            report = self._parts.instrument_controller.wait_for_arrival(*self._by_hand.move.command)
            self._by_hand.move = None
            self._parts.planner.moved_by_hand(report)
            self._parts.session_log.say("info", "the mount has arrived")
        frame, _ = self._exposures.take(
            self._parts.planner.plan_exposure_here(self._parts.instrument_controller.now_utc_ns())
        )
        place_px: tuple[float, float] | None = None
        stars: tuple[ChartStar, ...] | None = None
        try:
            self._exposures.simulate_readout_time(frame)
            self._exposures.simulate_processing_time()
            reduction, records = self._cycle.reduce_only(frame)
            stars = reduction.chart_stars
            place_px = self._places.of(frame, reduction, self._control.following)
            if isinstance(reduction.solution, Solution):
                self._note_solution(reduction.solution)
            light = self._cycle.photometry(reduction, records)
            self._parts.session_log.append_all((*records, light))
            self.note_light(light)
            self._forgive()
            self._count_frame()
        finally:
            self._exposures.keep(frame, self._control.following.state, place_px, stars)

    def _note_solution(self, solution: Solution) -> None:
        self._parts.planner.note_solution(solution)
        drift = self._parts.planner.drift.drift_words(solution)
        report = self._parts.watch.last_report
        # A telescope that waits for a satellite, or that stands, was not to go with the stars.
        is_to_track = report is not None and report.is_tracking and not self._leaping.is_on
        if drift is not None and is_to_track:
            self._parts.session_log.say("warning", drift)

    def _count_frame(self) -> None:
        """Count a finished frame; temporary settings, and a hold until the sky clears, may end."""
        config, changes = self.temporary.count(self._control.config)
        self._parts.session_log.append_all(changes)
        if changes:
            self._control.configure(config)
        if not self._leaping.is_on:
            self.set_exposure_and_cadence(self._control.following.track)
        if self._control.following.track is not None:
            self.last_track = self._control.following.track
        is_cloudy = self._cycle.cloud is not None
        self.clear_frames = 0 if is_cloudy else self.clear_frames + 1
        if self._control.authority.resumes_when_clear and self.clear_frames >= CLEAR_FRAMES:
            self._parts.session_log.say("info", "the stars are back: slews again")
            self._control.handle(Resumed(by="the sky"))

    def set_exposure_and_cadence(self, track: TrackState | None) -> None:
        """Set exposure and cadence for a track's rate; None: restore those of the night."""
        config, changes = self._pace.after(self._control.config, track)
        self._parts.session_log.append_all(changes)
        if changes:
            self._control.configure(config)

    def _reduce_and_go_on(
        self, frame: Frame, read_ms: float, blocked: SlewRefusal | None
    ) -> Reduction:
        began_s = time.perf_counter()
        before = self._control.following
        result = self._cycle.run(frame, before, blocked, self._orbits.last)
        folded_s = time.perf_counter()
        self._parts.session_log.append_all(result.records)
        self._control.handle(Followed(after=result.after))
        if isinstance(result.reduction.solution, Solution):
            self._note_solution(result.reduction.solution)
        self._parts.planner.update_search(
            before, result.after, self._parts.instrument_controller.now_utc_ns()
        )
        self._count_frame()
        is_first_look, self._is_first_look = self._is_first_look, False
        if is_first_look and self._must_check_pointing:
            self._check_pointing(result.reduction)
        self._leaping.follow_frame(frame, result.reduction)
        if self._control.authority.is_autonomous:
            self._plan = self._order_next()
            self._exposures.next_start_utc_ns = self._plan.t_start_utc_ns
        ordered_s = time.perf_counter()
        reduce_ms = result.reduction.stage_ms
        stages = {
            "read": read_ms,
            **self._leaping.take_stage_ms(),
            **reduce_ms,
            "filter": (folded_s - began_s) * 1e3 - sum(reduce_ms.values()),
            "order": (ordered_s - folded_s) * 1e3,
            "total": (ordered_s - began_s) * 1e3 + read_ms,
        }
        # The mount is on its way: nobody waits for this.
        self._leaping.record_last_leap()
        estimator.preload_modules(self._control.config.filter)
        self._parts.session_log.append_all(self._orbits.derive_frame_records())
        self._parts.guide.precompute_path(self._parts.instrument_controller.now_utc_ns())
        self.look_ahead()
        known_s = time.perf_counter()
        light = self._cycle.photometry(result.reduction, result.records)
        self._parts.session_log.append(light)
        self.note_light(light)
        of_frame = (frame_taken_record(frame, blocked), *result.records, light)
        self._parts.session_log.append_all(self._glints.glint_events(of_frame))
        stages["orbit"] = (known_s - ordered_s) * 1e3
        stages["light"] = (time.perf_counter() - known_s) * 1e3
        self._parts.session_log.append(CycleTiming(frame_id=frame.frame_id, stage_ms=stages))
        self._faults.clear()
        self._on_cycle(result.reduction)
        return result.reduction

    def _check_pointing(self, reduction: Reduction) -> None:
        """Check the first frame after arming against the mount's reported direction."""
        check = pointing_check(
            reduction.solution,
            self._parts.instrument_controller.mount_report(),
            self._control.config,
        )
        if check.ok:
            self._parts.session_log.say("info", check.detail)
        elif "pointing" in self._parts.watch.lifted:
            self._parts.session_log.say("warning", f"{check.detail}: overridden")
        else:
            words = f"{check.detail}; {check.remedy}"
            self._parts.session_log.say("alarm", f"not armed: {words}")
            self._control.handle(NotPointing(words=words))
