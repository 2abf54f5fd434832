"""Class, pulse and train of each of a frame's streaks."""

import logging
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rsoconsole.records import Detection, Frame, NotAStreak, Rejection
from rsoconsole.sky import line_angle_deg
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.frame.median import quantiles_of
from rsoconsole.vision.lines.segments import Ends
from rsoconsole.vision.stars.star_list import StarList
from rsoconsole.vision.streaks._streak_light import (
    StreakLight,
    fading_of,
    light_along,
    modulation_of,
)
from rsoconsole.vision.streaks.class_probabilities import (
    ClassEvidence,
    Likelihood,
    most_likely_class,
    probabilities_from_evidence,
)

MIN_CUT, MIN_WHOLE = 2, 3
"""Fewest lines of a train: 2 where the frame cuts at least two of them, 3 elsewhere."""
SLOWEST_DEG_S = 0.05
"""Least rate of a whole train, deg/s: slower ones are neighbours in a slot."""
_PARALLEL_DEG, _SIGMAS = 1.0, 4.0
_SAME_LENGTH = 0.15
_LIGHTS_APART = 0.5
"""Largest distance of the lights of one aircraft, over the length of its trail."""
_TRAIN = ("satellite", "undetermined")


def corrected_by_neighbours(
    streaks: Sequence[Detection], deg_s_per_px: float | None = None
) -> list[Detection]:
    """Correct the class and train of each streak by the other streaks of the frame.

    - A streak near an aircraft and parallel to it is another of its lights.
    - Parallel streaks that may be satellites are a train. Streaks with both ends in the frame count
      only where ``deg_s_per_px`` (scale over exposure) shows them faster than ``SLOWEST_DEG_S``.
    """
    seen = [_as_its_light(each, streaks) for each in streaks]
    may_be = [
        each
        for each in seen
        if each.object_class in _TRAIN
        and each.method != "operator"
        and (each.kind != "streak" or each.length_px * (deg_s_per_px or 0.0) > SLOWEST_DEG_S)
    ]
    return [replace(each, train=_train(each, may_be)) for each in seen]


def _as_its_light(one: Detection, streaks: Sequence[Detection]) -> Detection:
    if one.object_class not in _TRAIN or one.method == "operator":
        return one
    beside = [
        other.class_probability
        for other in streaks
        if other.object_class == "aircraft" and _is_parallel(one, other) and _is_near(one, other)
    ]
    if not beside:
        return one
    return replace(one, object_class="aircraft", class_probability=max(beside))


def _train(one: Detection, streaks: Sequence[Detection]) -> int:
    if one not in streaks:
        return 0
    alike = [
        each
        for each in streaks
        if each is one or (_is_parallel(one, each) and _is_as_long(one, each))
    ]
    is_cut = sum(each.kind != "streak" for each in alike) >= MIN_CUT
    return len(alike) if len(alike) >= (MIN_CUT if is_cut else MIN_WHOLE) else 0


def _is_parallel(one: Detection, other: Detection) -> bool:
    """True where they run alike, as far as both directions are known."""
    error = math.hypot(one.sigma_angle_deg or 0.0, other.sigma_angle_deg or 0.0)
    return line_angle_deg(one.angle_deg, other.angle_deg) < _PARALLEL_DEG + _SIGMAS * error


def _is_as_long(one: Detection, other: Detection) -> bool:
    """True where their lengths agree; a streak cut by the frame may be as long."""
    if "streak" not in {one.kind, other.kind} or one.kind != other.kind:
        return True
    longer = max(one.length_px, other.length_px)
    return abs(one.length_px - other.length_px) < _SAME_LENGTH * longer


def _is_near(one: Detection, other: Detection) -> bool:
    apart_px = math.hypot(one.x_px - other.x_px, one.y_px - other.y_px)
    return apart_px < _LIGHTS_APART * max(one.length_px, other.length_px)


log = logging.getLogger(__name__)

_ON_LINE_FWHM = 0.5
_PULSE_SNR = 25.0
"""Signal to noise of the summed light from which a pulse of half its depth would show."""
_PER_QUARTILES = 0.7413
"""Sigma of a normal law over the distance of its quartiles."""
_MIN_STARS = 8
_UNKNOWN_SCATTER = 0.25
CONTINUOUS_CLASSES = ("satellite", "aircraft", "undetermined")
"""Classes that may shine during the whole exposure, so that places along a streak are times."""


