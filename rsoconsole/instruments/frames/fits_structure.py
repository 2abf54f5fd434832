"""What a FITS file's structural keywords promise, looked at before anybody believes them.

A length below zero sends astropy into a loop without end, a huge one asks for all the memory there
is. Source: FITS standard 4.0, 4.4.1, 7.1.1, 7.3.1 and 10.1.
"""

import math
import re
from collections.abc import Iterator, Mapping

from rsoconsole.instruments.frames.plain_fits import Content

MOST_PIXELS = 400_000_000
"""Of one image: no camera has more."""
_BLOCK, _CARD, _MOST_BLOCKS, _MOST_UNITS = 2880, 80, 1000, 2000
_WHOLE = re.compile(rb"= +([+-]?[0-9]+)(?:\.0*)? *(?:/.*)?$")
_BITS = (8, 16, 32, 64, -32, -64)
_MOST_AXES, _MOST_ITEMS = 999, 16 * MOST_PIXELS


def structure_fault(content: Content) -> str | None:
    """The keyword that cannot be, with its value; None where nothing speaks against the file.

    Looks as far as headers can be read: what breaks off half-way is for the decoder to say.
    """
    for header in _headers(content):
        fault = _fault_of(header)
        if fault is not None:
            return fault
    return None


def _headers(content: Content) -> Iterator[dict[str, int]]:
    """The whole numbers of each unit's header, in order."""
    offset = 0
    for _ in range(_MOST_UNITS):
        header, end = _header(content, offset)
        if end is None:
            return
        yield header
        if _fault_of(header) is not None:
            return
        offset = end + -(-data_bytes(header) // _BLOCK) * _BLOCK
        if offset >= len(content):
            return


def _header(content: Content, offset: int) -> tuple[dict[str, int], int | None]:
    header: dict[str, int] = {}
    for block in range(_MOST_BLOCKS):
        start = offset + block * _BLOCK
        piece = bytes(content[start : start + _BLOCK])
        if len(piece) < _BLOCK:
            break
        for at in range(0, _BLOCK, _CARD):
            card = piece[at : at + _CARD]
            keyword = card[:8].rstrip()
            if keyword == b"END":
                return header, start + _BLOCK
            value = _WHOLE.match(card[8:])
            if value is not None:
                header.setdefault(keyword.decode("ascii", "replace"), _number(value[1]))
    return header, None


def _number(digits: bytes) -> int:
    """As it is, or one that no file can have where it has more digits than any."""
    return int(digits) if len(digits) < 20 else (-1 if digits.startswith(b"-") else 10**20)


def data_bytes(header: Mapping[str, int]) -> int:
    """Bytes that a unit's header promises, without the padding to a full block."""
    axes = [header.get(f"NAXIS{n + 1}", 0) for n in range(header.get("NAXIS", 0))]
    items = math.prod(axes) if axes else 0
    groups = header.get("GCOUNT", 1)
    return abs(header.get("BITPIX", 8)) // 8 * groups * (header.get("PCOUNT", 0) + items)


_RANGES = {
    "NAXIS": (0, _MOST_AXES),
    "ZNAXIS": (1, _MOST_AXES),
    "PCOUNT": (0, _MOST_ITEMS),
    "GCOUNT": (0, _MOST_ITEMS),
    "TFIELDS": (0, _MOST_AXES),
}
_AXES = (("NAXIS", 0), ("ZNAXIS", 1), ("ZTILE", 1))
"""Numbered keywords, and the least that each may be."""


def _fault_of(header: dict[str, int]) -> str | None:
    for keyword, value in header.items():
        least, most = _RANGES.get(keyword, (value, value))
        is_depth = keyword in ("BITPIX", "ZBITPIX")
        if not least <= value <= most or (is_depth and value not in _BITS):
            return f"{keyword} = {value}"
    for prefix, least in _AXES:
        axes = {k: v for k, v in header.items() if re.fullmatch(rf"{prefix}[0-9]+", k)}
        for keyword, value in axes.items():
            if not least <= value <= _MOST_ITEMS:
                return f"{keyword} = {value}"
        if prefix != "ZTILE" and math.prod(axes.values()) > _MOST_ITEMS:
            return " x ".join(f"{k} = {v}" for k, v in axes.items())
    return None
