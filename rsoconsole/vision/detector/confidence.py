"""Confidence of a measured candidate, from network's log-odds and line fit together.

The network sees a small map, in which a chain of stars or a cosmic ray can look like a faint
streak. The line fit on the raw frame separates them: a real streak has light all along a line as
wide as stars are. A flash of a distant aircraft can be recognised only by other candidates, on the
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
from rsoconsole.vision.detector.measured_detection import SHARP_PX, Candidate, LineLight, PointImage
from rsoconsole.vision.lines.line_or_points import MAX_FWHM

FEATURE_NAMES = (
    "constant",
    "network",
    "log_snr",
    "steady",
    "extent",
    "one_line",
    "like_line",
    "wide",
    "narrow",
    "shortness",
    "few_points",
    "like_stars",
    "unlike",
    "longness",
    "in_line",
    "parallel_unlike",
    "uneven",
    "faint",
    "rough",
    "confused",
    "along_trails",
    "blurred",
    "drifted",
)
"""Names of the inputs of one image kind. All from ``wide`` on are 0 or more and weigh nothing at 0;
they speak against a streak, except the last two, which describe how the frame shows stars."""
IMAGE_KINDS = ("", "joined ", "trailed ")
"""Kinds of star image: sharp, so wide that pixels were joined, or drawn out by drift."""
FEATURES = tuple(way + name for way in IMAGE_KINDS for name in FEATURE_NAMES)
"""Names of the curve's inputs; a candidate has those of one image kind, the others are 0."""
MIN_LOGIT = -7.0
"""Least log-odds of the network that counts: the line filter may see what the network misses."""
MAX_LOG_SNR, MAX_LOG_STEADY, _MIN_STEADY = 0.3, 1.5, 0.5
_EXTENDED_FWHM, _MAX_EXTENT = 8.0, 2.0
_SURE_OF_LINE, _MAX_ONE_LINE = 10.0, 2.5
"""Chi-square that separates a line from a few points, and the most that its logarithm counts."""
_ROUGH_AS_LINE, _DOUBT_AS_LINE = 50.0, 100.0
"""Chi-square that halves the effect of roughness and of the network's doubt."""
_SURE_OF_IMAGE, _MAX_LIKE, _MAX_UNLIKE = 30.0, 4.0, 3.0
"""Chi-square that tells a line from stars; largest logarithms of it and of a pixel's rest."""
_FULL_WEIGHT_FWHM, _MIN_WEIGHT, _WEIGHT_WHERE_JOINED = 15.0, 0.25, 0.4
_CLEAR_SNR, _CLEAR_FWHM, _MIN_CLEAR = 15.0, 10.0, 0.4
_EVEN_ENOUGH, _EVEN_WHERE_JOINED, _ROUGH_BY_NOISE = 0.06, 0.18, 4.0
"""Scatter along a line by air and sensor, where stars are wide, and by noise at an SNR of 1."""
FAINT_SNR = 12.0
"""Signal to noise below which a chain of faint stars is as likely as a streak."""
SHORT_FWHM, LONG_FWHM = 12.0, 120.0
"""Lengths in widths of a star below and above which streaks are less likely."""
LENGTH_ERROR = 2.0
"""Largest ratio of a streak's length to its proposal's: a fit follows light beyond the ends."""
MAX_IN_LINE = 2
_LEAST, _MOST = 1e-7, 1.0 - 1e-7
_SAME_WIDTH, _WIDTH_PER_SNR = 0.05, 1.5
"""Logarithm of width over the stars' that counts for nothing: least, and per inverse SNR."""
_SAME_LINE_PX, _MAX_OFF_LINE_PX, _SAME_LINE_DEG = 2.0, 8.0, 2.0
_CONTEXT_LONG, _CONTEXT_ROUGH, _CONTEXT_UNEVEN = 4.0, 0.4, 0.8
_MAX_CONFUSED, _OTHER_WAY_DEG = 1.1, 20.0
_SHARP = PointImage(fwhm_px=1.0)
_MUCH_LONGER, _UNLIKE, _BESIDE_DEG, _BRIGHT_SNR = 2.5, 1.08, 1.5, 30.0
"""Ratios of length: alone, beside a bright line; largest angle between, deg; least bright SNR."""
_UNLIKE_WHERE_JOINED = 1.35
"""Ratio of length that suffices beside a bright line where pixels are joined."""


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

    def highest_confidence(
        self, network_confidence: float, proposed_px: float = math.inf, focus: PointImage = _SHARP
    ) -> float:
        """Return the highest confidence, 0 to 1, that a proposal can reach when it is measured.

        ``proposed_px``: length of the proposal; the streak may be ``LENGTH_ERROR`` times as long.
        ``focus``: image of a star at the proposal's place (``PointImage.at``).
        """
        first = _image_kind(focus) * len(FEATURE_NAMES)
        table = dict(zip(FEATURE_NAMES, self.weights[first:], strict=False))
        longest_px = max(LENGTH_ERROR * proposed_px, 0.1)
        psf_px = min(max(focus.fwhm_px, 0.1), SHARP_PX)
        logit, length_fwhm = _logit(network_confidence), longest_px / psf_px
        as_line = _DOUBT_AS_LINE if length_fwhm < MAX_FWHM else 0.0
        weighted = _weighted(logit, length_fwhm, math.inf, focus.joined, as_line)
        z = table["constant"] + table["network"] * weighted
        z += max(table["log_snr"], 0.0) * MAX_LOG_SNR
        z += max(table["steady"], 0.0) * MAX_LOG_STEADY
        z += max(table["extent"], 0.0) * _MAX_EXTENT
        z += max(table["one_line"], 0.0) * _MAX_ONE_LINE
        z += table["shortness"] * math.log(max(SHORT_FWHM * psf_px / longest_px, 1.0))
        blurred, drifted = _blur_features(focus)
        z += table["blurred"] * blurred + table["drifted"] * drifted
        # None of the others speaks for a satellite, but for images of the stars: what is short and
        # like them the star search sees as well.
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


