"""Figures with exact 95 % intervals, computed from the rows of analysed frames."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from models.curve_fit import counts, gathered, population_weights, reliability
from models.frames import HARD, KINDS, Kind
from models.intervals import rate_interval, rate_upper_limit, share_interval
from models.judging import FrameRow, TrailRow, confidences_of
from rsoconsole.vision import ConfidenceCurve

SNR_BANDS = ((5.0, 30.0), (3.0, 5.0), (2.0, 3.0), (1.5, 2.0), (0.8, 1.5))
LENGTH_BANDS_PX = (
    (15.0, 30.0),
    (30.0, 60.0),
    (60.0, 90.0),
    (90.0, 150.0),
    (150.0, 300.0),
    (300.0, 600.0),
)
BELOW_TAU = "below tau"
MAX_REASONS = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Trail:
    """One true trail, with the result of the detector on it."""

    kind: Kind
    number: int
    true: TrailRow
    confidence: float
    """Confidence of the likeliest candidate on the trail; 0 without one."""
    error_px: float | None
    """Error of the likeliest candidate's midpoint; None without one, or where the edge cuts it."""

    def is_found(self, tau: float) -> bool:
        """True where a candidate on the trail has a confidence above ``tau``."""
        return self.confidence > tau

    def lost(self) -> str:
        """Reason why no detection lies on the trail."""
        return self.true["lost"] if self.confidence <= 0.0 else BELOW_TAU


