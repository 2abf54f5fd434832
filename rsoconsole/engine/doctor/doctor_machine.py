"""The doctor's look at the machine itself: its heat, power and time, and its disk's kind."""

from rsoconsole.config import Config
from rsoconsole.control import Machine
from rsoconsole.engine.doctor import doctor_system
from rsoconsole.engine.doctor.doctor_check import Check, bad, unsure, well
from rsoconsole.engine.machine import (
    HEAT_REMEDY,
    POWER_REMEDY,
    Medium,
    TimeSource,
    disk_outlook,
    medium_of,
    read_machine,
    read_time_source,
    troubles_of,
)
from rsoconsole.instruments.observatory import utc_now_ns

WORN_PERCENT = 80
_NOT_REPORTED = {
    True: "this kernel does not tell it",
    False: "not a Raspberry Pi: this machine does not tell it",
}


def check_temperature(reading: Machine | None = None) -> Check:
    """The processor is cool enough to run at its full speed."""
    found = read_machine() if reading is None else reading
    if found.cpu_temperature_c is None:
        return well("this machine does not tell it")
    parts = [f"{found.cpu_temperature_c:.0f} °C"]
    if found.cpu_frequency_mhz is not None and found.cpu_frequency_max_mhz is not None:
        parts.append(
            f"{found.cpu_frequency_mhz:.0f} of {found.cpu_frequency_max_mhz:.0f} MHz at the moment"
        )
    troubles = [each for each in troubles_of(found) if each.name == "hot"]
    if troubles:
        return bad(", ".join([troubles[0].words, *parts[1:]]), HEAT_REMEDY)
    return well(", ".join(parts))


def check_power(reading: Machine | None = None) -> Check:
    """The supply is strong enough, and nothing slows the processor down."""
    found = read_machine() if reading is None else reading
    if found.is_under_voltage is None and found.is_throttled is None:
        return well(_NOT_REPORTED[found.is_pi])
    troubles = [each for each in troubles_of(found) if each.name in {"power", "throttled"}]
    if troubles:
        return bad("; ".join(each.words for each in troubles), troubles[0].remedy)
    if found.has_been_under_voltage:
        words = "well now, but it has been too weak before: under-voltage spoils cards and frames"
        return unsure(words, POWER_REMEDY)
    if found.has_been_throttled:
        words = "well now, but the processor has been slowed down before"
        return unsure(words, HEAT_REMEDY)
    words = "no under-voltage" if found.is_throttled is None else "no under-voltage, not throttled"
    return well(words)


def check_medium(config: Config, medium: Medium | None = None) -> Check:
    """The nights are written to something that bears it: a card wears out, and is slow."""
    root = config.session.root
    found = medium_of(root) if medium is None else medium
    now_utc_ns = utc_now_ns()
    need = disk_outlook(config, doctor_system.free_bytes(root), now_utc_ns).bytes_a_night
    device = f" {found.device}" if found.device else ""
    parts = [f"{found.kind}{device}", f"a night writes up to {need / 1e6:.0f} MB"]
    if found.life_used_percent is not None:
        parts.append(f"{found.life_used_percent} % of its life used")
    detail = ", ".join(parts)
    if found.kind in {"SD card", "eMMC"}:
        remedy = (
            "set session.root to a folder on a USB disk: nights wear a card out, and what it loses "
            "is the operating system too"
        )
        is_worn = (found.life_used_percent or 0) >= WORN_PERCENT
        return Check(ok=False if is_worn else None, detail=detail, remedy=remedy)
    if found.kind == "memory":
        remedy = "set session.root to a disk: what lies in memory is gone with the power"
        return bad(detail, remedy)
    return well(detail)


def check_time_source(source: TimeSource | None = None) -> Check:
    """Somebody sets this machine's clock; without a real-time clock each power cut unsets it."""
    found = read_time_source() if source is None else source
    kept = f"real-time clock {found.rtc}" if found.rtc else "no real-time clock"
    said = found.detail if found.kind == "unknown" else f"{found.kind}: {found.detail}"
    detail = f"{said}; {kept}"
    if found.kind in {"GPS", "NTP"}:
        return well(detail)
    remedy = "'sudo timedatectl set-ntp true', or chrony with a GPS receiver"
    if not found.rtc:
        remedy += "; until it is reached after each start the time is wrong"
    return unsure(detail, remedy)
