"""A detection as it goes on record, of a fit, of a trace, or of a proposed box alone."""

import math
from dataclasses import replace

from rsoconsole.records import Detection, Frame
from rsoconsole.vision.detector.candidate import UNMEASURED, LineLight
from rsoconsole.vision.detector.network import NetworkBox
from rsoconsole.vision.streaks import StreakFit, Trace

BOX_SIGMA_PX = 3.0
"""One sigma of a box's centre against the streak's midpoint, of boxes about streaks of 119 px."""


def _corners(box: NetworkBox) -> tuple[float, float, float, float]:
    return box.x0_px, box.y0_px, box.x1_px, box.y1_px


def with_fit(detection: Detection, fit: StreakFit) -> Detection:
    """The same candidate, measured by a fit."""
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


def from_fit(frame: Frame, box: NetworkBox, fit: StreakFit) -> Detection:
    return with_fit(replace(from_box(frame, box), method="line"), fit)


def light_of(trace: Trace | None) -> LineLight:
    if trace is None:
        return UNMEASURED
    return LineLight(
        lower_quartile_snr=trace.lower_quartile_snr,
        roughness=trace.roughness,
        confusion=trace.confusion,
        over_points=trace.over_points,
    )


def with_trace(detection: Detection, trace: Trace, least_open_px: float = 0.0) -> Detection:
    """The same candidate, measured by a trace.

    ``least_open_px``: sigma along one that leaves the frame, where it is not longer than that.
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


def from_trace(frame: Frame, box: NetworkBox, trace: Trace) -> Detection:
    return with_trace(replace(from_box(frame, box), method="line"), trace, 100.0)


def at_box_centre(detection: Detection) -> Detection:
    """The paper's measurement of a detection: its box's centre stands for the streak's midpoint.

    Whether it is a streak, and where it ends, is still what the line fit made of it.
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


def from_box(frame: Frame, box: NetworkBox) -> Detection:
    """A proposal as it is, not measured: to compare, and for the record of what was refused."""
    x0, y0, x1, y1 = _corners(box)
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
        x_a_px=box.x_a_px,
        y_a_px=box.y_a_px,
        x_b_px=box.x_b_px,
        y_b_px=box.y_b_px,
        box_px=(x0, y0, x1, y1),
        length_px=box.length_px,
        width_px=0.0,
        snr=0.0,
        sigma_along_px=BOX_SIGMA_PX,
        sigma_across_px=BOX_SIGMA_PX,
        is_clipped=is_clipped,
        method="box",
    )
