"""A streak's light compared with an earlier frame: was the same light there already, or is it new?

Stars in a row, and other fixed sources, shine at the same places in both frames; moving ones do
not. The light of every column along the line is summed across it in this frame and, at the
corresponding places, in the earlier one. Arrays only: the caller supplies the mapping between
places.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.arrays import BoolArray
from rsoconsole.vision.lines.line_columns import (
    LineColumns,
    offsets_across_px,
    pixels_of_line_places,
    running_mean,
    sum_line_columns,
)
from rsoconsole.vision.lines.segments import Ends, length_of
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA

Mapping2d: TypeAlias = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]
"""Function from pixels (x, y) of this frame to pixels of the earlier one, arrays of one shape."""
EarlierFinding: TypeAlias = Literal["same", "new", "unclear"]

_LONGEST_PX = 1500.0
"""Length beyond which no chain of stars is expected, px."""
_BEYOND, _MAX_BEYOND_PX = 0.25, 60.0
"""Distance that lines are followed beyond the ends: share of streak length, and largest, px."""
_KNOT_PX = 24.0
"""Distance between places that are mapped, px; a plate is straight that far."""
_WHOLE = 0.9
"""Share of the columns that both frames must hold."""
_PER_FWHM = 2.0 * math.sqrt(math.pi) / FWHM_PER_SIGMA
"""Equivalent rows across a line for the noise of a matched sum, over its FWHM."""
_STAR_SIGMA, _STAR_SHARE = 4.0, 0.2
"""Light of the earlier frame that holds a column: sigma of noise, share of this frame's."""
_SURE_SNR, _SAME_SNR = 8.0, 5.0
"""SNR expected of the streak in the earlier frame, required for "new" and for "same"."""
_MAX_FRESH, _MIN_FRESH, _NO_LIGHT, _FRESH_SNR = 0.25, 0.5, 0.05, 4.0
_AS_BRIGHT, _EXPLAINED, _IDENTICAL = (0.6, 1.6), 0.6, 0.75
_LACKING, _LACKING_SNR = 0.6, 3.0
"""Share of an even streak's light, and its SNR, that must lie between bright stars."""
_CALIBRATED = 0.1
"""Share of a star's light by which the two frames may differ."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EarlierLight:
    """Comparison of a streak's light with that at the same places in an earlier frame."""

    amplitude: float
    """How strongly the streak's profile is present in the earlier frame; 0: not, 1: as bright."""
    explained: float
    """Share of the streak's light that the earlier frame has too, column by column."""
    depth_snr: float
    """Signal to noise that the streak would have in the earlier frame."""
    fresh_share: float
    """Share of the streak's light that lies where the earlier frame is dark."""
    fresh_snr: float
    lacking: float
    """Share of an even streak's light, as bright as measured, that is not new; 1: none is new."""
    lacking_snr: float
    beyond_share: float
    """Earlier frame's light on the line beyond the ends that is gone now, over the streak's."""
    beyond_snr: float

    @property
    def is_identical(self) -> bool:
        """True where the light agrees so closely that different stars could hardly make it."""
        is_deep = self.depth_snr >= _SURE_SNR
        return self.finding == "same" and is_deep and self.explained > _IDENTICAL

    @property
    def finding(self) -> EarlierFinding:
        """Outcome: the earlier frame shows the light ("same"), does not ("new"), or "unclear"."""
        is_dark_now = self.beyond_snr > _FRESH_SNR and self.beyond_share > _MAX_FRESH
        has_fresh = self.fresh_snr > _FRESH_SNR and self.fresh_share > _NO_LIGHT
        if (
            self.depth_snr >= _SAME_SNR
            and _AS_BRIGHT[0] < self.amplitude < _AS_BRIGHT[1]
            and self.explained > _EXPLAINED
            and self.fresh_share < _MAX_FRESH
            and self.lacking > _LACKING
            and self.lacking_snr > _LACKING_SNR
            and not (has_fresh or is_dark_now)
        ):
            return "same"
        is_new = self.fresh_share > _MIN_FRESH and self.fresh_snr > _FRESH_SNR
        return "new" if is_new and self.depth_snr >= _SURE_SNR else "unclear"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StreakProfile:
    """A streak's light in its own frame, column by column, for comparison with other frames."""

    ends: Ends
    fwhm_px: float
    u_px: FloatArray
    """(columns,): distance along the line from end a, px; it extends beyond both ends."""
    v_px: FloatArray
    """(rows,): distance across from the line, px."""
    columns: LineColumns

    @classmethod
    def of(cls, pixels: PixelArray, ends: Ends, width_px: float) -> "StreakProfile | None":
        """Measure the light between ``ends`` (x_a, y_a, x_b, y_b); None for too long a line.

        ``width_px``: full width at half maximum across; the largest among the frames to be
        compared.
        """
        length, fwhm = length_of(ends), max(width_px, 1.5)
        if not 1.0 < length < _LONGEST_PX:
            return None
        beyond_px = min(_BEYOND * length, _MAX_BEYOND_PX) + fwhm
        u = np.arange(-math.ceil(beyond_px), math.ceil(length + beyond_px) + 1, dtype=np.float64)
        v = offsets_across_px(fwhm)
        columns = sum_line_columns(pixels, *pixels_of_line_places(ends, u, v[:, None]), v, fwhm)
        return cls(ends=ends, fwhm_px=fwhm, u_px=u, v_px=v, columns=columns)


