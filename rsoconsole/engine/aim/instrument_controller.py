"""Moves the mount and opens the shutter, each with a deadline; the targets come from others."""

import contextlib
import dataclasses
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config
from rsoconsole.instruments import ClockFault, Instruments, MountReport
from rsoconsole.records import Frame, SlewCommand, SlewRefusal
from rsoconsole.sky import separation_deg

NS = 1_000_000_000
POLL_NS = NS // 2
SENT_AGAIN = 2
FAR_OFF_DEG = 0.5
"""Distance from the target, deg, beyond which a mount has stopped elsewhere."""


class Interrupted(Exception):  # noqa: N818 -- a signal, not an error
    """Signal that ends the loop's present work (STOP, shutdown); operators never see it."""


class StoppedElsewhere(Exception):  # noqa: N818 -- a fact about the mount, not an error
    """The mount is not where this program sent it: somebody else stopped or moved it."""


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Ordered:
    """A motion that this program has ordered; each order makes a new object."""

    t_utc_ns: int
    to_icrs_deg: tuple[float, float] | None
    """Target in the mount's own coordinates, ICRS degrees; None: its park position."""


class InstrumentController:
    """The loop's access to the instruments.

    While the loop is to be interrupted, no slew and no exposure is ordered.
    """

    def __init__(
        self, instruments: Instruments, config: Config, is_wanted: Callable[[], bool]
    ) -> None:
        """``is_wanted``: returns True when the loop is to drop its work."""
        self.instruments = instruments
        self._config = config
        self._is_wanted = is_wanted
        self.sent: tuple[tuple[float, float], int] | None = None
        """Last target sent (mount's coordinates, ICRS deg) and time, UTC ns; None: none or over."""
        self._is_sent_to_park = False
        """True where the last order that the mount accepted was to park."""
        self.ordered: Ordered | None = None
        """The motion ordered last; set before the mount receives it, kept if the mount refuses."""
        self.arrived_utc_ns = 0
        """Time at which the mount last reported its arrival, before it settled, UTC ns."""
        self.on_tick: Callable[[], None] = lambda: None
        """Called at every step of a wait, at least once a second."""
        self.on_opened: Callable[[int, int], None] = lambda _frame_id, _opened_utc_ns: None
        """Called when an exposure has been ordered, with its frame number and the time, UTC ns."""
        self.on_closed: Callable[[], MountReport | None] = lambda: None
        """Callback when a shutter should have closed; returns where a mount sent on looked."""
        self.on_clock_fault: Callable[[ClockFault], None] = lambda _fault: None
        """Called when the clock was set or runs wrong, or the program stood still."""

    def configure(self, config: Config) -> None:
        """Use a new configuration from now on."""
        self._config = config

    def heed(self) -> None:
        """Raise Interrupted when the loop is to be interrupted; else do nothing."""
        if self._is_wanted():
            raise Interrupted

    def now_utc_ns(self) -> int:
        """Return the clock's present time, UTC ns."""
        return self.instruments.clock.now_utc_ns()

    def wait_until(self, t_utc_ns: int) -> None:
        """Let time pass until an instant, in steps of at most a second.

        Raises Interrupted when the loop is to be interrupted, and also when the clock was set or
        the program stood still: the instant has then lost its meaning, and so have the times of
        work under way.
        """
        clock = self.instruments.clock
        while True:
            self.heed()
            self.raise_if_clock_fault()
            now_ns = clock.now_utc_ns()
            if now_ns >= t_utc_ns:
                return
            clock.wait_until(min(t_utc_ns, now_ns + NS))
            self.on_tick()

    def raise_if_clock_fault(self) -> None:
        """Raise Interrupted when the clock was set or runs wrong, or the program stood still."""
        faults = self.instruments.clock.take_faults()
        for fault in faults:
            self.on_clock_fault(fault)
        if faults:
            raise Interrupted

    def mount_report(self) -> MountReport:
        """Return the mount's position report; under simulation, one made now or later."""
        not_before = self.now_utc_ns() if self.instruments.clock.is_simulated else None
        return self.instruments.mount.report(not_before)

    def order_slew(self, ra_icrs_deg: float, dec_icrs_deg: float) -> None:
        """Send the mount to a direction in its own coordinates and return at once.

        Raises Interrupted, before anything is sent, when the loop is to be interrupted.
        """
        self.heed()
        now_ns = self.now_utc_ns()
        self.ordered = Ordered(t_utc_ns=now_ns, to_icrs_deg=(ra_icrs_deg, dec_icrs_deg))
        self.instruments.mount.slew(ra_icrs_deg, dec_icrs_deg, now_ns)
        self.sent, self._is_sent_to_park = ((ra_icrs_deg, dec_icrs_deg), now_ns), False

    def order_park(self) -> None:
        """Send the mount to its park position and return at once."""
        self.forget_order()
        self.ordered = Ordered(t_utc_ns=self.now_utc_ns(), to_icrs_deg=None)
        self.instruments.mount.park()
        self._is_sent_to_park = True

    def forget_order(self) -> None:
        """Forget the last order and do not await its arrival: its motion is or will be ended."""
        self.sent, self._is_sent_to_park = None, False
        if self.ordered is not None and self.ordered.to_icrs_deg is None:
            self.ordered = None

    def is_on_its_way_to_park(self, report: MountReport) -> bool:
        """Return True while the mount moves to its park position.

        Some drivers do not report this; so a slew also counts if the last order was to park.
        """
        return report.is_slewing and (report.is_parking or self._is_sent_to_park)

    def end_motion(self) -> None:
        """End a slew and wait until the mount rests."""
        self.forget_order()
        self.instruments.mount.abort()
        self.wait_for_rest()

    def end_park(self) -> None:
        """Release a parked mount; stop a mount on its way to park, and wait until it rests."""
        report = self.mount_report()
        is_on_its_way = self.is_on_its_way_to_park(report)
        if report.is_parked or report.is_parking:
            self.forget_order()
            self.instruments.mount.unpark()
        elif is_on_its_way:
            self.forget_order()
            self.instruments.mount.abort()
        if is_on_its_way:
            self.wait_for_rest()

    def wait_for_arrival(
        self,
        ra_icrs_deg: float,
        dec_icrs_deg: float,
        *,
        poll_ns: int = POLL_NS,
        settle_s: float | None = None,
    ) -> MountReport:
        """Wait until the mount reports its arrival, and then until it has settled.

        ``poll_ns``: interval between two reports, ns; ``settle_s``: time to settle, s, None for the
        configured time. A mount that stops a little beside the target is sent there again, up to
        twice, because some mounts lose the sky's motion during a long slew. Raises StoppedElsewhere
        when the mount rests far from the target: somebody else has stopped it, and it is left
        there. Raises InstrumentError when it does not arrive in time, Interrupted on STOP.
        """
        limit_ns = self.now_utc_ns() + round(self._config.mount.slew_timeout_s * NS)
        for sent_again in itertools.count():
            report = self._wait_for_rest(limit_ns, poll_ns)
            off_deg = separation_deg(
                report.ra_icrs_deg, report.dec_icrs_deg, ra_icrs_deg, dec_icrs_deg
            )
            if not report.is_slewing and off_deg * 60.0 <= self._config.mount.arrival_arcmin:
                break
            if report.is_slewing or sent_again >= SENT_AGAIN:
                raise InstrumentError(
                    f"the mount has not arrived in {self._config.mount.slew_timeout_s:.0f} s or"
                    f" {SENT_AGAIN + 1} orders, it is {off_deg * 60:.1f} arcmin off: look at it,"
                    " then arm again"
                )
            if off_deg > FAR_OFF_DEG:
                raise StoppedElsewhere(
                    f"the mount stopped {off_deg:.1f} deg short of where it was sent"
                )
            self.order_slew(ra_icrs_deg, dec_icrs_deg)
        self.arrived_utc_ns = self.now_utc_ns()
        settle_s = self._config.mount.settle_s if settle_s is None else settle_s
        self.wait_until(self.arrived_utc_ns + round(settle_s * NS))
        return report

    def wait_for_rest(self) -> MountReport:
        """Wait until the mount no longer slews.

        Raises InstrumentError when it slews for too long.
        """
        limit_ns = self.now_utc_ns() + round(self._config.mount.slew_timeout_s * NS)
        report = self._wait_for_rest(limit_ns)
        if report.is_slewing:
            raise InstrumentError(
                f"the mount has slewed for {self._config.mount.slew_timeout_s:.0f} s and more:"
                " look at it, then arm again"
            )
        return report

    def _wait_for_rest(self, limit_utc_ns: int, poll_ns: int = POLL_NS) -> MountReport:
        """Return the first report of a mount that no longer slews, or the last before the limit."""
        while True:
            self.wait_until(self.now_utc_ns() + poll_ns)
            report = self.mount_report()
            if not report.is_slewing or self.now_utc_ns() > limit_utc_ns:
                return report

    def expose(self, t_start_utc_ns: int, frame_id: int) -> Frame:
        """Open the shutter at an instant and return the frame.

        Raises InstrumentError when no frame comes, and Interrupted on STOP. Raises Interrupted also
        where the clock was set or the program stood still, because the frame's time is then
        worthless. An exposure under way is given up.
        """
        exposure = self._config.exposure
        camera = self.instruments.camera
        looked: MountReport | None = None
        self.wait_until(t_start_utc_ns)
        opened_ns = self.now_utc_ns()
        camera.start_exposure(exposure.exposure_s, frame_id)
        length_s = exposure.start_latency_s + exposure.exposure_s
        try:
            self.on_opened(frame_id, opened_ns)
            self.wait_until(opened_ns + math.ceil(length_s * NS))
            looked = self.on_closed()
        except (Interrupted, InstrumentError, StoppedElsewhere):
            # Or its frame would come while the next exposure is under way, and pass for that one's.
            with contextlib.suppress(InstrumentError):
                camera.abort()
            raise
        frame = camera.wait_frame(exposure.frame_timeout_s)
        # Some drivers write a frame's time when they have read it.
        self.raise_if_clock_fault()
        return frame if looked is None else _looked_at(frame, looked)


