"""One frame through the product's detector, held against its truth: a row of plain numbers.

A row keeps every candidate that passed the fit's gates, with all that was measured of it, so that a
curve of confidence can be fitted and judged again without looking at the frame once more; and for
every trail without such a candidate where it was lost.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any, TypedDict, cast

from models.frames import Kind, TrueFrame, TrueTrail
from rsoconsole.config import DetectorConfig
from rsoconsole.reason_text import text
from rsoconsole.records import Detection, Detections
from rsoconsole.sky.angles import turn_deg
from rsoconsole.vision.candidates import Measurements
from rsoconsole.vision.confidence import ConfidenceCurve, confidence_features
from rsoconsole.vision.detector import DARK, MOST_FITS, FrameAnalysis, StreakDetector
from rsoconsole.vision.maps import FrameMap
from rsoconsole.vision.network import Network, NetworkBox

ON_TRAIL_PX = 5.0
BOX_ON_TRAIL_PX = 16.0
NOT_PROPOSED = "not proposed by the network"
NOT_MEASURED = f"not measured: {MOST_FITS} more confident candidates in the frame"


class TrailRow(TypedDict):
    """One true trail."""

    x_px: float
    y_px: float
    length_px: float
    peak_snr: float
    is_cut: bool
    lost: str
    """Why no candidate lies on it; empty where one does."""


class CandidateRow(TypedDict):
    """One candidate that the curve of confidence was asked about."""

    measured: dict[str, Any]
    """The ``Detection``, with the network's own confidence."""
    trail: int | None
    """Index of the trail it lies on; None: of none."""
    is_taken: bool
    """False: refused after all, as one of many trailed stars; it still keeps others company."""
    error_px: float | None
    """Of its midpoint against the trail's; None where either is cut by the frame's edge."""


class FrameRow(TypedDict):
    """One frame."""

    kind: Kind
    number: int
    psf_px: float
    """Median width of its stars as the detector measured it."""
    seeing_px: float
    sky_e: float
    stars: int
    trails: list[TrailRow]
    candidates: list[CandidateRow]
    refused: dict[str, int]
    """How many candidates went for which reason."""
    stage_ms: dict[str, float]


class _NotedNetwork:
    """The network, and what it proposed last."""

    def __init__(self, network: Network) -> None:
        self._network = network
        self.boxes: list[NetworkBox] = []

    def run(self, frame_map: FrameMap) -> tuple[NetworkBox, ...]:
        found = self._network.run(frame_map)
        self.boxes += found
        return found


class _NotedCurve:
    """Leaves every candidate the network's word, and notes whom it was asked about last."""

    def __init__(self) -> None:
        self.asked: list[Detection] = []

    def judged(self, candidates: Sequence[Detection], _psf_fwhm_px: float) -> list[Detection]:
        self.asked = list(candidates)
        return list(candidates)

    def highest(self, *_of: object) -> float:
        """None is beyond hope: each is measured."""
        return 1.0


class Judge:
    """The product's detector with its network, watched. Not for use by two threads at once."""

    def __init__(self, network: Network | None = None) -> None:
        """``network`` None: the shipped one, on one thread."""
        self._network = _NotedNetwork(network or Network.load(None, 1))
        self._curve = _NotedCurve()
        self._detector = StreakDetector(
            self._network, DetectorConfig(threads=1), cast(ConfidenceCurve, self._curve)
        )

    def row(self, true: TrueFrame) -> FrameRow:
        """Look at one frame."""
        self._network.boxes = []
        self._curve.asked = []
        analysis = self._detector.analyse(true.frame, tau=0.0)
        found = analysis.detections
        asked = self._curve.asked
        met = [trail_of(each, true.trails) for each in asked]
        taken = set(found.detections)
        seen = {index for each, index in zip(asked, met, strict=True) if each in taken}
        trails = [
            TrailRow(
                x_px=round(trail.middle_px[0], 3),
                y_px=round(trail.middle_px[1], 3),
                length_px=round(trail.length_px, 2),
                peak_snr=round(trail.peak_snr, 4),
                is_cut=trail.is_cut,
                lost="" if index in seen else self._where_lost(true, trail, analysis),
            )
            for index, trail in enumerate(true.trails)
        ]
        candidates = [
            CandidateRow(
                measured=_plain(each),
                trail=index,
                is_taken=each in taken,
                error_px=None if index is None else _error_px(each, true.trails[index]),
            )
            for each, index in zip(asked, met, strict=True)
        ]
        return FrameRow(
            kind=true.kind,
            number=true.frame.frame_id,
            psf_px=analysis.stars.median_fwhm_px,
            seeing_px=round(true.content.fwhm_px, 3),
            sky_e=round(true.content.sky_electrons_px, 1),
            stars=len(analysis.stars),
            trails=trails,
            candidates=candidates,
            refused=_counted(found),
            stage_ms={name: round(ms, 1) for name, ms in found.stage_ms.items()},
        )

    def _where_lost(self, true: TrueFrame, trail: TrueTrail, analysis: FrameAnalysis) -> str:
        """Why no candidate lies on this trail."""
        near = [box for box in self._network.boxes if _is_box_on(box, trail)]
        if not near:
            return NOT_PROPOSED
        for rejection in analysis.detections.rejected:
            if _is_on(rejection.detection, trail, BOX_ON_TRAIL_PX):
                return without_figures(text(rejection.reason))
        # Whom the network hardly believes is refused without a record: asked once more.
        box = max(near, key=lambda each: each.confidence)
        measured = Measurements(true.frame, analysis.background, analysis.stars)
        if measured.is_dark(box):
            return text(DARK)
        before = [each for each in self._network.boxes if each.confidence > box.confidence]
        if sum(not measured.is_dark(each) for each in before) >= MOST_FITS:
            return NOT_MEASURED
        measured.measure(replace(box, confidence=1.0))
        reasons = [without_figures(text(rejection.reason)) for rejection in measured.rejected]
        return reasons[0] if reasons else "measured elsewhere"


