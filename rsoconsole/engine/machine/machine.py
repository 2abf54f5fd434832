"""The machine's heat, power and throttling, read from the kernel's own files.

A Raspberry Pi reports under-voltage by the driver ``rpi_volt`` of its hardware monitor (kernel
documentation, hwmon/raspberrypi-hwmon), and throttling by its firmware's value GET_THROTTLED, which
``vcgencmd`` reads; kernels before 6.12 have that value in a file of their own as well. What a
machine does not report is None, never a guess.
"""

import contextlib
import os
import shutil
import socket
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rsoconsole.control import Machine

ROOT = Path("/")
"""Folder that holds ``proc`` and ``sys``; tests use another."""
PI_HOT_C, HOT_C = 80.0, 95.0
"""Temperatures that count as hot, deg C, of a Raspberry Pi and of other machines."""
TIMEOUT_S = 3.0
UNDER_VOLTAGE, CAPPED, THROTTLED, SOFT_LIMIT = 1 << 0, 1 << 1, 1 << 2, 1 << 3
EARLIER = 16
"""Bits between a flag of the present and the flag that says whether it was ever set since boot."""
_THROTTLED_FILE = "sys/devices/platform/soc/soc:firmware/get_throttled"
_CPU_ZONES = ("cpu", "soc", "pkg")


@dataclass(frozen=True, slots=True, kw_only=True)
class Trouble:
    """One fault of the machine."""

    name: str
    """Kind of trouble: power, throttled or hot."""
    words: str
    remedy: str


POWER_REMEDY = (
    "use the supply made for this model and a short, thick cable; camera and disk on a powered hub"
)
HEAT_REMEDY = "a heat sink or a fan, air around the case, shade by day"


def read_machine(root: Path = ROOT) -> Machine:
    """Read the machine's state once; never raises."""
    alarm, word = _supply_alarm(root), _throttled_word(root)
    return Machine(
        model=board_model(root),
        cpu_temperature_c=_temperature_c(root),
        cpu_frequency_mhz=_megahertz(root, "scaling_cur_freq"),
        cpu_frequency_max_mhz=_megahertz(root, "cpuinfo_max_freq"),
        is_under_voltage=_either(alarm, _has(word, UNDER_VOLTAGE)),
        is_throttled=_has(word, CAPPED | THROTTLED | SOFT_LIMIT),
        has_been_under_voltage=_either(alarm, _has(word, UNDER_VOLTAGE << EARLIER)),
        has_been_throttled=_has(word, (CAPPED | THROTTLED | SOFT_LIMIT) << EARLIER),
    )


def troubles_of(reading: Machine) -> tuple[Trouble, ...]:
    """Return the faults that a reading shows, worst first; empty where it shows none."""
    found = []
    if reading.is_under_voltage:
        words = "under-voltage: the power supply gives too little"
        found.append(Trouble(name="power", words=words, remedy=POWER_REMEDY))
    degrees = reading.cpu_temperature_c
    at = "" if degrees is None else f" at {degrees:.0f} °C"
    if reading.is_throttled:
        remedy = POWER_REMEDY if reading.is_under_voltage else HEAT_REMEDY
        words = f"throttled: the processor is slowed down{at}"
        found.append(Trouble(name="throttled", words=words, remedy=remedy))
    hot_c = PI_HOT_C if reading.is_pi else HOT_C
    if degrees is not None and degrees >= hot_c:
        words = f"hot: {degrees:.0f} °C, it slows itself down from {hot_c:.0f} °C on"
        found.append(Trouble(name="hot", words=words, remedy=HEAT_REMEDY))
    return tuple(found)


def board_model(root: Path) -> str | None:
    """Return the board's name from its device tree; None without one, as on a PC."""
    text = text_of(root / "proc/device-tree/model")
    return None if text is None else text.replace("\0", "").strip() or None


def text_of(path: Path) -> str | None:
    """Return a small file's text without its last line break; None where it cannot be read."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return None


def _temperature_c(root: Path) -> float | None:
    """Temperature of the processor's thermal zone, else of the first zone, deg C."""
    found: list[tuple[bool, float]] = []
    for zone in sorted(root.glob("sys/class/thermal/thermal_zone*")):
        thousandths, kind = _whole(zone / "temp"), text_of(zone / "type") or ""
        if thousandths is not None and -50_000 <= thousandths <= 150_000:
            is_cpu = any(name in kind.lower() for name in _CPU_ZONES)
            found.append((is_cpu, thousandths / 1000.0))
    return max(found, key=lambda each: each[0])[1] if found else None


def _supply_alarm(root: Path) -> bool | None:
    for monitor in sorted(root.glob("sys/class/hwmon/hwmon*")):
        if text_of(monitor / "name") == "rpi_volt":
            alarm = _whole(monitor / "in0_lcrit_alarm")
            return None if alarm is None else alarm != 0
    return None


def _throttled_word(root: Path) -> int | None:
    """Return the firmware's throttling value, from its own program where there is one.

    The kernel's file logs a complaint when it is read.
    """
    answer = run_program(("vcgencmd", "get_throttled")) if root == Path("/") else None
    if answer is None:
        answer = text_of(root / _THROTTLED_FILE)
    try:
        return None if answer is None else int(answer.removeprefix("throttled="), 16)
    except ValueError:
        return None


def run_program(words: Sequence[str]) -> str | None:
    """Return a program's output; None where it is not installed, fails or takes too long."""
    program = shutil.which(words[0])
    if program is None:
        return None
    try:
        done = subprocess.run(
            (program, *words[1:]), capture_output=True, text=True, timeout=TIMEOUT_S, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout


def parse_name_values(text: str | None, mark: str) -> dict[str, str]:
    """Return names and values of the lines "name``mark``value"; of equal names, the first."""
    found: dict[str, str] = {}
    for line in (text or "").splitlines():
        name, _, value = line.partition(mark)
        if value.strip():
            found.setdefault(name.strip(), value.strip())
    return found


def _megahertz(root: Path, name: str) -> float | None:
    kilohertz = _whole(root / "sys/devices/system/cpu/cpu0/cpufreq" / name)
    return None if kilohertz is None else kilohertz / 1000.0


def _whole(path: Path) -> int | None:
    text = text_of(path)
    try:
        return None if text is None else int(text)
    except ValueError:
        return None


def _has(word: int | None, bits: int) -> bool | None:
    return None if word is None else bool(word & bits)


def _either(one: bool | None, other: bool | None) -> bool | None:
    return None if one is None and other is None else bool(one or other)


_VARIABLE = "NOTIFY_SOCKET"
_kept: list[str] = []
"""systemd's notify address, once it is hidden from the programs that the engine runs."""


def hide_notify_socket() -> None:
    """Remove systemd's notify address from the environment; keep it for ``notify_systemd``.

    Otherwise systemd's programs that the engine runs (``timedatectl``) would report their own
    failures as the engine's.
    """
    address = os.environ.pop(_VARIABLE, None)
    if address is not None:
        _kept[:] = [address]


def notify_systemd(state: str) -> bool:
    """Send a state to systemd: "READY=1", "WATCHDOG=1", "STATUS=..."; True when it was sent.

    Never raises and never waits. Without systemd nothing is sent.
    """
    address = os.environ.get(_VARIABLE) or "".join(_kept)
    if not address.startswith(("/", "@")):
        return False
    if address.startswith("@"):
        address = "\0" + address[1:]  # a name without a file
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as wire:
        wire.setblocking(False)
        wire.sendto(state.encode(), address)
        return True
    return False
