"""A run against the simulated observatory, judged object by object.

A detection or a measurement is of the object on whose true streak it lies, in pixels of its own
frame; of several the one whose middle is nearest. That holds for any rate, which an angle on the
sky does not: a hundredth of a second of shutter is 20 arcsec of a low satellite.
"""

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from rsoconsole.records import Detection, Identified, Measurement, TrackState
from rsoconsole.sky.angles import wrap_180

VISIBLE_SNR = 20.0
"""Integrated SNR from which a satellite in the field counts as visible."""
BESIDE_FWHM = 4.0
"""How far beside a true streak something may lie and be of it, in widths of the frame's stars."""


class JudgedFrame(Protocol):
    """What the session says of one exposure."""

    measurements: list[Measurement]
    detections: list[Detection]
    predicted: TrackState | None
    updated: TrackState | None
    identified: Identified | None


@dataclass(slots=True)
class _Tally:
    """Counts of one object."""

    name: str
    detections: int = 0
    visible_frames: int = 0
    track_frames: int = 0
    measured_arcsec: list[float] = field(default_factory=list)
    predicted_arcsec: list[float] = field(default_factory=list)
    identified: bool | None = None
    false_measurements: int = 0


def objects_figures(
    views: Sequence[tuple[JudgedFrame, Mapping[str, Any]]], targets: Mapping[int, str]
) -> list[dict[str, Any]]:
    """The summary's ``objects``: the targets, then all that was ever visible or detected.

    ``views``: each frame with its exposure's truth. ``detections``: frames in which a streak of
    the object was detected. ``visible_frames``: its place at mid-exposure lies in the field, and
    its integrated SNR is at least ``VISIBLE_SNR``. ``track_frames``: a track took its measurement.
    ``measured_rms_arcsec``: of all its measurements, those of clipped streaks across them alone.
    ``prediction_rms_arcsec``: one step ahead, of the track that followed it. ``identified``:
    whether the last name given to that track is right; None where none was given.
    ``false_measurements``: what that track took that was not of it.
    """
    tallies = {number: _Tally(name) for number, name in targets.items()}
    followed: int | None = None
    for frame, truth in views:
        there = {each["norad_id"]: each for each in truth.get("satellites", ()) if _is_told(each)}
        width_px = BESIDE_FWHM * float(truth.get("fwhm_px", 0.0))

        def of(number: int, there: Mapping[int, Mapping[str, Any]] = there) -> _Tally:
            return tallies.setdefault(number, _Tally(str(there[number]["name"])))

        for number, each in there.items():
            if each["is_in_frame"] and each["snr_integrated"] >= VISIBLE_SNR:
                of(number).visible_frames += 1
        seen = {_object_at(d.x_px, d.y_px, there, width_px) for d in frame.detections}
        for number in seen - {None}:
            assert number is not None
            of(number).detections += 1
        for measurement in frame.measurements:
            number = _object_at(measurement.x_px, measurement.y_px, there, width_px)
            error = None if number is None else _error_arcsec(measurement, there[number])
            if number is not None and error is not None:
                of(number).measured_arcsec.append(error)
        if followed is not None:
            _judge_prediction(of(followed) if followed in there else None, frame, there, followed)
        taken = taken_of(frame)
        if frame.updated is not None and taken is not None:
            number = _object_at(taken.x_px, taken.y_px, there, width_px)
            if frame.updated.kind == "initial" or followed is None:
                followed = number
            if number is not None and number == followed:
                of(number).track_frames += 1
            elif followed is not None:
                tallies[followed].false_measurements += 1
        if frame.identified is not None and followed is not None and followed in tallies:
            tallies[followed].identified = _is_right(frame.identified, followed)
    return [_figures(number, each) for number, each in tallies.items()]


def _is_told(satellite: Mapping[str, Any]) -> bool:
    """Whether its truth has what judging by streaks needs."""
    return "norad_id" in satellite and "x_start_px" in satellite and "snr_integrated" in satellite


