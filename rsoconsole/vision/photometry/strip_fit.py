"""Least squares of a streak, the stars beside it and the sky over the pixels of a strip."""

import math

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray
from rsoconsole.vision.arrays import IndexArray
from rsoconsole.vision.photometry.star_image import StarImage
from rsoconsole.vision.photometry.streak_strip import StreakStrip
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA

_KNOT_FWHM, _MAX_KNOTS = 8.0, 16
_PATH_PASSES = 2
_FOUND_SIGMAS, _FOUND_A_ROUND = 4.5, 6
_MODEL_ERROR = 0.02
_WIDTH_SIGMA = 0.03
"""One sigma of the width of a line over that of the stars, before it is fitted."""
_CENTRED_SNR = 12.0
"""SNR from which a star is moved onto its light."""


class StripFit:
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


def _summit(three: npt.NDArray[np.float32]) -> float:
    """Place of the top of a parabola through three neighbours, from the middle one; 0 at a rim."""
    if three.size < 3:
        return 0.0
    bend = float(three[0] - 2.0 * three[1] + three[2])
    return 0.0 if bend >= 0.0 else 0.5 * float(three[0] - three[2]) / bend
