"""A night under a sky of ours, judged by the truth that the sky's own command wrote. Pure."""

import math
import statistics
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rsoconsole.cli.judge.summary import SAME_OBJECT_ARCSEC, summarise
from rsoconsole.records import (
    Event,
    FrameTaken,
    Identified,
    Measurement,
    Miss,
    NotFollowed,
    NotSolved,
    Solution,
    StateChange,
    TrackState,
)
from rsoconsole.sky import wrap_180
from rsoconsole.words import text

VISIBLE_SNR = 20.0
"""Integrated; the noise of the simulator is known, so this is exact."""
SAME_FRAME_NS = 3_000_000_000
"""A header's time and the call's lie closer; a slow machine may take its time for a call."""

Truth = Mapping[str, Any]


@dataclass(slots=True)
class _Frame:
    """What the session says of one exposure, and the truth of it."""

    t_start_utc_ns: int
    truth: Truth | None
    state: str
    is_updated: bool = False
    at_deg: tuple[float, float] | None = None
    predicted: TrackState | None = None
    measurements: list[Measurement] = field(default_factory=list)
    solution: Solution | NotSolved | None = None
    reasons: list[str] = field(default_factory=list)


def judge(records: Iterable[Any], truth: Sequence[Truth]) -> dict[str, Any]:
    """Figures of the night and of each object; errors on the sky in arcsec, root mean square.

    ``calls``: skies asked for; more than the frames where the camera did not begin in time.

    ``measured_rms_arcsec`` is against where the object was at the middle of an exposure that began
    with the call; ``drawn_rms_arcsec`` against where the streak was drawn, the scatter of its time
    counted: the first has the shutter's error, the second has not.
    """
    told = list(records)
    frames = _frames(told, truth)
    solved = [f.solution for f in frames if isinstance(f.solution, Solution)]
    late_ms = [(f.truth["t_start_utc_ns"] - f.t_start_utc_ns) / 1e6 for f in frames if f.truth]
    names = {int(s["norad_id"]): str(s["name"]) for t in truth for s in t["satellites"]}
    verdict = next((each for each in reversed(told) if isinstance(each, Identified)), None)
    return {
        "frames": len(frames),
        "calls": len(truth),
        "frames_with_truth": len(late_ms),
        "alarms": dict(
            Counter(e.text for e in told if isinstance(e, Event) and e.level == "alarm")
        ),
        "solved": len(solved),
        "solve_rms_arcsec": _middle([each.rms_arcsec for each in solved]),
        "stars_matched": _middle([float(each.matched) for each in solved]),
        "call_after_header_ms": _middle(late_ms),
        "call_after_header_ms_max": max(late_ms, default=None),
        "gsc_ms": _middle([float(each["ms"]) for each in truth]),
        "scatter_rms_s": _rms([float(each["scatter_s"]) for each in truth]),
        "states": dict(Counter(f.state for f in frames)),
        "states_in_order": [f.state for f in frames],
        "reasons": dict(Counter(reason for f in frames for reason in f.reasons)),
        "false_measurements": sum(
            _nearest(m, f)[1] is None for f in frames for m in f.measurements
        ),
        "objects": [_object(number, name, frames, verdict) for number, name in names.items()],
        "as_the_demo_tells": summarise(told, truth),
    }


def _frames(records: Iterable[Any], truth: Sequence[Truth]) -> list[_Frame]:
    """In order, each with what belongs to it."""
    frames: dict[int, _Frame] = {}
    state = "SEARCH"
    for record in records:
        if isinstance(record, FrameTaken):
            start_ns = record.t_start_utc_ns or 0
            frames[record.frame_id] = _Frame(start_ns, truth_of(truth, start_ns), state)
        if isinstance(record, StateChange):
            state = record.after
        frame = frames.get(getattr(record, "frame_id", None) or -1)
        if frame is not None:
            _take(frame, record)
    return list(frames.values())


def _take(frame: _Frame, record: Any) -> None:
    match record:
        case Measurement():
            frame.measurements.append(record)
        case Solution() | NotSolved():
            frame.solution = record
        case TrackState(kind="predicted"):
            frame.predicted = record
        case TrackState():
            frame.is_updated, frame.at_deg = True, (record.x[0], record.x[2])
        case StateChange():
            frame.state = record.after
        case Miss() | NotFollowed():
            frame.reasons.append(
                f"{type(record).__name__}: {_without_figures(text(record.reason))}"
            )


