"""The autonomous loop: plan, slew, expose, reduce, follow, record; again."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt

from rsoconsole.config import Config
from rsoconsole.engine.hands import NS, Hands, Interrupted
from rsoconsole.engine.intentions import Intentions, Wish, action_record, change_record, changed
from rsoconsole.engine.plan import Plan, Planner
from rsoconsole.engine.preview import preview_of
from rsoconsole.errors import FrameError, InstrumentError
from rsoconsole.pipeline.batch import taken_record
from rsoconsole.pipeline.reduce import FrameReducer, Reduction
from rsoconsole.records import (
    CycleTiming,
    Event,
    Frame,
    LoopState,
    Miss,
    Solution,
    StateChange,
)
from rsoconsole.tracking.follow import Following, FollowSettings, follow

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
        self._reducer = reducer
        self._record = record
        self._intentions = intentions
        self._on_cycle = on_cycle
        self._planner = Planner(config)
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
        self._faults.clear()
        self._enter("SEARCH", f"armed by {by}")

    def run(self, frames: int | None = None) -> None:
        """Work until shutdown, or until ``frames`` exposures have been taken."""
        while not self._intentions.is_shutdown and (frames is None or self.frame_id < frames):
            try:
                self._apply_wishes()
                if self.following.state in ("IDLE", "MANUAL", "FAULT"):
                    self._hands.wait_until(self._hands.now_utc_ns() + IDLE_TICK_NS)
                else:
                    self._cycle()
            except Interrupted:
                self._on_stop()
            except (InstrumentError, FrameError) as error:
                self._on_failure(str(error))
        if self._intentions.is_shutdown:
            self._hands.instruments.mount.abort()
            self._enter("IDLE", "the engine ends")

    def _cycle(self) -> None:
        plan = self._planner.plan(self.following, self._hands.now_utc_ns())
        self._move(plan)
        self.frame_id += 1
        frame = self._hands.expose(plan.t_start_utc_ns, self.frame_id)
        self._planner.exposed(frame, self._hands.now_utc_ns())
        if self._hands.instruments.clock.is_simulated:
            latency_ns = round(self.config.indi.simulated_latency_s * NS)
            self._hands.wait_until(self._hands.now_utc_ns() + latency_ns)
        received_s = time.perf_counter()
        reduction = self._reducer.reduce(frame, always_solve=True)
        filter_s = time.perf_counter()
        before = self.following
        self.following, outcomes = self._fold(frame, reduction)
        filter_ms = (time.perf_counter() - filter_s) * 1e3
        if isinstance(reduction.solution, Solution):
            self._planner.solved(reduction.solution)
        self._planner.followed(before, self.following, self._hands.now_utc_ns())
        self._planner.plan(self.following, self._hands.now_utc_ns())
        total_ms = (time.perf_counter() - received_s) * 1e3
        timing = {**reduction.stage_ms, "filter": filter_ms, "total": total_ms}
        self._put_on_record(frame, reduction, outcomes, timing)
        self._faults.clear()
        if self._on_cycle is not None:
            self._on_cycle(self, reduction)

    def _move(self, plan: Plan) -> None:
        if plan.slew is None:
            return
        now_ns = self._hands.now_utc_ns()
        refused = self._planner.refusal(plan)
        if refused is not None:
            self._say("warning", f"slew refused: {refused}")
            return
        self._record.append(plan.slew, now_ns)
        report = self._hands.slew(*self._planner.command(plan.slew))
        self._planner.arrived(plan.slew, report)

    def _fold(self, frame: Frame, reduction: Reduction) -> tuple[Following, tuple[Any, ...]]:
        exposure = self.config.exposure
        t_mid_ns, exposure_s = frame.t_mid_utc_ns, frame.exposure_s
        if t_mid_ns is None or exposure_s is None:
            raise FrameError("the camera's frame has no DATE-OBS or EXPTIME: check its driver")
        seen = reduction.seen(frame, t_mid_ns + round(exposure.header_latency_s * NS), exposure_s)
        settings = FollowSettings(
            filter=self.config.filter,
            half_field_deg=min(self.config.optics.field_deg) / 2.0,
            choice=self.config.search.follow,
        )
        return follow(self.following, seen, settings)

    def _put_on_record(
        self,
        frame: Frame,
        reduction: Reduction,
        outcomes: tuple[Any, ...],
        timing: dict[str, float],
    ) -> None:
        now_ns = self._hands.now_utc_ns()
        taken = taken_record(frame)
        solution = () if reduction.solution is None else (reduction.solution,)
        for record in (
            taken,
            reduction.detections,
            *solution,
            *reduction.measurements,
            *outcomes,
            CycleTiming(frame_id=frame.frame_id, stage_ms=timing),
        ):
            self._record.append(record, now_ns)
        if self.config.session.keep_frames == "all" or (
            self.config.session.keep_frames == "detected" and reduction.detections.detections
        ):
            self._record.save_frame(frame)
        self._record.save_preview(frame.frame_id, preview_of(frame.pixels))

    def _apply_wishes(self) -> None:
        for wish in self._intentions.take_all():
            outcome = "done"
            try:
                self._grant(wish)
            except (ValueError, InstrumentError) as error:
                outcome = f"refused: {error}"
            self._record.append(action_record(wish, outcome), self._hands.now_utc_ns())

    def _grant(self, wish: Wish) -> None:
        if wish.verb == "arm":
            self.arm(wish.by)
        elif wish.verb == "disarm":
            self._enter("IDLE", f"disarmed by {wish.by}")
        elif wish.verb == "set":
            after = changed(self.config, wish.name, wish.value)
            self._record.append(
                change_record(self.config, after, wish.name, wish.by), self._hands.now_utc_ns()
            )
            self.config = after
            self._reducer.configure(after)
            self._planner.configure(after)
        else:
            raise ValueError(f"the engine knows no '{wish.verb}'")

    def _on_stop(self) -> None:
        if self._intentions.take_stop():
            self._enter("IDLE", "STOP")
            self._say("alarm", "STOP: motion and exposure ended, disarmed")

    def _on_failure(self, words: str) -> None:
        self._faults.append(words)
        self._say("alarm", words)
        self._record.append(Miss(frame_id=self.frame_id, reason=words), self._hands.now_utc_ns())
        if len(self._faults) >= FAULTS_IN_A_ROW:
            self._hands.instruments.mount.abort()
            self._enter("FAULT", words)

    def _enter(self, state: LoopState, reason: str) -> None:
        before = self.following.state
        self.following = Following(state=state)
        if before != state:
            self._record.append(
                StateChange(frame_id=self.frame_id, before=before, after=state, reason=reason),
                self._hands.now_utc_ns(),
            )

    def _say(self, level: Literal["info", "warning", "alarm"], text: str) -> None:
        self._record.append(
            Event(level=level, text=text, frame_id=self.frame_id), self._hands.now_utc_ns()
        )
