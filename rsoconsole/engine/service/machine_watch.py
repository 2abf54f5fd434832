"""Watches the machine beside the loop, and reports when troubles begin and end.

A reading takes time because it runs programs; it is made on a separate thread, and the loop and the
threads that answer requests use the last reading.
"""

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from rsoconsole.config import Config
from rsoconsole.control import Machine, PartHealth, Poller
from rsoconsole.engine.doctor.doctor_system import free_bytes, read_clock
from rsoconsole.engine.doctor.mount_lacks import MissingAbility
from rsoconsole.engine.loop.interruptions import ClockTrouble
from rsoconsole.engine.machine.machine import Trouble, read_machine, troubles_of
from rsoconsole.engine.machine.medium import RecordingMedium, read_recording_medium, session_bytes
from rsoconsole.engine.machine.time_source import TimeSource, read_time_source
from rsoconsole.instruments import Clock, MountReport

log = logging.getLogger(__name__)

EVERY_S = 15.0
SLOW_LOOKS = 8
"""Number of looks between two checks of disk and time source."""
QUIET_LOOKS = 4
"""Number of looks without a trouble after which it is over; a weak power supply comes and goes."""
ABOUT = "machine: "
Level = Literal["info", "warning", "alarm"]


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineState:
    """The machine's state at its last reading."""

    reading: Machine
    troubles: tuple[Trouble, ...]
    """Troubles of the last look, and those that have ended only just before it."""
    medium: RecordingMedium
    time_source: TimeSource

    def as_status(self) -> Machine:
        """Return the machine's state in the form used by the status."""
        return replace(
            self.reading,
            troubles=tuple(trouble.words for trouble in self.troubles),
            recording_medium=self.medium.kind,
            recording_device=self.medium.device or None,
            recording_life_used_percent=self.medium.life_used_percent,
            time_source=self.time_source.kind,
            time_source_detail=self.time_source.detail,
            real_time_clock=self.time_source.rtc,
        )


class TroubleTracker:
    """The machine's present troubles, updated by each reading; reports beginnings and ends."""

    def __init__(self) -> None:
        self._held: dict[str, tuple[Trouble, int]] = {}

    @property
    def present_troubles(self) -> tuple[Trouble, ...]:
        """Troubles that have not ended yet, in the order in which they began."""
        return tuple(trouble for trouble, _ in self._held.values())

    def step(self, seen: tuple[Trouble, ...]) -> list[tuple[Level, str]]:
        """Update by one more reading; return the lines to report, each with its level.

        ``seen``: troubles that the reading shows.
        """
        said: list[tuple[Level, str]] = []
        for trouble in seen:
            if trouble.name not in self._held:
                level: Level = "warning" if trouble.name == "hot" else "alarm"
                said.append((level, f"{ABOUT}{trouble.words}: {trouble.remedy}"))
            self._held[trouble.name] = trouble, 0
        names = {trouble.name for trouble in seen}
        for name, (trouble, missed) in list(self._held.items()):
            if name in names:
                continue
            if missed + 1 < QUIET_LOOKS:
                self._held[name] = trouble, missed + 1
            else:
                del self._held[name]
                said.append(("info", f"{ABOUT}no longer {trouble.words.partition(':')[0]}"))
        return said


class MachineWatch(Poller):
    """Reads the machine's state on a separate thread; ``state`` may be read from any thread."""

    def __init__(self, folder: Path, say: Callable[[Level, str], None]) -> None:
        """``folder``: the session's folder; ``say``: puts a line on record."""
        super().__init__("machine", EVERY_S)
        self._folder = folder
        self._say = say
        self._troubles = TroubleTracker()
        self._looks = 0
        self.state: MachineState | None = None

    def look(self) -> None:
        """Read the machine's state once, and report what has changed."""
        reading = read_machine()
        said = self._troubles.step(troubles_of(reading))
        before = self.state
        if before is None or self._looks % SLOW_LOOKS == 0:
            medium, time_source = read_recording_medium(self._folder), read_time_source()
        else:
            medium, time_source = before.medium, before.time_source
        self._looks += 1
        self.state = MachineState(
            reading=reading,
            troubles=self._troubles.present_troubles,
            medium=medium,
            time_source=time_source,
        )
        for level, text in said:
            self._say(level, text)

    def _look(self) -> None:
        try:
            self.look()
        except Exception:  # a machine that is told about wrongly must not end the looking
            log.exception("the machine could not be looked at")


