"""The checklist before the engine may move a telescope: facts are gathered, then checked.

Each check has a name of one word, by which an operator may override it; each override is logged.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeVar

from rsoconsole.base import RsoconsoleError
from rsoconsole.config import Config
from rsoconsole.engine.aim.night import darkness_words, dome_fault, sun_fault, weather_fault
from rsoconsole.engine.doctor import doctor, doctor_system
from rsoconsole.engine.doctor.checks import CheckResult, doubtful_check, failed_check, passed_check
from rsoconsole.engine.doctor.doctor_system import ClockReading
from rsoconsole.engine.doctor.mount_lacks import LackName, MissingAbility, missing_abilities
from rsoconsole.engine.machine.medium import DISK_REMEDY, bytes_until_dawn, disk_words
from rsoconsole.instruments import Instruments, MountAbilities, MountReport, SiteCheck, SkyReport
from rsoconsole.records import NotSolved, Solution
from rsoconsole.sky import day_of, separation_deg
from rsoconsole.tracking import CLIP_ARCSEC
from rsoconsole.words import ALIGN, NO_ANSWER, shutter_words

Answer = TypeVar("Answer")

CHECKS = (
    *("clock", "site", "time", "sun", "unparked", "abort", "tracking"),
    *("weather", "dome", "disk", "network", "index", "pointing"),
)
"""Names of all checks, in display order; "pointing" is checked later, on a frame."""
CLOCK_OFFSET_S = 0.1
"""Greatest offset of the machine's clock, s; in 0.1 s the sky moves by 1.5 arcsec."""
MOUNT_TIME_S = 30.0
"""Greatest offset of the mount's clock, s: many report whole seconds, and late."""
POINTING_DEG = CLIP_ARCSEC / 3600.0
"""Greatest pointing offset that the loop corrects, deg; beyond it no slew reaches its target."""
MOUNT_ANSWER_S = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmingCheck:
    """One check of the list, and its result."""

    name: str
    """Name by which an operator overrides the check; one of ``CHECKS``."""
    ok: bool
    detail: str
    """What was found, with the figure."""
    remedy: str = ""
    """What to do; empty when all is well."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmingFacts:
    """Facts that the checks need, at one instant; None: not known."""

    now_utc_ns: int
    is_simulated: bool
    clock: ClockReading
    site: SiteCheck | None
    report: MountReport | None
    mount_fault: str
    """Reason why the mount did not answer; empty when it answered."""
    mount_utc_offset_s: float | None
    """The mount's clock minus the engine's, s; None when the mount does not report its time."""
    abilities: MountAbilities | None
    """Functions that the mount's driver offers; None: not known."""
    sky: SkyReport | None
    free_bytes: int | None
    disk_fault: str
    """Reason why nothing can be written to the session's folder; empty when it can."""
    network: CheckResult
    index: CheckResult


def gather_facts(instruments: Instruments, config: Config, session_folder: Path) -> ArmingFacts:
    """Query clock, mount, safety monitor and disk; never raises.

    Quick while the mount answers; a silent mount is waited for a few seconds.
    """
    mount = instruments.mount
    report, mount_fault = _ask(lambda: mount.report(timeout_s=MOUNT_ANSWER_S))
    site: SiteCheck | None = None
    utc_offset_s: float | None = None
    abilities: MountAbilities | None = None
    if not mount_fault:  # a dead mount is waited for once, not three times
        site, mount_fault = _ask(lambda: mount.check_site(config.site.to_site()))
        utc_offset_s, _ = _ask(mount.utc_offset_s)
        abilities, fault = _ask(mount.abilities)
        mount_fault = mount_fault or fault
    monitor = instruments.safety_monitor
    sky = None if monitor is None else _ask(monitor.look)[0]
    free_bytes, disk_fault = _ask(lambda: doctor_system.free_bytes(session_folder))
    write_fault, _ = _ask(lambda: doctor_system.write_fault(session_folder))
    clock, _ = _ask(doctor_system.read_clock)
    return ArmingFacts(
        now_utc_ns=instruments.clock.now_utc_ns(),
        is_simulated=instruments.clock.is_simulated,
        clock=clock or ClockReading(is_synchronised=None),
        site=site,
        report=report,
        mount_fault=mount_fault,
        mount_utc_offset_s=utc_offset_s,
        abilities=abilities,
        sky=sky,
        free_bytes=free_bytes,
        disk_fault=disk_fault or write_fault or "",
        network=_checked(doctor.check_network, config),
        index=_checked(doctor.check_index_files, config),
    )


