"""Writer of IOD lines, the format of satellite observers (SeeSat-L): one line a measurement.

Columns are fixed. Angle format 2, ``HHMMmmm+DDMMmm``, has steps of 0.9 arcsec times cos Dec and 0.6
arcsec; epoch code 5 is J2000. The position's error is the longer axis of the measurement's
covariance together with the format's rounding; the time's error is that of the shutter together
with the clock's recorded offset. Optical behaviour and magnitude are not measured and stay empty.
Source: G. Lewis 1998, IOD Observation Format Description, clarified 2002.
"""

import math
import re
from collections.abc import Iterable

from rsoconsole.base import ExportError
from rsoconsole.library.formats.night import ExportedNight
from rsoconsole.library.formats.rows import MeasuredRow
from rsoconsole.library.formats.target import Target
from rsoconsole.library.formats.tdm import unclipped_rows
from rsoconsole.sky import largest_sigma, tai_minus_utc_s, wrap_180, wrap_360
from rsoconsole.words import NS_PER_DAY, utc_ns_to_iso

NS_PER_MS = 1_000_000
STATION = "9999"
"""Station number of a site that has no number of its own."""
_STATION = re.compile(r"[0-9A-HJ-NP-Z]{4}", re.ASCII)
SKIES = "EGFPBT "
"""Codes of the state of the sky: excellent, good, fair, poor, bad, terrible, not stated."""
RA_STEPS_PER_DEG = 4000
"""Steps in a degree of right ascension; a step is a thousandth of a minute of time."""
DEC_STEPS_PER_DEG = 6000
"""Steps in a degree of declination; a step is a hundredth of a minute of arc."""
_ARCSEC_PER_RA_STEP = 0.9
_ARCSEC_PER_DEC_STEP = 0.6
_UNIFORM = 1.0 / math.sqrt(12.0)
"""One sigma of a rounding, in steps."""


def to_iod(
    night: ExportedNight,
    tracks: Iterable[int],
    *,
    target: Target,
    station: str = STATION,
    sky: str = " ",
) -> str:
    """Return an IOD line for each measurement that these tracks took, in order of time.

    Streaks cut by the frame's edge are left out. Raises ExportError for a station or a state of the
    sky that a line cannot hold.
    """
    check_station(station, sky)
    offset_s = night.about.get("clock_offset_s")
    clock_s = float(offset_s) if isinstance(offset_s, int | float) else 0.0
    rows = [row for track in tracks for row in unclipped_rows(night.track_measurements(track))]
    rows.sort(key=lambda row: row.t_mid_utc_ns)
    return "".join(
        _line(
            row,
            target,
            station,
            sky,
            (night.shutter_sigma_s(row), math.hypot(night.time_sigma_s(row), clock_s)),
        )
        + "\n"
        for row in rows
    )


def site_line(night: ExportedNight, station: str) -> str:
    """Return a comment line with the station and its place, to precede the station's lines."""
    site = night.config.site
    place = site.to_site()
    name = "".join(c if c.isascii() and c.isprintable() else "?" for c in site.name)
    return (
        f"# {station} {place.latitude_deg:.5f} {place.longitude_deg:.5f} {place.elevation_m:.0f} m"
        f" (WGS84, east positive) {name}\n"
    )


def check_station(station: str, sky: str) -> None:
    """Check two fields of an IOD line: station number and state of the sky.

    Raises ExportError for a value that a line cannot hold.
    """
    if _STATION.fullmatch(station) is None:
        raise ExportError(
            f"{station!r} is no station: four digits or capitals without I and O, such as 9999"
        )
    if len(sky) != 1 or sky not in SKIES:
        raise ExportError(f"{sky!r} is no state of the sky: one of E, G, F, P, B, T")


def _line(
    row: MeasuredRow, target: Target, station: str, sky: str, sigmas_s: tuple[float, float]
) -> str:
    """One IOD line; ``sigmas_s``: error of the time in the position's covariance, and in all."""
    shutter_s, time_sigma_s = sigmas_s
    instant = utc_ns_to_iso(round_to_ms_utc_ns(row.t_mid_utc_ns))
    digits = re.sub(r"\D", "", instant)
    name = target.iod_name(row.track or 0, int(instant[:4]))
    position = mantissa_exponent_code(position_sigma_arcsec(row, shutter_s) / 60.0)
    angles = _angles(row.ra_icrs_deg, row.dec_icrs_deg)
    timing = mantissa_exponent_code(time_sigma_s)
    return f"{name} {station} {sky} {digits} {timing} 25 {angles} {position}"


