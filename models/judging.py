"""Analysis of one frame by the product's detector, compared with its truth: a row of plain numbers.

A row keeps every candidate that passed the fit's gates, with all its measured values, so that a
curve of confidence can be fitted and judged again without analysing the frame again. For every
trail without such a candidate it keeps the stage at which the trail was lost.
"""

import math
import re
from dataclasses import asdict
from typing import Any, TypedDict

from models.frames import Kind, TrueFrame, TrueTrail
from rsoconsole.config import DetectorConfig
from rsoconsole.records import Detection, Detections
from rsoconsole.sky import line_angle_deg
from rsoconsole.vision import (
    Candidate,
    ConfidenceCurve,
    FrameAnalysis,
    LineLight,
    Network,
    NetworkBox,
    PointImage,
    PsfField,
    StreakDetector,
    WorkingFrame,
    confidence_features,
    detection_in_original_pixels,
)
from rsoconsole.words import text

ON_TRAIL_PX, _ON_TRAIL_WIDTHS = 5.0, 0.6
BOX_ON_TRAIL_PX = 16.0
NOT_PROPOSED = "not proposed"


class TrailRow(TypedDict):
    """One true trail, with the reason why the detector lost it, if it did."""

    x_px: float
    y_px: float
    length_px: float
    peak_snr: float
    is_cut: bool
    lost: str
    """Reason why no candidate lies on the trail; empty where one does."""


class CandidateRow(TypedDict):
    """One candidate, as input for the curve of confidence."""

    measured: dict[str, Any]
    """The ``Detection`` in pixels of the working frame, with the network's own confidence.

    The row's ``focus`` says how many pixels of the frame are joined to one of these.
    """
    light: dict[str, Any]
    """The candidate's ``LineLight``: how even its light is along the line."""
    trail: int | None
    """Index of the trail on which the candidate lies; None: on none."""
    is_taken: bool
    """False: refused after the fit as one of many trailed stars."""
    error_px: float | None
    """Distance of its midpoint from the trail's; None without a trail or where an edge cuts one."""


class FrameRow(TypedDict):
    """One analysed frame: settings of its truth, trails, candidates, and refusals."""

    kind: Kind
    number: int
    focus: dict[str, Any]
    """The ``Focus`` (how the frame shows stars) as measured by the detector."""
    seeing_px: float
    sky_e: float
    stars: int
    trails: list[TrailRow]
    candidates: list[CandidateRow]
    refused: dict[str, int]
    """Number of refused candidates, by reason."""
    stage_ms: dict[str, float]


class Judge:
    """Runs the product's detector on frames of known truth; not for several threads at once."""

    def __init__(self, network: Network | None = None) -> None:
        """``network``: None for the shipped network on one thread."""
        self._detector = StreakDetector(
            network or Network.load(None, 1), DetectorConfig(threads=1), curve=None
        )

    def row(self, true: TrueFrame) -> FrameRow:
        """Analyse one frame and compare the result with its truth."""
        analysis = self._detector.analyse(true.frame, tau=0.0)
        found, working = analysis.detections, analysis.working
        placed = [working.original_detection(each.found) for each in analysis.candidates]
        # Where stars are wide so is a trail.
        width_px = analysis.focus.fwhm_px * analysis.focus.joined
        within_px = max(ON_TRAIL_PX, _ON_TRAIL_WIDTHS * width_px)
        met = [trail_of(each, true.trails, within_px) for each in placed]
        taken = {_place_of(each) for each in found.detections}
        seen = {index for each, index in zip(placed, met, strict=True) if _place_of(each) in taken}
        trails = [
            TrailRow(
                x_px=round(trail.middle_px[0], 3),
                y_px=round(trail.middle_px[1], 3),
                length_px=round(trail.length_px, 2),
                peak_snr=round(trail.peak_snr, 4),
                is_cut=trail.is_cut,
                lost="" if index in seen else _where_lost(trail, analysis),
            )
            for index, trail in enumerate(true.trails)
        ]
        candidates = [
            CandidateRow(
                measured=_plain(each.found),
                light=_plain(each.light),
                trail=index,
                is_taken=_place_of(place) in taken,
                error_px=None if index is None else _error_px(place, true.trails[index]),
            )
            for each, place, index in zip(analysis.candidates, placed, met, strict=True)
        ]
        return FrameRow(
            kind=true.kind,
            number=true.frame.frame_id,
            focus=_plain(analysis.focus),
            seeing_px=round(true.content.fwhm_px, 3),
            sky_e=round(true.content.sky_electrons_px, 1),
            stars=len(analysis.stars),
            trails=trails,
            candidates=candidates,
            refused=_counted(found),
            stage_ms={name: round(ms, 1) for name, ms in found.stage_ms.items()},
        )


