"""Candidates of network, line filter and star search, and their measurement on the pixels."""

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rsoconsole.records import Detection, FloatArray, Frame, NotAStreak, Rejection
from rsoconsole.vision.arrays import BoolArray
from rsoconsole.vision.detector.measured_detection import (
    SAME_STREAK_DEG,
    SHARP_PX,
    Candidate,
    LineLight,
    detection_from_box,
    detection_from_fit,
    detection_from_trace,
    is_same_streak,
    line_light_of,
)
from rsoconsole.vision.detector.network import LOWEST_CONFIDENCE, NetworkBox
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.lines.line_filter import CellLine
from rsoconsole.vision.lines.line_strip import OFF_PX
from rsoconsole.vision.lines.segments import Ends, box_about, length_of, midpoint_of
from rsoconsole.vision.lines.streak_search import cut_out
from rsoconsole.vision.stars.point_image import PointImage
from rsoconsole.vision.stars.star_list import StarList
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA
from rsoconsole.vision.streaks.streak_evenness import lumpiness_and_bend
from rsoconsole.vision.streaks.streak_fit import AS_CHAINS_FWHM, MARGIN_PX, StreakFit, fit_streak
from rsoconsole.vision.streaks.streak_trace import trace_line
from rsoconsole.vision.streaks.traced_line import LineTrace

log = logging.getLogger(__name__)

MIN_RECORDED_CONFIDENCE = 0.01
"""Confidence of the network below which a refused proposal is not recorded."""


LONGEST_FIT_PX = 450.0
"""Longer lines are measured along themselves alone (``streak_trace``): a fit would take seconds."""
_MIN_TRACE_SNR = 5.0
_NARROWEST, _SHORTEST = 0.6, 2.2
"""Least width over the stars' (over ``SHARP_PX`` at most), and length in star widths."""
_PIECE = 0.8
"""Least length of a measured line, over a light's own, for the light to be a piece of it."""
_UNDERSAMPLED_PX = 1.6
"""Width of stars up to which nothing can be narrower than they are, px."""
_LEEWAY_PX = 10.0
"""Largest distance of a box from the line of the filter, px."""
_BELIEVED = 0.01
"""Network's confidence from which a proposal is fitted though its light is not seen all along."""
_PERIODIC = 0.12
"""Roughness up to which a slow change or one period explains how the light varies."""
_FINER_WHERE_JOINED = 0.5
"""Factor on the largest distance of a proposal from its line where pixels are joined."""
_LIGHT_OFF_PX, _LIGHT_OFF_FWHM = 2.0, 0.6
"""Largest distance of a light of the star search from its line: px, or star widths if more."""
_DRAWN_OUT, _MORE = 1.3, 1.1
_SURE, _MUCH_LONGER, _MUCH_BETTER = 0.2, 1.6, 1.3
_AGREE_SNR, _AGREE_LENGTH = 0.75, 0.15


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """Line along which a streak may lie, from the network, the line filter or the star search."""

    box: NetworkBox
    """Box of the proposal with the network's confidence; the lowest where it proposed none."""
    is_line: bool
    """True where the line filter or the star search proposed it."""
    is_light: bool = False
    """True for a single light of the star search, which may be a piece of a longer line."""


