"""Streaks of a frame: the network proposes, the fit on the raw pixels disposes.

What is above tau and passes the fit's gates is a detection; everything else that the network
held possible is kept with the reason why it was not taken.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

from rsoconsole.config import DetectorConfig
from rsoconsole.reasons import BelowTau, NotAStreak
from rsoconsole.records import Detection, Detections, Frame, Rejection
from rsoconsole.sky.angles import turn_deg
from rsoconsole.vision.background import Background, local_background
from rsoconsole.vision.bins import bin_frame
from rsoconsole.vision.candidates import Measurements, at_box_centre, distinct, from_box, runs_alike
from rsoconsole.vision.confidence import ConfidenceCurve
from rsoconsole.vision.cores import threads_for
from rsoconsole.vision.maps import FrameMap, choose_blocks, make_map, map_noise
from rsoconsole.vision.network import NetworkBox
from rsoconsole.vision.pattern import find_pattern
from rsoconsole.vision.stars import STAR_BLOCK_PX, StarList, find_stars
from rsoconsole.vision.streak_names import named
from rsoconsole.vision.trailed_stars import Trail
from rsoconsole.vision.workers import Workers

MOST_FITS = 20
MOST_WITNESSES = 12
DARK = NotAStreak(kind="no light")
TRAILED_STREAKS = 9
"""So many streaks of one length and direction are stars; no satellite cluster is as large."""
_FEW_TRAILS, _MANY_TRAILS, _SURE = 3.0, 8.0, 0.9
"""Trails of stars in a row that look like one streak: of what is sure, and of what is not."""
_AS_TRAILS_DEG = 6.0
_SAME_LENGTH, _SAME_ANGLE_DEG = 0.10, 3.0


class Proposer(Protocol):
    """What proposes candidates: the trained network, or a stand-in."""

    def run(self, frame_map: FrameMap) -> tuple[NetworkBox, ...]:
        """Candidates of one map, most confident first."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameAnalysis:
    """All that was measured of one frame, so that the plate solver need not begin anew."""

    detections: Detections
    stars: StarList
    background: Background


