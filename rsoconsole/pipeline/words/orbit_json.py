"""JSON objects of the commands orbit and identify: an interface that users' scripts depend on."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from rsoconsole.orbits import (
    SURE,
    Identification,
    KnownOrbit,
    MeasuredDirections,
    ObjectMatch,
    Orbit,
    eccentricity_vector,
    osculating_elements,
    period_s,
)
from rsoconsole.pipeline.orbits.orbit_determination import FoundOrbit, OrbitArc
from rsoconsole.pipeline.orbits.orbit_outlook import FuturePosition, OrbitOutlook
from rsoconsole.records import FloatArray
from rsoconsole.sky import wrap_180
from rsoconsole.words import NS_PER_S, utc_ns_to_iso

_STEP = np.array([1e-2, 1e-2, 1e-2, 1e-6, 1e-6, 1e-6])
_ELEMENTS = ("a_km", "e", "i_deg", "raan_deg", "argp_deg", "m_deg")
_UNKNOWN = (
    *("prior", "epoch_utc", "r_gcrs_km", "v_gcrs_km_s", "covariance", *_ELEMENTS),
    *("period_s", "sigma_a_km", "sigmas", "rms_arcsec", "outliers", "outliers_utc", "rivals"),
)
_OF_CANDIDATE = ("norad_id", "name", "probability", "separation_arcsec")
_OF_MATCH = (
    *("norad_id", "name", "separation_arcsec", "cross_track_arcsec", "along_track_s"),
    *("along_track_arcsec", "rate_difference_percent", "rate_direction_deg", "tle_age_days"),
    *("score", "probability", "is_within_gate", "regime"),
    *("sigma_along_arcsec", "sigma_cross_arcsec"),
)


def orbit_report(
    found: FoundOrbit, outlook: OrbitOutlook | None, tle: tuple[str, str] | None = None
) -> dict[str, Any]:
    """Return the JSON object of ``rsoconsole orbit``.

    Elements are osculating, on GCRS axes. ``outlook``: positions and events ahead; None: none, its
    keys are then null, "predicted" an empty list. ``tle``: fitted mean elements as two lines; None:
    none.
    """
    orbit, seen = found.orbit, found.seen
    report: dict[str, Any] = {
        "method": found.method,
        "label": "not observable" if orbit is None else orbit.label,
        "reason": found.reason,
        **(dict.fromkeys(_UNKNOWN) if orbit is None else _orbit_values(orbit)),
        "observations": len(seen),
        "arc_s": float(seen.t_s[-1] - seen.t_s[0]),
        "t_first_utc": utc_ns_to_iso(int(seen.t_utc_ns[0])),
        "t_last_utc": utc_ns_to_iso(int(seen.t_utc_ns[-1])),
        "lines_not_used": list(found.not_used),
        "parts": [_part_report(each) for each in found.parts],
        "solutions": [
            {**elements_by_name(each.r_km, each.v_km_s), "range_km": float(each.ranges_km[1])}
            for each in found.solutions
        ],
        "tle": None if tle is None else list(tle),
        "frame": "GCRS",
        "tle_frame": "TEME",
    }
    report.update(_outlook_values(outlook))
    return report


def identification_report(name: str, found: Identification, arc_s: float) -> dict[str, Any]:
    """Return the JSON object of ``rsoconsole identify``.

    ``arc_s``: time from the track's first direction to its last.
    """
    matches = [_match_report(each) for each in found.matches]
    return {
        "name": name,
        "verdict": found.verdict,
        "reason": found.reason,
        "hint": found.hint or None,
        "matches": matches,
        "runner_up": matches[1] if len(matches) > 1 else None,
        "t_utc": utc_ns_to_iso(found.t_utc_ns),
        "arc_s": arc_s,
        "gate_deg": found.gate_deg,
        "catalogued": found.catalogued,
        "not_propagated": found.failed,
        "not_catalogued": found.not_catalogued,
        "named_with": found.named_with,
    }


def named_track_report(
    number: int, found: Identification, seen: MeasuredDirections
) -> dict[str, Any]:
    """Return the JSON object of one track for the list ``tracks`` of ``rsoconsole identify``.

    ``found``: identification of the track together with all tracks of the night.
    """
    candidates = [each for each in found.matches if each.probability >= 1.0 - SURE]
    best = found.matches[0] if found.matches and found.verdict == "identified" else None
    return {
        "track": number,
        "verdict": found.verdict,
        "reason": found.reason,
        "hint": found.hint or None,
        "norad_id": None if best is None else best.norad_id,
        "object_name": None if best is None else best.name,
        "probability": None if best is None else best.probability,
        "separation_arcsec": None if best is None else best.separation_arcsec,
        "candidates": [_values(each, _OF_CANDIDATE) for each in candidates],
        "not_catalogued": found.not_catalogued,
        "named_with": found.named_with,
        "directions": len(seen),
        "arc_s": float(seen.t_s[-1] - seen.t_s[0]),
        "t_utc": utc_ns_to_iso(found.t_utc_ns),
    }


def element_sigmas(orbit: KnownOrbit) -> dict[str, float | None]:
    """Return one sigma of each element, by name; None for an angle that is not determined.

    Such an angle has a sigma above 180 deg, as the perigee of a circular orbit. The sigma of the
    eccentricity has that of its vector's direction too, which lengthens the vector of an orbit
    that is nearly circular.
    """
    states = np.concatenate([orbit.r_km, orbit.v_km_s])
    around = states + np.concatenate([np.diag(_STEP), -np.diag(_STEP)])
    values = np.array([list(elements_by_name(each[:3], each[3:]).values()) for each in around])
    change = values[:6] - values[6:]
    change[:, 2:] = wrap_180(change[:, 2:])
    slopes = change.T / (2.0 * _STEP)
    variances = np.diag(slopes @ orbit.covariance @ slopes.T)
    sigmas = dict(zip(_ELEMENTS, np.sqrt(np.maximum(variances, 0.0)), strict=True))
    sigmas["e"] = _eccentricity_sigma(orbit)
    return {
        key: None if key.endswith("_deg") and value > 180.0 else float(value)
        for key, value in sigmas.items()
    }


def _eccentricity_sigma(orbit: KnownOrbit) -> float:
    vector, slopes = eccentricity_vector(orbit.r_km, orbit.v_km_s)
    covariance = slopes @ orbit.covariance @ slopes.T
    e = max(float(np.linalg.norm(vector)), 1e-12)
    along_2 = max(float(vector @ covariance @ vector) / e**2, 0.0)
    beside_2 = max(float(np.trace(covariance)) - along_2, 0.0)
    return float(np.sqrt(along_2 + (np.sqrt(e**2 + beside_2) - e) ** 2))


def _orbit_values(orbit: Orbit) -> dict[str, Any]:
    elements = elements_by_name(orbit.r_km, orbit.v_km_s)
    return {
        "prior": orbit.prior,
        "epoch_utc": utc_ns_to_iso(orbit.epoch_utc_ns, 6),
        "r_gcrs_km": orbit.r_km.tolist(),
        "v_gcrs_km_s": orbit.v_km_s.tolist(),
        "covariance": orbit.covariance.tolist(),
        **elements,
        "period_s": period_s(elements["a_km"]),
        "sigma_a_km": orbit.sigma_a_km,
        "sigmas": element_sigmas(orbit),
        "rms_arcsec": orbit.rms_arcsec,
        "outliers": orbit.outliers,
        "outliers_utc": [utc_ns_to_iso(int(t)) for t in orbit.outlier_utc_ns],
        "rivals": orbit.rivals,
    }


def elements_by_name(r_km: FloatArray, v_km_s: FloatArray) -> dict[str, float]:
    """Return the osculating elements of a position and velocity, by name, in the frame of these."""
    found = osculating_elements(r_km, v_km_s)
    return {key: float(getattr(found, key)) for key in _ELEMENTS}


def _outlook_values(outlook: OrbitOutlook | None) -> dict[str, Any]:
    keys = ("predicted", "is_up", "sets_utc", "rises_utc", "eclipse_begins_utc", "eclipse_ends_utc")
    if outlook is None:
        return {**dict.fromkeys(keys), "predicted": []}
    eclipse = outlook.eclipse_utc_ns or (None, None)
    times = (outlook.sets_utc_ns, outlook.rises_utc_ns, *eclipse)
    words = [None if each is None else utc_ns_to_iso(each, 0) for each in times]
    return dict(
        zip(keys, ([_ahead_report(a) for a in outlook.ahead], outlook.is_up, *words), strict=True)
    )


def _ahead_report(ahead: FuturePosition) -> dict[str, Any]:
    return {
        "t_utc": utc_ns_to_iso(ahead.t_utc_ns),
        "ra": ahead.ra_icrs_deg,
        "dec": ahead.dec_icrs_deg,
        "sigma_arcsec": ahead.sigma_arcsec,
        "alt": ahead.altitude_deg,
        "az": ahead.azimuth_deg,
        "range_km": ahead.range_km,
        "lit": ahead.lit,
    }


def _part_report(part: OrbitArc) -> dict[str, Any]:
    return {
        "name": part.name,
        "observations": part.observations,
        "t_first_utc": utc_ns_to_iso(part.t_first_utc_ns),
        "arc_s": (part.t_last_utc_ns - part.t_first_utc_ns) / NS_PER_S,
        "is_used": part.is_used,
        "same_object_probability": part.probability,
    }


def _match_report(match: ObjectMatch) -> dict[str, Any]:
    return {**_values(match, _OF_MATCH), "tle_epoch_utc": utc_ns_to_iso(match.tle_epoch_utc_ns)}


def _values(record: object, names: Sequence[str]) -> dict[str, Any]:
    """Return the values of a record by these names, each its own key."""
    return {name: getattr(record, name) for name in names}
