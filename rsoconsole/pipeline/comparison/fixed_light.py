"""Comparison of a solved frame's streaks with the frame before it and the star catalogue.

One frame alone cannot separate a flashing streak from stars in a row. Light that an earlier frame
shows at the same places of the sky, or that catalogue stars explain, is not a satellite's; light
that is in neither is not a star's. Light at the same pixels while the sky moves is the sensor's
own, unless it may belong to an object that the telescope keeps pace with. Frames are compared in
the order of the record.
"""

import logging
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.base import RsoconsoleError
from rsoconsole.pipeline.comparison.look_back import (
    FramePair,
    SolvedField,
    StreakComparison,
    star_positions_px,
    streak_ends_px,
)
from rsoconsole.records import (
    BelowTau,
    Detection,
    Detections,
    FloatArray,
    Frame,
    NotAStreak,
    NotAStreakKind,
    Rejection,
    Solution,
)
from rsoconsole.sky import J2000_JYEAR, StarCatalogue, Stars, julian_year, sky_to_pixel
from rsoconsole.vision import (
    CONTINUOUS_CLASSES,
    MIN_MATCHED,
    PRIOR,
    Comparison,
    FrameAnalysis,
    Likelihood,
    compare_with_catalogue_stars,
    corrected_by_neighbours,
    is_same_streak,
    match_stars,
    most_likely_class,
    update_probabilities,
)

_COMPLETE_MAG = 10.0
"""Magnitude to which the catalogue is complete for a camera without a filter, red stars apart."""
_WIDEST_DEG = 4.0
"""Half a field's diagonal up to which the catalogue is used."""
_BRIGHTEST, _MAX_STARS = slice(80), 1500
"""Brightest stars of a frame that are matched, and largest number of the catalogue's."""


def catalogue_stars(
    frame: Frame, solution: Solution, most: int, catalogue: StarCatalogue | None = None
) -> tuple[FloatArray, Stars] | None:
    """Return pixels (n, 2) of the catalogue stars in a frame, and the stars, the brightest first.

    ``most``: largest n; ``catalogue``: None for the shipped stars. Returns None where the field is
    too wide; raises RsoconsoleError where the catalogue cannot be read.
    """
    diagonal_px = math.hypot(frame.width_px, frame.height_px)
    radius_deg = 0.5 * diagonal_px * solution.scale_arcsec_px / 3600.0
    if radius_deg > _WIDEST_DEG:
        return None
    if catalogue is None:
        catalogue = StarCatalogue.load()
        if not catalogue.covers(solution.dec_icrs_deg, radius_deg):
            catalogue = StarCatalogue.load_whole_sky()
    t_utc_ns = frame.t_mid_utc_ns
    cone = catalogue.cone(
        solution.ra_icrs_deg % 360.0,
        solution.dec_icrs_deg,
        radius_deg,
        epoch_jyear=J2000_JYEAR if t_utc_ns is None else julian_year(t_utc_ns),
    )
    x, y = sky_to_pixel(solution.wcs, cone.ra_icrs_deg[:most], cone.dec_icrs_deg[:most])
    return np.stack([x, y], axis=1), cone.brightest(most)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KnownStars:
    """Catalogue stars in a frame's field, with the light predicted for each, in ADU."""

    here: SolvedField
    places_px: FloatArray
    light_adu: FloatArray
    complete_adu: float

    @classmethod
    def of(cls, here: SolvedField, catalogue: StarCatalogue | None = None) -> "KnownStars | None":
        """Match a frame's stars with the catalogue.

        None where the field is too wide, or where too few of its stars are in the catalogue.
        """
        known = catalogue_stars(here.frame, here.solution, _MAX_STARS, catalogue)
        if known is None:
            return None
        places, magnitude = known[0], known[1].magnitude
        stars, fwhm = here.stars, here.stars.median_fwhm_px
        bright = np.flatnonzero(~stars.is_saturated)[_BRIGHTEST]
        mine, theirs = match_stars(star_positions_px(stars)[bright], places, max(fwhm, 2.0))
        if len(mine) < MIN_MATCHED:
            return None
        # Magnitude of a star that gives 1 ADU.
        zero_mag = float(np.median(magnitude[theirs] + 2.5 * np.log10(stars.flux[bright][mine])))
        return cls(
            here=here,
            places_px=places,
            light_adu=np.asarray(10.0 ** (-0.4 * (magnitude - zero_mag))),
            complete_adu=10.0 ** (-0.4 * (_COMPLETE_MAG - zero_mag)),
        )

    def compare(self, streak: Detection) -> StreakComparison | None:
        """Compare one streak with the catalogue; None where the result is unclear."""
        light = compare_with_catalogue_stars(
            self.here.frame.pixels,
            self.places_px,
            self.light_adu,
            ends=streak_ends_px(streak),
            width_px=max(streak.width_px, self.here.stars.median_fwhm_px),
            complete_adu=self.complete_adu,
        )
        if light is None or light.finding == "unclear":
            return None
        if light.finding == "no stars":
            return StreakComparison(comparison="no catalogue stars")
        reason = NotAStreak(kind="catalogue stars", value=light.stars)
        return StreakComparison(comparison="catalogue stars", reason=reason)


