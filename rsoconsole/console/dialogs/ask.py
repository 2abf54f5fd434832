"""Dialogs with text fields: direction, exposure and cadence, aim offset, line of text."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Generic

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.widgets import Input, Static

from rsoconsole.base import RsoconsoleError
from rsoconsole.config import Config
from rsoconsole.console.commands.keymap import Orders
from rsoconsole.console.dialogs.dialogs import Dialog, Result, dialog_box
from rsoconsole.console.watches.messages import call_between_messages
from rsoconsole.control import (
    AimOffset,
    Goto,
    MovePreview,
    Outcome,
    Preview,
    preview_lines,
    read_record,
)

if TYPE_CHECKING:
    from rsoconsole.pipeline import ParsedDirection

GOTO_EXAMPLES = "05 32 11 -4 52 10 · 83.05 -4.87 of date · alt 47 az 201 · SES-10 · M31"

UNREAD = "the night's settings are being read: a moment"
UNREAD_CHECK_S = 0.2
GOES = "enter goes there and stays with the stars: follows nothing, you have the mount"


def _ask_engine(
    dialog: Dialog[Any], orders: Orders, move: Goto | AimOffset, answer: Callable[[Outcome], None]
) -> None:
    """Request the engine's preview of a move; the dialog calls ``answer`` with the outcome."""
    orders.send(Preview(move=move), partial(call_between_messages, dialog, answer))


class FieldDialog(Dialog[Result], Generic[Result]):
    """Base of dialogs with text fields, of which the first has the focus."""

    def on_mount(self) -> None:
        """Give the focus to the first field."""
        self.query(Input).first().focus()


class GotoDialog(FieldDialog[tuple[float, float] | None]):
    """Dialog for a direction to go to, in any notation; previews the path and the limits.

    Enter is accepted once the engine's preview is shown and refuses nothing. Result: (RA, Dec)
    ICRS, degrees; None: cancelled.
    """

    ANSWERS = frozenset(("enter",))

    def __init__(
        self,
        config: Callable[[], Config | None],
        now_utc_ns: Callable[[], int],
        orders: Orders,
        begun: str = "",
        caution: str = "",
    ) -> None:
        """Make the dialog.

        ``config``: returns the night's settings, or None until they are read; typed text waits for
            them.
        ``now_utc_ns``: returns the frame clock, UTC ns; called at every key, since many directions
            move with the sky.
        ``orders``: asks the engine for its preview.
        ``begun``: text already in the field.
        ``caution``: further consequences of going, shown below the preview.
        """
        super().__init__()
        self._caution = caution
        self._begun = begun
        self._config = config
        self._now_utc_ns = now_utc_ns
        self._orders = orders
        self._names: Any = None
        self._asked = 0
        self._preview: MovePreview | None = None
        self._is_asking = False
        """True until the engine's preview of the typed direction is shown."""

    def compose(self) -> ComposeResult:
        """Make the field, and a line that says what the typed text means."""
        with dialog_box("go to", "enter goes · esc back"):
            yield Input(self._begun, placeholder=GOTO_EXAMPLES, id="direction")
            yield Static("", id="understood", markup=False)

    def on_input_changed(self, event: Input.Changed) -> None:
        """Parse the typed text and request the engine's preview of going there."""
        event.stop()
        self._look(event.value)

    def _look(self, text: str) -> None:
        self._preview, self._is_asking = None, False
        self._asked += 1
        if self._config() is None:
            self._say(UNREAD if text.strip() else "")
            self.set_timer(UNREAD_CHECK_S, partial(self._look_again, self._asked, text))
            return
        try:
            self._ask(text)
        except (ValueError, RsoconsoleError) as error:
            self._say(str(error) if text.strip() else "")

    def _look_again(self, number: int, text: str) -> None:
        """Parse the text again, unless something else has been typed meanwhile."""
        if number == self._asked:
            self._look(text)

    def _ask(self, text: str) -> None:
        found = self._understood(text)
        self._is_asking = True
        caution = f"\ncareful: {found.caution}" if found.caution else ""
        self._say(f"{found.words}{caution}\nasking the engine …")

        move = Goto(ra_icrs_deg=found.ra_icrs_deg, dec_icrs_deg=found.dec_icrs_deg)
        answer = partial(self._show_preview, self._asked, f"{found.words}{caution}")
        _ask_engine(self, self._orders, move, answer)

    def _understood(self, text: str) -> "ParsedDirection":
        """Return the direction meant at this instant. Raises ValueError or RsoconsoleError."""
        from rsoconsole.pipeline import TargetNames, parse_direction

        config = self._config()
        if config is None:
            raise ValueError(UNREAD)
        if self._names is None:
            self._names = TargetNames.load(config.catalogue.tle_files)
        return parse_direction(text, config.site.to_site(), self._now_utc_ns(), self._names)

    def _show_preview(self, number: int, words: str, outcome: Outcome) -> None:
        """Show the engine's preview of the last direction typed."""
        if number != self._asked:
            return
        self._is_asking = False
        if not outcome.ok:
            self._say(f"{words}\n{outcome.message}")
            return
        self._preview = preview = read_record(MovePreview, outcome.data)
        self.note_question()
        caution = [self._caution] if self._caution and preview and not preview.refused else []
        self._say("\n".join([words, *preview_lines(preview, GOES), *caution]))

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Close with the typed direction, if the engine's preview is shown and refuses nothing."""
        event.stop()
        preview = self._preview
        if preview is None:
            if self._is_asking:
                self.say_too_early("enter")
            return
        if preview.refused:
            self.app.bell()
            return
        try:
            found = self._understood(event.value)
        except (ValueError, RsoconsoleError) as error:
            self._say(str(error))
            return
        self.dismiss((found.ra_icrs_deg, found.dec_icrs_deg))

    def _say(self, text: str) -> None:
        self.query_one("#understood", Static).update(text)


