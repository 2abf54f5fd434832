"""The odd mount as a driver on stdin and stdout, for Debian's indiserver.

    ODD="lieabort slowreport=2" python -m tests.rigs.odd_mount_driver

``ODD``: fields of ``Oddities``. indiserver wants one file to run: a shell script with that line.
"""

import math
import os
import select
import sys
import time

from tests.rigs.odd_mount import Oddities, OddMount
from tests.rigs.odd_mount_server import ElementReader

_READ_BYTES = 65536


def _emit(element: str) -> None:
    sys.stdout.buffer.write(element.encode("utf-8", "surrogateescape") + b"\n")
    sys.stdout.buffer.flush()


def main() -> None:
    """Obey until stdin ends."""
    model = OddMount(
        Oddities.parse(os.environ.get("ODD", "")),
        monotonic_s=time.monotonic,
        utc_ns=time.time_ns,
        emit=_emit,
    )
    reader = ElementReader()
    while True:
        wait_s = model.next_event_s - time.monotonic()
        timeout_s = max(0.0, wait_s) if math.isfinite(wait_s) else None
        if select.select([sys.stdin], [], [], timeout_s)[0]:
            chunk = os.read(sys.stdin.fileno(), _READ_BYTES)
            if not chunk:
                return
            for element in reader.feed(chunk):
                model.receive(element)
        model.advance()


if __name__ == "__main__":
    main()