log = logging.getLogger(__name__)

MAX_LOOKS = 8
FIXED_CONFIDENCE = 0.02
"""Factor on the confidence of a streak that is fixed in the sky or on the sensor."""
_LED_TO: dict[NotAStreakKind, Comparison | None] = {
    "fixed in the sky": "same light",
    "catalogue stars": "catalogue stars",
    "fixed on the sensor": None,
}
"""Comparison that belongs to each reason; None for the sensor's own light."""
_NOTHING = StreakComparison()


class FrameComparison:
    """Comparison of each solved frame with the solved frame before it, whose pixels are kept."""

    def __init__(self) -> None:
        self.before: SolvedField | None = None
        """The last solved frame; None before there is one."""

    def compared_detections(
        self, frame: Frame, analysis: FrameAnalysis, solution: Solution
    ) -> Detections:
        """Return the frame's detections with the results of the comparison; raise nothing.

        ``frame``: with the pixels that ``analysis`` was made from. Call it once for each frame, in
        the order of the record.
        """
        here = SolvedField(
            frame=frame,
            stars=analysis.stars,
            solution=solution,
            streaks=analysis.detections.detections,
        )
        before, self.before = self.before, here
        asked = _worth_a_look(analysis)
        return _after(here, analysis, lambda: compare_streaks(here, before, asked))


class RecordedComparison:
    """Stand-in comparison for a frame that is reduced again without the frame before it.

    It takes the results of the comparison from the frame's recorded rejections.
    """

    before = None

    def __init__(self, recorded: Detections | None) -> None:
        """``recorded``: the detections recorded for that frame; None where it was never reduced."""
        rejected = () if recorded is None else recorded.rejected
        self._fixed = [
            each
            for each in rejected
            if isinstance(each.reason, NotAStreak) and each.reason.kind in _LED_TO
        ]

    def compared_detections(
        self, frame: Frame, analysis: FrameAnalysis, solution: Solution
    ) -> Detections:
        """Return the detections with the recorded results and a new catalogue comparison."""
        here = SolvedField(frame=frame, stars=analysis.stars, solution=solution)
        asked = _worth_a_look(analysis)
        return _after(
            here, analysis, lambda: compare_streaks(here, None, asked) | self._words(asked)
        )

    def _words(self, streaks: list[Detection]) -> dict[Detection, StreakComparison]:
        words: dict[Detection, StreakComparison] = {}
        for each in streaks:
            for one in self._fixed:
                reason = one.reason
                if isinstance(reason, NotAStreak) and is_same_streak(each, one.detection):
                    words[each] = StreakComparison(comparison=_LED_TO[reason.kind], reason=reason)
        return words


def _after(
    here: SolvedField,
    analysis: FrameAnalysis,
    compare: Callable[[], dict[Detection, StreakComparison]],
) -> Detections:
    """Return the frame's streaks after a comparison; unchanged where the comparison fails."""
    found = analysis.detections
    try:
        words = compare()
        return (
            apply_comparisons(found, words, analysis.class_shares, here.frame) if words else found
        )
    except Exception:
        # A look beside the frame must not cost the frame.
        log.exception("frame %d: its streaks are not compared", here.frame.frame_id)
        return found


