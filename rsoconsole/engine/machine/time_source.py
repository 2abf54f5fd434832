"""The source of this machine's time: a GPS receiver, a time server, or none."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rsoconsole.engine.machine.machine import ROOT, parse_name_values, run_program, text_of

TimeSourceKind = Literal["GPS", "NTP", "none", "unknown"]
_CLOCKS = re.compile(r"GPS|PPS|NMEA|GNSS|SHM|UBX", re.IGNORECASE)
"""Names that chrony and gpsd give to reference clocks."""
_LEAP_UNSET = "Not synchronised"
Ask = Callable[[Sequence[str]], str | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeSource:
    """The service that sets this machine's clock."""

    kind: TimeSourceKind
    """Kind of source; none: a time service is off or reaches no source; unknown: not reported."""
    detail: str
    rtc: str | None
    """Name of the real-time clock, which runs without power; None where there is none."""


def read_time_source(ask: Ask = run_program, root: Path = ROOT) -> TimeSource:
    """Read the time source from chrony, else from systemd; runs programs, never raises."""
    clock = text_of(root / "sys/class/rtc/rtc0/name")
    chrony = ask(("chronyc", "-c", "tracking"))
    found = None if chrony is None else _by_chrony(chrony)
    if found is None:
        found = _by_systemd(ask(("timedatectl", "show")), ask(("timedatectl", "show-timesync")))
    return TimeSource(kind=found[0], detail=found[1], rtc=clock)


def _by_chrony(line: str) -> tuple[TimeSourceKind, str] | None:
    """Return the source by the line of ``chronyc -c tracking``; None for any other line."""
    fields = line.strip().split(",")
    if len(fields) < 14:
        return None
    name, stratum, leap = fields[1] or fields[0], fields[2], fields[13]
    if leap == _LEAP_UNSET:
        return "none", "chrony reaches no source"
    if stratum == "1" and _CLOCKS.search(name):
        return "GPS", f"chrony by {name}"
    return "NTP", f"chrony by {name}, stratum {stratum}"


def _by_systemd(clock: str | None, service: str | None) -> tuple[TimeSourceKind, str]:
    """Return the source by what ``timedatectl`` reports of the clock and its time service."""
    pairs = parse_name_values(clock, "=")
    server = parse_name_values(service, "=").get("ServerName", "")
    is_set = pairs.get("NTPSynchronized") == "yes"
    if is_set:
        return (
            "NTP",
            f"systemd-timesyncd by {server}" if server else "a time service of this system",
        )
    if pairs.get("NTP") == "yes":
        return "none", f"systemd-timesyncd has not reached {server or 'a time server'} yet"
    if pairs.get("NTP") == "no":
        return "none", "no time service runs"
    return "unknown", "this system does not tell"
