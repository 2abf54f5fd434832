"""What is up now: the satellites of the element files above the limit; one is gone to."""

import logging
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar, Literal

from textual.binding import Binding, BindingType
from textual.message import Message
from textual.widgets import Input

from rsoconsole.base import RsoconsoleError
from rsoconsole.config import Config
from rsoconsole.console.dialogs._list_dialog import ListDialog
from rsoconsole.console.dialogs.ask import UNREAD_CHECK_S
from rsoconsole.console.dialogs.dialogs import Send
from rsoconsole.console.drawing.plot import Ink, Line
from rsoconsole.console.words.words import clipped, first_shown
from rsoconsole.words import clock, span

if TYPE_CHECKING:
    from rsoconsole.pipeline import VisibleSatellite

log = logging.getLogger(__name__)

Order = Literal["altitude", "minutes left", "name"]
ORDERS: tuple[Order, ...] = ("altitude", "minutes left", "name")
SOON_MIN = 15.0
NAME_COLUMNS = 24


class UpFound(Message):
    """What is up, or why that cannot be said."""

    def __init__(
        self, found: "tuple[VisibleSatellite, ...]", t_utc_ns: int, fault: str = ""
    ) -> None:
        super().__init__()
        self.found, self.t_utc_ns, self.fault = found, t_utc_ns, fault


class UpListDialog(ListDialog[str | None, "VisibleSatellite"]):
    """Satellites above the limit; typing finds one. Gives its number, as the go-to takes it."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("tab", "sort", show=False, priority=True),
    ]
    DEFAULT_CSS = """
    UpListDialog > Vertical { width: 78; }
    """
    LISTED = "what is up now"
    KEYS = "↑↓ choose · enter plans a go-to · tab sorts · esc back"
    TO_TYPE = "type a part of a name or number"

    def __init__(self, config: Callable[[], Config | None], now_utc_ns: Callable[[], int]) -> None:
        """``config``: the night's, None until it has been read; ``now_utc_ns``: the frame clock."""
        super().__init__()
        self._config, self._now_utc_ns = config, now_utc_ns
        self._found: tuple[VisibleSatellite, ...] | None = None
        self._t_utc_ns = 0
        self._limit_deg = 0.0
        self._fault = ""
        self._order: Order = "altitude"

    def look(self, send: Send) -> None:
        """Compute it: large catalogues take a second."""
        from rsoconsole.pipeline import read_catalogue, visible_now

        while (config := self._config()) is None:
            time.sleep(UNREAD_CHECK_S)
            if not self.is_running:
                return
        t_utc_ns = self._now_utc_ns()
        files = config.catalogue.tle_files
        if not files:
            fault = "no element files are configured: name some in catalogue.tle_files"
            send(UpFound((), t_utc_ns, fault))
            return
        site, limits = config.site.to_site(), config.limits
        self._limit_deg = limits.min_altitude_deg
        try:
            found = visible_now(read_catalogue(files), site, t_utc_ns, limits)
        except RsoconsoleError as error:
            send(UpFound((), t_utc_ns, str(error)))
        except Exception:  # whatever it is, nobody waits for ever for the list
            log.exception("what is up cannot be computed")
            send(UpFound((), t_utc_ns, "it cannot be computed: the console's log says why"))
        else:
            send(UpFound(found, t_utc_ns))

    def on_up_found(self, message: UpFound) -> None:
        """The list."""
        self._found, self._fault = message.found, message.fault
        self._t_utc_ns = message.t_utc_ns
        self.show()

    @property
    def shown(self) -> "list[VisibleSatellite]":
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

    def result_of(self, row: "VisibleSatellite") -> str:
        """Its number."""
        return str(row.norad_id)

    def action_sort(self) -> None:
        """By altitude, by what sets first, by name."""
        self._order = ORDERS[(ORDERS.index(self._order) + 1) % len(ORDERS)]
        self.show()

    def lines(self, width: int, height: int) -> list[Line]:
        """The satellites, or why there are none."""
        shown: list[VisibleSatellite] = []
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
        return up_lines(head, shown, self._at, width, height)


def up_lines(
    head: str, shown: "list[VisibleSatellite]", chosen: int, width: int, height: int
) -> list[Line]:
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
