"""Light of a streak: its image along its path, fitted together with the stars and sky beside it.

The path may bend and the light may change along it. Stars at known places are in the model; what
else shines near the line is found in what the model leaves. A short light on the line itself is a
star where the frame before shows it too, and the object's own where it does not.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.arrays import BoolArray, IndexArray
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.lines.segments import Ends, length_of
from rsoconsole.vision.photometry.star_image import StarImage
from rsoconsole.vision.photometry.streak_strip import StreakStrip
from rsoconsole.vision.photometry.strip_fit import StripFit

_HALF_FWHM, _MIN_HALF_PX = 4.5, 9.0
_MARGIN_FWHM, _MARGIN_SHARE = 3.0, 0.15
"""Length beyond either end: widths, and a share of the length, which may be found too short."""
_BEYOND_SIGMAS = 3.0
"""Light in that share beyond an end that belongs to the streak."""
_MAX_STARS = 30
_ON_LINE_FWHM = 1.0
"""Distance from the line, in widths, within which a light may be the object's own."""
_ROUNDS = 3
_STARS_UNASKED = 2
"""Lights on the line that pass for stars where no frame before says what they are."""
_BLENDED_SHARE = 0.1
_SATURATED = 0.95
_IMAGE_ERROR = 0.02
"""Error of a star's light that its image leaves on the line, as a share of that light."""
_SHAPE_ERROR = 0.008
"""Error of the image of a line against that of a point, as a share of the line's light."""
_EXCESS = 1.2
"""Factor on the noise of the light, by worlds drawn at random (tests/campaign/brightness.py)."""
_CONFUSED = 12.0
"""Largest ratio of variances that one piece of sky beside the line may add to their mean."""
_MAX_STEPS, _MIN_STEPS, _MIN_STEP_SNR = 240, 4, 1.5
_EDGE_SEEN = 0.6
"""Share of the light that must lie within a column at a streak's end for it to count in a step."""

StarThere = Callable[[float, float], bool | None]
"""Whether light was at a place (x, y) before; None where that is not known."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StreakFlux:
    """Light of one streak above stars and sky, ADU."""

    flux_adu: float
    sigma_adu: float
    star_share: float
    """Light of stars on the line over the streak's own."""
    is_saturated: bool
    step_px: FloatArray
    """(steps,) middle of each step from end a, px."""
    step_adu_px: FloatArray
    """(steps,) light of each step, ADU a px of length."""
    step_sigma_adu_px: FloatArray
    length_px: float

    @property
    def is_blended(self) -> bool:
        """True where stars on the line had more than a tenth of its light."""
        return self.star_share > _BLENDED_SHARE


def streak_flux(
    pixels: PixelArray,
    sky: Background,
    image: StarImage,
    ends: Ends,
    *,
    stars_px: FloatArray,
    was_there: StarThere,
    saturation_adu: float,
    scale: float = 1.0,
) -> StreakFlux | None:
    """Measure the light of a streak between ``ends`` (x_a, y_a, x_b, y_b); None outside the frame.

    - image: of a point, without trail: drift and motion add up to one line
    - stars_px: (n, 2) places of stars; those on the line must be known to be stars
    - scale: width of a star there over the frame's median
    """
    fwhm = image.fwhm_px * scale
    half_px = max(_HALF_FWHM * fwhm, _MIN_HALF_PX)
    length = length_of(ends)
    margin_px = _MARGIN_FWHM * fwhm + min(_MARGIN_SHARE * length, 30.0)
    strip = StreakStrip.of(pixels, sky, ends, half_px, margin_px)
    if strip is None:
        return None
    fit = _StripLight(strip, image, scale, fwhm)
    fit.set_stars(_near(strip, stars_px, fwhm))
    fit.follow_path()
    unasked = _STARS_UNASKED
    for _ in range(_ROUNDS):
        fit.solve()
        fit.centre_stars()
        found = [
            place
            for place in fit.lights_left()
            if abs(place[1]) > _ON_LINE_FWHM * fwhm
            or (word := was_there(*strip.to_frame_px(*place)))
            or (word is None and (unasked := unasked - 1) >= 0)
        ]
        if not found:
            break
        fit.add_stars(np.array(found))
    else:
        fit.solve()
    return fit.result(saturation_adu)


def _near(strip: StreakStrip, stars_px: FloatArray, fwhm: float) -> FloatArray:
    """(u, v) of the stars whose light reaches the strip."""
    if not len(stars_px):
        return np.zeros((0, 2))
    u, v = strip.to_strip_px(stars_px)
    reach = 2.0 * fwhm
    is_near = (np.abs(v) < strip.half_px + reach) & (u > -strip.margin_px - reach)
    is_near &= u < strip.length_px + strip.margin_px + reach
    return np.stack([u[is_near], v[is_near]], axis=1)[:_MAX_STARS]


