"""The same screen for terminals that know letters only: every sign becomes one ASCII character.

The last thing before the terminal: panes, dialogs and pictures pass through it alike.
"""

import unicodedata

from rich.color import Color as RichColor
from rich.segment import Segment
from textual.color import Color
from textual.filter import LineFilter

_SIGNS = str.maketrans(
    {
        **dict(zip("─━┄┈╌═╴╶", "--------", strict=True)),
        **dict(zip("│┃┆┊╎║╷╵▌▐▎▍▋▊▉", "|" * 15, strict=True)),
        **dict.fromkeys("┌┐└┘├┤┬┴┼╭╮╰╯╋╔╗╚╝╠╣╦╩╬", "+"),
        **dict(zip("▁▂▃▄▅▆▇█", "_..--=##", strict=True)),
        **dict(zip("αδστ″′²³°±×·…•∙○●◆☾☼▸✓✗", "adst\"'23o~x.~*.oo#CO>yn", strict=True)),
        **dict(zip("↑↓←→↗↘↙↖▲▼‹›▔", "^v<>/\\/\\^v<>-", strict=True)),
        **dict(zip("╍░✎═", "~%n=", strict=True)),
        **dict(zip("«»▾▴◂", "<>v^<", strict=True)),
        "▀": "#",
    }
)
_RAMP = " .:-=+*#%@"
"""From dark to bright: what a square of a picture becomes."""
_BRAILLE = range(0x2800, 0x2900)
_UPPER_DOTS = 0x01 | 0x02 | 0x08 | 0x10
HALF_BLOCK = "▀"


def plain(text: str) -> str:
    """ASCII of the same length."""
    return "".join(c if c.isascii() else _one(c) for c in text.translate(_SIGNS))


def _one(character: str) -> str:
    code = ord(character)
    if code in _BRAILLE:
        dots = code - _BRAILLE.start
        if not dots:
            return " "
        is_fat = dots.bit_count() > 2
        is_upper = bool(dots & _UPPER_DOTS) and not dots & ~_UPPER_DOTS
        return ("*" if is_upper else "o") if is_fat else ("'" if is_upper else ".")
    base = unicodedata.normalize("NFKD", character)[0]
    return base if base.isascii() and base.isprintable() else "?"


class PlainFilter(LineFilter):
    """Turns every line into ASCII; squares of pictures by their light."""

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:  # noqa: ARG002 -- as Textual asks
        """One line."""
        return [self._plain(segment) for segment in segments]

    def _plain(self, segment: Segment) -> Segment:
        text, style, control = segment
        if control or text.isascii():
            return segment
        if style is not None and set(text) == {HALF_BLOCK}:
            light = (_light(style.color) + _light(style.bgcolor)) / 2.0
            sign = _RAMP[min(int(light * len(_RAMP)), len(_RAMP) - 1)]
            return Segment(sign * len(text), style, control)
        return Segment(plain(text), style, control)


def _light(colour: RichColor | None) -> float:
    """From 0 to 1; dark where there is no colour to tell."""
    if colour is None:
        return 0.0
    red, green, blue = colour.get_truecolor()
    return max(red, green, blue) / 255.0
