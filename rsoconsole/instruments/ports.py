"""Interfaces of clock, mount and camera, the same for every driver.

Directions are ICRS degrees; epoch of date and hours exist only in the processes that speak INDI.
Instants are UTC nanoseconds. An instrument that does not do something in time raises
InstrumentError, whose text names the remedy.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, Protocol

from rsoconsole.instruments.motion import Motion
from rsoconsole.records import Frame, Site

PierSide = Literal["east", "west"]
StopPath = Literal["mount", "indi"]
"""Path of a STOP: the mount's own process, or a second plain connection to the INDI server."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MountReport:
    """State of the mount at one instant, as its driver reports it and as its motion is measured."""

    t_utc_ns: int
    """Time of the report: simulated time, or when the report arrived."""
    ra_icrs_deg: float
    dec_icrs_deg: float
    is_slewing: bool
    is_parked: bool
    is_tracking: bool
    pier_side: PierSide | None
    """Side of the pier on which the telescope is; None when the mount does not report it."""
    age_s: float = 0.0
    """Age of the driver's report, s, by wall clock; 0 in the simulated observatory."""
    is_parking: bool = False
    """True on the way to the park position, or where the driver reports that the mount is there and
    no measurement shows it yet.
    """
    motion: Motion = field(default_factory=Motion)
    """Motion measured from the reported directions."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StopResult:
    """Result of a STOP so far: ABORT sent, answered by the driver, motion measured."""

    is_answered: bool
    """True where the driver accepted ABORT and claims no motion: no proof that it stands."""
    ms: float
    """Wall time from the request until ``is_answered`` was known, or given up, ms."""
    path: StopPath
    ordered_ms: float | None = None
    """Wall time, ms, from request until ABORT was on its way; None: it never was, or unknown."""
    is_tracking: bool | None = None
    """True where tracking is on, as the driver reports; None where it does not report that."""
    motion: Motion | None = None
    """Motion measured since: stands, tracks, still moves or unknown; None: being measured."""
    measured_ms: float | None = None
    """Wall time from the request until ``motion`` was known, or given up, ms."""
    detail: str = ""
    """Reason why the STOP is not answered, or the motion is not known; empty for none."""
    is_superseded: bool = False
    """True when another order ended the measurement."""

    @property
    def rate_deg_s(self) -> float | None:
        """Rate of the faster axis, deg/s; None where the mount is not measured to move."""
        moves = self.motion is not None and self.motion.kind == "moves"
        return self.motion.rate_deg_s if self.motion is not None and moves else None

    @property
    def is_at_rest(self) -> bool:
        """True where the measured motion is that of a mount that stands still or tracks."""
        return self.motion is not None and self.motion.is_at_rest


@dataclass(frozen=True, slots=True, kw_only=True)
class MountAbilities:
    """What the mount's driver can do, as found when it was connected."""

    can_abort: bool = True
    """True where motion can be ended; False: only the power switch ends a slew."""
    can_park: bool = True
    can_set_tracking: bool = True
    """True where tracking can be set; if not, no limit can end it, and its state is unknown."""
    has_pier_side: bool = True
    has_site: bool = True
    has_time: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class SlewEnd:
    """End of a slew by the mount's own process, because no engine watched it."""

    unwatched_s: float
    """Time since the last order of the engine, s."""
    lease_s: float
    """Longest time allowed without an order of the engine, s."""


def ignore_stop_result(_result: StopResult) -> None:
    """Do nothing: the callback of a STOP for callers that need only its returned result."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SiteCheck:
    """The site that the mount reports, compared with the configured site."""

    is_consistent: bool
    reported: Site | None
    """Site that the mount reports; None when it reports none."""
    detail: str


@dataclass(frozen=True, slots=True, kw_only=True)
class SkyReport:
    """Weather and dome at one instant, as their drivers report them."""

    weather: Literal["ok", "warning", "alert", "silent"] | None
    """State of the weather; None: no station is configured; "silent": it does not answer."""
    dome: Literal["open", "closed", "moving", "silent"] | None
    detail: str = ""
    """Message of the driver, or why it is silent."""


class SafetyMonitorPort(Protocol):
    """Interface of a monitor of weather and dome."""

    def look(self) -> SkyReport:
        """Return the latest report, at once; never raises."""

    def close(self) -> None:
        """Close the connection."""


ClockFaultKind = Literal["set", "leap second", "runs wrong", "runs right", "slept", "stood still"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockFault:
    """A fault of the machine's clock."""

    kind: ClockFaultKind
    """Kind of fault. "set": UTC was stepped, by somebody or a time service; "leap second": by one;
    "runs wrong": its seconds are none, until "runs right"; "slept": the whole machine; "stood
    still": this process was not run."""
    seconds: float
    """Size of the step of UTC, or the time in which nothing ran, s."""
    rate: float = 1.0
    """Kind "runs wrong": seconds of UTC per true second."""


class Clock(Protocol):
    """Interface of the engine's only source of time."""

    @property
    def is_simulated(self) -> bool:
        """True when time passes only during ``wait_until``."""

    @property
    def speed(self) -> float:
        """Seconds of this clock per second of wall time during a wait; 0: as fast as possible."""

    def now_utc_ns(self) -> int:
        """Return the present instant, UTC ns."""

    def wait_until(self, t_utc_ns: int) -> bool:
        """Let time pass until ``t_utc_ns``; return at once if that is past.

        Returns True when the instant was reached, False when ``wake`` ended the wait early. With a
        simulated clock the observatory's time passes meanwhile: on return, mount and camera are at
        the instant, and the mount has reported it. Raises InstrumentError when the simulated
        observatory does not answer.
        """

    def wake(self) -> None:
        """End the wait in progress; where none is, the next wait ends at once.

        May be called from any thread.
        """

    def take_faults(self) -> tuple[ClockFault, ...]:
        """Return the faults of the clock since the last call, in order."""

    @property
    def is_steady(self) -> bool:
        """False while the clock runs at a wrong rate: measurements then have no valid time."""


