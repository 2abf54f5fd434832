"""A kept frame as FITS with its plate in the header and its streaks in a table behind the image.

The pixels' bytes stay as the session coded them, without loss. A plate that the camera's driver
wrote is taken out first: two would contradict each other. Sources: Greisen & Calabretta 2002 (WCS),
Shupe et al. 2005 (SIP), Rots et al. 2015 (time), Pence et al. 2010 (tiled images).
"""

import io
import math
import re
import warnings
from typing import Any

import erfa

from rsoconsole.config import Config
from rsoconsole.errors import ExportError
from rsoconsole.export.frames import FrameOnRecord
from rsoconsole.pipeline.frame import shutter_mid_utc_ns
from rsoconsole.records import Solution
from rsoconsole.sky import MJD_UNIX, NS_PER_DAY, utc_ns_to_iso, wcs_cards

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
"""Name, what a row has it from, unit and comment."""


def solved_fits(frame: FrameOnRecord, config: Config) -> bytes:
    """The file's content.

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
    words = {
        "CRPIX1": "1-based",
        "RADESYS": "its axes; there is no equinox",
    }
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
    """DATE-OBS stays the camera's; the shutter's instants are beside it."""
    mid_ns, exposure_s = shutter_mid_utc_ns(frame.taken, config.exposure), frame.taken.exposure_s
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
    """A row a measurement; what the track took, and where it was expected."""
    import numpy as np
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
        x, P = frame.predicted.x, frame.predicted.P
        sigma_ra = math.sqrt(P[0][0]) * math.cos(math.radians(x[2])) * 3600.0
        hdu.header["PRED_RA"] = (x[0], "[deg] where the track expected it, ICRS")
        hdu.header["PRED_DEC"] = (x[2], "[deg]")
        hdu.header["PRED_SRA"] = (sigma_ra, "[arcsec] one sigma, times cos Dec")
        hdu.header["PRED_SDE"] = (math.sqrt(P[2][2]) * 3600.0, "[arcsec] one sigma")
    return hdu
