"""Takes the exposures of the loop, one after another, and numbers them."""

import statistics
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NoReturn

from rsoconsole.config import Config
from rsoconsole.engine.aim.instrument_controller import (
    CLOCKS_APART_NS,
    NS,
    AimPlan,
    InstrumentController,
    Interrupted,
)
from rsoconsole.engine.aim.plan import Planner
from rsoconsole.engine.tasks.session_log import SessionLog
from rsoconsole.engine.tasks.watch import Watch
from rsoconsole.instruments import ARRIVED_KEY
from rsoconsole.pipeline import frame_taken_record
from rsoconsole.records import ChartStar, Frame, LoopState

REMEMBERED = 10
KNOWN_FROM = 5
"""Number of frames after which the usual difference between the two clocks counts as known."""
UNKNOWN_S = 10.0
"""Greatest error of a frame's time while fewer frames are known, s."""
MIN_S = 0.5
SPREADS = 2.0
"""Greatest error of a frame's time, in units of the range of the last frames' differences."""
AGREED = 3
"""Number of frames in a row with the same error after which the camera's clock was set."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameTime:
    """Whether a frame's time can be right, and how far it is off."""

    is_believed: bool
    off_s: float
    """Difference from the time that the frames before lead to expect, s."""
    is_set: bool = False
    """True where the camera's clock was set by ``off_s``, so that earlier times do not compare."""


class FrameTimes:
    """Checks frames' times by the difference between the camera's clock and this machine's."""

    def __init__(self) -> None:
        self._usual: deque[float] = deque(maxlen=REMEMBERED)
        self._off: list[float] = []
        """Differences of the last frames that were not believed, s."""

    def forget(self) -> None:
        """Forget the last frames, because this machine's own clock was set."""
        self._usual.clear()
        self._off.clear()

    def check_frame_time(self, t_start_utc_ns: int, opened_utc_ns: int) -> FrameTime:
        """Return whether a frame's time is believable.

        ``t_start_utc_ns``: its start by the camera's clock; ``opened_utc_ns``: when this machine
        ordered it.
        """
        apart_s = (t_start_utc_ns - opened_utc_ns) / 1e9
        if not self._usual:
            self._usual.append(apart_s)
            return FrameTime(is_believed=True, off_s=0.0)
        off_s = apart_s - statistics.median(self._usual)
        if abs(off_s) <= self._allowed_s():
            self._usual.append(apart_s)
            self._off.clear()
            return FrameTime(is_believed=True, off_s=off_s)
        if self._off and abs(apart_s - self._off[-1]) > MIN_S:
            self._off.clear()
        self._off.append(apart_s)
        if len(self._off) < AGREED:
            return FrameTime(is_believed=False, off_s=off_s)
        agreed = list(self._off)
        self.forget()
        self._usual.extend(agreed)
        return FrameTime(is_believed=False, off_s=off_s, is_set=True)

    def _allowed_s(self) -> float:
        if len(self._usual) < KNOWN_FROM:
            return UNKNOWN_S
        return max(MIN_S, SPREADS * (max(self._usual) - min(self._usual)))


