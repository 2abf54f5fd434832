"""Export of single frames: FITS with the plate solution in the header, and DS9 regions."""

import io
import math
import re
import warnings
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import erfa
import numpy as np

from rsoconsole.base import ExportError
from rsoconsole.config import Config
from rsoconsole.library.formats.rows import MeasuredRow
from rsoconsole.night import frames_of, predicted_sigma_arcsec
from rsoconsole.pipeline import mid_exposure_utc_ns
from rsoconsole.records import FrameTaken, Solution, TrackState
from rsoconsole.session import SessionReader
from rsoconsole.sky import MJD_UNIX, wcs_cards, wrap_360
from rsoconsole.tracking import sky_covariance_arcsec2
from rsoconsole.words import NS_PER_DAY, utc_ns_to_iso


@dataclass(slots=True, kw_only=True)
class FrameOnRecord:
    """One exposure on record, with its plate solution, prediction and measurements."""

    taken: FrameTaken
    solution: Solution | None = None
    predicted: TrackState | None = None
    rows: list[MeasuredRow] = field(default_factory=list)
    """Measurements of the frame that count, not superseded."""
    file: Path | None = None
    """File of the frame's pixels; None where they are not kept."""


def frames_on_record(session: Path, rows: Iterable[MeasuredRow]) -> dict[int, FrameOnRecord]:
    """Gather the exposures of a session by frame number, each with its measurements.

    ``rows``: the session's measurements; superseded ones are left out. Raises SessionError.
    """
    reader = SessionReader(session)
    frames = {
        each.frame_id: FrameOnRecord(
            taken=each.taken,
            solution=each.solution if isinstance(each.solution, Solution) else None,
            predicted=each.predicted,
            file=reader.frame_path(each.frame_id),
        )
        for each in frames_of(record for _, _, record in reader.records())
        if each.taken is not None
    }
    for row in rows:
        if row.frame_id in frames and not row.is_superseded:
            frames[row.frame_id].rows.append(row)
    return frames


def selected_frames(frames: dict[int, FrameOnRecord], numbers: tuple[int, ...] | None) -> list[int]:
    """Return the chosen frame numbers in ascending order; None chooses all.

    Raises ExportError for a number that the session does not have.
    """
    if numbers is None:
        return sorted(frames)
    unknown = [str(number) for number in numbers if number not in frames]
    if unknown:
        known = f"{min(frames)} to {max(frames)}" if frames else "none"
        raise ExportError(f"the session has no frame {', '.join(unknown)}; it has {known}")
    return sorted(numbers)


def parse_numbers(text: str) -> tuple[int, ...]:
    """Parse frame numbers written like ``3,9-12``. Raises ValueError."""
    numbers: set[int] = set()
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        if not first.isdecimal() or (dash and not last.isdecimal()):
            raise ValueError(f"{part.strip()!r} is no frame: write them like 3,9-12")
        begin, end = int(first), int(last or first)
        if end < begin or end - begin > 1_000_000:
            raise ValueError(f"{part.strip()!r} is no range of frames: the smaller number first")
        numbers.update(range(begin, end + 1))
    return tuple(sorted(numbers))


STREAKS = "STREAKS"
_PLATE = re.compile(
    r"WCSAXES|WCSNAME|C(?:TYPE|UNIT|RVAL|RPIX|DELT|ROTA|RDER|SYER)[12]|(?:CD|PC)[12]_[12]|"
    r"CD00[12]00[12]|PC00[12]00[12]|PV[12]_\d+|LONPOLE|LATPOLE|RADE(?:SYS|CSYS)|EQUINOX|EPOCH|"
    r"[AB]P?_(?:ORDER|DMAX|\d+_\d+)|IMAGE[WH]"
)
_COLUMNS = (
    ("X_PX", "x_px", "pix", "column of the midpoint, 0-based"),
    ("Y_PX", "y_px", "pix", "row of it, 0-based"),
    ("RA_ICRS", "ra_icrs_deg", "deg", "midpoint at mid-exposure"),
    ("DEC_ICRS", "dec_icrs_deg", "deg", "midpoint at mid-exposure"),
    ("SIG_RA", "sigma_ra_arcsec", "arcsec", "one sigma, times cos Dec"),
    ("SIG_DEC", "sigma_dec_arcsec", "arcsec", "one sigma"),
    ("CORR", "correlation", None, "correlation of both errors"),
    ("CONF", "confidence", None, "confidence, 0 to 1"),
    ("RA_A", "ra_a_icrs_deg", "deg", "one end"),
    ("DEC_A", "dec_a_icrs_deg", "deg", "one end"),
    ("RA_B", "ra_b_icrs_deg", "deg", "the other end"),
    ("DEC_B", "dec_b_icrs_deg", "deg", "the other end"),
)
"""Name, field of the row, unit and comment."""


