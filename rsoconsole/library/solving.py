"""``rso.solve``: plate solutions of frames."""

from collections.abc import Sequence
from typing import Any, TypedDict, Unpack, overload

from rsoconsole.errors import InputError, NotSolvedError
from rsoconsole.library.frames import FrameLike, Frames, frame_facts, opened, scale_of
from rsoconsole.library.given import (
    ConfigLike,
    Number,
    QuantityLike,
    SkyCoordLike,
    config_of,
    direction_deg,
    number,
)
from rsoconsole.library.plate import PlateWCS
from rsoconsole.pipeline.single import MOST_MASKED, FrameSolver
from rsoconsole.records import NotSolved
from rsoconsole.words import no_direction


class Hints(TypedDict, total=False):
    """What may be given beside frames."""

    center: SkyCoordLike | None
    ra: Number | None
    dec: Number | None
    radius: Number | None
    scale: Number | tuple[Number, Number] | None
    extension: str | None
    config: ConfigLike


@overload
def solve(frames: FrameLike, **hints: Unpack[Hints]) -> PlateWCS: ...


@overload
def solve(frames: Sequence[FrameLike], **hints: Unpack[Hints]) -> list[PlateWCS]: ...


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

    ``frames`` as ``rso.detect`` takes them. Hints come from the header; what is given overrides
    it: ``center``, a ``SkyCoord``, or ``ra`` and ``dec`` (quantities; plain numbers are degrees,
    ICRS), ``radius`` about it (degrees), ``scale`` in arcsec a pixel, a quantity or number, or
    the lowest and the highest. Wrong hints cost time and are named in ``wrong_hints``.
    ``extension`` and ``config`` as ``rso.detect`` has them.

    Returns an astropy ``WCS`` (TAN or TAN-SIP, ICRS, pixels from 0) of each frame, a list where a
    list was given, with ``matched``, ``rms``, ``center``, ``scale``, ``rotation`` and
    ``is_flipped`` (``rso.PlateWCS``).

    Raises NotSolvedError with ``reason`` for a frame that has no solution, SolverError without
    index files, FrameError and InputError as ``rso.detect`` does.

    >>> wcs = rso.solve("frame.fits", center=SkyCoord("20h12m50s +46d01m"), scale=10.3)
    >>> wcs.pixel_to_world(120.0, 80.5), wcs.matched, wcs.rms
    """
    place = _place(center, ra, dec)
    radius_deg = None if radius is None else number(radius, "deg", "radius")
    if radius_deg is not None and not 0.0 < radius_deg <= 180.0:
        raise InputError(f"radius: {radius_deg:g} deg must be above 0, and 180 at most")
    settings = config_of(config)
    scales = _scales(scale, settings.solver.scale_tolerance)
    found: list[PlateWCS] = []
    with FrameSolver.open(settings) as solver:
        for frame in opened(frames, frame_facts(extension=extension), max_masked=MOST_MASKED):
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
    is_one = len(found) == 1 and not _is_list(frames)
    return found[0] if is_one else found


def _is_list(frames: Any) -> bool:
    return isinstance(frames, list | tuple) and not hasattr(frames, "writeto")


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
    ra_deg, dec_deg = number(ra, "deg", "ra"), number(dec, "deg", "dec")
    if fault := no_direction(ra_deg, dec_deg):
        raise InputError(fault)
    return ra_deg % 360.0, dec_deg


def _scales(
    scale: Number | tuple[Number, Number] | None, tolerance: float
) -> tuple[float, float] | None:
    """Lowest and highest, arcsec a pixel."""
    if scale is None:
        return None
    if isinstance(scale, tuple):
        if len(scale) != 2:
            raise InputError("scale: one value, or the lowest and the highest")
        low, high = scale_of(scale[0], "scale"), scale_of(scale[1], "scale")
    elif isinstance(scale, QuantityLike) and getattr(scale, "shape", ()) == (2,):
        pair: Any = scale
        low, high = scale_of(pair[0], "scale"), scale_of(pair[1], "scale")
    else:
        middle = scale_of(scale, "scale")
        low, high = middle * (1.0 - tolerance), middle * (1.0 + tolerance)
    if low > high:
        raise InputError(f"scale: the lowest, {low:g}, is above the highest, {high:g}")
    return low, high
