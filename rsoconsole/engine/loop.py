"""The loop: plan, slew, expose, reduce, follow, record; again. Decisions are made elsewhere."""

import contextlib
import logging
import time
from collections.abc import Callable
from dataclasses import replace

from rsoconsole.config import Config
from rsoconsole.control import Request, Status
from rsoconsole.engine.arming import pointing_check
from rsoconsole.engine.by_hand import ByHand, HandMove, Parts
from rsoconsole.engine.chronicle import Chronicle, Recorder
from rsoconsole.engine.command_queue import (
    Alarm,
    CommandQueue,
    action_record,
    alarm_words,
    dropped_by,
)
from rsoconsole.engine.exposures import Exposures
from rsoconsole.engine.faults import Faults
from rsoconsole.engine.guide import Guide
from rsoconsole.engine.handlers import joined
from rsoconsole.engine.hands import NS, POLL_NS, Hands, Interrupted, StoppedElsewhere
from rsoconsole.engine.interruptions import Interruptions
from rsoconsole.engine.kept import KeptTrack, kept_name
from rsoconsole.engine.leaping import LEAP_POLL_NS, Leaping
from rsoconsole.engine.modes import Modes
from rsoconsole.engine.pace import Pace
from rsoconsole.engine.parking import Parking
from rsoconsole.engine.plan import Plan, Planner
from rsoconsole.engine.preview import PlacesOfInterest
from rsoconsole.engine.seek import Seeking
from rsoconsole.engine.settings import Settings
from rsoconsole.engine.slews import NowhereError, Slews
from rsoconsole.engine.states import (
    BY_OPERATOR,
    Armed,
    Charge,
    ClockSet,
    Disarmed,
    Failed,
    Followed,
    Happening,
    LimitMet,
    Marked,
    NightEnded,
    NotPointing,
    Resumed,
    Step,
    Stopped,
    Taken,
    step,
    without_kept,
)
from rsoconsole.engine.status import status_of
from rsoconsole.engine.temporary import Temporary
from rsoconsole.engine.tracks_now import AimAhead, aim_ahead, tracks_now
from rsoconsole.engine.verdicts import PixelsOf, Verdicts
from rsoconsole.engine.watch import Watch
from rsoconsole.errors import InstrumentError, RsoconsoleError
from rsoconsole.pipeline.cycle import Cycle
from rsoconsole.pipeline.orbits import Orbits
from rsoconsole.pipeline.reduce import FrameReducer, Reduction
from rsoconsole.pipeline.uncorrelated_tracks import Past
from rsoconsole.reasons import DONE, Cause, CommandResult, Missed, SlewRefusal
from rsoconsole.records import (
    CycleTiming,
    Frame,
    Miss,
    Solution,
    StateChange,
    Topic,
    TrackState,
)
from rsoconsole.tracking import lqe
from rsoconsole.tracking.following import Following

log = logging.getLogger(__name__)

IDLE_TICK_NS = NS
CLEAR_FRAMES = 2
"""Frames in a row with their stars: the sky has cleared."""
STOP_POLL_S = 0.02
ENGINE_ENDS = CommandResult(kind="dropped", dropped_by="engine ended")


class _RunFailed(Exception):  # noqa: N818 -- carried from the loop to its own end
    """A run of a given number of frames met a fault that it cannot pass."""


