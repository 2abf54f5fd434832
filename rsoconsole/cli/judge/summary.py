"""Summary of a run with the simulated observatory, evaluated against the observatory's truth."""

import math
import statistics
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rsoconsole.base import parse_json
from rsoconsole.cli.judge._objects import (
    direction_offset_arcsec,
    identified_norad_id,
    is_on_a_streak,
    lead_measured,
    lead_track_id,
    measurement_offset_arcsec,
    objects_figures,
    steps_by_track_id,
)
from rsoconsole.night import NightFrame, NightTrack, frames_of, rms, tracks_of
from rsoconsole.records import (
    CycleTiming,
    Identified,
    LeapDone,
    LowPass,
    Measurement,
    OrbitEstimate,
    Record,
)

_PARTS = ("total", "slew", "settle", "shutter", "open", "readout", "wait")
_ON_RECORD = (
    *("streaks", "ended", "a_km", "e", "i_deg", "across_rms_arcsec"),
    *("t_next_rise_utc_ns", "sigma_next_s", "scatter_s"),
)
"""Fields of a pass that are copied from the record."""


def leap_figures(leaps: Sequence[LeapDone], passes: Sequence[LowPass]) -> dict[str, Any] | None:
    """Return the summary's figures of leaps and passes of low satellites; None without any.

    They are the numbers of leaps made, of leaps that met the satellite and of leaps ordered as the
    shutter closed, the medians of a leap's durations (s), and each pass.
    """
    if not leaps and not passes:
        return None
    met = [each for each in leaps if each.result == "met"]
    took = {
        part: round(statistics.median(getattr(each, f"{part}_s") for each in leaps), 3)
        for part in _PARTS
        if leaps
    }
    beside = [each.total_s - each.slew_s - each.settle_s for each in leaps]
    return {
        "leaps": len(leaps),
        "met": len(met),
        "ordered_at_close": sum(each.ordered == "at close" for each in leaps),
        "took_s": took,
        "beside_slew_and_settle_s": round(statistics.median(beside), 3) if beside else None,
        "passes": [_of_pass(each, met) for each in passes],
    }


def _of_pass(each: LowPass, met: Sequence[LeapDone]) -> dict[str, Any]:
    return {
        "name": each.name or None,
        "planned_leaps": each.planned_leaps,
        "leaps_met": sum(leap.begun_frame_id == each.begun_frame_id for leap in met),
        **{name: getattr(each, name) for name in _ON_RECORD},
    }


@dataclass(slots=True)
class _Satellite:
    """All tracks of one satellite; of an unknown one its only track."""

    tracks: list[int] = field(default_factory=list)
    frames: int = 0
    """Number of frames in which the satellite was measured."""
    last_frame: int = 0
    is_measured_last: bool = False


def tracks_figures(
    frames: Sequence[NightFrame], known: Mapping[int, NightTrack]
) -> list[dict[str, Any]]:
    """The summary's ``tracks``: one object per satellite, in the order in which they were found.

    Keys of each satellite:

    - ``tracks``: ids of its tracks.
    - ``frames``: number of frames in which it was measured.
    - ``state``: at the end of the run: TRACK, COAST, LOST, or IDLE where the operator ended the
      track.
    - ``lost``: why it was lost, in words.
    - ``orbit``: as the summary's ``orbit``.
    """
    satellites: dict[object, _Satellite] = {}
    for frame in frames:
        for track_id, step in steps_by_track_id(frame).items():
            number = identified_norad_id(known[track_id].identified)
            key: object = ("track", track_id) if number is None else number
            found = satellites.setdefault(key, _Satellite())
            if track_id not in found.tracks:
                found.tracks.append(track_id)
            updated = step.updated
            is_measured = updated is not None and updated.kind != "predicted"
            # A track begins with two measurements, in two frames.
            found.frames += 2 if updated is not None and updated.kind == "initial" else is_measured
            found.last_frame, found.is_measured_last = frame.frame_id, is_measured
    newest = max((frame.frame_id for frame in frames), default=0)
    return [_figures(each, known, newest) for each in satellites.values()]


