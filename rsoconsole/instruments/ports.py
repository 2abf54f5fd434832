"""Interfaces of clock, mount and camera, whichever driver is behind them.

Directions are ICRS degrees on this side of the border; epoch of date and hours exist only in
the processes that speak INDI. Instants are UTC nanoseconds. Everything that an instrument does
not do in time raises InstrumentError with the remedy in words.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, Protocol

from rsoconsole.instruments.motion import Motion
from rsoconsole.records import Frame, Site

PierSide = Literal["east", "west"]
StopPath = Literal["mount", "indi"]
"""Path of a STOP: through the mount's own process, or by a second plain connection to the INDI
server."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MountReport:
    """The mount's state at one instant, as its driver reports it and as its motion is measured."""

    t_utc_ns: int
    """Time of the report: the simulated instant, or the arrival of the report."""
    ra_icrs_deg: float
    dec_icrs_deg: float
    is_slewing: bool
    is_parked: bool
    is_tracking: bool
    pier_side: PierSide | None
    """Side of the pier the telescope is on; None when the mount does not report it."""
    age_s: float = 0.0
    """Age of the driver's report, wall clock; 0 in the simulated observatory. A mount that only
    tracks may be silent for long."""
    is_parking: bool = False
    """True on the way to its park position, as the driver reports."""
    motion: Motion = field(default_factory=Motion)
    """Motion measured from the reported directions; all else here is the driver's report."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StopResult:
    """The result of a STOP so far: ordered, answered by the driver, and measured."""

    is_answered: bool
    """True where the driver has accepted ABORT and claims no motion any more: no proof that it
    stands."""
    ms: float
    """Wall time from the request until this was known, or given up."""
    path: StopPath
    ordered_ms: float | None = None
    """Wall time from the request until ABORT was on its way to the mount; None: it never was, or it
    is unknown."""
    is_tracking: bool | None = None
    """True where tracking is on, as the driver reports; None where it does not."""
    motion: Motion | None = None
    """The motion measured since: it stands, tracks, still moves, or is not known. None while it
    is being measured."""
    measured_ms: float | None = None
    """Wall time from the request until the motion was known, or given up."""
    detail: str = ""
    """Reason why it is not answered, or not known."""
    is_superseded: bool = False
    """True when another order ended the measurement."""

    @property
    def rate_deg_s(self) -> float | None:
        """Rate of the faster axis of a mount that moves on; None for any other, or not known."""
        moves = self.motion is not None and self.motion.kind == "moves"
        return self.motion.rate_deg_s if self.motion is not None and moves else None

    @property
    def is_at_rest(self) -> bool:
        """True where measured to stand or to track."""
        return self.motion is not None and self.motion.is_at_rest


@dataclass(frozen=True, slots=True, kw_only=True)
class MountAbilities:
    """The abilities of the mount's driver, as found when it was connected."""

    can_abort: bool = True
    """True where motion can be ended; without it nothing but the power switch ends a slew."""
    can_park: bool = True
    can_set_tracking: bool = True
    """True where tracking can be set; without it tracking cannot be ended at a limit, and its state
    is unknown."""
    has_pier_side: bool = True
    has_site: bool = True
    has_time: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class SlewEnd:
    """End of an unwatched slew by the mount's own process."""

    unwatched_s: float
    """Time without any order, seconds."""
    lease_s: float
    """Longest allowed time without any order, seconds."""