class Engine:
    """Holds the state between cycles; every decision in it is made by a pure function."""

    def __init__(
        self,
        *,
        config: Config,
        hands: Hands,
        reducer: FrameReducer,
        record: Recorder,
        queue: CommandQueue,
        on_cycle: Callable[["Engine", Reduction], None] | None = None,
        pixels_of: PixelsOf = lambda _frame_id: None,
        past: Past | None = None,
    ) -> None:
        """``pixels_of``: those of one of the last frames, where they are kept.

        ``past``: what no catalogue knew on earlier nights.
        """
        self.config = config
        self.charge = Charge()
        self.hands = hands
        self.orbits = Orbits(config, past)
        self.guide = Guide(self.orbits.online, config)
        self.planner = Planner(config, self.guide)
        self.chronicle = Chronicle(record, hands.now_utc_ns, self.orbits.hear)
        self.watch = Watch(hands.instruments, config, queue, self.chronicle.append)
        self._parking = Parking(hands, self.chronicle)
        self.slews = Slews(hands, self.planner, self.watch, self.chronicle)
        self._exposures = Exposures(hands, self.planner, self.watch, self.chronicle, queue, config)
        self.cycle = Cycle(reducer, config)
        """What makes a track of frames, and knows the last ones."""
        self._queue = queue
        self._on_cycle = on_cycle
        self._plan: Plan | None = None
        self._kept = KeptTrack()
        self._is_first_look = False
        self._must_check_pointing = True
        self._faults = Faults()
        self._gave_up: str | None = None
        """Why autonomy gave the mount back by itself: a run of so many frames ends there."""
        self._has_dawned = False
        """The night is over, and the mount has not been asked for since."""
        self._clear_frames = 0
        self.last_track: TrackState | None = None
        """What was followed last this night."""
        self._ahead: AimAhead | None = None
        """Where the exposure after the next one would look."""
        self.temporary = Temporary()
        """Settings that hold for some frames only."""
        self._pace = Pace()
        self._places = PlacesOfInterest()
        parts = Parts(
            hands=hands,
            planner=self.planner,
            slews=self.slews,
            watch=self.watch,
            guide=self.guide,
            chronicle=self.chronicle,
        )
        self.leaping = Leaping(self, parts, self.cycle.glance)
        """Stares and leaps, where that is configured."""
        hands.on_opened, hands.on_closed = self.leaping.opened, self.leaping.closed
        self.by_hand = ByHand(self, parts)
        self.seeking = Seeking(self, hands, self.planner, self.slews, self.guide)
        self.verdicts = Verdicts(self, self.cycle, self.chronicle, pixels_of)
        self.handlers = joined(
            (
                Modes(self).handlers,
                self.by_hand.handlers,
                Settings(self, self.temporary, self.chronicle).handlers,
                self.verdicts.handlers,
                self.seeking.handlers,
            )
        )
        """How each command of the operator is checked and done."""
        hands.on_tick = self.watch.hear_loop
        self.interruptions = Interruptions(
            self,
            parts,
            self.by_hand,
            forget=self._forget_times,
            forget_camera=self._exposures.frame_times.forget,
            end_at_limit=self._exposures.end_at_limit,
        )
        """What nobody ordered: faults of the clock, slews ended by the mount's own process."""
        hands.on_clock_fault = self.interruptions.hear
        self._exposures.on_camera_set = self.interruptions.camera_set

    @property
    def frame_id(self) -> int:
        """The exposure begun last."""
        return self._exposures.frame_id

    @property
    def following(self) -> Following:
        """What is followed."""
        return self.charge.following

    @property
    def may_move(self) -> bool:
        """Whether autonomy has the mount and nobody holds it."""
        return self.charge.is_autonomous and not self.charge.is_held

    @property
    def hand_move(self) -> HandMove | None:
        """Where the operator has sent the mount, until it is there."""
        return self.by_hand.move

    def status(self) -> Status:
        """A snapshot, from any thread."""
        clock = self.hands.instruments.clock
        charge, now_ns = self.charge, self.chronicle.last_utc_ns()
        ahead = self._ahead if charge.is_autonomous and charge.following.tracks else None
        return status_of(
            charge,
            self.watch,
            frame_id=self.frame_id,
            now_utc_ns=now_ns,
            faults=self._faults.words,
            exposing_until_utc_ns=self._exposures.open_until_utc_ns,
            next_start_utc_ns=self._exposures.next_start_utc_ns,
            names=self.orbits.names,
            kept_until_utc_ns=self._kept.until_utc_ns,
            slew_left_s=self._slew_left_s(),
            markable_frames=self.verdicts.frame_ids,
            simulated_speed=clock.speed if clock.is_simulated else None,
            tracks=tracks_now(
                charge.following, self.orbits.names, self.cycle.folds.shown, now_ns, ahead
            ),
            next_aim=None if ahead is None else ahead.aim,
            orbits=self.orbits,
        )

    def _look_ahead(self) -> None:
        """Where the exposure after the next one would look, before the mount goes there."""
        ahead = None
        if self.charge.is_autonomous:
            now_ns = self.hands.now_utc_ns()
            ahead = self.planner.ahead(self.following, self._plan, now_ns)
        self._ahead = aim_ahead(ahead, self.following, self.config)

    def _slew_left_s(self) -> float | None:
        report, sent = self.watch.last_report, self.hands.sent
        if report is None or sent is None:
            return None
        return self.planner.slew_left_s(report, *sent)

    def wake(self) -> None:
        """Cut a wait short (any thread)."""
        self.hands.instruments.clock.wake()

    def arm(self, by: str = "operator", lifted: frozenset[str] = frozenset()) -> None:
        """Hand the mount to autonomy: search from where the telescope points.

        ``lifted``: checks of the arming list that are overridden by name. Raises ValueError when
        it is armed already.
        """
        report = self.hands.mount_report()
        if report.is_parked:
            self.hands.instruments.mount.unpark()
        # Lifted before it is armed: the watch may look in between.
        before = self.watch.lifted
        self.watch.take_charge(self.charge.is_responsible, lifted)
        try:
            self.happen(Armed(by=by))
        except ValueError:
            self.watch.take_charge(self.charge.is_responsible, before)
            raise
        self._faults.clear()
        if lifted:
            self.chronicle.say(
                "warning", f"armed without these checks: {', '.join(sorted(lifted))}"
            )

    def resume(self, by: str) -> None:
        """Give the mount back to autonomy, or follow again what was ended.

        Raises ValueError where there is nothing to resume, where the mount is parked, and where
        dome, weather or daylight would take it away again.
        """
        was_autonomous = self.charge.is_autonomous
        report = self.hands.mount_report()
        if report.is_parked and not was_autonomous:
            raise ValueError("the mount is parked: unpark it first")
        self.expect_night()
        self.happen(Resumed(by=by))
        if not was_autonomous:
            self.planner.moved_by_hand(report)

    def expect_night(self) -> None:
        """Raises ValueError where autonomy would get the mount and it is no night for it."""
        end = None if self.charge.is_autonomous else self.watch.night_end()
        if end is not None:
            raise ValueError(f"{end.detail}: autonomy gets the mount back when that has passed")

    def expect_cloud(self) -> None:
        """Raises ValueError where the stars are there: a hold until they are back would be none."""
        stars = self.cycle.star_count
        if stars is not None and self._clear_frames >= CLEAR_FRAMES:
            raise ValueError(f"no cloud now: {stars} stars; a plain hold lasts until you resume")

    def run(self, frames: int | None = None) -> None:
        """Work until shutdown, or until ``frames`` exposures have been begun or dawn has come.

        Raises InstrumentError when a run of ``frames`` cannot be finished, or when a simulated
        observatory is gone: no time passes without it.
        """
        with self.watch.running():
            while not self._queue.is_shutdown and not self._is_over(frames):
                try:
                    self._heed_alarms()
                    self._execute_commands()
                    self._one_turn(is_bounded=frames is not None)
                except Interrupted:
                    continue
                except StoppedElsewhere as stopped:
                    self._not_where_left(str(stopped))
                except _RunFailed as error:
                    raise InstrumentError(f"the run ended {error}") from error
                except NowhereError as error:
                    if self.planner.leave_spiral():
                        self.chronicle.say("warning", f"nothing left to look at there: {error}")
                    elif error.is_dawn:
                        parks = self.config.mount.park_at_end
                        self.happen(NightEnded(words=f"{error}", parks=parks, is_dawn=True))
                    else:
                        self._on_failure(f"nowhere to search: {error}", is_final=True)
                except RsoconsoleError as error:
                    self._on_failure(str(error))
                except Exception as error:  # the telescope must not be left to itself
                    log.exception("the loop broke")
                    self._on_failure(f"the loop broke ({error}): see the log", is_final=True)
            self._end()

    def _is_over(self, frames: int | None) -> bool:
        """Whether a run of so many frames has come to its end."""
        if frames is None:
            return False
        return self.frame_id >= frames or (self._has_dawned and not self._parking.is_wanted)

    def _one_turn(self, *, is_bounded: bool) -> None:
        if self._kept.is_over(self.hands.now_utc_ns()):
            before = self.charge
            self._enter(without_kept(before), None)
            self._note_given_up(before)
        self.interruptions.look_at_mount()
        is_at_work = self.charge.is_autonomous or self.charge.state == "MANUAL"
        if is_at_work and not self.hands.instruments.clock.is_steady:
            # What is measured now has no time.
            self.hands.wait_until(self.hands.now_utc_ns() + IDLE_TICK_NS)
        elif self.charge.is_autonomous:
            self._one_exposure()
        elif self.charge.state == "MANUAL":
            self._one_look()
        else:
            if is_bounded and self.charge.state == "FAULT":
                fault = ("see the session's log", *self._faults.words)[-1]
                raise _RunFailed(f"in FAULT: {fault}")
            self._parking.see_to_it()
            self._see_whether_over()
            if is_bounded and self._gave_up is not None and not self._parking.is_wanted:
                raise _RunFailed(f"early: {self._gave_up}")
            self.hands.wait_until(self.hands.now_utc_ns() + IDLE_TICK_NS)

    def _see_whether_over(self) -> None:
        """A fault whose cause was the mount's silence is over once the mount answers again."""
        stopped = self._faults.take_stop(self.watch)
        if stopped is not None:
            # Given once more: nobody knows what the mount has done meanwhile.
            self.chronicle.say("info", "the mount answers again and stands: STOP is over")
            self.happen(replace(stopped, is_confirmed=True))
        elif self._faults.is_over(self.charge, self.watch):
            self._faults.clear()
            self.chronicle.say("info", "the mount answers again: arming goes on")

    def _not_where_left(self, words: str) -> None:
        """The mount's own process did that, or somebody else: autonomy waits for those."""
        try:
            if self.interruptions.goes_on_after():
                return
        except Interrupted:
            return
        except InstrumentError as error:
            self._on_failure(str(error))
            return
        self.chronicle.say("alarm", f"{words}: somebody else did that, autonomy waits for 'resume'")
        self.happen(Taken(by="somebody else"))

    def _end(self) -> None:
        if self._queue.is_shutdown:
            result = self.hands.instruments.mount.abort()
            with contextlib.suppress(Interrupted):
                self._heed_alarms()
            for request in self._queue.take_all():
                is_done = request.command.survives_stop
                self.chronicle.append(action_record(request, DONE if is_done else ENGINE_ENDS))
            if not result.stopped:
                self.chronicle.say("alarm", f"the mount did not confirm its stop: {result.detail}")
            self._enter(Charge(), Cause(kind="engine ended"))
            if result.stopped:
                self.chronicle.say("info", "the engine ends, the mount stands", "engine ended")

    def happen(self, happening: Happening) -> Step:
        """Pass through one step: do what it asks, and put the change on record.

        Raises ValueError with the reason where the step refuses.
        """
        before = self.charge
        result = step(before, happening)
        if result.refusal is not None:
            raise ValueError(result.refusal)
        self._enter(result.charge, result.reason)
        if not isinstance(happening, Followed | Marked):
            self._forget_since(before)
            self._note_given_up(before)
        if isinstance(happening, LimitMet | BY_OPERATOR):
            self.by_hand.move = None
        if isinstance(happening, BY_OPERATOR):
            self._parking.forget()
        self._note_giving_up(happening)
        self._note_end_of_fault(before, happening)
        if not self.charge.is_autonomous:
            self._is_first_look = False
            self.leaping.forget()
            # The next arming looks with the night's own exposure.
            self._set_pace(None)
        for action in result.actions:
            if action == "abort":
                self.hands.instruments.mount.abort()
            elif action == "park":
                self._parking.want()
            elif action == "start search":
                self._is_first_look = True
                # Who set the clock has not turned the telescope: a cloud ends no night for that.
                self._must_check_pointing = not isinstance(happening, ClockSet)
                self.planner.start_search(self.hands.mount_report(), self.hands.now_utc_ns())
            elif action == "search home":
                self.planner.go_home()
            else:
                self.cycle.forget_plate()
        return result

    def _note_end_of_fault(self, before: Charge, happening: Happening) -> None:
        """The operator, or a STOP that is confirmed at last, has ended it."""
        is_ended = isinstance(happening, BY_OPERATOR) or before.state != "IDLE"
        if (self.charge.state == "IDLE" and is_ended) or (
            before.state == "FAULT" != self.charge.state
        ):
            self._faults.clear()

    def _forget_since(self, before: Charge) -> None:
        """Something from outside: words on frames before it lead nowhere, nor does the plan."""
        if self.charge.following is not before.following:
            self.cycle.folds.forget()
        if self.charge.state != before.state:
            self.cycle.hand.forget()
        self._plan = self._exposures.next_start_utc_ns = None

    def _note_given_up(self, before: Charge) -> None:
        """A kept track is worth nothing any more, and no change of state says so."""
        given_up = before.kept
        if given_up is None or self.charge.kept is not None or self.charge.state != before.state:
            return
        words = f"{kept_name(given_up, self.orbits.names)} can no longer be followed again"
        self.chronicle.say("info", words, "kept")

    def _note_giving_up(self, happening: Happening) -> None:
        if self.charge.state != "IDLE":
            self._gave_up, self._has_dawned = None, False
        elif isinstance(happening, NightEnded) and happening.is_dawn:
            self._has_dawned = True
        elif isinstance(happening, NotPointing | NightEnded):
            self._gave_up = happening.words

    def configure(self, config: Config) -> None:
        """Take new tunables; in force from the next cycle."""
        before, self.config = self.config, config
        whole = (self.hands, self.cycle, self.planner, self.orbits, self.guide, self.watch)
        for part in (*whole, self._exposures):
            part.configure(config)
        self.leaping.configure(before)

    def _one_exposure(self) -> None:
        """Wait for the mount, expose, reduce, follow, send the mount on; then put it on record."""
        plan = self._plan or self._order_next()
        self._plan = None
        poll_ns, settle_s = POLL_NS, None
        if self.leaping.is_on:
            poll_ns, settle_s = LEAP_POLL_NS, self.leaping.times.settle_s()
        is_held = self.charge.is_held
        if self.slews.finish(plan, is_held=is_held, poll_ns=poll_ns, settle_s=settle_s):
            self.cycle.forget_plate()
        self.leaping.times.arrived()
        place_px: tuple[float, float] | None = None
        frame: Frame | None = None
        try:
            frame, read_ms = self._exposures.take(plan)
            self._exposures.pass_readout_time(frame)
            self.leaping.read_out(frame)
            self._exposures.pass_processing_time()
            reduction = self._reduce_and_go_on(frame, read_ms, plan.blocked)
            place_px = self._places.of(frame, reduction, self.following)
        finally:
            self.leaping.drop_early()
            # Also the frame that could not be used: it is the one somebody will want to see.
            if frame is not None:
                self._exposures.keep(frame, self.following.state, place_px)

    def _order_next(self) -> Plan:
        """Where and when the next exposure is; the mount is on its way when this returns."""
        if self._is_first_look:
            return self.planner.first_look(self.hands.now_utc_ns())
        if self.leaping.is_on:
            return self.leaping.order_next(is_held=self.charge.is_held)
        return self.slews.order_next(self.following, is_held=self.charge.is_held)

    def _one_look(self) -> None:
        """An exposure while the operator has the mount: shown and measured, not followed."""
        if self.hand_move is not None:
            report = self.hands.wait_for_arrival(*self.hand_move.command)
            self.by_hand.move = None
            self.planner.moved_by_hand(report)
            self.chronicle.say("info", "the mount has arrived")
        frame, _ = self._exposures.take(self.planner.first_look(self.hands.now_utc_ns()))
        place_px: tuple[float, float] | None = None
        try:
            self._exposures.pass_readout_time(frame)
            self._exposures.pass_processing_time()
            reduction, records = self.cycle.look(frame)
            place_px = self._places.of(frame, reduction, self.following)
            if isinstance(reduction.solution, Solution):
                self.planner.solved(reduction.solution)
            self.chronicle.tell(records)
            self.charge = replace(self.charge, failures=0)
            self._faults.clear()
            self._count_frame()
        finally:
            self._exposures.keep(frame, self.following.state, place_px)

    def _count_frame(self) -> None:
        """One frame is done: what holds for some frames, or until the sky clears, may be over."""
        config, changes = self.temporary.count(self.config)
        for change in changes:
            self.chronicle.append(change)
        if changes:
            self.configure(config)
        if not self.leaping.is_on:
            self._set_pace(self.following.track)
        if self.following.track is not None:
            self.last_track = self.following.track
        is_cloudy = self.cycle.cloud is not None
        self._clear_frames = 0 if is_cloudy else self._clear_frames + 1
        if self.charge.resumes_when_clear and self._clear_frames >= CLEAR_FRAMES:
            self.chronicle.say("info", "the stars are back: slews again")
            self.happen(Resumed(by="the sky"))

    def _set_pace(self, track: TrackState | None) -> None:
        """Exposure and cadence for what is followed; the night's own where nothing is."""
        config, changes = self._pace.after(self.config, track)
        for change in changes:
            self.chronicle.append(change)
        if changes:
            self.configure(config)

    def _reduce_and_go_on(
        self, frame: Frame, read_ms: float, blocked: SlewRefusal | None
    ) -> Reduction:
        began_s = time.perf_counter()
        before = self.following
        result = self.cycle.run(frame, before, blocked, self.orbits.last)
        folded_s = time.perf_counter()
        self.chronicle.tell(result.records)
        self.happen(Followed(after=result.after))
        if isinstance(result.reduction.solution, Solution):
            self.planner.solved(result.reduction.solution)
        self.planner.followed(before, result.after, self.hands.now_utc_ns())
        self._count_frame()
        is_first_look, self._is_first_look = self._is_first_look, False
        if is_first_look and self._must_check_pointing:
            self._check_pointing(result.reduction)
        self.leaping.saw(frame, result.reduction)
        if self.charge.is_autonomous:
            self._plan = self._order_next()
            self._exposures.next_start_utc_ns = self._plan.t_start_utc_ns
        ordered_s = time.perf_counter()
        reduce_ms = result.reduction.stage_ms
        stages = {
            "read": read_ms,
            **self.leaping.take_stage_ms(),
            **reduce_ms,
            "filter": (folded_s - began_s) * 1e3 - sum(reduce_ms.values()),
            "order": (ordered_s - folded_s) * 1e3,
            "total": (ordered_s - began_s) * 1e3 + read_ms,
        }
        # The mount is on its way: nobody waits for this.
        self.leaping.plan_pass()
        lqe.make_ready()
        self.chronicle.tell(self.orbits.refine())
        self.guide.prepare(self.hands.now_utc_ns())
        self._look_ahead()
        stages["orbit"] = (time.perf_counter() - ordered_s) * 1e3
        self.chronicle.append(CycleTiming(frame_id=frame.frame_id, stage_ms=stages))
        self._faults.clear()
        if self._on_cycle is not None:
            self._on_cycle(self, result.reduction)
        return result.reduction

    def _forget_times(self) -> None:
        """What lives by times that are wrong."""
        self.last_track = None
        self.orbits.forget()
        self.leaping.forget_times()

    def _check_pointing(self, reduction: Reduction) -> None:
        """The first frame after arming must agree with where the mount says it looks."""
        check = pointing_check(reduction.solution, self.hands.mount_report(), self.config)
        if check.ok:
            self.chronicle.say("info", check.detail)
        elif "pointing" in self.watch.lifted:
            self.chronicle.say("warning", f"{check.detail}: overridden")
        else:
            words = f"{check.detail}; {check.remedy}"
            self.chronicle.say("alarm", f"not armed: {words}")
            self.happen(NotPointing(words=words))

    def _execute_commands(self) -> None:
        """Do what waits, in order; each gets its outcome on record, whatever comes between."""
        requests = self._queue.take_all()
        for number, request in enumerate(requests):
            outcome = DONE
            try:
                with self._queue.executing():
                    outcome = self._execute(request)
            except (ValueError, InstrumentError, StoppedElsewhere) as error:
                outcome = CommandResult.refused(error)
                log.warning("%s refused: %s", request.command.verb, error)
            except Interrupted:
                self._put_back(requests[number:])
                raise
            except Exception as error:  # a fault of ours: it goes up, and no command with it
                failed = CommandResult(kind="failed", detail=f"{type(error).__name__}: {error}")
                self.chronicle.append(action_record(request, failed))
                self._put_back(requests[number + 1 :])
                raise
            self.chronicle.append(action_record(request, outcome))
        self._queue.finished()
        if requests:
            self._look_ahead()

    def _put_back(self, requests: tuple[Request, ...]) -> None:
        """Taken from the queue already: they wait again; what was undone there is undone here."""
        undone, result = self._queue.put_back(requests)
        for each in undone:
            self.chronicle.append(action_record(each, result))

    def _execute(self, request: Request) -> CommandResult:
        """One command, by its handler. Raises as the handler does."""
        return self.handlers[type(request.command)].execute(request.command, request.by)

    def park(self, by: str) -> None:
        """Disarm and send the mount to its park position, again and again until it is there."""
        self.happen(Disarmed(by=by))
        # What was followed before is gone back to only after the checklist.
        self._enter(replace(self.charge, is_resumable=False), None)
        self._parking.want()

    def _heed_alarms(self) -> None:
        """What cut the loop short: pass through its step, then say so.

        Raises Interrupted while a STOP is still talking to the mount on its own thread: nothing
        may be executed before it is over.
        """
        if not self._queue.is_stopping:
            return
        alarms = self._queue.take_alarms()
        if not alarms:
            time.sleep(STOP_POLL_S)
            raise Interrupted
        # An order may have been on its way when the flag went up: stop the mount once more.
        again = self.hands.instruments.mount.abort()
        for alarm in alarms:
            for request in alarm.dropped:
                self.chronicle.append(action_record(request, dropped_by(alarm.happening)))
            self._heed(alarm, again.stopped)

    def _heed(self, alarm: Alarm, is_stopped_again: bool) -> None:
        # The words first: what has to be done may fail.
        topic: Topic = "limit" if isinstance(alarm.happening, LimitMet) else ""
        words = alarm_words(alarm, is_stopped_again, self.config)
        self.chronicle.say("alarm", words, topic)
        happening = alarm.happening
        if not isinstance(happening, Stopped):
            self.happen(happening)
            return
        is_confirmed = is_stopped_again or (alarm.result is not None and alarm.result.stopped)
        stopped = replace(happening, is_confirmed=is_confirmed)
        self.happen(stopped)
        if not is_confirmed:
            self._faults.expect_stop(stopped, words, self.hands.now_utc_ns())

    def _on_failure(self, words: str, *, is_final: bool = False) -> None:
        if self.charge.state == "FAULT":
            if self.hands.instruments.clock.is_simulated:
                raise InstrumentError(words)
            time.sleep(1.0)  # whatever is broken passes no time by itself
            return
        if self._faults.add(words):  # said once, however often it fails
            self.chronicle.say("alarm", words)
        reason = Missed(kind="instrument", detail=words)
        tracks = [each.track.track_id for each in self.following.tracks]
        for track_id in tracks or (None,):
            self.chronicle.append(Miss(frame_id=self.frame_id, reason=reason, track_id=track_id))
        self.happen(Failed(words=words, is_final=is_final))

    def _enter(self, charge: Charge, reason: Cause | None) -> None:
        before, self.charge = self.charge.state, charge
        # What was overridden stands as long as the mount can be given back without a checklist.
        over = charge.state in ("IDLE", "FAULT") and not charge.is_resumable
        self._kept.see(charge, self.config.filter, self.chronicle.last_utc_ns())
        self.watch.take_charge(charge.is_responsible, frozenset() if over else None)
        # Without a reason it is the fold's own passage, which is on record already.
        if before != charge.state and reason is not None:
            self.chronicle.append(
                StateChange(
                    frame_id=self.frame_id,
                    before=before,
                    after=charge.state,
                    reason=reason,
                    kept_track_id=0 if charge.kept is None else charge.kept.track_id,
                )
            )
