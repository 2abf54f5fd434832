"""Reads frames from files: FITS as cameras and archives write it, TIFF and PNG.

The kind of a file is recognised by its first bytes, not by its name. A file is in memory at most
twice: once as bytes, once as pixels.
"""

import bz2
import gzip
import io
import logging
import stat
import zlib
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from rsoconsole.base import FrameError
from rsoconsole.instruments.frames._decoder_child import DecodeRequest
from rsoconsole.instruments.frames._fits_by_astropy import ALL, structure_fault
from rsoconsole.instruments.frames._frame_decoder import decoder
from rsoconsole.instruments.frames._frame_pixels import (
    Room,
    fill_nonfinite,
    noiseless_sky_note,
    one_plane,
    saturation_adu,
    to_pixels,
)
from rsoconsole.instruments.frames.exposure_time import exposure_time
from rsoconsole.instruments.frames.frame_header import (
    EXTENSION_KEY,
    NOTES_KEY,
    camera_mode,
    header_notes,
    plate_scale_arcsec_px,
    pointing_deg,
)
from rsoconsole.instruments.frames.plain_fits import Content, FitsImage, read_plain
from rsoconsole.records import Frame

MAGIC = (b"\x89PNG", b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")


def fits_image(
    content: Content, name: str, extension: str | None = None, min_side_px: int = 1
) -> FitsImage:
    """Read one image of a FITS file.

    ``extension``: which image, by number (0 is the primary unit), name (EXTNAME) or
    ``NAME,VERSION``; None: the first image. Images with a side below ``min_side_px`` count only
    where there are no larger ones. Every file that is not plain is decoded in another process.
    Raises FrameError.
    """
    fault = structure_fault(content)
    if fault is not None:
        raise FrameError(f"{name} is damaged: {fault} cannot be; copy it again or leave it out")
    plain = read_plain(content)
    if plain is not None and extension in (None, "0"):
        return FitsImage(raw=plain[0], header=plain[1])
    request = DecodeRequest(name=name, extension=extension, min_side_px=min_side_px)
    return decoder().decode(request, content)


MIN_SIDE_PX = 64
MAX_BYTES = 400_000_000
"""Largest file that is read, packed or unpacked, bytes: 200 million pixels of 16 bits."""
MAX_NONFINITE_FRACTION = 0.0
"""Largest fraction of NaN or infinite pixels, by default: a camera's frame has none."""
_FITS_MAGIC = b"SIMPLE  ="
_MAX_NAMED = 8
_SCALING = ("BZERO", "BSCALE", "BLANK")
log = logging.getLogger(__name__)
OTHERS_KEY = "OTHER_IMAGES"
"""Key in a frame's header for the labels (a tuple) of the other images in its file."""
EIGHT_BIT = "8 bits a pixel: faint streaks are lost in its steps; give the camera's 16-bit frames"
COLOURS = "a colour picture: its colours are added up; give the camera's raw frames"


def read_frame(
    path: Path,
    frame_id: int,
    *,
    extension: str | None = None,
    max_nonfinite_fraction: float = MAX_NONFINITE_FRACTION,
) -> Frame:
    """Read one frame from a file: FITS (also .gz, .bz2, fpack), TIFF or PNG.

    ``extension``: which image of a FITS file with several images, by the name, ``NAME,VERSION`` or
    number of its extension; None: the first one, and a note names the others.
    ``max_nonfinite_fraction``: up to this fraction of the frame, pixels that are NaN or infinite
    count as masked bad pixels: they are filled with the median of their neighbourhood, and a note
    says how many; more are an error.

    Pixels are uint16 or float32, native byte order, (height, width). A start time that cannot be
    understood becomes None, with a note. Frames of 8 bits and coloured pictures get a note, too;
    notes are in ``header["NOTES"]``. Raises FrameError, one sentence with the remedy.
    """
    path = Path(path)
    return frame_from_bytes(
        _read_bytes(path),
        frame_id,
        path.name,
        extension=extension,
        max_nonfinite_fraction=max_nonfinite_fraction,
    )


def read_frames(
    path: Path,
    frame_id: int,
    *,
    extension: str | None = None,
    max_nonfinite_fraction: float = MAX_NONFINITE_FRACTION,
) -> Iterator[Frame]:
    """Yield the frame of a file as ``read_frame`` does; for extension ``ALL``, every image."""
    path = Path(path)
    is_all = extension is not None and extension.strip().lower() == ALL
    read = partial(
        frame_from_bytes,
        _read_bytes(path),
        frame_id,
        path.name,
        max_nonfinite_fraction=max_nonfinite_fraction,
        is_alone=not is_all,
    )
    frame = read(extension=None if is_all else extension)
    yield frame
    for label in frame.header.get(OTHERS_KEY, ()) if is_all else ():
        yield read(extension=label)


def frame_from_bytes(
    content: Content,
    frame_id: int,
    name: str,
    *,
    extension: str | None = None,
    max_nonfinite_fraction: float = MAX_NONFINITE_FRACTION,
    room: Room = lambda _: None,
    is_alone: bool = True,
) -> Frame:
    """Make a frame of a file in memory (a camera's BLOB); arguments as of ``read_frame``.

    ``room``: function that may return an array (height, width) into which 16-bit pixels are
    written; for all other pixels a new array is made. ``is_alone``: whether to note that the file
    has other images.
    """
    full_adu: float | None = None
    notes: list[str] = []
    try:
        content = _decompress(content, name)
        if content[: len(_FITS_MAGIC)] == _FITS_MAGIC:
            image = fits_image(content, name, extension, MIN_SIDE_PX)
            bits = image.raw.dtype.itemsize * 8
            notes += _notes_of_others(image) if is_alone else []
        elif content[:4] in MAGIC:
            stored = decoder().decode(DecodeRequest(name=name, is_picture=True), content).raw
            bits = stored.dtype.itemsize * 8
            raw, full_adu, is_coloured = one_plane(stored, name)
            image = FitsImage(raw=raw, header={})
            notes += [COLOURS] if is_coloured else []
        else:
            raise FrameError(f"{name} is neither FITS, TIFF nor PNG: convert it to FITS")
        return _frame_of(
            image,
            frame_id,
            name,
            notes,
            full_adu,
            bits=bits,
            max_nonfinite_fraction=max_nonfinite_fraction,
            room=room,
        )
    except (ArithmeticError, AttributeError, LookupError, MemoryError, TypeError, ValueError) as e:
        # A header may say anything; whatever stumbles over it, the frame is what is wrong.
        log.warning("%s cannot be understood", name, exc_info=True)
        raise FrameError(
            f"{name} is damaged: its header or pixels make no sense ({type(e).__name__}); copy it"
            " again or leave it out"
        ) from e


def frame_from_array(
    array: npt.NDArray[Any],
    frame_id: int,
    name: str,
    *,
    header: Mapping[str, Any] | None = None,
    max_nonfinite_fraction: float = MAX_NONFINITE_FRACTION,
) -> Frame:
    """Make a frame of an array of pixels, (height, width), with the checks of ``read_frame``.

    ``array``: integers or real numbers of any size, ADU; it is not changed. ``header``: FITS cards
    by name; BZERO and BSCALE must be applied to the array already, and left out. Raises FrameError.
    """
    raw = np.asarray(array)
    if raw.ndim != 2:
        shape = " x ".join(map(str, raw.shape)) or "a single number"
        raise FrameError(
            f"{name} has {raw.ndim} axes ({shape}): a frame is (height, width); give one plane of"
            " it, or a list of frames"
        )
    if raw.dtype.kind not in "iuf":
        raise FrameError(f"{name} holds {raw.dtype} pixels: give integers or real numbers")
    cards = {key: value for key, value in (header or {}).items() if key not in _SCALING}
    try:
        return _frame_of(
            FitsImage(raw=raw.astype(raw.dtype.newbyteorder("="), copy=False), header=cards),
            frame_id,
            name,
            [],
            None,
            bits=raw.dtype.itemsize * 8,
            max_nonfinite_fraction=max_nonfinite_fraction,
            room=lambda _: None,
        )
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        log.warning("%s cannot be understood", name, exc_info=True)
        raise FrameError(
            f"{name}: its header makes no sense ({type(error).__name__}): give it without"
        ) from error


def _frame_of(
    image: FitsImage,
    frame_id: int,
    name: str,
    notes: list[str],
    full_adu: float | None,
    *,
    bits: int,
    max_nonfinite_fraction: float,
    room: Room,
) -> Frame:
    """Make a frame of an image.

    ``full_adu``: its saturation; None: it is found from header and pixels.
    """
    raw, header = image.raw, dict(image.header)
    _check_shape(raw, name)
    if bits == 8:
        notes.append(EIGHT_BIT)
    pixels = to_pixels(raw, header, name, room)
    if pixels.dtype == np.float32:
        note = fill_nonfinite(pixels, name, max_nonfinite_fraction)
        notes += [note] if note else []
    notes += [note] if (note := noiseless_sky_note(pixels)) else []
    full_adu = saturation_adu(raw, pixels, header) if full_adu is None else full_adu
    if bits == 8:
        # Kept in 16 bits it would not show any more.
        header.setdefault("SATURATE", full_adu)
    exposed = exposure_time(header)
    notes += header_notes(header)
    ra_deg, dec_deg = pointing_deg(header)
    if image.label:
        header |= {EXTENSION_KEY: image.label, OTHERS_KEY: image.others}
    return Frame(
        frame_id=frame_id,
        name=f"{name}[{image.label}]" if image.label else name,
        pixels=pixels,
        t_start_utc_ns=exposed.start_utc_ns,
        exposure_s=exposed.exposure_s,
        scale_arcsec_px=plate_scale_arcsec_px(header),
        pointing_ra_icrs_deg=ra_deg,
        pointing_dec_icrs_deg=dec_deg,
        saturation_adu=full_adu,
        camera=camera_mode(header),
        header={**header, NOTES_KEY: tuple(notes)},
    )


def _notes_of_others(image: FitsImage) -> list[str]:
    if not image.others:
        return []
    shown = ", ".join(image.others[:_MAX_NAMED])
    more = len(image.others) - _MAX_NAMED
    return [
        f"image {image.label} of {len(image.others) + 1} in the file; --extension takes another"
        f" ({shown}{f' and {more} more' if more > 0 else ''}) or {ALL}"
    ]


def _read_bytes(path: Path) -> bytes:
    if path.is_dir():
        raise FrameError(f"{path} is a directory: name the frames in it, e.g. {path}/*.fits")
    try:
        # A pipe or a device would be waited for, or never end.
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):
            raise FrameError(f"{path} is no regular file: name a frame")
        if found.st_size > MAX_BYTES:
            raise FrameError(
                f"{path} has {found.st_size / 1e9:.1f} GB, no frame more than"
                f" {MAX_BYTES / 1e9:.1f}: give one frame a file"
            )
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
            return _unpacked(bz2.BZ2File(io.BytesIO(content)), name)
        if content[:2] == b"\x1f\x8b":
            return _unpacked(gzip.GzipFile(fileobj=io.BytesIO(content)), name)
    except (OSError, ValueError, EOFError, zlib.error) as error:
        raise FrameError(f"{name} is truncated or damaged: {error}; copy it again") from error
    return content


def _unpacked(file: bz2.BZ2File | gzip.GzipFile, name: str) -> bytes:
    """Decompress a whole file, unless it is longer than any frame."""
    with file:
        content = file.read(MAX_BYTES + 1)
    if len(content) > MAX_BYTES:
        raise FrameError(f"{name} unpacks to more than {MAX_BYTES / 1e9:.1f} GB: leave it out")
    return content


def _check_shape(raw: npt.NDArray[Any], name: str) -> None:
    height, width = raw.shape
    if min(height, width) < MIN_SIDE_PX:
        raise FrameError(
            f"{name} is {width} x {height} px: at least {MIN_SIDE_PX} x {MIN_SIDE_PX} are needed"
        )
