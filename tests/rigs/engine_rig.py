"""An engine among instruments that live in the test: no process, no INDI, no disk."""

import dataclasses
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config
from rsoconsole.control import Outcome, Request, make_command
from rsoconsole.control.wire import parse_sender
from rsoconsole.engine import Engine
from rsoconsole.engine.aim.instrument_controller import InstrumentController, Interrupted
from rsoconsole.engine.service._command_handler import CommandHandler
from rsoconsole.engine.tasks.command_queue import CommandQueue
from rsoconsole.instruments import (
    SIDEREAL_ARCSEC_S,
    ClockFault,
    Instruments,
    MountAbilities,
    MountReport,
    PierSide,
    SiteCheck,
    SlewEnd,
    StopResult,
)
from rsoconsole.instruments.motion import Motion
from rsoconsole.instruments.ports import SafetyMonitorPort
from rsoconsole.pipeline import Glance, Reduction
from rsoconsole.records import (
    Detections,
    Frame,
    Measurement,
    Site,
    Solution,
    Wcs,
    measurement_id_of,
)
from rsoconsole.sky import altaz_to_icrs
from tests.makers import NS, T0_UTC_NS, geo_measurement

CONFIG = Config()
SITE = CONFIG.site.to_site()
START_DEG = altaz_to_icrs(SITE, 55.0, 180.0, T0_UTC_NS)


class StillClock:
    """Time passes only when waited for."""

    is_simulated = True
    speed = 0.0

    def __init__(self) -> None:
        self.t_utc_ns = T0_UTC_NS
        self.faults: list[ClockFault] = []
        self.is_steady = True

    def set_by(self, step_s: float) -> None:
        """Have somebody set it; what it says then is up to the test."""
        self.faults.append(ClockFault(kind="set", seconds=step_s))

    def now_utc_ns(self) -> int:
        return self.t_utc_ns

    def wait_until(self, t_utc_ns: int) -> bool:
        self.t_utc_ns = max(self.t_utc_ns, t_utc_ns)
        return True

    def wake(self) -> None:
        pass

    def take_faults(self) -> tuple[ClockFault, ...]:
        """What a test has done to it, once."""
        faults, self.faults = tuple(self.faults), []
        return faults


class PlainMount:
    """Goes where it is told, unless told to be broken."""

    def __init__(self, clock: StillClock) -> None:
        self.clock = clock
        self.at_deg = START_DEG
        self.slews: list[tuple[float, float]] = []
        self.aborts = 0
        self.is_stuck = False
        self.is_parked = False
        self.is_tracking = True
        self.pier_side: PierSide | None = "west"
        self.slew_end: SlewEnd | None = None
        self.able = MountAbilities()
        self.measured: Motion | None = None
        """How it is measured to move, where that is not what it is told to."""

    @property
    def motion(self) -> Motion:
        if self.measured is not None:
            return self.measured
        is_standing = self.is_parked or not self.is_tracking
        rate_arcsec_s = SIDEREAL_ARCSEC_S if is_standing else 0.0
        return Motion(kind="stands" if is_standing else "tracks", ra_rate_arcsec_s=rate_arcsec_s)

    @motion.setter
    def motion(self, measured: Motion) -> None:
        self.measured = measured

    def slew(self, ra_icrs_deg: float, dec_icrs_deg: float, now_utc_ns: int) -> None:
        self.slews.append((ra_icrs_deg, dec_icrs_deg))
        if not self.is_stuck:
            self.at_deg = (ra_icrs_deg, dec_icrs_deg)

    def report(self, not_before_utc_ns: int | None = None, timeout_s: float = 10.0) -> MountReport:
        return MountReport(
            t_utc_ns=self.clock.t_utc_ns,
            ra_icrs_deg=self.at_deg[0],
            dec_icrs_deg=self.at_deg[1],
            is_slewing=False,
            is_parked=self.is_parked,
            is_tracking=self.is_tracking and not self.is_parked,
            pier_side=self.pier_side,
            motion=self.motion,
        )

    def abort(self, timeout_s: float = 2.0, *, on_news: Any = None) -> StopResult:
        self.aborts += 1
        result = StopResult(is_answered=True, ms=1.0, path="mount")
        if on_news is not None:
            on_news(result)
            on_news(dataclasses.replace(result, motion=Motion(kind="tracks"), measured_ms=2.0))
        return result

    def park(self) -> None:
        self.is_parked = True

    def unpark(self) -> None:
        self.is_parked = False

    def set_tracking(self, is_on: bool) -> None:
        self.is_tracking = is_on

    def set_sidereal_rate(self) -> None:
        """It has no other."""

    def keep(self, lease_s: float, track_until_utc_ns: int | None) -> None:
        self.lease = (lease_s, track_until_utc_ns)

    def check_site(self, site: Site) -> SiteCheck:
        return SiteCheck(is_consistent=True, reported=site, detail="agrees")

    def utc_offset_s(self) -> float | None:
        return 0.0

    def abilities(self) -> MountAbilities:
        return self.able

    def take_slew_end(self) -> SlewEnd | None:
        """What a test has had its own process do, once."""
        taken, self.slew_end = self.slew_end, None
        return taken


