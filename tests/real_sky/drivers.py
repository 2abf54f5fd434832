"""Each mount driver of this machine, in its own simulation, through the product's own INDI mount.

Run as ``python -m tests.real_sky.drivers [DRIVER ...]``; it prints the guide's table of drivers, as
Markdown, and says on stderr what it cannot run and why. It installs nothing. What the product says
of a mount is held against the coordinates that a second connection reads.
"""

import argparse
import concurrent.futures
import contextlib
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from rsoconsole.base import InstrumentError
from rsoconsole.config import IndiConfig, MountConfig, WaitsConfig
from rsoconsole.instruments import MountReport, StopResult
from rsoconsole.instruments.indi.indi_wire import IndiWire
from rsoconsole.instruments.mount.mount import IndiMount
from rsoconsole.records import Site
from rsoconsole.sky import altaz_to_icrs, separation_deg

SITE = Site(latitude_deg=29.19, longitude_deg=-81.05, elevation_m=10.0)
WAITS = WaitsConfig(device_s=15.0)
FIRST, SECOND, FAR = (40.0, 110.0), (45.0, 250.0), (40.0, 100.0)
"""Altitude and azimuth of the slews, on both sides of the meridian; the last is stopped on its way.
"""
ARRIVES_S, STOPS_S, PARKS_S, MEASURES_S = 90.0, 20.0, 60.0, 4.0
ARRIVED_DEG = 0.2
DEFINED_S = 3.0
"""A driver defines its properties bit by bit."""
CELL_CHARACTERS = 90
RESTS_ARCSEC_S = 20.0
"""Rate above which a mount that is said to rest does not: it tells 15 standing, 0 tracking."""
CONCURRENT = 4
FASTEST = (
    *("indi_simulator_telescope", "indi_celestron_gps"),
    *("indi_eqmod_telescope", "indi_skyadventurergti_telescope"),
)
"""Those that are tried with every change."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Driver:
    """A driver and the device that it makes."""

    program: str
    device: str
    package: str = "indi-bin"


DRIVERS = (
    Driver(program="indi_simulator_telescope", device="Telescope Simulator"),
    Driver(program="indi_eqmod_telescope", device="EQMod Mount", package="indi-eqmod"),
    Driver(program="indi_ioptronv3_telescope", device="iOptronV3"),
    Driver(program="indi_ieqlegacy_telescope", device="iEQ"),
    Driver(program="indi_lx200_10micron", device="10micron"),
    Driver(program="indi_lx200ap_v2", device="AstroPhysics V2"),
    Driver(program="indi_lx200_OnStep", device="LX200 OnStep"),
    Driver(program="indi_lx200gemini", device="Losmandy Gemini"),
    Driver(program="indi_lx200generic", device="Standard LX200"),
    Driver(program="indi_astrotrac_telescope", device="AstroTrac"),
    Driver(program="indi_pmc8_telescope", device="PMC8"),
    Driver(program="indi_celestron_gps", device="Celestron GPS"),
    Driver(program="indi_temma_telescope", device="Temma Takahashi"),
    Driver(
        program="indi_skyadventurergti_telescope",
        device="SkyAdventurer GTi",
        package="indi-eqmod",
    ),
)


@dataclass(slots=True, kw_only=True)
class Row:
    """What was seen of one driver; a cell that begins with WRONG is the product's own fault."""

    driver: Driver
    cells: dict[str, str] = field(default_factory=dict)
    fault: str = ""


COLUMNS = ("run", "connects", "goes", "STOP", "tracks", "parks", "pier side", "lacks")


