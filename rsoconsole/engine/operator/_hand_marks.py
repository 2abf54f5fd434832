"""Streaks that the operator marks by hand: the decision from a mark, and its result."""

import math
from dataclasses import replace

from rsoconsole.config import Config
from rsoconsole.control import MarkByHand
from rsoconsole.pipeline import FrameObservations, measure
from rsoconsole.records import (
    CommandResult,
    Detection,
    Measurement,
    NotFollowed,
    Record,
    RuledKind,
    Ruling,
    Solution,
    TrackState,
    mark_id_of,
)
from rsoconsole.sky import largest_sigma, separation_deg

MARK_SIGMA_PX = 2.0
SHORTEST_MARK_PX = 3.0
WIDEST_MARK_PX = 10_000.0
BETTER = 1.5
"""Ratio of a mark's sigma to a measurement's above which the operator must confirm the mark."""
SAME_STREAK_ARCSEC = 30.0
"""Distance beyond which an automatic measurement is of something else, if the mark is precise."""


def decision_from_mark(
    shown: FrameObservations, mark: MarkByHand, by: str, config: Config
) -> Ruling:
    """Return the decision to follow a streak, from the two ends that the operator marked.

    Raises ValueError for a frame without plate solution or time, and for impossible ends.
    """
    x_a, y_a, x_b, y_b = mark.x_a_px, mark.y_a_px, mark.x_b_px, mark.y_b_px
    taken = shown.taken
    if not isinstance(shown.solution, Solution):
        raise ValueError(_not_solved(taken.frame_id))
    # What was refined where the frame cuts it ends at its rim.
    rim = 0.5 if mark.sigma_across_px is not None else 0.0
    if not all(-rim <= x <= taken.width_px - 1 + rim for x in (x_a, x_b)) or not all(
        -rim <= y <= taken.height_px - 1 + rim for y in (y_a, y_b)
    ):
        raise ValueError(f"the ends must lie in the frame, {taken.width_px} x {taken.height_px} px")
    detection = detection_of(mark, taken.frame_id)
    if detection.length_px < SHORTEST_MARK_PX:
        raise ValueError("the two ends are the same place: mark one end, then the other")
    for sigma_px in (detection.sigma_along_px, detection.sigma_across_px):
        if not 0.0 < sigma_px <= WIDEST_MARK_PX:
            raise ValueError(f"sigma_px must be above 0, and {WIDEST_MARK_PX:g} at most")
    made = measure_accepted(detection, mark_id_of(taken.frame_id, shown.decisions), shown, config)
    return Ruling(frame_id=taken.frame_id, taken=made, by=by)


def detection_of(mark: MarkByHand, frame_id: int) -> Detection:
    """Return a mark as a detection, with the mark's precision."""
    x_a, y_a, x_b, y_b = mark.x_a_px, mark.y_a_px, mark.x_b_px, mark.y_b_px
    sigma_px = MARK_SIGMA_PX if mark.sigma_px is None else mark.sigma_px
    across_px = sigma_px if mark.sigma_across_px is None else mark.sigma_across_px
    return Detection(
        frame_id=frame_id,
        confidence=1.0,
        x_px=(x_a + x_b) / 2.0,
        y_px=(y_a + y_b) / 2.0,
        x_a_px=x_a,
        y_a_px=y_a,
        x_b_px=x_b,
        y_b_px=y_b,
        box_px=(min(x_a, x_b), min(y_a, y_b), max(x_a, x_b), max(y_a, y_b)),
        length_px=math.hypot(x_b - x_a, y_b - y_a),
        width_px=0.0,
        snr=0.0,
        sigma_along_px=sigma_px,
        sigma_across_px=across_px,
        is_clipped=bool(mark.is_clipped),
        method="operator",
    )


def mark_from_detection(mark: MarkByHand, found: Detection) -> MarkByHand:
    """Return a mark with the ends and precision of the streak that was found beneath it."""
    return replace(
        mark,
        x_a_px=found.x_a_px,
        y_a_px=found.y_a_px,
        x_b_px=found.x_b_px,
        y_b_px=found.y_b_px,
        sigma_px=found.sigma_along_px,
        sigma_across_px=found.sigma_across_px,
        is_clipped=found.is_clipped or None,
    )


