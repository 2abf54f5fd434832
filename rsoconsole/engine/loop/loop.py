"""The loop: plan, slew, expose, reduce, follow, record; its decisions are made elsewhere."""

import contextlib
import logging
import time
from collections.abc import Callable
from dataclasses import replace
from queue import Empty, SimpleQueue

from rsoconsole.base import InstrumentError, RsoconsoleError
from rsoconsole.config import Config
from rsoconsole.control import Status
from rsoconsole.engine.aim.guide import Guide
from rsoconsole.engine.aim.instrument_controller import (
    NS,
    InstrumentController,
    Interrupted,
    StoppedElsewhere,
)
from rsoconsole.engine.aim.plan import Planner
from rsoconsole.engine.aim.states import (
    BY_OPERATOR,
    Armed,
    Authority,
    ClockSet,
    Disarmed,
    Failed,
    Followed,
    LimitMet,
    Marked,
    NightEnded,
    NotPointing,
    Resumed,
    Step,
    Taken,
    Trigger,
    step,
    without_kept,
)
from rsoconsole.engine.leaps.leaping import Leaping
from rsoconsole.engine.loop._command_turn import CommandTurn
from rsoconsole.engine.loop._frame_turn import CLEAR_FRAMES, FrameTurn
from rsoconsole.engine.loop._status import status_of
from rsoconsole.engine.loop.interruptions import Interruptions
from rsoconsole.engine.operator.by_hand import ByHand, HandMove, Parts
from rsoconsole.engine.operator.decisions import Decisions, PixelsOf
from rsoconsole.engine.operator.handlers import Modes, Seeking, Settings, joined
from rsoconsole.engine.tasks.command_queue import CommandQueue, action_record
from rsoconsole.engine.tasks.exposures import Exposures
from rsoconsole.engine.tasks.faults import Faults
from rsoconsole.engine.tasks.field_tracks import KeptTrack, kept_name, tracks_now
from rsoconsole.engine.tasks.parking import Parking
from rsoconsole.engine.tasks.session_log import SessionLog
from rsoconsole.engine.tasks.slews import NowhereError, Slews
from rsoconsole.engine.tasks.watch import Watch
from rsoconsole.instruments import StopResult
from rsoconsole.pipeline import Cycle, FrameReducer, Orbits, Past, Reduction
from rsoconsole.records import DONE, Cause, CommandResult, Miss, Missed, StateChange, TrackState
from rsoconsole.session import SessionWriter as Recorder
from rsoconsole.tracking import Following
from rsoconsole.words import CUT_POWER, NO_PARK, measured_text, unmeasured_text

log = logging.getLogger(__name__)

IDLE_TICK_NS = NS
END_MEASURED_S = 8.0
"""How long an engine that ends measures how it leaves the mount."""
ENGINE_ENDS = CommandResult(kind="dropped", dropped_by="engine ended")


class _RunFailed(Exception):  # noqa: N818 -- carried from the loop to its own end
    """A run of a given number of frames met a fault that it cannot pass."""