def main() -> None:
    """Run the drivers, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("drivers", nargs="*", help="names of programs; none: all that are known")
    named = parser.parse_args().drivers
    known = {each.program: each for each in DRIVERS}
    if unknown := [name for name in named if name not in known]:
        sys.exit(f"not known: {', '.join(unknown)}; known are {', '.join(known)}")
    wanted = [known[name] for name in named] if named else list(DRIVERS)
    if shutil.which("indiserver") is None:
        sys.exit("indiserver is missing: apt install indi-bin")
    for each in wanted:
        if shutil.which(each.program) is None:
            print(f"{each.program} is missing: apt install {each.package}", file=sys.stderr)
    there = [each for each in wanted if shutil.which(each.program)]
    with concurrent.futures.ThreadPoolExecutor(CONCURRENT) as pool:
        rows = list(pool.map(try_driver, there))
    print(table(rows))
    if any(cell.startswith("WRONG") for row in rows for cell in row.cells.values()):
        sys.exit(1)


def table(rows: list[Row]) -> str:
    """The rows as Markdown."""
    head = ["driver", *COLUMNS]
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    for row in rows:
        cells = [row.cells.get(name, "") for name in COLUMNS]
        if row.fault:
            cells[1] = row.fault
        lines.append(f"| `{row.driver.program}` | {' | '.join(cells)} |")
    return "\n".join(lines)


def try_driver(driver: Driver) -> Row:
    """Everything that is done with one driver."""
    row = Row(driver=driver)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            with served(driver, folder) as port:
                row.cells["run"] = simulate(driver, port)
                config = IndiConfig(port=port, mount=driver.device)
                mount = IndiMount(config, folder / "mount.log", MountConfig(), WAITS, site=SITE)
                try:
                    act(row, mount, Truth(port, driver.device))
                finally:
                    mount.close()
        except InstrumentError as error:
            row.fault = str(error)
    print(f"{driver.program}: {row.fault or row.cells}", file=sys.stderr, flush=True)
    return row


@contextlib.contextmanager
def served(driver: Driver, folder: Path) -> Iterator[int]:
    """An indiserver of its own with the driver."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = int(free.getsockname()[1])
    home = {**os.environ, "HOME": str(folder)}
    with (folder / "indiserver.log").open("wb") as log:
        command = ["indiserver", "-p", str(port), "-u", str(folder / "s"), driver.program]
        server = subprocess.Popen(command, stdout=log, stderr=log, env=home)
    try:
        time.sleep(1.5)
        yield port
    finally:
        server.terminate()
        server.wait()


def simulate(driver: Driver, port: int) -> str:
    """Switch the driver's simulation on, and give it the site, as an operator's client does.

    Returns how it runs.
    """
    wire = IndiWire("127.0.0.1", port)
    wire.ask(driver.device)
    can_simulate = wire.wait(lambda each: each.name == "SIMULATION", 3.0) is not None
    if can_simulate:
        wire.new("Switch", driver.device, "SIMULATION", {"ENABLE": "On"})
        wire.wait(lambda each: each.name == "SIMULATION" and not each.is_definition, 3.0)
    wire.new("Switch", driver.device, "CONNECTION", {"CONNECT": "On"})
    if wire.wait(lambda each: each.name == "GEOGRAPHIC_COORD", 8.0) is not None:
        place = {"LAT": "29.19", "LONG": "278.95", "ELEV": "10"}
        wire.new("Number", driver.device, "GEOGRAPHIC_COORD", place)
        time.sleep(1.0)
    wire.close()
    return "simulates" if can_simulate else "a simulator"


class Truth:
    """Rates of the coordinates by a connection of the test's own."""

    def __init__(self, port: int, device: str) -> None:
        self._port, self._device = port, device

    def rate_arcsec_s(self) -> float | None:
        """The faster axis over ``MEASURES_S``; None where the driver does not answer."""
        first = self._place()
        time.sleep(MEASURES_S)
        last = self._place()
        if first is None or last is None:
            return None
        (t0, ra0, dec0), (t1, ra1, dec1) = first, last
        ra = ((ra1 - ra0 + 12.0) % 24.0 - 12.0) * 54_000.0
        return max(abs(ra), abs(dec1 - dec0) * 3600.0) / (t1 - t0)

    def _place(self) -> tuple[float, float, float] | None:
        wire = IndiWire("127.0.0.1", self._port)
        try:
            wire.ask(self._device, "EQUATORIAL_EOD_COORD")
            found = wire.wait(lambda each: each.name == "EQUATORIAL_EOD_COORD", 3.0)
            if found is None:
                return None
            return time.monotonic(), float(found.values["RA"]), float(found.values["DEC"])
        finally:
            wire.close()


def act(row: Row, mount: IndiMount, truth: Truth) -> None:
    """Connect, slew, stop, park; fill the row's cells."""
    mount.start()
    row.cells["connects"] = "yes"
    time.sleep(DEFINED_S)
    able = mount.abilities()
    lacks = {
        "ABORT": able.can_abort,
        "parking": able.can_park,
        "tracking on and off": able.can_set_tracking,
        "side of the pier": able.has_pier_side,
        "site": able.has_site,
        "clock": able.has_time,
    }
    row.cells["lacks"] = ", ".join(name for name, has in lacks.items() if not has) or "nothing"
    with contextlib.suppress(InstrumentError):
        if mount.report().is_parked:
            mount.unpark()
            time.sleep(2.0)
    row.cells["goes"] = cell(lambda: goes(mount, truth))
    row.cells["pier side"] = cell(lambda: pier(mount)) if row.cells["goes"] == "yes" else "-"
    row.cells["STOP"] = cell(lambda: stops(mount, truth))
    row.cells["tracks"] = cell(lambda: tracks(mount, truth))
    row.cells["parks"] = cell(lambda: parks(mount, truth)) if able.can_park else "-"


