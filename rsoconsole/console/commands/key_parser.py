"""Keys from a terminal's bytes: an escape and a key right behind it are two keys."""

from collections.abc import Iterable

from textual._xterm_parser import XTermParser
from textual.drivers import linux_driver
from textual.events import Key

ESCAPE = "\x1b"
_BEGINS_MORE = frozenset("[O]P_^X\x1b\t\x7fbf")
"""What continues an escape sequence, or is one key with the escape: alt and an arrow, a tab."""


class KeyParser(XTermParser):
    """Textual's parser, which takes an escape and the key behind it for alt and that key."""

    def _sequence_to_key_events(self, sequence: str, alt: bool = False) -> Iterable[Key]:
        """Yield the keys of a sequence.

        ``alt``: an escape was before it that begins no sequence.
        """
        is_pair = len(sequence) == 2 and sequence[0] == ESCAPE and sequence[1] not in _BEGINS_MORE
        if sequence[-1] == "x" and (is_pair or alt):
            yield Key("alt+x", None)  # STOP, which waits for no escape
            return
        if is_pair or alt:
            yield Key("escape", ESCAPE)
            sequence = sequence[-1]
        yield from super()._sequence_to_key_events(sequence)


def install_parser() -> None:
    """Have Textual's driver use the parser; Textual has no setting for it."""
    linux_driver.XTermParser = KeyParser  # type: ignore[attr-defined]