def largest_sigma_arcsec(measurement: Measurement) -> float:
    """Return one sigma of a direction, arcsec, on the axis where it is largest."""
    return largest_sigma(*measurement.cov_sky_arcsec2)


def better_measurement(
    mark: Measurement, shown: FrameObservations, taken: Measurement | None
) -> Measurement | None:
    """Return a much more precise measurement that a mark would replace; None: there is none.

    ``taken``: the track's accepted measurement of the frame.
    """
    sigma = largest_sigma_arcsec(mark)
    near = [m for m in shown.measurements if _away_arcsec(m, mark) <= 3.0 * sigma]
    known = [m for m in (taken, *near) if m is not None and m != mark and not m.is_clipped]
    best = min(known, key=largest_sigma_arcsec, default=None)
    return best if best is not None and BETTER * largest_sigma_arcsec(best) < sigma else None


def _away_arcsec(one: Measurement, other: Measurement) -> float:
    away_deg = separation_deg(
        one.ra_icrs_deg, one.dec_icrs_deg, other.ra_icrs_deg, other.dec_icrs_deg
    )
    return away_deg * 3600.0


def measure_accepted(
    detection: Detection, measurement_id: str, shown: FrameObservations, config: Config
) -> Measurement:
    """Measure a detection that the operator accepts.

    Raises ValueError where the frame was not solved, or has no time.
    """
    if not isinstance(shown.solution, Solution):
        raise ValueError(_not_solved(shown.taken.frame_id))
    made = measure(
        detection,
        shown.solution,
        shown.taken,
        config.exposure,
        measurement_id=measurement_id,
        source="operator",
    )
    if made is None:
        raise ValueError(f"frame {shown.taken.frame_id} has no time: nothing can be measured on it")
    return made


def _not_solved(frame_id: int) -> str:
    return f"frame {frame_id} was not solved: without stars a streak has no place on the sky"


def detected_measurement(
    mark: Measurement, shown: FrameObservations, taken: Measurement | None
) -> Measurement | None:
    """Return the detector's measurement of the streak that was marked; None where it has none.

    ``taken``: the track's accepted measurement of the frame.
    """
    known = [m for m in (taken, *shown.measurements) if m is not None and m.source != "operator"]
    within = max(SAME_STREAK_ARCSEC, 3.0 * largest_sigma_arcsec(mark))
    near = [m for m in known if _away_arcsec(m, mark) <= within]
    return min(near, key=lambda m: _away_arcsec(m, mark), default=None)


def with_mark_figures(
    result: CommandResult, mark: Measurement, automatic: Measurement | None
) -> CommandResult:
    """Add a mark's precision, and its distance from the detector's measurement, to a result.

    ``automatic``: the detector's measurement; None where it has none.
    """
    east, _, north = mark.cov_sky_arcsec2
    return replace(
        result,
        sigma_arcsec=(math.sqrt(east), math.sqrt(north)),
        off_arcsec=None if automatic is None else _away_arcsec(automatic, mark),
    )


def unfollowed_frame_result(decision: Ruling, records: tuple[Record, ...]) -> CommandResult:
    """Return the result of a decision on a frame that was taken without autonomy."""
    states = [r for r in records if isinstance(r, TrackState) and r.frame_id == decision.frame_id]
    result = decision_result(decision, ())
    kinds = {each.kind for each in states}
    if decision.taken is None or ("updated" in kinds and "initial" not in kinds):
        return result
    return replace(result, ruled="second of a track" if "initial" in kinds else "first of a track")


def decision_result(decision: Ruling, records: tuple[Record, ...]) -> CommandResult:
    """Return the result of a decision, with the number of frames that the track did not use."""
    taken, left_alone = decision.taken, 0
    ruled: RuledKind = "rejected" if decision.refused else "taken back"
    if taken is not None:
        ruled = "taken by hand" if taken.source == "operator" else "taken"
        left_alone = sum(isinstance(record, NotFollowed) for record in records)
    return CommandResult(
        kind="ruled", ruled=ruled, frame_id=decision.frame_id, left_alone=left_alone
    )