class _StripLight(StripFit):
    """Sum of the light along the path, once all parts are solved."""

    def result(self, saturation_adu: float) -> StreakFlux:
        """Sum the light along the path, with stars and sky taken away."""
        strip, noise = self.strip, self.strip.noise_adu
        clean = strip.light_adu - self.of_stars - self.of_sky
        profile = self._profile(self.v_px, self.scale)
        column, count = strip.bins()
        # What stands out on the line is the object's own flash; beside it a cosmic ray.
        is_sound = (self.weights * (noise**2) > 0.1) | (np.abs(self.v_px) < 1.5 * self.fwhm)
        weight = profile * is_sound
        norm = _binned(column, weight * profile, count)
        is_known = norm > 0.3 * float(np.median(norm[norm > 0.0], axis=0))
        safe = np.where(is_known, norm, 1.0)
        seen = _binned(column, weight * clean, count) / safe
        modelled = _binned(column, weight * self.of_line, count) / np.maximum(norm, 1e-12)
        along = np.where(is_known, seen, modelled)
        variance = np.where(is_known, noise**2 / safe, 0.0)
        is_counted = self._counted(along, variance)
        flux = float(along[is_counted].sum())
        spread = self._noise_factor(along, profile, column, clean, is_sound)
        integral = self._knot_lengths()
        by_fit = float(integral @ self.covariance[: self.knots, : self.knots] @ integral)
        by_stars = self._star_light(weight, norm, column) * _IMAGE_ERROR
        by_noise = _EXCESS * spread * math.sqrt(max(by_fit, float(variance[is_counted].sum())))
        sigma = math.hypot(by_noise, by_stars, _SHAPE_ERROR * flux)
        on_line = (np.abs(self.stars[:, 1]) < self.fwhm) & (self.stars[:, 0] > 0.0)
        on_line &= self.stars[:, 0] < self.length
        lit = self.found[self.knots : self.knots + len(self.stars)][on_line]
        steps = self._steps(along, variance * spread**2)
        return StreakFlux(
            flux_adu=flux,
            sigma_adu=sigma,
            star_share=float(np.abs(lit).sum()) / max(abs(flux), 1e-9),
            is_saturated=strip.brightest_adu > _SATURATED * saturation_adu,
            step_px=steps[0],
            step_adu_px=steps[1],
            step_sigma_adu_px=steps[2],
            length_px=self.length,
        )

    def _counted(self, along: FloatArray, variance: FloatArray) -> BoolArray:
        """Columns whose light is the streak's: those near it, and beyond where light goes on."""
        u = np.arange(along.size) - math.ceil(self.strip.margin_px)
        near = _MARGIN_FWHM * self.fwhm
        counted = (u > -near) & (u < self.length + near)
        for beyond in ((u <= -near), (u >= self.length + near)):
            light, noise = along[beyond].sum(), math.sqrt(float(variance[beyond].sum()))
            counted |= beyond & bool(light > _BEYOND_SIGMAS * noise)
        return np.asarray(counted)

    def _star_light(self, weight: FloatArray, norm: FloatArray, column: IndexArray) -> float:
        """Light of stars that would count as the line's, root of the sum of squares, ADU."""
        lit = self.found[self.knots : self.knots + len(self.stars)]
        along = weight / np.where(norm > 0.0, norm, np.inf)[column]
        return float(np.linalg.norm(lit * (self._star_columns @ along)))

    def _knot_lengths(self) -> FloatArray:
        """Length of line that each knot stands for, px."""
        if self.knots == 1:
            return np.array([self.length])
        lengths = np.full(self.knots, self.length / (self.knots - 1))
        lengths[[0, -1]] *= 0.5
        return lengths

    def _noise_factor(
        self,
        along: FloatArray,
        profile: FloatArray,
        column: IndexArray,
        clean: FloatArray,
        is_sound: BoolArray,
    ) -> float:
        """Factor on sigma: scatter on the line, and beside it in pieces as large as a star.

        Photons of the streak make the first larger than one, faint stars the second.
        """
        noise = self.strip.noise_adu
        on_it = is_sound & (np.abs(self.v_px) < 0.8 * self.fwhm)
        rest = clean[on_it] - along[column[on_it]] * profile[on_it]
        free = max(rest.size - np.unique(column[on_it]).size - 4, 8)
        on_line = float((rest**2).sum()) / free / noise**2
        beside = is_sound & (np.abs(self.v_px) > 1.2 * self.fwhm)
        left = clean - self.of_line
        side = max(round(self.fwhm), 2)
        block = (column[beside] // side) * 1000 + np.rint(self.v_px[beside] // side).astype(int)
        _, index, number = np.unique(block, return_inverse=True, return_counts=True)
        total = np.bincount(index, left[beside])
        full = number > 0.5 * side * side
        ratio = (total[full] ** 2 / number[full]) / noise**2
        spread = float(np.minimum(ratio, _CONFUSED).mean()) if ratio.size > 12 else 1.0
        return math.sqrt(max(on_line, 1.0) * max(spread, 1.0))

    def _steps(
        self, along: FloatArray, variance: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Middle, light a px and its sigma in steps of a star's width; empty where too few."""
        wide = max(self.fwhm, 2.0, self.length / _MAX_STEPS)
        number = int(self.length / wide)
        empty = np.zeros(0), np.zeros(0), np.zeros(0)
        if number < _MIN_STEPS:
            return empty
        u = np.arange(along.size) - math.ceil(self.strip.margin_px)
        edge = self._edge(u.astype(np.float64))
        use = (edge > _EDGE_SEEN) & (variance > 0.0) & (u >= 0) & (u < self.length)
        step = np.clip((u / self.length * number).astype(int), 0, number - 1)
        weight = np.where(use, edge / np.maximum(variance, 1e-12), 0.0)
        total = np.bincount(step, weight * edge, minlength=number)
        is_known = total > 0.0
        safe = np.where(is_known, total, 1.0)
        light = np.bincount(step, weight * along, minlength=number) / safe
        sigma = 1.0 / np.sqrt(safe)
        middle = (np.arange(number) + 0.5) * self.length / number
        if not is_known.any() or np.median(light[is_known] / sigma[is_known]) < _MIN_STEP_SNR:
            return empty
        return middle[is_known], light[is_known], sigma[is_known]


def _binned(column: IndexArray, values: FloatArray, count: int) -> FloatArray:
    """Sum of the values in each of ``count`` columns."""
    return np.asarray(np.bincount(column, values, count), dtype=np.float64)
