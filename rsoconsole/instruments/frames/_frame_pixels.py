"""Converts a file's stored numbers to a frame's pixels (uint16 or float32) with saturation."""

import math
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from rsoconsole.base import FrameError
from rsoconsole.records import PixelArray

Room: TypeAlias = Callable[[tuple[int, ...]], npt.NDArray[np.uint16] | None]
"""Function that may give an array (height, width) for writing pixels of 16 bits."""

EIGHT_BIT_ADU = 255.0
_CONVERTER_BITS = (8, 10, 12, 14)
_FILL_BLOCK_PX = 64


def one_plane(raw: npt.NDArray[Any], name: str) -> tuple[npt.NDArray[Any], float | None, bool]:
    """Convert a picture to one plane: (pixels, saturation or None, whether it had colours).

    Colours of 8 bits are added up, which avoids coarser steps; those of more bits are averaged. A
    picture that is grey in every pixel keeps its values. ``raw``: (height, width) or (height,
    width, 3 or 4); the fourth plane, opacity, is ignored. Raises FrameError for other shapes.
    """
    if raw.ndim == 2:
        return raw, None, False
    if raw.ndim != 3 or raw.shape[2] not in (3, 4) or raw.dtype.kind not in "uf":
        raise FrameError(f"{name} is no picture in one or three colours: give monochrome frames")
    first, second, third = (raw[..., colour] for colour in range(3))
    if np.array_equal(first, second) and np.array_equal(first, third):
        return np.ascontiguousarray(first), None, False
    if raw.dtype.itemsize == 1:
        total = first.astype(np.uint16)
        total += second
        total += third
        return total, 3.0 * EIGHT_BIT_ADU, True
    mean = first.astype(np.float32)
    mean += second
    mean += third
    mean /= np.float32(3.0)
    return (mean.round().astype(np.uint16) if raw.dtype == np.uint16 else mean), None, True


def to_pixels(
    raw: npt.NDArray[Any], header: Mapping[str, Any], name: str, room: Room
) -> PixelArray:
    """Convert to uint16 where the file has that, else float32; a copy, or ``room``'s array."""
    bzero, bscale = _scaling(header)
    if raw.dtype.kind == "u" and raw.dtype.itemsize == 1 and (bzero, bscale) == (0.0, 1.0):
        return raw.astype(np.uint16)
    if raw.dtype.kind == "u" and raw.dtype.itemsize == 2:
        return raw.astype(np.uint16)
    if raw.dtype.kind == "i" and raw.dtype.itemsize == 2 and (bzero, bscale) == (32768.0, 1.0):
        # FITS has no unsigned 16-bit type: flipping the sign bit adds 32768.
        given = room(raw.shape)
        unsigned = np.empty(raw.shape, np.uint16) if given is None else given
        unsigned[...] = raw.view(raw.dtype.str.replace("i", "u"))
        unsigned ^= np.uint16(0x8000)
        return unsigned
    shift_bits = _shift_bits(raw, bzero, bscale)
    if shift_bits is not None:
        return raw.astype(np.uint16) << np.uint16(shift_bits)
    if raw.dtype.kind not in "iuf":
        raise FrameError(f"{name} holds {raw.dtype} pixels: give integers or real numbers")
    with np.errstate(over="ignore", invalid="ignore"):
        pixels: npt.NDArray[np.float32] = raw.astype(np.float32)
        blank = header.get("BLANK")
        masked = raw == blank if raw.dtype.kind == "i" and blank is not None else None
        if (bzero, bscale) != (0.0, 1.0):
            pixels *= np.float32(bscale)
            pixels += np.float32(bzero)
    if masked is not None:
        pixels[masked] = np.nan
    return pixels


def _scaling(header: Mapping[str, Any]) -> tuple[float, float]:
    return float(header.get("BZERO", 0.0)), float(header.get("BSCALE", 1.0))


def _shift_bits(raw: npt.NDArray[Any], bzero: float, bscale: float) -> int | None:
    """Bits by which a camera's values were shifted down before coding; None when they were not.

    Sessions keep 12 bits in 16 that way, and say so with BSCALE: the same frame comes back.
    """
    if raw.dtype.kind != "i" or raw.dtype.itemsize != 2 or bzero != 0.0:
        return None
    bits = math.log2(bscale) if bscale > 1.0 else 0.0
    if not (1.0 <= bits <= 8.0 and bits.is_integer()):
        return None
    highest = 0xFFFF >> int(bits)
    return int(bits) if int(raw.min()) >= 0 and int(raw.max()) <= highest else None


def fill_nonfinite(pixels: npt.NDArray[Any], name: str, max_fraction: float) -> str | None:
    """Replace NaN and infinite pixels, in place, by the median of their block.

    Returns a note for the user, None where there are none. Raises FrameError where they are more
    than ``max_fraction`` of the frame.
    """
    bad = ~np.isfinite(pixels)
    count = int(np.count_nonzero(bad))
    if count == 0:
        return None
    if count > max_fraction * pixels.size:
        raise FrameError(
            f"{name}: NaN or infinite values in {count} of {pixels.size} pixels: "
            "write the frame without masking"
        )
    frame_median = float(np.median(pixels[~bad]))
    b = _FILL_BLOCK_PX
    for j, i in sorted({(int(y) // b, int(x) // b) for y, x in np.argwhere(bad)}):
        block = pixels[j * b : (j + 1) * b, i * b : (i + 1) * b]
        mask = bad[j * b : (j + 1) * b, i * b : (i + 1) * b]
        block[mask] = frame_median if mask.all() else np.median(block[~mask])
    return f"{count} of {pixels.size} pixels were NaN or infinite and were filled"


def saturation_adu(raw: npt.NDArray[Any], pixels: PixelArray, header: Mapping[str, Any]) -> float:
    """Return the value at which pixels saturate, ADU: as the header states, or from the pixels.

    A 12-bit converter stored in 16 bits saturates at 65520, or at 4095.
    """
    stated = header.get("SATURATE")
    if isinstance(stated, int | float) and not isinstance(stated, bool) and stated > 0:
        return float(stated)
    if raw.dtype.itemsize == 1:
        bzero, bscale = _scaling(header)
        return EIGHT_BIT_ADU * bscale + bzero
    if pixels.dtype != np.uint16:
        return 65535.0
    used_bits = int(np.bitwise_or.reduce(pixels[::7], axis=None))
    step = used_bits & -used_bits
    if step > 1:
        return float(65536 - step)
    highest = int(pixels.max())
    if highest in {(1 << bits) - 1 for bits in _CONVERTER_BITS}:
        # One pixel may be there by chance.
        is_full_scale = int(np.count_nonzero(pixels == highest)) >= 3
        return float(highest) if is_full_scale else 65535.0
    return 65535.0


_SAMPLES_A_SIDE = 256
_MAX_ALIKE = 0.75


def noiseless_sky_note(pixels: PixelArray) -> str | None:
    """Return a note on a sky that is one value nearly everywhere, so has no noise; else None."""
    rows, columns = (max(1, side // _SAMPLES_A_SIDE) for side in pixels.shape)
    sample = pixels[::rows, ::columns]
    level = np.median(sample)
    alike = float(np.mean(sample == level))
    if alike < _MAX_ALIKE:
        return None
    return (
        f"{100.0 * alike:.0f} % of the pixels are {level:g}: a sky without noise, cut off or"
        " drawn; what is faint is lost, and widths and signal-to-noise ratios mean little; give"
        " the camera's own frame"
    )
