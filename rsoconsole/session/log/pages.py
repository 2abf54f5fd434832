"""Reads the rows of a SQLite file page by page, where SQLite itself can no longer read the file.

Every page that looks like a page of rows is read, whether or not a table leads to it. Its cells may
be damaged: the caller must check the rows. SQLite's own ``.recover`` would do the same, but the
shell that Debian 12 ships (3.40.1) ends it with "SQL logic error" on every database. Source:
sqlite.org/fileformat2.html.
"""

import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TypeAlias

from rsoconsole.session.log.database import MAX_ROW_BYTES

Value: TypeAlias = int | float | str | bytes | None
Fields: TypeAlias = tuple[Value, ...]

MAGIC = b"SQLite format 3\0"
DEFAULT_PAGE_BYTES = 4096
_FILE_HEADER_BYTES = 100
_TABLE_LEAF, _INDEX_LEAF, _INDEX_INTERIOR = 13, 10, 2
_HEADER_BYTES = {_TABLE_LEAF: 8, _INDEX_LEAF: 8, _INDEX_INTERIOR: 12}
_INTEGER_BYTES = {1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8}
_WAL_HEADER_BYTES, _FRAME_HEADER_BYTES = 32, 24


class DatabasePages:
    """Pages of a database and its write-ahead log, read without SQLite."""

    def __init__(self, database: Path, wal: Path) -> None:
        """Read both files. Raises OSError."""
        content = database.read_bytes()
        self._page_bytes = DEFAULT_PAGE_BYTES
        reserved = 0
        if content.startswith(MAGIC):
            (size,) = struct.unpack_from(">H", content, 16)
            size = 65536 if size == 1 else size
            if size >= 512 and size & (size - 1) == 0:
                self._page_bytes, reserved = size, content[20]
        self._usable = self._page_bytes - reserved
        step = self._page_bytes
        images = [content[i : i + step] for i in range(0, len(content), step)]
        self._images = [image for image in images if len(image) == step]
        self._by_number = dict(enumerate(self._images, start=1))
        for number, image in self._frames(wal.read_bytes() if wal.exists() else b""):
            self._by_number[number] = image
            self._images.append(image)

    def rows(self) -> Iterator[tuple[int | None, Fields]]:
        """Yield (rowid, fields) of everything that looks like a row.

        rowid is None for a row of a WITHOUT ROWID table. In the fields, a column that is the rowid
        itself is None.
        """
        for image in self._images:
            starts = (_FILE_HEADER_BYTES, 0) if image.startswith(MAGIC) else (0,)
            for start in starts:
                yield from self._cells(image, start)

    def _frames(self, wal: bytes) -> Iterator[tuple[int, bytes]]:
        """Yield (page number, image) of the log's own frames, without those of an earlier round."""
        salts = wal[16:24]
        step = _FRAME_HEADER_BYTES + self._page_bytes
        for place in range(_WAL_HEADER_BYTES, len(wal) - step + 1, step):
            if wal[place + 8 : place + 16] == salts:
                (number,) = struct.unpack_from(">I", wal, place)
                yield number, wal[place + _FRAME_HEADER_BYTES : place + step]

    def _cells(self, image: bytes, start: int) -> Iterator[tuple[int | None, Fields]]:
        kind = image[start]
        header_bytes = _HEADER_BYTES.get(kind)
        if header_bytes is None:
            return
        (cells,) = struct.unpack_from(">H", image, start + 3)
        for number in range(cells):
            pointer = start + header_bytes + 2 * number
            if pointer + 2 > len(image):
                return
            (place,) = struct.unpack_from(">H", image, pointer)
            try:
                yield self._cell(image, place, kind)
            except (IndexError, ValueError, struct.error):
                continue

    def _cell(self, image: bytes, place: int, kind: int) -> tuple[int | None, Fields]:
        place += 4 * (kind == _INDEX_INTERIOR)
        size, place = _varint(image, place)
        rowid = None
        if kind == _TABLE_LEAF:
            rowid, place = _varint(image, place)
        return rowid, _fields(self._payload(image, place, size, kind))

    def _payload(self, image: bytes, place: int, size: int, kind: int) -> bytes:
        """Bytes of a row, those on overflow pages included. Source: fileformat2.html, 1.6."""
        if size > MAX_ROW_BYTES:
            raise ValueError("no row is that long")
        usable = self._usable
        most = usable - 35 if kind == _TABLE_LEAF else (usable - 12) * 64 // 255 - 23
        if size <= most:
            return _exactly(image[place : place + size], size)
        least = (usable - 12) * 32 // 255 - 23
        local = least + (size - least) % (usable - 4)
        local = local if local <= most else least
        parts = [_exactly(image[place : place + local], local)]
        (following,) = struct.unpack_from(">I", image, place + local)
        missing = size - local
        while missing > 0:
            page = self._by_number.get(following)
            if page is None or missing > usable * len(self._by_number):
                raise ValueError("the row breaks off")
            parts.append(page[4 : 4 + min(missing, usable - 4)])
            missing -= usable - 4
            (following,) = struct.unpack_from(">I", page)
        return b"".join(parts)


def _varint(content: bytes, place: int) -> tuple[int, int]:
    """Read a variable-length integer: (integer, place behind it)."""
    value = 0
    for i in range(9):
        byte = content[place + i]
        if i == 8:
            value = value << 8 | byte
            return value - (value >> 63 << 64), place + 9
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, place + i + 1
    raise AssertionError


def _fields(payload: bytes) -> Fields:
    header_bytes, place = _varint(payload, 0)
    types: list[int] = []
    while place < header_bytes:
        kind, place = _varint(payload, place)
        types.append(kind)
    return tuple(_values(payload, header_bytes, types))


def _values(payload: bytes, place: int, types: Sequence[int]) -> Iterator[Value]:
    for kind in types:
        if kind == 0:
            yield None
        elif kind in _INTEGER_BYTES:
            size = _INTEGER_BYTES[kind]
            yield int.from_bytes(_exactly(payload[place : place + size], size), "big", signed=True)
            place += size
        elif kind == 7:
            yield struct.unpack_from(">d", payload, place)[0]
            place += 8
        elif kind in (8, 9):
            yield kind - 8
        elif kind >= 12:
            size = (kind - 12) // 2
            content = _exactly(payload[place : place + size], size)
            yield content.decode() if kind % 2 else content
            place += size
        else:
            raise ValueError(f"no value has the type {kind}")


def _exactly(content: bytes, size: int) -> bytes:
    if len(content) != size:
        raise ValueError("the row breaks off")
    return content