class MoveDialog(Dialog[bool | None]):
    """Dialog that previews the move to a streak and asks whether to go. Result: True or None."""

    ANSWERS = frozenset(("enter",))
    BINDINGS: ClassVar[list[BindingType]] = [Binding("enter", "go", "Go")]

    def __init__(self, direction: tuple[float, float], caution: str, orders: Orders) -> None:
        """``direction``: (RA, Dec) ICRS, degrees; ``caution``: further consequences of going."""
        super().__init__()
        self._direction, self._caution, self._orders = direction, caution, orders
        self._may_go = False

    def compose(self) -> ComposeResult:
        """Make the line for the engine's preview."""
        with dialog_box("centre the streak", "enter goes · esc back"):
            yield Static("asking the engine …", id="told", markup=False)

    def on_mount(self) -> None:
        """Request the engine's preview at once."""
        ra, dec = self._direction
        move = Goto(ra_icrs_deg=ra, dec_icrs_deg=dec)
        _ask_engine(self, self._orders, move, self._show_preview)

    def _show_preview(self, outcome: Outcome) -> None:
        preview = read_record(MovePreview, outcome.data) if outcome.ok else None
        lines = preview_lines(preview, GOES) if outcome.ok else [outcome.message]
        self._may_go = preview is not None and not preview.refused
        rows = [*lines, *([self._caution] if self._caution else [])]
        self.query_one("#told", Static).update("\n".join(rows))
        self.note_question()

    def action_go(self) -> None:
        """Close with True, if the engine's preview is shown and refuses nothing."""
        if self._may_go:
            self.dismiss(True)
        else:
            self.app.bell()


