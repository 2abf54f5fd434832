"""Comparison of a frame's streaks with the light in the frame before it.

Light at the same place of the sky in both frames is not a satellite's. Light at the same pixels,
while the sky moves, is the sensor's own. An object that the telescope keeps pace with also stays at
its pixels, but its streak has the length and direction of the sky's motion between the frames.
"""

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from rsoconsole.records import Detection, FloatArray, Frame, NotAStreak, Solution
from rsoconsole.sky import line_angle_deg, pixel_to_sky, sky_to_pixel
from rsoconsole.vision import (
    Comparison,
    EarlierLight,
    Ends,
    Mapping2d,
    StarList,
    StreakProfile,
    compare_stars,
    compare_with_earlier_frame,
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SolvedField:
    """Frame with its plate solution, stars and streaks."""

    frame: Frame
    stars: StarList
    solution: Solution
    streaks: tuple[Detection, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class StreakComparison:
    """Result of comparing a streak with earlier light or catalogue stars."""

    comparison: Comparison | None = None
    reason: NotAStreak | None = None
    """Reason why it is no streak; None where it may be one."""


def to_other_frame_px(
    here: SolvedField, other: SolvedField, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the pixels of ``other`` that show the same places as ``x``, ``y`` in ``here``."""
    return sky_to_pixel(other.solution.wcs, *pixel_to_sky(here.solution.wcs, x, y))


def star_positions_px(stars: StarList) -> FloatArray:
    """Pixels of the stars, (n, 2) as x, y."""
    return np.stack([stars.x_px, stars.y_px], axis=1)


def streak_ends_px(streak: Detection) -> Ends:
    """Ends of a streak: x_a, y_a, x_b, y_b in pixels."""
    return streak.x_a_px, streak.y_a_px, streak.x_b_px, streak.y_b_px


_ONE_WAY_DEG, _ONE_LENGTH = 10.0, 1.4
"""Turn and ratio of lengths up to which two streaks belong to one motion."""
_BESIDE_SHARE, _BESIDE_FWHM = 0.12, 2.0
"""Largest distance of a moved streak from its expected place: share of its way, star widths."""


def has_moved_on(streak: Detection, here: SolvedField, before: SolvedField, later_s: float) -> bool:
    """Return True if an earlier streak at the place of ``streak`` has moved to another place.

    The earlier object is then another streak of ``here``, further along its line, and ``streak``
    may be a new object. ``later_s``: seconds between the mid-exposures of ``before`` and
    ``here``.
    """
    exposure_s = before.frame.exposure_s
    if not exposure_s:
        return False
    way_per_length = later_s / exposure_s
    others = [each for each in here.streaks if each != streak and _is_alike(each, streak)]
    return any(
        _leads(earlier, other, streak, way_per_length, here.stars)
        for earlier in _at_its_place(streak, here, before)
        for other in others
    )


def _is_alike(one: Detection, other: Detection) -> bool:
    if one.kind != "streak" or min(one.length_px, other.length_px) <= 0.0:
        return False
    ratio = one.length_px / other.length_px
    turned = abs(line_angle_deg(one.angle_deg, other.angle_deg))
    return 1.0 / _ONE_LENGTH < ratio < _ONE_LENGTH and turned < _ONE_WAY_DEG


def _at_its_place(
    streak: Detection, here: SolvedField, before: SolvedField
) -> list[tuple[float, float, float]]:
    """Middles (x, y) on this frame, and lengths, of earlier streaks that overlap with it."""
    found = []
    for each in before.streaks:
        if not _is_alike(each, streak):
            continue
        x, y = to_other_frame_px(before, here, np.array([each.x_px]), np.array([each.y_px]))
        if math.hypot(x[0] - streak.x_px, y[0] - streak.y_px) < streak.length_px:
            found.append((float(x[0]), float(y[0]), each.length_px))
    return found


def _leads(
    earlier: tuple[float, float, float],
    other: Detection,
    streak: Detection,
    way_per_length: float,
    stars: StarList,
) -> bool:
    """True where the other streak lies where the earlier streak's own motion has brought it."""
    x, y, length_px = earlier
    way_px = length_px * way_per_length
    dx, dy = other.x_px - x, other.y_px - y
    angle = math.radians(streak.angle_deg)
    along = dx * math.cos(angle) + dy * math.sin(angle)
    across = dy * math.cos(angle) - dx * math.sin(angle)
    beside_px = max(_BESIDE_SHARE * way_px, _BESIDE_FWHM * stars.median_fwhm_px)
    return max(abs(abs(along) - way_px), abs(across)) < beside_px


LATEST_S = 600.0
"""Greatest age, s, of an earlier frame with which a frame is compared."""
_BRIGHTEST = slice(120)
"""Stars of a frame that are matched with the other's."""
_MOVED_PX, _MOVED_FWHM = 4.0, 2.0
"""Least motion of the sky, in px and in widths of a star, that separates it from the sensor."""
_SAME_WAY_DEG, _SAME_LENGTH = 15.0, 2.0
"""Turn and ratio of lengths up to which a streak may be one that the telescope keeps pace with."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FramePair:
    """A frame and the frame before it, ready for the comparison of single streaks."""

    here: SolvedField
    before: SolvedField
    flux_ratio: float
    later_s: float

    @classmethod
    def of(cls, here: SolvedField, before: SolvedField) -> "FramePair | None":
        """Prepare the comparison of two frames; None where they cannot be compared.

        Causes: another size or another field, exposures that overlap or lie too far apart, trailed
        stars in the earlier frame, or stars that disagree.
        """
        later_s = _later_s(here.frame, before.frame)
        is_alike = here.frame.pixels.shape == before.frame.pixels.shape
        if later_s is None or not is_alike or before.stars.trail is not None:
            return None
        bright = np.flatnonzero(~here.stars.is_saturated)[_BRIGHTEST]
        x, y = to_other_frame_px(here, before, here.stars.x_px[bright], here.stars.y_px[bright])
        agree = compare_stars(
            np.stack([x, y], axis=1),
            here.stars.flux[bright],
            star_positions_px(before.stars),
            before.stars.flux,
            before.stars.median_fwhm_px,
        )
        if agree is None or not agree.is_good:
            return None
        return cls(here=here, before=before, flux_ratio=agree.flux_ratio, later_s=later_s)

    def compare(self, streak: Detection) -> StreakComparison | None:
        """Compare one streak with the earlier frame; None where the result is unclear."""
        here, before = self.here, self.before
        width_px = max(streak.width_px, here.stars.median_fwhm_px, before.stars.median_fwhm_px)
        profile = StreakProfile.of(here.frame.pixels, streak_ends_px(streak), width_px)
        if profile is None:
            return None
        light = self._light(
            profile, streak, partial(to_other_frame_px, here, before), self.flux_ratio
        )
        found = "unclear" if light is None else light.finding
        if found == "same" and has_moved_on(streak, here, before, self.later_s):
            return None
        if found == "same":
            return StreakComparison(
                comparison="same light", reason=NotAStreak(kind="fixed in the sky")
            )
        if self._may_be_sensors(streak):
            exposures = (before.frame.exposure_s or 1.0) / (here.frame.exposure_s or 1.0)
            there = self._light(profile, streak, None, exposures)
            if there is not None and there.is_identical:
                return StreakComparison(reason=NotAStreak(kind="fixed on the sensor"))
        return StreakComparison(comparison="new light") if found == "new" else None

    def _light(
        self,
        profile: StreakProfile,
        streak: Detection,
        to_earlier: Mapping2d | None,
        flux_ratio: float,
    ) -> EarlierLight | None:
        pixels = self.before.frame.pixels
        return compare_with_earlier_frame(
            profile, pixels, to_earlier, snr=streak.snr, flux_ratio=flux_ratio
        )

    def _may_be_sensors(self, streak: Detection) -> bool:
        """True where the sky has moved enough, and a moving light is no explanation."""
        x, y = np.array([streak.x_px]), np.array([streak.y_px])
        was_x, was_y = to_other_frame_px(self.before, self.here, x, y)
        # From where the sky that was at its pixels is now: what a light that stayed there has gone.
        dx, dy = float(x[0] - was_x[0]), float(y[0] - was_y[0])
        least_px = max(_MOVED_PX, _MOVED_FWHM * self.here.stars.median_fwhm_px)
        return math.hypot(dx, dy) > least_px and not self._keeps_pace(streak, dx, dy)

    def _keeps_pace(self, streak: Detection, dx: float, dy: float) -> bool:
        """True where a light with this displacement between the frames draws such a streak."""
        angle_deg = math.degrees(math.atan2(dy, dx)) % 180.0
        if line_angle_deg(angle_deg, streak.angle_deg) > _SAME_WAY_DEG:
            return False
        expected_px = math.hypot(dx, dy) * (self.here.frame.exposure_s or 0.0) / self.later_s
        is_as_long = 1.0 / _SAME_LENGTH < streak.length_px / max(expected_px, 0.1) < _SAME_LENGTH
        return streak.is_clipped or is_as_long


def _later_s(frame: Frame, before: Frame) -> float | None:
    """Seconds between the middles of two successive exposures; None where they are not."""
    times = frame.t_start_utc_ns, before.t_start_utc_ns
    if times[0] is None or times[1] is None or not frame.exposure_s or not before.exposure_s:
        return None
    from_start_s = (times[0] - times[1]) / 1e9
    if not before.exposure_s <= from_start_s < LATEST_S:
        return None
    return from_start_s + 0.5 * (frame.exposure_s - before.exposure_s)
