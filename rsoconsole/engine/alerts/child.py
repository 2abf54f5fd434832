"""``python -m rsoconsole.engine.alerts.child``: reads a session's log and alerts the operator.

The first line on stdin holds the settings as JSON, so that no address is on a command line. Each
further line says that the engine's loop is alive; the end of stdin says that the engine is gone.
"""

import contextlib
import json
import logging
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TextIO

from rsoconsole.base import SessionError
from rsoconsole.config import AlertKind
from rsoconsole.control import one_line
from rsoconsole.engine.alerts._news import KINDS, Alert, SessionAlerts
from rsoconsole.engine.alerts._spool import QueuedMessage, Spool
from rsoconsole.engine.alerts.services import FIRST_AGAIN_S, AlertSender, Service, send_heartbeat
from rsoconsole.session import SessionReader

HOUR_S = 3600.0


@dataclass(slots=True)
class Limiter:
    """Limits how many alerts are sent; an alert that is held back is not sent later.

    Urgent alerts (faults and limits) are counted separately, and only one with an equal text holds
    another back; any other alert is held back by an earlier one of its kind.
    """

    events: Collection[AlertKind]
    quiet_s: float
    most_per_hour: int
    _last_s: dict[str, float] = field(default_factory=dict)
    _sent_s: dict[bool, deque[float]] = field(
        default_factory=lambda: {True: deque(), False: deque()}
    )
    _held: dict[str, int] = field(default_factory=dict)

    def alert_if_allowed(self, alert: Alert, now_s: float) -> Alert | None:
        """Return the alert where it may be sent now, else None.

        The returned text states how many alerts of its kind were held back before. ``now_s``: a
        monotonic time, s.
        """
        if alert.kind not in self.events:
            return None
        key = f"{alert.kind}: {alert.text}" if alert.is_urgent else alert.kind
        recent = self._sent_s[alert.is_urgent]
        while recent and now_s - recent[0] >= HOUR_S:
            recent.popleft()
        last_s = self._last_s.get(key)
        is_early = last_s is not None and now_s - last_s < self.quiet_s
        if is_early or len(recent) >= self.most_per_hour:
            self._held[alert.kind] = self._held.get(alert.kind, 0) + 1
            return None
        self._last_s[key] = now_s
        self._forget(now_s)
        recent.append(now_s)
        held = self._held.pop(alert.kind, 0)
        words = f"{alert.text} ({held} more of this kind before it)" if held else alert.text
        return replace(alert, text=words)

    def _forget(self, now_s: float) -> None:
        """Forget alerts that no longer hold back others; a night's faults may have many texts."""
        rest_s = max(self.quiet_s, HOUR_S)
        self._last_s = {key: at for key, at in self._last_s.items() if now_s - at < rest_s}


log = logging.getLogger("rsoconsole.engine.alerts")

LOOK_S = 2.0
ALIVE_S = 90.0
"""How long the heartbeat goes on after the loop's last report, s."""
CLOSING_S = 30.0
"""Time in which an engine that has ended must close its session, s; later it counts as dead."""
FLUSH_S = 60.0
MAX_TEXT = 600


def log_own_messages_only(stream: TextIO) -> None:
    """Log this program's messages, and none of apprise and its libraries.

    Their lines contain addresses, which are secrets.
    """
    handler = logging.StreamHandler(stream)
    handler.setFormatter(logging.Formatter("%(asctime)s %(message)s"))
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    log.propagate = False
    # Without any handler, logging prints warnings to stderr by itself.
    logging.getLogger().addHandler(logging.NullHandler())
    threading.excepthook = lambda fault: log.error(
        "the thread %s broke: %s", getattr(fault.thread, "name", "?"), fault.exc_type.__name__
    )


