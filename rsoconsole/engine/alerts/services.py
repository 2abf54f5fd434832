"""The configured alert services, each through apprise; no message contains an address."""

import logging
import threading
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rsoconsole.base import ConfigError, read_private_lines, value_errors_as
from rsoconsole.config import AlertsConfig, expect_service_url, service_scheme
from rsoconsole.engine.alerts._news import URGENT
from rsoconsole.engine.alerts._spool import QueuedMessage, Spool, digest_of

SEND_S = 30.0


@dataclass(frozen=True, slots=True)
class Service:
    """One service: its name and its address."""

    name: str
    """Name shown to people: kind of service, and its number among all."""
    url: str


@dataclass(frozen=True, slots=True)
class SendResult:
    """The result of one message to one service."""

    ok: bool
    detail: str


def services_of(config: AlertsConfig) -> tuple[Service, ...]:
    """Return all configured services.

    Raises ConfigError where ``services_file`` is unreadable, or readable by other users.
    """
    urls = [*config.services]
    if config.services_file is not None:
        urls += _of_file(config.services_file)
    urls = list(dict.fromkeys(urls))
    return tuple(Service(f"{service_scheme(url)} {n}", url) for n, url in enumerate(urls, start=1))


def send(url: str, title: str, body: str, *, is_urgent: bool = False) -> SendResult:
    """Send one message through apprise, which has time-outs of its own; never raises."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what it loads, and when, is its own affair
        return _send(url, title, body, is_urgent)


def _send(url: str, title: str, body: str, is_urgent: bool) -> SendResult:
    try:
        import apprise
    except ImportError:
        words = "the package apprise is not installed: 'pip install apprise' gets it"
        return SendResult(False, words)
    # What it logs may hold the address.
    logging.getLogger("apprise").disabled = True
    try:
        one = apprise.Apprise()
        if not one.add(url):
            words = "apprise does not understand the address: see its list of services"
            return SendResult(False, words)
        kind = apprise.NotifyType.WARNING if is_urgent else apprise.NotifyType.INFO
        if one.notify(body=body, title=title, notify_type=kind):
            return SendResult(True, "sent")
    except Exception as error:  # whatever one of a hundred services does
        return SendResult(False, f"apprise broke ({type(error).__name__})")
    words = "the service did not take it: no network, a wrong address, or a refusal"
    return SendResult(False, words)


def send_within(url: str, title: str, body: str, *, limit_s: float = SEND_S) -> SendResult:
    """Send one message, giving up after ``limit_s`` seconds."""
    done: list[SendResult] = []
    worker = threading.Thread(
        target=lambda: done.append(send(url, title, body)), daemon=True, name="send"
    )
    worker.start()
    worker.join(limit_s)
    return done[0] if done else SendResult(False, f"no answer in {limit_s:.0f} s")


def send_heartbeat(url: str, *, limit_s: float = SEND_S) -> SendResult:
    """Call the heartbeat's address once, with a time limit."""
    from rsoconsole.pipeline import Fetcher, FetchError

    try:
        Fetcher(deadline_s=limit_s).get(url)
    except FetchError as error:
        words = {
            "refused": "it refuses",
            "unreachable": "it cannot be reached: is there a network?",
        }
        return SendResult(False, words.get(error.kind, "it did not answer as it should"))
    return SendResult(True, "called")


def _of_file(path: Path) -> Sequence[str]:
    lines = read_private_lines(path, ConfigError, "alerts.services_file has one address a line")
    urls = [line for line in lines if not line.startswith("#")]
    for number, url in enumerate(urls, start=1):
        with value_errors_as(ConfigError, f"{path}, address {number}: "):
            expect_service_url(url)
    return urls


log = logging.getLogger(__name__)

FIRST_AGAIN_S, LONGEST_AGAIN_S = 20.0, 900.0
_LOOK_S = 0.5
Send = Callable[..., SendResult]


class AlertSender:
    """Sends queued messages, on one thread for each service, until ``finish`` is called."""

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

    def add(self, message: QueuedMessage, seen: tuple[str, int] = ("", 0)) -> None:
        """Queue a message for all services.

        ``seen``: the session, and the number of the record that the message is about.
        """
        message.pending = [digest_of(each.url) for each in self._services]
        if message.pending:
            self._spool.add(message, seen)
        with self._there:
            self._there.notify_all()

    def finish(self, limit_s: float) -> int:
        """Wait up to ``limit_s`` until all is sent; return the number of messages still queued."""
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
            waiting = self._spool.oldest_unsent(digest)
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
