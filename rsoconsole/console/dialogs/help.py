"""The help: the keys of this moment, every command by group, the signs, and the terms."""

import textwrap
from collections.abc import Mapping
from typing import ClassVar

from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll

from rsoconsole.console.commands.command import GROUPS, Place
from rsoconsole.console.commands.commands import commands_in
from rsoconsole.console.commands.glossary import glossary_text
from rsoconsole.console.commands.keymap import key_words
from rsoconsole.console.dialogs.dialogs import PagedDialog
from rsoconsole.console.panes.last_line import MODE_KEYS, MODE_WORDS, Mode

HELP_COLUMNS = 70
SIGNS = """\
State      IDLE waits to be armed, SEARCH looks, ACQUIRE has one frame,
           TRACK measures, COAST predicts, MANUAL is yours, LOST, FAULT
Picture    [━] followed   (━) other detections   ‹ › rejected, from near
           < > by your hand   + where it was expected, · 3 sigma about it
           1 2* several tracks, * the lead   ○3 not seen in this frame
           in an opened frame { } detected now   « » rejected now
Plots      ● measured, ░ within 3 sigma, ○ nothing measured, │ a setting
           changed, ╌ τ, or 3 sigma as tried; ▲ ▼ a measurement beyond the
           axis, △ ▽ a bound beyond it; the newest frame at the right
Times are UTC; under simulation they are the observatory's own."""
REVIEW_SIGNS = """\
Time line  the night from its first record to its last; its words are states,
           ┃ is here, A the moment kept to compare with, ░ not read yet
           ○ miss   × refused   ▼ lost   ▲ operator   ✎ note   ! alarm   / found
           ▫ the frame's pixels are kept: enter opens it at full resolution
           a cell of many frames shows what a quarter of them have; the mouse
           goes where it is clicked or drawn"""


def help_text(
    keymap: Mapping[str, str] | None = None, mode: Mode = "live", place: Place = "live"
) -> str:
    """Return the help's first page: the keys that work now, every command by group, the signs.

    ``keymap``: keys that replace the default ones, by the command's name.
    ``mode``: what the keys mean now.
    ``place``: the live screen or a review.
    """
    lines: list[str] = []
    if MODE_WORDS[mode]:
        lines.append(MODE_WORDS[mode])
        for key in MODE_KEYS[mode]:
            lines += textwrap.wrap(
                key.words or key.name,
                HELP_COLUMNS,
                initial_indent=f"  {key.key:<9}",
                subsequent_indent=" " * 11,
            )
        lines.append("")
    for group, title in GROUPS.items():
        here = [command for command in commands_in(place) if command.group == group]
        if not here:
            continue
        lines.append(title)
        for command in here:
            if command.name != "stop_by_letter":
                keys = (keymap or {}).get(command.name, command.keys)
                shown = f"x {key_words(keys)}" if command.name == "stop" else key_words(keys)
                words = f"{command.title}: {command.help}"
                lines += textwrap.wrap(
                    words, HELP_COLUMNS, initial_indent=f"  {shown:<9}", subsequent_indent=" " * 11
                )
        lines.append("")
    signs = SIGNS if place == "live" else f"{SIGNS}\n{REVIEW_SIGNS}"
    return "\n".join([*lines, f"  {'^p':<9}every command by name", "", signs])


class HelpDialog(PagedDialog[str | None]):
    """Dialog of the help: keys and signs on one page, terms on the other.

    Result: "tour" where the tour is to be shown next, else None.
    """

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("question_mark,f1,q", "put_away", "Back", show=False),
        Binding("tab,g,left,right", "other_page", "Terms"),
        Binding("t", "tour", "Tour"),
        Binding("up", "scroll(-1)", show=False),
        Binding("down", "scroll(1)", show=False),
        Binding("pageup", "page(-1)", show=False),
        Binding("pagedown,space", "page(1)", show=False),
        Binding("home", "end(False)", show=False),
        Binding("end", "end(True)", show=False),
    ]

    def __init__(
        self, keymap: Mapping[str, str] | None = None, mode: Mode = "live", place: Place = "live"
    ) -> None:
        super().__init__()
        self._pages = {
            "keys and signs": help_text(keymap, mode, place),
            "terms": glossary_text(HELP_COLUMNS),
        }
        self._shown = "keys and signs"

    @property
    def _other(self) -> str:
        return next(name for name in self._pages if name != self._shown)

    def action_other_page(self) -> None:
        """Show the other page: keys and signs, or terms."""
        self._shown = self._other
        self.show()
        self.query_one(VerticalScroll).scroll_home(animate=False, immediate=True)

    def action_scroll(self, by: int) -> None:
        """Scroll down by ``by`` lines; a negative number scrolls up."""
        self.query_one(VerticalScroll).scroll_relative(y=by, animate=False, immediate=True)

    def action_page(self, by: int) -> None:
        """Scroll down by ``by`` pages; a negative number scrolls up."""
        box = self.query_one(VerticalScroll)
        box.scroll_relative(y=by * max(box.size.height - 1, 1), animate=False, immediate=True)

    def action_end(self, is_last: bool) -> None:
        """Scroll to the first line, or with ``is_last`` to the last one."""
        box = self.query_one(VerticalScroll)
        (box.scroll_end if is_last else box.scroll_home)(animate=False, immediate=True)

    def action_tour(self) -> None:
        """Close with "tour", which starts the tour of the screen."""
        self.dismiss("tour")

    def page(self) -> tuple[str, str, str]:
        """Return the title, the keys and the text of the present page."""
        keys = f"tab {self._other} · t tour · esc back"
        return f"help: {self._shown}", keys, self._pages[self._shown]