class Exposures:
    """Takes planned exposures, and records their frames."""

    def __init__(
        self,
        instrument_controller: InstrumentController,
        planner: Planner,
        watch: Watch,
        session_log: SessionLog,
        config: Config,
    ) -> None:
        self.frame_id = 0
        self.next_start_utc_ns: int | None = None
        """Time at which the next exposure is to begin, UTC ns; None: not known, or shutter open."""
        self.open_until_utc_ns: int | None = None
        """Time at which the shutter closes, UTC ns; None while it is closed."""
        self.frame_times = FrameTimes()
        self.on_camera_set: Callable[[float], None] = lambda _step_s: None
        """Called with the step in seconds when the camera's clock is found to have been set."""
        self._instrument_controller = instrument_controller
        self._planner = planner
        self._watch = watch
        self._session_log = session_log
        self._config = config

    def configure(self, config: Config) -> None:
        """Use a new configuration from now on."""
        self._config = config

    def take(self, plan: AimPlan) -> tuple[Frame, float]:
        """Take an exposure; return the frame, and the time since its last byte came, ms.

        Where sidereal tracking would meet a limit before the exposure's end, tracking is stopped
        instead. Raises Interrupted for that, for a frame whose time is not believable, and for all
        else that needs the loop; raises InstrumentError when no frame comes.
        """
        self.next_start_utc_ns = plan.t_start_utc_ns
        self._instrument_controller.wait_until(plan.t_start_utc_ns)
        exposure = self._config.exposure
        opened_ns = self._instrument_controller.now_utc_ns()
        end_ns = opened_ns + round((exposure.start_latency_s + exposure.exposure_s) * NS)
        ahead = self._watch.limit_before(end_ns)
        if ahead is not None:
            self.end_at_limit(f"before the end of this exposure: {ahead.text}")
        self.frame_id += 1
        self._session_log.frame_id = self.frame_id
        self.open_until_utc_ns, self.next_start_utc_ns = end_ns, None
        try:
            frame = self._instrument_controller.expose(opened_ns, self.frame_id)
        finally:
            self.open_until_utc_ns = None
        self._expect_believable(frame, opened_ns)
        arrived_s = frame.header.get(ARRIVED_KEY)
        read_ms = 0.0 if arrived_s is None else (time.monotonic() - float(arrived_s)) * 1e3
        self._session_log.append(frame_taken_record(frame, plan.blocked))
        for text in self._instrument_controller.instruments.camera.take_messages():
            self._session_log.say("info", f"camera: {text}")
        self._planner.note_frame(frame, opened_ns)
        if clocks_apart := _clocks_apart_words(frame, opened_ns):
            self._session_log.say("warning", clocks_apart)
        return frame, read_ms

    def _expect_believable(self, frame: Frame, opened_ns: int) -> None:
        """Raise Interrupted for a frame whose time does not agree with those before it."""
        if frame.t_start_utc_ns is None:
            return
        found = self.frame_times.check_frame_time(frame.t_start_utc_ns, opened_ns)
        if found.is_set:
            self.on_camera_set(found.off_s)
        if not found.is_believed:
            words = f"frame {frame.frame_id} is not followed: by the camera's clock it began"
            self._session_log.say(
                "alarm", f"{words} {found.off_s:+.1f} s from when it was ordered", "clock"
            )
            raise Interrupted

    def simulate_readout_time(self, frame: Frame) -> None:
        """Let the time of the read-out pass in a simulated night, by the number of pixels."""
        optics, share = self._config.optics, 1.0
        if frame.camera is not None:
            share = frame.width_px * frame.height_px / (optics.width_px * optics.height_px)
        self._pass(min(share, 1.0) * self._config.exposure.readout_s)

    def simulate_processing_time(self) -> None:
        """Let the time of the processing pass in a simulated night."""
        self._pass(self._config.indi.simulated_latency_s)

    def _pass(self, pause_s: float) -> None:
        if self._instrument_controller.instruments.clock.is_simulated:
            self._instrument_controller.wait_until(
                self._instrument_controller.now_utc_ns() + round(pause_s * NS)
            )

    def keep(
        self,
        frame: Frame,
        state: LoopState,
        place_px: tuple[float, float] | None,
        stars: tuple[ChartStar, ...] | None,
    ) -> None:
        """Keep the frame's previews, and its pixels where the configuration says so.

        ``place_px``: column and row of the close-up; None: no close-up. ``stars``: its brightest
        stars; None: not known.
        """
        wanted = self._config.session.keep_frames
        is_wanted = wanted in {"all", "last"} or (
            wanted == "detected" and state in ("ACQUIRE", "TRACK")
        )
        self._session_log.keep(frame, is_wanted=is_wanted, place_px=place_px, stars=stars)

    def end_at_limit(self, words: str) -> NoReturn:
        """End motion and tracking at a limit, then raise Interrupted; ``words``: the limit."""
        self._watch.end_at_limit(words)
        raise Interrupted


def _clocks_apart_words(frame: Frame, opened_utc_ns: int) -> str:
    """Return what is wrong with a frame's time, in words; empty where nothing is."""
    apart_ns = (frame.t_start_utc_ns or opened_utc_ns) - opened_utc_ns
    if abs(apart_ns) <= CLOCKS_APART_NS:
        return ""
    return (
        f"the camera's clock is {apart_ns / NS:+.0f} s off this machine's: synchronise both, every"
        " measurement is wrong by as much"
    )
