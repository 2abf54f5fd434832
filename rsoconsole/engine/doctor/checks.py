"""Checks of the machine, its disk and clock, the master frames and the shutter's timing."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import date

from rsoconsole.config import Config
from rsoconsole.control import Machine
from rsoconsole.engine.doctor import doctor_system
from rsoconsole.engine.machine.machine import HEAT_REMEDY, POWER_REMEDY, troubles_of
from rsoconsole.engine.machine.medium import RecordingMedium, disk_outlook, read_recording_medium
from rsoconsole.engine.machine.time_source import TimeSource
from rsoconsole.instruments import utc_now_ns
from rsoconsole.pipeline import Master, MasterTraits, is_same_exposure, nearest_dark, read_masters
from rsoconsole.sky import day_of
from rsoconsole.words import (
    OLD_DAYS,
    TAKE_DARK,
    calibration_age_days,
    camera_mode_words,
    shutter_words,
    timing_words,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckResult:
    """The result of one check of the doctor."""

    check: str = ""
    ok: bool | None
    """True when passed, False when failed; None when it cannot be determined."""
    detail: str
    remedy: str = ""
    """What to do; empty when all is well."""


def passed_check(detail: str, remedy: str = "") -> CheckResult:
    """Return a passed check; ``remedy``: what could still be better."""
    return CheckResult(ok=True, detail=detail, remedy=remedy)


def failed_check(detail: str, remedy: str = "") -> CheckResult:
    """Return a failed check."""
    return CheckResult(ok=False, detail=detail, remedy=remedy)


def doubtful_check(detail: str, remedy: str = "") -> CheckResult:
    """Return a check without a clear result, or with a fault that does not stop a night."""
    return CheckResult(ok=None, detail=detail, remedy=remedy)


HOW = "'rsoconsole calibrate-time NIGHT --rinex FILE --write', of nights on navigation satellites"


def check_shutter(config: Config, today: date | None = None) -> CheckResult:
    """Check that the shutter timing of every camera mode was measured recently enough."""
    today = today or day_of(utc_now_ns())
    known = config.exposure.calibrated
    if not known:
        return doubtful_check(shutter_words(config.exposure, today), HOW)
    detail = "; ".join(
        f"{camera_mode_words(each.camera_mode)}: {timing_words(each, today)}" for each in known
    )
    old = [each for each in known if calibration_age_days(each, today) > OLD_DAYS]
    later = [each for each in known if calibration_age_days(each, today) < 0]
    if later:
        remedy = "the machine's clock is wrong, or exposure.calibrated.measured_on"
    else:
        remedy = f"older than {OLD_DAYS} days: measure again, {HOW}" if old else ""
    return CheckResult(ok=None if old or later else True, detail=detail, remedy=remedy)


WORN_PERCENT = 80
_NOT_REPORTED = {
    True: "this kernel does not tell it",
    False: "not a Raspberry Pi: this machine does not tell it",
}


def check_temperature(reading: Machine) -> CheckResult:
    """Check that the processor is cool enough for its full speed."""
    if reading.cpu_temperature_c is None:
        return passed_check("this machine does not tell it")
    parts = [f"{reading.cpu_temperature_c:.0f} °C"]
    mhz, max_mhz = reading.cpu_frequency_mhz, reading.cpu_frequency_max_mhz
    if mhz is not None and max_mhz is not None:
        parts.append(f"{mhz:.0f} of {max_mhz:.0f} MHz at the moment")
    troubles = [each for each in troubles_of(reading) if each.name == "hot"]
    if troubles:
        return failed_check(", ".join([troubles[0].words, *parts[1:]]), HEAT_REMEDY)
    return passed_check(", ".join(parts))


def check_power(reading: Machine) -> CheckResult:
    """Check that the power supply is strong enough, and that the processor is not slowed down."""
    if reading.is_under_voltage is None and reading.is_throttled is None:
        return passed_check(_NOT_REPORTED[reading.is_pi])
    troubles = [each for each in troubles_of(reading) if each.name in {"power", "throttled"}]
    if troubles:
        return failed_check("; ".join(each.words for each in troubles), troubles[0].remedy)
    if reading.has_been_under_voltage:
        words = "well now, but it has been too weak before: under-voltage spoils cards and frames"
        return doubtful_check(words, POWER_REMEDY)
    if reading.has_been_throttled:
        words = "well now, but the processor has been slowed down before"
        return doubtful_check(words, HEAT_REMEDY)
    words = (
        "no under-voltage" if reading.is_throttled is None else "no under-voltage, not throttled"
    )
    return passed_check(words)


def check_recording_medium(config: Config, medium: RecordingMedium | None = None) -> CheckResult:
    """Check that the sessions' disk stands nightly writing; a memory card wears out."""
    root = config.session.root
    found = read_recording_medium(root) if medium is None else medium
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
        return CheckResult(ok=False if is_worn else None, detail=detail, remedy=remedy)
    if found.kind == "memory":
        remedy = "set session.root to a disk: what lies in memory is gone with the power"
        return failed_check(detail, remedy)
    return passed_check(detail)