def _weighted(
    logit: float, length_fwhm: float, steady: float, joined: int, as_line: float
) -> float:
    """Network's log-odds, reduced where pixels were joined: it knows stars that are points.

    Its doubt also counts less for lines longer than its map shows well, and for a line that every
    part of it shows clearly or, where that is significant (``as_line``), that one line explains
    better than points.
    """
    word = logit if joined == 1 else _WEIGHT_WHERE_JOINED * logit
    if word >= 0.0:
        return word
    clear = math.sqrt(_CLEAR_SNR / max(steady, 0.1)) if length_fwhm > _CLEAR_FWHM else 1.0
    word *= min(max(clear, _MIN_CLEAR), 1.0)
    word /= 1.0 + as_line / _DOUBT_AS_LINE
    return word * min(max(_FULL_WEIGHT_FWHM / max(length_fwhm, 0.1), _MIN_WEIGHT), 1.0)


def confidence_features(
    candidate: Candidate, focus: PointImage, others: Sequence[Candidate] = ()
) -> tuple[float, ...]:
    """Return the curve's inputs for one candidate, in the order of ``FEATURES``.

    Those of other image kinds are 0. By their names:

    - network: the network's log-odds, at least ``MIN_LOGIT``
    - log_snr: logarithm of the matched signal to noise over 20, at most ``MAX_LOG_SNR``, since a
      chain of bright stars is bright too
    - steady: the same by the lower quartile of the line's parts, at most ``MAX_LOG_STEADY``; small
      for stars in a row
    - extent: logarithm of the length over some star widths
    - one_line, few_points: how much better one line, or a few points, explain a short profile
    - like_line, like_stars: how much better one line, or star images, explain the pixels
    - wide, narrow: logarithm of the width over the stars', beyond what noise explains
    - shortness, longness: logarithms of the length against ``SHORT_FWHM`` and ``LONG_FWHM``
    - unlike: logarithm of the chi-square per pixel that the fitted line leaves (``LineLight.left``)
    - in_line: number of other candidates on its line
    - parallel_unlike: 1 where a parallel one is much longer, or bright and of another length
    - uneven: how bent its path is
    - faint: logarithm of ``FAINT_SNR`` over its signal to noise
    - rough: scatter along the line that nothing explains
    - confused: how much the sky beside it scatters
    - along_trails: 1 along the stars' trails, less the more it turns away from them; 0 where stars
      are points
    - blurred, drifted: logarithms of the side of joined pixels (for wide stars), and of 1 plus the
      length of the trails in star widths
    """
    found, light = candidate.found, candidate.light
    focus = focus.at(found.x_px, found.y_px)
    psf_px, length_px = max(focus.fwhm_px, 0.1), max(found.length_px, 0.1)
    # What widens the stars alone, like a shaken mount, does not make a line any shorter.
    unit_px = min(max(found.width_px, SHARP_PX), psf_px)
    snr = max(found.snr, 0.1)
    steady = max(light.lower_quartile_snr, _MIN_STEADY)
    width_px = max(found.width_px, 0.1)
    like = _like_image(light)
    as_line, as_points = max(light.over_points, 0.0), max(-light.over_points, 0.0)
    # Where stars are sharp points a cosmic ray is a line as well, but not like the stars' images.
    no_ray = 0.0 if _image_kind(focus) == 0 else as_line
    wide = math.log(width_px / max(focus.widest_streak_px(found.angle_deg), 0.1))
    narrow = math.log(min(psf_px, SHARP_PX) / width_px)
    leeway = _SAME_WIDTH + _WIDTH_PER_SNR / snr
    is_sharp = focus.joined == 1
    even = _EVEN_ENOUGH if is_sharp else _EVEN_WHERE_JOINED
    unlike = _UNLIKE if is_sharp else _UNLIKE_WHERE_JOINED
    # Drawn-out stars keep everything company.
    near = others if focus.trail_px == 0.0 else ()
    rest = [other.found for other in near if other is not candidate and _is_clear_line(other)]
    seen = (
        1.0,
        _weighted(
            _logit(found.confidence), length_px / unit_px, steady, focus.joined, max(no_ray, like)
        ),
        min(math.log(snr / 20.0), MAX_LOG_SNR),
        min(math.log(steady / 20.0), MAX_LOG_STEADY),
        min(max(0.0, math.log(length_px / unit_px / _EXTENDED_FWHM)), _MAX_EXTENT),
        min(math.log1p(no_ray / _SURE_OF_LINE), _MAX_ONE_LINE),
        min(math.log1p(max(light.over_stars, 0.0) / _SURE_OF_IMAGE), _MAX_LIKE),
        max(0.0, wide - leeway),
        max(0.0, narrow - leeway),
        max(0.0, math.log(SHORT_FWHM * unit_px / length_px)),
        min(math.log1p(as_points / _SURE_OF_LINE), _MAX_ONE_LINE),
        min(math.log1p(max(-light.over_stars, 0.0) / _SURE_OF_LINE), _MAX_LIKE),
        min(math.log(max(light.left, 1.0)), _MAX_UNLIKE),
        max(0.0, math.log(length_px / (LONG_FWHM * unit_px))),
        float(min(sum(_is_in_line(found, other) for other in rest), MAX_IN_LINE)),
        float(any(_is_parallel_unlike(found, other, unlike) for other in rest)),
        light.bend / (1.0 + like / _ROUGH_AS_LINE),
        max(0.0, math.log(FAINT_SNR / snr)),
        math.log1p(light.roughness**2 / (even**2 + (_ROUGH_BY_NOISE / snr) ** 2))
        / (1.0 + as_line / _ROUGH_AS_LINE),
        min(math.log(max(light.confusion, 1.0)), _MAX_CONFUSED),
        _along_trails(found, focus) / (1.0 + like / _ROUGH_AS_LINE),
        *_blur_features(focus),
    )
    before = (0.0,) * (_image_kind(focus) * len(seen))
    return before + seen + (0.0,) * (len(FEATURES) - len(before) - len(seen))