def round_to_ms_utc_ns(t_utc_ns: int) -> int:
    """Round an instant to 1 ms, but never up across a leap second; return UTC nanoseconds.

    Rounding up across it would shift the instant by a second.
    """
    rounded = (t_utc_ns + NS_PER_MS // 2) // NS_PER_MS * NS_PER_MS
    if rounded % NS_PER_DAY == 0 and rounded > t_utc_ns:
        leap_s = float(tai_minus_utc_s(rounded)) - float(tai_minus_utc_s(t_utc_ns))
        return rounded if leap_s == 0.0 else rounded - NS_PER_MS
    return rounded


def position_sigma_arcsec(row: MeasuredRow, shutter_sigma_s: float = 0.0) -> float:
    """Return one sigma of a line's position along its error ellipse's longer axis, arcsec.

    The format's rounding is included. ``shutter_sigma_s``: part of the time's error that is also in
    the measurement's covariance, s. Its effect is subtracted here, because the line states the
    time's error separately, and readers add that to the position along the motion.
    """
    east2, cross, north2 = _without(row.cov_sky_arcsec2, shutter_sigma_s, _rate_arcsec_s(row))
    cos_dec = math.cos(math.radians(row.dec_icrs_deg))
    east2 += (_ARCSEC_PER_RA_STEP * cos_dec * _UNIFORM) ** 2
    north2 += (_ARCSEC_PER_DEC_STEP * _UNIFORM) ** 2
    return largest_sigma(east2, cross, north2)


def _without(
    cov: tuple[float, float, float], sigma_s: float, rate_arcsec_s: tuple[float, float]
) -> tuple[float, float, float]:
    """Covariance less the part due to an error of the time, as far as it contains that."""
    east2, cross, north2 = cov
    east_s, north_s = rate_arcsec_s
    det = east2 * north2 - cross * cross
    along = north2 * east_s**2 - 2.0 * cross * east_s * north_s + east2 * north_s**2
    if det <= 0.0 or along <= 0.0:
        return cov
    variance_s2 = min(sigma_s**2, det / along)
    return (
        max(east2 - variance_s2 * east_s**2, 0.0),
        cross - variance_s2 * east_s * north_s,
        max(north2 - variance_s2 * north_s**2, 0.0),
    )


def _rate_arcsec_s(row: MeasuredRow) -> tuple[float, float]:
    """Rate east and north, by the streak and its exposure, of either sign; 0 without these."""
    ends = (row.ra_a_icrs_deg, row.dec_a_icrs_deg, row.ra_b_icrs_deg, row.dec_b_icrs_deg)
    a_ra, a_dec, b_ra, b_dec = ends
    if a_ra is None or a_dec is None or b_ra is None or b_dec is None or not row.exposure_s:
        return 0.0, 0.0
    cos_dec = math.cos(math.radians(row.dec_icrs_deg))
    east = float(wrap_180(b_ra - a_ra)) * cos_dec * 3600.0 / row.exposure_s
    return east, (b_dec - a_dec) * 3600.0 / row.exposure_s


def mantissa_exponent_code(value: float) -> str:
    """Return the two digits ``MX`` that stand for a value of M x 10^(X - 8).

    The range is 1e-8 to 90; a value beyond it gets the nearest code.
    """
    if value <= 1e-8:
        return "10"
    exponent = math.floor(math.log10(value))
    mantissa = round(value / 10.0**exponent)
    if mantissa >= 10:
        mantissa, exponent = 1, exponent + 1
    if exponent > 1:
        return "99"
    return "10" if exponent < -8 else f"{mantissa}{exponent + 8}"


def _angles(ra_deg: float, dec_deg: float) -> str:
    ra_steps = round(wrap_360(ra_deg) * RA_STEPS_PER_DEG) % (360 * RA_STEPS_PER_DEG)
    minutes, thousandths = divmod(ra_steps, 1000)
    hours, minutes = divmod(minutes, 60)
    dec_steps = round(abs(dec_deg) * DEC_STEPS_PER_DEG)
    sign = "-" if dec_deg < 0.0 and dec_steps else "+"
    arc_minutes, hundredths = divmod(dec_steps, 100)
    degrees, arc_minutes = divmod(arc_minutes, 60)
    return (
        f"{hours:02d}{minutes:02d}{thousandths:03d}"
        f"{sign}{degrees:02d}{arc_minutes:02d}{hundredths:02d}"
    )