def merged_proposals(boxes: Sequence[NetworkBox], lines: Sequence[CellLine]) -> list[Proposal]:
    """Merge the proposals of network and line filter, so that each streak appears once.

    A streak that both propose has the network's confidence and the filter's ends; it has the
    network's ends where the network is confident and its line is not much shorter.
    """
    is_left = np.ones(len(boxes), dtype=bool)
    said = np.array([box.confidence for box in boxes])
    ends = np.array([box.ends_px for box in boxes]).reshape(-1, 4)
    lengths = np.hypot(ends[:, 2] - ends[:, 0], ends[:, 3] - ends[:, 1])
    lines_px = [(line.x_a, line.y_a, line.x_b, line.y_b) for line in lines]
    alike = _are_of_one_streak(np.array(lines_px).reshape(-1, 4), ends)
    found = []
    for line, ends_px, of_line in zip(lines, lines_px, alike, strict=True):
        box = NetworkBox(
            confidence=LOWEST_CONFIDENCE, corners_px=box_about(ends_px), ends_px=ends_px
        )
        same, is_light = of_line & is_left, line.is_light
        if is_light:
            # A light may be a piece of what the network sees whole.
            same &= lengths < _MUCH_LONGER * box.length_px
        if same.any():
            best = boxes[int(np.argmax(np.where(same, said, -1.0)))]
            longer = box.length_px / np.maximum(lengths, 1.0)
            is_its_own = best.confidence > _SURE and best.length_px * _MUCH_LONGER > box.length_px
            if is_its_own:
                # It knows the ends of what it knows better than a sum along cells.
                box, is_light = best, False
            else:
                box = replace(best, ends_px=box.ends_px)
            # What the network is sure of may be one of several in a row.
            is_left &= ~same | ((said > _SURE) & (longer > _MUCH_LONGER))
        found.append(Proposal(box=box, is_line=True, is_light=is_light))
    left = (box for box, is_one in zip(boxes, is_left.tolist(), strict=True) if is_one)
    return found + [Proposal(box=box, is_line=False) for box in left]


def ranked_proposals(found: Sequence[Proposal]) -> list[Proposal]:
    """Sort proposals: the network's best and the line filter's best first, in turn."""
    by_network = sorted(range(len(found)), key=lambda i: -found[i].box.confidence)
    by_filter = [i for i in range(len(found)) if found[i].is_line]
    place = {i: rank for rank, i in enumerate(by_network)}
    for rank, i in enumerate(by_filter):
        place[i] = min(place[i], rank)
    return [found[i] for i in sorted(range(len(found)), key=lambda i: place[i])]


def _are_of_one_streak(lines: FloatArray, boxes: FloatArray) -> BoolArray:
    """True where a box lies near a line and runs in its direction: (lines, boxes).

    Both have rows from end to end: x_a, y_a, x_b, y_b.
    """
    x_a, y_a, x_b, y_b = lines.T[:, :, None]
    box_x_a, box_y_a, box_x_b, box_y_b = boxes.T[:, None]
    dx, dy, box_dx, box_dy = x_b - x_a, y_b - y_a, box_x_b - box_x_a, box_y_b - box_y_a
    length = np.maximum(np.hypot(dx, dy), 1.0)
    box_length = np.maximum(np.hypot(box_dx, box_dy), 1.0)
    turn = np.abs(box_dx * dy - box_dy * dx) / (box_length * length)
    shorter = np.minimum(box_length, length)
    leeway = np.sin(np.minimum(np.radians(SAME_STREAK_DEG) + _LEEWAY_PX / shorter, 1.5))
    off_x = 0.5 * (box_x_a + box_x_b) - 0.5 * (x_a + x_b)
    off_y = 0.5 * (box_y_a + box_y_b) - 0.5 * (y_a + y_b)
    of_line = np.abs(off_y * dx - off_x * dy) / length
    of_box = np.abs(off_y * box_dx - off_x * box_dy) / box_length
    reach = 0.5 * np.maximum(box_length, length) + _LEEWAY_PX
    is_near = (np.minimum(of_line, of_box) < _LEEWAY_PX) & (np.hypot(off_x, off_y) < reach)
    return np.asarray((turn < leeway) & is_near)