def _without_figures(reason: str) -> str:
    """One kind of reason whatever its figures are."""
    return " ".join("#" if any(c.isdigit() for c in word) else word for word in reason.split())


def truth_of(truth: Sequence[Truth], t_start_utc_ns: int) -> Truth | None:
    """The call from which a frame that began then was drawn; None where there was none."""
    near = [(abs(each["t_start_utc_ns"] - t_start_utc_ns), i) for i, each in enumerate(truth)]
    off_ns, index = min(near, default=(SAME_FRAME_NS, 0))
    return truth[index] if off_ns < SAME_FRAME_NS else None


def _object(
    number: int, name: str, frames: Sequence[_Frame], verdict: Identified | None
) -> dict[str, Any]:
    """One satellite's night."""
    own = [(f, _of(f, number)) for f in frames]
    visible = [
        f for f, sat in own if sat and sat["is_in_frame"] and sat["snr_matched"] >= VISIBLE_SNR
    ]
    seen = [
        (m, sat) for f, sat in own if sat for m in f.measurements if _nearest(m, f)[1] == number
    ]
    measured = [_apart(m.ra_icrs_deg, m.dec_icrs_deg, sat) for m, sat in seen]
    drawn = [_apart(m.ra_icrs_deg, m.dec_icrs_deg, sat, "_drawn") for m, sat in seen]
    predicted = [
        math.hypot(*_apart(f.predicted.x[0], f.predicted.x[2], sat))
        for f, sat in own
        if sat and sat["is_in_frame"] and f.predicted is not None and f.predicted.misses <= 1
    ]
    tracked = [
        f
        for f, sat in own
        if sat and f.at_deg and math.hypot(*_apart(*f.at_deg, sat)) < SAME_OBJECT_ARCSEC
    ]
    best = verdict.matches[0] if verdict is not None and verdict.matches else None
    return {
        "norad_id": number,
        "name": name,
        "detections": len(seen),
        "visible_frames": len(visible),
        "track_frames": sum(f.state == "TRACK" for f in tracked),
        "coast_frames": sum(f.state == "COAST" for f in visible),
        "measured_rms_arcsec": _rms([math.hypot(*each) for each in measured]),
        "drawn_rms_arcsec": _rms([math.hypot(*each) for each in drawn]),
        "drawn_mean_arcsec": [_mean([e[axis] for e in drawn]) for axis in (0, 1)],
        "prediction_rms_arcsec": _rms(predicted),
        "identified": best is not None
        and best.norad_id == number
        and verdict.verdict == "identified",
        "false_measurements": sum(
            _nearest(m, f)[1] is None for f, sat in own if sat for m in f.measurements
        ),
        "confidence": [round(m.confidence, 2) for m, _ in seen],
        "sigma_claimed_arcsec": _middle(
            [math.sqrt(m.cov_sky_arcsec2[0] + m.cov_sky_arcsec2[2]) for m, _ in seen]
        ),
        "snr_integrated": _middle([s["snr_matched"] for _, s in own if s and s["is_in_frame"]]),
    }


def _of(frame: _Frame, number: int) -> Truth | None:
    satellites = frame.truth["satellites"] if frame.truth else []
    return next((each for each in satellites if each["norad_id"] == number), None)


def _nearest(measurement: Measurement, frame: _Frame) -> tuple[float, int | None]:
    """Distance to the nearest object and its number; None where nothing real is near."""
    satellites = frame.truth["satellites"] if frame.truth else []
    at = measurement.ra_icrs_deg, measurement.dec_icrs_deg
    near = [(math.hypot(*_apart(*at, each)), int(each["norad_id"])) for each in satellites]
    off, number = min(near, default=(math.inf, -1))
    return off, number if off <= SAME_OBJECT_ARCSEC else None


def _apart(ra_deg: float, dec_deg: float, satellite: Truth, which: str = "") -> tuple[float, float]:
    """(east, north) of a direction from the satellite's true place."""
    true_ra = float(satellite[f"ra{which}_icrs_deg"])
    true_dec = float(satellite[f"dec{which}_icrs_deg"])
    cos_dec = math.cos(math.radians(true_dec))
    return wrap_180(ra_deg - true_ra) * cos_dec * 3600.0, (dec_deg - true_dec) * 3600.0


def _rms(values: Sequence[float]) -> float | None:
    return math.sqrt(statistics.fmean(v * v for v in values)) if values else None


def _mean(values: Sequence[float]) -> float | None:
    return statistics.fmean(values) if values else None


def _middle(values: Sequence[float]) -> float | None:
    return statistics.median(values) if values else None