def _place_of(found: Detection) -> tuple[float, ...]:
    """Key that tells one candidate from another, whatever its reason."""
    return found.x_px, found.y_px, found.x_a_px, found.y_a_px


def _where_lost(trail: TrueTrail, analysis: FrameAnalysis) -> str:
    """Reason why no candidate lies on this trail."""
    working = analysis.working
    if not any(_is_box_on(each.box, trail, working) for each in analysis.proposals):
        return NOT_PROPOSED
    for rejection in analysis.detections.rejected:
        if _is_on(rejection.detection, trail, BOX_ON_TRAIL_PX):
            return without_figures(text(rejection.reason))
    return "measured elsewhere"


def features_of(row: FrameRow) -> list[tuple[float, ...]]:
    """Features of each of the frame's candidates, the inputs of a confidence curve."""
    measured, focus = [candidate_of(each) for each in row["candidates"]], focus_of(row)
    return [confidence_features(each, focus, measured) for each in measured]


def confidences_of(row: FrameRow, curve: ConfidenceCurve) -> list[float]:
    """Confidence of each of the frame's candidates, by the product's code with this curve."""
    measured = [candidate_of(each) for each in row["candidates"]]
    return [each.found.confidence for each in curve.with_curve_confidences(measured, focus_of(row))]


def focus_of(row: FrameRow) -> PointImage:
    """How the row's frame shows a star (a ``PointImage``), as the detector measured it."""
    values = dict(row["focus"])
    field = values.pop("psf_field", None)
    if field is not None:
        field = PsfField(**{name: _kept(value) for name, value in field.items()})
    return PointImage(**values, psf_field=field)


def _kept(value: Any) -> Any:
    """A record's tuple, which JSON keeps as a list."""
    return tuple(value) if isinstance(value, list) else value


def candidate_of(row: CandidateRow) -> Candidate:
    """The detector's ``Candidate`` from its row, with the network's own confidence."""
    values = dict(row["measured"])
    found = Detection(box_px=tuple(values.pop("box_px")), **values)
    return Candidate(found=found, light=LineLight(**row["light"]))


def measured_of(row: CandidateRow, focus: dict[str, Any]) -> Detection:
    """The ``Detection`` of a candidate in pixels of the original frame.

    It has the network's own confidence. ``focus``: the frame's, from its row.
    """
    return detection_in_original_pixels(candidate_of(row).found, int(focus["joined"]))


def trail_of(
    detection: Detection, trails: tuple[TrueTrail, ...], within_px: float = ON_TRAIL_PX
) -> int | None:
    """Index of the first true trail on which a detection lies; None: on none.

    ``within_px``: largest distance from the trail.
    """
    return next(
        (at for at, trail in enumerate(trails) if _is_on(detection, trail, within_px)), None
    )


def without_figures(reason: str) -> str:
    """A reason of refusal without its figures, so that equal reasons can be counted."""
    bare = re.sub(r"\([^)]*\)|:? ?signal to noise [^:]*$", "", reason)
    bare = re.sub(r"\d+(\.\d+)?( %)?", "#", bare)
    return re.sub(r"\s+", " ", bare).replace(" :", ":").strip()


def _is_on(detection: Detection, trail: TrueTrail, within_px: float) -> bool:
    """True where it lies on the trail's line, between its ends, and runs along it."""
    dx, dy = trail.x_b_px - trail.x_a_px, trail.y_b_px - trail.y_a_px
    return _lies(
        (detection.x_px, detection.y_px, detection.angle_deg, detection.length_px),
        (*trail.middle_px, math.degrees(math.atan2(dy, dx)), trail.length_px),
        within_px,
    )


def _is_box_on(box: NetworkBox, trail: TrueTrail, working: WorkingFrame) -> bool:
    x, y = (working.to_original_px(place) for place in box.middle_px)
    dx, dy = trail.x_b_px - trail.x_a_px, trail.y_b_px - trail.y_a_px
    return _lies(
        (x, y, box.angle_deg, box.length_px * working.side),
        (*trail.middle_px, math.degrees(math.atan2(dy, dx)), trail.length_px),
        BOX_ON_TRAIL_PX,
    )


def _lies(
    one: tuple[float, float, float, float],
    true: tuple[float, float, float, float],
    within_px: float,
) -> bool:
    """Middle x, y, direction (deg) and length of a candidate and of the truth."""
    x, y, angle_deg, length_px = one
    true_x, true_y, true_deg, true_px = true
    turn = line_angle_deg(angle_deg, true_deg)
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


def _plain(measured: Detection | LineLight | PointImage) -> dict[str, Any]:
    return {name: _rounded(value) for name, value in asdict(measured).items()}


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