def classify_streaks(
    frame: Frame,
    sky: Background,
    stars: StarList,
    detections: Iterable[Detection],
    rejected: Iterable[Rejection] = (),
) -> tuple[list[Detection], list[Rejection], Mapping[Detection, Likelihood]]:
    """Give the streaks of a frame their class, pulse and train; order is kept.

    Returns the detections, the rejections, and the probabilities of all classes by streak (before
    the correction by neighbours). Streaks drawn by the operator, and those without a width, keep
    their class. A streak whose examination fails stays as it is, without probabilities; nothing is
    raised.
    """
    per_px = None
    if frame.scale_arcsec_px is not None and frame.exposure_s:
        per_px = frame.scale_arcsec_px / 3600.0 / frame.exposure_s
    named = [_named(frame, sky, stars, each) for each in detections]
    found = corrected_by_neighbours([streak for streak, _ in named], per_px)
    rejected = list(rejected)
    doubted = [_named(frame, sky, stars, each.detection, each) for each in rejected]
    others = [
        replace(each, detection=streak) for each, (streak, _) in zip(rejected, doubted, strict=True)
    ]
    shares = {
        streak: of_all
        for streak, of_all in (*zip(found, (of_all for _, of_all in named), strict=True), *doubted)
        if of_all is not None
    }
    return found, others, shares


def _named(
    frame: Frame,
    sky: Background,
    stars: StarList,
    streak: Detection,
    rejection: Rejection | None = None,
) -> tuple[Detection, Likelihood | None]:
    if streak.method == "operator" or streak.width_px <= 0.0:
        return streak, None
    against = rejection.reason if rejection is not None else None
    kind = against.kind if isinstance(against, NotAStreak) else ""
    try:
        return _looked_at(frame, sky, stars, streak, kind)
    except Exception:
        # A name must not cost the detection.
        log.exception("frame %d: no class for %s", frame.frame_id, streak)
        return streak, None


def _looked_at(
    frame: Frame, sky: Background, stars: StarList, streak: Detection, against: str
) -> tuple[Detection, Likelihood]:
    ends = (streak.x_a_px, streak.y_a_px, streak.x_b_px, streak.y_b_px)
    light = light_along(frame.pixels, sky, ends, streak.width_px)
    pulse = None if light is None else modulation_of(light)
    evidence = ClassEvidence(
        kind=streak.kind,
        length_px=streak.length_px,
        width_px=streak.width_px,
        snr=streak.snr,
        star_fwhm_px=stars.fwhm_at(streak.x_px, streak.y_px),
        star_scatter=_scatter(stars),
        unevenness=streak.unevenness,
        scale_arcsec_px=frame.scale_arcsec_px,
        exposure_s=frame.exposure_s,
        aperture_m=_aperture_m(frame),
        fading=fading_of(frame.pixels, sky, ends, streak.width_px),
        modulation=pulse,
        is_pulse_seen=light is not None and _is_bright(light),
        star_share=None if light is None else _star_share(stars, ends, light),
        spoken_against=against,
    )
    shares = probabilities_from_evidence(evidence)
    name, probability = most_likely_class(shares)
    period_s = None
    if (
        pulse is not None
        and streak.kind == "streak"
        and frame.exposure_s
        and name in CONTINUOUS_CLASSES
    ):
        period_s = frame.exposure_s / pulse.periods
    named_so = replace(
        streak,
        object_class=name,
        class_probability=probability,
        modulation_period_px=None if pulse is None else pulse.period_px,
        modulation_period_s=period_s,
        modulation_depth=None if pulse is None else pulse.depth,
    )
    return named_so, shares


def _is_bright(light: StreakLight) -> bool:
    return light.mean_adu * math.sqrt(light.light_adu.size) > _PULSE_SNR * light.sigma_adu


def _scatter(stars: StarList) -> float:
    """Relative scatter of single stars' widths about those expected at their places.

    They differ with their light, and over the field where that is not known.
    """
    widths = stars.fwhm_px
    if stars.psf_field is not None:
        widths = widths / stars.expected_fwhm_px()
    widths = widths[~stars.is_saturated]
    if widths.size < _MIN_STARS:
        return _UNKNOWN_SCATTER
    low, high = quantiles_of(np.log(np.maximum(widths, 0.1)), (0.25, 0.75))
    return _PER_QUARTILES * (high - low)


def _star_share(stars: StarList, ends: Ends, light: StreakLight) -> float | None:
    """Share of a streak's light in separately detected stars on it."""
    total = float(light.light_adu.sum())
    if total <= 0.0 or stars.trail is not None:
        return None
    x_a, y_a, x_b, y_b = ends
    length = math.hypot(x_b - x_a, y_b - y_a)
    dx, dy = (x_b - x_a) / length, (y_b - y_a) / length
    u = (stars.x_px - x_a) * dx + (stars.y_px - y_a) * dy
    v = (stars.y_px - y_a) * dx - (stars.x_px - x_a) * dy
    near_px = _ON_LINE_FWHM * light.fwhm_px
    is_on = (np.abs(v) < near_px) & (u > -near_px) & (u < length + near_px)
    return min(float(stars.flux[is_on].sum()) / total, 1.0)


def _aperture_m(frame: Frame) -> float | None:
    """Aperture of the telescope by the header (APTDIA, mm), m; None where it has none."""
    try:
        diameter_m = float(frame.header.get("APTDIA", 0.0)) / 1e3
    except (OverflowError, TypeError, ValueError):
        return None
    return diameter_m if 0.0 < diameter_m < 100.0 else None
