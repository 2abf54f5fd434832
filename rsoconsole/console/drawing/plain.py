"""ASCII forms of the screen, removal of control characters, and the colour themes."""

import re
import unicodedata
from collections.abc import Sequence

from rich.cells import cell_len
from rich.color import Color as RichColor
from rich.segment import Segment
from textual.color import Color
from textual.filter import LineFilter
from textual.theme import Theme

_SIGNS = str.maketrans(
    {
        **dict(zip("─━┄┈╌═╴╶", "--------", strict=True)),
        **dict(zip("│┃┆┊╎║╷╵▌▐▎▍▋▊▉", "|" * 15, strict=True)),
        **dict.fromkeys("┌┐└┘├┤┬┴┼╭╮╰╯╋╔╗╚╝╠╣╦╩╬", "+"),
        **dict(zip("▁▂▃▄▅▆▇█", "_..--=##", strict=True)),
        **dict(zip("αδστ″′²³°±×·…•∙○●◉✶◆☾☼▸✓✗", "adst\"'23d~x.~o.o*O*#CO>yn", strict=True)),
        **dict(zip("↑↓←→↗↘↙↖▲▼‹›▔", "^v<>/\\/\\^v<>-", strict=True)),
        **dict(zip("╍░✎═△▽", "~:n=AV", strict=True)),
        **dict(zip("«»▾▴◂▫", "<>v^<.", strict=True)),
        **dict(zip("▀╱╲Δ−µ", "#/\\D-u", strict=True)),
    }
)
SPELLED = {"±": "+-", "σ": "sig", "τ": "tau", "α": "RA", "δ": "Dec"}
"""Signs that ASCII spells out, since a single letter would mean something else."""
_WIDE_GAP = {n: re.compile(f" {{{n + 1},}}|─{{{n + 2},}}") for n in (1, 2)}
_RAMP = " .:-=+*#%@"
_BRAILLE = range(0x2800, 0x2900)
_FAT = (0x01 | 0x08, 0x02 | 0x10, 0x04 | 0x20, 0x40 | 0x80)
"""Pairs of braille dots side by side: a fat dot, or the part of it in one cell."""
_UPPER_DOTS = 0x01 | 0x02 | 0x08 | 0x10
HALF_BLOCK = "▀"


def to_ascii(text: str) -> str:
    """Return the text in ASCII, each character replaced by exactly one."""
    return "".join(c if c.isascii() else _one(c) for c in text.translate(_SIGNS))


def _one(character: str) -> str:
    code = ord(character)
    if code in _BRAILLE:
        dots = code - _BRAILLE.start
        if not dots:
            return " "
        if any(dots & pair == pair for pair in _FAT):
            # What was measured: never the sign of what was missed.
            return "*"
        is_upper = bool(dots & _UPPER_DOTS) and not dots & ~_UPPER_DOTS
        return "'" if is_upper else "."
    base = unicodedata.normalize("NFKD", character)[0]
    return base if base.isascii() and base.isprintable() else "?"


def spell_out_signs(texts: Sequence[str]) -> list[str]:
    """Return a line's pieces in ASCII with the signs of ``SPELLED`` spelled out.

    The line keeps its length: the columns that a spelled sign takes come from blanks and rules.
    They are taken right before the sign, so that the text behind keeps its place; else behind the
    sign, else earlier, else from the line's end.
    """
    line = "".join(texts)
    owners = [number for number, text in enumerate(texts) for _ in text]
    cells: list[tuple[str, int]] = list(zip(line, owners, strict=True))
    at = 0
    while at < len(cells):
        sign, owner = cells[at]
        words = SPELLED.get(sign)
        if words is None:
            at += 1
            continue
        gap, more = _gap(cells, at, len(words) - 1), len(words) - 1
        if gap is None:
            gap = len(cells)
        cells[at : at + 1] = [(letter, owner) for letter in words]
        first = gap if gap < at else min(gap + more, len(cells) - more)
        del cells[first : first + more]
        at += len(words) if gap > at else 1
    made = [""] * len(texts)
    for letter, owner in cells:
        made[owner] += letter
    return [to_ascii(text) for text in made]


def _gap(cells: Sequence[tuple[str, int]], at: int, wanted: int) -> int | None:
    """Return the index from which ``wanted`` cells can be taken out of a gap; None: no such gap."""
    line = "".join(sign for sign, _ in cells)
    before = line[:at]
    width = len(before) - len(before.rstrip(" "))
    if width > wanted:
        return at - width
    behind = _WIDE_GAP[wanted].search(line, at + 1)
    if behind is not None:
        return behind.start() + 1
    earlier = list(_WIDE_GAP[wanted].finditer(before))
    return earlier[-1].start() + 1 if earlier else None


class AsciiFilter(LineFilter):
    """Turns every line into ASCII; squares of pictures become characters by their brightness."""

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:  # noqa: ARG002 -- as Textual asks
        """Return one line in ASCII."""
        words = [index for index, segment in enumerate(segments) if not segment.control]
        if any(HALF_BLOCK in segments[index].text for index in words):
            # Beside a picture nothing may move.
            return [self._plain(segment) for segment in segments]
        texts = spell_out_signs([segments[index].text for index in words])
        text_of = dict(zip(words, texts, strict=True))
        return [
            Segment(text_of[index], segment.style, segment.control)
            if index in text_of
            else self._plain(segment)
            for index, segment in enumerate(segments)
        ]

    def _plain(self, segment: Segment) -> Segment:
        text, style, control = segment
        if control or text.isascii():
            return segment
        if style is not None and set(text) == {HALF_BLOCK}:
            light = (_light(style.color) + _light(style.bgcolor)) / 2.0
            sign = _RAMP[min(int(light * len(_RAMP)), len(_RAMP) - 1)]
            return Segment(sign * len(text), style, control)
        return Segment(to_ascii(text), style, control)


