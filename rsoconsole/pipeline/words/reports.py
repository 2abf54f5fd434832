"""Records as the command line's JSON objects, an interface that users' scripts depend on.

Keys may be added, never renamed. Angles are in degrees, ICRS; what is missing is None.
"""

import math
from collections.abc import Sequence
from typing import Any

from rsoconsole.instruments import EXTENSION_KEY, exposure_time
from rsoconsole.night import predicted_sigma_arcsec
from rsoconsole.pipeline.batch.batch_pool import ProcessedFrame
from rsoconsole.pipeline.frame.frame_site import FrameSite
from rsoconsole.pipeline.frame.hints import WrongHint
from rsoconsole.pipeline.frame.reduce import Reduction
from rsoconsole.records import (
    Detection,
    Detections,
    Frame,
    Measurement,
    NotSolved,
    Photometry,
    Solution,
    StateChange,
    StreakLight,
    TrackState,
    measurement_id_of,
)
from rsoconsole.sky import wcs_cards
from rsoconsole.tracking import Following
from rsoconsole.vision import PointList
from rsoconsole.words import text, utc_ns_to_iso

_OF_DETECTION = (
    *("confidence", "snr", "kind", "class_probability", "train", "modulation_period_px"),
    *("modulation_period_s", "modulation_depth"),
    *("angle_deg", "sigma_angle_deg", "sigma_across_px"),
)
"""Keys with the names of the detection's own fields."""
_OF_PLATE = {
    "ra": "ra_icrs_deg",
    "dec": "dec_icrs_deg",
    "scale_arcsec_px": "scale_arcsec_px",
    "rotation_deg": "rotation_deg",
    "flipped": "is_flipped",
    "matched": "matched",
    "rms_arcsec": "rms_arcsec",
}
"""Keys of a plate solution, and the fields of a solution that they show."""


def detection_report(detection: Detection) -> dict[str, Any]:
    """Return the JSON object of one candidate streak."""
    return {
        "x": detection.x_px,
        "y": detection.y_px,
        "x_a": detection.x_a_px,
        "y_a": detection.y_a_px,
        "x_b": detection.x_b_px,
        "y_b": detection.y_b_px,
        "box": list(detection.box_px),
        "length": detection.length_px,
        "width": detection.width_px,
        "clipped": detection.is_clipped,
        "class": detection.object_class,
        **{name: getattr(detection, name) for name in _OF_DETECTION},
    }


_OF_LIGHT = (
    *("mag", "mag_sigma", "mag_sigma_colour", "band", "flux_adu", "flux_sigma_adu"),
    *("is_saturated", "is_blended"),
)
"""Keys of a streak's brightness, with the names of its own fields."""
_OF_ZERO_POINT = ("zero_point_mag", "zero_point_sigma_mag", "zero_point_stars", "limiting_mag")


def _light_report(light: Photometry | None, frame_id: int, number: int) -> dict[str, Any]:
    """Return the brightness of one candidate; every value None where it was not measured."""
    name = measurement_id_of(frame_id, number)
    streaks = () if light is None else light.streaks
    return streak_light_report(
        next((each for each in streaks if each.measurement_id == name), None)
    )


def streak_light_report(light: StreakLight | None) -> dict[str, Any]:
    """Return the brightness of a streak; every value None where it was not measured."""
    return {key: getattr(light, key, None) for key in _OF_LIGHT}


def points_report(points: PointList | None) -> list[dict[str, Any]]:
    """Return the JSON objects of the points among a frame's star trails; none without trails.

    Only those that one frame alone makes likely.
    """
    if points is None:
        return []
    return [
        {
            "x": float(points.x_px[n]),
            "y": float(points.y_px[n]),
            "sigma": float(points.sigma_px[n]),
            "snr": float(points.snr[n]),
            "flux_adu": float(points.flux_adu[n]),
            "flux_sigma_adu": float(points.flux_sigma_adu[n]),
            "is_trail_end": bool(points.is_trail_end[n]),
        }
        for n in points.sure()
    ]


def detections_report(
    name: str,
    found: Detections,
    light: Photometry | None = None,
    *,
    points: Sequence[dict[str, Any]] = (),
    extension: str | None = None,
    notes: Sequence[str] = (),
) -> dict[str, Any]:
    """Return the JSON object of ``rsoconsole detect``.

    ``light``: the frame's brightness; None where it was not measured. ``points``: those among star
    trails, by ``points_report``. ``extension``: the one read, of a file with several images;
    ``notes``: cautions about the frame.
    """
    return {
        "frame": name,
        "extension": extension,
        "width": found.width_px,
        "height": found.height_px,
        "detections": [
            {**detection_report(d), **_light_report(light, found.frame_id, n)}
            for n, d in enumerate(found.detections)
        ],
        "points": list(points),
        **{key: getattr(light, key, None) for key in _OF_ZERO_POINT},
        "rejected": [
            {**detection_report(r.detection), "reason": text(r.reason)} for r in found.rejected
        ],
        "ms": {stage: round(value, 3) for stage, value in found.stage_ms.items()},
        "notes": list(notes),
    }


