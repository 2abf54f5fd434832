"""A frame as INDI's camera drivers write it: a plain FITS file in memory."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

_BLOCK = 2880

Card = str | int | float | bool


def fits_bytes(pixels: npt.NDArray[np.uint16], cards: Mapping[str, Card]) -> bytearray:
    """A single-image FITS file of (height, width) uint16, stored as int16 with BZERO 32768.

    Keys of at most eight characters; text without quotes. Source: FITS standard 4.0.
    """
    height_px, width_px = pixels.shape
    lines = [
        _card("SIMPLE", True),
        _card("BITPIX", 16),
        _card("NAXIS", 2),
        _card("NAXIS1", width_px),
        _card("NAXIS2", height_px),
        _card("EXTEND", True),
        _card("BZERO", 32768),
        _card("BSCALE", 1),
        *(_card(key, value) for key, value in cards.items()),
        "END".ljust(80),
    ]
    header = "".join(lines).encode("ascii")
    header += b" " * (-len(header) % _BLOCK)
    size = len(header) + pixels.size * 2
    file = bytearray(size + -size % _BLOCK)
    file[: len(header)] = header
    data = np.frombuffer(file, dtype=">u2", count=pixels.size, offset=len(header))
    # Subtracting 32768 from an unsigned value is turning over its top bit.
    np.bitwise_xor(pixels.ravel(), np.uint16(0x8000), out=data, casting="unsafe")
    return file


def _card(key: str, value: Card) -> str:
    if isinstance(value, bool):
        text = f"{'T' if value else 'F':>20}"
    elif isinstance(value, int):
        text = f"{value:>20d}"
    elif isinstance(value, float):
        text = f"{value:>20.10G}"
    else:
        text = f"'{value:<8}'"
    return f"{key:<8}= {text}"[:80].ljust(80)