def arming_checks(facts: ArmingFacts, config: Config) -> tuple[ArmingCheck, ...]:
    """Return the result of every check but "pointing", which needs a frame."""
    found = {
        "clock": _clock(facts, config),
        "site": _site(facts),
        "time": _time(facts),
        "sun": _sun(facts, config),
        "unparked": _unparked(facts, config),
        "abort": _ability("abort", "STOP can end a slew", facts, config),
        "tracking": _ability("tracking", "it can be ended at a limit", facts, config),
        "weather": _weather(facts, config),
        "dome": _dome(facts, config),
        "disk": _disk(facts, config),
        "network": facts.network,
        "index": facts.index,
    }
    return tuple(_of_doctor(name, each) for name, each in found.items())


def pointing_check(
    solution: Solution | NotSolved | None, report: MountReport | None, config: Config
) -> ArmingCheck:
    """Check that a solved frame shows the stars at which the mount reports to point.

    ``report``: the mount's at the time of the exposure; None: the mount did not report.
    """
    return _of_doctor("pointing", _pointing(solution, report, config))


def _pointing(
    solution: Solution | NotSolved | None, report: MountReport | None, config: Config
) -> CheckResult:
    if solution is None:
        return failed_check(
            "no frame has been taken yet", "look at the camera: its driver, its cable, its power"
        )
    if isinstance(solution, NotSolved):
        return failed_check(
            f"frame {solution.frame_id} is not solved: {solution.reason}",
            "lens cap, focus, cloud? Check optics.focal_length_mm and pixel_um, and "
            f"that the mount is aligned to within solver.radius_deg = {config.solver.radius_deg:g}",
        )
    if report is None:
        return failed_check(
            "the mount does not say where it looks",
            "look at the mount's driver, its cable, its power",
        )
    apart_deg = separation_deg(
        solution.ra_icrs_deg, solution.dec_icrs_deg, report.ra_icrs_deg, report.dec_icrs_deg
    )
    detail = (
        f"pointing offset {60 * apart_deg:.1f} arcmin: the stars lie beside where the mount says"
    )
    if apart_deg <= POINTING_DEG:
        return passed_check(detail)
    return failed_check(
        f"{detail}, {60 * POINTING_DEG:.0f} at most", f"{ALIGN} (its sync, its hand controller)"
    )


def unknown_words(names: Collection[str]) -> str:
    """Return a message on names that are no check's; empty where all are known."""
    unknown = ", ".join(sorted(set(names) - set(CHECKS)))
    return f"no check is called {unknown}; there are {', '.join(CHECKS)}" if unknown else ""


def refusal_text(checks: Sequence[ArmingCheck], overridden: Collection[str]) -> str | None:
    """Return why the engine cannot be armed; None when every failed check is overridden."""
    failed = [check for check in checks if not check.ok and check.name not in overridden]
    if not failed:
        return None
    listed = "; ".join(
        f"{check.name}: {check.detail}" + (f" -> {check.remedy}" if check.remedy else "")
        for check in failed
    )
    options = " ".join(f"--override {check.name}" for check in failed)
    return f"not armed. {listed}. If you answer for it: {options}"


def _clock(facts: ArmingFacts, config: Config) -> CheckResult:
    """Check the machine's clock; the answer includes the shutter's timing, if it was measured."""
    found = doctor.check_clock(facts.clock, CLOCK_OFFSET_S)
    if facts.is_simulated:
        found = passed_check("the simulated observatory's own")
    if not config.exposure.calibrated:
        return found
    shutter = shutter_words(config.exposure, day_of(facts.now_utc_ns))
    return replace(found, detail=f"{found.detail}; {shutter}")


def _site(facts: ArmingFacts) -> CheckResult:
    if facts.site is None:
        return _mount_is_silent(facts)
    if facts.site.is_consistent:
        return passed_check(facts.site.detail)
    remedy = "correct site.latitude_deg and site.longitude_deg, or set the mount's site"
    return failed_check(facts.site.detail, remedy)


