"""Messages in full, and copying texts to the terminal's clipboard."""

from collections.abc import Sequence
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.content import Content
from textual.widgets import OptionList
from textual.widgets.option_list import Option

from rsoconsole.console.actions.seat import OperatorScreen
from rsoconsole.console.dialogs.dialogs import Dialog, dialog_box
from rsoconsole.console.panes.log_pane import LogPane
from rsoconsole.console.tuning.tuning_pane import TunePane
from rsoconsole.night import LogLine
from rsoconsole.words import utc_text

MAX_LOG_LINES = 60
SAID_COLUMNS = 40


def log_line_text(line: LogLine) -> str:
    """Return one line of the log in full, with its time and frame."""
    frame = f" {line.frame_id:04d}" if line.frame_id is not None else ""
    return f"{utc_text(line.t_utc_ns)}{frame} {line.text_with_count}"


class MessageListDialog(Dialog[str | None]):
    """Dialog of messages in full, the newest first. Result: the message to copy, or None."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("ctrl+y", "copy", "Copy", show=False)]
    DEFAULT_CSS = """
    MessageListDialog OptionList { height: auto; border: none; background: $surface; }
    """

    def __init__(self, messages: Sequence[str]) -> None:
        super().__init__()
        self._messages = list(messages)

    def compose(self) -> ComposeResult:
        """Make an option for each message, over as many rows as the message takes."""
        with dialog_box("messages", "↑↓ choose · enter copies · esc back"):
            yield OptionList(*(Option(Content(each)) for each in self._messages))

    def on_mount(self) -> None:
        """Put the cursor on the newest message."""
        self.query_one(OptionList).focus()

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """Close with the chosen message, which copies it."""
        event.stop()
        self.dismiss(self._messages[event.option_index])

    def action_copy(self) -> None:
        """Close with the chosen message, by the key that copies on the screens too."""
        chosen = self.query_one(OptionList).highlighted
        if chosen is not None:
            self.dismiss(self._messages[chosen])


class MessageActions(OperatorScreen):
    """Lists the messages in full, and copies what is shown."""

    def action_read(self) -> None:
        """List all messages in full: a STOP's state, the alert, the last notice, the log."""
        news = self.stop_news
        said = [f"STOP {news.text}"] if news is not None else []
        said += [self.alert_words] if self.alert_words else []
        said += [self.last_said] if self.last_said else []
        said += [log_line_text(line) for line in reversed(self.night.log[-MAX_LOG_LINES:])]
        if said:
            self.app.push_screen(MessageListDialog(said), self._copy)
        else:
            self.say("nothing has been said yet")

    def action_copy(self) -> None:
        """Copy the open log's top line, the tuning pane, the open orbit, or state and figures."""
        if self.is_log_open:
            line = self.query_one(LogPane).top_line
            self._copy(None if line is None else log_line_text(line))
        elif isinstance(self.focused, TunePane):
            self._copy(self.focused.text)
        else:
            names = ("orbit",) if self.is_orbit_open else ("top", "facts")
            self._copy("\n".join(self.pane(name).text for name in names))

    def _copy(self, text: str | None) -> None:
        """Copy a text to the terminal's clipboard, also through SSH (OSC 52)."""
        if not text:
            return
        lines = [line.strip() for line in text.splitlines()]
        self.app.copy_to_clipboard("\n".join(lines))
        more = f" and {len(lines) - 1} more lines" if len(lines) > 1 else ""
        self.say(f"copied, if the terminal allows it: {lines[0][:SAID_COLUMNS]}{more}")