class EngineLink:
    """The engine's signs of life on stdin: each line means a live loop, the end a gone engine."""

    def __init__(self, alive_s: float = ALIVE_S) -> None:
        self._holds_s, self._alive_s = alive_s, time.monotonic()
        self.is_gone = threading.Event()
        threading.Thread(target=self._listen, daemon=True, name="engine").start()

    @property
    def is_alive(self) -> bool:
        """True while the engine is there and its loop has reported within ``alive_s``."""
        return not self.is_gone.is_set() and time.monotonic() - self._alive_s < self._holds_s

    def _listen(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            while sys.stdin.readline():
                self._alive_s = time.monotonic()
        self.is_gone.set()


def main() -> None:
    """Run until the engine is gone and all alerts are sent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # the engine's end says when to end
    log_own_messages_only(sys.stderr)
    settings: dict[str, Any] = json.loads(sys.stdin.readline())
    services = [Service(name, url) for name, url in settings["services"]]
    engine = EngineLink(float(settings.get("alive_s", ALIVE_S)))
    if settings["heartbeat_url"]:
        threading.Thread(
            target=_beat, args=(engine, settings), daemon=True, name="heartbeat"
        ).start()
    spool = Spool(Path(settings["spool"]))
    if spool.fault:
        log.warning("%s: messages wait in memory alone", spool.fault)
    sender = AlertSender(
        services, spool, first_again_s=float(settings.get("first_again_s", FIRST_AGAIN_S))
    )
    try:
        _follow(engine, sender, spool.last_alerted_record(settings["session"]), settings)
    finally:
        left = sender.finish(FLUSH_S)
        if left:
            log.warning("%d messages wait in the spool for the next engine", left)


def _follow(
    engine: EngineLink, sender: AlertSender, seen: int | None, settings: Mapping[str, Any]
) -> None:
    """Follow the session's log; ``seen``: the last record already reported; None: not known."""
    folder, look_s = Path(settings["session"]), float(settings.get("look_s", LOOK_S))
    limiter = Limiter(
        events=settings["events"],
        quiet_s=float(settings["quiet_s"]),
        most_per_hour=int(settings["most_per_hour"]),
    )
    news, seq = SessionAlerts(), 0
    # In place of one that died, and without its place: what is there is taken for told.
    is_old = seen is None and bool(settings.get("is_again"))
    gone_s: float | None = None

    def send(alert: Alert) -> None:
        passed = limiter.alert_if_allowed(alert, time.monotonic())
        if passed is not None:
            message = QueuedMessage(
                kind=passed.kind,
                title=one_line(f"{settings['title']}: {passed.kind}"),
                body=one_line(passed.text)[:MAX_TEXT],
                t_utc_ns=time.time_ns(),
            )
            sender.add(message, (settings["session"], seq))

    while True:
        is_gone = engine.is_gone.wait(look_s)
        gone_s = time.monotonic() if is_gone and gone_s is None else gone_s
        is_closed = False
        with contextlib.suppress(SessionError):  # not begun yet, or moved away: look again
            reader = SessionReader(folder)
            is_closed = reader.read_meta().get("is_closed") is True
            for place, t_utc_ns, record in reader.records(seq, KINDS):
                seq, alerts = place, news.take(t_utc_ns, record)
                for alert in alerts if not is_old and seq > (seen or 0) else ():
                    send(alert)
            is_old = False
        if is_closed:
            send(news.closing_alert(time.time_ns()))
            return
        if gone_s is not None:
            if time.monotonic() - gone_s > float(settings.get("closing_s", CLOSING_S)):
                words = f"the engine has ended without closing its session {folder.name}"
                send(Alert(kind="fault", text=words, t_utc_ns=time.time_ns()))
                return
            time.sleep(look_s)


def _beat(engine: EngineLink, settings: Mapping[str, Any]) -> None:
    url, every_s, is_failing = settings["heartbeat_url"], float(settings["heartbeat_s"]), False
    while not engine.is_gone.is_set():
        if engine.is_alive:
            done = send_heartbeat(url, limit_s=min(20.0, every_s))
            if done.ok == is_failing:
                log.log(logging.INFO if done.ok else logging.WARNING, "heartbeat: %s", done.detail)
            is_failing = not done.ok
        engine.is_gone.wait(every_s)


if __name__ == "__main__":
    main()