class StreakDetector:
    """Finds and measures streaks. Not for use by two threads at once (nor is its network)."""

    def __init__(
        self, network: Proposer, settings: DetectorConfig, curve: ConfidenceCurve | None = None
    ) -> None:
        """``curve`` None: a streak keeps the confidence of its proposal."""
        self._network = network
        self._settings = settings
        self._curve = curve
        self._workers = Workers(threads_for(settings.threads))

    def detect(self, frame: Frame, tau: float | None = None) -> Detections:
        """Streaks of ``frame`` with a confidence above ``tau`` (None: the configured one)."""
        return self.analyse(frame, tau).detections

    def analyse(self, frame: Frame, tau: float | None = None) -> FrameAnalysis:
        """The same, with the frame's stars and background.

        Where there is a second thread, it estimates the maps' noise while the first reads the
        frame, and looks for stars, which only the fit needs, beside map and network; the time of
        the stage ``stars`` then runs beside theirs.
        """
        threshold = self._settings.tau if tau is None else tau
        watch, workers = _Stopwatch(), self._workers
        with watch.stage("pattern"):
            pattern = find_pattern(frame.pixels)
            if pattern is not None:
                frame = replace(frame, pixels=pattern.removed(frame.pixels))
        pixels = frame.pixels
        blocks = choose_blocks(
            frame.width_px, frame.height_px, frame.scale_arcsec_px, frame.exposure_s
        )
        mode = self._settings.map_mode
        lines = blocks if mode == "fast" else ()
        with watch.stage("background"):
            noises = {block: workers.begin(partial(map_noise, pixels, block)) for block in lines}
            bins = bin_frame(pixels, {STAR_BLOCK_PX}, line_blocks=lines, workers=workers)
            sky = local_background(pixels, bins=bins, workers=workers)

        def look_for_stars() -> StarList:
            with watch.stage("stars"):
                return find_stars(pixels, sky, saturation_adu=frame.saturation_adu, bins=bins)

        looked = workers.begin(look_for_stars)
        with watch.stage("map"):
            noise = {block: begun.result() for block, begun in noises.items()}
            maps = [
                make_map(pixels, mode, block, bins=bins, noise=noise.get(block), workers=workers)
                for block in blocks
            ]
        with watch.stage("network"):
            boxes = distinct(frame, [self._network.run(each) for each in maps])
        stars = looked.result()
        with watch.stage("fit"):
            taken, rejected = self._measure(frame, boxes, sky, stars, threshold)
            taken, trailed = _without_trailed_stars(taken)
            rejected += trailed
            if stars.trail is not None:
                taken, trailed = not_along(taken, stars.trail)
                rejected += trailed
            if self._settings.centroid == "box":
                taken = [at_box_centre(d) for d in taken]
            faint = [d for d in taken if d.confidence <= threshold]
            rejected += [
                Rejection(detection=d, reason=BelowTau(confidence=d.confidence, tau=threshold))
                for d in faint
            ]
        with watch.stage("class"):
            taken, rejected = named(frame, sky, stars, taken, rejected)
        return FrameAnalysis(
            detections=Detections(
                frame_id=frame.frame_id,
                width_px=frame.width_px,
                height_px=frame.height_px,
                detections=tuple(d for d in taken if d.confidence > threshold),
                rejected=tuple(sorted(rejected, key=lambda r: -r.detection.confidence)),
                stage_ms=watch.stage_ms,
            ),
            stars=stars,
            background=sky,
        )

    def _measure(
        self,
        frame: Frame,
        boxes: tuple[NetworkBox, ...],
        sky: Background,
        stars: StarList,
        threshold: float,
    ) -> tuple[list[Detection], list[Rejection]]:
        """Measured candidates, most confident first, and those that are none.

        What no measurement could lift above ``threshold`` or shows no light at a glance is not
        measured. What could only bear witness against one that is above, since it runs alike, is.
        """
        ordered = sorted(boxes, key=lambda b: -b.confidence)
        measured = Measurements(frame, sky, stars)
        curve = self._curve
        width_px = stars.median_fwhm_px
        hopeful: list[NetworkBox] = []
        others: list[NetworkBox] = []
        for box in ordered:
            most = 1.0 if curve is None else curve.highest(box.confidence, box.length_px, width_px)
            (hopeful if most > threshold else others).append(box)
        fits = 0
        for box in hopeful:
            if fits == MOST_FITS:
                measured.refuse(box, NotAStreak(kind="not measured", limit=MOST_FITS))
            elif measured.is_dark(box):
                measured.refuse(box, DARK)
            else:
                fits += 1
                measured.measure(box)
        risen = [d for d in self._judged(measured.taken, stars) if d.confidence > threshold]
        witnesses = 0
        for box in others:
            is_asked = risen and witnesses < MOST_WITNESSES
            if is_asked and runs_alike(from_box(frame, box), risen) and not measured.is_dark(box):
                witnesses += 1
                measured.measure(box)
            else:
                measured.refuse(box, NotAStreak(kind="below tau", limit=threshold))
        taken = self._judged(measured.taken, stars)
        return sorted(taken, key=lambda d: -d.confidence), measured.rejected

    def _judged(self, taken: list[Detection], stars: StarList) -> list[Detection]:
        """With the confidence that each earns by its measurement and among the others."""
        if self._curve is None:
            return taken
        return self._curve.judged(taken, stars.median_fwhm_px)


def _without_trailed_stars(
    taken: list[Detection],
) -> tuple[list[Detection], list[Rejection]]:
    """Set aside streaks that so many others share length and direction with that they are stars."""
    if len(taken) < TRAILED_STREAKS:
        return taken, []
    kept: list[Detection] = []
    trailed: list[Rejection] = []
    for d in taken:
        alike = sum(_is_alike(d, other) for other in taken)
        if alike < TRAILED_STREAKS:
            kept.append(d)
        else:
            reason = NotAStreak(kind="trailed stars", value=alike)
            trailed.append(Rejection(detection=d, reason=reason))
    return kept, trailed


def not_along(taken: list[Detection], trail: Trail) -> tuple[list[Detection], list[Rejection]]:
    """Set aside what runs as the stars' own trails do and is as long as some of them in a row.

    A long one in which there is no doubt stays: a satellite may go the same way.
    """
    one_px = trail.length_px + trail.fwhm_px
    is_chain = [
        turn_deg(d.angle_deg, trail.angle_deg) < _AS_TRAILS_DEG
        and d.length_px < (_FEW_TRAILS if d.confidence > _SURE else _MANY_TRAILS) * one_px
        for d in taken
    ]
    kept = [d for d, is_one in zip(taken, is_chain, strict=True) if not is_one]
    chains = [
        Rejection(
            detection=d,
            reason=NotAStreak(kind="stars' trails", value=d.length_px, limit=trail.length_px),
        )
        for d, is_one in zip(taken, is_chain, strict=True)
        if is_one
    ]
    return kept, chains


def _is_alike(one: Detection, other: Detection) -> bool:
    turn = turn_deg(one.angle_deg, other.angle_deg)
    longer = max(one.length_px, other.length_px)
    return turn < _SAME_ANGLE_DEG and abs(one.length_px - other.length_px) < _SAME_LENGTH * longer


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
