"""Measurement of a STOP in the mount's process, from the mount's incoming reports."""

import dataclasses
import time
from collections.abc import Callable
from typing import Any

from rsoconsole.instruments.indi.indi_client import IndiClient
from rsoconsole.instruments.indi.reported_motion import (
    ABORT,
    COORDINATES,
    POLLING,
    POLLING_MS,
    ReportedMotion,
)
from rsoconsole.instruments.motion import Motion, StopMeasure


class StopMeasurement:
    """Measurement from the first ABORT until rest; ``look`` must be called repeatedly."""

    def __init__(
        self,
        client: IndiClient,
        motion: ReportedMotion,
        say: Callable[[dict[str, Any]], None],
        *,
        hold_tracking: Callable[[], None],
        monotonic_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """``say`` is called with each change of the motion.

        ``hold_tracking`` is called after every repeated ABORT.
        """
        self._client, self._motion, self._say = client, motion, say
        self._hold_tracking, self._monotonic_s = hold_tracking, monotonic_s
        self._measure = StopMeasure(monotonic_s())
        self._polling_ms: float | None = None
        self.is_over = False

    def look(self) -> None:
        """Check the motion once: repeat ABORT where the mount moves; report a change of motion."""
        if self.is_over:
            return
        if self._polling_ms is None and (self._motion.polling_ms or 0.0) > POLLING_MS:
            self._polling_ms = self._motion.polling_ms
            self._client.send_numbers(POLLING, {"PERIOD_MS": POLLING_MS})
        step = self._measure.step(
            self._monotonic_s(), self._motion.motion(), is_answered=has_accepted_abort(self._client)
        )
        if step.sends_abort:
            self._client.send_switch(ABORT, "ABORT")
            self._hold_tracking()
        if step.news is not None or step.is_over:
            self._report(step.news, is_over=step.is_over)
        if step.is_over:
            self.end()

    def end(self) -> None:
        """End the measurement, and restore the driver's polling period."""
        if not self.is_over and self._polling_ms is not None:
            self._client.send_numbers(POLLING, {"PERIOD_MS": self._polling_ms})
        self.is_over = True

    def _report(self, motion: Motion | None, *, is_over: bool) -> None:
        self._say(
            {
                "event": "stop measured",
                "motion": None if motion is None else dataclasses.asdict(motion),
                "at_s": self._monotonic_s(),
                "is_over": is_over,
            }
        )


def has_accepted_abort(client: IndiClient) -> bool:
    """Return True where the driver has not refused ABORT and reports no motion."""
    abort, coordinates = client.get(ABORT), client.get(COORDINATES)
    is_refused = abort is not None and abort.state == "Alert" and not abort.is_definition
    return not is_refused and coordinates is not None and coordinates.state != "Busy"