def solved_report(
    name: str,
    solution: Solution | NotSolved,
    frame: Frame,
    *,
    wrong: Sequence[WrongHint] = (),
    index_missing: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> dict[str, Any]:
    """Return the JSON object of ``rsoconsole solve``.

    ``wrong``: hints that the stars contradict; ``index_missing``: index files that are missing for
    a field of the hinted scale; ``notes``: cautions about the frame.
    """
    return {
        **solution_report(name, solution, frame.width_px, frame.height_px),
        "extension": frame.header.get(EXTENSION_KEY),
        "wrong_hints": [{"hint": each.hint, "reason": each.words} for each in wrong],
        "index_missing": list(index_missing),
        "notes": list(notes),
    }


def solution_report(
    name: str, solution: Solution | NotSolved, width_px: int, height_px: int
) -> dict[str, Any]:
    """Return the JSON object of a plate solution, or of the reason why there is none."""
    plate = solution if isinstance(solution, Solution) else None
    values = {key: getattr(plate, field, None) for key, field in _OF_PLATE.items()}
    return {
        "frame": name,
        "solved": plate is not None,
        "reason": solution.reason if isinstance(solution, NotSolved) else None,
        **values,
        "wcs": None if plate is None else wcs_cards(plate.wcs, width_px, height_px),
        "ms": round(solution.ms, 3),
    }


def measurement_report(measurement: Measurement) -> dict[str, Any]:
    """Return the JSON object of one measurement."""
    east, _, north = measurement.cov_sky_arcsec2
    return {
        "ra": measurement.ra_icrs_deg,
        "dec": measurement.dec_icrs_deg,
        "sigma_ra_arcsec": math.sqrt(east),
        "sigma_dec_arcsec": math.sqrt(north),
        "x": measurement.x_px,
        "y": measurement.y_px,
        "confidence": measurement.confidence,
        "source": measurement.source,
    }


def prediction_report(track: TrackState) -> dict[str, Any]:
    """Return the JSON object of the filter's prediction for a frame."""
    east_arcsec, north_arcsec = predicted_sigma_arcsec(track)
    return {
        "t_utc": utc_ns_to_iso(track.t_utc_ns),
        "ra": track.x[0] % 360.0,
        "dec": track.x[2],
        "sigma_ra_arcsec": east_arcsec,
        "sigma_dec_arcsec": north_arcsec,
    }


def process_report(name: str, processed: ProcessedFrame, place: FrameSite) -> dict[str, Any]:
    """Return the JSON object of ``rsoconsole process`` for one frame: one cycle of Algorithm 1.

    ``place``: the site in force.
    """
    frame, reduction, after = processed.frame, processed.reduction, processed.after
    light = next((r for r in processed.records if isinstance(r, Photometry)), None)
    found = detections_report(name, reduction.detections, light)
    states = [r for r in processed.records if isinstance(r, TrackState)]
    predicted = next((s for s in states if s.kind == "predicted"), None)
    updated = next((s for s in states if s.kind != "predicted"), None)
    followed = _followed(reduction, after)
    causes = [r.reason for r in processed.records if isinstance(r, StateChange)]
    faint = next((c for c in causes if c.kind == "faint frames agree"), None)
    solution = reduction.solution
    t_mid_ns = processed.t_mid_utc_ns
    return {
        "frame": name,
        "t_mid_utc": None if t_mid_ns is None else utc_ns_to_iso(t_mid_ns),
        "state": after.state,
        "detections": found["detections"],
        "rejected": found["rejected"],
        **{key: found[key] for key in _OF_ZERO_POINT},
        "solution": None
        if solution is None
        else solution_report(name, solution, frame.width_px, frame.height_px),
        "measurements": [measurement_report(m) for m in reduction.measurements],
        "measurement": None if followed is None else measurement_report(followed),
        "nis": None if updated is None else updated.nis,
        "predicted": None if predicted is None else prediction_report(predicted),
        "faint": None
        if faint is None
        else {"frames": faint.frames, "probability": faint.probability},
        "extension": frame.header.get(EXTENSION_KEY),
        "no_time": None if t_mid_ns is not None else exposure_time(frame.header).fault,
        "site": place.report,
        "notes": [*(each.words for each in reduction.cautions), *place.notes(frame)],
    }


def _followed(reduction: Reduction, after: Following) -> Measurement | None:
    """Return the accepted measurement, or the most confident before lock."""
    if after.state == "TRACK":
        return after.lead_measured
    if after.state == "COAST" or not reduction.measurements:
        return None
    return reduction.measurements[0]
