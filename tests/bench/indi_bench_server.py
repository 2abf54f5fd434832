"""An INDI server with a mount and a camera that cost nothing, for what the clients themselves cost.

    python -m tests.bench.indi_bench_server PORT WIDTH HEIGHT

The first line of stdout is its port. For every frame it prints when the first byte was handed to
the system and when the last, by ``time.monotonic()``, as JSON. A frame is sent as libindi's drivers
send it: base64, a line every 72 bytes.
"""

import base64
import contextlib
import json
import re
import socket
import sys
import threading
import time

import numpy as np

from rsoconsole.simulator import fits_bytes

MOUNT, CAMERA = "Telescope Simulator", "CCD Simulator"
_ORDER = re.compile(
    rb"<(getProperties|enableBLOB|new\w+Vector)\b([^>]*?)(?:/>|>(.*?)</\1>)", re.DOTALL
)
_NAME = re.compile(rb"""name=(?:"([^"]+)"|'([^']+)')""")
_DEVICE = re.compile(rb"""device=(?:"([^"]+)"|'([^']+)')""")
_LINE = 72


def definition(
    device: str, name: str, kind: str, members: dict[str, str], state: str = "Ok"
) -> str:
    """A property, as a driver defines it."""
    rule = ' rule="OneOfMany"' if kind == "Switch" else ""
    limits = ' format="%g" min="0" max="0" step="0"' if kind == "Number" else ""
    inner = "".join(
        f'<def{kind} name="{member}" label="{member}"{limits}>{value}</def{kind}>'
        for member, value in members.items()
    )
    return (
        f'<def{kind}Vector device="{device}" name="{name}" label="{name}" group="Main"'
        f' state="Ok" perm="rw" timeout="60"{rule}>{inner}</def{kind}Vector>\n'
    )


def change(device: str, name: str, kind: str, members: dict[str, str], state: str) -> bytes:
    """What a driver answers."""
    inner = "".join(f'<one{kind} name="{m}">{value}</one{kind}>' for m, value in members.items())
    head = f'<set{kind}Vector device="{device}" name="{name}" state="{state}">'
    return f"{head}{inner}</set{kind}Vector>\n".encode()


COORDINATES = {"RA": "5", "DEC": "10"}
DEFINITIONS = {
    MOUNT: definition(MOUNT, "CONNECTION", "Switch", {"CONNECT": "On", "DISCONNECT": "Off"})
    + definition(MOUNT, "EQUATORIAL_EOD_COORD", "Number", COORDINATES)
    + definition(MOUNT, "ON_COORD_SET", "Switch", {"TRACK": "On", "SLEW": "Off"})
    + definition(MOUNT, "TELESCOPE_ABORT_MOTION", "Switch", {"ABORT": "Off"})
    + definition(MOUNT, "TELESCOPE_TRACK_STATE", "Switch", {"TRACK_ON": "On", "TRACK_OFF": "Off"}),
    CAMERA: definition(CAMERA, "CONNECTION", "Switch", {"CONNECT": "On", "DISCONNECT": "Off"})
    + definition(CAMERA, "CCD_EXPOSURE", "Number", {"CCD_EXPOSURE_VALUE": "0"})
    + definition(CAMERA, "CCD_ABORT_EXPOSURE", "Switch", {"ABORT": "Off"})
    + f'<defBLOBVector device="{CAMERA}" name="CCD1" label="Image" group="Main" state="Ok"'
    ' perm="ro" timeout="60"><defBLOB name="CCD1" label="Image"/></defBLOBVector>\n',
}


class Client:
    """One connection, served on a thread of its own."""

    def __init__(self, connection: socket.socket, frame: bytes) -> None:
        self._socket, self._frame = connection, frame
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def serve(self) -> None:
        """Until it hangs up."""
        with contextlib.suppress(ConnectionError):
            self._serve()

    def _serve(self) -> None:
        heard = b""
        while chunk := self._socket.recv(65536):
            heard += chunk
            last = 0
            for order in _ORDER.finditer(heard):
                last = order.end()
                device, name = (_found(each, order[2]) for each in (_DEVICE, _NAME))
                self._answer(order[1].decode(), device, name)
            heard = heard[last:]

    def _answer(self, verb: str, device: str, name: str) -> None:
        if verb == "getProperties":
            wanted = [device] if device else list(DEFINITIONS)
            self._socket.sendall("".join(DEFINITIONS.get(each, "") for each in wanted).encode())
        elif name == "EQUATORIAL_EOD_COORD":
            self._say(change(MOUNT, name, "Number", COORDINATES, "Busy"))
        elif name == "TELESCOPE_ABORT_MOTION":
            self._say(change(MOUNT, name, "Switch", {"ABORT": "Off"}, "Ok"))
            self._say(change(MOUNT, "EQUATORIAL_EOD_COORD", "Number", COORDINATES, "Ok"))
        elif name == "TELESCOPE_TRACK_STATE":
            self._say(change(MOUNT, name, "Switch", {"TRACK_ON": "On", "TRACK_OFF": "Off"}, "Busy"))
        elif name == "CCD_EXPOSURE":
            self._say(change(CAMERA, name, "Number", {"CCD_EXPOSURE_VALUE": "1"}, "Busy"))
            time.sleep(0.1)
            began_s = time.monotonic()
            self._socket.sendall(self._frame)
            told = {"first_s": began_s, "last_s": time.monotonic()}
            print(json.dumps(told), flush=True)

    def _say(self, what: bytes) -> None:
        self._socket.sendall(what)


def _found(pattern: re.Pattern[bytes], text: bytes) -> str:
    found = pattern.search(text)
    return "" if found is None else (found[1] or found[2]).decode()


def frame_message(width_px: int, height_px: int) -> bytes:
    """A frame of noise as a driver sends it."""
    pixels = np.random.default_rng(1).integers(0, 65536, (height_px, width_px), dtype=np.uint16)
    content = bytes(fits_bytes(pixels, {"EXPTIME": 1.0}))
    text = base64.b64encode(content)
    lines = b"\n".join(text[i : i + _LINE] for i in range(0, len(text), _LINE))
    return (
        f'<setBLOBVector device="{CAMERA}" name="CCD1" state="Ok">\n<oneBLOB name="CCD1"'
        f' size="{len(content)}" enclen="{len(text)}" format=".fits">\n'.encode()
        + lines
        + b"\n</oneBLOB>\n</setBLOBVector>\n"
    )


def main(port: int, width_px: int, height_px: int) -> None:
    """Serve until killed."""
    frame = frame_message(width_px, height_px)
    with socket.create_server(("127.0.0.1", port)) as listener:
        print(listener.getsockname()[1], flush=True)
        while True:
            connection, _ = listener.accept()
            client = Client(connection, frame)
            threading.Thread(target=client.serve, daemon=True).start()


if __name__ == "__main__":
    main(*map(int, sys.argv[1:4]))