class Engine:
    """Runs the loop and holds its state between cycles; pure functions make its decisions."""

    def __init__(
        self,
        *,
        config: Config,
        instrument_controller: InstrumentController,
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
        self.authority = Authority()
        self.instrument_controller = instrument_controller
        self.orbits = Orbits(config, past)
        self.guide = Guide(self.orbits.online, config)
        self.planner = Planner(config, self.guide)
        self.session_log = SessionLog(record, instrument_controller.now_utc_ns, self.orbits.receive)
        self.watch = Watch(
            instrument_controller.instruments,
            config,
            queue,
            self.session_log.append,
            lambda: instrument_controller.ordered,
        )
        self._parking = Parking(instrument_controller, self.session_log)
        self.slews = Slews(instrument_controller, self.planner, self.watch, self.session_log)
        self._exposures = Exposures(
            instrument_controller, self.planner, self.watch, self.session_log, config
        )
        self.cycle = Cycle(reducer, config)
        """What makes a track of frames, and knows the last ones."""
        self._queue = queue
        self._kept = KeptTrack()
        self._faults = Faults()
        self._gave_up: str | None = None
        """Why autonomy gave the mount back by itself: a run of a given length ends there."""
        self._has_dawned = False
        """The night is over, and the mount has not been asked for since."""
        parts = Parts(
            instrument_controller=instrument_controller,
            planner=self.planner,
            slews=self.slews,
            watch=self.watch,
            guide=self.guide,
            session_log=self.session_log,
        )
        self.leaping = Leaping(self, parts, self.cycle.glance)
        """Stares and leaps, where that is configured."""
        instrument_controller.on_opened, instrument_controller.on_closed = (
            self.leaping.opened,
            self.leaping.closed,
        )
        self.by_hand = ByHand(self, parts)
        self.frames = FrameTurn(
            self,
            parts,
            exposures=self._exposures,
            cycle=self.cycle,
            orbits=self.orbits,
            leaping=self.leaping,
            by_hand=self.by_hand,
            faults=self._faults,
            forgive=self._forgive,
            on_cycle=lambda reduction: on_cycle(self, reduction) if on_cycle else None,
        )
        """Each exposure's way through the loop."""
        self.seeking = Seeking(self, instrument_controller, self.planner, self.slews, self.guide)
        self.decisions = Decisions(self, self.cycle, self.session_log, pixels_of)
        self.handlers = joined(
            (
                Modes(self).handlers,
                self.by_hand.handlers,
                Settings(self, self.frames.temporary, self.session_log).handlers,
                self.decisions.handlers,
                self.seeking.handlers,
            )
        )
        """How each command of the operator is checked and done."""
        self.commands = CommandTurn(
            self,
            instrument_controller,
            queue,
            self.session_log,
            self._faults,
            handlers=self.handlers,
            on_executed=self.frames.look_ahead,
        )
        """What waits in the queue, and what cuts a wait short."""
        instrument_controller.on_tick = self.watch.loop_is_alive
        self.interruptions = Interruptions(
            self,
            parts,
            self.by_hand,
            forget=self._forget_times,
            forget_camera=self._exposures.frame_times.forget,
            end_at_limit=self._exposures.end_at_limit,
        )
        """What nobody ordered: faults of the clock, slews ended by the mount's own process."""
        instrument_controller.on_clock_fault = self.interruptions.receive
        self._exposures.on_camera_set = self.interruptions.camera_set

    @property
    def frame_id(self) -> int:
        """Number of the last exposure that was begun."""
        return self._exposures.frame_id

    @property
    def following(self) -> Following:
        """The followed tracks, and the state of the fold over frames."""
        return self.authority.following

    @property
    def last_track(self) -> TrackState | None:
        """The last lead track of this night; None without one."""
        return self.frames.last_track

    @property
    def may_move(self) -> bool:
        """True where autonomy has control and no hold stops its slews."""
        return self.authority.is_autonomous and not self.authority.is_held

    @property
    def hand_move(self) -> HandMove | None:
        """The move by hand under way; None once it has arrived."""
        return self.by_hand.move

    def status(self) -> Status:
        """Return the engine's present status; may be called from any thread."""
        clock = self.instrument_controller.instruments.clock
        authority, now_ns = self.authority, self.session_log.last_utc_ns()
        ahead = (
            self.frames.ahead if authority.is_autonomous and authority.following.tracks else None
        )
        return status_of(
            authority,
            self.watch,
            frame_id=self.frame_id,
            now_utc_ns=now_ns,
            faults=self._faults.words,
            exposing_until_utc_ns=self._exposures.open_until_utc_ns,
            next_start_utc_ns=self._exposures.next_start_utc_ns,
            names=self.orbits.names,
            kept_until_utc_ns=self._kept.until_utc_ns,
            slew_left_s=self._slew_left_s(),
            markable_frames=self.decisions.frame_ids,
            simulated_speed=clock.speed if clock.is_simulated else None,
            tracks=tracks_now(
                authority.following,
                self.orbits.names,
                self.cycle.folds.shown,
                now_ns,
                ahead,
                lights=self.frames.lights,
            ),
            next_aim=None if ahead is None else ahead.aim,
            orbits=self.orbits,
            light=self.frames.lights.last,
        )

    def _slew_left_s(self) -> float | None:
        report, sent = self.watch.last_report, self.instrument_controller.sent
        if report is None or sent is None:
            return None
        return self.planner.slew_left_s(report, *sent)

    def wake(self) -> None:
        """End the loop's present wait; may be called from any thread."""
        self.instrument_controller.instruments.clock.wake()

    def arm(self, by: str = "operator", lifted: frozenset[str] = frozenset()) -> None:
        """Give control to autonomy: search from where the telescope points.

        A parked mount is released, and a park under way ended; a move by hand is waited for.
        ``lifted``: names of the arming checks that are overridden. Raises ValueError when armed
        already, Interrupted when the loop is interrupted meanwhile.
        """
        refusal = step(self.authority, Armed(by=by)).refusal
        if refusal is not None:
            raise ValueError(refusal)
        self.end_park()
        if self.instrument_controller.mount_report().is_slewing:
            # Or the search would begin somewhere on the way of a move by hand.
            self.instrument_controller.wait_for_rest()
        self.instrument_controller.instruments.mount.set_sidereal_rate()
        # Lifted before it is armed: the watch may look in between.
        before = self.watch.lifted
        self.watch.take_over(self.authority.is_responsible, lifted)
        try:
            self.handle(Armed(by=by))
        except ValueError:
            self.watch.take_over(self.authority.is_responsible, before)
            raise
        self._faults.clear()
        if lifted:
            self.session_log.say(
                "warning", f"armed without these checks: {', '.join(sorted(lifted))}"
            )

    def resume(self, by: str) -> None:
        """Give control back to autonomy, or follow an ended track again.

        A move by hand under way is ended where a track is followed again; else it is waited for,
        and the search begins where it ends. Raises ValueError where there is nothing to resume,
        where the mount is parked, and where dome, weather or daylight would end autonomy.
        """
        was_autonomous = self.authority.is_autonomous
        report = self.instrument_controller.mount_report()
        if not was_autonomous and (report.is_parked or report.is_parking):
            how = "parked" if report.is_parked else "on its way to its park position"
            raise ValueError(f"the mount is {how}: unpark it first")
        self.expect_night()
        refusal = step(self.authority, Resumed(by=by)).refusal
        if refusal is None and not was_autonomous and report.is_slewing:
            if self.authority.kept is not None:
                self.instrument_controller.end_motion()
            report = self.instrument_controller.wait_for_rest()
        self.handle(Resumed(by=by))
        if not was_autonomous:
            self.planner.moved_by_hand(report)

    def expect_night(self) -> None:
        """Raise ValueError where dome, weather or daylight would end autonomy at once.

        Does nothing where autonomy has control already.
        """
        end = None if self.authority.is_autonomous else self.watch.night_end()
        if end is not None:
            raise ValueError(f"{end.detail}: autonomy gets the mount back when that has passed")

    def expect_cloud(self) -> None:
        """Raise ValueError under a clear sky, where "hold until clear" would end at once."""
        stars = self.cycle.star_count
        if stars is not None and self.frames.clear_frames >= CLEAR_FRAMES:
            raise ValueError(f"no cloud now: {stars} stars; a plain hold lasts until you resume")

    def run(self, frames: int | None = None) -> None:
        """Run until shutdown, or until ``frames`` exposures have been begun or dawn has come.

        Raises InstrumentError when a run of ``frames`` cannot be finished, or when a simulated
        observatory has gone, without which no time passes.
        """
        with self.watch.running():
            while not self._queue.is_shutdown and not self._is_over(frames):
                try:
                    self.commands.heed_alarms()
                    self.commands.execute_waiting()
                    self._one_turn(is_bounded=frames is not None)
                except Interrupted:
                    continue
                except StoppedElsewhere as stopped:
                    self._not_where_left(str(stopped))
                except _RunFailed as error:
                    raise InstrumentError(f"the run ended {error}") from error
                except NowhereError as error:
                    if self.planner.leave_spiral():
                        self.session_log.say("warning", f"nothing left to look at there: {error}")
                    elif error.is_dawn:
                        parks = self.config.mount.park_at_end
                        self.handle(NightEnded(words=f"{error}", parks=parks, is_dawn=True))
                    else:
                        self._on_failure(f"nowhere to search: {error}", is_final=True)
                except RsoconsoleError as error:
                    self._on_failure(str(error))
                except Exception as error:  # the telescope must not be left to itself
                    log.exception("the loop broke")
                    self._on_failure(f"the loop broke ({error}): see the log", is_final=True)
            self._end()

    def _is_over(self, frames: int | None) -> bool:
        """Whether a run of a given number of frames has come to its end."""
        if frames is None:
            return False
        return self.frame_id >= frames or (self._has_dawned and not self._parking.is_wanted)

    def _one_turn(self, *, is_bounded: bool) -> None:
        if self._kept.is_over(self.instrument_controller.now_utc_ns()):
            before = self.authority
            self._enter(without_kept(before), None)
            self._note_given_up(before)
        self.interruptions.look_at_mount()
        is_at_work = self.authority.is_autonomous or self.authority.state == "MANUAL"
        if is_at_work and not self.instrument_controller.instruments.clock.is_steady:
            # What is measured now has no time.
            self.instrument_controller.wait_until(
                self.instrument_controller.now_utc_ns() + IDLE_TICK_NS
            )
        elif self.authority.is_autonomous:
            self.frames.one_exposure()
        elif self.authority.state == "MANUAL":
            self.frames.one_look()
        else:
            if is_bounded and self.authority.state == "FAULT":
                fault = ("see the session's log", *self._faults.words)[-1]
                raise _RunFailed(f"in FAULT: {fault}")
            self._parking.see_to_it()
            self._see_whether_over()
            if is_bounded and self._gave_up is not None and not self._parking.is_wanted:
                raise _RunFailed(f"early: {self._gave_up}")
            self.instrument_controller.wait_until(
                self.instrument_controller.now_utc_ns() + IDLE_TICK_NS
            )

    def _see_whether_over(self) -> None:
        """A fault whose cause was the mount's silence is over once the mount answers again."""
        stopped = self._faults.take_stop(self.watch)
        if stopped is not None:
            # Given once more: nobody knows what the mount has done meanwhile.
            report = self.watch.last_report
            how = "is at rest" if report is None else report.motion.kind
            words = f"the mount {how}, measured: STOP is over"
            self.session_log.say("info", words)
            self.handle(replace(stopped, is_obeyed=True))
        elif self._faults.is_over(self.authority, self.watch):
            self._faults.clear()
            self.session_log.say("info", "the mount answers again: arming goes on")

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
        self.session_log.say(
            "alarm", f"{words}: somebody else did that, autonomy waits for 'resume'"
        )
        self.handle(Taken(by="somebody else"))

    def _end(self) -> None:
        if self._queue.is_shutdown:
            measured: SimpleQueue[StopResult] = SimpleQueue()
            result = self.instrument_controller.instruments.mount.abort(on_news=measured.put)
            self.leaping.forget("the engine ends")
            with contextlib.suppress(Interrupted):
                self.commands.heed_alarms()
            for request in self._queue.take_all():
                came_of_it = DONE if request.command.survives_stop else ENGINE_ENDS
                self.session_log.append(action_record(request, came_of_it))
                request.course.settle(came_of_it)
            said, is_alarm = self._how_it_ends(result, measured)
            self._enter(Authority(), Cause(kind="engine ended"))
            words = f"the engine ends, {said}"
            if is_alarm:
                self.session_log.say("alarm", words)
            else:
                self.session_log.say("info", words, "engine ended")

    def _how_it_ends(self, result: StopResult, news: SimpleQueue[StopResult]) -> tuple[str, bool]:
        """How the engine leaves the mount, and whether that is an alarm."""
        if self.instrument_controller.instruments.clock.is_simulated:
            if result.is_answered:  # no time passes any more in which it could be measured
                return "the mount is at rest, by its driver's word", False
            return f"the mount's driver did not answer ABORT: {result.detail}", True
        ends_s = time.monotonic() + END_MEASURED_S
        while result.motion is None and (left_s := ends_s - time.monotonic()) > 0.0:
            with contextlib.suppress(Empty):
                result = news.get(timeout=left_s)
        if result.is_at_rest and result.motion is not None:
            return f"the mount {result.motion.kind}, measured", False
        if result.rate_deg_s is not None:
            return measured_text("moves", result.rate_deg_s), True
        return unmeasured_text(result.detail, f"{CUT_POWER} if it does"), True

    def handle(self, trigger: Trigger) -> Step:
        """Pass a trigger through the state machine; perform and record the step, and return it.

        Raises ValueError, with the reason, where the state machine refuses.
        """
        before = self.authority
        result = step(before, trigger)
        if result.refusal is not None:
            raise ValueError(result.refusal)
        if "abort" in result.actions:
            # Before all else: what follows may wait for a camera.
            self.instrument_controller.instruments.mount.abort()
        self._enter(result.authority, result.reason)
        if not isinstance(trigger, Followed | Marked):
            self._forget_since(before)
            self._note_given_up(before)
        is_ended = "abort" in result.actions or isinstance(trigger, LimitMet)
        if is_ended or isinstance(trigger, BY_OPERATOR):
            self.by_hand.move = None
        if is_ended:
            self.instrument_controller.forget_order()
        if isinstance(trigger, BY_OPERATOR):
            self._parking.forget()
        self._note_giving_up(trigger)
        self._note_end_of_fault(before, trigger)
        if not self.authority.is_autonomous:
            self.frames.end_autonomy()
        for action in result.actions:
            if action == "park":
                self._parking.want()
            elif action == "start search":
                # Who set the clock has not turned the telescope: a cloud ends no night for that.
                self.frames.begin_search(checks_pointing=not isinstance(trigger, ClockSet))
            elif action == "search home":
                self.planner.go_home()
            elif action != "abort":
                self.cycle.forget_plate()
        return result

    def _note_end_of_fault(self, before: Authority, trigger: Trigger) -> None:
        """The operator, or a STOP that is confirmed at last, has ended it."""
        is_ended = isinstance(trigger, BY_OPERATOR) or before.state != "IDLE"
        if (self.authority.state == "IDLE" and is_ended) or (
            before.state == "FAULT" != self.authority.state
        ):
            self._faults.clear()

    def _forget_since(self, before: Authority) -> None:
        """Something from outside: words on frames before it lead nowhere, nor does the plan."""
        if self.authority.following is not before.following:
            self.cycle.folds.forget()
        if self.authority.state != before.state:
            self.cycle.hand.forget()
        self.frames.forget_plan()

    def _note_given_up(self, before: Authority) -> None:
        """A kept track is worth nothing any more, and no change of state says so."""
        given_up = before.kept
        if (
            given_up is None
            or self.authority.kept is not None
            or self.authority.state != before.state
        ):
            return
        words = f"{kept_name(given_up, self.orbits.names)} can no longer be followed again"
        self.session_log.say("info", words, "kept")

    def _note_giving_up(self, trigger: Trigger) -> None:
        if self.authority.state != "IDLE":
            self._gave_up, self._has_dawned = None, False
        elif isinstance(trigger, NightEnded) and trigger.is_dawn:
            self._has_dawned = True
        elif isinstance(trigger, NotPointing | NightEnded):
            self._gave_up = trigger.words

    def configure(self, config: Config) -> None:
        """Use a new configuration from the next cycle on."""
        before, self.config = self.config, config
        whole = (
            self.instrument_controller,
            self.cycle,
            self.planner,
            self.orbits,
            self.guide,
            self.watch,
        )
        for part in (*whole, self._exposures):
            part.configure(config)
        self.leaping.configure(before)

    def _forget_times(self) -> None:
        """What lives by times that are wrong."""
        self.frames.last_track = None
        self.orbits.forget()
        self.leaping.forget_times()

    def park(self, by: str) -> None:
        """Disarm and send the mount to its park position, repeating the order until it is there.

        Raises ValueError where its driver has no park position, InstrumentError where it
        refuses.
        """
        with contextlib.suppress(InstrumentError):  # whether a silent mount has one is seen later
            if not self.instrument_controller.instruments.mount.abilities().can_park:
                raise ValueError(NO_PARK)
        self.handle(Disarmed(by=by))
        # What was followed before is gone back to only after the checklist.
        self._enter(replace(self.authority, is_resumable=False), None)
        self.instrument_controller.heed()
        self._parking.want()
        self._parking.see_to_it()
        if self._parking.trouble:
            again = "; it is told again: 'unpark' ends that" if self._parking.is_wanted else ""
            raise InstrumentError(f"{self._parking.trouble}{again}")

    @property
    def is_park_wanted(self) -> bool:
        """True while the mount is to be parked and is not parked yet."""
        return self._parking.is_wanted

    def end_park(self) -> None:
        """End parking: release a parked mount, or stop one that is on its way to park."""
        self._parking.forget()
        self.instrument_controller.end_park()

    def _forgive(self) -> None:
        """An exposure came through: what failed before is over."""
        self.authority = replace(self.authority, failures=0)
        self._faults.clear()

    def _on_failure(self, words: str, *, is_final: bool = False) -> None:
        if self.authority.state == "FAULT":
            if self.instrument_controller.instruments.clock.is_simulated:
                raise InstrumentError(words)
            time.sleep(1.0)  # whatever is broken passes no time by itself
            return
        if self._faults.add(words):  # said once, however often it fails
            self.session_log.say("alarm", words)
        reason = Missed(kind="instrument", detail=words)
        tracks = [each.track.track_id for each in self.following.tracks]
        for track_id in tracks or (None,):
            self.session_log.append(Miss(frame_id=self.frame_id, reason=reason, track_id=track_id))
        self.handle(Failed(words=words, is_final=is_final))

    def _enter(self, authority: Authority, reason: Cause | None) -> None:
        before, self.authority = self.authority.state, authority
        # What was overridden stands as long as the mount can be given back without a checklist.
        over = authority.state in ("IDLE", "FAULT") and not authority.is_resumable
        self._kept.see(authority, self.config.filter, self.session_log.last_utc_ns())
        self.watch.take_over(authority.is_responsible, frozenset() if over else None)
        # Without a reason it is the fold's own passage, which is on record already.
        if before != authority.state and reason is not None:
            self.session_log.append(
                StateChange(
                    frame_id=self.frame_id,
                    before=before,
                    after=authority.state,
                    reason=reason,
                    kept_track_id=0 if authority.kept is None else authority.kept.track_id,
                )
            )
