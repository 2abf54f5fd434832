"""The autonomous loop: plan, slew, expose, reduce, follow, record; again."""

import contextlib
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

from rsoconsole.config import Config
from rsoconsole.engine.hands import NS, Hands, Interrupted
from rsoconsole.engine.intentions import Intentions, Wish, action_record, change_record, changed
from rsoconsole.engine.plan import Plan, Planner
from rsoconsole.engine.preview import preview_of
from rsoconsole.errors import InstrumentError, RsoconsoleError
from rsoconsole.instruments.camera import ARRIVED_KEY
from rsoconsole.pipeline.cycle import Cycle, taken_record
from rsoconsole.pipeline.reduce import FrameReducer, Reduction
from rsoconsole.records import (
    CycleTiming,
    Event,
    Frame,
    LoopState,
    Miss,
    OperatorAction,
    Solution,
    StateChange,
)
from rsoconsole.tracking.follow import Following

log = logging.getLogger(__name__)

FAULTS_IN_A_ROW = 3
IDLE_TICK_NS = NS


class Recorder(Protocol):
    """Where the loop puts what happened; must return at once and never raise."""

    def append(self, record: Any, t_utc_ns: int) -> int:
        """One record, in order."""

    def save_frame(self, frame: Frame) -> bool:
        """The pixels as the camera gave them."""

    def save_preview(self, frame_id: int, picture: npt.NDArray[np.uint8]) -> bool:
        """A small uint8 picture."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """The engine in one line."""

    state: LoopState
    holder: str
    frame: int
    ra: float | None
    dec: float | None
    t_utc_ns: int | None
    """Of the direction."""
    faults: tuple[str, ...]


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
        intentions: Intentions,
        on_cycle: Callable[["Engine", Reduction], None] | None = None,
    ) -> None:
        self.config = config
        self.following = Following(state="IDLE")
        self.frame_id = 0
        self._hands = hands
        self._cycle = Cycle(reducer, config)
        self._record = record
        self._intentions = intentions
        self._on_cycle = on_cycle
        self._planner = Planner(config)
        self._plan: Plan | None = None
        self._seen_utc_ns = 0
        self._faults: list[str] = []

    def status(self) -> Status:
        """A snapshot, from any thread."""
        following = self.following
        track = following.track
        holder = {"IDLE": "nobody", "FAULT": "nobody", "MANUAL": "operator"}
        return Status(
            state=following.state,
            holder=holder.get(following.state, "autonomy"),
            frame=self.frame_id,
            ra=None if track is None else track.x[0] % 360.0,
            dec=None if track is None else track.x[2],
            t_utc_ns=None if track is None else track.t_utc_ns,
            faults=tuple(self._faults),
        )

    def wake(self) -> None:
        """Cut a wait short (any thread)."""
        self._hands.instruments.clock.wake()

    def arm(self, by: str = "operator") -> None:
        """Hand the mount to autonomy: search from where the telescope points."""
        report = self._hands.mount_report()
        if report.is_parked:
            self._hands.instruments.mount.unpark()
        self._planner.start_search(report, self._hands.now_utc_ns())
        self._cycle.forget_plate()
        self._faults.clear()
        self._enter("SEARCH", f"armed by {by}")

    def run(self, frames: int | None = None) -> None:
        """Work until shutdown, or until ``frames`` exposures have been begun.

        Raises InstrumentError when a run of ``frames`` cannot be finished, or when a simulated
        observatory is gone: no time passes without it.
        """
        while not self._intentions.is_shutdown and (frames is None or self.frame_id < frames):
            try:
                self._heed_stops()
                self._apply_wishes()
                if self.following.state in ("IDLE", "MANUAL", "FAULT"):
                    if frames is not None and self.following.state == "FAULT":
                        raise _RunFailed(self._faults[-1])
                    self._hands.wait_until(self._hands.now_utc_ns() + IDLE_TICK_NS)
                else:
                    self._one_exposure()
            except Interrupted:
                continue
            except _RunFailed as error:
                raise InstrumentError(f"the run ended in FAULT: {error}") from error
            except RsoconsoleError as error:
                self._on_failure(str(error))
            except Exception as error:  # the telescope must not be left to itself
                log.exception("the loop broke")
                self._on_failure(f"the loop broke ({error}): see the log", is_final=True)
        self._end()

    def _end(self) -> None:
        if self._intentions.is_shutdown:
            result = self._hands.instruments.mount.abort()
            self._heed_stops()
            self._apply_wishes()
            if not result.stopped:
                self._say("alarm", f"the mount did not confirm its stop: {result.detail}")
            self._enter("IDLE", "the engine ends")

    def _one_exposure(self) -> None:
        """Wait for the mount, expose, reduce, follow, send the mount on; then put it on record."""
        plan = self._plan or self._plan_and_order()
        self._plan = None
        self.frame_id += 1
        if plan.slew is not None:
            report = self._hands.wait_for_arrival(*self._planner.command(plan.slew))
            if self._planner.arrived(plan.slew, report):
                self._cycle.forget_plate()
        self._hands.wait_until(plan.t_start_utc_ns)
        opened_ns = self._hands.now_utc_ns()
        frame = self._hands.expose(opened_ns, self.frame_id)
        arrived_s = frame.header.get(ARRIVED_KEY)
        read_ms = 0.0 if arrived_s is None else (time.monotonic() - float(arrived_s)) * 1e3
        self._append(taken_record(frame))
        for text in self._hands.instruments.camera.take_messages():
            self._say("info", f"camera: {text}")
        clocks_apart = self._planner.exposed(frame, opened_ns)
        if clocks_apart is not None:
            self._say("warning", clocks_apart)
        if self._hands.instruments.clock.is_simulated:
            # Read-out and processing cost virtual time, not the wall's: stopwatches stand still.
            pause_s = self.config.exposure.readout_s + self.config.indi.simulated_latency_s
            self._hands.wait_until(self._hands.now_utc_ns() + round(pause_s * NS))
        try:
            self._reduce_and_go_on(frame, read_ms)
        finally:
            # Also the frame that could not be used: it is the one somebody will want to see.
            self._keep(frame)

    def _reduce_and_go_on(self, frame: Frame, read_ms: float) -> None:
        began_s = time.perf_counter()
        before = self.following
        result = self._cycle.run(frame, before)
        folded_s = time.perf_counter()
        self.following = result.after
        if isinstance(result.reduction.solution, Solution):
            self._planner.solved(result.reduction.solution)
        self._planner.followed(before, result.after, self._hands.now_utc_ns())
        for record in result.records:
            self._append(record)
        self._plan = self._plan_and_order()
        ordered_s = time.perf_counter()
        reduce_ms = result.reduction.stage_ms
        stages = {
            "read": read_ms,
            **reduce_ms,
            "filter": (folded_s - began_s) * 1e3 - sum(reduce_ms.values()),
            "order": (ordered_s - folded_s) * 1e3,
            "total": (ordered_s - began_s) * 1e3 + read_ms,
        }
        self._append(CycleTiming(frame_id=frame.frame_id, stage_ms=stages))
        self._faults.clear()
        if self._on_cycle is not None:
            self._on_cycle(self, result.reduction)

    def _plan_and_order(self) -> Plan:
        """Where and when the next exposure is; the mount is on its way when this returns."""
        plan = self._planner.plan(self.following, self._hands.now_utc_ns())
        if plan.slew is None:
            return plan
        refused = self._planner.refusal(plan)
        if refused is not None:
            self._say("warning", f"slew refused: {refused}")
            return replace(plan, slew=None)
        self._hands.order_slew(*self._planner.command(plan.slew))
        self._append(plan.slew)
        return plan

    def _keep(self, frame: Frame) -> None:
        keep = self.config.session.keep_frames
        if keep == "all" or (keep == "detected" and self.following.state in ("ACQUIRE", "TRACK")):
            self._record.save_frame(frame)
        self._record.save_preview(frame.frame_id, preview_of(frame.pixels))

    def _apply_wishes(self) -> None:
        for wish in self._intentions.take_all():
            outcome = "done"
            try:
                self._grant(wish)
            except (ValueError, InstrumentError) as error:
                outcome = f"refused: {error}"
            self._append(action_record(wish, outcome))

    def _grant(self, wish: Wish) -> None:
        if wish.verb == "arm":
            self.arm(wish.by)
        elif wish.verb == "disarm":
            self._enter("IDLE", f"disarmed by {wish.by}")
        elif wish.verb == "set":
            after = changed(self.config, wish.name, wish.value)
            self._append(change_record(self.config, after, wish.name, wish.by))
            self.config = after
            for part in (self._hands, self._cycle, self._planner):
                part.configure(after)
        elif wish.verb != "shutdown":
            raise ValueError(f"the engine knows no '{wish.verb}'")

    def _heed_stops(self) -> None:
        """After a STOP: nothing more is ordered, so stop the mount once more, then say so."""
        if not self._intentions.is_stopping:
            return
        again = self._hands.instruments.mount.abort()
        self._enter("IDLE", "STOP")
        for stop in self._intentions.take_stops():
            stopped = stop.result.stopped or again.stopped
            outcome = f"stopped in {stop.result.ms:.0f} ms" if stopped else "NOT confirmed"
            self._append(OperatorAction(verb="stop", arguments={}, outcome=outcome, by=stop.by))
            for wish in stop.dropped:
                self._append(action_record(wish, "dropped by STOP"))
            if stopped:
                self._say("alarm", "STOP: motion ended, disarmed; the mount tracks on")
            else:
                self._say("alarm", "STOP was not confirmed by the mount: cut its power")

    def _on_failure(self, words: str, *, is_final: bool = False) -> None:
        if self.following.state == "FAULT":
            if self._hands.instruments.clock.is_simulated:
                raise InstrumentError(words)
            time.sleep(1.0)  # whatever is broken passes no time by itself
            return
        self._faults.append(words)
        self._plan = None
        self._say("alarm", words)
        self._append(Miss(frame_id=self.frame_id, reason=words))
        if is_final or len(self._faults) >= FAULTS_IN_A_ROW:
            self._hands.instruments.mount.abort()
            self._enter("FAULT", words)

    def _enter(self, state: LoopState, reason: str) -> None:
        before = self.following.state
        self.following = Following(state=state)
        self._plan = None
        if before != state:
            self._append(
                StateChange(frame_id=self.frame_id, before=before, after=state, reason=reason)
            )

    def _say(self, level: Literal["info", "warning", "alarm"], text: str) -> None:
        self._append(Event(level=level, text=text, frame_id=self.frame_id))

    def _append(self, record: Any) -> None:
        self._record.append(record, self._last_utc_ns())

    def _last_utc_ns(self) -> int:
        """The clock's present; where the clock is gone, the last instant it told."""
        with contextlib.suppress(RsoconsoleError):
            self._seen_utc_ns = self._hands.now_utc_ns()
        return self._seen_utc_ns
