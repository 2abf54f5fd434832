"""Threads that send what waits: one for each service, so that a slow one delays no other."""

import logging
import threading
import time
from collections.abc import Callable, Sequence

from rsoconsole.alerting.alert import URGENT
from rsoconsole.alerting.services import Sent, Service, send
from rsoconsole.alerting.spool import Spool, digest_of

log = logging.getLogger(__name__)

FIRST_AGAIN_S, LONGEST_AGAIN_S = 20.0, 900.0
_LOOK_S = 0.5
Send = Callable[..., Sent]


class Sender:
    """Sends until it is closed; ``add`` returns as soon as the message is in the spool."""

    def __init__(
        self,
        services: Sequence[Service],
        spool: Spool,
        *,
        send: Send = send,
        first_again_s: float = FIRST_AGAIN_S,
    ) -> None:
        self._services, self._spool, self._send = services, spool, send
        self._first_again_s = first_again_s
        self._end = threading.Event()
        self._there = threading.Condition()
        self._threads = [
            threading.Thread(target=self._serve, args=(each,), daemon=True, name=each.name)
            for each in services
        ]
        self._drop_old()
        for thread in self._threads:
            thread.start()

    def add(
        self, *, kind: str, title: str, body: str, t_utc_ns: int, seen: tuple[str, int] = ("", 0)
    ) -> None:
        """One message to all services."""
        to = [digest_of(each.url) for each in self._services]
        if to:
            self._spool.add(kind=kind, title=title, body=body, t_utc_ns=t_utc_ns, to=to, seen=seen)
        with self._there:
            self._there.notify_all()

    def finish(self, limit_s: float) -> int:
        """Wait until all is sent, at most so long; how many messages are still in the spool."""
        deadline = time.monotonic() + limit_s
        self._drop_old()  # what another engine left for services of its own is not waited for
        while len(self._spool) and time.monotonic() < deadline:
            time.sleep(0.05)
        self._end.set()
        with self._there:
            self._there.notify_all()
        return len(self._spool)

    def _serve(self, service: Service) -> None:
        digest, again_s = digest_of(service.url), self._first_again_s
        is_failing = False
        while not self._end.is_set():
            waiting = self._spool.first_for(digest)
            if waiting is None:
                with self._there:
                    self._there.wait(_LOOK_S)
                continue
            done = self._send(
                service.url, waiting.title, waiting.body, is_urgent=waiting.kind in URGENT
            )
            if done.ok:
                self._spool.sent(waiting.number, digest)
                if is_failing:
                    log.info("%s takes messages again", service.name)
                again_s, is_failing = self._first_again_s, False
                continue
            if not is_failing:
                log.warning("%s: %s; the message waits", service.name, done.detail)
            is_failing = True
            self._end.wait(again_s)
            again_s = min(again_s * 2.0, LONGEST_AGAIN_S)
            self._drop_old()

    def _drop_old(self) -> None:
        self._spool.drop_old(time.time_ns(), {digest_of(each.url) for each in self._services})
