"""Writer of SCORE's table: brightness for the satellite observations repository of the IAU CPS.

27 columns in a fixed order, each always there, empty where nothing is known; a row is one magnitude
in V with its limiting magnitude. SCORE reads a row without a magnitude as a non-detection, so that
streaks without one are left out. Columns of distance are for measured ones and stay empty: SCORE
computes distance and phase from catalogue elements. The name stays empty too, since SCORE knows it
by the catalogue number and refuses another spelling.
"""

import csv
import io
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from rsoconsole.base import ExportError
from rsoconsole.library.formats.night import ExportedNight
from rsoconsole.library.formats.rows import MeasuredRow
from rsoconsole.library.formats.target import Target
from rsoconsole.library.formats.tdm import unclipped_rows
from rsoconsole.words import utc_ns_to_iso

SCORE_COLUMNS = (
    "satellite_name",
    "norad_cat_id",
    "observation_time_utc",
    "observation_time_uncertainty_sec",
    "apparent_magnitude",
    "apparent_magnitude_uncertainty",
    "observer_latitude_deg",
    "observer_longitude_deg",
    "observer_altitude_m",
    "limiting_magnitude",
    "instrument",
    "observing_mode",
    "observing_filter",
    "observer_email",
    "observer_orcid",
    "satellite_right_ascension_deg",
    "satellite_declination_deg",
    "sigma_2_ra",
    "sigma_ra_sigma_dec",
    "sigma_2_dec",
    "range_to_satellite_km",
    "range_to_satellite_uncertainty_km",
    "range_rate_of_satellite_km_per_sec",
    "range_rate_of_satellite_uncertainty_km_per_sec",
    "comments",
    "data_archive_link",
    "mpc_code",
)
ScoreDetector: TypeAlias = Literal["CCD", "CMOS", "OTHER"]
"""Kinds of detector; SCORE's other two, VISUAL and BINOCULARS, are eyes."""
MAX_NORAD_ID = 999_999
"""Largest catalogue number that SCORE takes."""
MAX_TEXT = 200
"""Length of instrument and filter."""
COMMENT = "V by Tycho-2 stars in the same frame; RA (co)variances times cos Dec"
_EMAIL = re.compile(r"[^@\s,]+@[^@\s,]+\.[^@\s,.]+", re.ASCII)
_ORCID = re.compile(r"\d{4}-\d{4}-\d{4}-\d{3}[\dX]", re.ASCII)


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreOptions:
    """Columns of SCORE that no session has on record; None: not given."""

    email: str | None = None
    """Address of the observer, to which SCORE confirms; it is not published."""
    orcid: str | None = None
    """ORCID of each observer, separated by commas, as in 0000-0002-1825-0097."""
    detector: str | None = None
    """CCD, CMOS or OTHER."""
    passband: str | None = None
    """Filter in front of the camera; CLEAR: none."""

    def __post_init__(self) -> None:
        """Check what is given. Raises ExportError for a value that SCORE would refuse."""
        if self.email is not None and _EMAIL.fullmatch(self.email) is None:
            raise ExportError(f"{self.email!r} is no e-mail address: name@example.org")
        for each in self.orcids:
            _check_orcid(each)
        kinds = get_args(ScoreDetector)
        if self.detector is not None and self.detector not in kinds:
            raise ExportError(f"{self.detector!r} is none of {', '.join(kinds)}")
        if self.passband is not None and not 0 < len(self.passband.strip()) <= MAX_TEXT:
            raise ExportError(f"a filter has a name of 1 to {MAX_TEXT} characters: V, or CLEAR")

    @property
    def orcids(self) -> tuple[str, ...]:
        """The observers' ORCIDs in capitals."""
        given = () if self.orcid is None else self.orcid.split(",")
        return tuple(each.strip().upper() for each in given)


