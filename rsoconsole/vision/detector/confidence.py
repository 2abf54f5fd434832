"""Confidence of a measured candidate, from both networks' log-odds and line fit together.

The first network sees a small map, in which a chain of stars or a cosmic ray can look like a faint
streak. The verifier looks at the image of the line in the raw frame; the line fit tells how wide it
is and how bright. A flash of a distant aircraft can be recognised only by other candidates, on the
same line or parallel and of another length. A logistic curve of all these figures, fitted on frames
with known truth (``models.confidence``), gives a probability.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rsoconsole.base import ModelError
from rsoconsole.records import Detection
from rsoconsole.sky import line_angle_deg
from rsoconsole.vision.detector.measured_detection import Candidate
from rsoconsole.vision.stars.point_image import PointImage

FEATURE_NAMES = (
    "constant",
    "verifier",
    "network",
    "faint",
    "wide",
    "in_line",
    "parallel_unlike",
    "blurred",
    "drifted",
)
"""Names of the inputs of one image kind. All from ``faint`` on are 0 or more and weigh nothing at
0; they speak against a streak, except the last two, which describe how the frame shows stars."""
IMAGE_KINDS = ("", "joined ", "trailed ")
"""Kinds of star image: sharp, so wide that pixels were joined, or drawn out by drift."""
FEATURES = tuple(way + name for way in IMAGE_KINDS for name in FEATURE_NAMES)
"""Names of the curve's inputs; a candidate has those of one image kind, the others are 0."""
MIN_LOGIT = -7.0
"""Least log-odds of the network that counts: the line filter may see what the network misses."""
MAX_LOG_ODDS = 12.0
"""Largest log-odds of the verifier that count, either way."""
MIN_IN_LINE = 2
_FAINT_SNR = 12.0
"""Signal to noise below which chance may draw a line that looks as a streak does."""
_LEAST, _MOST = 1e-7, 1.0 - 1e-7
_SAME_WIDTH, _WIDTH_PER_SNR = 0.05, 1.5
"""Logarithm of width over the stars' that counts for nothing: least, and per inverse SNR."""
_CLEARLY_WIDE, _MAX_WIDE = 0.15, 2.0
_SAME_LINE_PX, _MAX_OFF_LINE_PX, _SAME_LINE_DEG = 2.0, 8.0, 2.0
_CONTEXT_LONG = 4.0
_MUCH_LONGER, _UNLIKE, _BESIDE_DEG, _BRIGHT_SNR = 2.5, 1.08, 1.5, 30.0
"""Ratios of length: alone, beside a bright line; largest angle between, deg; least bright SNR."""
_UNLIKE_WHERE_JOINED = 1.35
"""Ratio of length that suffices beside a bright line where pixels are joined."""
_ENDS_WIDTHS = 4.0
"""Widths of a line by which its length may be wrong where a star lies at an end."""


@dataclass(frozen=True, slots=True)
class ConfidenceCurve:
    """Logistic curve for the confidence: its weights, in the order of ``FEATURES``."""

    weights: tuple[float, ...]

    @classmethod
    def from_card(cls, card: Mapping[str, Any]) -> "ConfidenceCurve":
        """Read the curve from a network's card.

        Raises ModelError when its weights are missing or made for other features.
        """
        try:
            table = card["measured_confidence"]["weights"]
            if set(table) != set(FEATURES):
                odd = ", ".join(sorted(set(table) ^ set(FEATURES)))
                raise ValueError(f"made for other features: {odd}")
            return cls(tuple(float(table[name]) for name in FEATURES))
        except (KeyError, TypeError, ValueError) as error:
            raise ModelError(
                f"the network's card has no curve of measured confidence ({error}): "
                "reinstall rsoconsole, or run models.confidence for your own network"
            ) from error

    def confidence(
        self, candidate: Candidate, focus: PointImage, others: Sequence[Candidate] = ()
    ) -> float:
        """Probability, 0 to 1, that a measured candidate is a real streak.

        ``candidate`` still has the network's confidence. ``others``: the measured candidates of its
        frame, with or without ``candidate`` itself.
        """
        features = confidence_features(candidate, focus, others)
        z = sum(w * f for w, f in zip(self.weights, features, strict=True))
        return 1.0 / (1.0 + math.exp(-min(max(z, -30.0), 30.0)))

    def with_curve_confidences(
        self, candidates: Sequence[Candidate], focus: PointImage
    ) -> list[Candidate]:
        """Return a frame's candidates with the curve's confidence instead of the network's."""
        confidences = [self.confidence(each, focus, candidates) for each in candidates]
        return [each.with_confidence(at) for each, at in zip(candidates, confidences, strict=True)]


