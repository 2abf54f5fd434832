"""The dialog that rejects one of the last measurements by its number."""

from collections.abc import Sequence
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical
from textual.events import Key
from textual.widgets import Button, Static

from rsoconsole.console.dialogs.dialogs import Dialog, framed
from rsoconsole.night import LastMeasured
from rsoconsole.words import angle, clock

SOURCES = {"network": "detector", "operator": "by hand"}


def measured_words(each: LastMeasured) -> str:
    """Frame, time, source, sigma, NIS."""
    sigma = f"±{angle(each.sigma_arcsec)}"
    nis = "" if each.nis is None else f"NIS {each.nis:.1f}"
    source = SOURCES.get(each.source, each.source)
    time = clock(each.t_utc_ns)
    return f"frame {each.frame_id:04d}  {time}  {source:<8}  {sigma:>7}  {nis}".rstrip()


class RejectDialog(Dialog[int | None]):
    """Which of the last measurements was something else. Gives its frame's number, or None."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("j", "newest", "The newest", show=False),
        Binding("q", "put_away", "Back", show=False),
    ]

    def __init__(self, measured: Sequence[LastMeasured]) -> None:
        super().__init__()
        self._measured = measured

    def compose(self) -> ComposeResult:
        """One line each, the newest first."""
        with framed("reject a measurement", "1-9 or enter rejects · esc back"):
            words = "Which one was something else? The track is as if without it."
            yield Static(words, markup=False)
            with Vertical(classes="choices"):
                for number, each in enumerate(self._measured, start=1):
                    yield Button(
                        f"{number}  {measured_words(each)}", id=f"measured-{number}", compact=True
                    )

    def on_mount(self) -> None:
        """The newest is proposed."""
        self.query(Button).first().focus()

    def on_button_pressed(self, event: Button.Pressed) -> None:
        """That one."""
        event.stop()
        self._choose(int(str(event.button.id).removeprefix("measured-")))

    def on_key(self, event: Key) -> None:
        """By its number."""
        if event.key.isdigit() and 1 <= int(event.key) <= len(self._measured):
            event.stop()
            self._choose(int(event.key))

    def action_newest(self) -> None:
        """The key that opened this, once more."""
        self._choose(1)

    def _choose(self, number: int) -> None:
        self.dismiss(self._measured[number - 1].frame_id)
