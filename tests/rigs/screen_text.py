"""A screen as text that a diff shows: its characters, then the style of each as a letter."""

import io
import os
import string
from itertools import count
from pathlib import Path

from rich.console import Console
from rich.segment import Segment
from rich.style import Style
from textual.app import App

SNAPSHOTS = Path(__file__).parents[1] / "snapshots"
WRITES = "RSOCONSOLE_WRITE_SNAPSHOTS"
"""Set in the environment, snapshots are written; look at them in the diff."""
_LETTERS = string.ascii_letters + string.digits + "".join(map(chr, range(0xC0, 0x250)))


def screen_text(app: App[object]) -> str:
    """What a terminal shows, and a legend of its styles in the order in which they come."""
    width, height = app.size
    console = Console(
        width=width,
        height=height,
        file=io.StringIO(),
        force_terminal=True,
        color_system="truecolor",
        record=True,
        legacy_windows=False,
        safe_box=False,
    )
    update = app.screen._compositor.render_update(full=True, screen_stack=app._background_screens)
    console.print(update)
    shown = Segment.split_lines(Segment.filter_control(console._record_buffer))
    letters: dict[str, str] = {}
    rows, styles = [], []
    for line in shown:
        rows.append("".join(segment.text for segment in line))
        styles.append("".join(_letter(segment, letters) * segment.cell_length for segment in line))
    legend = [f"{letter} {words}" for words, letter in letters.items()]
    # A bar at the end: no editor takes blanks away.
    return "\n".join([*(f"{each}|" for each in (*rows[:height], *styles[:height])), *legend, ""])


def expect_as_agreed(seen: str, name: str) -> None:
    """The same as it was agreed, or agreed from now on where snapshots are written."""
    agreed = SNAPSHOTS / f"{name}.screen"
    if WRITES in os.environ:
        agreed.write_text(seen, encoding="utf-8")
    before = agreed.read_text(encoding="utf-8").splitlines()
    changed = [
        f"{n}: {old!r} is now {new!r}"
        for n, old, new in zip(count(1), before, seen.splitlines(), strict=False)
        if old != new
    ]
    assert not changed, f"{name}: " + "\n".join(changed[:6])
    assert len(before) == len(seen.splitlines()), name


def _letter(segment: Segment, letters: dict[str, str]) -> str:
    words = _words(segment.style or Style.null())
    return letters.setdefault(words, _LETTERS[len(letters)])


def _words(style: Style) -> str:
    kinds = ("bold", "dim", "italic", "underline", "reverse", "strike")
    colours = [each.name if each else "default" for each in (style.color, style.bgcolor)]
    return " ".join([f"{colours[0]} on {colours[1]}", *(k for k in kinds if getattr(style, k))])