def solved_fits(frame: FrameOnRecord, config: Config) -> bytes:
    """Return a FITS file of the frame's pixels, with the plate solution in its header.

    Raises ExportError for a frame that was not kept, not solved, or whose file cannot be read.
    """
    number = frame.taken.frame_id
    if frame.file is None:
        raise ExportError(
            f"frame {number} was not kept: session.keep_frames says which frames keep their pixels"
        )
    if frame.solution is None:
        raise ExportError(f"frame {number} has no plate solution")
    from astropy.io import fits
    from astropy.utils.exceptions import AstropyUserWarning

    content = io.BytesIO()
    try:
        # Without decompression the image's bytes pass through as they are. Of a file that was cut
        # astropy only warns.
        with (
            warnings.catch_warnings(action="error", category=AstropyUserWarning),
            fits.open(frame.file, disable_image_compression=True, memmap=False) as hdus,
        ):
            image = hdus[1]
            if image.header.get("ZIMAGE") is not True:
                raise ExportError(f"{frame.file} holds no image of a session")
            _write_plate(image.header, frame, frame.solution, config)
            parts = fits.HDUList([fits.PrimaryHDU(), image, _streaks(frame)])
            parts.writeto(content, checksum=True)
    except (OSError, IndexError, TypeError, ValueError, AstropyUserWarning) as error:
        raise ExportError(f"frame {number} cannot be read from {frame.file}: {error}") from error
    return content.getvalue()


def _write_plate(header: Any, frame: FrameOnRecord, solution: Solution, config: Config) -> None:
    for keyword in [key for key in header if _PLATE.fullmatch(key)]:
        header.remove(keyword, ignore_missing=True, remove_all=True)
    taken = frame.taken
    words = {"CRPIX1": "1-based", "RADESYS": "its axes; there is no equinox"}
    for key, value in wcs_cards(solution.wcs, taken.width_px, taken.height_px).items():
        header[key] = (value, words.get(key, ""))
    header["PLTMATCH"] = (solution.matched, "stars that the plate rests on")
    header["PLTRMS"] = (solution.rms_arcsec, "[arcsec] residual of a star, per axis")
    _write_time(header, frame, config)
    site = config.site.to_site()
    place_m = erfa.gd2gc(
        1, math.radians(site.longitude_deg), math.radians(site.latitude_deg), site.elevation_m
    )
    for axis, value in zip("XYZ", place_m, strict=True):
        header[f"OBSGEO-{axis}"] = (float(value), "[m] site, ITRS")
    header["EXTNAME"] = ("IMAGE", "pixels as the camera gave them")
    header.add_history("Plate solution, times and the table STREAKS by rsoconsole")


def _write_time(header: Any, frame: FrameOnRecord, config: Config) -> None:
    """Write the shutter's instants beside DATE-OBS, which stays the camera's."""
    mid_ns, exposure_s = mid_exposure_utc_ns(frame.taken, config.exposure), frame.taken.exposure_s
    if mid_ns is None or exposure_s is None:
        return
    half_ns = round(exposure_s * 5e8)
    start_ns = frame.taken.t_start_utc_ns or 0
    header["TIMESYS"] = ("UTC", "of all times here")
    header["DATE-OBS"] = header.get("DATE-OBS") or _date(start_ns)
    header["EXPTIME"] = header.get("EXPTIME", exposure_s)
    instants = (("BEG", mid_ns - half_ns, "shutter opens"), ("AVG", mid_ns, "mid-exposure"))
    for name, t_utc_ns, words in (*instants, ("END", mid_ns + half_ns, "shutter closes")):
        header[f"DATE-{name}"] = (_date(t_utc_ns), words)
        header[f"MJD-{name}"] = (_mjd(t_utc_ns), f"[d] {words}, UTC")
    header["MJD-OBS"] = (_mjd(start_ns), "[d] start, as DATE-OBS has it")
    header["XPOSURE"] = (exposure_s, "[s]")


def _mjd(t_utc_ns: int) -> float:
    return MJD_UNIX + t_utc_ns / NS_PER_DAY


def _date(t_utc_ns: int) -> str:
    return utc_ns_to_iso(t_utc_ns, decimals=6).removesuffix("Z")