def to_score(
    night: ExportedNight, tracks: Iterable[int], *, target: Target, options: ScoreOptions
) -> str:
    """Return the magnitudes of these tracks as SCORE's CSV, with a heading.

    Raises ExportError where a column that SCORE requires is not given, and without a magnitude.
    """
    _expect_complete(target, options)
    rows = [
        row
        for track in tracks
        for row in scored_rows(unclipped_rows(night.track_measurements(track)))
    ]
    if not rows:
        raise ExportError(
            "no measurement has a magnitude in V: SCORE would take its row for a non-detection"
        )
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(SCORE_COLUMNS)
    for row in sorted(rows, key=lambda row: row.t_mid_utc_ns):
        values = _values(night, row, target, options)
        writer.writerow([values.get(name, "") for name in SCORE_COLUMNS])
    return text.getvalue()


def scored_rows(rows: Iterable[MeasuredRow]) -> tuple[MeasuredRow, ...]:
    """Return the measurements that SCORE takes: with a magnitude in V and a limiting one."""
    return tuple(
        row
        for row in rows
        if row.mag_v is not None
        and row.sigma_mag is not None
        and (row.value("limiting_mag") or 0.0) > 0.0
    )


def _values(
    night: ExportedNight, row: MeasuredRow, target: Target, options: ScoreOptions
) -> dict[str, str]:
    site, optics = night.config.site.to_site(), night.config.optics
    camera = night.config.indi.camera if night.config.instruments.camera == "indi" else ""
    instrument = f"focal length {optics.focal_length_mm:g} mm, pixels {optics.pixel_um:g} um"
    east2, cross, north2 = row.cov_sky_arcsec2
    return {
        "norad_cat_id": str(target.norad_id),
        "observation_time_utc": utc_ns_to_iso(row.t_mid_utc_ns, 6),
        "observation_time_uncertainty_sec": f"{night.time_sigma_s(row):.6g}",
        "apparent_magnitude": f"{row.mag_v:.4f}",
        "apparent_magnitude_uncertainty": f"{row.sigma_mag:.4f}",
        "observer_latitude_deg": f"{site.latitude_deg:.6f}",
        "observer_longitude_deg": f"{site.longitude_deg:.6f}",
        "observer_altitude_m": f"{site.elevation_m:.1f}",
        "limiting_magnitude": f"{row.value('limiting_mag'):.2f}",
        "instrument": (f"{camera}, {instrument}" if camera else instrument)[:MAX_TEXT],
        "observing_mode": options.detector or "",
        "observing_filter": (options.passband or "").strip(),
        "observer_email": options.email or "",
        "observer_orcid": ",".join(options.orcids),
        "satellite_right_ascension_deg": f"{row.ra_icrs_deg % 360.0:.8f}",
        "satellite_declination_deg": f"{row.dec_icrs_deg:.8f}",
        "sigma_2_ra": f"{east2:.6g}",
        "sigma_ra_sigma_dec": f"{cross:.6g}",
        "sigma_2_dec": f"{north2:.6g}",
        "comments": f"SIMULATED; {COMMENT}" if night.is_simulated else COMMENT,
    }


def _expect_complete(target: Target, options: ScoreOptions) -> None:
    given = {
        "--norad": target.norad_id,
        "--observer-email": options.email,
        "--observer-orcid": options.orcid,
        "--detector": options.detector,
        "--filter": options.passband,
    }
    missing = [name for name, value in given.items() if value is None]
    if missing:
        raise ExportError(f"SCORE requires what no session knows: give {', '.join(missing)}")
    if (target.norad_id or 0) > MAX_NORAD_ID:
        raise ExportError(f"SCORE takes catalogue numbers of six digits, not {target.norad_id}")


def _check_orcid(orcid: str) -> None:
    """Raise ExportError for a wrong form or check digit (ISO 7064, MOD 11-2)."""
    total = 0
    for digit in orcid.replace("-", "")[:-1] if _ORCID.fullmatch(orcid) else "":
        total = (total + int(digit)) * 2
    check = "0123456789X"[(12 - total % 11) % 11]
    if _ORCID.fullmatch(orcid) is None or orcid[-1] != check:
        raise ExportError(
            f"{orcid!r} is no ORCID: 16 digits as in 0000-0002-1825-0097, the last of which checks"
            " the others"
        )
