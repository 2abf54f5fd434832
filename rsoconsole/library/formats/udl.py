"""Writer of EOObservation records for the Unified Data Library (UDL), as JSON.

Names, units and words are those of the library's published schema. It defines ``mag`` as calibrated
against Gaia's G band; what is measured here is Johnson V, which is sent and said in the descriptor:
of sunlight V is about 0.15 mag fainter than G. ``magNormRange`` is for 1000 km, at the same phase.
"""

import json
import math
from collections.abc import Iterable
from typing import Any

from rsoconsole.library.formats.night import ExportedNight
from rsoconsole.library.formats.rows import MeasuredRow
from rsoconsole.library.formats.target import Target
from rsoconsole.library.formats.tdm import unclipped_rows
from rsoconsole.orbits import magnitude_at_range
from rsoconsole.words import utc_ns_to_iso

MARKING = "U"
"""Classification marking of the UDL: unclassified."""
DESCRIPTOR = (
    "astrometric: relative to catalogue stars, no aberration in it, light time not taken out;"
    " obTime is mid-exposure"
)
IN_V = "; mag and zeroptd are Johnson V by Tycho-2 stars, not Gaia G"
BY_ORBIT = "; range and solarPhaseAngle are by the orbit of these directions"
_NORM_RANGE_KM = 1000.0
_DEG2_PER_ARCSEC2 = 1.0 / 3600.0**2


def to_udl(night: ExportedNight, tracks: Iterable[int], *, target: Target, source: str) -> str:
    """Return the measurements of these tracks as JSON, a list of EOObservation records.

    Clipped streaks are left out. ``source``: who makes the records.
    """
    found: list[dict[str, Any]] = []
    for track in tracks:
        rows = unclipped_rows(night.track_measurements(track))
        places = ["FIRST", *["IN"] * (len(rows) - 2), "LAST"] if len(rows) > 1 else ["SINGLE"]
        for row, place in zip(rows, places, strict=False):
            record = _record(night, row, target)
            record |= {
                "source": source,
                "origObjectId": target.tdm_name(track),
                "trackId": f"{night.name}-{track}",
                "obPosition": place,
            }
            found.append(record)
    return json.dumps(found, indent=1, allow_nan=False) + "\n"


def _record(night: ExportedNight, row: MeasuredRow, target: Target) -> dict[str, Any]:
    site = night.config.site.to_site()
    east2, cross, north2 = row.cov_sky_arcsec2
    cos_dec = max(math.cos(math.radians(row.dec_icrs_deg)), 1e-9)
    light, details = _light(night, row)
    record: dict[str, Any] = {
        "classificationMarking": MARKING,
        "dataMode": "SIMULATED" if night.is_simulated else "REAL",
        "obTime": utc_ns_to_iso(row.t_mid_utc_ns, 6),
        "origSensorId": night.config.site.name,
        "uct": not target.is_known,
        "referenceFrame": "GCRF",
        "ra": round(row.ra_icrs_deg % 360.0, 9) % 360.0,
        "raUnc": row.sigma_ra_arcsec / cos_dec / 3600.0,
        "raMeasured": True,
        "declination": round(row.dec_icrs_deg, 9),
        "declinationUnc": row.sigma_dec_arcsec / 3600.0,
        "declinationMeasured": True,
        "senlat": site.latitude_deg,
        "senlon": site.longitude_deg,
        "senalt": site.elevation_m / 1000.0,
        **light,
        "descriptor": _descriptor(light),
        "eoobservationDetails": {
            "raCov": east2 / cos_dec**2 * _DEG2_PER_ARCSEC2,
            "declinationCov": north2 * _DEG2_PER_ARCSEC2,
            "raDeclinationCov": cross / cos_dec * _DEG2_PER_ARCSEC2,
            "timesUnc": night.time_sigma_s(row),
            **details,
        },
    }
    if row.exposure_s is not None:
        record["expDuration"] = row.exposure_s
    if target.norad_id is not None:
        record["satNo"] = target.norad_id
    return record


def _light(night: ExportedNight, row: MeasuredRow) -> tuple[dict[str, Any], dict[str, Any]]:
    """Fields of brightness and distance, and those of the details; without what is not known."""
    frame = night.photometry.get(row.frame_id)
    is_instrumental = row.band == "instrumental" and not row.is_saturated
    mag_v, range_km = row.mag_v, row.range_km
    normed = None
    if mag_v is not None and range_km is not None:
        normed = magnitude_at_range(mag_v, range_km, _NORM_RANGE_KM)
    record = {
        "mag": mag_v,
        "magUnc": None if mag_v is None else row.sigma_mag,
        "magNormRange": normed,
        "zeroptd": None if frame is None else frame.zero_point_mag,
        "zeroPtdUnc": None if frame is None else frame.zero_point_sigma_mag,
        "range": range_km,
        "rangeMeasured": None if range_km is None else False,
        "solarPhaseAngle": row.phase_deg,
    }
    details = {
        "magInstrumental": row.mag if is_instrumental else None,
        "magInstrumentalUnc": row.mag_sigma if is_instrumental else None,
        "pcalNumStars": (None if frame is None else frame.zero_point_stars) or None,
    }
    return _known(record), _known(details)


def _known(values: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


def _descriptor(light: dict[str, Any]) -> str:
    in_v = IN_V if "mag" in light or "zeroptd" in light else ""
    return DESCRIPTOR + in_v + (BY_ORBIT if "range" in light else "")
