"""Encodes frames and previews as files of a session: without loss, and small.

A 12-bit converter whose values fill 16 bits leaves the low four bits empty, and Rice coding does
not exploit that: such pixels are shifted down first. ``BSCALE`` states the factor, so that every
FITS reader returns the camera's values. Source of the coding: Pence et al. 2010, FITS tiled image
compression.
"""

import io
import math
import re
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from rsoconsole.records import UNITS_KEY, ChartStar, Frame

TILE_ROWS = 16
MAX_SHIFT_BITS = 8
_STRUCTURE = {
    *("SIMPLE", "XTENSION", "EXTEND", "EXTNAME", "BITPIX", "NAXIS", "NAXIS1", "NAXIS2", "NAXIS3"),
    *("PCOUNT", "GCOUNT", "GROUPS", "TFIELDS", "BZERO", "BSCALE", "BLANK", "CHECKSUM", "DATASUM"),
    *("ZIMAGE", "ZCMPTYPE", "ZBITPIX", "ZNAXIS", "ZNAXIS1", "ZNAXIS2", "COMMENT", "HISTORY", "END"),
}
"""Cards that describe the file, not the exposure."""
_KEYWORD = re.compile("[A-Z0-9_-]{1,8}")
_PNG_SIGNATURE, _PNG_END_BYTES = b"\x89PNG\r\n\x1a\n", 12
_STARS = b"stars\0"
"""Keyword of a PNG's text with stars: x and y, px, and flux, ADU, of each."""
MAX_STARS = 200
"""Most stars that are read from a picture: sessions may come from anybody."""


def compress_frame(frame: Frame) -> bytes:
    """Encode a frame as a FITS file with a Rice-coded image in its first extension.

    Real-valued pixels are coded without loss by GZIP.
    """
    from astropy.io import fits

    header = fits.Header()
    units = frame.header.get(UNITS_KEY, {})
    for key, value in _cards(frame.header):
        header[key] = (value, f"[{units[key]}]") if key in units else value
    stored, shift_bits = _shift_down(frame.pixels)
    is_real = stored.dtype.kind == "f"
    hdu = fits.CompImageHDU(
        data=stored,
        header=header,
        compression_type="GZIP_2" if is_real else "RICE_1",
        tile_shape=(min(TILE_ROWS, stored.shape[0]), stored.shape[1]),
        quantize_level=0 if is_real else 16,
    )
    if shift_bits:
        hdu.header["BSCALE"] = (float(1 << shift_bits), "the camera's low bits are empty")
        hdu.header["BZERO"] = 0.0
    buffer = io.BytesIO()
    fits.HDUList([fits.PrimaryHDU(), hdu]).writeto(buffer)
    return buffer.getvalue()


def encode_preview(
    picture: npt.NDArray[np.uint8], stars: Sequence[ChartStar] | None = None
) -> bytes:
    """Encode a picture as PNG: (height, width), or (height, width, 3) in RGB.

    ``stars``: written into the file as text, for ``decode_preview_stars``; None: not known.
    """
    import cv2

    ordered = picture[..., ::-1] if picture.ndim == 3 else picture
    ok, encoded = cv2.imencode(".png", np.ascontiguousarray(ordered))
    if not ok:
        raise ValueError("the preview cannot be coded as PNG")
    coded = bytes(encoded.tobytes())
    if stars is None:
        return coded
    text = " ".join(f"{x:.1f},{y:.1f},{flux:.0f}" for x, y, flux in stars)
    body = b"tEXt" + _STARS + text.encode("ascii")
    chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
    return coded[:-_PNG_END_BYTES] + chunk + coded[-_PNG_END_BYTES:]


def decode_preview_stars(coded: bytes) -> tuple[ChartStar, ...] | None:
    """Return the stars in a PNG that ``encode_preview`` made; None: stars not known."""
    at = len(_PNG_SIGNATURE)
    while at + 8 <= len(coded):
        length, kind = struct.unpack_from(">I4s", coded, at)
        body = coded[at + 8 : at + 8 + length]
        if kind == b"tEXt" and body.startswith(_STARS):
            return tuple(_parse_stars(body.removeprefix(_STARS).decode("latin-1")))
        at += length + 12
    return None


def _parse_stars(text: str) -> Iterator[ChartStar]:
    for words in text.split()[:MAX_STARS]:
        try:
            star = ChartStar(*map(float, words.split(",")))
        except (TypeError, ValueError):
            continue
        if all(map(math.isfinite, star)) and star.flux_adu > 0.0:
            yield star


def _shift_down(pixels: npt.NDArray[Any]) -> tuple[npt.NDArray[Any], int]:
    """Shift down: (pixels without their empty low bits, number of those bits)."""
    if pixels.dtype != np.uint16:
        return pixels, 0
    used_bits = int(np.bitwise_or.reduce(pixels, axis=None))
    if used_bits == 0:
        return pixels, 0
    shift_bits = min((used_bits & -used_bits).bit_length() - 1, MAX_SHIFT_BITS)
    if shift_bits == 0:
        return pixels, 0
    return (pixels >> np.uint16(shift_bits)).view(np.int16), shift_bits


def _cards(header: Mapping[str, Any]) -> Iterator[tuple[str, bool | int | float | str]]:
    """Yield the cards that FITS can carry as they are."""
    for key, value in header.items():
        if key in _STRUCTURE or not _KEYWORD.fullmatch(key):
            continue
        if isinstance(value, float) and not math.isfinite(value):
            continue
        if isinstance(value, str) and not (value.isascii() and value.isprintable()):
            continue
        if isinstance(value, bool | int | float | str):
            yield key, value