def _like_image(light: LineLight) -> float:
    """Advantage of a line of star images in explaining a light, less where much stays unlike."""
    return max(light.over_stars, 0.0) / max(light.left, 1.0) ** 2


def _image_kind(focus: PointImage) -> int:
    """Place in ``IMAGE_KINDS``."""
    return 2 if focus.trail_px > 0.0 else 1 if focus.joined > 1 else 0


def _along_trails(found: Detection, focus: PointImage) -> float:
    """1 for what runs as the drawn-out stars do, less the more it turns away, 0 from some angle."""
    if focus.trail_px == 0.0:
        return 0.0
    turn = line_angle_deg(found.angle_deg, focus.trail_deg)
    return max(0.0, 1.0 - turn / _OTHER_WAY_DEG)


def _blur_features(focus: PointImage) -> tuple[float, float]:
    """Logarithms of the width of the stars and of the length to which drift has drawn them."""
    return math.log(focus.joined), math.log1p(focus.trail_px / max(focus.fwhm_px, 0.1))


def _is_clear_line(other: Candidate) -> bool:
    """True where another candidate is clearly a line of light and not a few stars in a row."""
    found, light = other.found, other.light
    is_line = found.length_px > _CONTEXT_LONG * found.width_px
    is_even = light.roughness < _CONTEXT_ROUGH and found.unevenness < _CONTEXT_UNEVEN
    return is_line and is_even and found.snr / light.confusion > _BRIGHT_SNR


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
    return not shorter.is_clipped and apart_px > (0.0 if longer.is_clipped else 3.0 * sigma_px)


CALIBRATED_ARCSEC_PX, USABLE_ARCSEC_PX = (1.0, 10.0), (0.3, 250.0)
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