class PlainCamera:
    """Gives black frames in time, unless told to be broken."""

    def __init__(self, clock: StillClock) -> None:
        self.clock = clock
        self.broken_for = 0
        self.aborts = 0
        self.binned: list[int] = []
        self.shares: list[float] = []

    def start_exposure(self, exposure_s: float, frame_id: int) -> None:
        self.taken = (frame_id, self.clock.now_utc_ns(), exposure_s)

    def set_binning(self, binning: int) -> int:
        self.binned.append(binning)
        return binning

    def set_subframe(self, share: float) -> float:
        self.shares.append(share)
        return share

    def wait_frame(self, timeout_s: float) -> Frame:
        if self.broken_for > 0:
            self.broken_for -= 1
            raise InstrumentError("camera gave no frame in 30 s: check its USB power")
        frame_id, t_start_ns, exposure_s = self.taken
        return Frame(
            frame_id=frame_id,
            name=f"frame {frame_id}",
            pixels=np.zeros((64, 64), np.uint16),
            t_start_utc_ns=t_start_ns,
            exposure_s=exposure_s,
        )

    def take_messages(self) -> tuple[str, ...]:
        return ()

    def abort(self) -> None:
        self.aborts += 1


class ScriptedReducer:
    """Sees a geostationary satellite in the frames it is told to, at its true place.

    Every frame is solved: the telescope looks exactly where the mount says.
    """

    def __init__(self, frames: set[int], mount: PlainMount) -> None:
        self.frames = frames
        self.mount = mount
        self.config = CONFIG

    def configure(self, config: Config) -> None:
        self.config = config

    def forget_plate(self) -> None:
        pass

    def glance(self, frame: Frame, reach_px: float) -> Glance | None:
        """The test's frames have no middle."""
        return None

    def reduce(self, frame: Frame) -> Reduction:
        found: tuple[Measurement, ...] = ()
        if frame.frame_id in self.frames and frame.t_mid_utc_ns is not None:
            since_s = (frame.t_mid_utc_ns - T0_UTC_NS) / NS
            here = geo_measurement(2, ra_deg=START_DEG[0], dec_deg=START_DEG[1], cadence_s=since_s)
            found = (
                dataclasses.replace(
                    here,
                    measurement_id=measurement_id_of(frame.frame_id, 0),
                    frame_id=frame.frame_id,
                    t_mid_utc_ns=frame.t_mid_utc_ns,
                ),
            )
        return Reduction(
            detections=Detections(
                frame_id=frame.frame_id, width_px=64, height_px=64, detections=()
            ),
            solution=dataclasses.replace(solution_at(*self.mount.at_deg), frame_id=frame.frame_id),
            measurements=found,
            star_count=100,
            fwhm_px=2.5,
            absence="no detection",
        )


