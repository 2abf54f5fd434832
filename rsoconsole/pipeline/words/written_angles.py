"""Two angles in one line of text, told apart; what each one is, where the text says so."""

import re
from dataclasses import dataclass

_DASHES = str.maketrans("−–—‐", "----")
_POINT_FIRST = re.compile(r"(?<![\d.])\.(?=\d)")
_LABEL = re.compile(r"\b(ra|dec|alt|az|ha|el)\b\s*[:=]?\s*|([αδ])\s*[:=]?\s*", re.IGNORECASE)
_KINDS = {"el": "alt", "α": "ra", "δ": "dec"}
_FIELD = re.compile(r"([+-]?)\d+(?:\.\d+)?\s*([hʰd°]?)", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")


@dataclass(frozen=True, slots=True, kw_only=True)
class WrittenAngle:
    """One angle, not read yet."""

    text: str
    kind: str
    """ra, dec, alt, az or ha; empty where the text does not say."""


def plain_signs(text: str) -> str:
    """The same with one kind of minus, and a nought before a leading point."""
    return _POINT_FIRST.sub("0.", text.translate(_DASHES))


def without_labels(text: str) -> str:
    """What is left of a text when ra, dec, alt, az and ha are taken out."""
    return _LABEL.sub(" ", text)


def is_labelled(text: str) -> bool:
    """Whether a text begins with the name of a coordinate."""
    return _LABEL.match(text.strip()) is not None


def two_angles(text: str) -> tuple[WrittenAngle, WrittenAngle]:
    """The two angles of a text.

    They are parted by the name of the second one; else by a comma; else by the second one's sign,
    or its h, d or °; else in halves. Raises ValueError where that does not give two.
    """
    labels = list(_LABEL.finditer(text))
    kinds = [_kind(match) for match in labels]
    if len(labels) > 2 or len(set(kinds)) != len(kinds):
        raise ValueError(f"{text.strip()!r} names more than two coordinates")
    if len(labels) == 2:
        before = text[: labels[0].start()].strip(" ,")
        first, second = text[labels[0].end() : labels[1].start()], text[labels[1].end() :]
        if before:
            raise ValueError(f"{before!r} stands before the first coordinate's name")
        return _angle(first, kinds[0]), _angle(second, kinds[1])
    if labels and text[: labels[0].start()].strip(" ,"):
        # The second one's name alone.
        return _angle(text[: labels[0].start()], ""), _angle(text[labels[0].end() :], kinds[0])
    values = text[labels[0].end() :] if labels else text
    first, second = _parted(values)
    return _angle(first, kinds[0] if kinds else ""), _angle(second, "")


def is_marked(angle: str, *marks: str) -> bool:
    """Whether an angle is marked with one of these letters or signs."""
    return any(mark in angle.lower() for mark in marks)


def number_of_fields(angle: str) -> int:
    """How many numbers an angle is written with."""
    return len(_FIELD.findall(angle))


def _kind(match: re.Match[str]) -> str:
    word = (match.group(1) or match.group(2)).lower()
    return _KINDS.get(word, word)


def _angle(text: str, kind: str) -> WrittenAngle:
    plain = text.strip(" ,")
    if not plain:
        raise ValueError(f"{kind or 'the second angle'} has no value")
    return WrittenAngle(text=plain, kind=kind)


def _parted(values: str) -> tuple[str, str]:
    if _DECIMAL_COMMA.fullmatch(values.strip()):
        raise ValueError(f"{values.strip()!r}: write a point for decimals, and both angles")
    if values.count(",") == 1:
        first, _, second = values.partition(",")
        return first, second
    fields = list(_FIELD.finditer(values))
    begins = [n for n, match in enumerate(fields) if n and (match.group(1) or match.group(2))]
    if len(begins) == 1:
        at = begins[0]
    elif not begins and len(fields) in {2, 4, 6}:
        at = len(fields) // 2
    else:
        raise ValueError(f"{values.strip()!r} is not two angles")
    cut = fields[at].start()
    return values[:cut], values[cut:]
