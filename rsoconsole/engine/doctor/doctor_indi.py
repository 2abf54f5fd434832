"""What an INDI server says, asked by plain TCP: which devices it has, where the mount stands."""

import html
import re
import socket
import time

from rsoconsole.instruments.indi import IndiWire
from rsoconsole.records import Site

_DEVICE = re.compile(rb"""device=(?:"([^"]+)"|'([^']+)')""")


def devices_there(host: str, port: int, wanted: set[str], quiet_s: float) -> set[str]:
    """The devices that the server announces, until those wanted are there.

    Ends also when it has announced nothing new for ``quiet_s``. Raises OSError.
    """
    heard = b""
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
            heard += chunk
            names = found | {html.unescape((a or b).decode()) for a, b in _DEVICE.findall(heard)}
            if names != found:
                found, news_s = names, time.monotonic()
            # The beginning of the next name may be in this one's end.
            heard = heard[heard.rfind(b"<") :]
    return found


def told_site(host: str, port: int, mount: str, quiet_s: float) -> Site | None:
    """The site that the mount tells; None when it does not in ``quiet_s``.

    Raises InstrumentError.
    """
    wire = IndiWire(host, port, quiet_s)
    try:
        wire.ask(mount, "GEOGRAPHIC_COORD")
        told = wire.wait(
            lambda vector: vector.device == mount and vector.name == "GEOGRAPHIC_COORD",
            quiet_s,
        )
    finally:
        wire.close()
    if told is None:
        return None
    latitude_deg, east_deg = float(told.values["LAT"]), float(told.values["LONG"])
    return Site(
        latitude_deg=latitude_deg,
        longitude_deg=(east_deg + 180.0) % 360.0 - 180.0,
        elevation_m=float(told.values.get("ELEV", 0.0)),
    )