def _looked_at(frame: Frame, report: MountReport) -> Frame:
    """Return the frame with the mount's report from before it was sent on.

    Some drivers write a frame's header when they have read it, on the way to the next place.
    """
    if frame.pointing_ra_icrs_deg is None:
        return frame
    return dataclasses.replace(
        frame, pointing_ra_icrs_deg=report.ra_icrs_deg, pointing_dec_icrs_deg=report.dec_icrs_deg
    )


IsRefused = Callable[[SlewCommand, int], SlewRefusal | None]
"""Function that returns the limit against a slew's place until an instant, UTC ns, or None."""

SLEW_OVERHEAD_S = 3.0
"""Assumed time of a slew beyond travel and settling, s; ample, so that slow mounts are in time."""

FLIP_WAY_DEG = 190.0
"""Turn of the declination axis that changes sides near the equator; the other turns less."""

CLOCKS_APART_NS = 10 * NS


@dataclass(frozen=True, slots=True, kw_only=True)
class AimPlan:
    """The plan of the next exposure: its times, and the slew before it if there is one."""

    t_start_utc_ns: int
    t_mid_utc_ns: int
    slew: SlewCommand | None
    refused: tuple[tuple[SlewCommand, SlewRefusal], ...] = ()
    """Refused slews with the limit; each place once, but all where nothing is left to search."""
    blocked: SlewRefusal | None = None
    """Reason why the telescope does not follow the track; None when it may."""
