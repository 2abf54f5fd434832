"""Frames of any make: files, arrays, astropy's CCDData and HDUs, one of them or many."""

import io
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
import numpy.typing as npt

from rsoconsole.errors import FrameError, InputError
from rsoconsole.instruments.frames import frame_from_array, frame_from_bytes, read_frames
from rsoconsole.library.given import (
    Instant,
    Number,
    SkyCoordLike,
    direction_deg,
    instants_utc_ns,
    number,
)
from rsoconsole.pipeline.single import MOST_MASKED
from rsoconsole.records import Frame


@runtime_checkable
class ImageLike(Protocol):
    """``astropy.nddata.CCDData``, or an image HDU of ``astropy.io.fits``."""

    @property
    def data(self) -> Any: ...

    @property
    def header(self) -> Any: ...


FrameLike: TypeAlias = str | PathLike[str] | npt.NDArray[Any] | ImageLike
"""FITS (also .gz, .bz2, fpack), TIFF or PNG by its path; pixels (height, width) in ADU."""
Frames: TypeAlias = FrameLike | Iterable[FrameLike]


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameFacts:
    """What the caller says of frames; it wins over their headers."""

    extension: str | None = None
    t_start_utc_ns: npt.NDArray[np.int64] | None = None
    """() or one a frame."""
    exposure_s: float | None = None
    scale_arcsec_px: float | None = None
    pointing_deg: tuple[float, float] | None = None


def frame_facts(
    *,
    extension: str | None = None,
    t_start: Instant | Iterable[Instant] | None = None,
    exposure: Number | None = None,
    scale: Number | None = None,
    pointing: SkyCoordLike | None = None,
) -> FrameFacts:
    """The same with units dealt with. Raises InputError."""
    exposure_s = None if exposure is None else number(exposure, "s", "exposure")
    if exposure_s is not None and exposure_s <= 0.0:
        raise InputError(f"exposure: {exposure_s:g} s must be above 0")
    scale_arcsec_px = None if scale is None else scale_of(scale, "scale")
    return FrameFacts(
        extension=extension,
        t_start_utc_ns=None if t_start is None else instants_utc_ns(t_start, "t_start"),
        exposure_s=exposure_s,
        scale_arcsec_px=scale_arcsec_px,
        pointing_deg=None if pointing is None else direction_deg(pointing, "pointing"),
    )


def scale_of(value: Number, name: str) -> float:
    """Arcsec a pixel, of a quantity an angle or an angle a pixel. Raises InputError."""
    unit = str(getattr(value, "unit", ""))
    found = number(value, "arcsec / pix" if "pix" in unit else "arcsec", name)
    if found <= 0.0:
        raise InputError(f"{name}: {found:g} arcsec a pixel must be above 0")
    return found


def opened(frames: Frames, said: FrameFacts, *, max_masked: float = 0.0) -> Iterator[Frame]:
    """Every frame, numbered from 1, read when it is asked for.

    Raises FrameError naming the frame that cannot be used, InputError for what is none.
    """
    given = tuple(_each(frames))
    if not given:
        raise InputError("no frames: the list is empty")
    t = said.t_start_utc_ns
    if t is not None and t.ndim and len(t) != len(given):
        raise InputError(f"t_start: {len(t)} times for {len(given)} frames")
    if t is not None and not t.ndim and len(given) > 1:
        raise InputError(f"t_start: one time for {len(given)} frames: give one for each")
    count = 0
    for number_, each in enumerate(given, start=1):
        for frame in _opened(each, number_, len(given), said, max_masked):
            count += 1
            start = frame.t_start_utc_ns if t is None else int(np.atleast_1d(t)[number_ - 1])
            yield _with_facts(replace(frame, frame_id=count, t_start_utc_ns=start), said)


