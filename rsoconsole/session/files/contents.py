"""Whether the bytes of a session's file are whole, where no hash of them was kept; its row."""

import io
import zlib
from pathlib import PurePosixPath

from rsoconsole.session.files.digest import sha256_of

_PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
_CHUNK_BYTES_BESIDE_DATA = 12
"""Length, type and CRC. Source: PNG specification (ISO/IEC 15948), 5.3."""


def found_row(path: str, role: str, frame_id: int, content: bytes) -> tuple[object, ...]:
    """The row of the table ``files`` for a file that was found without one."""
    return frame_id, role, path, len(content), None, None, sha256_of(content)


def content_fault(name: str, content: bytes) -> str | None:
    """Why a FITS or PNG file cannot be read whole; None when it can, and for other files."""
    suffixes = {suffix.lower() for suffix in PurePosixPath(name).suffixes}
    if ".png" in suffixes:
        return _png_fault(content)
    if suffixes & {".fits", ".fit", ".fts"}:
        return _fits_fault(content)
    return None


def _png_fault(content: bytes) -> str | None:
    """Every chunk carries its own checksum: no decoder is needed, and none may complain."""
    if not content.startswith(_PNG_MAGIC):
        return "it is no PNG picture"
    place = len(_PNG_MAGIC)
    while place + _CHUNK_BYTES_BESIDE_DATA <= len(content):
        size = int.from_bytes(content[place : place + 4], "big")
        end = place + 8 + size
        if end + 4 > len(content):
            break
        if zlib.crc32(content[place + 4 : end]) != int.from_bytes(content[end : end + 4], "big"):
            return "a part of the picture is damaged"
        if content[place + 4 : place + 8] == b"IEND":
            return None
        place = end + 4
    return "the picture breaks off"


def _fits_fault(content: bytes) -> str | None:
    import warnings

    from astropy.io import fits

    try:
        with warnings.catch_warnings():
            # A file that breaks off is only worth a warning to astropy.
            warnings.simplefilter("error")
            with fits.open(io.BytesIO(content), memmap=False) as hdus:
                shapes = [hdu.data.shape for hdu in hdus if hdu.is_image and hdu.data is not None]
    except Exception as error:  # astropy raises whatever a damaged file makes it stumble over
        return f"it cannot be read as FITS ({error})"
    return None if any(len(shape) == 2 for shape in shapes) else "it holds no image"