def _worth_a_look(analysis: FrameAnalysis) -> list[Detection]:
    """Return the detections, and the candidates that another tau would accept."""
    found = analysis.detections
    below = [r.detection for r in found.rejected if isinstance(r.reason, BelowTau)]
    seen = [each for each in (*found.detections, *below) if each.width_px > 0.0]
    return seen[:MAX_LOOKS]


def compare_streaks(
    here: SolvedField, before: SolvedField | None, streaks: list[Detection]
) -> dict[Detection, StreakComparison]:
    """Compare streaks with the frame before; without a clear result, with the catalogue.

    Returns the clear results by streak; empty without streaks or where the stars are trailed.
    ``before``: None to compare with the catalogue alone.
    """
    if not streaks or here.stars.trail is not None:
        return {}
    words: dict[Detection, StreakComparison] = {}
    back = None if before is None else FramePair.of(here, before)
    if back is not None:
        words = {each: word for each in streaks if (word := back.compare(each)) is not None}
    left = [each for each in streaks if each not in words]
    known = None
    try:
        known = KnownStars.of(here) if left else None
    except RsoconsoleError as error:  # what the frame before says stands
        log.warning(
            "frame %d: its streaks are held against no star: %s", here.frame.frame_id, error
        )
    if known is not None:
        words |= {each: word for each in left if (word := known.compare(each)) is not None}
    return words


def apply_comparisons(
    found: Detections,
    words: Mapping[Detection, StreakComparison],
    shares: Mapping[Detection, Likelihood],
    frame: Frame,
) -> Detections:
    """Return the detections with new classes and rejections by the comparisons. Pure.

    ``words``: result of the comparison by streak; ``shares``: likelihood of the classes by
    streak.
    """
    kept: list[Detection] = []
    rejected: list[Rejection] = []
    for each in found.detections:
        word = words.get(each, _NOTHING)
        renamed = _renamed(each, word, shares, frame)
        if word.reason is None:
            kept.append(renamed)
        else:
            rejected.append(Rejection(detection=renamed, reason=word.reason))
    for one in found.rejected:
        word = words.get(one.detection, _NOTHING)
        renamed = _renamed(one.detection, word, shares, frame)
        rejected.append(Rejection(detection=renamed, reason=word.reason or one.reason))
    rejected.sort(key=lambda each: -each.detection.confidence)
    per_px = None
    if frame.scale_arcsec_px is not None and frame.exposure_s:
        per_px = frame.scale_arcsec_px / 3600.0 / frame.exposure_s
    detections = tuple(corrected_by_neighbours(kept, per_px))
    return replace(found, detections=detections, rejected=tuple(rejected))


def _renamed(
    streak: Detection, word: StreakComparison, shares: Mapping[Detection, Likelihood], frame: Frame
) -> Detection:
    if word == _NOTHING:
        return streak
    before = shares.get(streak, PRIOR)
    if word.reason is None and most_likely_class(before) != (
        streak.object_class,
        streak.class_probability,
    ):
        return streak  # its company has named it
    after = PRIOR if word.comparison is None else update_probabilities(before, word.comparison)
    name, probability = most_likely_class(after)
    if word.reason is not None:
        streak = replace(streak, confidence=FIXED_CONFIDENCE * streak.confidence, train=0)
    return replace(
        streak,
        object_class=name,
        class_probability=probability,
        modulation_period_s=_period_s(streak, frame) if name in CONTINUOUS_CLASSES else None,
    )


def _period_s(streak: Detection, frame: Frame) -> float | None:
    """Return the period of its brightness in seconds; None where it is not known."""
    period_px, exposure_s = streak.modulation_period_px, frame.exposure_s
    if streak.kind != "streak" or period_px is None or not exposure_s:
        return None
    known = streak.modulation_period_s
    return exposure_s * period_px / streak.length_px if known is None else known
