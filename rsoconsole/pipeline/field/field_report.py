"""Contents of the frames as the command line's JSON objects; keys may be added, never renamed."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rsoconsole.orbits import (
    OLDEST_DAYS,
    Candidate,
    LineChoice,
    LineMatch,
    first_few,
    orbit_regime,
)
from rsoconsole.pipeline.field.field_frame import TAKEN, FieldFrame, FrameMatches, MoverMatches
from rsoconsole.pipeline.field.point_light import PointMagnitude, mean_magnitude
from rsoconsole.pipeline.words.reports import detection_report, streak_light_report
from rsoconsole.records import FloatArray
from rsoconsole.sky import (
    ARCSEC_RAD,
    LIT_SHARE,
    lit_fraction,
    pixel_to_sky,
    sky_to_pixel,
    unit_to_direction,
)
from rsoconsole.words import catalogued_name, count_words, utc_ns_to_iso

EXPECTED = 0.5
"""Probability to have crossed the frame from which an object counts as expected."""
_POINT_PX = 8.0
"""Motion in an exposure below which an object looks much like a star, px."""
_ARCMIN_RAD = 60.0 * ARCSEC_RAD


def frame_report(name: str, answer: FrameMatches, movers: Mapping[int, int]) -> dict[str, Any]:
    """Return the JSON object of one frame.

    ``movers``: number of the moving point identified with an object, by its catalogue number.
    """
    frame = answer.frame
    seen_as = _seen_as(answer)
    crossed = [
        {
            **_candidate_report(answer.candidates[n], frame),
            "streak": seen_as.get(n),
            "mover": movers.get(answer.candidates[n].entry.norad_id),
            "seen_probability": answer.match.taken[n],
            "unseen_because": _why_unseen(answer, n, answer.candidates[n].entry.norad_id in movers),
        }
        for n in answer.crossing_indices
    ]
    streaks = [
        {
            "streak": number,
            "below_tau": number > frame.taken,
            **detection_report(detection),
            **streak_light_report(light),
            **_place(frame, detection.x_px, detection.y_px),
            **_matched_report(matched, answer.candidates),
        }
        for number, (detection, light, matched) in enumerate(
            zip(answer.detections, answer.lights, answer.match.lines, strict=True), start=1
        )
    ]
    return {
        "frame": name,
        "t_mid_utc": utc_ns_to_iso(frame.t_mid_utc_ns),
        "exposure_s": frame.exposure_s,
        "ra": frame.solution.ra_icrs_deg,
        "dec": frame.solution.dec_icrs_deg,
        "scale_arcsec_px": frame.solution.scale_arcsec_px,
        "plate": frame.plate_from,
        "compared": answer.compared,
        "too_old": answer.too_old,
        "matches": [
            {"streak": each["streak"], **each["matches"][0]}
            for each in streaks
            if each["verdict"] == "identified"
        ],
        "unmatched_detections": [each for each in streaks if each["verdict"] != "identified"],
        "expected_not_seen": [
            each
            for each in crossed
            if each["chance"] >= EXPECTED and each["streak"] is None and each["mover"] is None
        ],
        "crossed": crossed,
        "streaks": streaks,
        "notes": [*frame.notes, *_too_old(answer), *_without_place(answer)],
    }


def movers_report(
    names: Sequence[str], frames: Sequence[FieldFrame], answers: Sequence[MoverMatches]
) -> dict[str, Any]:
    """Return the JSON object of the points that move through several frames."""
    return {
        "frames": list(names),
        "movers": [
            _mover_report(number, names, frames, each)
            for number, each in enumerate(answers, start=1)
        ],
    }


def _mover_report(
    number: int, names: Sequence[str], frames: Sequence[FieldFrame], answer: MoverMatches
) -> dict[str, Any]:
    mover = answer.mover
    rate = (mover.line.b - mover.line.a) / max(mover.span_s, 1e-9)
    lights = [frames[frame].point_magnitude(n, rate) for frame, n in mover.points]
    return {
        "mover": number,
        "probability": mover.probability,
        "rate_arcsec_s": mover.rate_arcsec_s,
        "position_angle_deg": mover.position_angle_deg,
        "t_mid_utc": utc_ns_to_iso(mover.t_mid_utc_ns),
        "span_s": mover.span_s,
        **_light_report(mean_magnitude(lights)),
        "places": [
            {**_point_report(names[frame], frames[frame], n), **_light_report(light)}
            for (frame, n), light in zip(mover.points, lights, strict=True)
        ],
        **_matched_report(answer.matched, answer.candidates),
    }


_OF_LIGHT = (
    *("mag", "mag_sigma", "mag_sigma_colour", "band", "flux_adu", "flux_sigma_adu"),
    "is_saturated",
)
"""Keys of a point's brightness, with the names of its own fields."""


