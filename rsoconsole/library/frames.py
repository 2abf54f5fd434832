"""Frames in any form (files, arrays, CCDData, HDUs), and ``detect`` and ``solve`` on them."""

import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path
from typing import (
    TYPE_CHECKING,
    Any,
    Literal,
    Protocol,
    TypeAlias,
    TypedDict,
    Unpack,
    overload,
    runtime_checkable,
)

import numpy as np
import numpy.typing as npt

from rsoconsole.base import FrameError, InputError, NotSolvedError
from rsoconsole.instruments import frame_from_array, frame_from_bytes, read_frames
from rsoconsole.library._given import (
    ConfigLike,
    Instant,
    Number,
    QuantityLike,
    SkyCoordLike,
    direction_deg,
    in_unit,
    instants_utc_ns,
    records_table,
    resolve_config,
)
from rsoconsole.library.plate import PlateWCS
from rsoconsole.night import Row
from rsoconsole.pipeline import MAX_MASKED, FrameDetector, FrameSolver
from rsoconsole.records import (
    TABLES,
    Detections,
    Frame,
    NotSolved,
    Photometry,
    measurement_id_of,
)
from rsoconsole.words import direction_fault


@runtime_checkable
class ImageLike(Protocol):
    """``astropy.nddata.CCDData``, or an image HDU of ``astropy.io.fits``."""

    @property
    def data(self) -> Any: ...

    @property
    def header(self) -> Any: ...


FrameLike: TypeAlias = str | PathLike[str] | npt.NDArray[Any] | ImageLike
"""A path (FITS, also .gz, .bz2, fpack; TIFF; PNG), an array (height, width) in ADU, an image."""
Frames: TypeAlias = FrameLike | Iterable[FrameLike]


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameOverrides:
    """Values given by the caller that override a frame's header; None: as in the header."""

    extension: str | None = None
    t_start_utc_ns: npt.NDArray[np.int64] | None = None
    """Start of exposure, UTC nanoseconds: () for a single frame, (N,) for N frames."""
    exposure_s: float | None = None
    scale_arcsec_px: float | None = None
    pointing_deg: tuple[float, float] | None = None


def frame_overrides(
    *,
    extension: str | None = None,
    t_start: Instant | Iterable[Instant] | None = None,
    exposure: Number | None = None,
    scale: Number | None = None,
    pointing: SkyCoordLike | None = None,
) -> FrameOverrides:
    """Convert the values that override frame headers to plain units.

    Raises InputError.
    """
    exposure_s = None if exposure is None else in_unit(exposure, "s", "exposure")
    if exposure_s is not None and exposure_s <= 0.0:
        raise InputError(f"exposure: {exposure_s:g} s must be above 0")
    scale_arcsec_px = None if scale is None else scale_in_arcsec_px(scale, "scale")
    return FrameOverrides(
        extension=extension,
        t_start_utc_ns=None if t_start is None else instants_utc_ns(t_start, "t_start"),
        exposure_s=exposure_s,
        scale_arcsec_px=scale_arcsec_px,
        pointing_deg=None if pointing is None else direction_deg(pointing, "pointing"),
    )


def scale_in_arcsec_px(value: Number, name: str) -> float:
    """Convert a scale, given as an angle or as an angle a pixel, to arcsec a pixel.

    ``name`` is what the error calls it. Raises InputError.
    """
    unit = str(getattr(value, "unit", ""))
    found = in_unit(value, "arcsec / pix" if "pix" in unit else "arcsec", name)
    if found <= 0.0:
        raise InputError(f"{name}: {found:g} arcsec a pixel must be above 0")
    return found