def _figures(satellite: _Satellite, known: Mapping[int, NightTrack], newest: int) -> dict[str, Any]:
    last = known[satellite.tracks[-1]]
    orbit, named, lost = last.orbit, last.identified, last.lost
    is_named = identified_norad_id(named) is not None
    return {
        "name": named.matches[0].name if named is not None and is_named else None,
        "norad_id": identified_norad_id(named),
        "tracks": list(satellite.tracks),
        "frames": satellite.frames,
        "last_frame": satellite.last_frame,
        "state": _state(satellite, lost, newest),
        "lost": lost or None,
        "orbit": None if orbit is None else orbit_figures(orbit),
    }


def _state(satellite: _Satellite, lost: str, newest: int) -> str:
    if lost:
        return "LOST"
    if satellite.last_frame < newest:
        return "IDLE"
    return "TRACK" if satellite.is_measured_last else "COAST"


def orbit_figures(orbit: OrbitEstimate) -> dict[str, Any]:
    """Figures of an orbit estimate for the summary."""
    names: Sequence[str] = (
        *("label", "prior", "a_km", "sigma_a_km", "e", "i_deg", "observations", "arc_s"),
    )
    return {name: getattr(orbit, name) for name in names}


SAME_OBJECT_ARCSEC = 60.0
SAME_FRAME_NS = 1_000_000_000
HIDDEN_SNR = 15.0
"""Matched SNR below which a miss is due to the satellite's faintness, not to the detector."""


def summarise(
    records: Iterable[Record],
    truth: Sequence[Mapping[str, Any]],
    targets: Mapping[int, str] | None = None,
) -> dict[str, Any]:
    """Return the figures of ``rsoconsole demo --headless`` that come from records and truth.

    ``records``: in the session's order. ``truth``: one object per exposure as the simulated
    observatory wrote it. ``targets``: names, by catalogue number, of the satellites for which the
    night was made. Errors are root mean squares of distances on the sky. ``measured_rms_arcsec``
    covers the followed satellite's measurements, and its neighbours have a figure of their own;
    where none was followed it covers those of all satellites.
    """
    log = list(records)
    frames = [each for each in frames_of(log) if each.taken is not None]
    views = _with_exposures(frames, truth)
    led, misses = _lead_track(frames)
    locked = (each.frame_id for each in frames if any(c.after == "TRACK" for c in each.changes))
    return {
        "frames": len(frames),
        "detections": sum(len(frame.detected_streaks) for frame in frames),
        "misses": misses,
        "states": dict(Counter(frame.state_after or "SEARCH" for frame in frames)),
        "locked_after_frames": next(locked, None),
        **_against_truth(views),
        "orbit": None if led.orbit is None else orbit_figures(led.orbit),
        "identified": None if led.identified is None else _name_figures(led.identified),
        "tracks": tracks_figures(frames, tracks_of(frames)),
        "objects": objects_figures(views, targets or {}),
        "leaps": leap_figures(
            [each for each in log if isinstance(each, LeapDone)],
            [each for each in log if isinstance(each, LowPass)],
        ),
        "latency_ms": _latency([each for each in log if isinstance(each, CycleTiming)]),
    }


@dataclass(slots=True)
class _LeadTrack:
    """The last lead track, with its last orbit and identification."""

    track_id: int | None = None
    orbit: OrbitEstimate | None = None
    identified: Identified | None = None


def _lead_track(frames: Iterable[NightFrame]) -> tuple[_LeadTrack, int]:
    """The last lead track, and the number of misses of all leads."""
    led, misses = _LeadTrack(), 0
    for frame in frames:
        lead = lead_track_id(steps_by_track_id(frame))
        led.track_id = led.track_id if lead is None else lead
        misses += sum(each.track_id in (None, led.track_id) for each in frame.misses)
        for orbit in frame.orbits:
            led.orbit = orbit if orbit.track_id == led.track_id else led.orbit
        for found in frame.names:
            led.identified = found if found.track_id == led.track_id else led.identified
    return led, misses


