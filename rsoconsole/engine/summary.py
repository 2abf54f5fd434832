"""A run against the simulated observatory, judged by the truth that only this module reads."""

import json
import math
import statistics
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import singledispatchmethod
from pathlib import Path
from typing import Any

from rsoconsole.records import (
    CycleTiming,
    Detections,
    FrameTaken,
    Measurement,
    Miss,
    NotFollowed,
    StateChange,
    TrackState,
)
from rsoconsole.sky.angles import separation_deg

SAME_OBJECT_ARCSEC = 60.0
SAME_FRAME_NS = 1_000_000_000


@dataclass(slots=True)
class _Frame:
    """What the session says of one exposure."""

    t_mid_utc_ns: int
    state: str = "SEARCH"
    measurements: list[Measurement] = field(default_factory=list)
    predicted: TrackState | None = None
    updated: TrackState | None = None
    gated: list[Measurement] = field(default_factory=list)


class _Tally:
    """The session's records gathered by exposure."""

    def __init__(self) -> None:
        self.frames: dict[int, _Frame] = {}
        self.timings: list[CycleTiming] = []
        self.detections = 0
        self.misses = 0
        self.locked_after: int | None = None
        self._state = "SEARCH"

    @singledispatchmethod
    def take(self, record: Any) -> None:
        """One record, in order; kinds that no figure needs pass by."""

    @take.register
    def _(self, record: FrameTaken) -> None:
        t_mid_ns = (record.t_start_utc_ns or 0) + round((record.exposure_s or 0.0) * 5e8)
        self.frames[record.frame_id] = _Frame(t_mid_ns, self._state)

    @take.register
    def _(self, record: Detections) -> None:
        self.detections += len(record.detections)

    @take.register
    def _(self, record: Measurement) -> None:
        self.frames[record.frame_id].measurements.append(record)

    @take.register
    def _(self, record: TrackState) -> None:
        if record.kind == "predicted":
            self.frames[record.frame_id].predicted = record
        else:
            self.frames[record.frame_id].updated = record

    @take.register
    def _(self, record: NotFollowed) -> None:
        if record.reason.startswith("NIS"):
            self.frames[record.frame_id].gated.append(record.measurement)

    @take.register
    def _(self, _record: Miss) -> None:
        self.misses += 1

    @take.register
    def _(self, record: StateChange) -> None:
        self._state = record.after
        if record.frame_id in self.frames:
            self.frames[record.frame_id].state = record.after
        if record.after == "TRACK" and self.locked_after is None:
            self.locked_after = record.frame_id

    @take.register
    def _(self, record: CycleTiming) -> None:
        self.timings.append(record)


def summarise(records: Iterable[Any], truth: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The figures of ``rsoconsole demo --headless``, without scenario, seed and session.

    ``records`` in the session's order; ``truth`` one object an exposure as the simulated
    observatory wrote it. Errors are distances on the sky, root mean square.
    """
    tally = _Tally()
    for record in records:
        tally.take(record)
    return {
        "frames": len(tally.frames),
        "detections": tally.detections,
        "misses": tally.misses,
        "states": dict(Counter(frame.state for frame in tally.frames.values())),
        "locked_after_frames": tally.locked_after,
        **_against_truth(tally.frames, truth),
        **_consistency(tally.frames),
        "latency_ms": _latency(tally.timings),
    }


def read_truth(path: Path) -> list[dict[str, Any]]:
    """The simulated observatory's truth, one object an exposure; empty when there is none."""
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line]


def _satellites(truth: Sequence[Mapping[str, Any]], t_mid_utc_ns: int) -> list[Mapping[str, Any]]:
    for exposure in truth:
        t_true_mid_ns = exposure["t_start_utc_ns"] + round(exposure["exposure_s"] * 5e8)
        if abs(t_true_mid_ns - t_mid_utc_ns) < SAME_FRAME_NS:
            return list(exposure["satellites"])
    return []


def _against_truth(
    frames: Mapping[int, _Frame], truth: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    followed: Counter[str] = Counter()
    measured: list[float] = []
    predicted: list[float] = []
    for frame in frames.values():
        satellites = _satellites(truth, frame.t_mid_utc_ns)
        if not satellites:
            continue
        for measurement in frame.measurements:
            off, _ = _nearest(satellites, measurement.ra_icrs_deg, measurement.dec_icrs_deg)
            if off <= SAME_OBJECT_ARCSEC:
                measured.append(off)
        if frame.updated is not None:
            off, name = _nearest(satellites, frame.updated.x[0], frame.updated.x[2])
            followed[name if off <= SAME_OBJECT_ARCSEC else "nothing real"] += 1
        if frame.predicted is not None and frame.updated is not None:
            off, _ = _nearest(satellites, frame.predicted.x[0], frame.predicted.x[2])
            predicted.append(off)
    total = sum(followed.values())
    target, times = followed.most_common(1)[0] if followed else (None, 0)
    return {
        "target": target,
        "target_share": times / total if total else None,
        "measured_rms_arcsec": _rms(measured),
        "prediction_rms_arcsec": _rms(predicted),
    }


def _nearest(
    satellites: Sequence[Mapping[str, Any]], ra_deg: float, dec_deg: float
) -> tuple[float, str]:
    """Distance in arcsec to the nearest satellite's true place, and its name."""
    return min(
        (
            separation_deg(s["ra_icrs_deg"], s["dec_icrs_deg"], ra_deg % 360.0, dec_deg) * 3600.0,
            str(s["name"]),
        )
        for s in satellites
    )


def _consistency(frames: Mapping[int, _Frame]) -> dict[str, float | None]:
    nis: list[float] = []
    inside: list[bool] = []
    for frame in frames.values():
        updated = frame.updated
        if updated is None or updated.nis is None or frame.predicted is None:
            inside.extend(False for _ in frame.gated)
            continue
        nis.append(updated.nis)
        innovation, sigma = updated.innovation_arcsec, updated.sigma_innovation_arcsec
        if innovation is not None and sigma is not None:
            pairs = zip(innovation, sigma, strict=True)
            inside.append(all(abs(value) <= 3.0 * bound for value, bound in pairs))
    return {
        "nis_mean": statistics.fmean(nis) if nis else None,
        "inside_3sigma": sum(inside) / len(inside) if inside else None,
    }


def _latency(timings: Sequence[CycleTiming]) -> dict[str, dict[str, float]]:
    stages: dict[str, dict[str, float]] = {}
    for stage in ("process", "detect", "solve", "filter", "total"):
        values = sorted(t.stage_ms[stage] for t in timings if stage in t.stage_ms)
        if values:
            stages[stage] = {
                "median": round(statistics.median(values), 3),
                "p95": round(values[math.ceil(0.95 * len(values)) - 1], 3),
            }
    return stages


def _rms(values: Sequence[float]) -> float | None:
    return math.sqrt(statistics.fmean(v * v for v in values)) if values else None