def _light_report(light: PointMagnitude | None) -> dict[str, Any]:
    """Return the brightness of a point; every value None where it was not measured."""
    return {key: getattr(light, key, None) for key in _OF_LIGHT}


def mover_numbers_by_norad_id(answers: Sequence[MoverMatches]) -> dict[int, int]:
    """Number of each identified mover, by the catalogue number of its object."""
    return {
        each.candidates[best].entry.norad_id: number
        for number, each in enumerate(answers, start=1)
        if (best := each.matched.choices[0].candidate) is not None
        and each.matched.choices[0].probability >= TAKEN
    }


def _too_old(answer: FrameMatches) -> list[str]:
    if not answer.too_old:
        return []
    days = f"more than {OLDEST_DAYS:.0f} days from the frame"
    return [f"{answer.too_old:,} catalogued objects left out, their elements are {days}"]


def _without_place(answer: FrameMatches) -> list[str]:
    if not answer.without_place:
        return []
    names = [catalogued_name(each.name, each.norad_id) for each in answer.without_place]
    count = count_words(len(names), "catalogued object")
    return [f"{count} without a place then by SGP4 (decayed?): {first_few(names)}"]


def _seen_as(answer: FrameMatches) -> dict[int, int]:
    """Return the number of each candidate's most likely streak, by the candidate's index."""
    found: dict[int, int] = {}
    for number, matched in enumerate(answer.match.lines, start=1):
        best = matched.choices[0]
        if best.candidate is not None and best.probability >= TAKEN:
            found[best.candidate] = number
    return found


def _why_unseen(answer: FrameMatches, n: int, is_mover: bool) -> str | None:
    if is_mover or answer.match.taken[n] >= TAKEN:
        return None
    candidate, frame = answer.candidates[n], answer.frame
    if _lit(candidate, frame.t_mid_utc_ns) < LIT_SHARE:
        return "in the Earth's shadow"
    rate_arcsec_s = float(np.linalg.norm(candidate.rate)) / ARCSEC_RAD
    if rate_arcsec_s * frame.exposure_s < _POINT_PX * frame.solution.scale_arcsec_px:
        return "hardly longer than a star in so short an exposure"
    perhaps = [
        number
        for number, matched in enumerate(answer.match.lines, start=1)
        if any(each.candidate == n for each in matched.choices)
    ]
    if perhaps:
        return f"streak {perhaps[0]} may be it"
    return "too faint, or not where its elements say"


def _lit(candidate: Candidate, t_utc_ns: int) -> float:
    return float(lit_fraction(candidate.r_km[None], np.array([t_utc_ns], np.int64))[0])