class Memory:
    """A recorder that only remembers."""

    def __init__(self) -> None:
        self.records: list[Any] = []
        self.t_utc_ns: list[int] = []

    def append(self, record: Any, t_utc_ns: int) -> int:
        self.records.append(record)
        self.t_utc_ns.append(t_utc_ns)
        return len(self.records)

    def save_frame(self, frame: Frame) -> bool:
        return True

    def save_preview(self, frame_id: int, picture: Any, stars: Any = None) -> bool:
        return True

    def save_closeup(self, frame_id: int, picture: Any) -> bool:
        return True

    def of(self, kind: type[Any]) -> list[Any]:
        return [record for record in self.records if isinstance(record, kind)]


@dataclasses.dataclass
class Rig:
    """One engine and everything around it."""

    engine: Engine
    mount: PlainMount
    camera: PlainCamera
    clock: StillClock
    memory: Memory
    queue: CommandQueue
    reducer: ScriptedReducer


def rig(
    frames: set[int],
    config: Config = CONFIG,
    safety_monitor: SafetyMonitorPort | None = None,
    make_mount: Callable[[StillClock], PlainMount] = PlainMount,
) -> Rig:
    clock = StillClock()
    mount, camera = make_mount(clock), PlainCamera(clock)
    instruments = Instruments(
        clock=clock,
        mount=mount,  # type: ignore[arg-type]
        camera=camera,  # type: ignore[arg-type]
        host="",
        port=0,
        mount_name="",
        camera_name="",
        safety_monitor=safety_monitor,
    )
    queue, memory, reducer = CommandQueue(), Memory(), ScriptedReducer(frames, mount)
    engine = Engine(
        config=config,
        instrument_controller=InstrumentController(
            instruments, config, lambda: queue.is_interrupt_wanted
        ),
        reducer=reducer,  # type: ignore[arg-type]
        record=memory,
        queue=queue,
    )
    return Rig(engine, mount, camera, clock, memory, queue, reducer)


def command_handler_of(r: Rig, mount_word_s: float = 0.0) -> CommandHandler:
    """``mount_word_s``: so long an answer waits for the mount; not at all where no loop runs."""
    return CommandHandler(r.engine, r.queue, Path(), mount_word_s=mount_word_s)


def asked(
    verb: str,
    arguments: Mapping[str, Any] | None = None,
    by: str = "operator",
    stamp: int | None = None,
) -> Request:
    """A command as it comes off the wire. Raises ValueError for what is none."""
    return Request(
        command=make_command(verb, arguments or {}), sender=parse_sender(by), stamp=stamp
    )


def told(
    command_handler: CommandHandler, verb: str, arguments: Mapping[str, Any], by: str = "operator"
) -> Outcome:
    """What the wire answers: also to what is no command."""
    try:
        return command_handler.handle(asked(verb, arguments, by))
    except ValueError as error:
        return Outcome(ok=False, message=str(error))


def heed_alarms(r: Rig) -> None:
    """What has cut in, as the loop heeds it: once the thread that stops the mount has left it.

    A STOP is answered before that thread has ended.
    """
    ends_s = time.monotonic() + 20.0
    while True:
        try:
            return r.engine.commands.heed_alarms()
        except Interrupted:
            assert time.monotonic() < ends_s, "a STOP is still under way"


def end_when_idle(r: Rig) -> None:
    """Shut the engine down at its first idle second after the arming."""
    wait = r.clock.wait_until

    def leave(t_utc_ns: int) -> bool:
        if r.engine.following.state in ("IDLE", "FAULT"):
            r.queue.request_shutdown()
        return wait(t_utc_ns)

    r.clock.wait_until = leave  # type: ignore[method-assign]


def solution_at(ra_deg: float, dec_deg: float) -> Solution:
    wcs = Wcs(
        crpix_x_px=0.0,
        crpix_y_px=0.0,
        crval_ra_deg=ra_deg,
        crval_dec_deg=dec_deg,
        cd=(3.5e-4, 0.0, 0.0, 3.5e-4),
    )
    return Solution(
        frame_id=1,
        wcs=wcs,
        ra_icrs_deg=ra_deg,
        dec_icrs_deg=dec_deg,
        scale_arcsec_px=1.26,
        rotation_deg=0.0,
        is_flipped=False,
        matched=50,
        rms_arcsec=0.5,
        path="full",
        ms=10.0,
    )
