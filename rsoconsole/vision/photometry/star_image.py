"""Image of a point in one frame, from its own bright stars: a sum of round Gaussians.

Stars and streaks are measured with the same image, so that light in its far wings counts alike in
both and cancels in a magnitude. A Gaussian drawn out along a line is known in closed form, and so
are trailed stars and streaks.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.stars.star_list import StarList
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA

WIDTHS = np.array([0.65, 0.85, 1.0, 1.3, 1.8, 2.7, 4.2])
"""Widths of the Gaussians, by the width of a star."""
MIN_STARS = 3
_MAX_STARS = 14
_MIN_SNR = 30.0
_BESIDE_SHARE = 0.03
"""Largest light of a neighbour, as a share of a star's, within its stamp."""
_PASSES = 2
_MODEL_ERROR = 0.01
"""Error of the image itself, as a share of its light at each pixel."""
_CUT_SIGMAS = 4.0
_RADII = 1024


@dataclass(frozen=True, kw_only=True, eq=False)
class StarImage:
    """Image of a point of unit light; widths are those of the frame's median star."""

    shares: FloatArray
    """(k,) share of each Gaussian of the light; their sum is 1."""
    sigmas_px: FloatArray
    """(k,) one sigma of each Gaussian, px."""
    trail_px: float = 0.0
    """Length to which drift has drawn every star, px; 0 for points."""
    trail_deg: float = 0.0
    """Direction of the trail, deg, from x towards y."""

    @classmethod
    def gaussian(cls, stars: StarList) -> "StarImage":
        """Return one Gaussian of the stars' median width, where too few stars show their image."""
        trail = stars.trail
        return cls(
            shares=np.ones(1),
            sigmas_px=np.array([max(stars.median_fwhm_px, 1.2) / FWHM_PER_SIGMA]),
            trail_px=0.0 if trail is None else trail.length_px,
            trail_deg=0.0 if trail is None else trail.angle_deg,
        )

    def without_trail(self) -> "StarImage":
        """Return the image that a line has across: drift and motion add up to one line."""
        return replace(self, trail_px=0.0)

    @cached_property
    def _by_radius(self) -> tuple[FloatArray, FloatArray]:
        """Distances from a point that is no trail, px, and the light there."""
        r_px = np.linspace(0.0, 6.0 * float(self.sigmas_px.max()), _RADII)
        s2 = self.sigmas_px[:, None] ** 2
        light = self.shares @ (np.exp(-0.5 * r_px**2 / s2) / (2.0 * math.pi * s2))
        return r_px, np.asarray(light)

    @property
    def fwhm_px(self) -> float:
        """Full width at half maximum across, px: of the cross-section of a line."""
        grid = np.linspace(0.0, 4.0 * float(self.sigmas_px.min()) + 4.0, 400)
        profile = self.across(grid)
        return 2.0 * float(grid[np.argmax(profile < 0.5 * profile[0])])

    def at(
        self, dx_px: FloatArray, dy_px: FloatArray, scale: FloatArray | float = 1.0
    ) -> FloatArray:
        """Light per pixel at offsets from the point, whose width is ``scale`` times the median."""
        if self.trail_px < _MIN_TRAIL_PX:
            r_px = np.sqrt(dx_px * dx_px + dy_px * dy_px) / scale
            return np.asarray(np.interp(r_px, *self._by_radius, right=0.0) / scale**2)
        return np.asarray(
            sum(
                share * _drawn_out(dx_px, dy_px, sigma * scale, self.trail_px, self.trail_deg)
                for share, sigma in zip(self.shares, self.sigmas_px, strict=True)
            )
        )

    def with_slopes(
        self, dx_px: FloatArray, dy_px: FloatArray, scale: float
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Light per pixel, and how it changes as the point moves along x and y and ln scale grows.

        By finite steps where drift has drawn the image out.
        """
        if self.trail_px >= _MIN_TRAIL_PX:
            step = _SLOPE_STEP
            here = self.at(dx_px, dy_px, scale)
            others = (
                self.at(dx_px - step, dy_px, scale),
                self.at(dx_px, dy_px - step, scale),
                self.at(dx_px, dy_px, scale * math.exp(step)),
            )
            along_x, along_y, wider = ((each - here) / step for each in others)
            return here, along_x, along_y, wider
        r2 = dx_px * dx_px + dy_px * dy_px
        here, slope, wider = (np.zeros(r2.shape) for _ in range(3))
        for share, sigma in zip(self.shares, self.sigmas_px * scale, strict=True):
            light = share * np.exp(-0.5 * r2 / sigma**2) / (2.0 * math.pi * sigma**2)
            here += light
            slope += light / sigma**2
            wider += light * (r2 / sigma**2 - 2.0)
        return here, slope * dx_px, slope * dy_px, wider

    def across(self, v_px: FloatArray, scale: float = 1.0) -> FloatArray:
        """Cross-section of an endless line of unit light a px of length, at distances ``v_px``."""
        s = self.sigmas_px[:, None] * scale
        return np.asarray(self.shares @ (np.exp(-0.5 * (v_px / s) ** 2) / (s * _ROOT_2PI)))


_MIN_TRAIL_PX = 0.05
_SLOPE_STEP = 0.02
_ROOT_2PI = math.sqrt(2.0 * math.pi)


def fit_star_image(
    pixels: PixelArray, sky: Background, stars: StarList, saturation_adu: float
) -> StarImage:
    """Fit the image of a point to bright stars without neighbours; one Gaussian where few are.

    The stars' own place, light and sky are fitted in turn with the shares of the Gaussians, which
    are not negative.
    """
    plain = StarImage.gaussian(stars)
    half_px = math.ceil(min(max(3.5 * stars.median_fwhm_px, 6.0), 18.0) + 0.5 * plain.trail_px)
    chosen = _lone_stars(pixels, stars, half_px, saturation_adu)
    if chosen.size < MIN_STARS:
        return plain
    stamps = [_Stamp.of(pixels, sky, stars, n, half_px) for n in chosen]
    widths = WIDTHS * plain.sigmas_px[0]
    image = replace(plain, sigmas_px=widths, shares=(widths == plain.sigmas_px[0]).astype(float))
    for stamp in stamps:
        stamp.fit(image)  # for the place
    for _ in range(_PASSES):
        for stamp in stamps:
            stamp.fit(image)
        shares = _shares(stamps, image)
        if shares is None:
            return plain
        image = replace(image, shares=shares)
    is_lit = image.shares > 0.0
    return replace(image, shares=image.shares[is_lit], sigmas_px=widths[is_lit])


def _lone_stars(
    pixels: PixelArray, stars: StarList, half_px: int, saturation_adu: float
) -> np.ndarray:
    """Numbers of bright unsaturated stars inside the frame without a neighbour in their stamp."""
    height, width = pixels.shape
    x, y = stars.x_px, stars.y_px
    is_inside = (np.minimum(x, width - 1 - x) > half_px + 1) & (
        np.minimum(y, height - 1 - y) > half_px + 1
    )
    is_good = is_inside & ~stars.is_saturated & (stars.snr > _MIN_SNR) & (stars.flux > 0.0)
    chosen: list[int] = []
    for n in np.flatnonzero(is_good):
        near = np.hypot(x - x[n], y - y[n]) < 1.3 * half_px
        near[n] = False
        if (stars.flux[near] > _BESIDE_SHARE * stars.flux[n]).any():
            continue
        row, column = round(float(y[n])), round(float(x[n]))
        core = pixels[row - 2 : row + 3, column - 2 : column + 3]
        if float(core.max()) < 0.9 * saturation_adu:
            chosen.append(int(n))
        if len(chosen) == _MAX_STARS:
            break
    return np.array(chosen, dtype=int)


class _Stamp:
    """A star's pixels, with its place, light and sky as fitted last."""

    def __init__(
        self, side_px: tuple[FloatArray, FloatArray], light: FloatArray, noise: float, scale: float
    ) -> None:
        self.x_px, self.y_px = side_px
        """(side,) offsets of columns and rows from the star."""
        self.light, self.noise, self.scale = light, noise, scale
        self.flux = self.sky = 0.0
        self.columns = np.zeros((0, light.size))
        """(k, n) each Gaussian, of unit light, at the pixels."""
        self.is_kept = np.ones(light.size, bool)

    @classmethod
    def of(
        cls, pixels: PixelArray, sky: Background, stars: StarList, n: int, half_px: int
    ) -> "_Stamp":
        x, y = float(stars.x_px[n]), float(stars.y_px[n])
        column, row = round(x), round(y)
        side = np.arange(-half_px, half_px + 1, dtype=np.float64)
        box = pixels[row - half_px : row + half_px + 1, column - half_px : column + half_px + 1]
        light = box.astype(np.float64).ravel() - sky.at(sky.level, x, y)
        scale = stars.fwhm_at(x, y) / stars.median_fwhm_px
        places = np.asarray(side + (column - x)), np.asarray(side + (row - y))
        return cls(places, light, sky.at(sky.noise, x, y), scale)

    def _gaussians(self, image: StarImage) -> FloatArray:
        sigmas = (image.sigmas_px * self.scale)[:, None]
        if image.trail_px:
            dx, dy = (each.ravel() for each in np.meshgrid(self.x_px, self.y_px))
            trail = image.trail_px, image.trail_deg
            return np.stack([_drawn_out(dx, dy, float(s), *trail) for s in sigmas[:, 0]])
        along, down = (
            np.exp(-0.5 * (side / sigmas) ** 2) / (_ROOT_2PI * sigmas)
            for side in (self.x_px, self.y_px)
        )
        return np.asarray((down[:, :, None] * along[:, None, :]).reshape(len(sigmas), -1))

    def weights(self, model: FloatArray) -> FloatArray:
        """Weights of the pixels, by noise and the error of the image itself."""
        return np.asarray(self.is_kept / (self.noise**2 + (_MODEL_ERROR * model) ** 2))

    def fit(self, image: StarImage) -> None:
        """Fit light, sky and a small move of the place; then leave out pixels far off."""
        self.columns = self._gaussians(image)
        here = image.shares @ self.columns
        # Of a Gaussian by its centre; for a trail across and along it alike, which is near enough.
        slope = (image.shares / (image.sigmas_px * self.scale) ** 2) @ self.columns
        side = self.x_px.size
        by_x = slope * np.tile(self.x_px, side)
        by_y = slope * np.repeat(self.y_px, side)
        design = np.stack([here, by_x, by_y, np.ones(here.size)])
        weighted = design * self.weights(max(self.flux, 0.0) * here)
        found = np.linalg.lstsq(weighted @ design.T, weighted @ self.light, rcond=None)[0]
        self.flux, self.sky = float(found[0]), float(found[3])
        if self.flux > 0.0:
            dx, dy = np.clip(found[1:3] / self.flux, -0.5, 0.5)
            self.x_px, self.y_px = self.x_px - dx, self.y_px - dy
        sigma = np.sqrt(self.noise**2 + (0.1 * self.flux * here) ** 2)
        self.is_kept = np.abs(self.light - found @ design) < _CUT_SIGMAS * sigma


def _shares(stamps: list[_Stamp], image: StarImage) -> FloatArray | None:
    """Share of each Gaussian of the light, from all stars together; None where none shines."""
    from scipy.optimize import nnls

    count = image.sigmas_px.size
    normal, right = np.zeros((count, count)), np.zeros(count)
    for stamp in stamps:
        if stamp.flux <= 0.0:
            continue
        weights = stamp.weights(stamp.flux * (image.shares @ stamp.columns)) * stamp.flux**2
        weighted = stamp.columns * weights
        normal += weighted @ stamp.columns.T
        right += weighted @ ((stamp.light - stamp.sky) / stamp.flux)
    if not normal.any():
        return None
    factor = np.linalg.cholesky(normal + np.eye(count) * 1e-9 * np.trace(normal))
    found, _ = nnls(factor.T, np.linalg.solve(factor, right))
    total = float(found.sum())
    return None if total <= 0.0 else np.asarray(found / total)


def _drawn_out(
    dx_px: FloatArray, dy_px: FloatArray, sigma_px: FloatArray | float, length_px: float, deg: float
) -> FloatArray:
    """Gaussian of unit light, drawn out evenly along a centred line of a length and direction."""
    if length_px < _MIN_TRAIL_PX:
        r2 = dx_px * dx_px + dy_px * dy_px
        return np.asarray(np.exp(-0.5 * r2 / sigma_px**2) / (2.0 * math.pi * sigma_px**2))
    c, s = math.cos(math.radians(deg)), math.sin(math.radians(deg))
    u, v = c * dx_px + s * dy_px, c * dy_px - s * dx_px
    half = 0.5 * length_px
    along = 0.5 * (_erf((u + half) / sigma_px) - _erf((u - half) / sigma_px)) / length_px
    return np.asarray(along * np.exp(-0.5 * (v / sigma_px) ** 2) / (sigma_px * _ROOT_2PI))


def _erf(t: FloatArray) -> FloatArray:
    """Error function of t / sqrt(2)."""
    from scipy.special import erf

    return np.asarray(erf(t * math.sqrt(0.5)))
