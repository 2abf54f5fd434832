"""What an INDI server says, asked by plain TCP: which devices it has, where the mount stands."""

import socket
import time

from rsoconsole.instruments.indi_wire import IndiWire
from rsoconsole.records import Site

INDI_TIMEOUT_S = 3.0


def devices_there(host: str, port: int, wanted: set[str]) -> set[str]:
    """Those of the wanted devices that the server speaks of. Raises OSError."""
    deadline = time.monotonic() + INDI_TIMEOUT_S
    heard = b""
    found: set[str] = set()
    with socket.create_connection((host, port), timeout=INDI_TIMEOUT_S) as wire:
        wire.sendall(b'<getProperties version="1.7"/>\n')
        while found < wanted and (left_s := deadline - time.monotonic()) > 0:
            wire.settimeout(left_s)
            try:
                chunk = wire.recv(65536)
            except TimeoutError:
                break
            if not chunk:
                break
            heard += chunk
            found = {d for d in wanted if any(f"device={q}{d}{q}".encode() in heard for q in "\"'")}
    return found


def told_site(host: str, port: int, mount: str) -> Site | None:
    """The site that the mount tells; None when it does not. Raises InstrumentError."""
    wire = IndiWire(host, port, INDI_TIMEOUT_S)
    try:
        wire.ask(mount, "GEOGRAPHIC_COORD")
        told = wire.wait(
            lambda vector: vector.device == mount and vector.name == "GEOGRAPHIC_COORD",
            INDI_TIMEOUT_S,
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