HOLDS_S = 5.0
"""Age at which clock and disk are read again, s."""
SILENT_S = 10.0
"""Age of its last report at which a mount counts as silent, s."""
LOW_HOURS = 4.0
SAID_S = 900.0
"""How long a fault of the clock is still reported after it came, s."""


class HealthMeter:
    """Reads the health of mount, clock, disk and machine; may be called from any thread.

    Clock and disk are read at most every few seconds.
    """

    def __init__(
        self,
        config: Callable[[], Config],
        clock: Clock,
        folder: Path,
        machine: Callable[[], MachineState | None] = lambda: None,
    ) -> None:
        """``machine``: returns the last reading of the machine itself; None: not read."""
        self._config = config
        self._clock = clock
        self._folder = folder
        self._machine = machine
        self._read_s = -HOLDS_S
        self._readings: tuple[PartHealth, ...] = ()

    def read(
        self,
        report: MountReport | None,
        trouble: ClockTrouble | None = None,
        lacks: Sequence[MissingAbility] = (),
    ) -> tuple[PartHealth, ...]:
        """Return the health of mount, clock, disk and machine; what cannot be read is left out.

        ``trouble``: the clock's last fault; ``lacks``: functions that the mount's driver does not
        offer.
        """
        now_s = time.monotonic()
        if now_s - self._read_s >= HOLDS_S:
            self._read_s = now_s
            self._readings = (self._read_clock(), self._read_disk())
        found = (self._mount(report), *self._readings, *machine_health(self._machine()))
        if trouble is not None:
            since_s = (self._clock.now_utc_ns() - trouble.t_utc_ns) / 1e9
            if 0.0 <= since_s < SAID_S or not self._clock.is_steady:
                clock = PartHealth(name="clock", ok=False, text=trouble.text)
                found = (*(each for each in found if each.name != "clock"), clock)
        return (*found, *driver_health(lacks))

    def _mount(self, report: MountReport | None) -> PartHealth:
        if report is None:
            return PartHealth(name="mount", ok=False, text="has not been heard of")
        silent_s = (self._clock.now_utc_ns() - report.t_utc_ns) / 1e9
        if silent_s > SILENT_S:
            return PartHealth(name="mount", ok=False, text=f"silent for {silent_s:.0f} s")
        word = "parked" if report.is_parked else "slewing" if report.is_slewing else ""
        claimed = "tracks" if report.is_tracking else "stands"
        measured = report.motion.kind
        word = word or (claimed if measured == "unknown" else measured)
        return PartHealth(name="mount", ok=True, text=word)

    def _read_clock(self) -> PartHealth:
        if self._clock.is_simulated:
            return PartHealth(name="clock", ok=True, text="simulated")
        reading = read_clock()
        if not reading.is_synchronised:
            return PartHealth(name="clock", ok=False, text="not synchronised")
        offset_ms = None if reading.offset_s is None else abs(reading.offset_s) * 1e3
        words = "synchronised" if offset_ms is None else f"NTP ±{offset_ms:.1f} ms"
        return PartHealth(name="clock", ok=True, text=words)

    def _read_disk(self) -> PartHealth:
        try:
            free = free_bytes(self._folder)
        except OSError as error:
            return PartHealth(name="disk", ok=False, text=error.strerror or str(error))
        hours = free / max(session_bytes(self._config(), 3600.0), 1.0)
        text = f"{free / 1e9:.0f} GB, {min(hours, 999.0):.0f} h"
        return PartHealth(name="disk", ok=hours >= LOW_HOURS, text=text)


def driver_health(lacks: Sequence[MissingAbility]) -> tuple[PartHealth, ...]:
    """Return the health of the mount's driver; empty where it lacks no important function."""
    missing = [lack.what for lack in lacks if lack.name in ("abort", "tracking", "park")]
    return (PartHealth(name="driver", ok=False, text=", ".join(missing)),) if missing else ()


def machine_health(state: MachineState | None) -> tuple[PartHealth, ...]:
    """Return the health of power supply and processor; empty where the machine reports neither."""
    if state is None:
        return ()
    found = []
    names = {trouble.name for trouble in state.troubles}
    if "power" in names:
        found.append(PartHealth(name="power", ok=False, text="UNDER-VOLTAGE"))
    words: list[str] = []
    if state.reading.cpu_temperature_c is not None:
        words.append(f"{state.reading.cpu_temperature_c:.0f} °C")
    words += [word for word in ("hot", "throttled") if word in names]
    if words:
        is_well = not names & {"hot", "throttled"}
        found.append(PartHealth(name="CPU", ok=is_well, text=", ".join(words)))
    return tuple(found)
