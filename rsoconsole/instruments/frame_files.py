"""Frames from files: FITS as cameras and archives write it, TIFF and PNG.

The kind of a file is told by its first bytes, not by its name. A file is held in memory once as
bytes and once as pixels, never a third time.
"""

import bz2
import gzip
import math
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from rsoconsole.errors import FrameError
from rsoconsole.instruments.frame_header import NOTES_KEY, exposure_s, pointing_deg, scale, start
from rsoconsole.instruments.plain_fits import Content, read_plain
from rsoconsole.records import Frame, PixelArray

Room: TypeAlias = Callable[[tuple[int, ...]], npt.NDArray[np.uint16] | None]

MIN_SIDE_PX = 64
MAX_NONFINITE_FRACTION = 0.0
"""A camera gives numbers: a frame with anything else is not what it saw."""
_FILL_BLOCK_PX = 64
_IMAGE_MAGIC = (b"\x89PNG", b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
# What astropy raises for a damaged file; AttributeError where a header breaks off half-way.
_BROKEN = (OSError, ValueError, TypeError, KeyError, IndexError, AttributeError, zlib.error)


def read_frame(
    path: Path,
    frame_id: int,
    *,
    allow_8bit: bool = False,
    expected_size: tuple[int, int] | None = None,
    max_nonfinite_fraction: float = MAX_NONFINITE_FRACTION,
) -> Frame:
    """Read one frame: FITS (also .gz, .bz2, fpack; first two-dimensional image), TIFF or PNG.

    Pixels come as uint16 or float32, native order, (height, width). ``expected_size`` is (width,
    height). Pixels that are NaN or infinite are errors when they are more than
    ``max_nonfinite_fraction`` of the frame; fewer are masked bad pixels, are filled with the
    median of their neighbourhood, and ``header["NOTES"]`` says how many. By default none may be.
    A start time that cannot be understood is None, and a note says so; it never becomes another.
    Raises FrameError, one sentence with the remedy.
    """
    path = Path(path)
    return frame_from_bytes(
        _read_bytes(path),
        frame_id,
        path.name,
        allow_8bit=allow_8bit,
        expected_size=expected_size,
        max_nonfinite_fraction=max_nonfinite_fraction,
    )


def frame_from_bytes(
    content: Content,
    frame_id: int,
    name: str,
    *,
    allow_8bit: bool = False,
    expected_size: tuple[int, int] | None = None,
    max_nonfinite_fraction: float = MAX_NONFINITE_FRACTION,
    room: Room = lambda _: None,
) -> Frame:
    """The same as ``read_frame`` for a file that is already in memory (a camera's BLOB).

    ``room`` may give an array (height, width) into which pixels of 16 bits are written; else, and
    for all other pixels, a fresh one is made.
    """
    content = _decompress(content, name)
    if content[:9] == b"SIMPLE  =":
        raw, header = _fits_image(content, name)
    elif content[:4] in _IMAGE_MAGIC:
        raw, header = _plain_image(content, name), {}
    else:
        raise FrameError(f"{name} is neither FITS, TIFF nor PNG: convert it to FITS")
    _check_shape(raw, name, expected_size)
    notes: list[str] = []
    pixels = _to_pixels(raw, header, name, allow_8bit, room)
    if pixels.dtype == np.float32:
        note = _fill_nonfinite(pixels, name, max_nonfinite_fraction)
        notes += [note] if note else []
    t_start_utc_ns, note = start(header)
    notes += [note] if note else []
    ra_deg, dec_deg = pointing_deg(header)
    return Frame(
        frame_id=frame_id,
        name=name,
        pixels=pixels,
        t_start_utc_ns=t_start_utc_ns,
        exposure_s=exposure_s(header),
        scale_arcsec_px=scale(header),
        pointing_ra_icrs_deg=ra_deg,
        pointing_dec_icrs_deg=dec_deg,
        saturation_adu=255.0 if raw.dtype.itemsize == 1 else _saturation_adu(pixels, header),
        header={**header, NOTES_KEY: tuple(notes)},
    )


def _read_bytes(path: Path) -> bytes:
    if path.is_dir():
        raise FrameError(f"{path} is a directory: name the frames in it, e.g. {path}/*.fits")
    try:
        content = path.read_bytes()
    except FileNotFoundError as error:
        raise FrameError(f"{path} does not exist: check the name") from error
    except OSError as error:
        raise FrameError(f"{path} cannot be read: {error.strerror or error}") from error
    if not content:
        raise FrameError(f"{path} is empty (0 bytes): copy it again or leave it out")
    return content


def _decompress(content: Content, name: str) -> Content:
    try:
        if content[:3] == b"BZh":
            return bz2.decompress(content)
        if content[:2] == b"\x1f\x8b":
            return gzip.decompress(content)
    except (OSError, ValueError, EOFError, zlib.error) as error:
        raise FrameError(f"{name} is truncated or damaged: {error}; copy it again") from error
    return content


def _fits_image(content: Content, name: str) -> tuple[npt.NDArray[Any], dict[str, Any]]:
    """The first two-dimensional image, unscaled where it is 16-bit, and its merged header."""
    return read_plain(content) or _fits_image_by_astropy(bytes(content), name)


def _fits_image_by_astropy(content: bytes, name: str) -> tuple[npt.NDArray[Any], dict[str, Any]]:
    from astropy.io import fits

    truncated = FrameError(f"{name} is truncated: copy it again or leave it out")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with fits.HDUList.fromstring(content, do_not_scale_image_data=True) as hdus:
                for hdu in _images(hdus, name):
                    info = hdu.fileinfo()
                    if info and info["datLoc"] + _data_bytes(hdu) > len(content):
                        raise truncated
                    raw = hdu.data
                    if raw is None:
                        raise truncated
                    if raw.ndim == 3:
                        raw = raw[0]
                    return raw, _merged_header(hdus[0].header, hdu.header)
        except FrameError:
            raise
        except fits.VerifyError as error:
            raise FrameError(f"{name} is not valid FITS: {error}; write it anew") from error
        except _BROKEN as error:
            raise truncated from error
    if len(content) % 2880:
        raise truncated
    raise FrameError(f"{name} holds no two-dimensional image: name a file with a frame in it")


def _images(hdus: Any, name: str) -> Iterator[Any]:
    """HDUs with two axes, or three of which the first has one plane."""
    for hdu in hdus:
        if not hdu.is_image:
            continue
        shape = hdu.shape
        if len(shape) == 2 or (len(shape) == 3 and shape[0] == 1):
            yield hdu
        elif len(shape) == 3:
            raise FrameError(
                f"{name} has {shape[0]} planes of {shape[2]} x {shape[1]} px: "
                "give monochrome frames, one image a file"
            )


def _data_bytes(hdu: Any) -> int:
    """Bytes that the header promises, without the padding to a full block."""
    header = getattr(hdu, "_bintable", hdu).header
    axes = [int(header[f"NAXIS{i + 1}"]) for i in range(int(header["NAXIS"]))]
    items = int(header.get("PCOUNT", 0)) + math.prod(axes)
    return abs(int(header["BITPIX"])) // 8 * int(header.get("GCOUNT", 1)) * items


def _merged_header(primary: Any, own: Any) -> dict[str, Any]:
    """Cards as plain values; an image's own cards win over the primary header's."""
    merged: dict[str, Any] = {}
    for header in (primary, own):
        for card in header.cards:
            if card.keyword in ("", "COMMENT", "HISTORY"):
                continue
            try:
                value = card.value
            except (ValueError, OSError):
                continue
            if isinstance(value, bool | int | float | str):
                merged[card.keyword] = value
    return merged


def _plain_image(content: Content, name: str) -> npt.NDArray[Any]:
    import cv2

    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    finally:
        cv2.utils.logging.setLogLevel(level)
    if image is None:
        raise FrameError(f"{name} is truncated or damaged: copy it again or leave it out")
    return np.asarray(image)


def _check_shape(raw: npt.NDArray[Any], name: str, expected: tuple[int, int] | None) -> None:
    if raw.ndim != 2:
        raise FrameError(f"{name} is a colour image: give monochrome frames")
    height, width = raw.shape
    if min(height, width) < MIN_SIDE_PX:
        raise FrameError(
            f"{name} is {width} x {height} px: at least {MIN_SIDE_PX} x {MIN_SIDE_PX} are needed"
        )
    if expected is not None and (width, height) != expected:
        raise FrameError(
            f"{name} is {width} x {height} px, the configured camera gives "
            f"{expected[0]} x {expected[1]}: set optics.width_px and optics.height_px"
        )


def _to_pixels(
    raw: npt.NDArray[Any],
    header: Mapping[str, Any],
    name: str,
    allow_8bit: bool,
    room: Room,
) -> PixelArray:
    """uint16 where the file holds that, else float32; never the file's own memory."""
    bzero, bscale = float(header.get("BZERO", 0.0)), float(header.get("BSCALE", 1.0))
    if raw.dtype.itemsize == 1:
        if not allow_8bit:
            raise FrameError(
                f"{name} is 8-bit: faint streaks are lost in its steps; "
                "give the camera's 16-bit frames"
            )
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


def _shift_bits(raw: npt.NDArray[Any], bzero: float, bscale: float) -> int | None:
    """By how much a camera's values were shifted down before coding; None when they were not.

    Sessions keep 12 bits in 16 that way, and say so with BSCALE: the same frame comes back.
    """
    if raw.dtype.kind != "i" or raw.dtype.itemsize != 2 or bzero != 0.0:
        return None
    bits = math.log2(bscale) if bscale > 1.0 else 0.0
    if not (1.0 <= bits <= 8.0 and bits.is_integer()):
        return None
    highest = 0xFFFF >> int(bits)
    return int(bits) if int(raw.min()) >= 0 and int(raw.max()) <= highest else None


def _fill_nonfinite(pixels: npt.NDArray[Any], name: str, max_fraction: float) -> str | None:
    """Fill masked pixels in place with the median of their block; returns what to note."""
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


def _saturation_adu(pixels: PixelArray, header: Mapping[str, Any]) -> float:
    """Highest value a pixel can take; a 12-bit converter in 16 bits stops at 65520."""
    stated = header.get("SATURATE")
    if isinstance(stated, int | float) and not isinstance(stated, bool) and stated > 0:
        return float(stated)
    if pixels.dtype != np.uint16:
        return 65535.0
    used_bits = int(np.bitwise_or.reduce(pixels[::7], axis=None))
    step = used_bits & -used_bits
    return float(65536 - step) if step else 65535.0
