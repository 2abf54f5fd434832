"""A process that takes one small frame by INDI and says what its mirror keeps of it, as JSON."""

import json
import os
import sys
import threading
import weakref
from collections.abc import Mapping
from typing import Any

from rsoconsole.instruments.indi.client_choice import open_client
from rsoconsole.instruments.indi.indi_child import ReplyWriter
from rsoconsole.instruments.indi.indi_client import Vector


class Silent(ReplyWriter):
    """Tells nobody what is waited for."""

    def __init__(self) -> None:
        """Leave stdout as it is: the answer goes there."""

    def send(self, message: Mapping[str, Any]) -> None:
        """Nobody listens."""


def main(host: str, port: int, device: str, library: str) -> None:
    """Expose for a moment; what was seen of the BLOB, during the call and after it."""
    has_come = threading.Event()
    seen: dict[str, Any] = {}

    def receive(vector: Vector) -> None:
        if vector.blobs and "content" not in seen:
            content = vector.blobs["CCD1"]
            seen["content"] = content if library == "pyindi" else weakref.ref(content)
            seen["start"], seen["bytes"] = bytes(content[:6]).decode(), content.nbytes
            seen["middle"] = sum(content[len(content) // 2 : len(content) // 2 + 100])
            has_come.set()

    client, _ = open_client(library, device, receive)
    order = {
        "host": host,
        "port": port,
        "setting": "indi.camera",
        "device_s": 60.0,
        "quiet_s": 20.0,
    }
    client.open(order, ("CCD_EXPOSURE", "CCD1"), Silent())
    client.enable_blobs("CCD1")
    before = client.send_numbers("CCD_EXPOSURE", {"CCD_EXPOSURE_VALUE": 0.1})
    seen["has_come"] = has_come.wait(60.0)
    # Told only once the call is over.
    vector = client.wait("CCD1", lambda v: v.state == "Ok", 10.0, before)
    assert vector is not None
    # libindi keeps its memory, whose pages have gone; Python's is let go whole.
    content = seen.pop("content")
    seen["kept"] = len(vector.blobs) + len(vector.values)
    if isinstance(content, weakref.ref):
        seen["has_gone"] = content() is None
    else:
        seen["has_gone"] = sum(content[len(content) // 2 : len(content) // 2 + 100]) == 0
    print(json.dumps(seen), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), sys.argv[3], sys.argv[4])
    sys.stdout.flush()
    os._exit(0)
