"""Checks of the INDI client library and, over plain TCP, of an INDI server.

They cover the server's devices, the mount's site and what its driver offers.
"""

import html
import json
import re
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import closing

from rsoconsole.config import Config
from rsoconsole.engine.doctor.checks import CheckResult, failed_check, passed_check
from rsoconsole.engine.doctor.mount_lacks import PROPERTIES
from rsoconsole.instruments import (
    ANY_CLIENT,
    IndiWire,
    MountAbilities,
    abilities_from_properties,
    allowed_libraries,
)
from rsoconsole.records import Site

_IMPORT_ALL = """
import importlib, json, sys
for name in sys.argv[1:]:
    print(json.dumps([name, "it ends the process"]), flush=True)
    try:
        importlib.import_module(name)
        fault = None
    except BaseException as error:
        fault = f"{type(error).__name__}: {error}"
    print(json.dumps([name, fault]), flush=True)
"""
_PATIENCE_S = 120


def import_faults(names: Sequence[str]) -> dict[str, str]:
    """Return the reason why each module does not load, by name; loadable ones are left out."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", _IMPORT_ALL, *names],
        capture_output=True,
        text=True,
        timeout=_PATIENCE_S,
        check=False,
    )
    faults: dict[str, str | None] = {}
    for line in done.stdout.splitlines():
        if line.startswith("["):
            name, fault = json.loads(line)
            faults[name] = fault
    return {name: why for name in names if (why := faults.get(name, "not tried"))}


_COORDINATES = "EQUATORIAL_EOD_COORD"
_ALL_OF_MOUNT = {_COORDINATES, *PROPERTIES.values()}
_DEVICE = re.compile(rb"""device=(?:"([^"]+)"|'([^']+)')""")


def check_client(config: Config) -> CheckResult:
    """Check that the configured INDI client library is installed and loads."""
    setting = config.indi.client
    if "indi" not in (config.instruments.mount, config.instruments.camera):
        return passed_check("not used: neither mount nor camera speaks INDI")
    meant = allowed_libraries(setting)
    faults = import_faults([each.module for each in meant])
    found = [
        f"{each.title} does not load: {faults[each.module]}"
        for each in meant
        if each.is_installed and each.module in faults
    ]
    usable = [each for each in meant if each.module not in faults]
    if usable:
        detail = "; ".join([f"{usable[0].title} (indi.client is {setting})", *found])
        return passed_check(detail)
    found += [f"{each.package} is not installed" for each in meant if not each.is_installed]
    remedy = f"'{meant[-1].install}'"
    return failed_check(
        "; ".join(found), remedy if setting == "auto" else f"{remedy}, {ANY_CLIENT}"
    )


def announced_devices(host: str, port: int, wanted: set[str], quiet_s: float) -> set[str]:
    """Return the devices that the INDI server announces; stops once all ``wanted`` are there.

    Stops also when the server has announced nothing new for ``quiet_s``. Raises OSError.
    """
    received = b""
    found: set[str] = set()
    news_s = time.monotonic()
    with socket.create_connection((host, port), timeout=quiet_s) as wire:
        wire.sendall(b'<getProperties version="1.7"/>\n')
        while not wanted <= found and (left_s := news_s + quiet_s - time.monotonic()) > 0:
            wire.settimeout(left_s)
            try:
                chunk = wire.recv(65536)
            except TimeoutError:
                break
            if not chunk:
                break
            received += chunk
            names = found | {html.unescape((a or b).decode()) for a, b in _DEVICE.findall(received)}
            if names != found:
                found, news_s = names, time.monotonic()
            # The beginning of the next name may be in this one's end.
            received = received[received.rfind(b"<") :]
    return found


def mount_abilities(host: str, port: int, mount: str, quiet_s: float) -> MountAbilities | None:
    """Return the functions that the mount's driver offers, by the properties that it defines.

    Listens until the driver has defined nothing new for ``quiet_s``. None where it has reported no
    coordinates, because it is not connected to its mount. Raises InstrumentError.
    """
    found: set[str] = set()
    with closing(IndiWire(host, port, quiet_s)) as wire:
        wire.ask(mount)
        while not found >= _ALL_OF_MOUNT:
            vector = wire.wait(
                lambda vector: vector.device == mount and vector.name not in found, quiet_s
            )
            if vector is None:
                break
            found.add(vector.name)
    return abilities_from_properties(found) if _COORDINATES in found else None


def mount_site(host: str, port: int, mount: str, quiet_s: float) -> Site | None:
    """Return the site that the mount reports; None where it reports none within ``quiet_s``.

    Raises InstrumentError.
    """
    with closing(IndiWire(host, port, quiet_s)) as wire:
        wire.ask(mount, "GEOGRAPHIC_COORD")
        found = wire.wait(
            lambda vector: vector.device == mount and vector.name == "GEOGRAPHIC_COORD", quiet_s
        )
    if found is None:
        return None
    latitude_deg, east_deg = float(found.values["LAT"]), float(found.values["LONG"])
    return Site(
        latitude_deg=latitude_deg,
        longitude_deg=(east_deg + 180.0) % 360.0 - 180.0,
        elevation_m=float(found.values.get("ELEV", 0.0)),
    )