def check_time_source(source: TimeSource) -> CheckResult:
    """Check that a service sets this machine's clock.

    A machine without a real-time clock loses its time at each power cut.
    """
    kept = f"real-time clock {source.rtc}" if source.rtc else "no real-time clock"
    said = source.detail if source.kind == "unknown" else f"{source.kind}: {source.detail}"
    detail = f"{said}; {kept}"
    if source.kind in {"GPS", "NTP"}:
        return passed_check(detail)
    remedy = "'sudo timedatectl set-ntp true', or chrony with a GPS receiver"
    if not source.rtc:
        remedy += "; until it is reached after each start the time is wrong"
    return doubtful_check(detail, remedy)


BIAS_GONE = 0.5
"""Level, in units of the bias's, below which a dark frame has had its bias subtracted."""


def check_calibration(config: Config) -> CheckResult:
    """Check that the configured master frames exist and fit the camera's size and the exposure."""
    if not config.calibration.master_files:
        return passed_check("no master frames: frames are used as they come")
    masters, faults = read_masters(config.calibration)
    camera = MasterTraits(
        width_px=config.optics.width_px,
        height_px=config.optics.height_px,
        exposure_s=config.exposure.exposure_s,
        temperature_c=None,
    )
    doubts = list(_doubts(masters, camera))
    loaded = [f"{each.setting.removesuffix('s')} {each.words}" for each in masters]
    return CheckResult(
        ok=False if faults else None if doubts else True,
        detail="; ".join([*loaded, *faults, *(words for words, _ in doubts)]),
        remedy="; ".join(
            [
                *(["correct the paths in calibration, or leave them out"] if faults else []),
                *dict.fromkeys(remedy for _, remedy in doubts),
            ]
        ),
    )


def _doubts(masters: Sequence[Master], camera: MasterTraits) -> Iterator[tuple[str, str]]:
    """Yield each reason why a master would not be used, or not be right, with its remedy."""
    for each in masters:
        if not each.traits.covers_pixels_of(camera):
            yield (
                f"{each.path.name} does not fit the camera's {camera.size_words}",
                "give masters of the camera's binning, or correct optics.width_px and"
                " optics.height_px",
            )
    fitting = [each for each in masters if each.traits.covers_pixels_of(camera)]
    bias = next((each for each in fitting if each.setting == "bias"), None)
    dark = nearest_dark(fitting, camera)
    if dark is None and bias is None and any(each.setting == "flat" for each in fitting):
        yield (
            "the flat is not used without a dark or bias of its size",
            "name one in calibration.darks or calibration.bias",
        )
    if dark is None:
        return
    if bias is None and not is_same_exposure(dark.traits.exposure_s, camera.exposure_s):
        yield (
            f"no dark is known to be of {camera.exposure_s:g} s: {dark.path.name} is used as it is",
            f"{TAKE_DARK}, or calibration.bias to scale it",
        )
    if bias is not None and dark.level_adu < BIAS_GONE * bias.level_adu:
        yield (
            f"{dark.path.name} ({dark.level_adu:.0f} ADU) lies below the bias"
            f" ({bias.level_adu:.0f} ADU)",
            "give a dark with the camera's offset still in it",
        )
