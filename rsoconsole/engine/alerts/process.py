"""The engine's side of the alert process: starts it and keeps it alive, never waits for it."""

import contextlib
import json
import logging
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import platformdirs

from rsoconsole.base import ConfigError
from rsoconsole.config import APP, AlertsConfig, state_dir
from rsoconsole.engine.alerts.services import services_of

log = logging.getLogger(__name__)

BEAT_S = 15.0
AGAIN_S = 60.0
_MODULE = "rsoconsole.engine.alerts.child"


class AlertProcess:
    """The alert process beside the engine; its methods raise nothing and never delay the loop."""

    def __init__(
        self,
        config: AlertsConfig,
        folder: Path,
        *,
        title: str,
        beat_s: float = BEAT_S,
        again_s: float = AGAIN_S,
        **settings: Any,
    ) -> None:
        """``folder``: the session's folder; ``settings``: passed unchanged to the alert process."""
        self._beat_s, self._again_s = beat_s, again_s
        self._end = threading.Event()
        self._child: subprocess.Popen[bytes] | None = None
        self._thread: threading.Thread | None = None
        self._is_alive: Callable[[], bool] = lambda: True
        self._settings: Mapping[str, Any] | None = None
        self.fault: str | None = None
        """Reason why no alerts are sent, in words for the log; None without one."""
        if not config.is_configured:
            return
        try:
            services = services_of(config)
        except ConfigError as error:
            self.fault, services = f"no alerts are sent: {error}", ()
            if not config.heartbeat_url:
                return
        self._settings = {
            "session": str(folder.resolve()),
            "title": title,
            "spool": str(state_dir() / "alerts"),
            "services": [(each.name, each.url) for each in services],
            "events": list(config.events),
            "quiet_s": config.quiet_min * 60.0,
            "most_per_hour": config.most_per_hour,
            "heartbeat_url": config.heartbeat_url,
            "heartbeat_s": config.heartbeat_s,
            **settings,
        }

    def start(self, is_alive: Callable[[], bool]) -> None:
        """Start the alert process, if any alert is configured.

        ``is_alive``: returns True while the loop is alive; called from any thread.
        """
        if self._settings is None:
            return
        self._is_alive = is_alive
        self._thread = threading.Thread(target=self._keep, daemon=True, name="alerts")
        self._thread.start()

    def close(self) -> None:
        """Tell the alert process to end once its messages are sent; waits 1 s at most."""
        self._end.set()
        if self._thread is not None:
            self._thread.join(1.0)
        if self._child is not None:
            _let_go(self._child)

    @property
    def pid(self) -> int | None:
        """Process number of the alert process; None while there is none."""
        return None if self._child is None else self._child.pid

    def _keep(self) -> None:
        is_again, is_said, began_s = False, False, 0.0
        while not self._end.is_set():
            if self._child is None or self._child.poll() is not None:
                if self._child is not None and not is_said:
                    log.warning("the process that sends alerts has ended; it is started again")
                    _let_go(self._child)
                    is_said = True
                if not is_again or time.monotonic() - began_s >= self._again_s:
                    began_s = time.monotonic()
                    self._begin(is_again=is_again)
                    is_again, is_said = True, False
            elif self._alive():
                self._say(b"alive\n")
            self._end.wait(self._beat_s)

    def _alive(self) -> bool:
        try:
            return self._is_alive()
        except Exception:
            log.exception("nobody can tell whether the loop lives")
            return False

    def _begin(self, *, is_again: bool) -> None:
        try:
            with _log_file() as log_file:
                self._child = subprocess.Popen(
                    [sys.executable, "-m", _MODULE],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.DEVNULL,
                    stderr=log_file,
                    start_new_session=True,  # Ctrl+C is for the engine
                )
            assert self._child.stdin is not None
            # A child that hangs must not hold up even this thread.
            os.set_blocking(self._child.stdin.fileno(), False)
            message = {**(self._settings or {}), "is_again": is_again}
            self._say(json.dumps(message).encode() + b"\n")
        except OSError as error:
            log.warning("the process that sends alerts cannot be started: %s", error.strerror)

    def _say(self, line: bytes) -> None:
        child = self._child
        if child is not None and child.stdin is not None:
            with contextlib.suppress(OSError, ValueError):
                child.stdin.write(line)
                child.stdin.flush()


def _let_go(child: subprocess.Popen[bytes]) -> None:
    """Close the child's stdin; a thread waits for its end, however late."""
    if child.stdin is not None:
        with contextlib.suppress(OSError):
            child.stdin.close()
    threading.Thread(target=child.wait, daemon=True, name="alerts' end").start()


def _log_file() -> contextlib.AbstractContextManager[Any]:
    """Open the child's log beside the program's; nothing where that cannot be written."""
    folder = platformdirs.user_log_path(APP)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / "alerts.log"
        is_full = path.exists() and path.stat().st_size >= 2_000_000
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | (os.O_TRUNC if is_full else 0)
        descriptor = os.open(path, flags, 0o600)
        os.fchmod(descriptor, 0o600)
        return open(descriptor, "ab")  # noqa: PTH123 - a descriptor
    except OSError:
        return contextlib.closing(open(os.devnull, "wb"))  # noqa: PTH123 - closed by the caller
