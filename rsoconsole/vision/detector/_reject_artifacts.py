"""Lines of light that are no streaks of the sky: trailed stars, rows and columns of the sensor."""

import math

import numpy as np

from rsoconsole.records import Detection, Frame, NotAStreak, Rejection
from rsoconsole.sky import line_angle_deg
from rsoconsole.vision.detector._candidates import Proposal
from rsoconsole.vision.detector.measured_detection import Candidate
from rsoconsole.vision.stars.star_list import StarTrail
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA

TRAILED_STREAKS = 9
"""Number of like streaks (length, direction) that are stars, where stars are not points."""
_POINTS_TO_STREAKS = 3.0
"""Ratio of points to streaks that are alike, above which the stars are no streaks."""
_LENGTH_KNOWN = 0.2
"""Largest error of a length, in lengths; a line cut by the frame has no length to compare."""
_FEW_TRAILS, _MANY_TRAILS, _SURE, _STEADY = 2.0, 8.0, 0.9, 0.2
"""Trails of stars in a row that look like one streak (the first for a sure or steady one, the
second for others), and the confidence and roughness that make it sure or steady."""
_NO_TRAILS = 4.0
"""Verifier's log-odds from which a light is not a few trails of stars in a row."""
_AS_TRAILS_DEG = 6.0
_LONG_ROW, _ALONG_ROW_DEG = 0.5, 0.15
"""Share of the frame, and degrees off its rows or columns."""
_ROW_PX, _LEFT_OF_ROWS = 2.5, 0.5
"""Largest turn of a line off its row, px, and ridge SNR up to which row offsets look alike."""
_BLOOMING_DEG, _SATURATED = 3.0, 0.9
_ONE_TRAIL = 1.5
_SAME_LENGTH, _SAME_ANGLE_DEG = 0.10, 3.0


def reject_artifacts(
    judged: list[Candidate],
    trail: StarTrail | None,
    frame: Frame,
    *,
    points: int = 0,
    is_striped: bool = False,
) -> tuple[list[Detection], list[Rejection]]:
    """Split a frame's measured lines into streaks of the sky and rejections of artifacts.

    - trail: trail of the stars; None: they are points
    - points: number of stars in the frame
    - is_striped: True where offsets of rows or columns were subtracted from the frame
    """
    rejected: list[Rejection] = []
    if trail is not None:
        judged, rejected = reject_star_trails(judged, trail)
    taken, more = _reject_rows([each.found for each in judged], frame, is_striped=is_striped)
    rejected += more
    taken, more = _reject_trailed_stars(taken, points if trail is None else 0)
    return taken, rejected + more


def is_star_trail(proposal: Proposal, trail: StarTrail) -> bool:
    """Return True where a proposal is parallel to the stars' trails and about as short as one.

    The limit is ``_ONE_TRAIL`` times a trail with its blur at both ends.
    """
    box, one_px = proposal.box, trail.length_px + 2.0 * trail.fwhm_px
    leeway_deg = _AS_TRAILS_DEG + math.degrees(trail.fwhm_px / max(box.length_px, 1.0))
    is_along = line_angle_deg(box.angle_deg, trail.angle_deg) < leeway_deg
    return is_along and box.length_px < _ONE_TRAIL * one_px


def _reject_trailed_stars(
    taken: list[Detection], points: int
) -> tuple[list[Detection], list[Rejection]]:
    """Reject streaks that share length and direction with enough others to be stars.

    Not where stars are points: a dozen satellites of one slot draw one length in one direction.
    """
    if len(taken) < TRAILED_STREAKS:
        return taken, []
    kept: list[Detection] = []
    trailed: list[Rejection] = []
    for d in taken:
        alike = sum(_is_alike(d, other) for other in taken)
        if alike < TRAILED_STREAKS or points > _POINTS_TO_STREAKS * alike:
            kept.append(d)
        else:
            reason = NotAStreak(kind="trailed stars", value=alike)
            trailed.append(Rejection(detection=d, reason=reason))
    return kept, trailed