def read_caller_frames(
    frames: Frames, facts: FrameOverrides, *, max_masked: float = 0.0
) -> Iterator[Frame]:
    """Yield the caller's frames, each read when it is needed; they are numbered from 1.

    ``facts``: values that override the headers; ``max_masked``: largest fraction of pixels that may
    be NaN or infinite. Raises FrameError that names the frame that cannot be used, InputError for a
    value that is no frame.
    """
    given = tuple(_each(frames))
    if not given:
        raise InputError("no frames: the list is empty")
    t = facts.t_start_utc_ns
    if t is not None and t.ndim and len(t) != len(given):
        raise InputError(f"t_start: {len(t)} times for {len(given)} frames")
    if t is not None and not t.ndim and len(given) > 1:
        raise InputError(f"t_start: one time for {len(given)} frames: give one for each")
    count = 0
    for number_, each in enumerate(given, start=1):
        for frame in _read_one(each, number_, len(given), facts, max_masked):
            count += 1
            start = frame.t_start_utc_ns if t is None else int(np.atleast_1d(t)[number_ - 1])
            yield _with_facts(replace(frame, frame_id=count, t_start_utc_ns=start), facts)


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


def _read_one(
    each: Any, number_: int, count: int, facts: FrameOverrides, max_masked: float
) -> Iterator[Frame]:
    if isinstance(each, str | PathLike):
        path = Path(fspath(each)).expanduser()
        yield from read_frames(
            path, number_, extension=facts.extension, max_nonfinite_fraction=max_masked
        )
        return
    name = "the array" if count == 1 else f"array {number_}"
    if _is_hdu_list(each) or (hasattr(each, "writeto") and hasattr(each, "fileinfo")):
        yield _of_hdu(each, number_, count, facts.extension, max_masked)
        return
    if facts.extension is not None:
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
    """Frame of an HDU, as from a file of its own."""
    name = "the HDU" if count == 1 else f"HDU {number_}"
    if not isinstance(hdu, list) and hdu.data is None:
        raise FrameError(f"{name} holds no image: give one that does")
    file = io.BytesIO()
    hdu.writeto(file, output_verify="silentfix+ignore")
    return frame_from_bytes(
        file.getvalue(), number_, name, extension=extension, max_nonfinite_fraction=masked
    )


def _of_ccd(ccd: Any, number_: int, count: int, max_masked: float) -> Frame:
    """Frame of a CCDData; masked pixels are filled as bad pixels are."""
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
    """Frame of an array: its pixels and their mask, which may be None."""
    data, mask = array
    pixels = np.asarray(data)
    if mask is not None and np.any(mask):
        pixels = pixels.astype(np.float32)
        pixels[np.broadcast_to(np.asarray(mask, bool), pixels.shape)] = np.nan
        max_masked = max(max_masked, MAX_MASKED)
    return frame_from_array(pixels, number_, name, header=header, max_nonfinite_fraction=max_masked)


def _with_facts(frame: Frame, facts: FrameOverrides) -> Frame:
    ra_dec = facts.pointing_deg or (frame.pointing_ra_icrs_deg, frame.pointing_dec_icrs_deg)
    return replace(
        frame,
        exposure_s=frame.exposure_s if facts.exposure_s is None else facts.exposure_s,
        scale_arcsec_px=(
            frame.scale_arcsec_px if facts.scale_arcsec_px is None else facts.scale_arcsec_px
        ),
        pointing_ra_icrs_deg=ra_dec[0],
        pointing_dec_icrs_deg=ra_dec[1],
    )


if TYPE_CHECKING:
    from astropy.table import QTable