def _logit(confidence: float) -> float:
    p = min(max(confidence, _LEAST), _MOST)
    return max(math.log(p / (1.0 - p)), MIN_LOGIT)


def confidence_features(
    candidate: Candidate, focus: PointImage, others: Sequence[Candidate] = ()
) -> tuple[float, ...]:
    """Return the curve's inputs for one candidate, in the order of ``FEATURES``.

    Those of other image kinds are 0. By their names:

    - verifier: its log-odds, at most ``MAX_LOG_ODDS`` either way
    - network: the network's log-odds, at least ``MIN_LOGIT``
    - faint: logarithm of ``_FAINT_SNR`` over the signal to noise
    - wide: logarithm of the width over the stars', drift counted, beyond what noise explains, in
      units of ``_CLEARLY_WIDE``: a galaxy seen from its edge has 1 to 2, a streak hardly ever
    - in_line: 1 where ``MIN_IN_LINE`` other candidates are on its line (two of a slot often are)
    - parallel_unlike: 1 where a parallel one is much longer, or bright and of another length
    - blurred, drifted: logarithms of the side of joined pixels (for wide stars), and of 1 plus the
      length of the trails in star widths
    """
    found, light = candidate.found, candidate.light
    focus = focus.at(found.x_px, found.y_px)
    snr = max(found.snr, 0.1)
    width_px = max(found.width_px, 0.1)
    wide = 0.0
    if not focus.is_guessed:
        wide = math.log(width_px / max(focus.widest_streak_px(found.angle_deg), 0.1))
    leeway = _SAME_WIDTH + _WIDTH_PER_SNR / snr
    unlike = _UNLIKE if focus.joined == 1 else _UNLIKE_WHERE_JOINED
    # Drawn-out stars keep everything company.
    near = others if focus.trail_px == 0.0 else ()
    rest = [other.found for other in near if other is not candidate and _is_clear_line(other)]
    seen = (
        1.0,
        min(max(light.log_odds, -MAX_LOG_ODDS), MAX_LOG_ODDS),
        _logit(found.confidence),
        max(0.0, math.log(_FAINT_SNR * light.confusion / snr)),
        min(max(0.0, wide - leeway) / _CLEARLY_WIDE, _MAX_WIDE),
        float(sum(_is_in_line(found, other) for other in rest) >= MIN_IN_LINE),
        float(any(_is_parallel_unlike(found, other, unlike) for other in rest)),
        *_blur_features(focus),
    )
    before = (0.0,) * (_image_kind(focus) * len(seen))
    return before + seen + (0.0,) * (len(FEATURES) - len(before) - len(seen))


def _image_kind(focus: PointImage) -> int:
    """Place in ``IMAGE_KINDS``."""
    return 2 if focus.trail_px > 0.0 else 1 if focus.joined > 1 else 0


def _blur_features(focus: PointImage) -> tuple[float, float]:
    """Logarithms of the width of the stars and of the length to which drift has drawn them."""
    return math.log(focus.joined), math.log1p(focus.trail_px / max(focus.fwhm_px, 0.1))


def _is_clear_line(other: Candidate) -> bool:
    """True where another candidate is clearly a line of light and not a few stars in a row."""
    found, light = other.found, other.light
    is_line = found.length_px > _CONTEXT_LONG * found.width_px
    is_bright = found.snr / light.confusion > _BRIGHT_SNR
    return is_line and is_bright and light.log_odds >= 0.0


def _is_in_line(one: Detection, other: Detection) -> bool:
    """True where ``other`` lies on the line of ``one``, as far as its direction is known."""
    if line_angle_deg(one.angle_deg, other.angle_deg) > _SAME_LINE_DEG:
        return False
    angle = math.radians(one.angle_deg)
    dx, dy = other.x_px - one.x_px, other.y_px - one.y_px
    along = abs(dx * math.cos(angle) + dy * math.sin(angle))
    across = abs(dy * math.cos(angle) - dx * math.sin(angle))
    # Of a line known evenly all along: sigma of its slope is sqrt(12) of its offset's a length.
    slope_error = 3.0 * math.sqrt(12.0) * one.sigma_across_px / max(one.length_px, 1.0)
    return across < min(_SAME_LINE_PX + slope_error * along, _MAX_OFF_LINE_PX)