def _name_figures(found: Identified) -> dict[str, Any]:
    """Figures of the last identification."""
    best = found.matches[0] if found.matches else None
    return {
        "verdict": found.verdict,
        "norad_id": None if best is None else best.norad_id,
        "name": None if best is None else best.name,
        "separation_arcsec": None if best is None else best.separation_arcsec,
        "runner_up": found.matches[1].name if len(found.matches) > 1 else None,
    }


def read_truth(path: Path) -> list[dict[str, Any]]:
    """Read the simulated observatory's truth, a dict per exposure; empty without the file."""
    if not path.exists():
        return []
    return [parse_json(line) for line in path.read_text(encoding="utf-8").splitlines() if line]


_Views = Sequence[tuple[NightFrame, Mapping[str, Any]]]
"""Frames, each with the truth of its exposure."""


def _with_exposures(frames: Sequence[NightFrame], truth: Sequence[Mapping[str, Any]]) -> _Views:
    """Frames with the truth of their exposures; an empty one where none is near in time.

    Each truth also has the constant lateness of all exposures by their clock: no frame shows that.
    """
    late_ns = [
        exposure["t_open_utc_ns"] + round(exposure["exposure_s"] * 5e8) - exposure["t_place_utc_ns"]
        for exposure in truth
        if "t_open_utc_ns" in exposure and "t_place_utc_ns" in exposure
    ]
    always = {"always_late_ns": round(statistics.median(late_ns)) if late_ns else 0}
    return [(frame, {**_exposure(truth, frame), **always}) for frame in frames]


def _exposure(truth: Sequence[Mapping[str, Any]], frame: NightFrame) -> Mapping[str, Any]:
    """The truth of a frame, each satellite with the instant of its place."""
    for exposure in truth:
        t_true_mid_ns = exposure["t_start_utc_ns"] + round(exposure["exposure_s"] * 5e8)
        if abs(t_true_mid_ns - frame.t_mid_utc_ns) < SAME_FRAME_NS:
            if "t_place_utc_ns" not in exposure:
                return exposure
            t_utc_ns = exposure["t_place_utc_ns"]
            timed = [{**each, "t_utc_ns": t_utc_ns} for each in exposure["satellites"]]
            return {**exposure, "satellites": timed}
    return {"satellites": ()}


def _against_truth(views: _Views) -> dict[str, Any]:
    """Figures against what really was there; those of the track against one named satellite."""
    target, share = _followed(views)
    predicted, outside, nis = _track_figures(views, target)
    confidences = [m.confidence for frame, _ in views if (m := lead_measured(frame)) is not None]
    return {
        "target": target,
        "target_share": share,
        **_measured_figures(views, target),
        "prediction_rms_arcsec": rms(predicted),
        "nis_mean": statistics.fmean(nis) if nis else None,
        "inside_3sigma": None if not outside else 1.0 - sum(outside) / len(outside),
        "confidence_min": min(confidences, default=None),
        **_hidden(views, target),
    }


def _measured_figures(views: _Views, target: str | None) -> dict[str, Any]:
    """Figures of measurements, each against the nearest satellite; the target's neighbours apart.

    False are those far from all of them and on no streak: the middle of a cut or fast one may
    be far from its own.
    """
    measured: list[float] = []
    neighbours: list[float] = []
    chi2: list[float] = []
    false_measurements = 0
    for frame, exposure in views:
        for measurement in frame.measurements:
            offsets = [
                (*measurement_offset_arcsec(measurement, each), each["name"])
                for each in exposure["satellites"]
            ]
            nowhere = (math.inf, 0.0, None)
            east, north, name = min(offsets, key=lambda o: math.hypot(o[0], o[1]), default=nowhere)
            if math.hypot(east, north) > SAME_OBJECT_ARCSEC:
                false_measurements += not is_on_a_streak(measurement, exposure)
            elif target is not None and name != target:
                neighbours.append(math.hypot(east, north))
            else:
                measured.append(math.hypot(east, north))
                chi2.append(_chi2(measurement, east, north))
    return {
        "false_measurements": false_measurements,
        "measured_rms_arcsec": rms(measured),
        "neighbours_rms_arcsec": rms(neighbours),
        "measured_chi2_mean": statistics.fmean(chi2) if chi2 else None,
    }


