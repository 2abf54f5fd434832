"""Execution of orders and writing of replies, in the processes of mount and camera.

Runs only in a child process.
"""

import json
import os
import queue
import signal
import sys
import threading
import traceback
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from rsoconsole.base import RsoconsoleError
from rsoconsole.instruments.indi.indi_process import END

_UNREAD_LINES = 2000


class ReplyWriter:
    """Writes JSON lines to the parent, and keeps all other output off that pipe.

    It never blocks: where the parent hangs and reads nothing, the oldest unread lines are dropped.
    """

    def __init__(self) -> None:
        self._out = os.fdopen(os.dup(1), "wb")
        os.dup2(2, 1)
        self._unsaid: deque[bytes] = deque(maxlen=_UNREAD_LINES)
        self._has_more = threading.Semaphore(0)
        threading.Thread(target=self._write_all, daemon=True, name="reply writer").start()

    def send(self, message: Mapping[str, Any]) -> None:
        """Send one line to the parent; returns at once."""
        self._unsaid.append(json.dumps(message).encode() + b"\n")
        self._has_more.release()

    def _write_all(self) -> None:
        while True:
            self._has_more.acquire()
            if not self._unsaid:
                continue
            try:
                self._out.write(self._unsaid.popleft())
                self._out.flush()
            except OSError:
                return


Handler = Callable[[dict[str, Any]], dict[str, Any]]


def execute_orders(
    writer: ReplyWriter,
    slow: Mapping[str, Handler],
    urgent: Mapping[str, Handler],
    on_order: Callable[[dict[str, Any]], None] = lambda _order: None,
) -> bool:
    """Execute the orders that come as JSON lines on stdin, until the parent ends.

    ``slow``: handlers of orders that are executed one after another; ``urgent``: of orders that are
    executed at once, each on a thread of its own. ``on_order``: called with each order as it
    arrives. SIGTERM and SIGHUP are ignored: the parent may need this process to end safely. Returns
    True where the parent ordered the end, False where its end of the pipe closed.
    """
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    waiting: queue.SimpleQueue[tuple[Handler, dict[str, Any]]] = queue.SimpleQueue()

    def obey(handler: Handler, order: dict[str, Any]) -> None:
        try:
            writer.send({"id": order["id"], **handler(order)})
        except RsoconsoleError as error:
            writer.send({"id": order["id"], "error": str(error)})
        except Exception as error:
            traceback.print_exc()
            writer.send({"id": order["id"], "error": f"{type(error).__name__}: {error}"})

    def work() -> None:
        while True:
            obey(*waiting.get())

    threading.Thread(target=work, daemon=True, name="orders").start()
    for line in sys.stdin.buffer:
        try:
            order = json.loads(line)
        except ValueError:
            # A parent that is killed may leave half an order behind.
            continue
        on_order(order)
        if order["verb"] == END:
            return True
        if order["verb"] in urgent:
            handler = urgent[order["verb"]]
            threading.Thread(target=obey, args=(handler, order), daemon=True).start()
        elif order["verb"] in slow:
            waiting.put((slow[order["verb"]], order))
        else:
            writer.send({"id": order["id"], "error": f"nobody here knows '{order['verb']}'"})
    return False
