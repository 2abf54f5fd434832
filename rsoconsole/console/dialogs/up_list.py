"""What is up now: the satellites of the element files above the limit; one is gone to."""

import logging
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar, Literal

from textual import events
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.message import Message
from textual.widgets import Input

from rsoconsole.config import Config
from rsoconsole.console.dialogs.ask import UNREAD_CHECK_S
from rsoconsole.console.dialogs.dialogs import Dialog
from rsoconsole.console.dialogs.session_list import poster
from rsoconsole.console.drawing import Ink, Line
from rsoconsole.console.panes import LinesPane
from rsoconsole.console.words import clipped, first_shown
from rsoconsole.errors import RsoconsoleError
from rsoconsole.words import clock, span

if TYPE_CHECKING:
    from rsoconsole.pipeline.outlook import Up

log = logging.getLogger(__name__)

Order = Literal["altitude", "minutes left", "name"]
ORDERS: tuple[Order, ...] = ("altitude", "minutes left", "name")
SOON_MIN = 15.0
NAME_COLUMNS = 24


class UpFound(Message):
    """What is up, or why that cannot be said."""

    def __init__(self, found: "tuple[Up, ...]", t_utc_ns: int, fault: str = "") -> None:
        super().__init__()
        self.found, self.t_utc_ns, self.fault = found, t_utc_ns, fault


class UpListDialog(Dialog[str | None]):
    """Satellites above the limit; typing finds one. Gives its number, as the go-to takes it."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "choose(-1)", show=False),
        Binding("down", "choose(1)", show=False),
        Binding("pageup", "choose(-10)", show=False),
        Binding("pagedown", "choose(10)", show=False),
        Binding("tab", "sort", show=False, priority=True),
    ]
    DEFAULT_CSS = """
    UpListDialog > Vertical {
        width: 78; max-width: 100%; height: 80%; min-height: 10; max-height: 100%;
        background: $surface; border: solid $primary; padding: 0 1;
    }
    UpListDialog LinesPane { height: 1fr; }
    """

    def __init__(self, config: Callable[[], Config | None], now_utc_ns: Callable[[], int]) -> None:
        """``config``: the night's, None until it has been read; ``now_utc_ns``: the frame clock."""
        super().__init__()
        self._config, self._now_utc_ns = config, now_utc_ns
        self._found: tuple[Up, ...] | None = None
        self._t_utc_ns = 0
        self._limit_deg = 0.0
        self._fault = ""
        self._order: Order = "altitude"
        self._at = 0

    def compose(self) -> ComposeResult:
        """A field to type in, and the list."""
        with Vertical() as box:
            box.border_title = "what is up now"
            box.border_subtitle = "↑↓ choose · enter plans a go-to · tab sorts · esc back"
            yield Input(placeholder="type a part of a name or number", id="wanted", compact=True)
            yield LinesPane(id="rows")

    def on_mount(self) -> None:
        """Compute it on a thread: large catalogues take a second."""
        self.query_one(Input).focus()
        self._show()
        post = poster(self.app.call_from_thread, self.post_message)
        work = lambda: self._look(post)  # noqa: E731 -- it is given to a thread
        threading.Thread(target=work, name="console-up-now", daemon=True).start()

    def _look(self, post: Callable[[Message], None]) -> None:
        from rsoconsole.pipeline.orbits import read_catalogue
        from rsoconsole.pipeline.outlook import up_now

        while (config := self._config()) is None:
            time.sleep(UNREAD_CHECK_S)
            if not self.is_running:
                return
        t_utc_ns = self._now_utc_ns()
        files = config.catalogue.tle_files
        if not files:
            fault = "no element files are configured: name some in catalogue.tle_files"
            post(UpFound((), t_utc_ns, fault))
            return
        site, limits = config.site.to_site(), config.limits
        self._limit_deg = limits.min_altitude_deg
        try:
            found = up_now(read_catalogue(files), site, t_utc_ns, limits)
        except RsoconsoleError as error:
            post(UpFound((), t_utc_ns, str(error)))
        except Exception:  # whatever it is, nobody waits for ever for the list
            log.exception("what is up cannot be computed")
            post(UpFound((), t_utc_ns, "it cannot be computed: the console's log says why"))
        else:
            post(UpFound(found, t_utc_ns))

    def on_up_found(self, message: UpFound) -> None:
        """The list."""
        self._found, self._fault = message.found, message.fault
        self._t_utc_ns = message.t_utc_ns
        self._show()

    @property
    def shown(self) -> "list[Up]":
        """Those that what was typed leaves, in the chosen order."""
        words = self.query_one(Input).value.lower().split()
        left = [
            up
            for up in self._found or ()
            if all(word in f"{up.name} {up.norad_id}".lower() for word in words)
        ]
        if self._order == "name":
            return sorted(left, key=lambda up: (up.name, up.norad_id))
        if self._order == "minutes left":
            return sorted(left, key=lambda up: (up.minutes_left is None, up.minutes_left or 0.0))
        return left

    def on_input_changed(self, event: Input.Changed) -> None:
        """Other ones are left."""
        event.stop()
        self._at = 0
        self._show()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Plan the way to the chosen one."""
        event.stop()
        shown = self.shown
        if shown:
            self.dismiss(str(shown[min(self._at, len(shown) - 1)].norad_id))
        else:
            self.app.bell()

    def on_click(self, event: events.Click) -> None:
        """By the mouse: choose; nothing moves by it."""
        rows = self.query_one("#rows", LinesPane)
        if event.widget is rows and event.y:
            room = max(rows.size.height - 1, 1)
            number = first_shown(self._at, len(self.shown), room) + event.y - 1
            self._at = min(number, max(len(self.shown) - 1, 0))
            self._show()

    def action_choose(self, by: int) -> None:
        """One further up or down."""
        self._at = min(max(self._at + by, 0), max(len(self.shown) - 1, 0))
        self._show()

    def action_sort(self) -> None:
        """By altitude, by what sets first, by name."""
        self._order = ORDERS[(ORDERS.index(self._order) + 1) % len(ORDERS)]
        self._show()

    def _show(self) -> None:
        shown: list[Up] = []
        if self._found is None:
            head = "computing …"
        elif self._fault:
            head = self._fault
        else:
            shown = self.shown
            head = (
                f"{len(shown)} of {len(self._found)} above {self._limit_deg:g}°"
                f" at {clock(self._t_utc_ns)}, by {self._order}"
            )
        at = self._at
        self.query_one("#rows", LinesPane).show(
            lambda width, height: up_lines(head, shown, at, width, height)
        )


def up_lines(head: str, shown: "list[Up]", chosen: int, width: int, height: int) -> list[Line]:
    """How many, and as many of them as fit, the chosen one among them."""
    lines = [clipped([(head, "dim")], width)]
    room = max(height - 1, 1)
    first = first_shown(chosen, len(shown), room)
    for number, up in enumerate(shown[first : first + room], first):
        left = "12 h +" if up.minutes_left is None else span(up.minutes_left * 60.0)
        is_soon = up.minutes_left is not None and up.minutes_left < SOON_MIN
        ink: Ink = "warn" if is_soon else "" if up.is_lit else "dim"
        text = (
            f"{'▸' if number == chosen else ' '} {up.name[:NAME_COLUMNS]:<{NAME_COLUMNS}}"
            f" {up.norad_id:>6}  alt {up.alt_deg:4.1f} az {up.az_deg:5.1f}"
            f"  up {left:>6}  {'' if up.is_lit else 'in shadow'}"
        )
        lines.append(clipped([(text.ljust(width), "here" if number == chosen else ink)], width))
    return lines[: max(height, 1)]