def _streaks(frame: FrameOnRecord) -> Any:
    """Table with a row a measurement: what the track took, and where it was expected."""
    from astropy.io import fits

    rows = frame.rows
    values = [[getattr(row, field) for _, field, _, _ in _COLUMNS] for row in rows]
    table = np.array(values, dtype=np.float64).reshape(len(rows), len(_COLUMNS))
    columns = [
        fits.Column(name=name, format="D", unit=unit, array=table[:, place])
        for place, (name, _, unit, _) in enumerate(_COLUMNS)
    ]
    columns.append(fits.Column(name="TAKEN", format="L", array=[r.is_taken for r in rows]))
    columns.append(fits.Column(name="CLIPPED", format="L", array=[r.is_clipped for r in rows]))
    columns.append(fits.Column(name="SOURCE", format="8A", array=[r.source for r in rows]))
    hdu = fits.BinTableHDU.from_columns(columns, name=STREAKS)
    for place, (_, _, _, comment) in enumerate(_COLUMNS, start=1):
        hdu.header.comments[f"TTYPE{place}"] = comment
    if frame.predicted is not None:
        x = frame.predicted.x
        east_arcsec, north_arcsec = predicted_sigma_arcsec(frame.predicted)
        hdu.header["PRED_RA"] = (x[0], "[deg] where the track expected it, ICRS")
        hdu.header["PRED_DEC"] = (x[2], "[deg]")
        hdu.header["PRED_SRA"] = (east_arcsec, "[arcsec] one sigma, times cos Dec")
        hdu.header["PRED_SDE"] = (north_arcsec, "[arcsec] one sigma")
    return hdu


HEAD = (
    "# Region file format: DS9 version 4.1\n"
    'global font="helvetica 10 normal roman" select=1 edit=0 move=0 delete=1 include=1\n'
    "icrs\n"
)
SIGMAS = 3.0
END_ARCSEC = 3.0
SMALLEST_ARCSEC = 0.01


def to_regions(frame: FrameOnRecord) -> str:
    """Return a DS9 regions file with the frame's streaks and the predicted position.

    It holds only its header where the frame has neither.
    """
    lines = [line for row in frame.rows for line in _streak(row)]
    if frame.predicted is not None:
        lines.append(_ellipse(frame.predicted))
    return HEAD + "".join(line + "\n" for line in lines)


def _streak(row: MeasuredRow) -> list[str]:
    colour = "red" if row.is_taken else "yellow"
    words = f"{'taken' if row.is_taken else row.not_taken_because or 'not followed'}"
    text = _braced(f"{row.confidence:.2f} {words}")
    lines = []
    a, b = (row.ra_a_icrs_deg, row.dec_a_icrs_deg), (row.ra_b_icrs_deg, row.dec_b_icrs_deg)
    if a[0] is not None and a[1] is not None and b[0] is not None and b[1] is not None:
        ends = f"{_place(a[0], a[1])},{_place(b[0], b[1])}"
        lines.append(f"line({ends}) # line=0 0 color={colour} text={text}")
        for ra_deg, dec_deg in ((a[0], a[1]), (b[0], b[1])):
            lines.append(f'circle({_place(ra_deg, dec_deg)},{END_ARCSEC:.1f}") # color={colour}')
    lines.append(f"point({_place(row.ra_icrs_deg, row.dec_icrs_deg)}) # point=cross color={colour}")
    return lines


def _ellipse(state: TrackState) -> str:
    covariance = sky_covariance_arcsec2(state)
    variances, axes = np.linalg.eigh(covariance)
    east, north = axes[:, 1]
    position_angle_deg = math.degrees(math.atan2(east, north))
    long_arcsec, short_arcsec = (
        max(SIGMAS * math.sqrt(max(float(v), 0.0)), SMALLEST_ARCSEC) for v in variances[::-1]
    )
    angle_deg = wrap_360(position_angle_deg + 90.0) % 180.0
    return (
        f'ellipse({_place(state.x[0], state.x[2])},{long_arcsec:.3f}",{short_arcsec:.3f}",'
        f"{angle_deg:.3f}) # color=green dash=1 text={_braced('predicted, 3 sigma')}"
    )


def _place(ra_deg: float, dec_deg: float) -> str:
    return f"{wrap_360(ra_deg):.8f},{dec_deg:+.8f}"


def _braced(text: str) -> str:
    """Text in braces for DS9: without braces inside, and ASCII alone."""
    plain = text.encode("ascii", "replace").decode()
    return "{" + re.sub(r"[{}\s]+", " ", plain).strip() + "}"
