"""Streak detection in a frame: network, line filter, star search propose; pixels decide.

A candidate above tau that passes the measurement's gates is a detection; every other candidate of
the network is recorded with the reason for its rejection.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rsoconsole.config import DetectorConfig
from rsoconsole.records import (
    BelowTau,
    Detection,
    Detections,
    FloatArray,
    Frame,
    NotAStreak,
    Rejection,
)
from rsoconsole.vision.detector._candidates import (
    FrameCandidates,
    Proposal,
    ranked_proposals,
)
from rsoconsole.vision.detector._reject_artifacts import reject_artifacts
from rsoconsole.vision.detector.confidence import ConfidenceCurve
from rsoconsole.vision.detector.measured_detection import (
    Candidate,
    with_midpoint_at_box_centre,
)
from rsoconsole.vision.detector.proposal_search import (
    FAINT_PX,
    FrameProposals,
    ProposalSearch,
    Proposer,
    Stopwatch,
)
from rsoconsole.vision.detector.working_frame import WorkingFrame
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.lines.segments import Ends
from rsoconsole.vision.stars.point_image import PointImage
from rsoconsole.vision.stars.psf_memory import PsfMemory
from rsoconsole.vision.stars.star_list import StarList
from rsoconsole.vision.streaks.class_probabilities import Likelihood
from rsoconsole.vision.streaks.streak_classes import classify_streaks
from rsoconsole.vision.streaks.streak_middle import with_middle_by_light

MIN_FAINT_CONFIDENCE = 3e-4
"""Least confidence of a measured streak that is recorded: frames together may make it sure."""
MAX_FITS = 28
MAX_QUICK_FITS = 3
MAX_VERIFIED, _MIN_LOG_ODDS = 72, -2.0
"""Number of proposals that the verifier looks at, and its log-odds from which one is measured."""
_SHARP_PX = 1.5
"""Width of stars, px, below which streaks side by side are told apart in finer cells alone."""
_SURELY_ONE = 2.0
"""Verifier's log-odds of a streak beside which no fainter one is looked for."""
MIN_BELIEVED = 1e-3
"""Network's confidence below which only what the line filter proposes too is looked at."""
_WORTH_A_NAME = 0.2
_PROMISING = 0.1
"""Share of tau below which a trace's confidence is too low for any fit to lift it above tau."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameAnalysis:
    """Everything measured in one frame; its stars and background also serve the plate solver."""

    detections: Detections
    stars: StarList
    background: Background
    candidates: tuple[Candidate, ...] = ()
    """Measured lines of light, in working-frame pixels, with the network's confidence."""
    focus: PointImage
    working: WorkingFrame
    proposals: tuple[Proposal, ...] = ()
    """Proposals, in working-frame pixels."""
    class_shares: Mapping[Detection, Likelihood] = field(default_factory=dict)
    """Probabilities of all classes by streak of ``detections``, accepted or not, if it has any."""