def is_on_a_streak(measurement: Measurement, truth: Mapping[str, Any]) -> bool:
    """Whether a measurement lies on the true streak of anything."""
    there = {each["norad_id"]: each for each in truth.get("satellites", ()) if _is_told(each)}
    width_px = BESIDE_FWHM * float(truth.get("fwhm_px", 0.0))
    return _object_at(measurement.x_px, measurement.y_px, there, width_px) is not None


def _object_at(
    x_px: float, y_px: float, there: Mapping[int, Mapping[str, Any]], width_px: float
) -> int | None:
    """The object on whose streak a pixel lies."""
    near: list[tuple[float, int]] = []
    for number, each in there.items():
        ends = [(each[f"x_{end}_px"], each[f"y_{end}_px"]) for end in ("start", "end")]
        if _beside_px((x_px, y_px), *ends) <= width_px:
            near.append((math.hypot(x_px - each["x_px"], y_px - each["y_px"]), number))
    return min(near)[1] if near else None


def _beside_px(
    at: tuple[float, float], start: tuple[float, float], end: tuple[float, float]
) -> float:
    """Distance of a point from a line between two others."""
    along = (end[0] - start[0], end[1] - start[1])
    offset = (at[0] - start[0], at[1] - start[1])
    length2 = along[0] ** 2 + along[1] ** 2
    share = (offset[0] * along[0] + offset[1] * along[1]) / length2 if length2 > 0.0 else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.hypot(offset[0] - share * along[0], offset[1] - share * along[1])


def _error_arcsec(measurement: Measurement, true: Mapping[str, Any]) -> float | None:
    """Distance from the truth; of a clipped streak across it, where its direction is known."""
    cos_dec = math.cos(math.radians(true["dec_icrs_deg"]))
    east = wrap_180(measurement.ra_icrs_deg - true["ra_icrs_deg"]) * cos_dec * 3600.0
    north = (measurement.dec_icrs_deg - true["dec_icrs_deg"]) * 3600.0
    if not measurement.is_clipped:
        return math.hypot(east, north)
    if measurement.ends_icrs_deg is None:
        return None
    (ra_a, dec_a), (ra_b, dec_b) = measurement.ends_icrs_deg
    along_east, along_north = wrap_180(ra_b - ra_a) * cos_dec, dec_b - dec_a
    length = math.hypot(along_east, along_north)
    return abs(east * along_north - north * along_east) / length if length > 0.0 else None


def _judge_prediction(
    tally: _Tally | None,
    frame: JudgedFrame,
    there: Mapping[int, Mapping[str, Any]],
    followed: int,
) -> None:
    """One step ahead, where the object was in the frame."""
    predicted = frame.predicted
    if tally is None or predicted is None or predicted.misses > 1:
        return
    true = there[followed]
    if true["is_in_frame"]:
        cos_dec = math.cos(math.radians(true["dec_icrs_deg"]))
        east = wrap_180(predicted.x[0] - true["ra_icrs_deg"]) * cos_dec
        north = predicted.x[2] - true["dec_icrs_deg"]
        tally.predicted_arcsec.append(math.hypot(east, north) * 3600.0)


def taken_of(frame: JudgedFrame) -> Measurement | None:
    """The measurement that the track took; None where it took none."""
    named = None if frame.updated is None else frame.updated.measurement_id
    return next((m for m in frame.measurements if m.measurement_id == named), None)


def _is_right(found: Identified, followed: int) -> bool | None:
    if found.verdict != "identified" or not found.matches:
        return None
    return found.matches[0].norad_id == followed


def _figures(number: int, tally: _Tally) -> dict[str, Any]:
    return {
        "norad": number,
        "name": tally.name,
        "detections": tally.detections,
        "visible_frames": tally.visible_frames,
        "track_frames": tally.track_frames,
        "measured_rms_arcsec": _rms(tally.measured_arcsec),
        "prediction_rms_arcsec": _rms(tally.predicted_arcsec),
        "identified": tally.identified,
        "false_measurements": tally.false_measurements,
    }


def _rms(values: Sequence[float]) -> float | None:
    return math.sqrt(statistics.fmean(v * v for v in values)) if values else None
