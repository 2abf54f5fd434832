"""A process that says what one INDI client makes of a server's bytes, as JSON lines."""

import json
import os
import sys
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


def say(**what: Any) -> None:
    """One line."""
    # Whole lines, from whatever thread.
    os.write(1, json.dumps(what).encode() + b"\n")


def on_vector(vector: Vector) -> None:
    """A property as the mount's and the camera's processes see it."""
    say(
        name=vector.name,
        state=vector.state,
        values=dict(vector.values),
        is_definition=vector.is_definition,
        blobs={name: bytes(content).hex() for name, content in vector.blobs.items()},
    )


def main(library: str, host: str, port: int, device: str) -> None:
    """Connect, send an order for every line of stdin, say what comes, until stdin ends."""
    client, _ = open_client(library, device, on_vector, lambda text: say(message=text))
    order = {"host": host, "port": port, "setting": "indi.mount", "device_s": 20.0, "quiet_s": 20.0}
    client.open(order, (), Silent())
    say(ready=True)
    for line in sys.stdin:
        verb, name, *values = json.loads(line)
        if verb == "numbers":
            client.send_numbers(name, values[0])
        elif verb == "switch":
            client.send_switch(name, values[0])
        elif verb == "blobs":
            client.enable_blobs(name)
        elif verb == "forgotten":
            say(forgotten=client.get(name) is None)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]), sys.argv[4])
    os._exit(0)
