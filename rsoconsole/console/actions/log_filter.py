"""The filter of the log: which of its lines are seen."""

from collections.abc import Callable

from rsoconsole.console.actions.seat_uses import LookingSeat
from rsoconsole.console.dialogs import LineDialog
from rsoconsole.console.panes import LogPane


class LogFilter:
    """Only lines with some words, or every line again."""

    def __init__(self, seat: LookingSeat, pane: Callable[[], LogPane]) -> None:
        self._seat, self._pane = seat, pane

    def clear(self) -> None:
        """Every line again."""
        self._pane().filter("")
        self._seat.say("log: every line")

    def action_filter_log(self) -> None:
        """Only lines with some words."""

        def decided(wanted: str | None) -> None:
            if wanted is None:
                return
            self._pane().filter(wanted)
            self._seat.say(
                f"log: lines with {wanted!r}, changes of state and alarms"
                if wanted
                else "log: every line"
            )

        present = self._pane().wanted
        self._seat.ask(LineDialog("filter the log", "nothing: every line", present), decided)
