"""The simulated clock as an INDI device: clients let time pass and are notified afterwards."""

import asyncio
import math
import time
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any

from indipydriver import Device

from rsoconsole.simulator.mount.indi_vectors import (
    indi_timestamp,
    requested_switch,
    switch_vector,
    text_vector,
    turn_on,
)

NS = 1_000_000_000
US = 1_000
REPORT_EVERY_NS = 1 * NS
_LONGEST_STEP_S = 0.1
CATCH_UP = 4.0
"""Factor by which paced time runs faster while it is behind the wall clock."""
MAX_BEHIND_S = 60.0
"""Largest lag behind the wall clock that is caught up; the rest of a longer lag is dropped."""


class VirtualClock:
    """The observatory's time, in UTC ns, always whole microseconds (INDI's finest unit).

    ``speed``: virtual seconds per wall second; 0 or infinity: no pacing, ``advance`` takes no wall
    time. A paced clock stands still unless a client advances it, and then catches up with the wall
    clock, at most ``CATCH_UP`` times as fast.
    """

    def __init__(
        self, t_start_utc_ns: int, speed: float, wall_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._now_utc_ns = t_start_utc_ns // US * US
        self.speed = 0.0 if math.isinf(speed) else max(0.0, speed)
        self._interrupted = asyncio.Event()
        self._wall_s = wall_s
        self._on_schedule_s: float | None = None
        """Due time of the present instant by the wall's clock; None before the first advance."""

    @property
    def now_utc_ns(self) -> int:
        """The present instant."""
        return self._now_utc_ns

    def interrupt(self) -> None:
        """End the paced ``advance`` under way at the instant that it has reached."""
        self._interrupted.set()

    async def advance(self, t_utc_ns: int, on_report: Callable[[], Awaitable[None]]) -> int:
        """Advance to ``t_utc_ns``; return the instant reached, an earlier one if interrupted.

        ``t_utc_ns`` is rounded up to whole microseconds; a past instant leaves the clock unchanged.
        ``on_report`` is awaited at every whole virtual second of a paced advance and at the end.
        """
        self._interrupted.clear()
        t_end_utc_ns = max(self._now_utc_ns, -(-t_utc_ns // US) * US)
        while self.speed and self._now_utc_ns < t_end_utc_ns and not self._interrupted.is_set():
            await self._step(t_end_utc_ns, on_report)
        if not self._interrupted.is_set():
            self._now_utc_ns = t_end_utc_ns
        await on_report()
        return self._now_utc_ns

    async def _step(self, t_end_utc_ns: int, on_report: Callable[[], Awaitable[None]]) -> None:
        step_ns = max(US, round(_LONGEST_STEP_S * self.speed * NS) // US * US)
        next_report_utc_ns = (self._now_utc_ns // REPORT_EVERY_NS + 1) * REPORT_EVERY_NS
        t_next_utc_ns = min(self._now_utc_ns + step_ns, t_end_utc_ns)
        if self.speed <= 1.0 / _LONGEST_STEP_S:
            t_next_utc_ns = min(t_next_utc_ns, next_report_utc_ns)
        wall_s = (t_next_utc_ns - self._now_utc_ns) / NS / self.speed
        now_s = self._wall_s()
        due_s = now_s if self._on_schedule_s is None else self._on_schedule_s
        due_s = max(due_s, now_s - MAX_BEHIND_S)
        pause_s = max(due_s + wall_s - now_s, wall_s / CATCH_UP)
        try:
            await asyncio.wait_for(self._interrupted.wait(), pause_s)
        except TimeoutError:
            self._now_utc_ns = t_next_utc_ns
            self._on_schedule_s = due_s + wall_s
            if t_next_utc_ns >= next_report_utc_ns and t_next_utc_ns < t_end_utc_ns:
                await on_report()


DEVICE = "Simulated Clock"
_GROUP = "Main Control"


class ClockDevice:
    """INDI device of the simulated clock.

    SIM_CLOCK reports the time; a client lets time pass by SIM_ADVANCE and ends a paced advance by
    SIM_INTERRUPT.
    """

    def __init__(
        self,
        clock: VirtualClock,
        on_report: Callable[[], Awaitable[None]],
        spawn: Callable[[Coroutine[Any, Any, None]], Any],
        overdue: Callable[[], int | None] = lambda: None,
    ) -> None:
        """``spawn`` runs a coroutine in the background; ``on_report`` as in ``advance``.

        ``overdue`` gives the instant of an event that clients await, e.g. a late frame, or None.
        """
        self._overdue = overdue
        self._clock, self._on_report, self._spawn = clock, on_report, spawn
        self._is_advancing = False
        self._now = text_vector(
            "SIM_CLOCK", _GROUP, {"UTC_NS": str(clock.now_utc_ns), "SPEED": repr(clock.speed)}
        )
        self._advance = text_vector("SIM_ADVANCE", _GROUP, {"TO_UTC_NS": "0", "TAG": ""}, perm="rw")
        self._interrupt = switch_vector(
            "SIM_INTERRUPT", _GROUP, ("INTERRUPT",), None, rule="AtMostOne"
        )
        self.device = Device(DEVICE, [self._now, self._advance, self._interrupt])

    async def handle(self, event: Any) -> None:
        """Carry out a client's request to set one property."""
        if event.vectorname == "SIM_INTERRUPT":
            if requested_switch(event):
                self._clock.interrupt()
            turn_on(self._interrupt, None)
            await self._interrupt.send_setVector(
                timestamp=indi_timestamp(self._clock.now_utc_ns), state="Ok"
            )
        elif event.vectorname == "SIM_ADVANCE":
            await self._handle_advance(event)

    async def _handle_advance(self, event: Any) -> None:
        try:
            t_utc_ns = int(event["TO_UTC_NS"].strip())
        except (KeyError, ValueError):
            await self._refuse("TO_UTC_NS is a whole number of nanoseconds")
            return
        if self._is_advancing:
            await self._refuse("time is already passing on somebody's behalf")
            return
        self._is_advancing = True
        self._spawn(self._run(t_utc_ns, event.get("TAG", "").strip()))

    async def _run(self, t_utc_ns: int, tag: str) -> None:
        try:
            reached_utc_ns = await self._clock.advance(t_utc_ns, self._on_report)
            # What waits for a frame asks for no more time: it passes until the frame is there.
            due_utc_ns = self._overdue() if reached_utc_ns >= t_utc_ns else None
            if due_utc_ns is not None and due_utc_ns > reached_utc_ns:
                reached_utc_ns = await self._clock.advance(due_utc_ns, self._on_report)
        finally:
            self._is_advancing = False
        self._now["UTC_NS"] = str(reached_utc_ns)
        await self._now.send_setVector(timestamp=indi_timestamp(reached_utc_ns), state="Ok")
        self._advance["TO_UTC_NS"] = str(reached_utc_ns)
        self._advance["TAG"] = tag
        await self._advance.send_setVector(timestamp=indi_timestamp(reached_utc_ns), state="Ok")

    async def _refuse(self, why: str) -> None:
        t = indi_timestamp(self._clock.now_utc_ns)
        await self.device.send_device_message(why, t)
        await self._advance.send_setVector(timestamp=t, state="Alert")
