"""Reads FITS as cameras write it, without astropy: one image, in the first unit.

Astropy costs a process 30 MiB and half a second at its first frame. A file that is less plain than
this module expects (each card on one line, nothing after the image) is left to astropy, so that no
file is interpreted in two ways. Source: FITS standard 4.0, chapters 3 and 4.
"""

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from rsoconsole.instruments.frames.header_cards import COMMENT_UNIT
from rsoconsole.records import UNITS_KEY

_BLOCK, _CARD = 2880, 80
_MAX_BLOCKS = 64
_TYPES = {8: ">u1", 16: ">i2", 32: ">i4", 64: ">i8", -32: ">f4", -64: ">f8"}
_COMMENTARY = ("", "COMMENT", "HISTORY")
_KEYWORD = re.compile(r"[A-Z0-9_-]{1,8}")
_VALUE = re.compile(
    r" *(?:(?P<text>'(?:[^']|'')*')|(?P<is_true>T)|(?P<is_false>F)"
    r"|(?P<whole>[+-]?[0-9]{1,18})|(?P<real>[+-]?(?:[0-9]+\.[0-9]*|\.[0-9]+|[0-9]+(?=[ED]))"
    r"(?:[ED][+-]?[0-9]{1,3})?)|(?P<none>)) *(?:/.*)?"
)
# Astropy takes such a text for a record of its own, and may number keywords of such names.
_RECORD = re.compile(r"[A-Za-z_]\w*(?:\.\w+)*: ")
_LEFT_TO_ASTROPY = {"CONTINUE", "HIERARCH", "GROUPS", "ZIMAGE", "XTENSION", "LONGSTRN"}

Content = bytes | memoryview


@dataclass(frozen=True, slots=True, kw_only=True)
class FitsImage:
    """One two-dimensional image of a file, with its header."""

    raw: npt.NDArray[Any]
    """Pixels (height, width) as stored: BZERO and BSCALE are not applied."""
    header: dict[str, Any]
    """Values of the primary header, overridden by those of the image's own header."""
    label: str = ""
    """Name, "NAME,VERSION" or number of its extension; empty for the only image of a file."""
    others: tuple[str, ...] = ()


def read_plain(content: Content) -> tuple[npt.NDArray[Any], dict[str, Any]] | None:
    """Return the image as stored (height, width), a view of ``content``, and the header's values.

    None where the file is not plain: compressed, damaged, with its image in an extension, with
    further units after the image, with cards of several lines, or shorter than its header states.
    """
    found = _header(content)
    if found is None:
        return None
    header, offset = found
    axes, bits = _whole(header, "NAXIS"), _whole(header, "BITPIX")
    width, height = _whole(header, "NAXIS1"), _whole(header, "NAXIS2")
    planes = _whole(header, "NAXIS3") if axes == 3 else 1
    if axes not in (2, 3) or planes != 1 or min(width, height) < 1 or bits not in _TYPES:
        return None
    dtype = np.dtype(_TYPES[bits])
    if header.get("PCOUNT", 0) != 0 or header.get("GCOUNT", 1) != 1:
        return None
    if offset + width * height * dtype.itemsize > len(content):
        return None
    end = offset + -(-width * height * dtype.itemsize // _BLOCK) * _BLOCK
    if bytes(content[end : end + 8]) == b"XTENSION":
        return None
    flat = np.frombuffer(content, dtype, count=width * height, offset=offset)
    return flat.reshape(height, width), header


def _whole(header: dict[str, Any], keyword: str) -> int:
    """Whole number of the header; 0 where it has none of that name."""
    value = header.get(keyword)
    return value if type(value) is int else 0


def _header(content: Content) -> tuple[dict[str, Any], int] | None:
    """Values of the first header, and the offset of its data; None where a card is not plain."""
    header: dict[str, Any] = {}
    for block in range(_MAX_BLOCKS):
        piece = bytes(content[block * _BLOCK : (block + 1) * _BLOCK])
        if len(piece) < _BLOCK or not piece.isascii():
            return None
        text = piece.decode("ascii")
        if not text.isprintable():
            return None
        for start in range(0, _BLOCK, _CARD):
            card = text[start : start + _CARD]
            keyword = card[:8].rstrip()
            if keyword == "END":
                is_whole = not card[8:].strip() and next(iter(header), "") == "SIMPLE"
                return (header, (block + 1) * _BLOCK) if is_whole and header["SIMPLE"] else None
            if keyword in _COMMENTARY:
                continue
            if not _take(card, keyword, header):
                return None
    return None


def _take(card: str, keyword: str, header: dict[str, Any]) -> bool:
    """Put a card's value into ``header``; return False where it is not plain.

    A keyword that stands twice is left to astropy.
    """
    if keyword in _LEFT_TO_ASTROPY or not _KEYWORD.fullmatch(keyword) or card[8:10] != "= ":
        return False
    value = _VALUE.fullmatch(card[10:])
    if value is None or keyword in header:
        return False
    kind, stated = value.lastgroup, value[value.lastgroup or 0]
    if kind == "text":
        plain = stated[1:-1].replace("''", "'").rstrip()
        # Astropy ends a text at a slash behind a doubled quote.
        if _RECORD.match(plain) or plain.endswith("&") or "'/" in plain:
            return False
        header[keyword] = plain
    elif kind in ("is_true", "is_false"):
        header[keyword] = kind == "is_true"
    elif kind == "whole":
        header[keyword] = int(stated)
    elif kind == "real":
        header[keyword] = float(stated.replace("D", "E"))
    # A keyword without a value says nothing.
    unit = COMMENT_UNIT.match(card[10 + value.end(kind or 0) :].lstrip().removeprefix("/"))
    if unit is not None and keyword in header:
        header.setdefault(UNITS_KEY, {})[keyword] = unit[1]
    return True
