"""Conversion of others' Tracking Data Messages to directions at mid-exposure.

Corrections that a message states but has not applied are applied here.
"""

from collections.abc import Sequence

from rsoconsole.base import ExportError
from rsoconsole.library.formats._observed_csv import ObservedRow, ReadRows
from rsoconsole.library.formats._tdm_reader import Tdm, TdmSegment
from rsoconsole.records import Site
from rsoconsole.words import NS_PER_S

_MIDDLE_BY_HALVES = {"START": 1, "MIDDLE": 0, "END": -1}
"""Time from the epoch to the middle of the integration, in halves of it, by INTEGRATION_REF."""
_ABERRATIONS = ("CORRECTION_ABERRATION_YEARLY", "CORRECTION_ABERRATION_DIURNAL")


def observed_rows_of_tdm(message: Tdm, name: str) -> ReadRows:
    """Return the RA-Dec directions of a message at mid-exposure, with its corrections applied.

    ``name`` is what errors call the message. A segment that cannot be used costs itself alone.
    Raises ExportError where none has usable directions.
    """
    found: list[ObservedRow] = []
    not_used = list(message.not_used)
    faults: list[ExportError] = []
    for number, segment in enumerate(message.segments, start=1):
        where = f"{name}, segment {number}"
        if others := segment.others - segment.beside:
            lines = "1 epoch or line" if others == 1 else f"{others} epochs or lines"
            not_used.append(f"{where}: {lines} without both angles")
        try:
            found.extend(_of_segment(segment, where))
        except ExportError as error:
            faults.append(error)
    if not found and faults:
        raise faults[0]
    not_used.extend(map(str, faults))
    if not found:
        raise ExportError(
            f"{name} holds no pairs of angles (ANGLE_TYPE = RADEC): ranges and Doppler say nothing"
            " here"
        )
    return ReadRows(rows=tuple(found), not_used=tuple(not_used))


def _of_segment(segment: TdmSegment, where: str) -> list[ObservedRow]:
    if not segment.angles:
        return []
    kind = segment.metadata.get("ANGLE_TYPE", "none")
    if kind.upper() != "RADEC":
        raise ExportError(
            f"{where}: angles of type {kind}: only right ascension and declination (RADEC) are read"
        )
    frame = segment.metadata.get("REFERENCE_FRAME", "EME2000").upper()
    if frame not in {"EME2000", "ICRF", "GCRF", "J2000"}:
        raise ExportError(f"{where}: directions in {frame}: only EME2000 and ICRF are read")
    later_ns = _middle_later_ns(segment, where)
    add_1_deg, add_2_deg = _corrections_deg(segment, where)
    target, station = _participants(segment, where)
    return [
        ObservedRow(
            where=where,
            t_utc_ns=each.t_utc_ns + later_ns,
            ra_icrs_deg=(each.angle_1_deg + add_1_deg) % 360.0,
            dec_icrs_deg=each.angle_2_deg + add_2_deg,
            sigma_ra_arcsec=each.sigma_1_arcsec,
            sigma_dec_arcsec=each.sigma_2_arcsec,
            correlation=each.correlation or 0.0,
            target=target,
            station=station,
            site=_site_of_comments(segment.comments),
            is_degrees=True,
            mag=each.mag,
            mag_sigma=each.mag_sigma,
        )
        for each in segment.angles
    ]


def _middle_later_ns(segment: TdmSegment, where: str) -> int:
    """Time from an epoch as written to the middle of its integration, at reception."""
    if segment.metadata.get("TIMETAG_REF", "RECEIVE").upper() != "RECEIVE":
        raise ExportError(f"{where}: times of transmission (TIMETAG_REF): only RECEIVE is read")
    for key, value in segment.metadata.items():
        if key.startswith("RECEIVE_DELAY") and float(value) != 0.0:
            raise ExportError(
                f"{where}: {key} = {value} s: take the delay out of the times, then leave it out"
            )
    reference = segment.metadata.get("INTEGRATION_REF", "MIDDLE").upper()
    halves = _MIDDLE_BY_HALVES[reference]
    if halves == 0:
        return 0
    interval = segment.metadata.get("INTEGRATION_INTERVAL")
    if interval is None:
        raise ExportError(
            f"{where}: INTEGRATION_REF = {reference} without INTEGRATION_INTERVAL: say how long an"
            " exposure is"
        )
    return halves * round(float(interval) * NS_PER_S / 2.0)


def _corrections_deg(segment: TdmSegment, where: str) -> tuple[float, float]:
    """Corrections still to be added to both angles."""
    first, second, *aberrations = (
        float(segment.metadata.get(key, "0"))
        for key in ("CORRECTION_ANGLE_1", "CORRECTION_ANGLE_2", *_ABERRATIONS)
    )
    applied = segment.metadata.get("CORRECTIONS_APPLIED", "").upper()
    if applied == "YES":
        return 0.0, 0.0
    if any(aberrations) and applied == "NO":
        raise ExportError(
            f"{where}: aberration is still in its directions (CORRECTIONS_APPLIED = NO): only"
            " astrometric ones are read"
        )
    if (first or second) and not applied:
        raise ExportError(
            f"{where}: CORRECTION_ANGLE without CORRECTIONS_APPLIED: say YES or NO there"
        )
    return first, second


def _participants(segment: TdmSegment, where: str) -> tuple[str | None, str | None]:
    """Names of target and station: light goes from the last but one of PATH to the last."""
    seen, seer = segment.metadata.get("PATH", "2,1").split(",")[-2:]
    names = {n: segment.metadata.get(f"PARTICIPANT_{n}") for n in (seen, seer)}
    missing = [n for n, name in names.items() if name is None]
    if missing and "PATH" in segment.metadata:
        raise ExportError(f"{where}: PATH goes by participant {missing[0]}, and there is none")
    return names[seen], names[seer]


def _site_of_comments(comments: Sequence[str]) -> Site | None:
    """Site in the comments that ``tdm`` writes: TDM has no keyword for a place."""
    for comment in comments:
        words = comment.replace(",", " ").split()
        if words[:2] != ["Site", "WGS84:"]:
            continue
        try:
            return Site(
                latitude_deg=float(words[words.index("latitude") + 1]),
                longitude_deg=float(words[words.index("longitude") + 1]),
                elevation_m=float(words[words.index("height") + 1]),
            )
        except (ValueError, IndexError):
            return None
    return None
