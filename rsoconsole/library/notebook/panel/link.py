"""Poller of the engine and its session for a panel, on a thread of its own.

The kernel stays free. The poller works only while the page is open: once the page is closed, engine
and seat are released.
"""

import logging
from collections.abc import Callable
from typing import Any

from rsoconsole.base import ControlError, SessionError
from rsoconsole.control import AskStatus, ControlClient, Poller, Status, read_status, to_printable
from rsoconsole.library.notebook.panel._panel_view import LiveNight, night_view, status_view
from rsoconsole.words import NOT_SHOWN

log = logging.getLogger(__name__)

EVERY_S = 0.5
ANSWER_S = 1.0


class PanelLink(Poller):
    """Poller that reports the engine's status at every poll, and each change of the record."""

    def __init__(
        self,
        wire: ControlClient,
        *,
        seat: str,
        is_watched: Callable[[], bool],
        on_status: Callable[[dict[str, Any]], None],
        on_night: Callable[[dict[str, Any], bytes], None],
    ) -> None:
        """Prepare the poller; ``seat``: the panel's name, ``is_watched``: whether the page is open.

        ``on_status``: receives the status; ``on_night``: receives the view of the record and the
        newest picture (PNG, or empty).
        """
        super().__init__("panel", EVERY_S)
        self._wire, self._seat = wire, seat
        self._is_watched = is_watched
        self._on_status, self._on_night = on_status, on_night
        self._status = Status()
        self._fault = ""
        self.live: LiveNight | None = None
        """Record of the engine's session; None before the session is known."""

    @property
    def now_utc_ns(self) -> int | None:
        """Time of the engine's clock at its last answer, UTC nanoseconds; None before an answer."""
        return self._status.now_utc_ns

    def _look(self) -> None:
        try:
            if self._is_watched():
                self._see()
        except Exception:  # the panel must go on, whatever it met
            log.exception("the panel's look failed")

    def _see(self) -> None:
        reach, detail = self._ask()
        self._read()
        if self._is_closing:
            return
        words = " · ".join(part for part in (detail, self._fault) if part)
        self._on_status(status_view(self._status, reach, to_printable(words), self._seat))

    def _ask(self) -> tuple[str, str]:
        """Ask the engine; return (reach, fault in words)."""
        try:
            outcome = self._wire.send(AskStatus(), timeout_s=ANSWER_S)
        except ControlError as error:
            gone = isinstance(error.__cause__, FileNotFoundError | ConnectionRefusedError)
            return ("gone" if gone else "silent"), str(error)
        if not outcome.ok:
            return "silent", outcome.message
        self._status = read_status(outcome.data)
        return "attached", ""

    def _read(self) -> None:
        folder = self._status.session
        if folder is None:
            return
        try:
            if self.live is None or self.live.folder != folder:
                self.live = LiveNight(folder)
            if self.live.read_new_records():
                picture = b"" if self.live.picture is None else self.live.picture[1]
                self._on_night(night_view(self.live), picture)
            self._fault = ""
        except SessionError as error:
            self._fault = str(error)
        except Exception as error:  # STOP and the engine's word must be shown all the same
            log.exception(NOT_SHOWN)
            self._fault = f"{NOT_SHOWN}: {error or type(error).__name__}"
