"""STOP in the mount's process: ABORT until the driver answers, then tracking, then measuring."""

import contextlib
import functools
from collections.abc import Callable
from typing import Any

from rsoconsole.base import InstrumentError
from rsoconsole.instruments.indi.indi_client import IndiClient, Vector
from rsoconsole.instruments.indi.reported_motion import ABORT, COORDINATES, ReportedMotion
from rsoconsole.instruments.motion import AfterStop
from rsoconsole.instruments.mount._mount_watch import MountWatch
from rsoconsole.instruments.mount._stop_measurement import StopMeasurement, has_accepted_abort
from rsoconsole.instruments.mount.mount_mirror import MountMirror

_STOP_S = 2.0
_REPEAT_ABORT_S = 0.5
# A driver says on and off again within one look at the mount: ask again rather than wait long.
_TRACKING_S = 2.0


class StopExecutor:
    """Executor of STOP for one mount; it may be used any number of times."""

    def __init__(
        self,
        client: IndiClient,
        mirror: MountMirror,
        motion: ReportedMotion,
        watch: MountWatch,
        *,
        track: Callable[[bool], bool | None],
        await_report: Callable[[int], None],
        say: Callable[[dict[str, Any]], None],
        monotonic_s: Callable[[], float],
    ) -> None:
        """Functions: ``track`` turns tracking on or off and returns its state.

        ``await_report`` waits for a report later than an update number; ``say`` is called with the
        measured motion.
        """
        self._client, self._mirror, self._motion, self._watch = client, mirror, motion, watch
        self._track, self._await_report = track, await_report
        self._say, self._monotonic_s = say, monotonic_s

    def end_motion(
        self,
        after_stop: AfterStop,
        *,
        had_tracking: bool = False,
        on_progress: Callable[[str], None] = lambda _what: None,
    ) -> dict[str, Any]:
        """Send ABORT, repeatedly while the driver reports motion; then set tracking as required.

        The motion is measured from then on. ``had_tracking``: the mount tracked when STOP was
        requested, even if it no longer does. ``on_progress`` is called with "stop ordered" at the
        first ABORT and "stop answered" at the driver's answer. Returns is_answered, is_tracking and
        detail of a ``StopResult``.
        """
        client, mirror = self._client, self._mirror
        was_moving = mirror.is_reported_moving or client.get(COORDINATES) is None
        wanted = mirror.tracking_to_order(after_stop)
        if had_tracking and after_stop == "track" and not mirror.is_reported_parked:
            wanted = True
        first, aborts = client.last_update_number(), 0
        answer: Vector | None = None
        mirror.note_order()
        ends_s = self._monotonic_s() + _STOP_S
        while answer is None and (left_s := ends_s - self._monotonic_s()) > 0:
            client.send_switch(ABORT, "ABORT")
            aborts += 1
            if aborts == 1:
                on_progress("stop ordered")
                self._measure(wanted)
            awaited = COORDINATES if was_moving else ABORT
            answer = client.wait(
                awaited,
                lambda v: (
                    has_accepted_abort(client) and (v.name == COORDINATES or v.state != "Alert")
                ),
                min(left_s, _REPEAT_ABORT_S),
                first,
            )
        is_tracking = None
        if answer is not None:
            on_progress("stop answered")
            if not was_moving:
                self._await_report(answer.serial)
            self._watch.hold_tracking(wanted)
            is_tracking = mirror.is_reported_tracking if wanted is None else self._settled(wanted)
            # Not before: what it is to be is asked for now.
            self._watch.hold_tracking(wanted)
        detail = "" if answer is not None else self._why_unanswered(aborts, first)
        return {"is_answered": answer is not None, "is_tracking": is_tracking, "detail": detail}

    def _measure(self, wanted: bool | None) -> None:
        hold = functools.partial(self._watch.hold_tracking, wanted)
        self._watch.set_stop_measurement(
            StopMeasurement(
                self._client,
                self._motion,
                self._say,
                hold_tracking=hold,
                monotonic_s=self._monotonic_s,
            )
        )

    def _why_unanswered(self, aborts: int, first: int) -> str:
        client, mirror = self._client, self._mirror
        if not mirror.abilities.can_abort:
            return "its driver has no ABORT"
        abort = client.get(ABORT)
        if abort is not None and abort.state == "Alert":
            said = client.driver_message_since(first)
            return f"its driver answers ABORT with Alert{': ' if said else ''}{said}"
        if mirror.is_reported_moving:
            return f"its driver says that it still moves after {aborts} aborts in {_STOP_S:g} s"
        return f"its driver has not answered {aborts} aborts in {_STOP_S:g} s"

    def _settled(self, is_on: bool) -> bool | None:
        """Tracking state; ordered again where the driver returns to its own at its next poll."""
        ends_s = self._monotonic_s() + _TRACKING_S
        is_tracking: bool | None = None
        # A driver that refuses has stopped all the same.
        with contextlib.suppress(InstrumentError):
            while (is_tracking := self._track(is_on)) is not is_on and is_tracking is not None:
                if self._monotonic_s() > ends_s:
                    break
        return is_tracking
