"""Execution of the orders of a panel's page, each on a thread of its own.

STOP comes before all other orders, and is sent by a read-only panel too. Any other order passes the
same socket, control, checklist and limits as an order of a console.
"""

import logging
import threading
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from rsoconsole.base import ControlError, RsoconsoleError
from rsoconsole.config import Config
from rsoconsole.control import (
    COMMANDS,
    SUPERSEDED,
    Arm,
    Command,
    ControlClient,
    DirectStop,
    Goto,
    MovePreview,
    Outcome,
    Preview,
    StopNews,
    Stopping,
    make_command,
    preview_lines,
    read_record,
)
from rsoconsole.library.notebook.panel._panel_view import TUNED
from rsoconsole.library.notebook.panel.link import PanelLink

log = logging.getLogger(__name__)

LAST_FRAMES = 40
_PRESSES = 100
_PHASES = ("sent", "late", "answered", "failed", "stopped")
"""Phases of a STOP, in order: the later one counts."""
POINTING = {
    "name": "pointing",
    "detail": "judged on the first frame, once it is armed",
    "remedy": "tick it only where you know that the telescope looks where the mount says",
}
"""Item of the checklist that only the first frame can decide."""
NOTHING: dict[str, Any] = {}
Show = Callable[[str, dict[str, Any]], None]
"""Function that sends the page a name (said, asked, stop_news, goto, effect) and its value."""


