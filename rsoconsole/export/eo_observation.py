"""EOObservation records of the Unified Data Library (UDL) as a file: nothing is uploaded.

A JSON list, one record a measurement that a track took. Field names, units and the allowed words
are those of the UDL's interface: directions in degrees, the sensor's height in km, times to the
microsecond. Directions are astrometric, along GCRF axes; ``descriptor`` says so.
"""

import json
import math
from collections.abc import Iterable
from typing import Any

from rsoconsole.export.night import ExportedNight
from rsoconsole.export.rows import MeasuredRow
from rsoconsole.export.target import Target
from rsoconsole.export.tdm import whole
from rsoconsole.sky import utc_ns_to_iso

MARKING = "U"
"""Unclassified, as the UDL writes it."""
DESCRIPTOR = (
    "astrometric: relative to catalogue stars, no aberration in it, light time not taken out;"
    " obTime is mid-exposure"
)
_DEG2_PER_ARCSEC2 = 1.0 / 3600.0**2


def to_udl(
    night: ExportedNight, tracks: Iterable[int], *, target: Target, source: str, sensor: str
) -> str:
    """The records. A streak that the frame cuts is left out.

    ``source`` and ``sensor``: who makes them, and with what, in words of your own.
    """
    found = [
        _record(night, track, row, place, target=target, source=source, sensor=sensor)
        for track in tracks
        for row, place in _placed(whole(night.of_track(track)))
    ]
    return json.dumps(found, indent=1, allow_nan=False) + "\n"


def _placed(rows: tuple[MeasuredRow, ...]) -> Iterable[tuple[MeasuredRow, str]]:
    for n, row in enumerate(rows):
        last = n == len(rows) - 1
        place = "SINGLE" if len(rows) == 1 else "FIRST" if n == 0 else "LAST" if last else "IN"
        yield row, place


def _record(
    night: ExportedNight,
    track: int,
    row: MeasuredRow,
    place: str,
    *,
    target: Target,
    source: str,
    sensor: str,
) -> dict[str, Any]:
    site = night.config.site.to_site()
    east2, cross, north2 = row.cov_sky_arcsec2
    cos_dec = max(math.cos(math.radians(row.dec_icrs_deg)), 1e-9)
    record: dict[str, Any] = {
        "classificationMarking": MARKING,
        "dataMode": "SIMULATED" if night.is_simulated else "REAL",
        "source": source,
        "obTime": utc_ns_to_iso(row.t_mid_utc_ns, 6),
        "origSensorId": sensor,
        "origObjectId": target.tdm_name(track),
        "trackId": f"{night.name}-{track}",
        "obPosition": place,
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
        "descriptor": DESCRIPTOR,
        "eoobservationDetails": {
            "raCov": east2 / cos_dec**2 * _DEG2_PER_ARCSEC2,
            "declinationCov": north2 * _DEG2_PER_ARCSEC2,
            "raDeclinationCov": cross / cos_dec * _DEG2_PER_ARCSEC2,
            "timesUnc": night.time_sigma_s(row),
        },
    }
    if row.exposure_s is not None:
        record["expDuration"] = row.exposure_s
    if target.norad_id is not None:
        record["satNo"] = target.norad_id
    return record
