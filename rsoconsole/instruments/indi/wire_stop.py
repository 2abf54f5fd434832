"""STOP by a plain connection to the INDI server: the second path to the mount.

ABORT is sent at once, before anything is known of the mount. Then the driver's answer is read,
tracking is turned on or off as required, and the mount's motion is measured.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from rsoconsole.base import InstrumentError
from rsoconsole.instruments.indi.indi_wire import IndiVector, IndiWire
from rsoconsole.instruments.indi.reported_motion import (
    ABORT,
    COORDINATES,
    PARK,
    POLLING,
    POLLING_MS,
    TRACKING,
    ReportedMotion,
)
from rsoconsole.instruments.motion import AfterStop, Motion, StopMeasure, tracking_after_stop
from rsoconsole.instruments.ports import StopResult
from rsoconsole.words import NO_ANSWER

_REPEAT_ABORT_S = 0.5
_LOOK_S = 0.05
_TRACKING_S = 2.0
_SETTLE_S = 1.2
"""Time in which a driver, at its next poll of the mount, may restore its own tracking state."""
_UNTOLD = f"{NO_ANSWER}: look at its driver and its cable, and at the telescope"


@dataclass(frozen=True, slots=True, kw_only=True)
class StopCallbacks:
    """Callbacks during a STOP; where ``is_over`` returns True, the STOP ends early."""

    on_ordered: Callable[[], None] = lambda: None
    """Called when the first ABORT has been handed to the operating system."""
    on_answered: Callable[[], None] = lambda: None
    is_over: Callable[[], bool] = lambda: False
    """Returns True when nothing more may be sent to the mount, as nothing waits for this STOP."""


def stop_mount(
    host: str,
    port: int,
    device: str,
    timeout_s: float = 2.0,
    *,
    after_stop: AfterStop = "track",
    had_tracking: bool | None = None,
    watched: StopCallbacks = StopCallbacks(),
    on_result: Callable[[StopResult], None] = lambda _result: None,
    measures: bool = True,
) -> StopResult:
    """Send ABORT, read the answer to it, set tracking by ``after_stop``, measure the motion.

    ``had_tracking``: whether the mount tracked before; None: as its driver reports; needed where
    another path may already have sent ABORT. ``on_result``: called first with the result of ABORT,
    after ``timeout_s`` and the time to set tracking at the latest, then whenever the kind of
    measured motion changes. ``measures``: False: end before the measurement, which takes some
    seconds, or half a minute where the mount still moves. ``watched.is_over``: ends everything.

    Returns the last result. Never raises: where the server cannot be reached, ``is_answered`` of
    the result is False.
    """
    begun_s = time.monotonic()
    result = StopResult(is_answered=False, ms=0.0, path="indi")
    try:
        wire = IndiWire(host, port, timeout_s)
        try:
            stop = _WireStop(wire, device, watched, begun_s)
            result = stop.abort(timeout_s, after_stop, had_tracking)
            on_result(result)
            if measures and stop.vectors:
                result = stop.measure(result, on_result)
        finally:
            wire.close()
    except InstrumentError as error:
        result = replace(result, detail=str(error), ms=result.ms or _ms_since(begun_s))
        on_result(result)
    return result


class _WireStop:
    """One STOP by a plain connection, with the driver's reports before and after it."""

    def __init__(self, wire: IndiWire, device: str, watched: StopCallbacks, begun_s: float) -> None:
        self._wire, self._device, self._watched = wire, device, watched
        self._begun_s = begun_s
        self.vectors: dict[str, IndiVector] = {}
        self._first: dict[str, IndiVector] = {}
        self._motion = ReportedMotion()
        self._is_answered = False

    def abort(
        self, timeout_s: float, after_stop: AfterStop, had_tracking: bool | None
    ) -> StopResult:
        """Send ABORT until the driver answers or the time is over; then set tracking."""
        result = StopResult(is_answered=False, ms=0.0, path="indi")
        aborts = self._abort_until(self._begun_s + timeout_s)
        if not self._is_answered:
            detail = ""
            if not self._watched.is_over():
                detail = _UNTOLD if not self.vectors else self._unanswered(aborts, timeout_s)
            return replace(result, ms=_ms_since(self._begun_s), detail=detail)
        result = replace(result, is_answered=True, ms=_ms_since(self._begun_s))
        self._watched.on_answered()
        return replace(result, is_tracking=self._settle_tracking(after_stop, had_tracking))

    def measure(self, result: StopResult, on_result: Callable[[StopResult], None]) -> StopResult:
        """Measure the motion since ABORT; repeat ABORT while the mount is measured to move."""
        measure = StopMeasure(self._begun_s)
        self._wire.ask(self._device, POLLING)
        self._wire.ask(self._device, COORDINATES)
        polling_ms: float | None = None
        while not (measure.is_over or self._watched.is_over()):
            looked_s = time.monotonic()
            self._read_next(_LOOK_S)
            if time.monotonic() - looked_s > 10.0 * _LOOK_S:
                self._motion.reset_after_delay()
            if polling_ms is None and (self._motion.polling_ms or 0.0) > POLLING_MS:
                polling_ms = self._motion.polling_ms
                self._look_every(POLLING_MS)
            if self._motion.wants_word():
                self._wire.ask(self._device, COORDINATES)
            step = measure.step(
                time.monotonic(), self._motion.motion(), is_answered=self._is_answered
            )
            if step.sends_abort:
                self._send_abort()
            if step.news is not None:
                result = replace(
                    result, motion=step.news, measured_ms=_ms_since(self._begun_s), detail=""
                )
                on_result(result)
                if step.news.kind == "unknown" and self._is_answered:
                    break  # it is obeyed, and its reports are too few to tell
        if polling_ms is not None:
            self._look_every(polling_ms)
        if result.motion is None:
            result = replace(result, motion=Motion(), measured_ms=_ms_since(self._begun_s))
        return result

    def _abort_until(self, deadline_s: float) -> int:
        """Send ABORT until it was answered, or until the time was out; return how often."""
        aborts = 0
        if self._watched.is_over():
            return 0
        # Answered in order: one line tells how the mount was before the first ABORT.
        for name in (TRACKING, PARK, COORDINATES):
            self._wire.ask(self._device, name)
        while time.monotonic() < deadline_s and not (self._is_answered or self._watched.is_over()):
            self._send_abort()
            aborts += 1
            if aborts == 1:
                self._watched.on_ordered()
            # Only an answer given after the order counts, so the state is asked for behind it.
            self._wire.ask(self._device, COORDINATES)
            repeat_s = min(time.monotonic() + _REPEAT_ABORT_S, deadline_s)
            while not self._is_answered and (left_s := repeat_s - time.monotonic()) > 0:
                self._read_next(left_s)
        return aborts

    def _send_abort(self) -> None:
        self._wire.new("Switch", self._device, ABORT, {"ABORT": "On"})

    def _look_every(self, period_ms: float) -> None:
        self._wire.new("Number", self._device, POLLING, {"PERIOD_MS": f"{period_ms:g}"})

    def _unanswered(self, aborts: int, timeout_s: float) -> str:
        if self._is_refused:
            said = self._wire.last_message
            return f"its driver answers ABORT with Alert{': ' if said else ''}{said}"
        return f"its driver says that it still moves after {aborts} aborts in {timeout_s:.1f} s"

    def _settle_tracking(self, after_stop: AfterStop, had_tracking: bool | None) -> bool | None:
        """Turn tracking on or off as required; return its state after that.

        None where the driver does not report it.
        """
        was_parking = self._was_busy(PARK)
        wanted = tracking_after_stop(
            after_stop,
            was_slewing=self._was_busy(COORDINATES) and not was_parking,
            was_parking=was_parking,
            was_tracking=_is_on(self._first.get(TRACKING), "TRACK_ON"),
            is_parked=not was_parking and _is_on(self.vectors.get(PARK), "PARK"),
        )
        if had_tracking and after_stop == "track":
            wanted = True
        if TRACKING not in self.vectors:
            return None
        if wanted is None or self._watched.is_over():
            return _is_on(self.vectors[TRACKING], "TRACK_ON")
        member = "TRACK_ON" if wanted else "TRACK_OFF"
        self._wire.new("Switch", self._device, TRACKING, {member: "On"})
        del self.vectors[TRACKING]
        self._wire.ask(self._device, TRACKING)
        self._await_tracking(member, time.monotonic() + _TRACKING_S)
        if self._was_busy(COORDINATES):
            self._hold_tracking(member, time.monotonic() + _SETTLE_S)
            if not self._watched.is_over():
                # It may just have been said again.
                self._await_tracking(member, time.monotonic() + _TRACKING_S)
        tracking = self.vectors.get(TRACKING)
        return None if tracking is None else _is_on(tracking, "TRACK_ON")

    def _await_tracking(self, member: str, ends_s: float) -> None:
        while (left_s := ends_s - time.monotonic()) > 0:
            if _is_on(self.vectors.get(TRACKING), member):
                return
            self._read_next(left_s)

    def _hold_tracking(self, member: str, ends_s: float) -> None:
        """Repeat the tracking order whenever the driver reports the other state."""
        before = self.vectors.get(TRACKING)
        while (left_s := ends_s - time.monotonic()) > 0 and not self._watched.is_over():
            self._read_next(min(left_s, _LOOK_S))
            now = self.vectors.get(TRACKING)
            if self._watched.is_over():
                return
            if now is not before and not _is_on(now, member):
                self._wire.new("Switch", self._device, TRACKING, {member: "On"})
            before = now

    def _read_next(self, timeout_s: float) -> None:
        vector = self._wire.wait(lambda each: each.device == self._device, timeout_s)
        if vector is None:
            return
        self._motion.take(vector)
        is_first = vector.name not in self._first
        self._first.setdefault(vector.name, vector)
        self.vectors[vector.name] = vector
        # The first word on the coordinates was asked for before the order.
        if vector.name == COORDINATES and not is_first and vector.state != "Busy":
            self._is_answered = not self._is_refused

    @property
    def _is_refused(self) -> bool:
        said = self.vectors.get(ABORT)
        return said is not None and said.state == "Alert" and not said.is_definition

    def _was_busy(self, name: str) -> bool:
        return name in self._first and self._first[name].state == "Busy"


def _is_on(vector: IndiVector | None, member: str) -> bool:
    return vector is not None and vector.values.get(member) == "On"


def _ms_since(begun_s: float) -> float:
    return (time.monotonic() - begun_s) * 1e3