def _each(frames: Any) -> Iterable[Any]:
    if isinstance(frames, np.ndarray):
        return tuple(frames) if frames.dtype == object else (frames,)
    if isinstance(frames, str | PathLike | ImageLike) or _is_hdu_list(frames):
        return (frames,)
    if isinstance(frames, Iterable) and not isinstance(frames, bytes | Mapping):
        return frames
    raise InputError(
        f"{type(frames).__name__} is no frame: give a path, an array (height, width), a CCDData,"
        " an HDU, or a list of them"
    )


def _is_hdu_list(value: Any) -> bool:
    return isinstance(value, list) and hasattr(value, "writeto")


def _opened(
    each: Any, number_: int, count: int, said: FrameFacts, max_masked: float
) -> Iterator[Frame]:
    if isinstance(each, str | PathLike):
        path = Path(fspath(each)).expanduser()
        yield from read_frames(
            path, number_, extension=said.extension, max_nonfinite_fraction=max_masked
        )
        return
    name = "the array" if count == 1 else f"array {number_}"
    if _is_hdu_list(each) or (hasattr(each, "writeto") and hasattr(each, "fileinfo")):
        yield _of_hdu(each, number_, count, said.extension, max_masked)
        return
    if said.extension is not None:
        raise InputError("extension: only FITS files and HDU lists have several images")
    if isinstance(each, np.ma.MaskedArray):
        yield _masked((each.data, each.mask), number_, name, header={}, max_masked=max_masked)
    elif isinstance(each, np.ndarray):
        yield frame_from_array(each, number_, name, max_nonfinite_fraction=max_masked)
    elif isinstance(each, ImageLike):
        yield _of_ccd(each, number_, count, max_masked)
    else:
        raise InputError(
            f"frame {number_} is a {type(each).__name__}: give a path, an array (height, width),"
            " a CCDData or an HDU"
        )


def _of_hdu(hdu: Any, number_: int, count: int, extension: str | None, masked: float) -> Frame:
    """As from the file that it would be."""
    name = "the HDU" if count == 1 else f"HDU {number_}"
    if not isinstance(hdu, list) and hdu.data is None:
        raise FrameError(f"{name} holds no image: give one that does")
    file = io.BytesIO()
    hdu.writeto(file, output_verify="silentfix+ignore")
    return frame_from_bytes(
        file.getvalue(), number_, name, extension=extension, max_nonfinite_fraction=masked
    )


def _of_ccd(ccd: Any, number_: int, count: int, max_masked: float) -> Frame:
    """What its mask covers is filled as bad pixels are."""
    name = "the CCDData" if count == 1 else f"CCDData {number_}"
    plain = {
        str(key): value
        for key, value in dict(ccd.header).items()
        if isinstance(value, bool | int | float | str)
    }
    array = (ccd.data, getattr(ccd, "mask", None))
    return _masked(array, number_, name, header=plain, max_masked=max_masked)


def _masked(
    array: tuple[Any, Any], number_: int, name: str, *, header: Mapping[str, Any], max_masked: float
) -> Frame:
    """``array``: the pixels and their mask, which may be None."""
    data, mask = array
    pixels = np.asarray(data)
    if mask is not None and np.any(mask):
        pixels = pixels.astype(np.float32)
        pixels[np.broadcast_to(np.asarray(mask, bool), pixels.shape)] = np.nan
        max_masked = max(max_masked, MOST_MASKED)
    return frame_from_array(pixels, number_, name, header=header, max_nonfinite_fraction=max_masked)


def _with_facts(frame: Frame, said: FrameFacts) -> Frame:
    ra_dec = said.pointing_deg or (frame.pointing_ra_icrs_deg, frame.pointing_dec_icrs_deg)
    return replace(
        frame,
        exposure_s=frame.exposure_s if said.exposure_s is None else said.exposure_s,
        scale_arcsec_px=(
            frame.scale_arcsec_px if said.scale_arcsec_px is None else said.scale_arcsec_px
        ),
        pointing_ra_icrs_deg=ra_dec[0],
        pointing_dec_icrs_deg=ra_dec[1],
    )
