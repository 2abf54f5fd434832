"""The simulated clock as an INDI device: a client asks time to pass and is told when it has."""

from collections.abc import Awaitable, Callable, Coroutine
from typing import Any

from indipydriver import Device

from rsoconsole.simulator.devices.virtual_clock import VirtualClock
from rsoconsole.simulator.mount import asked_for, stamp, switches, texts, turn_on

DEVICE = "Simulated Clock"
_GROUP = "Main Control"


class ClockDevice:
    """SIM_CLOCK tells the time, SIM_ADVANCE asks for more, SIM_INTERRUPT ends a paced wait."""

    def __init__(
        self,
        clock: VirtualClock,
        on_report: Callable[[], Awaitable[None]],
        spawn: Callable[[Coroutine[Any, Any, None]], Any],
        overdue: Callable[[], int | None] = lambda: None,
    ) -> None:
        """``overdue``: when the thing comes that a client waits for in vain by now."""
        self._overdue = overdue
        self._clock, self._on_report, self._spawn = clock, on_report, spawn
        self._is_advancing = False
        self._now = texts(
            "SIM_CLOCK", _GROUP, {"UTC_NS": str(clock.now_utc_ns), "SPEED": repr(clock.speed)}
        )
        self._advance = texts("SIM_ADVANCE", _GROUP, {"TO_UTC_NS": "0", "TAG": ""}, perm="rw")
        self._interrupt = switches("SIM_INTERRUPT", _GROUP, ("INTERRUPT",), None, rule="AtMostOne")
        self.device = Device(DEVICE, [self._now, self._advance, self._interrupt])

    async def handle(self, event: Any) -> None:
        """Carry out what a client asks of one property."""
        if event.vectorname == "SIM_INTERRUPT":
            if asked_for(event):
                self._clock.interrupt()
            turn_on(self._interrupt, None)
            await self._interrupt.send_setVector(
                timestamp=stamp(self._clock.now_utc_ns), state="Ok"
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
        await self._now.send_setVector(timestamp=stamp(reached_utc_ns), state="Ok")
        self._advance["TO_UTC_NS"] = str(reached_utc_ns)
        self._advance["TAG"] = tag
        await self._advance.send_setVector(timestamp=stamp(reached_utc_ns), state="Ok")

    async def _refuse(self, why: str) -> None:
        t = stamp(self._clock.now_utc_ns)
        await self.device.send_device_message(why, t)
        await self._advance.send_setVector(timestamp=t, state="Alert")