def compare_with_earlier_frame(
    now: StreakProfile,
    earlier: PixelArray,
    to_earlier: Mapping2d | None,
    *,
    snr: float,
    flux_ratio: float,
) -> EarlierLight | None:
    """Compare a streak's light with the pixels of another frame, ``earlier``.

    - to_earlier: maps pixels of this frame to the other; None: both have the same pixels
    - snr: matched signal to noise of the streak in its own frame
    - flux_ratio: light of a star in the other frame over that in this one

    None where a frame does not hold the line, or no light stands out.
    """
    u, v, fwhm = now.u_px, now.v_px, now.fwhm_px
    if to_earlier is None:
        places = pixels_of_line_places(now.ends, u, v[:, None])
    else:
        places = _mapped(to_earlier, now.ends, u, v)
    before = sum_line_columns(earlier, *places, v, fwhm)
    beyond_b = u - length_of(now.ends)
    is_streak = (u >= -0.5 * fwhm) & (beyond_b <= 0.5 * fwhm)
    is_seen = now.columns.is_inside & before.is_inside
    if np.count_nonzero(is_seen & is_streak) < _WHOLE * np.count_nonzero(is_streak):
        return None
    sigma = before.sigma_adu / flux_ratio
    return _compared(
        (now.columns.light_adu, now.columns.sigma_adu),
        (before.light_adu / flux_ratio, sigma),
        is_streak & is_seen,
        is_seen & ((u < -fwhm) | (beyond_b > fwhm)),
        window=2 * round(0.5 * fwhm) + 1,
        depth_snr=float(snr * now.columns.sigma_adu / sigma),
        even_adu=snr * now.columns.noise_adu * math.sqrt(_PER_FWHM * fwhm / length_of(now.ends)),
    )


def _compared(
    now: tuple[FloatArray, float],
    before: tuple[FloatArray, float],
    is_streak: BoolArray,
    is_beyond: BoolArray,
    *,
    window: int,
    depth_snr: float,
    even_adu: float,
) -> EarlierLight | None:
    """Compare light and its sigma by column, scaled alike to the brightness of this frame's stars.

    ``even_adu``: light of each column of an even streak as bright as the one measured.
    """
    (light, sigma), (earlier, sigma_earlier) = now, before
    smooth, smooth_earlier = running_mean(light, window), running_mean(earlier, window)
    total = float(light[is_streak].sum())
    # What noise adds to a sum of squares is taken away.
    count = int(np.count_nonzero(is_streak))
    power = float((smooth[is_streak] ** 2).sum()) - count * sigma**2 / window
    if total <= 0.0 or power <= 0.0:
        return None
    is_held = smooth_earlier > _STAR_SIGMA * sigma_earlier / math.sqrt(window)
    is_held &= smooth_earlier > _STAR_SHARE * smooth
    is_held = np.convolve(is_held, np.ones(2 * window + 1), mode="same") > 0.0
    both = math.hypot(sigma, sigma_earlier)

    def new_light(of: BoolArray) -> tuple[float, float, int]:
        """Light that is new there, its sigma, and the number of columns."""
        columns = int(np.count_nonzero(of))
        return float((light - earlier)[of].sum()), both * math.sqrt(max(columns, 1)), columns

    def lacking_light(of: BoolArray) -> tuple[float, float]:
        """Signal to noise of an even streak's light that is not new there, and its share."""
        new, noise, columns = new_light(of)
        even = max(even_adu * columns, 1e-9)
        sigma = math.hypot(noise, _CALIBRATED * float(np.abs(earlier[of]).sum()))
        return (even - new) / sigma, 1.0 - new / even

    fresh, fresh_sigma, _ = new_light(is_streak & ~is_held)
    beyond, beyond_sigma, _ = new_light(is_beyond)
    # Between the stars, or over all of it where they leave nothing in between.
    lacking_snr, lacking = max(lacking_light(is_streak & ~is_held), lacking_light(is_streak))
    reached = np.minimum(np.maximum(smooth_earlier, 0.0), np.maximum(smooth, 0.0))[is_streak]
    return EarlierLight(
        amplitude=float((smooth * smooth_earlier)[is_streak].sum()) / power,
        explained=float(reached.sum() / np.maximum(smooth[is_streak], 0.0).sum()),
        depth_snr=depth_snr,
        fresh_share=fresh / total,
        fresh_snr=fresh / fresh_sigma,
        lacking=lacking,
        lacking_snr=lacking_snr,
        beyond_share=-beyond / total,
        beyond_snr=-beyond / beyond_sigma,
    )


def _mapped(
    to_earlier: Mapping2d, ends: Ends, u: FloatArray, v: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The line's pixels (v, u) in the earlier frame: knots mapped, straight between them."""
    knots = np.linspace(u[0], u[-1], max(math.ceil((u[-1] - u[0]) / _KNOT_PX), 1) + 1)
    across = np.array([v[0], v[-1]])[:, None]
    knots_x, knots_y = to_earlier(*pixels_of_line_places(ends, knots, across))
    share = ((v - v[0]) / (v[-1] - v[0]))[:, None]

    def spread(at_knots: FloatArray) -> FloatArray:
        low, high = (np.interp(u, knots, row) for row in at_knots)
        return np.asarray(low + share * (high - low))

    return spread(knots_x), spread(knots_y)