@dataclass(frozen=True, slots=True, kw_only=True)
class Alarm:
    """One candidate that lies on no true trail."""

    kind: Kind
    number: int
    confidence: float
    x_px: float
    y_px: float
    length_px: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Result of a confidence curve on all rows: true trails and false candidates."""

    frames: Counter[Kind]
    trails: tuple[Trail, ...]
    alarms: tuple[Alarm, ...]
    second: int
    """Number of candidates above tau on trails that have another candidate above tau."""


def outcome_of(rows: Sequence[FrameRow], curve: ConfidenceCurve, tau: float) -> Outcome:
    """Assign every candidate to its trail, or to the alarms where it lies on none."""
    trails: list[Trail] = []
    alarms: list[Alarm] = []
    second = 0
    for row in rows:
        best: dict[int, tuple[float, float | None]] = {}
        for each, confidence in zip(row["candidates"], confidences_of(row, curve), strict=True):
            trail, measured = each["trail"], each["measured"]
            if not counts(row, each):
                continue
            if trail is None:
                alarms.append(
                    Alarm(
                        kind=row["kind"],
                        number=row["number"],
                        confidence=confidence,
                        x_px=measured["x_px"],
                        y_px=measured["y_px"],
                        length_px=measured["length_px"],
                    )
                )
                continue
            before = best.get(trail, (0.0, None))
            second += min(before[0], confidence) > tau
            best[trail] = max(before, (confidence, each["error_px"]), key=lambda found: found[0])
        for index, true in enumerate(row["trails"]):
            confidence, error_px = best.get(index, (0.0, None))
            trails.append(
                Trail(
                    kind=row["kind"],
                    number=row["number"],
                    true=true,
                    confidence=confidence,
                    error_px=error_px,
                )
            )
    return Outcome(
        frames=Counter(row["kind"] for row in rows),
        trails=tuple(trails),
        alarms=tuple(alarms),
        second=second,
    )


def figures(rows: Sequence[FrameRow], curve: ConfidenceCurve, card: Any, tau: float) -> Any:
    """All figures of whole frames for the model card, as plain numbers.

    ``card``: the network's card.
    """
    seen = outcome_of(rows, curve, tau)
    whole = [t for t in seen.trails if t.kind == "satellites" and not t.true["is_cut"]]
    cut = [t for t in seen.trails if t.kind == "satellites" and t.true["is_cut"]]
    clouded = [t for t in seen.trails if t.kind == "clouds" and not t.true["is_cut"]]
    one_in = card["measured_confidence"].get("population", {}).get("one_frame_with_satellites_in")
    return {
        "tau": tau,
        "frames": {kind: seen.frames[kind] for kind in KINDS},
        "false_alarms": {
            "ordinary, no satellite": _alarms(seen, tau, ("empty",), 1000),
            "ordinary, beside satellites": _alarms(seen, tau, ("satellites",), 1000),
            "under clouds": _alarms(seen, tau, ("clouds",), 1000),
            **{kind: _alarms(seen, tau, (kind,), 100) for kind in HARD},
            "all hard kinds": _alarms(seen, tau, HARD, 100),
        },
        "second_detections": [seen.second, len(seen.trails)],
        "recall": {
            _name(snr): {
                _name(px): _recall(whole, tau, snr, px) for px in (*LENGTH_BANDS_PX, (15.0, 600.0))
            }
            for snr in SNR_BANDS
        },
        "recall_cut_by_the_edge": {_name(snr): _recall(cut, tau, snr) for snr in SNR_BANDS},
        "recall_under_clouds": {_name(snr): _recall(clouded, tau, snr) for snr in SNR_BANDS},
        "midpoint_error_px": {_name(snr): _errors(whole, tau, snr) for snr in SNR_BANDS},
        "lost": {_name(snr): _losses(whole, tau, snr) for snr in SNR_BANDS},
        "average_precision": {
            "SNR 0.8 and more": average_precision(seen, 0.8),
            "SNR 1.5 and more": average_precision(seen, 1.5),
            "SNR 3 and more": average_precision(seen, 3.0),
        },
        "reliability": _reliability(rows, curve, one_in),
    }


def average_precision(seen: Outcome, least_snr: float) -> float | None:
    """Area under the precision-recall curve of ordinary frames, half of them with satellites.

    Alarms of frames without satellites are weighted as if there were as many such frames as frames
    with satellites. Trails fainter than ``least_snr`` count neither as found nor as missed. None
    without a trail to find.
    """
    trails = [t for t in seen.trails if t.kind == "satellites"]
    asked = [t for t in trails if t.true["peak_snr"] >= least_snr]
    if not asked:
        return None
    empty = seen.frames["satellites"] / max(seen.frames["empty"], 1)
    weight = {"satellites": 1.0, "empty": empty}
    marks = [(t.confidence, 1.0, 0.0) for t in asked if t.confidence > 0.0]
    marks += [(a.confidence, 0.0, weight[a.kind]) for a in seen.alarms if a.kind in weight]
    hits = false = area = 0.0
    for _, hit, alarm in sorted(marks, key=lambda mark: (-mark[0], mark[1])):
        hits, false = hits + hit, false + alarm
        area += hit * hits / max(hits + false, 1e-9)
    return round(area / len(asked), 4)


def _alarms(seen: Outcome, tau: float, kinds: Iterable[Kind], per: int) -> Any:
    kinds = tuple(kinds)
    frames = sum(seen.frames[kind] for kind in kinds)
    if not frames:
        return None
    count = sum(alarm.confidence > tau for alarm in seen.alarms if alarm.kind in kinds)
    low, high = rate_interval(count, frames / per)
    return {
        "count": count,
        "frames": frames,
        "per": per,
        "rate": _short(count * per / frames),
        "interval": [_short(low), _short(high)],
        "upper_limit": _short(rate_upper_limit(count, frames / per)),
    }


def _in_band(
    snr: tuple[float, float], px: tuple[float, float] | None = None
) -> Callable[[Trail], bool]:
    def test(trail: Trail) -> bool:
        true = trail.true
        is_bright = snr[0] <= true["peak_snr"] < snr[1]
        return is_bright and (px is None or px[0] <= true["length_px"] < px[1])

    return test


def _recall(
    trails: Sequence[Trail],
    tau: float,
    snr: tuple[float, float],
    px: tuple[float, float] | None = None,
) -> Any:
    asked = list(filter(_in_band(snr, px), trails))
    found = sum(trail.is_found(tau) for trail in asked)
    low, high = share_interval(found, len(asked))
    return {
        "found": found,
        "of": len(asked),
        "recall": _short(found / len(asked)) if asked else None,
        "interval": [_short(low), _short(high)],
    }


def _errors(trails: Sequence[Trail], tau: float, snr: tuple[float, float]) -> Any:
    found = [t for t in filter(_in_band(snr), trails) if t.is_found(tau)]
    errors = np.array([t.error_px for t in found if t.error_px is not None])
    if not errors.size:
        return None
    return {
        "streaks": int(errors.size),
        "median": _short(float(np.median(errors))),
        "percentile_95": _short(float(np.percentile(errors, 95))),
        "largest": _short(float(errors.max())),
    }


def _losses(trails: Sequence[Trail], tau: float, snr: tuple[float, float]) -> dict[str, int]:
    lost = [t.lost() for t in filter(_in_band(snr), trails) if not t.is_found(tau)]
    return dict(Counter(lost).most_common(MAX_REASONS))


def _reliability(rows: Sequence[FrameRow], curve: ConfidenceCurve, one_in: int | None) -> Any:
    """Reliability in the stated population; None where the card states none."""
    if one_in is None:
        return None
    them = gathered(rows)
    confidence = 1.0 / (1.0 + np.exp(-np.clip(them.features @ np.array(curve.weights), -30, 30)))
    weights = population_weights(them, one_in)
    return {
        "one_frame_with_satellites_in": one_in,
        "bins": reliability(confidence, them.is_true, weights),
    }


def _name(band: tuple[float, float]) -> str:
    return f"{band[0]:g}-{band[1]:g}"


def _short(value: float) -> float:
    return float(f"{value:.4g}")
