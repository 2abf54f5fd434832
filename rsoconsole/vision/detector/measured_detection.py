"""Detections as recorded: from a fit, a trace, or a proposed box alone."""

import math
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.records import Detection, FloatArray, Frame
from rsoconsole.sky import line_angle_deg
from rsoconsole.vision.arrays import BoolArray
from rsoconsole.vision.detector.network import NetworkBox
from rsoconsole.vision.streaks.streak_fit import StreakFit
from rsoconsole.vision.streaks.traced_line import LineTrace

SHARP_PX = 3.2
"""Width of a star that neither wind nor the mount has widened, px: a streak may be as narrow."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LineLight:
    """Evenness of a candidate's light along its line, and what the verifier says of its image."""

    roughness: float
    """Scatter of the parts over their mean that no slow change and no single period explains."""
    confusion: float = 1.0
    """Scatter of the sky beside the line over the noise of its pixels."""
    log_odds: float = 0.0
    """The verifier's log-odds that the line is a streak."""


UNMEASURED = LineLight(roughness=1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """One measured line of light that may be a streak."""

    found: Detection
    """Detection with the network's confidence, or after ``with_curve_confidences`` the curve's."""
    light: LineLight

    def with_confidence(self, confidence: float) -> "Candidate":
        """Return the candidate with another confidence."""
        return replace(self, found=replace(self.found, confidence=confidence))


BOX_SIGMA_PX = 3.0
"""One sigma between a box's centre and the streak's midpoint, px, for streaks of 119 px."""


def with_fit(detection: Detection, fit: StreakFit) -> Detection:
    """Return the detection with the place, ends, width and errors of a fit."""
    return replace(
        detection,
        x_px=fit.x_px,
        y_px=fit.y_px,
        x_a_px=fit.x_a_px,
        y_a_px=fit.y_a_px,
        x_b_px=fit.x_b_px,
        y_b_px=fit.y_b_px,
        length_px=fit.length_px,
        width_px=fit.width_px,
        snr=fit.snr,
        sigma_along_px=fit.sigma_along_px,
        sigma_across_px=fit.sigma_across_px,
        is_clipped=fit.is_clipped,
        kind="crossing" if fit.is_crossing else "clipped" if fit.is_clipped else "streak",
        sigma_angle_deg=fit.sigma_angle_deg,
    )


def detection_from_fit(frame: Frame, box: NetworkBox, fit: StreakFit) -> Detection:
    """Return a detection with the proposal's box and confidence and the measurement of a fit."""
    return with_fit(replace(detection_from_box(frame, box), method="line"), fit)


def line_light_of(trace: LineTrace | None) -> LineLight:
    """Return the evenness of a traced line's light; ``UNMEASURED`` where ``trace`` is None."""
    if trace is None:
        return UNMEASURED
    return LineLight(
        roughness=trace.roughness,
        confusion=trace.confusion,
    )


def with_trace(detection: Detection, trace: LineTrace, least_open_px: float = 0.0) -> Detection:
    """Return the detection with the place, ends, width and errors of a trace.

    ``least_open_px``: least sigma along a line that leaves the frame, px.
    """
    length_px = math.hypot(trace.x_b_px - trace.x_a_px, trace.y_b_px - trace.y_a_px)
    is_clipped = any(trace.is_open)
    along = 0.5 * math.hypot(*trace.sigma_end_px)
    return replace(
        detection,
        x_px=0.5 * (trace.x_a_px + trace.x_b_px),
        y_px=0.5 * (trace.y_a_px + trace.y_b_px),
        x_a_px=trace.x_a_px,
        y_a_px=trace.y_a_px,
        x_b_px=trace.x_b_px,
        y_b_px=trace.y_b_px,
        length_px=length_px,
        width_px=trace.width_px,
        snr=trace.snr,
        sigma_along_px=max(length_px, least_open_px) if is_clipped else along,
        sigma_across_px=trace.sigma_across_px,
        is_clipped=is_clipped,
        kind="crossing" if all(trace.is_open) else "clipped" if is_clipped else "streak",
        sigma_angle_deg=trace.sigma_angle_deg,
    )


def detection_from_trace(frame: Frame, box: NetworkBox, trace: LineTrace) -> Detection:
    """Return a detection with the proposal's box and confidence and the measurement of a trace."""
    return with_trace(replace(detection_from_box(frame, box), method="line"), trace, 100.0)


def with_midpoint_at_box_centre(detection: Detection) -> Detection:
    """Return the detection with the centre of its box as midpoint, as in Jordan et al.

    The line fit still decides whether it is a streak, and where its ends are.
    """
    x0, y0, x1, y1 = detection.box_px
    return replace(
        detection,
        x_px=0.5 * (x0 + x1),
        y_px=0.5 * (y0 + y1),
        sigma_along_px=BOX_SIGMA_PX,
        sigma_across_px=BOX_SIGMA_PX,
        method="box",
    )


def detection_from_box(frame: Frame, box: NetworkBox) -> Detection:
    """Return a proposal as an unmeasured detection, to compare it or to record its rejection."""
    x0, y0, x1, y1 = box.corners_px
    x_a, y_a, x_b, y_b = box.ends_px
    rim_px = 1.0
    is_clipped = (
        x0 < rim_px
        or y0 < rim_px
        or x1 > frame.width_px - 1 - rim_px
        or y1 > frame.height_px - 1 - rim_px
    )
    return Detection(
        frame_id=frame.frame_id,
        confidence=box.confidence,
        x_px=0.5 * (x0 + x1),
        y_px=0.5 * (y0 + y1),
        x_a_px=x_a,
        y_a_px=y_a,
        x_b_px=x_b,
        y_b_px=y_b,
        box_px=box.corners_px,
        length_px=box.length_px,
        width_px=0.0,
        snr=0.0,
        sigma_along_px=BOX_SIGMA_PX,
        sigma_across_px=BOX_SIGMA_PX,
        is_clipped=is_clipped,
        method="box",
    )


SAME_STREAK_DEG, _SAME_WIDTHS, _MIN_WIDTH_PX = 10.0, 1.5, 2.0
"""Limits within which two boxes are one streak: turn, deg; shift in widths; least width, px."""


def distinct_boxes(found: list[tuple[NetworkBox, ...]]) -> tuple[NetworkBox, ...]:
    """Merge the candidates of several maps, with only the most confident one of each streak."""
    if len(found) == 1:
        return found[0]
    boxes = sorted((b for each in found for b in each), key=lambda b: -b.confidence)
    if not boxes:
        return ()
    same = _are_same(np.array([box.ends_px for box in boxes]))
    is_kept = np.zeros(len(boxes), dtype=bool)
    for i in range(len(boxes)):
        is_kept[i] = not (same[i] & is_kept).any()
    return tuple(box for box, is_one in zip(boxes, is_kept.tolist(), strict=True) if is_one)


def _are_same(ends: FloatArray) -> BoolArray:
    """True where ``is_same_streak`` holds for a box and another, (n, n); ``ends`` (n, 4)."""
    along = ends[:, 2:] - ends[:, :2]
    middle, lengths = 0.5 * (ends[:, 2:] + ends[:, :2]), np.hypot(along[:, 0], along[:, 1])
    cos, sin = (along / np.maximum(lengths, 1e-6)[:, None]).T
    cross = np.abs(cos[:, None] * sin[None] - sin[:, None] * cos[None])
    turn = np.degrees(np.arcsin(np.minimum(cross, 1.0)))
    shortest = np.maximum(np.minimum(lengths[:, None], lengths[None]), 1.0)
    off = middle[:, None] - middle[None]
    # Of row i on the line of column j.
    place = np.abs(off[..., 0] * cos + off[..., 1] * sin)
    across = np.abs(off[..., 1] * cos - off[..., 0] * sin)
    lies = (across < _SAME_WIDTHS * _MIN_WIDTH_PX) & (place < 0.5 * lengths + 1.0)
    return np.asarray((turn <= SAME_STREAK_DEG + np.degrees(2.0 / shortest)) & (lies | lies.T))


def is_same_streak(one: Detection, other: Detection) -> bool:
    """Return True where two are parallel and the midpoint of one lies on the other's line."""
    turn = line_angle_deg(one.angle_deg, other.angle_deg)
    shortest = max(min(one.length_px, other.length_px), 1.0)
    if turn > SAME_STREAK_DEG + float(np.degrees(2.0 / shortest)):
        return False
    return _lies_on(one, other) or _lies_on(other, one)


def _lies_on(one: Detection, other: Detection) -> bool:
    angle = np.radians(other.angle_deg)
    dx, dy = one.x_px - other.x_px, one.y_px - other.y_px
    along = abs(dx * np.cos(angle) + dy * np.sin(angle))
    across = abs(dy * np.cos(angle) - dx * np.sin(angle))
    reach_px = _SAME_WIDTHS * max(other.width_px, _MIN_WIDTH_PX)
    return bool(across < reach_px and along < 0.5 * other.length_px + 1.0)
