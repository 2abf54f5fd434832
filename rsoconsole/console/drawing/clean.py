"""What reaches the terminal from the console's widgets: text, never a command.

The last thing before the terminal: names, notes and reasons by any author pass through it alike,
whichever widget shows them.
"""

import re

from rich.cells import cell_len
from rich.segment import Segment
from textual.color import Color
from textual.filter import LineFilter

_COMMANDS = re.compile(
    "["
    "\x00-\x1f\x7f-\x9f"  # ESC, BEL and their like, and as one byte more
    "\u061c\u200b-\u200f\u202a-\u202e\u2060-\u206f\ufeff"  # turn or hide what stands beside them
    "\u2028\u2029\ufff9-\ufffb\ud800-\udfff\U000e0000-\U000e007f"
    "]"
)
_CURSOR = re.compile(r"\x1b\[\d+;\d+H")
"""What a sixel picture has before and behind it, in a segment without any style."""


def clean(text: str) -> str:
    """The same without commands, as wide as it was."""
    return _COMMANDS.sub(lambda found: " " * cell_len(found.group()), text)


class CleanFilter(LineFilter):
    """Takes the commands out of every line; segments that are commands as a whole are Textual's."""

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:  # noqa: ARG002 -- as Textual asks
        """One line."""
        return [self._clean(segment) for segment in segments]

    def _clean(self, segment: Segment) -> Segment:
        text, style, control = segment
        if control or _COMMANDS.search(text) is None:
            return segment
        if not style and _CURSOR.fullmatch(text):
            return segment
        return Segment(clean(text), style, control)