@dataclass(slots=True)
class FrameCandidates:
    """Candidates of a frame: measured lines of light, and rejections with their reasons."""

    frame: Frame
    sky: Background
    stars: StarList
    focus: PointImage
    is_worth_fitting: Callable[[Candidate], bool] = lambda _: True
    """Return True for a traced candidate that is worth the time of a fit."""
    taken: list[Candidate] = field(default_factory=list)
    """Candidates that are lines of light, with the network's confidence."""
    rejected: list[Rejection] = field(default_factory=list)

    def has(self, proposal: Proposal) -> bool:
        """Return True where a proposal is a single light, a piece of a line already measured."""
        if not proposal.is_light or not self.taken:
            return False
        piece = detection_from_box(self.frame, proposal.box)
        return any(
            each.found.length_px > _PIECE * piece.length_px and is_same_streak(piece, each.found)
            for each in self.taken
        )

    def measure(self, proposal: Proposal, log_odds: float = 0.0) -> None:
        """Measure a proposal and add it to ``taken`` or to ``rejected``.

        ``log_odds``: what the verifier says of it.
        """
        try:
            self._measure(proposal, log_odds)
        except Exception:
            # One candidate must not cost the others of the frame, nor the night.
            log.exception("frame %d: the line fit broke on %s", self.frame.frame_id, proposal)
            self.record_rejection(proposal.box, NotAStreak(kind="fit broke"))

    def _measure(self, proposal: Proposal, log_odds: float) -> None:
        box = proposal.box
        trace, reason = self._traced_well(proposal)
        if trace is None and box.confidence < _BELIEVED:
            self.record_rejection(box, reason or NotAStreak(kind="no line"))
            return
        measured: StreakFit | None = None
        traced = None if trace is None else self._from_trace(box, trace, log_odds)
        is_promising = traced is None or self.is_worth_fitting(traced)
        if box.length_px <= LONGEST_FIT_PX and is_promising:
            fit = fit_streak(
                self.frame.pixels,
                self.sky,
                box_about(box.corners_px, box.ends_px),
                stars=self.stars,
                psf_fwhm_px=None if trace is None else self._width_px(trace),
                ends=box.ends_px,
            )
            if isinstance(fit, StreakFit) and (trace is None or _agree(fit, trace)):
                light = traced.light if traced else line_light_of(self._traced(_ends_of(fit)))
                found = detection_from_fit(self.frame, box, fit)
                unevenness = max(fit.bend, fit.lumpiness)
                self._take(self._candidate(found, replace(light, log_odds=log_odds), unevenness))
                return
            if not isinstance(fit, StreakFit):
                reason, measured = reason or fit.reason, fit.fit
        if traced is None:
            self.record_rejection(box, reason or NotAStreak(kind="no line"), measured)
        else:
            self._take(traced)

    def _from_trace(self, box: NetworkBox, trace: LineTrace, log_odds: float) -> Candidate:
        found = detection_from_trace(self.frame, box, trace)
        light = replace(line_light_of(trace), log_odds=log_odds)
        return self._candidate(found, light, self._unevenness(found, trace))

    def _candidate(self, found: Detection, light: LineLight, unevenness: float) -> Candidate:
        """Candidate with the irregularity of path and light, where it shows a cosmic ray.

        No ray is as wide as stars many pixels wide, and wind bends whatever is in the frame.
        """
        if self.focus.joined > 1 or found.width_px > SHARP_PX:
            unevenness = 0.0
        return Candidate(found=replace(found, unevenness=unevenness), light=light)

    def _unevenness(self, found: Detection, trace: LineTrace) -> float:
        """Irregularity of a short line: of its path, and of its light if without one period."""
        ends = _ends_of(found)
        if found.length_px > AS_CHAINS_FWHM * self._focus_at(ends).fwhm_px:
            return 0.0
        cutout = cut_out(self.frame.pixels, self.sky, box_about(ends), MARGIN_PX, self.stars)
        width_px = self._width_px(trace)
        lumpiness, bend = lumpiness_and_bend(
            cutout, ends, width_px / FWHM_PER_SIGMA, found.snr / trace.confusion
        )
        return max(bend, lumpiness * (trace.roughness > _PERIODIC))

    def traced_ends(self, proposal: Proposal) -> Ends | None:
        """Ends of a proposal as the light along it shows them; None where no line stands out."""
        trace = self._traced(proposal.box.ends_px, is_light=proposal.is_light)
        return None if trace is None else _ends_of(trace)

    def _traced_well(self, proposal: Proposal) -> tuple[LineTrace | None, NotAStreak | None]:
        """Return a trace that passes the gates, or the first gate that it does not pass."""
        trace = self._traced(proposal.box.ends_px, is_light=proposal.is_light)
        reason = NotAStreak(kind="no line") if trace is None else self._fault(trace)
        return (trace, None) if reason is None else (None, reason)

    def _traced(self, ends: Ends, *, is_light: bool = False) -> LineTrace | None:
        """Trace the line, as wide as a star, or as drift has drawn it out where that shows more."""
        focus = self._focus_at(ends)
        width_px, widest_px = focus.fwhm_px, focus.widest_streak_px(_angle_deg(ends))
        off_px = OFF_PX if focus.joined == 1 else OFF_PX * _FINER_WHERE_JOINED
        if is_light:
            off_px = min(off_px, max(_LIGHT_OFF_PX, _LIGHT_OFF_FWHM * focus.fwhm_px))
        look = self.frame.pixels, self.sky, ends, self.stars
        trace = trace_line(*look, width_px, off_px=off_px)
        if widest_px < _DRAWN_OUT * width_px:
            return trace
        wide = trace_line(*look, widest_px, off_px=off_px)
        is_better = wide is not None and (trace is None or wide.snr > _MORE * trace.snr)
        return wide if is_better else trace

    def _width_px(self, trace: LineTrace) -> float:
        """Width expected of a traced streak, px."""
        ends = _ends_of(trace)
        focus = self._focus_at(ends)
        most = max(focus.widest_streak_px(_angle_deg(ends)), focus.fwhm_px)
        return min(max(trace.width_px, focus.fwhm_px), most)

    def _focus_at(self, ends: Ends) -> PointImage:
        """Return the focus at the midpoint of a line."""
        return self.focus.at(*midpoint_of(ends))

    def _take(self, candidate: Candidate) -> None:
        """Keep a candidate: of one streak the better, with the network's highest confidence."""
        found, reason = candidate.found, NotAStreak(kind="same streak")
        same = [each for each in self.taken if is_same_streak(found, each.found)]
        if all(found.snr >= _MUCH_BETTER * each.found.snr for each in same):
            for each in same:
                self.taken.remove(each)
            kept, others = candidate, same
        else:
            kept, others = max(same, key=lambda each: each.found.snr), [candidate]
            self.taken.remove(kept)
        said = max(each.found.confidence for each in (candidate, *same))
        self.rejected += [
            Rejection(detection=each.found, reason=reason)
            for each in others
            if MIN_RECORDED_CONFIDENCE <= each.found.confidence < said
        ]
        self.taken.append(kept.with_confidence(said))

    def _fault(self, trace: LineTrace) -> NotAStreak | None:
        """The first gate that a trace does not pass; None where it passes all."""
        # In the order of their cost: the trace computes what it is asked for.
        width_px, ends = self._width_px(trace), _ends_of(trace)
        star_px, length_px = self._focus_at(ends).fwhm_px, length_of(ends)
        is_sampled = self.focus.joined == 1 and star_px > _UNDERSAMPLED_PX
        least_px = _NARROWEST * min(width_px, SHARP_PX) if is_sampled else 0.0
        if trace.snr < _MIN_TRACE_SNR:
            reason = NotAStreak(kind="too faint", value=trace.snr, limit=_MIN_TRACE_SNR)
        elif trace.width_px < least_px:
            reason = NotAStreak(kind="too narrow", value=trace.width_px, limit=width_px)
        elif length_px < _SHORTEST * star_px:
            reason = NotAStreak(kind="too short", value=length_px)
        else:
            reason = None
        return reason

    def record_rejection(
        self, box: NetworkBox, reason: NotAStreak, fit: StreakFit | None = None
    ) -> None:
        """Add a rejected proposal with its reason, unless its confidence is very low.

        ``fit``: its measurement, where there is one.
        """
        if box.confidence < MIN_RECORDED_CONFIDENCE:
            return
        found = (
            detection_from_box(self.frame, box)
            if fit is None
            else detection_from_fit(self.frame, box, fit)
        )
        self.rejected.append(Rejection(detection=found, reason=reason))


def _angle_deg(ends: Ends) -> float:
    return math.degrees(math.atan2(ends[3] - ends[1], ends[2] - ends[0]))


def _agree(fit: StreakFit, trace: LineTrace) -> bool:
    """True where a fit covers the whole line that was traced."""
    length_px = length_of(_ends_of(trace))
    is_long = abs(fit.length_px - length_px) < _AGREE_LENGTH * length_px + fit.width_px
    return is_long and fit.snr > _AGREE_SNR * trace.snr


def _ends_of(line: StreakFit | LineTrace | Detection) -> Ends:
    return line.x_a_px, line.y_a_px, line.x_b_px, line.y_b_px
