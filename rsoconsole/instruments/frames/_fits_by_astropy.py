"""Reads an image of a FITS file that is not a plain one, by astropy; lists the file's images.

Observatories put the parts of a mosaic, the masks of an image or several summaries of one video
into the extensions of one file. Runs only in the decoding process: a hostile file may hang or crash
it.
"""

import math
import re
import warnings
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from rsoconsole.base import FrameError
from rsoconsole.instruments.frames.header_cards import COMMENT_UNIT, REPEATED_KEY
from rsoconsole.instruments.frames.plain_fits import Content, FitsImage
from rsoconsole.records import UNITS_KEY

MAX_PIXELS = 400_000_000
"""Largest image that is read, pixels: no camera has more."""
_BLOCK, _CARD, _MAX_BLOCKS, _MAX_UNITS = 2880, 80, 1000, 2000
_WHOLE = re.compile(rb"= +([+-]?[0-9]+)(?:\.0*)? *(?:/.*)?$")
_NO_BLANK = re.compile(r"[A-Z0-9_-]{1,8} *(?<=.{8})=(?=[^ =])")
"""A card that somebody wrote by hand, without a blank behind the equals sign."""
_BITS = (8, 16, 32, 64, -32, -64)
_MAX_AXES, _MAX_ITEMS = 999, 16 * MAX_PIXELS


def structure_fault(content: Content) -> str | None:
    """Return an impossible keyword of the file and its value, in words; None without one.

    Only readable headers are checked; the decoder reports files that are cut short.
    """
    for header in _headers(content):
        fault = _fault_of(header)
        if fault is not None:
            return fault
    return None


def _headers(content: Content) -> Iterator[dict[str, int]]:
    """Yield the whole numbers of each unit's header, in order."""
    offset = 0
    for _ in range(_MAX_UNITS):
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
    for block in range(_MAX_BLOCKS):
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
    """Number of a header, or an impossible one where it has more digits than any file can have."""
    return int(digits) if len(digits) < 20 else (-1 if digits.startswith(b"-") else 10**20)


def data_bytes(header: Mapping[str, int]) -> int:
    """Return the number of data bytes that a header declares, without padding to a full block."""
    axes = [header.get(f"NAXIS{n + 1}", 0) for n in range(header.get("NAXIS", 0))]
    items = math.prod(axes) if axes else 0
    groups = header.get("GCOUNT", 1)
    return abs(header.get("BITPIX", 8)) // 8 * groups * (header.get("PCOUNT", 0) + items)


_RANGES = {
    "NAXIS": (0, _MAX_AXES),
    "ZNAXIS": (1, _MAX_AXES),
    "PCOUNT": (0, _MAX_ITEMS),
    "GCOUNT": (0, _MAX_ITEMS),
    "TFIELDS": (0, _MAX_AXES),
}
_AXES = (("NAXIS", 0), ("ZNAXIS", 1), ("ZTILE", 1))
"""Numbered keywords, and the smallest value allowed to each."""


def _fault_of(header: dict[str, int]) -> str | None:
    for keyword, value in header.items():
        least, most = _RANGES.get(keyword, (value, value))
        is_depth = keyword in ("BITPIX", "ZBITPIX")
        if not least <= value <= most or (is_depth and value not in _BITS):
            return f"{keyword} = {value}"
    for prefix, least in _AXES:
        axes = {k: v for k, v in header.items() if re.fullmatch(rf"{prefix}[0-9]+", k)}
        for keyword, value in axes.items():
            if not least <= value <= _MAX_ITEMS:
                return f"{keyword} = {value}"
        if prefix != "ZTILE" and math.prod(axes.values()) > _MAX_ITEMS:
            return " x ".join(f"{k} = {v}" for k, v in axes.items())
    return None


ALL = "all"
"""Value of ``extension`` for all images of the file, one after another."""
_NAMELESS = ("", "PRIMARY", "COMPRESSED_IMAGE")
# What astropy raises for a damaged file; AttributeError where a header breaks off half-way.
_BROKEN = (OSError, ValueError, TypeError, KeyError, IndexError, AttributeError, zlib.error)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Unit:
    """A header and data unit with its number in the file."""

    number: int
    hdu: Any

    @property
    def name(self) -> str:
        """EXTNAME in capitals; empty where the unit has none of its own."""
        own = str(self.hdu.name).upper().replace(" ", "")
        return "" if own in _NAMELESS else own

    @property
    def side_px(self) -> int:
        """Length of the shorter side."""
        return int(min(self.hdu.shape[-2:]))


def image_by_astropy(
    content: bytes, name: str, extension: str | None = None, min_side_px: int = 1
) -> FitsImage:
    """Read the requested image in this process; arguments as of ``fits_image``."""
    from astropy.io import fits

    truncated = FrameError(f"{name} is truncated or damaged: copy it again or leave it out")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with fits.HDUList.fromstring(content, do_not_scale_image_data=True) as hdus:
                found = _labelled(_images(hdus, name, min_side_px))
                if not found and len(content) % 2880:
                    raise truncated
                label = _chosen(found, extension, name)
                hdu = found[label].hdu
                info = hdu.fileinfo()
                size_bytes = data_bytes(getattr(hdu, "_bintable", hdu).header)
                if info and info["datLoc"] + size_bytes > len(content):
                    raise truncated
                raw = hdu.data
                if raw is None:
                    raise truncated
                return FitsImage(
                    raw=raw[0] if raw.ndim == 3 else raw,
                    header=_merged_header(hdus[0].header, hdu.header),
                    label=label if len(found) > 1 else "",
                    others=tuple(other for other in found if other != label),
                )
        except FrameError:
            raise
        except fits.VerifyError as error:
            raise FrameError(f"{name} is not valid FITS: {error}; write it again") from error
        except Exception as error:  # decoders have errors of their own for a damaged image
            raise truncated from error


