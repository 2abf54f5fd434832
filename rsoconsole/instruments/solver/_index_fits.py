"""The FITS layout of an astrometry.net index file, read without a FITS library.

An index file is a primary header that states the quad sizes, followed by byte tables: quads, a
kd-tree of quad codes, a kd-tree of the stars as scaled unit vectors, and one table for each further
column of the stars, such as ``MAG_VT``. Reading the headers alone takes a millisecond, so a file
can be checked (complete? which scale? which sky?) before the solver is given it. Source of the
layout: the FITS standard 4.0 and astrometry.net's kdtree_fits_io.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from rsoconsole.base import SolverError, system_errors_as
from rsoconsole.records import FloatArray

_BLOCK = 2880
_CARD = 80
_SAMPLE = 5000


@dataclass(frozen=True, slots=True)
class IndexTable:
    """One table of an index file, rows of bytes."""

    name: str
    """Name of the only column, e.g. ``kdtree_data_stars``."""
    row_bytes: int
    rows: int
    offset: int
    """Offset of the table's first data byte in the file."""


@dataclass(frozen=True, slots=True)
class IndexHeader:
    """All headers of one index file."""

    cards: dict[str, str]
    """Primary header: keyword to value as written, strings without their quotes."""
    tables: tuple[IndexTable, ...]
    expected_size: int
    """Size of the complete file, bytes; a shorter file is truncated."""

    def table(self, name: str) -> IndexTable:
        """Return the table of this name. Raises SolverError when there is none."""
        for table in self.tables:
            if table.name == name:
                return table
        raise SolverError(f"index file has no table {name}: install it again")


def read_header(path: Path) -> IndexHeader:
    """Read all headers of an index file.

    Raises SolverError where the file is no index file, or is cut within a header.
    """
    with system_errors_as(SolverError, f"{path} cannot be read: "), path.open("rb") as stream:
        primary = _read_cards(stream, path)
        if "SCALE_L" not in primary or "SCALE_U" not in primary:
            raise SolverError(f"{path} is not an astrometry.net index file")
        tables, end = _read_tables(stream, path)
    return IndexHeader(primary, tables, end)


def dec_limits_deg(path: Path, header: IndexHeader) -> tuple[float, float]:
    """Return the least and greatest declination of the stars, deg, to about 0.1 deg.

    Both are those of a sample of stars spread evenly over the file.
    """
    low, scale = _star_range(path, header)
    data = header.table("kdtree_data_stars")
    step = max(1, data.rows // _SAMPLE)
    packed = np.memmap(path, "<u4", "r", offset=data.offset, shape=(data.rows, 3))
    z = np.clip(packed[::step, 2] / scale + low[2], -1.0, 1.0)
    return math.degrees(math.asin(z.min())), math.degrees(math.asin(z.max()))


def _star_range(path: Path, header: IndexHeader) -> tuple[FloatArray, float]:
    table = header.table("kdtree_range_stars")
    values = np.fromfile(path, "<f8", count=7, offset=table.offset)
    if values.size != 7 or not np.isfinite(values).all() or values[6] <= 0:
        raise SolverError(f"{path} is damaged: install it again")
    return values[:3], float(values[6])


def _read_cards(stream: BinaryIO, path: Path) -> dict[str, str]:
    cards: dict[str, str] = {}
    while True:
        block = stream.read(_BLOCK)
        if len(block) < _BLOCK or (not cards and not block.startswith((b"SIMPLE", b"XTENSION"))):
            raise SolverError(f"{path} is truncated or not an index file: install it again")
        for start in range(0, _BLOCK, _CARD):
            card = block[start : start + _CARD].decode("ascii", "replace")
            keyword = card[:8].strip()
            if keyword == "END":
                return cards
            if card[8:10] == "= ":
                cards.setdefault(keyword, _value(card[10:]))


def _value(text: str) -> str:
    text = text.strip()
    if text.startswith("'"):
        return text[1:].partition("'")[0].strip()
    return text.partition("/")[0].strip()


def _read_tables(stream: BinaryIO, path: Path) -> tuple[tuple[IndexTable, ...], int]:
    size = path.stat().st_size
    tables: list[IndexTable] = []
    end = stream.tell()
    while end < size:
        stream.seek(end)
        cards = _read_cards(stream, path)
        row_bytes, rows = int(cards["NAXIS1"]), int(cards["NAXIS2"])
        offset = stream.tell()
        tables.append(IndexTable(cards.get("TTYPE1", ""), row_bytes, rows, offset))
        end = offset + -(-row_bytes * rows // _BLOCK) * _BLOCK
    return tuple(tables), end