class SettingsDialog(FieldDialog[dict[str, float] | None]):
    """Dialog with a number field for each setting of ``NAMES``.

    Result: the changed values by the setting's name; None: cancelled.
    """

    HEAD: ClassVar[str]
    NAMES: ClassVar[dict[str, str]]
    """Label of each field, by the setting's name."""

    def __init__(self, present: Mapping[str, Any]) -> None:
        super().__init__()
        self._present = present

    def compose(self) -> ComposeResult:
        """Make a labelled field for each setting."""
        with dialog_box(self.HEAD, "enter takes them · tab the next field · esc back"):
            for name, words in self.NAMES.items():
                yield Static(words, markup=False)
                yield Input(
                    f"{self._present.get(name, '')}", id=name.replace(".", "-"), compact=True
                )
            yield Static("", id="told", markup=False)

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Close with the values that were changed."""
        event.stop()
        wanted = self._wanted()
        if wanted is not None:
            self.dismiss({n: v for n, v in wanted.items() if v != self._present.get(n)})

    def _wanted(self) -> dict[str, float] | None:
        """Return the fields' numbers; None, with a notice, where a field holds no number."""
        wanted: dict[str, float] = {}
        for name, words in self.NAMES.items():
            text = self.query_one(f"#{name.replace('.', '-')}", Input).value.strip()
            try:
                wanted[name] = float(text.replace("−", "-"))
            except ValueError:
                self._say(f"{words}: {text!r} is no number")
                return None
        return wanted

    def _say(self, text: str) -> None:
        self.query_one("#told", Static).update(text)


class ExposureDialog(SettingsDialog):
    """Dialog for exposure and cadence, seconds."""

    HEAD = "exposure and cadence"
    NAMES: ClassVar[dict[str, str]] = {
        "exposure.exposure_s": "exposure, s",
        "exposure.cadence_s": "cadence, s",
    }

    def _wanted(self) -> dict[str, float] | None:
        """Return both numbers; None where the exposure is not shorter than the cadence."""
        wanted = super()._wanted()
        if wanted and not wanted["exposure.exposure_s"] < wanted["exposure.cadence_s"]:
            self._say("the cadence is from start to start: longer than the exposure")
            return None
        return wanted


class AimDialog(SettingsDialog):
    """Dialog for an offset from the predicted position; previews its direction and the limits."""

    HEAD = "aim beside the prediction"
    NAMES: ClassVar[dict[str, str]] = {
        "aim.lead_s": "ahead in time, s; below 0 behind it",
        "aim.along_arcmin": "along the motion, arcmin",
        "aim.across_arcmin": "across it to the left, seen on the sky, arcmin",
    }

    def __init__(self, present: Mapping[str, Any], orders: Orders) -> None:
        super().__init__(present)
        self._orders = orders
        self._asked = 0

    def on_input_changed(self, event: Input.Changed) -> None:
        """Request the engine's preview of the typed offset."""
        event.stop()
        self._asked += 1
        wanted = self._wanted()
        if wanted is None:
            return
        aim = {name.partition(".")[2]: value for name, value in wanted.items()}
        _ask_engine(self, self._orders, AimOffset(**aim), partial(self._show_preview, self._asked))

    def _show_preview(self, number: int, outcome: Outcome) -> None:
        """Show the engine's preview of the last offset typed."""
        if number != self._asked:
            return
        if not outcome.ok:
            self._say(outcome.message)
            return
        ending = "enter looks there from the next exposure on"
        self._say("\n".join(preview_lines(read_record(MovePreview, outcome.data), ending)))


class LineDialog(FieldDialog[str | None]):
    """Dialog for one line of text, which is the result and may be empty; None: cancelled."""

    def __init__(self, title: str, words: str, value: str = "", *, goes_on: bool = False) -> None:
        """Make the dialog.

        ``words``: the field's hint while it is empty.
        ``value``: text already in the field.
        ``goes_on``: True where typing continues ``value``, False where it replaces it.
        """
        super().__init__()
        self._goes_on = goes_on
        self._title, self._words, self._value = title, words, value

    def compose(self) -> ComposeResult:
        """Make the field."""
        with dialog_box(self._title, "enter takes it · esc back"):
            yield Input(
                self._value, placeholder=self._words, id="line", select_on_focus=not self._goes_on
            )

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Close with the line in the field."""
        event.stop()
        self.dismiss(event.value.strip())
