"""A solved frame as it is compared with others: its pixels, stars and plate."""

from dataclasses import dataclass

import numpy as np

from rsoconsole.reasons import NotAStreak
from rsoconsole.records import Detection, FloatArray, Frame, Solution
from rsoconsole.sky import pixel_to_sky, sky_to_pixel
from rsoconsole.vision.lines import Box
from rsoconsole.vision.stars import StarList
from rsoconsole.vision.streaks import Compared


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SolvedField:
    """A solved frame."""

    frame: Frame
    stars: StarList
    solution: Solution
    streaks: tuple[Detection, ...] = ()
    """What was detected in it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Word:
    """What a comparison says of a streak."""

    comparison: Compared | None = None
    reason: NotAStreak | None = None
    """Why it is none."""


def to_field(
    here: SolvedField, other: SolvedField, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The same places of the sky in another frame."""
    return sky_to_pixel(other.solution.wcs, *pixel_to_sky(here.solution.wcs, x, y))


def places_px(stars: StarList) -> FloatArray:
    """(n, 2) of x, y."""
    return np.stack([stars.x_px, stars.y_px], axis=1)


def ends_of(streak: Detection) -> Box:
    """x_a, y_a, x_b, y_b in pixels."""
    return streak.x_a_px, streak.y_a_px, streak.x_b_px, streak.y_b_px
