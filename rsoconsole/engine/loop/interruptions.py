"""Interruptions that nobody ordered: faults of the clock, and slews that the lease ended.

The mount's own process ends a slew when the engine has not renewed its lease. Each interruption is
reported with its figures, and the night goes on by itself once the mount's state is known.
"""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from rsoconsole.base import InstrumentError
from rsoconsole.engine.aim.states import ClockSet
from rsoconsole.engine.operator.by_hand import ByHand, Parts
from rsoconsole.engine.operator.handlers import LoopControl
from rsoconsole.instruments import MIN_STEP_S, ClockFault, MountReport
from rsoconsole.records import Topic
from rsoconsole.sky import icrs_to_altaz

NS = 1_000_000_000
SETTLED_NS = NS
"""Wait before the mount's report is used, ns: its process stood still too, and must read again."""
GIVEN_UP = "what was under way is given up"


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockTrouble:
    """The clock's last fault, for the health panel."""

    t_utc_ns: int
    text: str


class Interruptions:
    """Handles clock faults and slews ended by the lease: reports them and checks the mount."""

    def __init__(
        self,
        control: LoopControl,
        parts: Parts,
        by_hand: ByHand,
        *,
        forget: Callable[[], None],
        forget_camera: Callable[[], None],
        end_at_limit: Callable[[str], None],
    ) -> None:
        """``forget``: drops all that depends on wrong times; ``end_at_limit``: stops at a limit.

        ``forget_camera``: drops the difference between the camera's clock and this machine's.
        """
        self._control, self._by_hand = control, by_hand
        self._parts = parts
        self._forget, self._forget_camera = forget, forget_camera
        self._end_at_limit = end_at_limit
        self._must_look = False
        self.trouble: ClockTrouble | None = None
        """The clock's last fault; None without one."""

    # -- time -----------------------------------------------------------------------------------

    def receive(self, fault: ClockFault) -> None:
        """Handle a fault of this machine's clock; the caller then drops the loop's present work."""
        match fault.kind:
            case "set" | "leap second":
                self._clock_set(fault)
            case "runs wrong":
                self._note(f"runs {fault.rate:.2f} times as fast as it should")
                self._say(
                    "alarm",
                    f"this machine's clock runs {fault.rate:.2f} times as fast as it should: no"
                    " frame is taken until it runs right; look at its time service, or at the host"
                    " of a virtual machine",
                )
                self._forget_own_times()
            case "runs right":
                self._note(f"ran wrong, {fault.seconds:+.1f} s in all")
                self._runs_right(fault)
            case "slept" | "stood still":
                self._stood_still(fault)

    def _runs_right(self, fault: ClockFault) -> None:
        """Report that the clock is believed again; a shift meanwhile counts as a clock set."""
        is_shifted = abs(fault.seconds) > MIN_STEP_S
        self._say(
            "warning",
            f"this machine's clock runs right again, {fault.seconds:+.1f} s from where it was:"
            " times on record in between are off by up to that"
            + (f", and {GIVEN_UP}" if is_shifted else ""),
        )
        if is_shifted:
            self._forget_own_times()
            self._control.handle(ClockSet(step_s=fault.seconds))

    def camera_set(self, step_s: float) -> None:
        """Handle a camera clock that was set by ``step_s``, which ends the track."""
        self._forget()  # what is known of the camera's clock is of the new time already
        self._note(f"camera's set by {step_s:+.1f} s")
        self._say(
            "alarm",
            f"the camera's clock was set by {step_s:+.1f} s: {GIVEN_UP}; synchronise it with this"
            " machine's",
        )
        self._control.handle(ClockSet(step_s=step_s))

    def _forget_own_times(self) -> None:
        self._forget()
        self._forget_camera()

    def _clock_set(self, fault: ClockFault) -> None:
        self._forget_own_times()
        if fault.kind == "leap second":
            self._note(f"leap second, {fault.seconds:+.0f} s")
            words = (
                f"a leap second has come ({fault.seconds:+.0f} s): {GIVEN_UP}, because two times"
                " across it are not as far apart as they look; both are right"
            )
        else:
            self._note(f"set by {fault.seconds:+.1f} s")
            words = (
                f"a time service or somebody has set the clock by {fault.seconds:+.1f} s:"
                f" {GIVEN_UP}, and times on record before this are off by as much"
            )
        self._say("alarm", words + self._mount_clock())
        self._control.handle(ClockSet(step_s=fault.seconds))

    def _mount_clock(self) -> str:
        """Return in words how far the mount's own clock is off; empty where it reports none."""
        off_s = None
        with contextlib.suppress(InstrumentError):
            off_s = self._parts.instrument_controller.instruments.mount.utc_offset_s()
        return "" if off_s is None else f"; the mount's own clock is {off_s:+.0f} s off this one"

    def _stood_still(self, fault: ClockFault) -> None:
        who = "this machine slept" if fault.kind == "slept" else "this program stood still"
        took = f"for {fault.seconds:.0f} s"
        self._note(f"{'slept' if fault.kind == 'slept' else 'stood still'} {took}")
        self._say(
            "alarm",
            f"{who} {took} and watched nothing: an exposure under way is given up, what is followed"
            " is coasted, and the mount is looked at before it goes on",
        )
        self._must_look = True

    # -- the mount ------------------------------------------------------------------------------

    def look_at_mount(self) -> None:
        """After a time when nothing ran, report what the mount does, and stop it beyond a limit.

        Does nothing where the program has not stood still. Raises Interrupted where the loop is to
        be interrupted or a limit was met, InstrumentError where the mount is silent while somebody
        has control.
        """
        if not self._must_look:
            return
        self._parts.instrument_controller.wait_until(
            self._parts.instrument_controller.now_utc_ns() + SETTLED_NS
        )
        try:
            report = self._parts.instrument_controller.mount_report()
        except InstrumentError as error:
            if self._control.authority.holder != "nobody":
                raise
            # Nobody has the mount: that it is off is no fault of a night.
            self._must_look = False
            self._say("alarm", f"nobody can tell how the mount stands: {error}")
            return
        self._must_look = False
        self._say_slew_end()
        self._go_on_from(report)

    def goes_on_after(self) -> bool:
        """Return True where the lease has ended the slew, which is then reported.

        The loop then goes on from where the mount stands. False where the lease ended no slew.
        """
        if not self._say_slew_end():
            return False
        self._must_look = False
        self._go_on_from(self._parts.instrument_controller.wait_for_rest())
        return True

    def _say_slew_end(self) -> bool:
        """Report that the mount's own process has ended a slew, and why; False where it has not."""
        ended = self._parts.instrument_controller.instruments.mount.take_slew_end()
        if ended is not None:
            words = (
                "the mount's own process has ended the slew, because the engine had not renewed its"
                f" lease for {ended.unwatched_s:.0f} s ({ended.lease_s:g} s are allowed)"
            )
            self._say("alarm", words, "")
        return ended is not None

    def _go_on_from(self, report: MountReport) -> None:
        """Go on from a mount's report.

        Raises Interrupted where the mount is beyond a limit; it has been stopped then.
        """
        if not report.is_slewing:
            self._parts.planner.moved_by_hand(report)
        how = "slews" if report.is_slewing else "tracks" if report.is_tracking else "stands still"
        if report.is_parked:
            self._say("info", "the mount is parked: nothing else has become of it")
            return
        refusal = self._parts.watch.refusal(report)
        if refusal is not None:
            self._end_at_limit(f"after nobody watched the mount: {refusal.text}")
            return
        site = self._control.config.site.to_site()
        alt_deg, az_deg = icrs_to_altaz(
            site, report.ra_icrs_deg, report.dec_icrs_deg, report.t_utc_ns
        )
        where = f"the mount {how} at altitude {alt_deg:.0f}, azimuth {az_deg:.0f} deg"
        goes_on = "autonomy goes on" if self._control.authority.is_autonomous else "as it was left"
        if self._by_hand.move is not None and not report.is_slewing:
            self._by_hand.move = None
            goes_on = "the move by hand has ended there: ask for it again"
        within = ", within its limits" if report.is_slewing or report.is_tracking else ""
        self._say("info", f"{where}{within}: {goes_on}")

    def _note(self, text: str) -> None:
        self.trouble = ClockTrouble(
            t_utc_ns=self._parts.instrument_controller.now_utc_ns(), text=text
        )

    def _say(
        self, level: Literal["info", "warning", "alarm"], text: str, topic: Topic = "clock"
    ) -> None:
        self._parts.session_log.say(level, text, topic)