class PanelOrders:
    """Receiver of the messages of a panel's page: executes its orders and answers them."""

    def __init__(
        self,
        wire: ControlClient,
        link: PanelLink,
        show: Show,
        *,
        read_only: bool,
        stop_directly: DirectStop | None,
    ) -> None:
        self._wire, self._link, self._show = wire, link, show
        self._read_only = read_only
        self._stop_directly = stop_directly
        self._lock = threading.Lock()
        self._stops = 0
        self._stop_shown = (0, 0)
        self._presses: deque[Any] = deque(maxlen=_PRESSES)
        self._effect_asked = 0
        self._goto_asked = 0

    def receive(self, message: Mapping[str, Any]) -> None:
        """Execute one message of the page; unknown messages are ignored."""
        kind = message.get("kind")
        if kind == "stop":
            self._stop_once(message.get("press"))
        elif self._read_only:
            self._say("read only: this panel only looks, but for STOP", "warning")
        elif kind == "order":
            self._order(message.get("verb"), _mapping(message.get("arguments")))
        elif kind == "goto_preview":
            self._in_thread(self._preview, str(message.get("text", "")), message.get("number"))
        elif kind == "goto":
            self._in_thread(self._go, str(message.get("text", "")))
        elif kind == "try":
            self._in_thread(self._try, _mapping(message.get("settings")), message.get("number"))
        elif kind == "forget":
            self._show("asked", NOTHING)

    def _stop_once(self, press: Any) -> None:
        """STOP once a press: a page that gets no answer sends the press again."""
        if press is None or press not in self._presses:
            self._presses.append(press)
            self.stop()

    def stop(self) -> None:
        """Send STOP, then remove an open question and an open go-to from the page."""
        with self._lock:
            self._stops += 1
            number = self._stops

        def news(answer: StopNews) -> None:
            if answer.is_superseded:
                self._end_stop(number)
            else:
                self._show_stop(number, answer.phase, answer.text)
            self._link.poll_now()

        Stopping(lambda: self._wire, self._stop_directly, news).begin()
        self._show_stop(number, "sent", "sent to the engine")
        self._show("asked", NOTHING)
        self._show("goto", NOTHING)

    def _show_stop(self, number: int, phase: str, text: str) -> None:
        """Show news of one STOP; news that is late, or of an older one, is dropped."""
        with self._lock:
            rank = number, _PHASES.index(phase)
            if rank <= self._stop_shown:
                return
            self._stop_shown = rank
            self._show("stop_news", {"number": number, "phase": phase, "text": text})

    def _end_stop(self, number: int) -> None:
        """End the alarm of a STOP: another order came before the stop was measured."""
        with self._lock:
            if self._stop_shown[0] != number:
                return
            self._stop_shown = number, len(_PHASES)
            self._show("stop_news", NOTHING)
        self._say(SUPERSEDED, "warning")

    # -- orders ---------------------------------------------------------------------------------

    def _order(self, verb: Any, arguments: Mapping[str, Any]) -> None:
        """Carry out an order of the page by its verb; a move goes by its preview."""
        known = COMMANDS.get(verb) if isinstance(verb, str) else None
        if known is None or not known.is_on_panel:
            return
        self._show("asked", NOTHING)
        try:
            command = make_command(known.verb, arguments)
        except ValueError as error:
            self._say(f"{known.label()}: not done, {error}", "warning")
            return
        self._say(f"{command.label()} …")
        self._in_thread(self._send, command)

    def _send(self, command: Command) -> None:
        stops = self._stops
        outcome = self._outcome(command)
        self._link.poll_now()
        if stops != self._stops:
            return  # STOP has the last word
        name = command.label()
        if outcome.ok:
            self._say(f"{name}: {outcome.message or 'done'}", "good")
            if isinstance(command, Arm):
                self._show("stop_news", NOTHING)
        elif outcome.data.get("seat"):
            holder = str(outcome.data["seat"])
            self._say(f"{name}: not done, {holder} has control", "warning")
            self._show("asked", {"kind": "seat", "holder": holder})
        elif isinstance(command, Arm) and outcome.data.get("checks"):
            self._say("not armed", "warning")
            failed = [
                {key: str(check.get(key) or "") for key in ("name", "detail", "remedy")}
                for check in outcome.data["checks"]
                if isinstance(check, Mapping) and not check.get("ok")
            ]
            checks = [*failed, POINTING]
            self._show("asked", {"kind": "arm", "message": outcome.message, "checks": checks})
        else:
            self._say(f"{name}: not done, {outcome.message}", "warning")

    def _outcome(self, command: Command) -> Outcome:
        try:
            return self._wire.send(command)
        except ControlError as error:
            return Outcome(ok=False, message=str(error))

    # -- go to ----------------------------------------------------------------------------------

    def _preview(self, text: str, number: Any) -> None:
        with self._lock:
            self._goto_asked += 1
            asked = self._goto_asked
        answer: dict[str, Any] = {"number": number, "lines": [], "may_go": False}
        try:
            found = self._understood(text)
            move = Goto(ra_icrs_deg=found.ra_icrs_deg, dec_icrs_deg=found.dec_icrs_deg)
            outcome = self._outcome(Preview(move=move))
            careful = [f"careful: {found.caution}"] if found.caution else []
            preview = read_record(MovePreview, outcome.data) if outcome.ok else None
            lines = preview_lines(preview) if outcome.ok else [outcome.message]
            answer["lines"] = [found.words, *careful, *lines]
            answer["may_go"] = preview is not None and not preview.refused
        except (ValueError, RsoconsoleError) as error:
            answer["lines"] = [str(error)]
        if asked == self._goto_asked:
            self._show("goto", answer)

    def _go(self, text: str) -> None:
        """Send a go-to, parsed again now: the sky moves past an altitude and azimuth."""
        try:
            found = self._understood(text)
        except (ValueError, RsoconsoleError) as error:
            self._say(f"go to: not done, {error}", "warning")
            return
        self._show("goto", NOTHING)
        self._send(Goto(ra_icrs_deg=found.ra_icrs_deg, dec_icrs_deg=found.dec_icrs_deg))

    def _understood(self, text: str) -> Any:
        from rsoconsole.pipeline import TargetNames, parse_direction

        live, now_utc_ns = self._link.live, self._link.now_utc_ns
        if live is None or now_utc_ns is None:
            raise ValueError("the engine has not said where and when it is yet")
        names = TargetNames.load(live.config.catalogue.tle_files)
        return parse_direction(text, live.config.site.to_site(), now_utc_ns, names)

    # -- tuning ---------------------------------------------------------------------------------

    def _try(self, settings: Mapping[str, Any], number: Any) -> None:
        with self._lock:
            self._effect_asked += 1
            asked = self._effect_asked
        live = self._link.live
        answer: dict[str, Any] = {"number": number, "rows": [], "fault": "", "frames": LAST_FRAMES}
        if live is None:
            answer["fault"] = "nothing is on record yet"
        else:
            try:
                changes = check_tuned_settings(settings)
                answer["rows"] = what_if_rows(list(live.records), live.begun_with, changes)
            except (ValueError, RsoconsoleError) as error:
                answer["fault"] = str(error)
        if asked == self._effect_asked:
            self._show("effect", answer)

    # -- the rest -------------------------------------------------------------------------------

    def _say(self, words: str, level: str = "info") -> None:
        self._show("said", {"text": words, "level": level})

    def _in_thread(self, work: Callable[..., None], *arguments: Any) -> None:
        def run() -> None:
            try:
                work(*arguments)
            except Exception as error:  # the operator must hear of it, whatever it is
                log.exception("panel")
                self._say(f"something broke: {error or type(error).__name__}", "warning")

        threading.Thread(target=run, name="panel-order", daemon=True).start()


def check_tuned_settings(settings: Mapping[str, Any]) -> dict[str, float | str]:
    """Check the settings that a page sends, and return them by dotted name.

    Raises ValueError for a setting that is not in ``TUNED`` or is neither a number nor text.
    """
    known = {name for name, _, _ in TUNED}
    values: dict[str, float | str] = {}
    for name, value in settings.items():
        is_plain = isinstance(value, str | int | float) and not isinstance(value, bool)
        if name not in known or not is_plain:
            raise ValueError(f"{name} cannot be tuned here")
        values[name] = value
    return values


def what_if_rows(
    records: list[Any], config: Config, changes: Mapping[str, float | str]
) -> list[list[str]]:
    """Compare the last frames with other settings: rows [figure, as recorded, as changed].

    The frames are followed again from ``records`` for both columns. ``config``: configuration at
    the session's beginning; ``changes``: settings by dotted name. Raises ConfigError for a value
    that is not valid.
    """
    from rsoconsole.night import merit
    from rsoconsole.pipeline import what_if

    was, then = (what_if(records, config, each, LAST_FRAMES) for each in ({}, changes))
    return [[each.label, each.words(was), each.words(then)] for each in merit.TUNED]


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}