class StreakDetector:
    """Detector that finds and measures streaks.

    Neither it nor its network may be used by two threads at once.
    """

    def __init__(
        self,
        network: Proposer,
        settings: DetectorConfig,
        curve: ConfidenceCurve | None = None,
        memory: PsfMemory | None = None,
        *,
        is_quick: bool = False,
    ) -> None:
        """Make a detector from a source of proposals and settings.

        - curve: gives the confidence after measurement; None: a streak keeps that of its proposal
        - memory: width of stars in earlier frames, where frames come in order from one camera;
          None: each frame stands alone
        - is_quick: measure only the few best proposals of the line filter, take stars to be points
        """
        self._is_quick = is_quick
        self._search = ProposalSearch(network, settings, memory, is_quick=is_quick)
        self._settings = settings
        self._curve = curve
        self._verifier = network.verifier

    def detect(self, frame: Frame, tau: float | None = None) -> Detections:
        """Find streaks of ``frame`` with a confidence above ``tau`` (None: the configured one)."""
        return self.analyse(frame, tau).detections

    def analyse(self, frame: Frame, tau: float | None = None) -> FrameAnalysis:
        """Measure streaks, stars and background of ``frame``; ``tau`` as in ``detect``.

        With a second thread some stages run at once, so that the times of ``stars`` and ``lines``
        overlap with those of other stages.
        """
        threshold = self._settings.tau if tau is None else tau
        watch = Stopwatch()
        seen = self._search.search(frame, watch)
        working, stars, focus = seen.working, seen.stars, seen.focus
        with watch.stage("fit"):
            measured = self._candidates(seen, threshold)
            self._measure(seen, measured, seen.proposals)
        proposals = seen.proposals
        if self._looks_for_faint(seen, measured):
            with watch.stage("faint"):
                faint = self._search.faint_proposals(seen)
                self._measure(seen, measured, faint)
                proposals += tuple(faint)
        with watch.stage("judge"):
            judged = self._judged(measured.taken, focus)
            rejected = measured.rejected
            judged.sort(key=lambda each: -each.found.confidence)
            taken, others = reject_artifacts(
                judged,
                stars.trail,
                working.frame,
                points=len(stars),
                is_striped=seen.is_striped,
            )
            rejected += others
            if self._settings.centroid == "box":
                taken = [with_midpoint_at_box_centre(d) for d in taken]
            rejected += [
                Rejection(detection=d, reason=BelowTau(confidence=d.confidence, tau=threshold))
                for d in taken
                if MIN_FAINT_CONFIDENCE < d.confidence <= threshold
            ]
        with watch.stage("class"):
            accepted = [d for d in taken if d.confidence > threshold]
            doubted = [r for r in rejected if r.detection.confidence > _WORTH_A_NAME * threshold]
            others = [r for r in rejected if r.detection.confidence <= _WORTH_A_NAME * threshold]
            accepted, doubted, shares = classify_streaks(
                working.frame, seen.sky, stars, accepted, doubted
            )
            rejected = doubted + others
            if not self._is_quick:
                accepted = [
                    with_middle_by_light(working.frame.pixels, seen.sky, stars, d) for d in accepted
                ]
        rejected.sort(key=lambda r: -r.detection.confidence)
        return FrameAnalysis(
            detections=Detections(
                frame_id=frame.frame_id,
                width_px=frame.width_px,
                height_px=frame.height_px,
                detections=tuple(working.original_detection(d) for d in accepted),
                rejected=tuple(working.original_rejection(each) for each in rejected),
                stage_ms=watch.stage_ms,
            ),
            stars=working.original_stars(stars),
            background=seen.original_sky,
            candidates=tuple(measured.taken),
            focus=focus,
            working=working,
            proposals=proposals,
            class_shares={
                working.original_detection(each): of_all for each, of_all in shares.items()
            },
        )

    def _looks_for_faint(self, seen: FrameProposals, measured: FrameCandidates) -> bool:
        """True where finer cells would show more: nothing measured is surely a streak, or stars
        are much narrower than the cells.
        """
        if self._verifier is None or self._is_quick or seen.side_px <= FAINT_PX:
            return False
        if seen.focus.fwhm_px < _SHARP_PX:
            return True
        return all(each.light.log_odds < _SURELY_ONE for each in measured.taken)

    def _candidates(self, seen: FrameProposals, threshold: float) -> FrameCandidates:
        curve, focus = self._curve, seen.focus

        def is_worth_fitting(candidate: Candidate) -> bool:
            # How wide it is the fit alone tells well.
            narrow = replace(candidate, found=replace(candidate.found, width_px=0.0))
            return curve is None or curve.confidence(narrow, focus) > _PROMISING * threshold

        return seen.candidates(is_worth_fitting)

    def _measure(
        self, seen: FrameProposals, measured: FrameCandidates, proposals: Sequence[Proposal]
    ) -> None:
        """Measure candidates: those that are lines of light, and those that are none.

        The verifier looks at the best proposals; what it gives no hope is not measured.
        """
        worth = [p for p in proposals if p.is_line or p.box.confidence >= MIN_BELIEVED]
        ranked = ranked_proposals(worth)
        ordered = ranked[:MAX_VERIFIED]
        for each in ranked[MAX_VERIFIED:]:
            measured.record_rejection(each.box, NotAStreak(kind="not measured", limit=MAX_VERIFIED))
        said = self._log_odds(seen, [each.box.ends_px for each in ordered])
        fits, most = 0, MAX_QUICK_FITS if self._is_quick else MAX_FITS
        for at in np.argsort(-said, kind="stable").tolist():
            each, log_odds = ordered[at], float(said[at])
            if log_odds < _MIN_LOG_ODDS:
                measured.record_rejection(each.box, NotAStreak(kind="unlike a streak"))
            elif measured.has(each):
                continue
            elif fits == most:
                measured.record_rejection(each.box, NotAStreak(kind="not measured", limit=most))
            else:
                fits += 1
                measured.measure(each, log_odds)
        # Now by the ends that were measured.
        found = [each.found for each in measured.taken]
        ends = [(d.x_a_px, d.y_a_px, d.x_b_px, d.y_b_px) for d in found]
        said = self._log_odds(seen, ends)
        measured.taken = [
            replace(each, light=replace(each.light, log_odds=odds))
            for each, odds in zip(measured.taken, said.tolist(), strict=True)
        ]

    def _log_odds(self, seen: FrameProposals, ends: list[Ends]) -> FloatArray:
        """What the verifier says of lines: (n,) log-odds; 0 without one."""
        lines = np.array(ends, dtype=np.float64).reshape(-1, 4)
        if self._verifier is None or not ends:
            return np.zeros(len(lines))
        return self._verifier.log_odds(seen.images(lines))

    def _judged(self, taken: list[Candidate], focus: PointImage) -> list[Candidate]:
        """Candidates with the confidence by their measurement and among the others."""
        return (
            list(taken) if self._curve is None else self._curve.with_curve_confidences(taken, focus)
        )
