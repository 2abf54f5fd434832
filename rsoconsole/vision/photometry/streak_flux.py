"""Light of a streak: its image along its path, fitted together with the stars and sky beside it.

The path may bend and the light may change along it. Stars at known places are in the model; what
else shines near the line is found in what the model leaves. A short light on the line itself is a
star where the frame before shows it too, and the object's own where it does not.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.arrays import BoolArray, IndexArray
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.lines.segments import Ends, length_of
from rsoconsole.vision.photometry.star_image import StarImage
from rsoconsole.vision.photometry.streak_strip import StreakStrip
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA

_HALF_FWHM, _MIN_HALF_PX = 4.5, 9.0
_MARGIN_FWHM, _MARGIN_SHARE = 3.0, 0.15
"""Length beyond either end: widths, and a share of the length, which may be found too short."""
_BEYOND_SIGMAS = 3.0
"""Light in that share beyond an end that belongs to the streak."""
_KNOT_FWHM, _MAX_KNOTS = 8.0, 16
_PATH_PASSES = 2
_MAX_STARS = 30
_FOUND_SIGMAS, _FOUND_A_ROUND, _ROUNDS = 4.5, 6, 3
_CENTRED_SNR = 12.0
"""SNR from which a star is moved onto its light."""
_ON_LINE_FWHM = 1.0
"""Distance from the line, in widths, within which a light may be the object's own."""
_STARS_UNASKED = 2
"""Lights on the line that pass for stars where no frame before says what they are."""
_BLENDED_SHARE = 0.1
_SATURATED = 0.95
_MODEL_ERROR = 0.02
_IMAGE_ERROR = 0.02
"""Error of a star's light that its image leaves on the line, as a share of that light."""
_SHAPE_ERROR = 0.008
"""Error of the image of a line against that of a point, as a share of the line's light."""
_WIDTH_SIGMA = 0.03
"""One sigma of the width of a line over that of the stars, before it is fitted."""
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
    fit = _StripFit(strip, image, scale, fwhm)
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