def ignore_stop_result(_result: StopResult) -> None:
    """Ignore the news of a STOP, where only its end is waited for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SiteCheck:
    """Site as the mount reports it against the configured one."""

    is_consistent: bool
    reported: Site | None
    """Site as the mount reports it; None when it does not."""
    detail: str


@dataclass(frozen=True, slots=True, kw_only=True)
class SkyReport:
    """Weather and dome as their drivers report them, at one instant."""

    weather: Literal["ok", "warning", "alert", "silent"] | None
    """State of the weather; None where no station is configured; "silent" where it is and does not
    answer."""
    dome: Literal["open", "closed", "moving", "silent"] | None
    detail: str = ""
    """Message of the driver, or why it is silent."""


class SafetyMonitorPort(Protocol):
    """A monitor of weather and dome."""

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
    """Size of the step of UTC, or time in which nothing ran."""
    rate: float = 1.0
    """Seconds of UTC in a second, of the kind "runs wrong"."""


class Clock(Protocol):
    """Source of time for the engine, the only one."""

    @property
    def is_simulated(self) -> bool:
        """True when time stands still except during a wait of this clock."""

    @property
    def speed(self) -> float:
        """Seconds of this clock in a second of wall time; 0: as many as possible."""

    def now_utc_ns(self) -> int:
        """The present instant."""

    def wait_until(self, t_utc_ns: int) -> bool:
        """Let time pass until ``t_utc_ns``; at once if that is past.

        True when the instant was reached, False when ``wake`` cut the wait short. A simulated
        clock makes the observatory live through that time: when it returns, mount and camera
        are at that instant and the mount has reported it. Raises InstrumentError when the
        simulated observatory does not answer.
        """

    def wake(self) -> None:
        """End a wait that is in progress (from any thread); without one, the next wait."""

    def take_faults(self) -> tuple[ClockFault, ...]:
        """Faults of the clock since the last call, in order."""

    @property
    def is_steady(self) -> bool:
        """False while a second of this clock is none: measurements then have no time."""


class MountPort(Protocol):
    """A telescope mount."""

    def start(self) -> None:
        """Connect. Raises InstrumentError when the mount cannot be reached."""

    def slew(self, ra_icrs_deg: float, dec_icrs_deg: float, now_utc_ns: int) -> None:
        """Slew to a direction and track at the sidereal rate; returns once the mount has accepted
        the order.

        ``now_utc_ns`` fixes the epoch of date. Raises InstrumentError when the mount refuses
        (parked, below its limits) or is silent.
        """

    def report(self, not_before_utc_ns: int | None = None, timeout_s: float = 10.0) -> MountReport:
        """Return the latest report, waiting (wall clock) for one at least as late as
        ``not_before_utc_ns``.

        Raises InstrumentError when none comes in time.
        """

    def abort(
        self, timeout_s: float = 2.0, *, on_news: Callable[[StopResult], None] = ignore_stop_result
    ) -> StopResult:
        """End motion at once; returns when the driver has answered, never raises for a mount that
        does not respond.

        Goes through the mount's process and, where the driver does not answer within 100 ms, beside
        it by a second plain connection to the INDI server. Returns when tracking is then ordered as
        required. ``on_news`` is called when ABORT is on its way, when it is answered, and, after
        this has returned, with the measured motion: each time that it changes, for 30 s at most, or
        until the next order.
        """

    def park(self) -> None:
        """Order the mount to its park position; ``report().is_parked`` shows the arrival."""

    def unpark(self) -> None:
        """Release a parked mount: parked, it accepts no other order."""

    def set_tracking(self, is_on: bool) -> None:
        """Turn sidereal tracking on or off."""

    def set_site(self, site: Site) -> None:
        """Send the mount its site."""

    def check_site(self, site: Site) -> SiteCheck:
        """Compare the mount's site with the configured one."""

    def abilities(self) -> MountAbilities:
        """Return the abilities of its driver. Raises InstrumentError where it is not connected."""

    def keep(self, lease_s: float, track_until_utc_ns: int | None) -> None:
        """Renew the lease on motion: the engine watches the mount.

        Without another call within ``lease_s`` (wall clock) a slew is ended and the mount goes
        back to sidereal tracking; at ``track_until_utc_ns`` (the instant of the next limit, by
        the machine's clock) tracking ends unless a later one has been given. Never raises.
        """

    def take_slew_end(self) -> SlewEnd | None:
        """The end of the last slew by the mount's process, once; None where it ended none."""

    def utc_offset_s(self) -> float | None:
        """The mount's own clock minus the engine's; None when it reports no time."""

    def restart(self) -> None:
        """Start a fresh process and a fresh connection."""

    def close(self) -> None:
        """End the process; the mount is left tracking at the sidereal rate, not slewing."""


class CameraPort(Protocol):
    """A camera."""

    def start(self) -> None:
        """Connect. Raises InstrumentError when the camera cannot be reached."""

    def start_exposure(self, exposure_s: float, frame_id: int) -> None:
        """Open the shutter; returns once the camera has accepted the order.

        Raises InstrumentError when the camera refuses or is silent.
        """

    def set_binning(self, binning: int) -> int:
        """Join a number of pixels on each axis, as a multiple of the binning that the camera was
        set to.

        1: as it was. Between exposures. Returns the binning from now on. Raises InstrumentError
        where the camera cannot or is silent.
        """

    def set_subframe(self, share: float) -> float:
        """Read only a share of each side of what the camera was set to read, about its middle.

        1: all of it. Between exposures. Returns the share that holds from now on, which the camera
        may have rounded. Raises InstrumentError where the camera cannot or is silent.
        """

    def wait_frame(self, timeout_s: float) -> Frame:
        """Return the frame of the exposure under way, within ``timeout_s`` of wall time.

        A simulated clock must first have been advanced past the end of the exposure (order + start
        latency + exposure). The pixels are the caller's own copy. Raises InstrumentError when no
        frame comes; the camera's process is then started again.
        """

    def take_messages(self) -> tuple[str, ...]:
        """Return the driver's messages since the last call, in its own words."""

    def abort(self) -> None:
        """Abort the exposure under way; its frame never comes."""

    def restart(self) -> None:
        """Start a fresh process and a fresh connection."""

    def close(self) -> None:
        """End the process and release the shared memory."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Instruments:
    """Clock, mount and camera of one observatory."""

    clock: Clock
    mount: MountPort
    camera: CameraPort
    host: str
    port: int
    mount_name: str
    camera_name: str
    safety_monitor: SafetyMonitorPort | None = None
    """Monitor of weather and dome; None where neither is configured."""
