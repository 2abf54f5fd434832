"""Checks whether this machine is ready for a night; each finds a fault that can end one.

No check raises or changes anything; a check that fails says what to do.
"""

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rsoconsole.base import InstrumentError, RsoconsoleError, indi_port_option, setup_check
from rsoconsole.config import Config, IndiConfig, SiteConfig
from rsoconsole.engine.doctor import checks, doctor_indi, doctor_system
from rsoconsole.engine.doctor.checks import CheckResult, doubtful_check, failed_check, passed_check
from rsoconsole.engine.doctor.doctor_indi import import_faults
from rsoconsole.engine.doctor.doctor_system import ClockReading
from rsoconsole.engine.doctor.mount_lacks import PROPERTIES, missing_abilities
from rsoconsole.engine.machine.machine import read_machine
from rsoconsole.engine.machine.medium import DISK_REMEDY, disk_outlook, disk_words
from rsoconsole.engine.machine.time_source import read_time_source
from rsoconsole.instruments import missing_protocol, utc_now_ns
from rsoconsole.records import Site
from rsoconsole.sky import separation_deg
from rsoconsole.words import NS_PER_DAY

if TYPE_CHECKING:
    from rsoconsole.instruments import IndexFile

KM_PER_DEG = 111.19
STALE_DAYS = 14.0
"""Age of elements at which a geostationary satellite's position may be off by 0.1 deg, days."""
DEFINED_S = 3.0
"""Time without a new property after which a driver counts as having defined all of them, s."""
SITE_KM = 1.0
"""Greatest distance of the mount's site, km: 0.01 deg of sky, which the engine demands too."""
_LIBRARIES = ("numpy", "cv2", "astropy", "erfa", "scipy", "filterpy", "sgp4", "astrometry")
_LIBRARIES_OF_PROCESSES = ("indipydriver", "indipyserver", "textual", "plotext")
_RUNTIMES = ("ai_edge_litert.interpreter", "tflite_runtime.interpreter")


def run_checks(config: Config) -> Iterator[CheckResult]:
    """Yield each check's result as soon as it is done."""
    by_name: tuple[tuple[str, Callable[[Config], CheckResult]], ...] = (
        ("system", lambda _: check_system()),
        ("python", check_libraries),
        ("network", check_network),
        ("camera", check_camera),
        ("calibration", checks.check_calibration),
        ("index files", check_index_files),
        ("catalogue", check_catalogue),
        ("site", check_site),
        ("INDI client", doctor_indi.check_client),
        ("INDI server", check_indi_server),
        ("mount site", check_mount_site),
        ("mount driver", check_mount_driver),
        ("clock", lambda _: check_clock()),
        ("shutter", checks.check_shutter),
        ("time source", lambda _: checks.check_time_source(read_time_source())),
        ("temperature", lambda _: checks.check_temperature(read_machine())),
        ("power", lambda _: checks.check_power(read_machine())),
        ("disk", check_disk),
        ("recording medium", checks.check_recording_medium),
        ("sessions folder", check_sessions_folder),
        ("terminal", lambda _: check_terminal()),
    )
    for name, check in by_name:
        try:
            found = check(config)
        except Exception as error:  # the doctor's own fault must not hide the other checks
            fault = f"the check itself failed: {type(error).__name__}: {error}"
            found = doubtful_check(fault, "reinstall rsoconsole")
        yield replace(found, check=name)


def check_system() -> CheckResult:
    """Check that the program's packages are available for this system, for a new installation."""
    machine = setup_check.probe_machine(Path(sys.prefix))
    python = ".".join(map(str, machine.python))
    detail = f"{64 if machine.is_64_bit else 32}-bit {machine.machine}, Python {python}"
    found = setup_check.installation_faults(machine)
    if not found:
        return passed_check(detail)
    # It runs, so only the next installation would fail.
    return doubtful_check(
        f"{detail}; rsoconsole could not be installed again: {'; '.join(found)}",
        setup_check.APT_LINE,
    )


def check_libraries(_config: Config) -> CheckResult:
    """Check that every library loads; they are loaded in another process, which may crash."""
    names = (*_LIBRARIES, *_LIBRARIES_OF_PROCESSES, *_RUNTIMES)
    broken = import_faults(names)
    if any(runtime not in broken for runtime in _RUNTIMES):
        broken = {name: fault for name, fault in broken.items() if name not in _RUNTIMES}
    version = ".".join(str(part) for part in sys.version_info[:3])
    if broken:
        what = "; ".join(f"{name}: {fault}" for name, fault in broken.items())
        return failed_check(
            f"Python {version}; {what}",
            f"'{setup_check.APT_LINE}', and install again with the README's first command",
        )
    return passed_check(f"Python {version}, every library loads")