def cell(look: Callable[[], str]) -> str:
    """What was seen, or the product's own words on why not."""
    try:
        return look()
    except InstrumentError as error:
        words = "".join(c if c.isascii() and c.isprintable() else "?" for c in str(error))
        return words if len(words) <= CELL_CHARACTERS else f"{words[:CELL_CHARACTERS]} ..."


def send(mount: IndiMount, altaz_deg: tuple[float, float]) -> tuple[float, float]:
    """Order a slew; its direction."""
    now_ns = time.time_ns()
    to = altaz_to_icrs(SITE, *altaz_deg, now_ns)
    mount.slew(*to, now_ns)
    return to


def wait_for(
    mount: IndiMount, is_so: Callable[[MountReport], bool], within_s: float
) -> float | None:
    """Seconds until a report is so; None: it never was."""
    begun_s = time.monotonic()
    while time.monotonic() - begun_s < within_s:
        if is_so(mount.report()):
            return time.monotonic() - begun_s
        time.sleep(0.3)
    return None


def goes(mount: IndiMount, truth: Truth) -> str:
    """Two slews, and how it moves after them."""
    for place in (FIRST, SECOND):
        to = send(mount, place)

        def has_arrived(report: MountReport, to: tuple[float, float] = to) -> bool:
            here = (report.ra_icrs_deg, report.dec_icrs_deg)
            return not report.is_slewing and separation_deg(*here, *to) < ARRIVED_DEG

        if wait_for(mount, has_arrived, ARRIVES_S) is None:
            report = mount.report()
            off_deg = separation_deg(report.ra_icrs_deg, report.dec_icrs_deg, *to)
            return f"not within {ARRIVES_S:.0f} s: {off_deg:.1f}° off"
    rate = truth.rate_arcsec_s()
    said = mount.report().motion.kind
    is_untrue = said == "tracks" and rate is not None and rate > RESTS_ARCSEC_S
    return f"WRONG: said {said}, {rate:.0f}″/s" if is_untrue else "yes"


def pier(mount: IndiMount) -> str:
    """How its side of the pier is read."""
    side = mount.report().pier_side
    is_reversed = any("the other way round" in text for text in mount.take_messages())
    if side is None:
        return "-"
    # It was sent to the west: a German mount is then east of its pier.
    if side != "east":
        return f"WRONG: {side} while it looks west"
    return "reversed, found" if is_reversed else "as INDI"


def stops(mount: IndiMount, truth: Truth) -> str:
    """STOP on the way, what is said of it, and whether it is so."""
    send(mount, FAR)
    time.sleep(2.0)
    news: list[StopResult] = []
    result = mount.abort(on_news=news.append)
    ends_s = time.monotonic() + STOPS_S
    while time.monotonic() < ends_s and not any(each.is_at_rest for each in news):
        time.sleep(0.2)
    rate = truth.rate_arcsec_s()
    last = next((each for each in reversed(news) if each.motion is not None), result)
    said = "unknown" if last.motion is None else last.motion.kind
    took = "" if last.measured_ms is None else f" in {last.measured_ms / 1e3:.1f} s"
    if last.is_at_rest and rate is not None and rate > RESTS_ARCSEC_S:
        return f"WRONG: said {said}, {rate:.0f}″/s"
    answer = "" if last.is_answered or result.is_answered else ", ABORT not answered"
    return f"{said}{took}{answer}" if last.is_at_rest else f"said not to rest ({said}){answer}"


def tracks(mount: IndiMount, truth: Truth) -> str:
    """Tracking on, and off."""
    kinds = []
    for is_on in (True, False):
        mount.set_tracking(is_on)
        wait_for(mount, lambda report: report.motion.is_at_rest, 15.0)
        rate, kind = truth.rate_arcsec_s(), mount.report().motion.kind
        true = "tracks" if rate is not None and rate < 5.0 else "stands"
        if kind in ("tracks", "stands") and rate is not None and kind != true:
            return f"WRONG: said {kind}, {rate:.0f}″/s"
        kinds.append(kind)
    mount.set_tracking(True)
    return "on and off" if kinds == ["tracks", "stands"] else f"{kinds[0]}, then {kinds[1]}"


def parks(mount: IndiMount, truth: Truth) -> str:
    """Park, and whether it rests when it is said to be parked."""
    mount.park()
    took_s = wait_for(mount, lambda report: report.is_parked, PARKS_S)
    if took_s is None:
        return f"not within {PARKS_S:.0f} s"
    rate = truth.rate_arcsec_s()
    if rate is not None and rate > RESTS_ARCSEC_S:
        return f"WRONG: said parked, {rate:.0f}″/s"
    mount.unpark()
    return "and unparks" if wait_for(mount, lambda r: not r.is_parked, 15.0) else "does not unpark"


if __name__ == "__main__":
    main()
