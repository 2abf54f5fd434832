"""What the network proposes, and what the line fit makes of each proposal."""

import logging
from dataclasses import dataclass, field, replace

import numpy as np

from rsoconsole.reasons import NotAStreak
from rsoconsole.records import Detection, Frame, Rejection
from rsoconsole.sky.angles import turn_deg
from rsoconsole.vision.background import Background
from rsoconsole.vision.network import NetworkBox
from rsoconsole.vision.stars import FWHM_PER_SIGMA, StarList
from rsoconsole.vision.streak_fit import NoStreak, StreakFit, fit_streak
from rsoconsole.vision.streak_glance import line_signal

log = logging.getLogger(__name__)

BOX_SIGMA_PX = 3.0
"""One sigma of a box's centre against the streak's midpoint, of boxes about streaks of 119 px."""
TOLD_CONFIDENCE = 0.01
"""Whom the network believes less is not on record where no line fits either."""
_SAME_STREAK_DEG = 10.0
_RUNS_ALIKE_DEG = 6.0
"""What a proposal's direction is worth."""


@dataclass(slots=True)
class Measurements:
    """The candidates of one frame: those that a line fits, and why the others were refused."""

    frame: Frame
    sky: Background
    stars: StarList
    taken: list[Detection] = field(default_factory=list)
    """With the network's confidence."""
    rejected: list[Rejection] = field(default_factory=list)

    def is_dark(self, box: NetworkBox) -> bool:
        """Whether a glance along a candidate shows too little light to be worth a fit."""
        psf_sigma = self.stars.median_fwhm_px / FWHM_PER_SIGMA
        signal = line_signal(self.frame.pixels, self.sky, _ends(box), psf_sigma)
        return not signal.is_worth_a_fit(box.confidence)

    def measure(self, box: NetworkBox) -> None:
        """Fit one candidate and put it where it belongs."""
        try:
            fit = fit_streak(
                self.frame.pixels, self.sky, _corners(box), stars=self.stars, ends=_ends(box)
            )
        except Exception:
            # One candidate must not cost the others of the frame, nor the night.
            log.exception("frame %d: the line fit broke on %s", self.frame.frame_id, box)
            self.refuse(box, NotAStreak(kind="fit broke"))
            return
        if isinstance(fit, NoStreak):
            self.refuse(box, fit.reason, fit.fit)
            return
        detection = _from_fit(self.frame, box, fit)
        if any(is_same_streak(detection, other) for other in self.taken):
            reason = NotAStreak(kind="same streak")
            self.rejected.append(Rejection(detection=detection, reason=reason))
        else:
            self.taken.append(detection)

    def refuse(self, box: NetworkBox, reason: NotAStreak, fit: StreakFit | None = None) -> None:
        """Keep a candidate on record with what speaks against it, if the network believes it."""
        if box.confidence < TOLD_CONFIDENCE:
            return
        found = from_box(self.frame, box) if fit is None else _from_fit(self.frame, box, fit)
        self.rejected.append(Rejection(detection=found, reason=reason))


def distinct(frame: Frame, found: list[tuple[NetworkBox, ...]]) -> tuple[NetworkBox, ...]:
    """Candidates of maps of several blocks, each streak once, at its most confident."""
    if len(found) == 1:
        return found[0]
    kept: list[tuple[NetworkBox, Detection]] = []
    for box in sorted((b for boxes in found for b in boxes), key=lambda b: -b.confidence):
        plain = from_box(frame, box)
        if not any(is_same_streak(plain, other) for _, other in kept):
            kept.append((box, plain))
    return tuple(box for box, _ in kept)


def is_same_streak(one: Detection, other: Detection) -> bool:
    """True when the midpoint of either lies on the other's line, and both run alike."""
    turn = turn_deg(one.angle_deg, other.angle_deg)
    shortest = max(min(one.length_px, other.length_px), 1.0)
    if turn > _SAME_STREAK_DEG + float(np.degrees(2.0 / shortest)):
        return False
    return _lies_on(one, other) or _lies_on(other, one)


def runs_alike(one: Detection, others: list[Detection]) -> bool:
    """Whether any of ``others`` may have the direction of a proposal."""
    turns = (turn_deg(one.angle_deg, other.angle_deg) for other in others)
    return any(turn < _RUNS_ALIKE_DEG for turn in turns)


def _lies_on(one: Detection, other: Detection) -> bool:
    angle = np.radians(other.angle_deg)
    dx, dy = one.x_px - other.x_px, one.y_px - other.y_px
    along = abs(dx * np.cos(angle) + dy * np.sin(angle))
    across = abs(dy * np.cos(angle) - dx * np.sin(angle))
    return bool(across < 1.5 * max(other.width_px, 2.0) and along < 0.5 * other.length_px + 1.0)


def _corners(box: NetworkBox) -> tuple[float, float, float, float]:
    return box.x0_px, box.y0_px, box.x1_px, box.y1_px


def _ends(box: NetworkBox) -> tuple[float, float, float, float]:
    return box.x_a_px, box.y_a_px, box.x_b_px, box.y_b_px


def _from_fit(frame: Frame, box: NetworkBox, fit: StreakFit) -> Detection:
    return Detection(
        frame_id=frame.frame_id,
        confidence=box.confidence,
        x_px=fit.x_px,
        y_px=fit.y_px,
        x_a_px=fit.x_a_px,
        y_a_px=fit.y_a_px,
        x_b_px=fit.x_b_px,
        y_b_px=fit.y_b_px,
        box_px=_corners(box),
        length_px=fit.length_px,
        width_px=fit.width_px,
        snr=fit.snr,
        sigma_along_px=fit.sigma_along_px,
        sigma_across_px=fit.sigma_across_px,
        is_clipped=fit.is_clipped,
        kind="crossing" if fit.is_crossing else "clipped" if fit.is_clipped else "streak",
        sigma_angle_deg=fit.sigma_angle_deg,
        method="line",
        unevenness=fit.unevenness,
    )


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