def detect(
    frames: Frames,
    *,
    tau: float | None = None,
    map_mode: Literal["fast", "paper"] | None = None,
    extension: str | None = None,
    exposure: Number | None = None,
    scale: Number | None = None,
    config: ConfigLike = None,
) -> "QTable":
    """Find streaks in frames, as ``rsoconsole detect`` does.

    ``frames``: a path (FITS, also .gz, .bz2 and fpack; TIFF; PNG), an array (height, width) of
    integers or real numbers in ADU, a ``CCDData``, an HDU, or any number of these; masked pixels
    are filled from their neighbours.
    ``tau``: the confidence that a detection must exceed; None: as configured.
    ``map_mode``: kind of the map that the network receives; None: as configured.
    ``extension``: which image of a FITS file that has several; ``"all"``: each of them.
    ``exposure`` (s), ``scale`` (arcsec/pix): for frames whose header does not state them; classes
    and notes depend on both.
    ``config``: None for the user's own.

    Returns one table for all frames, one row for each streak: in the order of the frames, in each
    frame the most confident first. Its columns are ``frame``, the frame's name, and those of a
    session's ``detections`` and ``magnitudes`` (``sessions/README.md``). A frame with a streak is
    plate-solved where its header has a direction; without one, magnitudes are instrumental.
    ``x_px`` and ``y_px`` are in pixels from the centre of the first pixel (0, 0), x along a row of
    the array. ``meta["frames"]`` names all frames, also those without a streak;
    ``meta["notes"]`` says what is unusual about them.

    Raises FrameError for a frame that cannot be used (damaged, NaN, three axes, below 64 px),
    InputError for other invalid arguments, ConfigError, ModelError.

    >>> streaks = rso.detect("frame.fits", tau=0.2)
    >>> streaks["x_px", "y_px", "length_px", "confidence"]
    """
    settings = resolve_config(config, {"detector.tau": tau, "detector.map_mode": map_mode})
    facts = frame_overrides(extension=extension, exposure=exposure, scale=scale)
    found: list[Detections] = []
    light: list[Row] = []
    names: dict[int, str] = {}
    notes: dict[str, None] = {}
    with FrameDetector(settings) as detector:
        for frame in read_caller_frames(frames, facts):
            one = detector.detect(frame)
            found.append(one.detections)
            light += _light_rows(one.detections, one.photometry)
            names[frame.frame_id] = frame.name
            notes |= dict.fromkeys(f"{frame.name}: {each}" for each in one.notes)
    meta: dict[str, Any] = {"frames": list(names.values()), "notes": list(notes)}
    return records_table("detections", found, meta, names=names, extra=LIGHT_COLUMNS, more=light)


LIGHT_COLUMNS = tuple(
    each for each in TABLES["magnitudes"].own if each.name not in {"measurement_id", "steps"}
)
"""Columns of a streak's brightness."""


def _light_rows(found: Detections, light: Photometry) -> list[Row]:
    """Return the brightness of each detection; values None where it was not measured."""
    by_id = {each.measurement_id: each for each in light.streaks}
    measured = (
        by_id.get(measurement_id_of(found.frame_id, n)) for n in range(len(found.detections))
    )
    return [
        {each.name: getattr(one, each.name, None) for each in LIGHT_COLUMNS} for one in measured
    ]


class SolveKeywords(TypedDict, total=False):
    """Keyword arguments of ``solve``."""

    center: SkyCoordLike | None
    ra: Number | None
    dec: Number | None
    radius: Number | None
    scale: Number | tuple[Number, Number] | None
    extension: str | None
    config: ConfigLike


@overload
def solve(frames: FrameLike, **hints: Unpack[SolveKeywords]) -> PlateWCS: ...


@overload
def solve(frames: Sequence[FrameLike], **hints: Unpack[SolveKeywords]) -> list[PlateWCS]: ...


