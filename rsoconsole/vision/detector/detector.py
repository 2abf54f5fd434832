"""Streak detection in a frame: network, line filter, star search propose; pixels decide.

A candidate above tau that passes the measurement's gates is a detection; every other candidate of
the network is recorded with the reason for its rejection.
"""

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Protocol

from rsoconsole.config import DetectorConfig
from rsoconsole.records import BelowTau, Detection, Detections, Frame, NotAStreak, Rejection
from rsoconsole.vision.detector._candidates import (
    MIN_RECORDED_CONFIDENCE,
    FrameCandidates,
    Proposal,
    merged_proposals,
    ranked_proposals,
)
from rsoconsole.vision.detector._reject_artifacts import is_star_trail, reject_artifacts
from rsoconsole.vision.detector.confidence import ConfidenceCurve
from rsoconsole.vision.detector.measured_detection import (
    Candidate,
    PointImage,
    distinct_boxes,
    is_parallel_to_any,
    with_midpoint_at_box_centre,
)
from rsoconsole.vision.detector.network import NetworkBox
from rsoconsole.vision.detector.working_frame import WorkingFrame, joined_square_side_px
from rsoconsole.vision.frame.background import Background, local_background
from rsoconsole.vision.frame.bins import bin_frame
from rsoconsole.vision.frame.maps import FrameMap, choose_blocks, make_map, map_noise
from rsoconsole.vision.frame.pattern import find_row_column_pattern
from rsoconsole.vision.frame.workers import Workers, threads_for
from rsoconsole.vision.lines.line_filter import FINEST_PX, CellLine, cell_side_px, propose_lines
from rsoconsole.vision.lines.line_or_stars import StarImageComparer
from rsoconsole.vision.lines.short_lines import interleaved_lines, short_lines
from rsoconsole.vision.stars.psf_field import Psf
from rsoconsole.vision.stars.psf_memory import PsfMemory
from rsoconsole.vision.stars.star_list import StarList
from rsoconsole.vision.stars.stars import MAX_STARS, STAR_BLOCK_PX, find_stars
from rsoconsole.vision.streaks.class_probabilities import Likelihood
from rsoconsole.vision.streaks.streak_classes import classify_streaks
from rsoconsole.vision.streaks.streak_middle import with_middle_by_light

MAX_FITS = 28
MAX_QUICK_FITS = 3
MAX_WITNESSES = 12
MIN_BELIEVED = 1e-3
"""Network's confidence below which a proposal is measured only if the line filter made it too."""
_MAX_JOININGS = 2
_MAX_WIDE_STARS = 1500
"""Largest number of stars listed where they are wide."""
_WORTH_A_NAME = 0.2
_PROMISING = 0.5
"""Share of tau below which a trace's confidence is too low for any fit to lift it above tau."""