def features_of(row: FrameRow) -> list[tuple[float, ...]]:
    """What the curve looks at, of each of the frame's candidates."""
    measured = [measured_of(each) for each in row["candidates"]]
    return [confidence_features(each, row["psf_px"], measured) for each in measured]


def confidences_of(row: FrameRow, curve: ConfidenceCurve) -> list[float]:
    """What the product says of each of the frame's candidates with this curve."""
    measured = [measured_of(each) for each in row["candidates"]]
    return [each.confidence for each in curve.judged(measured, row["psf_px"])]


def measured_of(candidate: CandidateRow) -> Detection:
    """The candidate's record, with the network's own confidence."""
    values = dict(candidate["measured"])
    return Detection(box_px=tuple(values.pop("box_px")), **values)


def trail_of(detection: Detection, trails: tuple[TrueTrail, ...]) -> int | None:
    """Index of the trail that a detection lies on; None: it is no satellite."""
    return next(
        (at for at, trail in enumerate(trails) if _is_on(detection, trail, ON_TRAIL_PX)), None
    )


def without_figures(reason: str) -> str:
    """A reason in words alone, so that equal ones can be counted."""
    bare = re.sub(r"\([^)]*\)|:? ?signal to noise [^:]*$", "", reason)
    bare = re.sub(r"\d+(\.\d+)?( %)?", "#", bare)
    return re.sub(r"\s+", " ", bare).replace(" :", ":").strip()


def _is_on(detection: Detection, trail: TrueTrail, within_px: float) -> bool:
    """Whether it lies on the trail's line, between its ends, and runs along it."""
    dx, dy = trail.x_b_px - trail.x_a_px, trail.y_b_px - trail.y_a_px
    return _lies(
        (detection.x_px, detection.y_px, detection.angle_deg, detection.length_px),
        (*trail.middle_px, math.degrees(math.atan2(dy, dx)), trail.length_px),
        within_px,
    )


def _is_box_on(box: NetworkBox, trail: TrueTrail) -> bool:
    x, y = 0.5 * (box.x_a_px + box.x_b_px), 0.5 * (box.y_a_px + box.y_b_px)
    dx, dy = trail.x_b_px - trail.x_a_px, trail.y_b_px - trail.y_a_px
    return _lies(
        (x, y, box.angle_deg, box.length_px),
        (*trail.middle_px, math.degrees(math.atan2(dy, dx)), trail.length_px),
        BOX_ON_TRAIL_PX,
    )


def _lies(
    one: tuple[float, float, float, float],
    true: tuple[float, float, float, float],
    within_px: float,
) -> bool:
    """x, y of the middle, direction (deg) and length of a candidate and of the truth."""
    x, y, angle_deg, length_px = one
    true_x, true_y, true_deg, true_px = true
    turn = turn_deg(angle_deg, true_deg)
    if turn > 10.0 + math.degrees(within_px / max(min(length_px, true_px), 1.0)):
        return False
    cos, sin = math.cos(math.radians(true_deg)), math.sin(math.radians(true_deg))
    dx, dy = x - true_x, y - true_y
    along, across = abs(dx * cos + dy * sin), abs(dy * cos - dx * sin)
    return across <= within_px and along <= 0.5 * true_px + within_px


def _error_px(detection: Detection, trail: TrueTrail) -> float | None:
    if trail.is_cut or detection.is_clipped:
        return None
    x, y = trail.middle_px
    return round(math.hypot(detection.x_px - x, detection.y_px - y), 4)


def _plain(detection: Detection) -> dict[str, Any]:
    return {name: _rounded(value) for name, value in asdict(detection).items()}


def _rounded(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_rounded(each) for each in value]
    return float(f"{value:.7g}") if isinstance(value, float) else value


def _counted(found: Detections) -> dict[str, int]:
    counted: dict[str, int] = {}
    for rejection in found.rejected:
        reason = without_figures(text(rejection.reason))
        counted[reason] = counted.get(reason, 0) + 1
    return counted
