"""Values of a header's cards as numbers, in whatever form others write them.

A value that cannot be used is never dropped silently: it becomes a note.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

from rsoconsole.records import UNITS_KEY

SECONDS: Mapping[str, float] = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "usec", "µs", "μs", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
}
"""Units of time that may stand behind a number, in seconds."""
MILLIMETRES: Mapping[str, float] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4, "inch": 25.4}
"""Units of a focal length, in mm."""
MICROMETRES: Mapping[str, float] = {
    **dict.fromkeys(("um", "µm", "μm", "micron", "microns", "micrometer", "micrometers"), 1.0),
    "mm": 1000.0,
    "nm": 1e-3,
}
"""Units of a pixel's size, in um."""
METRES: Mapping[str, float] = {
    **dict.fromkeys(("m", "metre", "metres", "meter", "meters"), 1.0),
    "km": 1000.0,
    **dict.fromkeys(("ft", "foot", "feet"), 0.3048),
}
"""Units of an elevation, in m."""
DEGREES: Mapping[str, float] = {
    **dict.fromkeys(("deg", "degs", "degree", "degrees", "d", "°"), 1.0),
    "rad": 57.29577951308232,
}
"""Units of an angle, in degrees."""
REPEATED_KEY = "REPEATED KEYWORDS"
"""Key for the further values of keywords that stand more than once, as a tuple by keyword."""
COMMENT_UNIT = re.compile(r"\s*\[\s*([^\W\d_]{1,20})\s*\]")
"""Unit at the beginning of a comment."""

_PART = r"(?:[0-9]{1,20}(?:[.,][0-9]{0,30})?|[.,][0-9]{1,30})"
_NUMBER = re.compile(rf"([+-]?{_PART}(?:[eEdD][+-]?[0-9]{{1,3}})?)\s*([^\W\d_]*)\.?")
_FRACTION = re.compile(rf"({_PART})\s*/\s*({_PART})\s*([^\W\d_]*)")
_THOUSANDS = re.compile(r"[+-]?[1-9][0-9]{0,2},[0-9]{3}\s*[^\W\d_]*")
"""Text that may have a decimal comma or one of thousands."""
_HUGE = 1e30
_MAX_BITS = 64
_MAX_SHOWN = 40


@dataclass(frozen=True, slots=True, kw_only=True)
class WrittenNumber:
    """A number as a card has it."""

    value: Decimal
    may_be_thousands: bool
    """True where its comma may stand for thousands, as in '10,000'."""


def written_number(
    value: object, units: Mapping[str, float] | None = None, plain: float = 1.0
) -> WrittenNumber | None:
    """Return the number that a card's value is or spells; None where it is none.

    Text may have a decimal comma, an exponent with D, and where ``units`` are given one of these
    behind it, or be a fraction ('1/4'). Text with both a point and a comma is no number: nothing
    is assumed about thousands. ``plain``: unit of a number without one.
    """
    if isinstance(value, str):
        return _spelt(value.strip(), units, plain)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _HUGE:
        return None
    exact = Decimal(value) if isinstance(value, int) else _exact(value)
    return WrittenNumber(value=exact * _exact(plain), may_be_thousands=False)


def _spelt(text: str, units: Mapping[str, float] | None, plain: float) -> WrittenNumber | None:
    whole = _NUMBER.fullmatch(text)
    parts = None if whole is not None or units is None else _FRACTION.fullmatch(text)
    found = whole or parts
    unit = "" if found is None else found[found.re.groups].lower()
    if found is None or (unit and unit not in (units or {})):
        return None
    number = _decimal(found[1]) * _exact(units[unit] if unit and units else plain)
    if parts is not None:
        divisor = _decimal(parts[2])
        if divisor == 0:
            return None
        number /= divisor
    if abs(number) > _HUGE:
        return None
    return WrittenNumber(value=number, may_be_thousands=_THOUSANDS.fullmatch(text) is not None)


def _exact(number: float) -> Decimal:
    """Return the number as it is written, not its nearest binary fraction."""
    return Decimal(repr(float(number)))


def _decimal(text: str) -> Decimal:
    return Decimal(re.sub("[dD]", "E", text.replace(",", ".")))


def shown_value(value: object) -> str:
    """Return a card's value as a note shows it: text in quotes, short and printable."""
    if isinstance(value, int) and value.bit_length() > _MAX_BITS:
        return "(a number of too many digits)"
    text = repr(value) if isinstance(value, str) else str(value)
    text = "".join(each if each.isprintable() else "?" for each in text)
    return text if len(text) <= _MAX_SHOWN else f"{text[:_MAX_SHOWN]}..."


def card_text(value: object) -> str:
    """Return a card's value as text, whatever it is."""
    return value if isinstance(value, str) else shown_value(value)


class Cards:
    """The cards of one header; keeps a note on each value that was asked for and is not used."""

    def __init__(self, header: Mapping[str, Any]) -> None:
        self._header = header
        self.notes: list[str] = []
        """Sentences on values that are not used, or are read with a doubt; each once."""

    def value(self, key: str) -> Any:
        """Value of a card; None where there is none, or a blank one.

        Of a keyword that stands more than once it is the first, and the others are noted.
        """
        value = self._header.get(key)
        for other in self._header.get(REPEATED_KEY, {}).get(key, ()):
            self.note(
                f"{key} stands twice, as {shown_value(value)} and {shown_value(other)}: the first"
                " is used"
            )
        return None if isinstance(value, str) and not value.strip() else value

    def note(self, words: str) -> None:
        """Add a note, if it is not there already."""
        if words not in self.notes:
            self.notes.append(words)

    def unit(self, key: str) -> str:
        """Unit in brackets in a card's comment, in small letters; empty where there is none."""
        return str(self._header.get(UNITS_KEY, {}).get(key, "")).lower()

    def not_used(self, key: str, why: str) -> str:
        """Add a note that a card is not used, and return it."""
        words = f"{key} {shown_value(self._header.get(key))} is not used: {why}"
        self.note(words)
        return words

    def decimal(
        self,
        key: str,
        what: str,
        low: float = -_HUGE,
        high: float = _HUGE,
        *,
        units: Mapping[str, float] | None = None,
        plain: float = 1.0,
    ) -> Decimal | None:
        """Return a card's number; None where it has none, or one beyond ``low`` and ``high``.

        ``what``: the quantity, for the note on a value that is not used. ``units``, ``plain``: as
        of ``written_number``; a unit in the card's comment goes before ``plain``.
        """
        value = self.value(key)
        if value is None:
            return None
        unit = self.unit(key) if units else ""
        if units and unit:
            if unit not in units:
                self.not_used(key, f"its comment has the unit [{unit}], which is not read")
                return None
            plain = units[unit]
        written = written_number(value, units, plain)
        if written is None or not low <= written.value <= high:
            self.not_used(key, f"it is not {what}")
            return None
        if written.may_be_thousands and abs(written.value) * 1000 <= high:
            self.note(
                f"{key} {shown_value(value)} is read with a decimal comma, as {written.value:f}"
            )
        return written.value

    def number(
        self,
        key: str,
        what: str,
        low: float = -_HUGE,
        high: float = _HUGE,
        *,
        units: Mapping[str, float] | None = None,
        plain: float = 1.0,
    ) -> float | None:
        """Return what ``decimal`` returns, as a float."""
        found = self.decimal(key, what, low, high, units=units, plain=plain)
        return None if found is None else float(found)