def check_network(config: Config) -> CheckResult:
    """Check that the detector's network file exists, matches its model card, and runs here."""
    from rsoconsole.vision import ANOTHER_NETWORK, Network

    try:
        network = Network.load(config.detector.model, config.detector.threads)
    except (RsoconsoleError, FileNotFoundError) as error:
        return failed_check(str(error), f"reinstall rsoconsole, {ANOTHER_NETWORK}")
    return passed_check(network.version)


def check_camera(config: Config) -> CheckResult:
    """Check that confidences were calibrated for this scale, exposure and frame size."""
    from rsoconsole.vision import camera_cautions, is_usable_scale

    optics, exposure_s = config.optics, config.exposure.exposure_s
    outside = camera_cautions(optics.scale_arcsec_px, exposure_s, optics.width_px, optics.height_px)
    if not outside:
        return passed_check(
            f"{optics.scale_arcsec_px:.3g} arcsec/px, {optics.width_px} x {optics.height_px} px,"
            f" {exposure_s:g} s"
        )
    settings = {
        "scale": "optics.focal_length_mm and optics.pixel_um",
        "exposure": "exposure.exposure_s",
        "size": "optics.width_px and optics.height_px",
    }
    return CheckResult(
        ok=None if is_usable_scale(optics.scale_arcsec_px) else False,
        detail="; ".join(outside.values()),
        remedy=f"if that is not so, correct {', '.join(settings[about] for about in outside)}",
    )


def check_index_files(config: Config) -> CheckResult:
    """Check that the plate solver has index files for all scales that the field needs."""
    from rsoconsole.instruments import folders_to_search, list_index_files, needed_tycho_numbers

    try:
        scales = needed_tycho_numbers(config.optics.field_deg)
        files = list_index_files(folders_to_search(config.solver.index_dirs))
    except (RsoconsoleError, FileNotFoundError) as error:
        return failed_check(str(error), "'rsoconsole index install'")
    width_deg, height_deg = config.optics.field_deg
    field = f"a field of {width_deg:.2f} x {height_deg:.2f} deg"
    usable = [file for file in files if file.is_healthy and file.scale in scales]
    missing = sorted(set(scales) - {file.scale for file in usable})
    faulty = [f"{file.path}: {file.fault}" for file in files if not file.is_healthy]
    if missing:
        return failed_check(
            "; ".join([f"{field} lacks scale {', '.join(map(str, missing))}", *faulty]),
            "'rsoconsole index install' gets them",
        )
    has_whole_sky = {file.scale for file in usable if file.is_whole_sky} >= set(scales)
    reach = "the whole sky" if has_whole_sky else _reach(usable)
    return passed_check(
        "; ".join([f"{len(usable)} files for {field}, {reach}", *faulty]),
        "" if has_whole_sky else "'rsoconsole index install' gets the rest of the sky",
    )