def _hidden(views: _Views, target: str | None) -> dict[str, int]:
    """Followed frames in which clouds or its own fading hid the target, and the other misses.

    Without them a night of clouds would look like a poor detector.
    """
    hidden = others = 0
    for frame, exposure in views:
        if frame.predicted is None:
            continue
        true = next((s for s in exposure["satellites"] if s["name"] == target), None)
        is_hidden = true is not None and float(true.get("snr_matched", math.inf)) < HIDDEN_SNR
        hidden += is_hidden
        others += frame.updated is None and not is_hidden
    return {"frames_hidden": hidden, "misses_visible": others}


def _followed(views: _Views) -> tuple[str | None, Any]:
    """The satellite most updates lie on, and the share of updates that do."""
    names: Counter[str] = Counter()
    for frame, exposure in views:
        if frame.updated is None:
            continue
        at = frame.updated.x[0], frame.updated.x[2], frame.updated.t_utc_ns
        satellites = exposure["satellites"]
        near = [(math.hypot(*direction_offset_arcsec(s, *at)), str(s["name"])) for s in satellites]
        off, name = min(near, default=(math.inf, ""))
        names[name if off <= SAME_OBJECT_ARCSEC else "nothing real"] += 1
    if not names:
        return None, None
    target, times = names.most_common(1)[0]
    return target, times / sum(names.values())


def _track_figures(
    views: _Views, target: str | None
) -> tuple[list[float], list[bool], list[float]]:
    """Figures of the one-step predictions of the target in the frame, also of missed ones.

    Errors in arcsec; whether a measurement of the target fell outside 3 sqrt(S), refused ones
    included; NIS of all of them.
    """
    errors: list[float] = []
    outside: list[bool] = []
    nis: list[float] = []
    for frame, exposure in views:
        named = (s for s in exposure["satellites"] if s["name"] == target)
        true = next((s for s in named if s["is_in_frame"]), None)
        predicted, updated = frame.predicted, frame.updated
        if true is None or predicted is None:
            continue
        if predicted.misses <= 1:
            at = predicted.x[0], predicted.x[2], predicted.t_utc_ns
            errors.append(math.hypot(*direction_offset_arcsec(true, *at)))
        if updated is not None and updated.nis is not None:
            nis.append(updated.nis)
            innovation = updated.innovation_arcsec or (0.0, 0.0)
            bounds = updated.sigma_innovation_arcsec or (0.0, 0.0)
            pairs = zip(innovation, bounds, strict=True)
            outside.append(any(abs(value) > 3.0 * bound for value, bound in pairs))
            continue
        for each in frame.not_followed:
            measurement, value = each.measurement, each.nis
            if value is None:
                continue
            if math.hypot(*measurement_offset_arcsec(measurement, true)) <= SAME_OBJECT_ARCSEC:
                nis.append(value)
                outside.append(True)
    return errors, outside, nis


def _chi2(measurement: Measurement, east: float, north: float) -> float:
    """Squared error in units of the measurement's own covariance; 2 when that is honest."""
    ee, en, nn = measurement.cov_sky_arcsec2
    return (nn * east**2 - 2.0 * en * east * north + ee * north**2) / (ee * nn - en**2)


_STAGES = (
    *("read", "glance", "ahead", "process", "detect", "solve", "filter", "order"),
    *("total", "orbit"),
)


def _latency(timings: Sequence[CycleTiming]) -> dict[str, dict[str, float]]:
    stages: dict[str, dict[str, float]] = {}
    for stage in _STAGES:
        values = sorted(t.stage_ms[stage] for t in timings if stage in t.stage_ms)
        if values:
            stages[stage] = {
                "median": round(statistics.median(values), 3),
                "p95": round(values[math.ceil(0.95 * len(values)) - 1], 3),
            }
    return stages