def _chosen(found: dict[str, _Unit], extension: str | None, name: str) -> str:
    """Label of the requested image."""
    if not found:
        raise FrameError(f"{name} holds no two-dimensional image: name a file with a frame in it")
    if extension is None:
        return next(iter(found))
    asked = extension.replace(" ", "").upper()
    for label, unit in found.items():
        # A name that several share stands for the first of them.
        if asked in (label, unit.name, str(unit.number)) and asked:
            return label
    raise FrameError(
        f"{name} has no image '{extension}': --extension takes {', '.join(found)}, the number of"
        f" an extension, or {ALL}"
    )


def _labelled(units: list[_Unit]) -> dict[str, _Unit]:
    names = [unit.name for unit in units]
    labels = [
        str(unit.number)
        if not unit.name
        else f"{unit.name},{unit.hdu.ver}"
        if names.count(unit.name) > 1
        else unit.name
        for unit in units
    ]
    # Two of one name and version: the number tells them apart.
    return {
        label if labels.count(label) == 1 else str(unit.number): unit
        for label, unit in zip(labels, units, strict=True)
    }


def _images(hdus: Any, name: str, min_side_px: int) -> list[_Unit]:
    """Units with two axes, or three of which the first has one plane."""
    images: list[_Unit] = []
    planes: tuple[int, ...] | None = None
    for number, hdu in enumerate(_readable(hdus)):
        if not hdu.is_image:
            continue
        shape = tuple(hdu.shape)
        if len(shape) == 2 or (len(shape) == 3 and shape[0] == 1):
            images.append(_Unit(number=number, hdu=hdu))
        elif len(shape) == 3 and planes is None:
            planes = shape
    large = [unit for unit in images if unit.side_px >= min_side_px]
    if not large and planes is not None:
        raise FrameError(
            f"{name} has {planes[0]} planes of {planes[2]} x {planes[1]} px: "
            "give monochrome frames, one image a file"
        )
    return large or [unit for unit in images if unit.side_px > 0][:1]


def _readable(hdus: Any) -> Iterator[Any]:
    """Yield units up to where the file is damaged.

    Raises astropy's error where no unit can be read.
    """
    units, count = iter(hdus), 0
    while True:
        try:
            hdu = next(units)
        except StopIteration:
            return
        except _BROKEN:
            if not count:
                raise
            return
        count += 1
        yield hdu


def _merged_header(primary: Any, own: Any) -> dict[str, Any]:
    """Merge cards as plain values; an image's own cards win over the primary header's.

    A value that is no FITS value, such as 10,5 or a text without quotes, is kept as text. Of a
    keyword that stands more than once in a header the first is used, and the others are kept in
    ``REPEATED_KEY``; units of comments are in ``UNITS_KEY``.
    """
    merged: dict[str, Any] = {}
    units: dict[str, str] = {}
    repeated: dict[str, tuple[Any, ...]] = {}
    for header in (primary,) if primary is own else (primary, own):
        seen: set[str] = set()
        for card in header.cards:
            keyword, value, comment = _parts(card)
            if not isinstance(value, bool | int | float | str):
                continue
            if keyword in seen:
                others = repeated.get(keyword, ())
                if value != merged[keyword] and value not in others:
                    repeated[keyword] = (*others, value)
                continue
            seen.add(keyword)
            merged[keyword] = value
            repeated.pop(keyword, None)
            units.pop(keyword, None)
            unit = COMMENT_UNIT.match(comment)
            if unit is not None:
                units[keyword] = unit[1]
    further = {UNITS_KEY: units, REPEATED_KEY: repeated}
    return merged | {key: found for key, found in further.items() if found}


def _parts(card: Any) -> tuple[str, Any, str]:
    """Keyword, value and comment of a card; the value is None where it has none."""
    from astropy.io.fits import Card, VerifyError

    if card.keyword in ("", "COMMENT", "HISTORY"):
        return "", None, ""
    try:
        image = str(card.image)
        if _NO_BLANK.match(image):
            card = Card.fromstring(f"{image[:9]} {image[9:79]}")
        return card.keyword, card.value, str(card.comment)
    except VerifyError:
        return card.keyword, *_unparsed_parts(card)
    except (ValueError, OSError):
        return card.keyword, None, ""


def _unparsed_parts(card: Any) -> tuple[str, str]:
    """Value of a card as it stands there, without unpaired quotes, and its comment."""
    try:
        _, _, stated = str(card.image)[:_CARD].partition("=")
    except Exception:  # what no rule of astropy mends
        return "(unreadable)", ""
    value, _, comment = stated.partition(" /")
    return value.strip().strip("'").strip(), comment
