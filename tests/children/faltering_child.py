"""A child process that fails in the ways a driver's process can; run by test_indi_process."""

import json
import os
import sys
import threading
import time
from typing import Any


def say(message: Any) -> None:
    """One line to the parent."""
    os.write(1, json.dumps(message).encode() + b"\n")


def obey(order: dict[str, Any]) -> None:
    """Carry out one order."""
    verb, number = order["verb"], order["id"]
    if "awaits" in order:
        say({"event": "waiting", "what": order["awaits"]})
        return
    if verb == "die":
        os._exit(7)
    if verb == "break off":
        os.write(1, b'{"id": %d, "answer": "4' % number)
        os._exit(9)
    if verb == "fall silent":
        os.close(1)
        time.sleep(60)
    if verb == "be late":
        time.sleep(order["after_s"])
    if verb == "babble":
        os.write(1, b'libindi says hello\n\xff\xfe\n[1, 2]\n"x"\n{"half":\n\n')
        say({"event": "unusable"})
        say({"event": "usable"})
    if verb != "wait for ever":
        say({"id": number, "echo": verb})


for line in sys.stdin.buffer:
    threading.Thread(target=obey, args=(json.loads(line),), daemon=True).start()