class _StripFit:
    """Least squares of streak, stars and sky over a strip; its parts are set and solved in turn."""

    def __init__(self, strip: StreakStrip, image: StarImage, scale: float, fwhm: float) -> None:
        self.strip, self.image, self.scale, self.fwhm = strip, image, scale, fwhm
        self.star_scale = scale
        self.length = strip.length_px
        self.knots = int(min(max(self.length / (_KNOT_FWHM * fwhm), 1.0), _MAX_KNOTS))
        self.path = np.zeros(3)
        """Offset across, px, of a line's powers of 2 u / length - 1."""
        self.stars = np.zeros((0, 2))
        self._star_columns = np.zeros((0, strip.u_px.size))
        self.place = 2.0 * strip.u_px / self.length - 1.0
        self.sky = self._sky_columns()
        self.edge = self._edge(strip.u_px)
        self._table_px = np.linspace(0.0, 1.5 * strip.half_px + 2.0, 512)
        self.found = np.zeros(0)
        self.model = np.zeros(strip.u_px.size)

    def _sky_columns(self) -> FloatArray:
        """Level that changes evenly across and in a few bends along."""
        v = self.strip.v_px / self.strip.half_px
        t = np.clip(self.place, -1.5, 1.5)
        return np.stack([np.ones(v.size), v, t, t * v, t * t])

    def set_stars(self, places: FloatArray) -> None:
        """Put stars at these (u, v) into the model."""
        self.stars = np.zeros((0, 2))
        self._star_columns = np.zeros((0, self.strip.u_px.size))
        self.add_stars(places)

    def add_stars(self, places: FloatArray) -> None:
        """Add stars at (u, v) to the model."""
        columns = np.zeros((len(places), self.strip.u_px.size))
        for column, (u, v) in zip(columns, places, strict=True):
            near, du, dv = self._about(u, v, 4.0 * self.fwhm + 2.0)
            column[near] = self.image.at(du, dv, self.star_scale)
        is_seen = columns.sum(axis=1) > 0.02
        self.stars = np.concatenate([self.stars, np.reshape(places, (-1, 2))[is_seen]])
        self._star_columns = np.concatenate([self._star_columns, columns[is_seen]])

    def _across(self) -> FloatArray:
        """Distance of every pixel from the path."""
        return np.asarray(self.strip.v_px - np.polynomial.polynomial.polyval(self.place, self.path))

    def _edge(self, u_px: FloatArray) -> FloatArray:
        """Share of the line's light at distances along it, blurred at both ends."""
        from scipy.special import erf

        root = math.sqrt(2.0) * max(self.fwhm / FWHM_PER_SIGMA, 0.5)
        return np.asarray(0.5 * (erf(u_px / root) - erf((u_px - self.length) / root)))

    def _hats(self, count: int) -> FloatArray:
        if count == 1:
            return np.ones((1, self.place.size))
        at = np.clip(0.5 * (self.place + 1.0), 0.0, 1.0) * (count - 1)
        return np.maximum(0.0, 1.0 - np.abs(at - np.arange(count)[:, None]))

    def _about(self, u: float, v: float, reach: float) -> tuple[IndexArray, FloatArray, FloatArray]:
        """Pixels about a place: their numbers and offsets from it."""
        du, dv = self.strip.u_px - u, self.strip.v_px - v
        near = np.flatnonzero((np.abs(du) < reach) & (np.abs(dv) < reach))
        return near, du[near], dv[near]

    def centre_stars(self) -> None:
        """Move stars that matter to the line onto their light, and solve once more."""
        light = self.found[self.knots : self.knots + len(self.stars)]
        sigma = np.sqrt(np.diag(self.covariance)[self.knots : self.knots + len(self.stars)])
        matters = (light > _CENTRED_SNR * sigma) & (np.abs(self.stars[:, 1]) < 3.0 * self.fwhm)
        left = self.strip.light_adu - self.model - self.of_sky
        moved = False
        for n in np.flatnonzero(matters):
            u, v = self.stars[n].tolist()
            near, du, dv = self._about(u, v, 1.5 * self.fwhm)
            if near.size < 9:
                continue
            at, step = self.image.at(du, dv, self.star_scale), 0.1
            slopes = np.stack(
                [
                    (self.image.at(du - step, dv, self.star_scale) - at) / step,
                    (self.image.at(du, dv - step, self.star_scale) - at) / step,
                    at / max(float(at.max()), 1e-12) * float(np.abs(at).mean()),
                ]
            )
            move = np.linalg.lstsq(slopes.T * light[n], left[near], rcond=None)[0][:2]
            if np.hypot(*move) > 0.05:
                self.stars[n] += np.clip(move, -0.6, 0.6)
                moved = True
        if moved:
            places = self.stars
            self.set_stars(places)
            self.solve()

    def _profile(self, v_px: FloatArray, scale: float) -> FloatArray:
        """Cross-section at distances from the path, from a table."""
        table = self.image.across(self._table_px, scale)
        return np.interp(np.abs(v_px), self._table_px, table)

    def follow_path(self) -> None:
        """Fit offset, tilt and bend of the path and the width of the line, the light even."""
        count = min(self.knots, 5)
        hats = self._hats(count) * self.edge
        step, level = 0.05, 0.0
        for turn in range(_PATH_PASSES + 1):
            v = self._across()
            line = self._profile(v, self.scale)
            by_v = self.edge * (self._profile(v - step, self.scale) - line) / step
            wider = self.edge * (self._profile(v, self.scale * 1.02) - line) / 0.02
            shape = np.stack([by_v, by_v * self.place, by_v * self.place**2, wider])
            # The first turn finds the light alone, with which a change of shape is weighed.
            shape = shape[: 4 if turn else 0]
            design = np.concatenate([hats * line, shape, self._star_columns, self.sky])
            light = max(level, 0.0)
            prior, believed = np.zeros((2, len(design)))
            if turn:
                prior[count + 3] = 1.0 / max(_WIDTH_SIGMA * self.star_scale * light, 1e-9) ** 2
                believed[count + 3] = light * (self.star_scale - self.scale) / self.scale
            found, _, _ = self._least_squares(design, light * line * self.edge, prior, believed)
            level = float(found[:count].mean())
            if level <= 0.0:
                return
            if turn:
                move = np.clip(found[count : count + 3] / level, -0.5 * self.fwhm, 0.5 * self.fwhm)
                self.path = np.clip(self.path + move, -1.5 * self.fwhm, 1.5 * self.fwhm)
                change = float(np.clip(found[count + 3] / level, -0.1, 0.1))
                self.scale = float(np.clip(self.scale * (1.0 + change), 0.7, 3.0))

    def _least_squares(
        self,
        design: FloatArray,
        expected: FloatArray,
        prior: FloatArray | float = 0.0,
        believed: FloatArray | float = 0.0,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return parameters, their covariance by the sky's noise, and the weights of the pixels.

        ``prior``: (parameters,) inverse variance with which each is ``believed`` to be something.
        """
        weights = 1.0 / (self.strip.noise_adu**2 + (_MODEL_ERROR * expected) ** 2)
        for _ in range(2):
            weighted = design * weights
            normal = weighted @ design.T
            normal[np.diag_indices_from(normal)] *= 1.0 + 1e-9
            normal[np.diag_indices_from(normal)] += prior
            covariance = np.asarray(
                np.linalg.pinv(normal, hermitian=True, rcond=1e-12), dtype=np.float64
            )
            found = covariance @ (weighted @ self.strip.light_adu + prior * believed)
            left = np.abs(self.strip.light_adu - found @ design) * np.sqrt(weights)
            # Huber's weights: cosmic rays and lights that are not in the model yet count less.
            weights = weights * np.minimum(1.0, 4.0 / np.maximum(left, 1e-9))
        return found, covariance, weights

    def solve(self) -> None:
        """Fit light in knots, stars and sky along the path found."""
        v = self._across()
        line = self._profile(v, self.scale) * self.edge
        hats = self._hats(self.knots) * line
        design = np.concatenate([hats, self._star_columns, self.sky])
        expected = np.abs(self.model) if self.model.any() else np.zeros(line.size)
        self.found, self.covariance, self.weights = self._least_squares(design, expected)
        count, stars = self.knots, len(self.stars)
        self.of_line = self.found[:count] @ hats
        self.of_stars = self.found[count : count + stars] @ self._star_columns
        self.of_sky = self.found[count + stars :] @ self.sky
        self.model = self.of_line + self.of_stars
        self.v_px = v

    def lights_left(self) -> list[tuple[float, float]]:
        """(u, v) of points of light that the model leaves, brightest first, none by chance."""
        import cv2

        left = self.strip.light_adu - self.model - self.of_sky
        mean, number = self.strip.raster(left)
        noise = self.strip.noise_adu**2 + (3.0 * _MODEL_ERROR * self.model) ** 2
        variance, _ = self.strip.raster(noise)
        sigma = max(self.fwhm / FWHM_PER_SIGMA, 0.6)
        weight = np.where(number > 0, number / np.maximum(variance, 1e-12), 0.0).astype(np.float32)
        side = 2 * math.ceil(3.0 * sigma) + 1
        kernel = cv2.getGaussianKernel(side, sigma)
        kernel = (kernel / kernel.max()).astype(np.float32)
        top = cv2.sepFilter2D(mean * weight, -1, kernel, kernel, borderType=cv2.BORDER_CONSTANT)
        low = cv2.sepFilter2D(weight, -1, kernel**2, kernel**2, borderType=cv2.BORDER_CONSTANT)
        score = top / np.sqrt(np.maximum(low, 1e-12))
        peak = score == cv2.dilate(score, np.ones((side, side), np.uint8))
        rows, columns = np.nonzero(peak & (score > _FOUND_SIGMAS))
        order = np.argsort(-score[rows, columns])[:_FOUND_A_ROUND]
        first, half = -math.ceil(self.strip.margin_px), math.ceil(self.strip.half_px)
        places = [
            (
                columns[n] + first + _summit(score[rows[n], columns[n] - 1 : columns[n] + 2]),
                rows[n] - half + _summit(score[rows[n] - 1 : rows[n] + 2, columns[n]]),
            )
            for n in order
        ]
        if len(self.stars):
            places = [
                place
                for place in places
                if np.hypot(*(self.stars - place).T).min() > 0.6 * self.fwhm
            ]
        return places

    def result(self, saturation_adu: float) -> StreakFlux:
        """Sum the light along the path, with stars and sky taken away."""
        strip, noise = self.strip, self.strip.noise_adu
        clean = strip.light_adu - self.of_stars - self.of_sky
        profile = self._profile(self.v_px, self.scale)
        column, count = strip.bins()
        is_sound = self.weights * (noise**2) > 0.1
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
        by_noise = spread * math.sqrt(max(by_fit, float(variance[is_counted].sum())))
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


def _summit(three: npt.NDArray[np.float32]) -> float:
    """Place of the top of a parabola through three neighbours, from the middle one; 0 at a rim."""
    if three.size < 3:
        return 0.0
    bend = float(three[0] - 2.0 * three[1] + three[2])
    return 0.0 if bend >= 0.0 else 0.5 * float(three[0] - three[2]) / bend
