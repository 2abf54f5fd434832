"""Dialog of the satellites above the altitude limit, to choose the target of a go-to."""

import logging
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, ClassVar, Literal

from textual.binding import Binding, BindingType
from textual.widgets import Input

from rsoconsole.base import RsoconsoleError
from rsoconsole.config import Config
from rsoconsole.console.dialogs._list_dialog import ListDialog
from rsoconsole.console.dialogs.ask import UNREAD_CHECK_S
from rsoconsole.console.drawing.plot import Ink
from rsoconsole.console.watches.messages import call_between_messages
from rsoconsole.words import count_words, duration_words, utc_text

if TYPE_CHECKING:
    from rsoconsole.orbits import StandardMagnitude
    from rsoconsole.pipeline import VisibleSatellite

log = logging.getLogger(__name__)

Order = Literal["altitude", "minutes left", "name"]
ORDERS: tuple[Order, ...] = ("altitude", "minutes left", "name")
SOON_MIN = 15.0
NAME_COLUMNS = 24


class VisibleSatellitesDialog(ListDialog[str | None, "VisibleSatellite"]):
    """Dialog of satellites above the limit, to choose one. Result: its catalogue number."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("tab", "sort", show=False, priority=True)]
    DEFAULT_CSS = """
    UpListDialog > Vertical { width: 78; }
    """
    LISTED = "what is up now"
    KEYS = "↑↓ choose · enter plans a go-to · tab sorts · esc back"
    TO_TYPE = "type a part of a name or number"

    def __init__(self, config: Callable[[], Config | None], now_utc_ns: Callable[[], int]) -> None:
        """``config``: returns the night's settings, None until read; ``now_utc_ns``: the clock."""
        super().__init__()
        self._config, self._now_utc_ns = config, now_utc_ns
        self._found: tuple[VisibleSatellite, ...] | None = None
        self._standard: Mapping[int, StandardMagnitude] = {}
        self._t_utc_ns = 0
        self._limit_deg = 0.0
        self._not_used = 0
        self._fault = ""
        self._order: Order = "altitude"

    def load_rows(self) -> None:
        """Compute the list, which takes a second for large catalogues; runs on a thread.

        It waits there until the night's settings are read.
        """
        from rsoconsole.pipeline import read_catalogue, visible_satellites

        while (config := self._config()) is None:
            time.sleep(UNREAD_CHECK_S)
            if not self.is_running:
                return
        t_utc_ns = self._now_utc_ns()
        files = config.catalogue.tle_files
        if not files:
            fault = "no element files are configured: name some in catalogue.tle_files"
            call_between_messages(self, self._list_satellites, (), t_utc_ns, fault)
            return
        site, limits = config.site.to_site(), config.limits
        self._limit_deg = limits.min_altitude_deg
        found: tuple[VisibleSatellite, ...] = ()
        fault = ""
        self._standard = _standard_magnitudes()
        try:
            sets = read_catalogue(files)
            self._not_used = len(sets.not_used)
            found = visible_satellites(sets.entries, site, t_utc_ns, limits)
        except RsoconsoleError as error:
            fault = str(error)
        except Exception:  # whatever it is, nobody waits for ever for the list
            log.exception("what is up cannot be computed")
            fault = "it cannot be computed: the console's log says why"
        call_between_messages(self, self._list_satellites, found, t_utc_ns, fault)

    def _list_satellites(
        self, found: "tuple[VisibleSatellite, ...]", t_utc_ns: int, fault: str
    ) -> None:
        self._found, self._t_utc_ns, self._fault = found, t_utc_ns, fault
        self.show()

    @property
    def matching_rows(self) -> "list[VisibleSatellite]":
        """The satellites that match the typed words, in the chosen order."""
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

    def row_result(self, row: "VisibleSatellite") -> str:
        """Return the satellite's catalogue number as text."""
        return str(row.norad_id)

    def action_sort(self) -> None:
        """Sort by the next of three orders: altitude, time left above the limit, name."""
        self._order = ORDERS[(ORDERS.index(self._order) + 1) % len(ORDERS)]
        self.show()

    def header_line(self, width: int) -> str:  # noqa: ARG002 -- the same however wide
        """Return the number of listed satellites and the list's time, or why there is none."""
        if self._found is None:
            return "computing …"
        return self._fault or (
            f"{len(self.matching_rows)} of {len(self._found)} above {self._limit_deg:g}°"
            f" at {utc_text(self._t_utc_ns)}, by {self._order}"
            + (f"; {count_words(self._not_used, 'element set')} not used" * bool(self._not_used))
        )

    def row_words(self, row: "VisibleSatellite", width: int) -> tuple[str, Ink]:  # noqa: ARG002
        """Return a row: the satellite's name, direction, time left above the limit; and its ink.

        With its predicted magnitude, where the user's nights know how bright it is.
        """
        from rsoconsole.pipeline import predicted_magnitude

        mag = predicted_magnitude(row, self._standard)
        light = "" if mag is None else f"mag {mag[0]:.1f}"
        left = "12 h +" if row.minutes_left is None else duration_words(row.minutes_left * 60.0)
        is_soon = row.minutes_left is not None and row.minutes_left < SOON_MIN
        text = (
            f"{row.name[:NAME_COLUMNS]:<{NAME_COLUMNS}}"
            f" {row.norad_id:>6}  alt {row.alt_deg:4.1f} az {row.az_deg:5.1f}"
            f"  up {left:>6}  {light if row.is_lit else 'in shadow'}"
        )
        return text, "warn" if is_soon else "" if row.is_lit else "dim"


def _standard_magnitudes() -> "Mapping[int, StandardMagnitude]":
    """Return those of the user's ledger; none where it cannot be read."""
    from rsoconsole.session import element_ledger_path, read_element_ledger

    try:
        return read_element_ledger(element_ledger_path()).standard_magnitudes()
    except RsoconsoleError:
        log.exception("how bright satellites are cannot be read")
        return {}