class MountPort(Protocol):
    """Interface of a telescope mount."""

    def start(self) -> None:
        """Connect. Raises InstrumentError when the mount cannot be reached."""

    def slew(self, ra_icrs_deg: float, dec_icrs_deg: float, now_utc_ns: int) -> None:
        """Slew to a direction and track there; returns once the mount has accepted the order.

        Tracks at the sidereal rate. ``now_utc_ns`` fixes the epoch of date. Raises InstrumentError
        when the mount refuses (parked, below its limits) or is silent.
        """

    def report(self, not_before_utc_ns: int | None = None, timeout_s: float = 10.0) -> MountReport:
        """Return the latest report; waits for a report not older than ``not_before_utc_ns``.

        ``timeout_s`` is wall clock. Raises InstrumentError when none comes in time.
        """

    def abort(
        self, timeout_s: float = 2.0, *, on_news: Callable[[StopResult], None] = ignore_stop_result
    ) -> StopResult:
        """End motion at once; returns when the driver has answered and tracking is set as required.

        ABORT goes through the mount's process and, where the driver does not answer within 100 ms,
        also by a second plain connection to the INDI server. ``on_news`` is called when ABORT is
        sent, when it is answered, and, also after this has returned, each time that the measured
        motion changes: for 30 s at most, or until the next order. Never raises because a mount does
        not respond.
        """

    def park(self) -> None:
        """Order the mount to its park position; ``report().is_parked`` shows the arrival."""

    def unpark(self) -> None:
        """Release a parked mount: while parked, it accepts no other order."""

    def set_tracking(self, is_on: bool) -> None:
        """Turn sidereal tracking on or off."""

    def set_sidereal_rate(self) -> None:
        """Set the sidereal rate, where another program has left the mount another one."""

    def set_site(self, site: Site) -> None:
        """Set the site in the mount."""

    def check_site(self, site: Site) -> SiteCheck:
        """Compare the mount's own site with ``site``, the configured one."""

    def abilities(self) -> MountAbilities:
        """Return what the driver can do. Raises InstrumentError where it is not connected."""

    def keep(self, lease_s: float, track_until_utc_ns: int | None) -> None:
        """Renew the lease on motion, because the engine watches the mount; never raises.

        Without another call within ``lease_s`` (wall time) a slew is ended, and the mount returns
        to sidereal tracking. At ``track_until_utc_ns`` (the instant of the next limit, by the
        machine's clock; None: no limit) tracking ends, unless a later call has named a later
        instant.
        """

    def take_slew_end(self) -> SlewEnd | None:
        """Return, once, how the mount's process ended an unwatched slew; None: it ended none."""

    def utc_offset_s(self) -> float | None:
        """Return the mount's clock minus the engine's, s; None when the mount reports no time."""

    def restart(self) -> None:
        """End the mount's process, start a new one and connect."""

    def close(self) -> None:
        """End the mount's process; it leaves the mount tracking at the sidereal rate, not
        slewing.
        """


class CameraPort(Protocol):
    """Interface of a camera."""

    def start(self) -> None:
        """Connect. Raises InstrumentError when the camera cannot be reached."""

    def start_exposure(self, exposure_s: float, frame_id: int) -> None:
        """Open the shutter; returns once the camera has accepted the order.

        Raises InstrumentError when the camera refuses or is silent.
        """

    def set_binning(self, binning: int) -> int:
        """Bin ``binning`` times as many pixels on each axis as in the camera's original setting.

        1: the original setting. To be called between exposures. Returns the binning now in force.
        Raises InstrumentError where the camera cannot bin that many, or is silent.
        """

    def set_subframe(self, share: float) -> float:
        """Read only the middle of the camera's original window: ``share`` of each side.

        ``share``: a fraction; 1: the whole window. To be called between exposures. Returns the
        share now in force, which the camera may have rounded. Raises InstrumentError where the
        camera cannot read a part of its window, or is silent.
        """

    def wait_frame(self, timeout_s: float) -> Frame:
        """Return the frame of the exposure under way, within ``timeout_s`` of wall time.

        A simulated clock must first have been advanced past the end of the exposure (order + start
        latency + exposure). The pixels must not be changed. Raises InstrumentError when no frame
        comes; the camera's process is then started again.
        """

    def take_messages(self) -> tuple[str, ...]:
        """Return the driver's messages, verbatim, since the last call."""

    def abort(self) -> None:
        """Abort the exposure under way; it yields no frame."""

    def restart(self) -> None:
        """End the camera's process, start a new one and connect."""

    def close(self) -> None:
        """End the camera's process and release the shared memory."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Instruments:
    """Clock, mount, camera and safety monitor of one observatory."""

    clock: Clock
    mount: MountPort
    camera: CameraPort
    host: str
    port: int
    mount_name: str
    camera_name: str
    safety_monitor: SafetyMonitorPort | None = None
    """Monitor of weather and dome; None where neither is configured."""