class Proposer(Protocol):
    """Source of proposals: the trained network, or a stand-in."""

    def run(self, frame_map: FrameMap) -> tuple[NetworkBox, ...]:
        """Candidates in one map, most confident first."""
        ...


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
        self._network = network
        self._settings = settings
        self._curve = curve
        self._memory = memory
        self._workers = Workers(threads_for(settings.threads))

    def detect(self, frame: Frame, tau: float | None = None) -> Detections:
        """Find streaks of ``frame`` with a confidence above ``tau`` (None: the configured one)."""
        return self.analyse(frame, tau).detections

    def analyse(self, frame: Frame, tau: float | None = None) -> FrameAnalysis:
        """Measure streaks, stars and background of ``frame``; ``tau`` as in ``detect``.

        With a second thread some stages run at once, so that the times of ``stars`` and ``lines``
        overlap with those of other stages.
        """
        threshold = self._settings.tau if tau is None else tau
        watch = _Stopwatch()
        with watch.stage("pattern"):
            pattern = find_row_column_pattern(frame.pixels)
            if pattern is not None:
                frame = replace(frame, pixels=pattern.removed(frame.pixels))
        known = None if self._memory is None else self._memory.recall(frame)
        working = WorkingFrame.of(frame, 1)
        seen = first = self._first_look(frame, watch, known, may_join_pixels=True)
        for _ in range(_MAX_JOININGS):
            side = joined_square_side_px(seen.stars, working.frame)
            if side == 1:
                break
            working = WorkingFrame.of(frame, side * working.side)
            joined = None if known is None else known.in_binned_pixels(working.side)
            seen = self._first_look(working.frame, watch, joined, _MAX_WIDE_STARS)
        stars = seen.stars
        if self._memory is not None:
            self._memory.remember(frame, working.original_stars(stars))
        focus = _focus(stars, working.side)
        with watch.stage("fit"):
            lights = StarImageComparer(frame.pixels, first.sky, working.original_stars(stars))
            measured = self._measure(working, seen, focus, threshold, lights)
            rejected = measured.rejected
            judged = self._judged(measured.taken, focus)
            judged.sort(key=lambda each: -each.found.confidence)
            taken, others = reject_artifacts(
                judged,
                stars.trail,
                working.frame,
                points=len(stars),
                is_striped=pattern is not None,
            )
            rejected += others
            if self._settings.centroid == "box":
                taken = [with_midpoint_at_box_centre(d) for d in taken]
            rejected += [
                Rejection(detection=d, reason=BelowTau(confidence=d.confidence, tau=threshold))
                for d in taken
                if MIN_RECORDED_CONFIDENCE < d.confidence <= threshold
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
            background=first.sky,
            candidates=tuple(measured.taken),
            focus=focus,
            working=working,
            proposals=seen.proposals,
            class_shares={
                working.original_detection(each): of_all for each, of_all in shares.items()
            },
        )

    def _first_look(
        self,
        frame: Frame,
        watch: "_Stopwatch",
        expected: Psf | None,
        most_stars: int = MAX_STARS,
        *,
        may_join_pixels: bool = False,
    ) -> "_FirstLook":
        """Find sky, stars and possible streaks; ``expected`` of the stars where they are few.

        With ``may_join_pixels`` no streak is searched for where stars are so wide that pixels will
        be joined first, as far as that is known in time.
        """
        pixels, workers = frame.pixels, self._workers
        blocks = choose_blocks(
            frame.width_px, frame.height_px, frame.scale_arcsec_px, frame.exposure_s
        )
        mode = self._settings.map_mode
        lines = blocks if mode == "fast" and not self._is_quick else ()
        # Where pixels were joined stars stand closer together, and streaks are short.
        finest_px = FINEST_PX if may_join_pixels else FINEST_PX // 2
        star_block_px = STAR_BLOCK_PX if may_join_pixels else STAR_BLOCK_PX // 2
        side_px = cell_side_px(frame.height_px, frame.width_px, finest_px)
        with watch.stage("background"):
            noises = {block: workers.begin(partial(map_noise, pixels, block)) for block in lines}
            bins = bin_frame(
                pixels, {star_block_px}, line_blocks=lines, square_px=side_px, workers=workers
            )
            sky = local_background(pixels, bins=bins, workers=workers)

        def look_for_stars_and_lines() -> tuple[StarList, list[CellLine]]:
            with watch.stage("stars"):
                stars = find_stars(
                    pixels,
                    sky,
                    most_stars,
                    saturation_adu=frame.saturation_adu,
                    bins=bins,
                    expected=expected,
                    block_px=star_block_px,
                    may_be_trails=not self._is_quick,
                )
            if may_join_pixels and joined_square_side_px(stars, frame) > 1:
                return stars, []
            with watch.stage("lines"):
                assert bins.squares is not None
                return stars, propose_lines(sky, bins.squares, side_px, stars)

        looked = workers.begin(look_for_stars_and_lines)
        if (
            may_join_pixels
            and looked.done()
            and joined_square_side_px(looked.result()[0], frame) > 1
        ):
            return _FirstLook(sky=sky, stars=looked.result()[0], proposals=())
        if self._is_quick:
            stars, found = looked.result()
            return _FirstLook(sky=sky, stars=stars, proposals=tuple(merged_proposals([], found)))
        with watch.stage("map"):
            noise = {block: begun.result() for block, begun in noises.items()}
            maps = [
                make_map(pixels, mode, block, bins=bins, noise=noise.get(block), workers=workers)
                for block in blocks
            ]
        with watch.stage("network"):
            boxes = distinct_boxes([self._network.run(each) for each in maps])
        stars, found = looked.result()
        is_sharp = may_join_pixels and stars.trail is None
        found = interleaved_lines(found, short_lines(stars, found, is_sharp=is_sharp))
        wanted = merged_proposals(boxes, found)
        if stars.trail is not None:
            trail = stars.trail
            wanted = [each for each in wanted if each.is_light or not is_star_trail(each, trail)]
        return _FirstLook(sky=sky, stars=stars, proposals=tuple(wanted))

    def _measure(
        self,
        working: WorkingFrame,
        seen: "_FirstLook",
        focus: PointImage,
        threshold: float,
        lights: StarImageComparer,
    ) -> FrameCandidates:
        """Measure the candidates: those that are lines of light, and those that are none.

        Candidates that no measurement could lift above ``threshold``, or without light at a glance,
        are not measured, except those that may count against one above it, since they run alike.
        """
        frame, stars = working.frame, seen.stars
        ordered = ranked_proposals(seen.proposals)
        curve = self._curve

        def is_worth_fitting(candidate: Candidate) -> bool:
            return curve is None or curve.confidence(candidate, focus) > _PROMISING * threshold

        measured = FrameCandidates(frame, seen.sky, stars, focus, is_worth_fitting, lights)
        hopeful: list[Proposal] = []
        others: list[Proposal] = []
        for each in ordered:
            (hopeful if self._has_hope(each, focus, threshold) else others).append(each)
        fits, most = 0, MAX_QUICK_FITS if self._is_quick else MAX_FITS
        for each in hopeful:
            if measured.has(each):
                continue
            if fits == most:
                measured.record_rejection(each.box, NotAStreak(kind="not measured", limit=most))
            elif (doubt := measured.quick_rejection(each)) is not None:
                measured.record_rejection(each.box, doubt)
            else:
                fits += 1
                measured.measure(each)
        judged = (each.found for each in self._judged(measured.taken, focus))
        risen_deg = [found.angle_deg for found in judged if found.confidence > threshold]
        witnesses = 0
        for each in others:
            is_asked = risen_deg and witnesses < (0 if self._is_quick else MAX_WITNESSES)
            alike = is_asked and is_parallel_to_any(each.box.angle_deg, risen_deg)
            if alike and measured.quick_rejection(each) is None:
                witnesses += 1
                measured.measure(each)
            else:
                measured.record_rejection(each.box, NotAStreak(kind="below tau", limit=threshold))
        return measured

    def _has_hope(self, proposal: Proposal, focus: PointImage, threshold: float) -> bool:
        said, length_px = proposal.box.confidence, proposal.box.length_px
        if proposal.is_line or said < MIN_BELIEVED or self._curve is None:
            return proposal.is_line or said >= MIN_BELIEVED
        here = focus.at(*proposal.box.middle_px)
        return self._curve.highest_confidence(said, length_px, here) > threshold

    def _judged(self, taken: list[Candidate], focus: PointImage) -> list[Candidate]:
        """Candidates with the confidence by their measurement and among the others."""
        return (
            list(taken) if self._curve is None else self._curve.with_curve_confidences(taken, focus)
        )


def _focus(stars: StarList, joined: int) -> PointImage:
    trail = stars.trail
    return PointImage(
        fwhm_px=stars.median_fwhm_px,
        joined=joined,
        trail_px=0.0 if trail is None else trail.length_px,
        trail_deg=0.0 if trail is None else trail.angle_deg,
        psf_field=stars.psf_field,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _FirstLook:
    """Sky, stars and proposals of a frame, before any is measured."""

    sky: Background
    stars: StarList
    proposals: tuple[Proposal, ...]


class _Stopwatch:
    """Wall time of each stage."""

    def __init__(self) -> None:
        self.stage_ms: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        began = time.perf_counter()
        try:
            yield
        finally:
            self.stage_ms[name] = (time.perf_counter() - began) * 1e3