def check_catalogue(config: Config) -> CheckResult:
    """Check that the files of elements can be read and are recent enough.

    Elements are too old where they no longer identify geostationary satellites.
    """
    from rsoconsole.pipeline import read_catalogue

    files = config.catalogue.tle_files
    fetch = (
        "fetch fresh ones ('rsoconsole catalogue add celestrak:geo' once, then 'rsoconsole"
        " catalogue update')"
    )
    if not files:
        return passed_check(
            "no element files: what is followed gets no name",
            f"{fetch}, or name files in catalogue.tle_files",
        )
    try:
        sets = read_catalogue(files)
    except RsoconsoleError as error:
        return failed_check(str(error), f"{fetch}, or mend the path")
    now_utc_ns = utc_now_ns()
    in_order = sorted(sets.entries, key=lambda each: each.epoch_utc_ns)
    newest = {each.norad_id: each.epoch_utc_ns for each in in_order}
    ages_days = sorted((now_utc_ns - epoch) / NS_PER_DAY for epoch in newest.values())
    middle_days = ages_days[len(ages_days) // 2]
    is_fresh = middle_days <= STALE_DAYS
    detail = f"{len(newest)} objects, half of their elements younger than {middle_days:.1f} d"
    remedies = [] if is_fresh else [f"{fetch}: kept satellites leave their elements by then"]
    if words := sets.not_used_words:
        detail += f"; {words}"
        remedies.append("mend these sets, or fetch them again")
    return CheckResult(
        ok=None if remedies else True,
        detail=detail,
        remedy="; ".join(remedies),
    )


def check_site(config: Config) -> CheckResult:
    """Check that the observing site has been set; the default site is far from most telescopes."""
    site, papers = config.site, SiteConfig()
    place = f"{_place(site.to_site())}, {site.elevation_m:.0f} m"
    is_papers = site.latitude_deg == papers.latitude_deg
    is_papers = is_papers and site.longitude_deg == papers.longitude_deg
    if config.indi.simulated or not is_papers:
        return passed_check(place)
    return doubtful_check(
        f"{place}: still the default, {papers.name}. Is it really yours?",
        "set site.latitude_deg, site.longitude_deg (east positive) and site.elevation_m",
    )


def check_indi_server(config: Config) -> CheckResult:
    """Check that the INDI server answers, and has the configured mount and camera."""
    indi, others = config.indi, config.instruments
    address = f"{indi.host}:{indi.port}"
    settings = {name: getattr(indi, name) for name in ("mount", "camera", "weather", "dome")}
    # Of another protocol: their package says whether they are there.
    settings |= {name: None for name in ("mount", "camera") if getattr(others, name) != "indi"}
    wanted = {device for device in settings.values() if device is not None}
    if missing_words := missing_protocol(config):
        return failed_check(missing_words)
    if not wanted:
        return passed_check(f"not used: mount by {others.mount}, camera by {others.camera}")
    try:
        found = doctor_indi.announced_devices(indi.host, indi.port, wanted, config.waits.quiet_s)
    except OSError as error:
        return failed_check(
            f"nothing answers at {address}: {error}",
            f"start indiserver{indi_port_option(indi.port)} with your mount's and camera's"
            " drivers, or set indi.host and indi.port; 'rsoconsole demo' brings its own",
        )
    if missing := wanted - found:
        names = [f"indi.{name}" for name, device in settings.items() if device in missing]
        return failed_check(
            f"{address} answers but has no {' and no '.join(sorted(missing))}"
            + (f" (it has: {', '.join(sorted(found))})" if found else " nor any other device yet"),
            f"start the driver, or set {' and '.join(names)} to its device's name",
        )
    there = ", ".join(device for device in settings.values() if device is not None)
    return passed_check(f"{address}: {there}")


def check_mount_site(config: Config) -> CheckResult:
    """Check that the mount's site is the configured site, on which its limits depend."""
    indi = config.indi
    if config.instruments.mount != "indi":
        return doubtful_check(f"a mount by {config.instruments.mount} is asked when it is armed")
    try:
        reported = doctor_indi.mount_site(indi.host, indi.port, indi.mount, config.waits.quiet_s)
    except InstrumentError as error:
        return doubtful_check(str(error))
    if reported is None:
        return doubtful_check(
            f"{indi.mount} does not tell it: is its driver connected to the mount?"
        )
    own = config.site.to_site()
    apart_km = KM_PER_DEG * separation_deg(
        own.longitude_deg, own.latitude_deg, reported.longitude_deg, reported.latitude_deg
    )
    detail = f"{indi.mount} says {_place(reported)}, {apart_km:.1f} km from the settings' site"
    if apart_km <= SITE_KM:
        return passed_check(detail)
    option = f"LAT={own.latitude_deg:g};LONG={own.longitude_deg % 360.0:g};ELEV={own.elevation_m:g}"
    remedy = (
        "correct site.latitude_deg and site.longitude_deg, or tell the mount: indi_setprop"
        f"{_indi_options(indi)} '{indi.mount}.GEOGRAPHIC_COORD.{option}'"
    )
    return failed_check(detail, remedy)


def check_mount_driver(config: Config) -> CheckResult:
    """Check that the mount's driver offers all functions that a night needs.

    Lists the missing ones with their effects.
    """
    indi = config.indi
    if config.instruments.mount != "indi":
        return doubtful_check(f"a mount by {config.instruments.mount} is asked when it is armed")
    quiet_s = min(config.waits.quiet_s, DEFINED_S)
    try:
        abilities = doctor_indi.mount_abilities(indi.host, indi.port, indi.mount, quiet_s)
    except InstrumentError as error:
        return doubtful_check(str(error))
    if abilities is None:
        return doubtful_check(
            f"{indi.mount} tells no position: is its driver connected to the mount?"
        )
    lacks = missing_abilities(abilities, config.mount)
    if not lacks:
        return passed_check(f"{indi.mount} offers all that is used")
    missing = ", ".join(PROPERTIES[lack.name] for lack in lacks)
    detail = "; ".join(f"{lack.what}: {lack.follows}" for lack in lacks)
    unsafe = [lack.name for lack in lacks if lack.needs_override]
    remedy = ""
    if unsafe:
        overrides = " ".join(f"--override {each}" for each in unsafe)
        remedy = f"another driver; else stay beside it and arm with {overrides}"
    detail = f"{indi.mount} has no {missing}. {detail}"
    return CheckResult(ok=False if unsafe else None, detail=detail, remedy=remedy)


def _indi_options(indi: IndiConfig) -> str:
    """Return the options of indi_setprop for the configured server; empty for the default one."""
    host = "" if indi.host in {"127.0.0.1", "localhost"} else f" -h {indi.host}"
    return host + indi_port_option(indi.port)


def check_clock(clock: ClockReading | None = None, most_offset_s: float = math.inf) -> CheckResult:
    """Check that the system's clock is synchronised, within ``most_offset_s`` seconds."""
    clock = clock or doctor_system.read_clock()
    if clock.is_synchronised is None:
        return doubtful_check(
            "this system does not tell whether its clock is synchronised",
            "compare it with a time server or a GPS receiver",
        )
    parts = ["synchronised" if clock.is_synchronised else "not synchronised"]
    if clock.offset_s is not None:
        parts.append(f"offset {clock.offset_s * 1e3:+.3f} ms")
    if clock.max_error_s is not None and clock.is_synchronised:
        parts.append(f"error at most {clock.max_error_s * 1e3:.0f} ms")
    remedy = ""
    if not clock.is_synchronised:
        remedy = "'sudo timedatectl set-ntp true', or chrony with a GPS receiver"
    elif abs(clock.offset_s or 0.0) > most_offset_s:
        remedy = "wait until it has settled"
    return CheckResult(ok=not remedy, detail=", ".join(parts), remedy=remedy)


def check_disk(config: Config) -> CheckResult:
    """Check that the disk has room for the coming night."""
    now_utc_ns = utc_now_ns()
    free_bytes = doctor_system.free_bytes(config.session.root)
    outlook = disk_outlook(config, free_bytes, now_utc_ns)
    room = disk_words(free_bytes, outlook.dark_s, outlook.bytes_a_night)
    detail = f"{room}: room for {outlook.nights:.1f} nights"
    if outlook.warning is None:
        return passed_check(detail)
    is_enough = outlook.nights >= 1.0
    soon = f"; soon: {DISK_REMEDY}" if is_enough else ""
    return CheckResult(ok=is_enough, detail=detail + soon, remedy=DISK_REMEDY)


def check_sessions_folder(config: Config) -> CheckResult:
    """Check that sessions can be written to their folder."""
    root = config.session.root
    fault = doctor_system.write_fault(root)
    if fault is None:
        return passed_check(str(root))
    return failed_check(
        f"{root}: {fault}", "give yourself the right to write there, or set session.root"
    )


def check_terminal() -> CheckResult:
    """Check that the terminal is large enough and knows UTF-8 and colours."""
    found = doctor_system.read_terminal()
    if found is None:
        return doubtful_check("there is none here: only the console needs one")
    faults = []
    if found.columns < 80 or found.rows < 24:
        faults.append("make it at least 80 x 24")
    if not found.is_utf8:
        faults.append("set LANG to a UTF-8 locale, e.g. C.UTF-8")
    if found.colours < 16:
        faults.append("set TERM to one with colours, e.g. xterm-256color")
    encoding = "UTF-8" if found.is_utf8 else "not UTF-8"
    return CheckResult(
        ok=not faults,
        detail=f"{found.columns} x {found.rows}, {found.colours} colours, {encoding}",
        remedy="; ".join(faults),
    )


def _reach(files: Sequence["IndexFile"]) -> str:
    """Return the range of declinations that the files of every scale have in common."""
    scales = {file.scale for file in files}
    south_deg = max(min(f.dec_deg[0] for f in files if f.scale == s) for s in scales)
    north_deg = min(max(f.dec_deg[1] for f in files if f.scale == s) for s in scales)
    return f"declination {south_deg:+.0f} to {north_deg:+.0f} deg"


def _place(site: Site) -> str:
    north = "N" if site.latitude_deg >= 0 else "S"
    east = "E" if site.longitude_deg >= 0 else "W"
    return f"{abs(site.latitude_deg):.3f} {north} {abs(site.longitude_deg):.3f} {east}"