def _candidate_report(candidate: Candidate, frame: FieldFrame) -> dict[str, Any]:
    entry = candidate.entry
    ra_deg, dec_deg = unit_to_direction(candidate.nominal)
    x, y = sky_to_pixel(frame.solution.wcs, ra_deg, dec_deg)
    rate_arcsec_s, angle_deg = _motion(candidate.nominal[1], candidate.rate)
    return {
        **_named(candidate),
        "regime": orbit_regime(entry.revolutions_a_day, entry.eccentricity),
        "chance": candidate.chance,
        "gate_along_s": candidate.gate_s,
        "gate_across_arcmin": candidate.gate_across_rad / _ARCMIN_RAD,
        "ra": float(ra_deg[1]),
        "dec": float(dec_deg[1]),
        "x": float(x[1]),
        "y": float(y[1]),
        "x_a": float(x[0]),
        "y_a": float(y[0]),
        "x_b": float(x[2]),
        "y_b": float(y[2]),
        "rate_arcsec_s": rate_arcsec_s,
        "position_angle_deg": angle_deg,
        "range_km": candidate.range_km,
        "lit": _lit(candidate, frame.t_mid_utc_ns),
    }


def _named(candidate: Candidate) -> dict[str, Any]:
    return {
        "norad_id": candidate.entry.norad_id,
        "name": candidate.entry.name,
        "tle_age_days": candidate.age_days,
    }


def _matched_report(matched: LineMatch, candidates: Sequence[Candidate]) -> dict[str, Any]:
    """Result of a match: its candidates, and the probability of an uncatalogued object."""
    named = [each for each in matched.choices if each.candidate is not None]
    none = [each.probability for each in matched.choices if each.candidate is None]
    return {
        "verdict": matched.verdict,
        "matches": [_choice_report(each, candidates) for each in named],
        "not_catalogued": none[0] if none else 0.0,
    }


def _choice_report(choice: LineChoice, candidates: Sequence[Candidate]) -> dict[str, Any]:
    fit = choice.fit
    assert choice.candidate is not None and fit is not None  # noqa: PT018 - go together
    entry = candidates[choice.candidate].entry
    by_radial, by_plane = fit.across_by
    return {
        **_named(candidates[choice.candidate]),
        "tle_epoch_utc": utc_ns_to_iso(entry.epoch_utc_ns),
        "regime": orbit_regime(entry.revolutions_a_day, entry.eccentricity),
        "probability": choice.probability,
        "along_track_s": fit.along_s,
        "sigma_along_track_s": fit.sigma_along_s,
        "cross_track_arcsec": fit.across_rad / ARCSEC_RAD,
        "sigma_cross_track_arcsec": fit.sigma_across_rad / ARCSEC_RAD,
        "along_track_km": fit.along_s * fit.speed_km_s,
        "cross_track_km": fit.across_rad * fit.range_km,
        "speed_km_s": fit.speed_km_s,
        "range_km": fit.range_km,
        "cross_track_by_radial": by_radial,
        "cross_track_by_plane": by_plane,
        "direction_difference_deg": fit.direction_deg,
        "length_ratio": fit.length_ratio,
    }


def _point_report(name: str, frame: FieldFrame, n: int) -> dict[str, Any]:
    points = frame.points
    ra_deg, dec_deg = unit_to_direction(points.u[n])
    return {
        "frame": name,
        "t_utc": utc_ns_to_iso(int(points.t_utc_ns[n])),
        "ra": float(ra_deg),
        "dec": float(dec_deg),
        "sigma_arcsec": points.sigma_arcsec,
        "x": float(points.x_px[n]),
        "y": float(points.y_px[n]),
        "snr": float(points.snr[n]),
    }


def _place(frame: FieldFrame, x_px: float, y_px: float) -> dict[str, float]:
    ra_deg, dec_deg = pixel_to_sky(frame.solution.wcs, x_px, y_px)
    return {"ra": float(ra_deg), "dec": float(dec_deg)}


def _motion(u: FloatArray, rate: FloatArray) -> tuple[float, float]:
    """Return the rate in arcsec/s and the position angle of a change of direction."""
    east = np.array([-u[1], u[0], 0.0]) / max(float(np.hypot(u[0], u[1])), 1e-12)
    along_east, along_north = float(rate @ east), float(rate @ np.cross(u, east))
    angle_deg = math.degrees(math.atan2(along_east, along_north)) % 360.0
    return math.hypot(along_east, along_north) / ARCSEC_RAD, angle_deg
