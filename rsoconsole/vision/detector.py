"""Streaks of a frame: the network proposes, the fit on the raw pixels disposes.

What is above tau and passes the fit's gates is a detection; everything else that the network
held possible is kept with the reason why it was not taken.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rsoconsole.config import DetectorConfig
from rsoconsole.records import Detection, Detections, Frame, Rejection
from rsoconsole.vision.background import Background, local_background
from rsoconsole.vision.bins import bin_frame
from rsoconsole.vision.confidence import ConfidenceCurve
from rsoconsole.vision.maps import FrameMap, choose_blocks, make_map
from rsoconsole.vision.network import NetworkBox
from rsoconsole.vision.stars import STAR_BLOCK_PX, StarList, find_stars
from rsoconsole.vision.streak_fit import NoStreak, StreakFit, fit_streak
from rsoconsole.vision.workers import Workers

BOX_SIGMA_PX = 3.0
"""One sigma of a box's centre against the streak's midpoint, of boxes about streaks of 119 px."""
MOST_FITS = 12
TOLD_CONFIDENCE = 0.01
"""Whom the network believes less is not on record when the fit finds no streak either."""
TRAILED_STREAKS = 9
"""So many streaks of one length and direction are stars; no satellite cluster is as large."""
_SAME_LENGTH, _SAME_ANGLE_DEG = 0.10, 3.0
_SAME_STREAK_DEG = 10.0


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
        self._workers = Workers(settings.threads)

    def detect(self, frame: Frame, tau: float | None = None) -> Detections:
        """Streaks of ``frame`` with a confidence above ``tau`` (None: the configured one)."""
        return self.analyse(frame, tau).detections

    def analyse(self, frame: Frame, tau: float | None = None) -> FrameAnalysis:
        """The same, with the frame's stars and background.

        Only the fit needs the stars: they are looked for beside the network, where there is a
        second thread, and their stage's time then runs beside its.
        """
        threshold = self._settings.tau if tau is None else tau
        watch, workers = _Stopwatch(), self._workers
        blocks = choose_blocks(
            frame.width_px, frame.height_px, frame.scale_arcsec_px, frame.exposure_s
        )
        with watch.stage("background"):
            bins = bin_frame(frame.pixels, {STAR_BLOCK_PX, *blocks}, workers=workers)
            sky = local_background(frame.pixels, bins=bins, workers=workers)
        with watch.stage("map"):
            maps = [
                make_map(frame.pixels, self._settings.map_mode, block, bins=bins, workers=workers)
                for block in blocks
            ]

        def look_for_stars() -> StarList:
            with watch.stage("stars"):
                return find_stars(frame.pixels, sky, saturation_adu=frame.saturation_adu, bins=bins)

        looked = workers.begin(look_for_stars)
        with watch.stage("network"):
            boxes = _distinct(frame, [self._network.run(each) for each in maps])
        stars = looked.result()
        with watch.stage("fit"):
            taken, rejected = self._measure(frame, boxes, sky, stars)
            taken, trailed = _without_trailed_stars(taken)
            rejected += trailed
            faint = [d for d in taken if d.confidence <= threshold]
            rejected += [
                Rejection(
                    detection=d, reason=f"confidence {d.confidence:.2f} below tau {threshold:.2f}"
                )
                for d in faint
            ]
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
        self, frame: Frame, boxes: tuple[NetworkBox, ...], sky: Background, stars: StarList
    ) -> tuple[list[Detection], list[Rejection]]:
        """Measured candidates, most confident first, and those that are none."""
        taken: list[Detection] = []
        rejected: list[Rejection] = []
        for number, box in enumerate(sorted(boxes, key=lambda b: -b.confidence)):
            plain = _from_box(frame, box)
            if self._settings.centroid == "box":
                taken.append(plain)
                continue
            is_told = box.confidence >= TOLD_CONFIDENCE
            if number >= MOST_FITS:
                if is_told:
                    reason = f"not measured: {MOST_FITS} more confident candidates in the frame"
                    rejected.append(Rejection(detection=plain, reason=reason))
                continue
            fit = fit_streak(
                frame.pixels,
                sky,
                _corners(box),
                stars=stars,
                ends=(box.x_a_px, box.y_a_px, box.x_b_px, box.y_b_px),
            )
            if isinstance(fit, NoStreak):
                if not is_told:
                    continue
                detection = plain if fit.fit is None else _from_fit(frame, box, fit.fit)
                rejected.append(Rejection(detection=detection, reason=fit.reason))
                continue
            detection = _from_fit(frame, box, fit)
            if any(is_same_streak(detection, other) for other in taken):
                reason = "same streak as a more confident candidate"
                rejected.append(Rejection(detection=detection, reason=reason))
            else:
                taken.append(detection)
        return sorted(self._judged(taken, stars), key=lambda d: -d.confidence), rejected

    def _judged(self, taken: list[Detection], stars: StarList) -> list[Detection]:
        """With the confidence that each earns by its measurement and among the others."""
        if self._curve is None or self._settings.centroid == "box":
            return taken
        return self._curve.judged(taken, stars.median_fwhm_px)


def _distinct(frame: Frame, found: list[tuple[NetworkBox, ...]]) -> tuple[NetworkBox, ...]:
    """Candidates of maps of several blocks, each streak once, at its most confident."""
    if len(found) == 1:
        return found[0]
    kept: list[tuple[NetworkBox, Detection]] = []
    for box in sorted((b for boxes in found for b in boxes), key=lambda b: -b.confidence):
        plain = _from_box(frame, box)
        if not any(is_same_streak(plain, other) for _, other in kept):
            kept.append((box, plain))
    return tuple(box for box, _ in kept)


def is_same_streak(one: Detection, other: Detection) -> bool:
    """True when the midpoint of either lies on the other's line, and both run alike."""
    turn = abs((one.angle_deg - other.angle_deg + 90.0) % 180.0 - 90.0)
    shortest = max(min(one.length_px, other.length_px), 1.0)
    if turn > _SAME_STREAK_DEG + float(np.degrees(2.0 / shortest)):
        return False
    return _lies_on(one, other) or _lies_on(other, one)


def _lies_on(one: Detection, other: Detection) -> bool:
    angle = np.radians(other.angle_deg)
    dx, dy = one.x_px - other.x_px, one.y_px - other.y_px
    along = abs(dx * np.cos(angle) + dy * np.sin(angle))
    across = abs(dy * np.cos(angle) - dx * np.sin(angle))
    return bool(across < 1.5 * max(other.width_px, 2.0) and along < 0.5 * other.length_px + 1.0)


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
            reason = f"one of {alike} streaks of one length and direction: the stars are trailed"
            trailed.append(Rejection(detection=d, reason=reason))
    return kept, trailed


def _is_alike(one: Detection, other: Detection) -> bool:
    turn = abs((one.angle_deg - other.angle_deg + 90.0) % 180.0 - 90.0)
    longer = max(one.length_px, other.length_px)
    return turn < _SAME_ANGLE_DEG and abs(one.length_px - other.length_px) < _SAME_LENGTH * longer


def _corners(box: NetworkBox) -> tuple[float, float, float, float]:
    return box.x0_px, box.y0_px, box.x1_px, box.y1_px


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
        method="line",
    )


def _from_box(frame: Frame, box: NetworkBox) -> Detection:
    """The paper's measurement: the centre of the box stands for the streak's midpoint."""
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