def solve(
    frames: Frames,
    *,
    center: SkyCoordLike | None = None,
    ra: Number | None = None,
    dec: Number | None = None,
    radius: Number | None = None,
    scale: Number | tuple[Number, Number] | None = None,
    extension: str | None = None,
    config: ConfigLike = None,
) -> PlateWCS | list[PlateWCS]:
    """Plate-solve a frame, or several, as ``rsoconsole solve`` does.

    ``frames``: as for ``rso.detect``. ``center`` to ``scale`` are hints for the solver, which
    replace those of the header; wrong hints cost time and are named in ``wrong_hints``.
    ``center``: a ``SkyCoord``; or instead of it ``ra`` and ``dec``, quantities or degrees (ICRS).
    ``radius``: largest distance of the frame's centre from ``center``, quantity or degrees.
    ``scale``: in arcsec a pixel, quantity or number, or a pair of the lowest and the highest.
    ``extension``, ``config``: as for ``rso.detect``.

    Returns an astropy ``WCS`` (TAN or TAN-SIP, ICRS, pixels from 0), or a list of them where a list
    was given; each also has ``matched``, ``rms``, ``center``, ``scale``, ``rotation`` and
    ``is_flipped`` (``rso.PlateWCS``).

    Raises NotSolvedError with ``reason`` for a frame that has no solution, SolverError without
    index files, FrameError and InputError as ``rso.detect`` does.

    >>> wcs = rso.solve("frame.fits", center=SkyCoord("20h12m50s +46d01m"), scale=10.3)
    >>> wcs.pixel_to_world(120.0, 80.5), wcs.matched, wcs.rms
    """
    place = _place(center, ra, dec)
    radius_deg = None if radius is None else in_unit(radius, "deg", "radius")
    if radius_deg is not None and not 0.0 < radius_deg <= 180.0:
        raise InputError(f"radius: {radius_deg:g} deg must be above 0, and 180 at most")
    settings = resolve_config(config)
    scales = _scales(scale, settings.solver.scale_tolerance)
    found: list[PlateWCS] = []
    with FrameSolver.open(settings) as solver:
        for frame in read_caller_frames(
            frames, frame_overrides(extension=extension), max_masked=MAX_MASKED
        ):
            solved = solver.solve(
                frame,
                ra_icrs_deg=None if place is None else place[0],
                dec_icrs_deg=None if place is None else place[1],
                radius_deg=radius_deg,
                scale_arcsec_px=scales,
            )
            if isinstance(solved.solution, NotSolved):
                missing = ", ".join(solved.index_missing)
                remedy = f"; index files that its scale wants are missing: {missing}"
                raise NotSolvedError(frame.name, solved.solution.reason, remedy if missing else "")
            found.append(
                PlateWCS.of_solution(
                    solved.solution,
                    name=frame.name,
                    shape=frame.pixels.shape,
                    wrong_hints=tuple(each.words for each in solved.wrong),
                    notes=solved.notes,
                )
            )
    is_list = isinstance(frames, list | tuple) and not _is_hdu_list(frames)
    return found if is_list or len(found) != 1 else found[0]


def _place(
    center: SkyCoordLike | None, ra: Number | None, dec: Number | None
) -> tuple[float, float] | None:
    if (ra is None) != (dec is None):
        raise InputError("ra and dec go together")
    if center is not None and ra is not None:
        raise InputError("center or ra and dec, not both")
    if center is not None:
        return direction_deg(center, "center")
    if ra is None or dec is None:
        return None
    ra_deg, dec_deg = in_unit(ra, "deg", "ra"), in_unit(dec, "deg", "dec")
    if fault := direction_fault(ra_deg, dec_deg):
        raise InputError(fault)
    return ra_deg % 360.0, dec_deg


def _scales(
    scale: Number | tuple[Number, Number] | None, tolerance: float
) -> tuple[float, float] | None:
    """Lowest and highest scale, arcsec a pixel."""
    if scale is None:
        return None
    if isinstance(scale, tuple):
        if len(scale) != 2:
            raise InputError("scale: one value, or the lowest and the highest")
        low, high = scale_in_arcsec_px(scale[0], "scale"), scale_in_arcsec_px(scale[1], "scale")
    elif isinstance(scale, QuantityLike) and getattr(scale, "shape", ()) == (2,):
        pair: Any = scale
        low, high = scale_in_arcsec_px(pair[0], "scale"), scale_in_arcsec_px(pair[1], "scale")
    else:
        middle = scale_in_arcsec_px(scale, "scale")
        low, high = middle * (1.0 - tolerance), middle * (1.0 + tolerance)
    if low > high:
        raise InputError(f"scale: the lowest, {low:g}, is above the highest, {high:g}")
    return low, high