def _is_parallel_unlike(one: Detection, other: Detection, unlike: float) -> bool:
    """True where two trails are parallel but surely not of one length: lights of one aircraft.

    Satellites near each other move alike. A trail cut by the frame may be longer.
    """
    if line_angle_deg(one.angle_deg, other.angle_deg) > _BESIDE_DEG:
        return False
    shorter, longer = sorted((one, other), key=lambda each: each.length_px)
    if longer is other and longer.length_px > _MUCH_LONGER * shorter.length_px:
        return True
    sigma_px = 2.0 * math.hypot(one.sigma_along_px, other.sigma_along_px)
    apart_px = longer.length_px - unlike * shorter.length_px
    leeway_px = 0.0 if longer.is_clipped else 3.0 * sigma_px + _ENDS_WIDTHS * shorter.width_px
    return not shorter.is_clipped and apart_px > leeway_px


CALIBRATED_ARCSEC_PX, USABLE_ARCSEC_PX = (0.3, 10.0), (0.3, 250.0)
EXPOSURE_S = (0.05, 60.0)
SMALLEST_PX, LARGEST_PX = (640, 480), (9576, 6388)
"""Longer and shorter side of the smallest and of the largest calibrated frames, px."""
_ROUNDING = 1e-3


def camera_cautions(
    scale_arcsec_px: float | None, exposure_s: float | None, width_px: int, height_px: int
) -> dict[str, str]:
    """Return cautions about a camera outside the calibrated range, by subject.

    Subjects: "scale", "exposure", "size". Empty for a camera inside the range; an unknown scale or
    exposure (None) gives no caution.
    """
    text_of = {
        "scale": _scale_words(scale_arcsec_px),
        "exposure": _exposure_words(exposure_s),
        "size": _size_words(width_px, height_px),
    }
    return {about: words for about, words in text_of.items() if words}


def is_usable_scale(scale_arcsec_px: float) -> bool:
    """True where the detector can be expected to work at this scale, in arcsec per pixel."""
    return _is_within(scale_arcsec_px, USABLE_ARCSEC_PX)


def _scale_words(scale_arcsec_px: float | None) -> str:
    if scale_arcsec_px is None or _is_within(scale_arcsec_px, CALIBRATED_ARCSEC_PX):
        return ""
    low, high = CALIBRATED_ARCSEC_PX
    here = f"{scale_arcsec_px:.3g} arcsec/px"
    if is_usable_scale(scale_arcsec_px):
        return (
            f"{here}: confidence is calibrated for {low:g} to {high:g}; take it as an order of"
            " rank, not as a probability"
        )
    low, high = USABLE_ARCSEC_PX
    return f"{here} is outside the {low:g} to {high:g} that can be used: do not rely on detections"


def _exposure_words(exposure_s: float | None) -> str:
    if exposure_s is None or _is_within(exposure_s, EXPOSURE_S):
        return ""
    low, high = EXPOSURE_S
    return (
        f"exposure {exposure_s:.3g} s: made for {low:g} to {high:g} s; confidence is not calibrated"
    )


def _size_words(width_px: int, height_px: int) -> str:
    longer, shorter = max(width_px, height_px), min(width_px, height_px)
    if longer > LARGEST_PX[0] or shorter > LARGEST_PX[1]:
        return (
            f"{width_px} x {height_px} px is larger than the {LARGEST_PX[0]} x {LARGEST_PX[1]}"
            " that was tested: memory may not suffice"
        )
    if longer < SMALLEST_PX[0] or shorter < SMALLEST_PX[1]:
        return (
            f"{width_px} x {height_px} px is smaller than {SMALLEST_PX[0]} x {SMALLEST_PX[1]}:"
            " confidence is not calibrated"
        )
    return ""


def _is_within(value: float, bounds: tuple[float, float]) -> bool:
    return bounds[0] * (1.0 - _ROUNDING) <= value <= bounds[1] * (1.0 + _ROUNDING)