def _reject_rows(
    taken: list[Detection], frame: Frame, *, is_striped: bool
) -> tuple[list[Detection], list[Rejection]]:
    """Reject lines along a row or column for half of the frame or at its rim, and saturated ones.

    Where offsets of rows or columns were subtracted, also lines no brighter than their errors.
    """
    kept: list[Detection] = []
    ruled: list[Rejection] = []
    for d in taken:
        off_deg = min(line_angle_deg(d.angle_deg, 0.0), line_angle_deg(d.angle_deg, 90.0))
        is_row = line_angle_deg(d.angle_deg, 0.0) < line_angle_deg(d.angle_deg, 90.0)
        side_px = frame.width_px if is_row else frame.height_px
        is_long = d.length_px > _LONG_ROW * side_px and off_deg < _ALONG_ROW_DEG
        along_deg = max(_ALONG_ROW_DEG, math.degrees(_ROW_PX / max(d.length_px, 1.0)))
        is_left = is_striped and off_deg < along_deg and _ridge_snr(d) < _LEFT_OF_ROWS
        across_px, most_px = (
            (d.y_px, frame.height_px - 1) if is_row else (d.x_px, frame.width_px - 1)
        )
        is_rim = off_deg < along_deg and min(across_px, most_px - across_px) < _ROW_PX
        if is_long or is_left or is_rim or (off_deg < _BLOOMING_DEG and _is_saturated(frame, d)):
            ruled.append(Rejection(detection=d, reason=NotAStreak(kind="row or column")))
        else:
            kept.append(d)
    return kept, ruled


def _ridge_snr(found: Detection) -> float:
    """Peak of its cross-section over the noise of a pixel, of a line matched by a Gaussian."""
    sigma = max(found.width_px, 1.0) / FWHM_PER_SIGMA
    area = math.sqrt(math.pi) * sigma * max(found.length_px, 1.0)
    return found.snr / math.sqrt(area)


def _is_saturated(frame: Frame, found: Detection) -> bool:
    """True where most of a line is saturated: charge that ran over along a column."""
    count = max(int(found.length_px), 2)
    x = np.rint(np.linspace(found.x_a_px, found.x_b_px, count)).astype(int)
    y = np.rint(np.linspace(found.y_a_px, found.y_b_px, count)).astype(int)
    column, row = np.clip(x, 0, frame.width_px - 1), np.clip(y, 0, frame.height_px - 1)
    return float(np.median(frame.pixels[row, column])) > _SATURATED * frame.saturation_adu


def reject_star_trails(
    judged: list[Candidate], trail: StarTrail
) -> tuple[list[Candidate], list[Rejection]]:
    """Split off lines in the direction of the stars' trail that are only a few trails long.

    The limit is two trails for a line of high confidence or steady light, eight for others: a
    satellite may move in the same direction, and trails end to end are seldom equally bright.
    """
    one_px = trail.length_px + trail.fwhm_px
    kept: list[Candidate] = []
    chains: list[Rejection] = []
    for each in judged:
        found, light = each.found, each.light
        is_sure = found.confidence > _SURE or light.roughness < _STEADY
        longest_px = (_FEW_TRAILS if is_sure else _MANY_TRAILS) * one_px
        if (
            line_angle_deg(found.angle_deg, trail.angle_deg) > _AS_TRAILS_DEG
            or found.length_px > longest_px
            or light.log_odds > _NO_TRAILS
        ):
            kept.append(each)
        else:
            reason = NotAStreak(kind="stars' trails", value=found.length_px, limit=trail.length_px)
            chains.append(Rejection(detection=found, reason=reason))
    return kept, chains


def _is_alike(one: Detection, other: Detection) -> bool:
    turn = line_angle_deg(one.angle_deg, other.angle_deg)
    longer = max(one.length_px, other.length_px)
    if any(each.sigma_along_px > _LENGTH_KNOWN * each.length_px for each in (one, other)):
        return one is other
    leeway_px = _SAME_LENGTH * longer + 2.0 * math.hypot(one.sigma_along_px, other.sigma_along_px)
    return turn < _SAME_ANGLE_DEG and abs(one.length_px - other.length_px) < leeway_px