def _time(facts: ArmingFacts) -> CheckResult:
    if facts.report is None:
        return _mount_is_silent(facts)
    offset_s = facts.mount_utc_offset_s
    if offset_s is None:
        return passed_check("the mount does not tell its time")
    detail = f"the mount's clock is {offset_s:+.1f} s from this machine's"
    if abs(offset_s) <= MOUNT_TIME_S:
        return passed_check(detail)
    return failed_check(
        f"{detail}, {MOUNT_TIME_S:.0f} s at most",
        "set the mount's UTC time, or the hand controller's zone and summer time",
    )


def _sun(facts: ArmingFacts, config: Config) -> CheckResult:
    fault = sun_fault(config, facts.now_utc_ns)
    when = darkness_words(config, facts.now_utc_ns)
    return failed_check(fault, when) if fault else passed_check(when)


def _unparked(facts: ArmingFacts, config: Config) -> CheckResult:
    if facts.report is None:
        return _mount_is_silent(facts)
    if facts.report.is_parked:
        return failed_check("the mount is parked", "'rsoconsole unpark'")
    is_parking = facts.report.is_parking
    detail = "the mount parks: arming ends that" if is_parking else "the mount is not parked"
    found = [_lack(name, facts, config) for name in ("park", "pier side")]
    lacks = [f"{lack.what}, {lack.follows}" for lack in found if lack is not None]
    return passed_check("; ".join([detail, *lacks]))


def _ability(
    name: Literal["abort", "tracking"], detail: str, facts: ArmingFacts, config: Config
) -> CheckResult:
    if facts.report is None or facts.abilities is None:
        return _mount_is_silent(facts)
    lack = _lack(name, facts, config)
    if lack is None:
        return passed_check(detail)
    remedy = "use a driver that can; else stay beside the mount" if lack.needs_override else ""
    return CheckResult(ok=not lack.needs_override, detail=lack.follows, remedy=remedy)


def _lack(name: LackName, facts: ArmingFacts, config: Config) -> MissingAbility | None:
    lacks = () if facts.abilities is None else missing_abilities(facts.abilities, config.mount)
    return next((lack for lack in lacks if lack.name == name), None)


def _weather(facts: ArmingFacts, config: Config) -> CheckResult:
    if config.indi.weather is None:
        return passed_check("no station is configured")
    fault = weather_fault(config, facts.sky)
    if fault:
        remedy = "wait until it clears; for a silent station look at its driver and indi.weather"
        return failed_check(fault, remedy)
    word = facts.sky.weather if facts.sky else None
    return passed_check(f"{config.indi.weather} says {word}")


def _dome(facts: ArmingFacts, config: Config) -> CheckResult:
    if config.indi.dome is None:
        return passed_check("none is configured")
    fault = dome_fault(config, facts.sky)
    if fault:
        return failed_check(fault, "open its shutter")
    return passed_check(f"{config.indi.dome} is open")


def _disk(facts: ArmingFacts, config: Config) -> CheckResult:
    if facts.disk_fault or facts.free_bytes is None:
        return failed_check(
            f"the session cannot be written: {facts.disk_fault or 'its disk is unknown'}",
            "give yourself the right to write there, or set session.root",
        )
    need_bytes, dark_s = bytes_until_dawn(config, facts.now_utc_ns)
    detail = disk_words(facts.free_bytes, dark_s, need_bytes)
    if facts.free_bytes >= need_bytes:
        return passed_check(detail)
    return failed_check(detail, DISK_REMEDY)


def _of_doctor(name: str, found: CheckResult) -> ArmingCheck:
    """Return a doctor's check as one of arming; an unknown result does not pass."""
    is_well = found.ok is True
    return ArmingCheck(
        name=name, ok=is_well, detail=found.detail, remedy="" if is_well else found.remedy
    )


def _mount_is_silent(facts: ArmingFacts) -> CheckResult:
    return failed_check(
        f"{NO_ANSWER}: {facts.mount_fault or 'no reason given'}",
        "look at its driver, its cable, its power",
    )


def _ask(question: Callable[[], Answer]) -> tuple[Answer | None, str]:
    """Return (answer, ""), or (None, why there is none)."""
    try:
        return question(), ""
    except RsoconsoleError as error:
        return None, str(error)
    except Exception as error:  # a driver's or the system's own fault is a failed check
        return None, f"{type(error).__name__}: {error}"


def _checked(check: Callable[[Config], CheckResult], config: Config) -> CheckResult:
    found, fault = _ask(lambda: check(config))
    return found or doubtful_check(fault, "reinstall rsoconsole")