def _light(colour: RichColor | None) -> float:
    """Return the brightness of a colour, 0 to 1; 0 for no colour."""
    if colour is None:
        return 0.0
    red, green, blue = colour.get_truecolor()
    return max(red, green, blue) / 255.0


_COMMANDS = re.compile(
    "["
    "\x00-\x1f\x7f-\x9f"  # ESC, BEL and their like, and as one byte more
    "\u061c\u200b-\u200f\u202a-\u202e\u2060-\u206f\ufeff"  # turn or hide what stands beside them
    "\u2028\u2029\ufff9-\ufffb\ud800-\udfff\U000e0000-\U000e007f"
    "]"
)
_CURSOR = re.compile(r"\x1b\[\d+;\d+H")
"""Cursor command before and behind a sixel picture, in a segment without any style."""


def without_terminal_commands(text: str) -> str:
    """Return the text without control characters, as wide as before.

    Each is replaced by as many blanks as it has columns, most of them by none. Characters that turn
    or hide the text beside them count as control characters too.
    """
    return _COMMANDS.sub(lambda found: " " * cell_len(found.group()), text)


class ControlCharacterFilter(LineFilter):
    """Filter that removes control characters, also those of terminal commands inside text.

    Only a segment that is a command as a whole stays: one marked as control, or the cursor command
    beside a sixel picture, in a segment without style.
    """

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:  # noqa: ARG002 -- as Textual asks
        """Return one line without control characters."""
        return [self._clean(segment) for segment in segments]

    def _clean(self, segment: Segment) -> Segment:
        text, style, control = segment
        if control or _COMMANDS.search(text) is None:
            return segment
        if not style and _CURSOR.fullmatch(text):
            return segment
        return Segment(without_terminal_commands(text), style, control)


NIGHT = "night"


def _track_colours(*colours: str) -> dict[str, str]:
    return {f"track-{n}": colour for n, colour in enumerate(colours)}


TRACK_COLOURS = _track_colours("#9a7000", "#1f78b8", "#2a8a3a", "#a44fb4", "#b85f1a", "#6464c8")
"""Colours of the tracks' numbers as variables, for a theme that may be light."""
_BRIGHT = _track_colours("#ffd75f", "#5fd7ff", "#87ff87", "#ff87ff", "#ffaf5f", "#afafff")
"""Colour of a track in a dark theme, and over a picture in any theme but night."""

THEMES = (
    Theme(
        name="dark",
        primary="#8fa8c8",
        secondary="#7f8fa8",
        success="#6fbf73",
        warning="#e0b050",
        error="#e06058",
        foreground="#d0d0d0",
        background="#101014",
        surface="#1a1a20",
        panel="#24242c",
        dark=True,
        variables=_BRIGHT,
    ),
    Theme(
        name="light",
        primary="#2c4a72",
        secondary="#4a6080",
        success="#1f6e2a",
        warning="#8a5a00",
        error="#a81e1e",
        foreground="#1c1c20",
        background="#fafaf6",
        surface="#f0efe8",
        panel="#e2e0d6",
        dark=False,
    ),
    Theme(
        name=NIGHT,
        primary="#8a1a10",
        secondary="#6a140c",
        success="#a02818",
        warning="#b83420",
        error="#d84028",
        foreground="#a02818",
        background="#000000",
        surface="#100302",
        panel="#1a0604",
        dark=True,
        variables={
            "text-muted": "#6a180e",
            "text-success": "#b03020",
            "text-warning": "#c83c28",
            "text-error": "#e04830",
            "text": "#b03020",
            **_track_colours("#e86850", "#b03020", "#d84028", "#982414", "#c83c28", "#802010"),
        },
    ),
)
COLOURS = {
    "dark": "dark",
    "night": "night: deep red only",
    "ansi-dark": "the terminal's own sixteen, dark",
    "ansi-light": "the terminal's own sixteen, light",
    "light": "light",
}
"""Themes that ctrl+t goes through, with their names; red comes early, white last."""

NIGHT_CSS = """
ConsoleApp.-theme-night FramePane > .frame--followed { color: #d84028; }
ConsoleApp.-theme-night FramePane > .frame--member { color: #d84028; }
ConsoleApp.-theme-night FramePane > .frame--candidate { color: #d84028; }
ConsoleApp.-theme-night FramePane > .frame--rejected { color: #8a1a10; }
ConsoleApp.-theme-night FramePane > .frame--operator { color: #b03020; }
ConsoleApp.-theme-night FramePane > .frame--predicted { color: #c83c28; }
ConsoleApp.-theme-night FramePane > .frame--coasted { color: #b03020; }
ConsoleApp.-theme-night FramePane > .frame--now { color: #c83c28; }
ConsoleApp.-theme-night FramePane > .frame--now_rejected { color: #b83420; }
ConsoleApp.-theme-night FramePane > .frame--box { color: #8a1a10; }
ConsoleApp.-theme-night FramePane > .frame--star { color: #a02818; }
ConsoleApp.-theme-night FramePane > .frame--cursor { color: #e04830; }
"""
"""Colours of the picture's marks in the night theme; they are bright in other themes."""

TRACK_CSS = "\n".join(
    f"FramePane > .frame--track_{n} {{ color: {bright}; text-style: bold; }}\n"
    f"ConsoleApp.-theme-night FramePane > .frame--track_{n} {{ color: $track-{n}; }}"
    for n, bright in enumerate(_BRIGHT.values())
)
"""Colours of the tracks' numbers in a picture."""
