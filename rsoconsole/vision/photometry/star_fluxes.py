"""Light of stars at known places, neighbours measured together with them."""

import math
from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray, PixelArray
from rsoconsole.vision.arrays import BoolArray, IndexArray
from rsoconsole.vision.frame.background import Background
from rsoconsole.vision.photometry.star_image import StarImage
from rsoconsole.vision.stars.psf_field import PsfField

_STAMP_FWHM, _MIN_STAMP_PX = 2.0, 3
_SATURATED = 0.95
_FIT_SNR = 30.0
"""SNR from which a star has a width and place of its own."""
_FIT_STEPS = 2
_MAX_FITTED = 30
_MAX_MOVE_FWHM, _MAX_WIDER = 0.35, 1.6
"""Largest move of a star's place, in widths, and largest change of its width, as a factor."""
_MODEL_ERROR = 0.03
"""Error of the image, as a share of its light, in the fit of width and place."""
_WIDTH_SCATTERS = (0.0, 0.01, 0.02, 0.035, 0.05, 0.08, 0.12, 0.18)
_NOISE_FACTORS = (1.0, 1.6, 2.5, 4.0, 7.0)
_SCATTER_PRIOR, _FACTOR_PRIOR = 0.05, 1.0
"""Mean scatter of widths, and mean excess of the factor over 1, of exponential priors."""
_MAX_WIDTH_SIGMAS = 3.0
_MIN_WIDTHS = 4
"""Fewest fitted stars by which widths are judged."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StarFluxes:
    """Light of stars, in the order of their places; arrays (n,)."""

    flux_adu: FloatArray
    """Above the sky, ADU; NaN where the stamp reaches beyond the frame."""
    sigma_adu: FloatArray
    """One sigma by the noise of the sky."""
    is_saturated: BoolArray
    shape_error: FloatArray
    """One sigma by the star's unknown width, as a share of its light; 0 where none was fitted."""
    width_scatter: float = 0.0
    """One sigma of widths from star to star, as a share."""


def star_fluxes(
    pixels: PixelArray,
    sky: Background,
    image: StarImage,
    places_px: FloatArray,
    *,
    saturation_adu: float,
    psf_field: PsfField | None = None,
    fwhm_px: float,
    fits_shapes: bool = False,
) -> StarFluxes:
    """Measure the light of stars at ``places_px`` (n, 2), one image for all, neighbours included.

    Each star is weighed by its own image less the image's mean over its stamp, which leaves an even
    sky out; what neighbours add to that sum is solved for all stars together. Those that matter as
    neighbours must be among the places.

    - fwhm_px: median width that belongs to ``psf_field``
    - fits_shapes: True to fit width and place of bright stars too: light that is weighed by an
      image a tenth too wide is a tenth too much
    """
    scales = np.ones(len(places_px))
    if psf_field is not None:
        scales = psf_field.all_at(places_px[:, 0], places_px[:, 1]) / fwhm_px
    stars = _Stars(
        pixels, sky, image, np.array(places_px, dtype=np.float64), scales=scales, fwhm_px=fwhm_px
    )
    is_saturated = stars.are_above(_SATURATED * saturation_adu)
    flux, sigma = stars.solve()
    widths = _Widths(change=0.0, scatter=0.0)
    if fits_shapes:
        with np.errstate(invalid="ignore"):
            bright = np.flatnonzero((flux > _FIT_SNR * sigma) & ~is_saturated)
        brightest = bright[np.argsort(-flux[bright])[:_MAX_FITTED]]
        widths = stars.fit_shapes(brightest, flux)
        flux, sigma = stars.solve()
    return StarFluxes(
        flux_adu=flux,
        sigma_adu=sigma,
        is_saturated=is_saturated,
        shape_error=stars.shape_error,
        width_scatter=widths.scatter,
    )


@dataclass(frozen=True, slots=True)
class _Widths:
    """How the widths of stars differ from those that the image gives them, by their logarithms."""

    change: float
    scatter: float
    noise_factor: float = 1.0
    """Error of a fitted width over that by the noise of the sky: neighbours are no noise."""

    @classmethod
    def of(cls, change: FloatArray, sigma: FloatArray) -> "_Widths":
        """Likeliest scatter and error for fitted changes of width and their sigmas by noise."""
        best, best_score = cls(0.0, 0.0), -math.inf
        order = np.argsort(change)
        for scatter in _WIDTH_SCATTERS:
            for factor in _NOISE_FACTORS:
                spread = np.hypot(scatter, factor * sigma)
                share = np.cumsum(1.0 / spread[order])
                middle = float(change[order][np.searchsorted(share, 0.5 * share[-1])])
                off = np.minimum(np.abs(change - middle) / spread, _MAX_WIDTH_SIGMAS)
                score = -float((0.5 * off**2 + np.log(spread)).sum())
                score -= scatter / _SCATTER_PRIOR + (factor - 1.0) / _FACTOR_PRIOR
                if score > best_score:
                    best, best_score = cls(middle, scatter, factor), score
        return best


class _Stars:
    """Places and widths of stars, and the sums that give their light."""

    def __init__(
        self,
        pixels: PixelArray,
        sky: Background,
        image: StarImage,
        places_px: FloatArray,
        *,
        scales: FloatArray,
        fwhm_px: float,
    ) -> None:
        self._pixels, self._sky, self._image = pixels, sky, image
        self._places, self._scales, self._fwhm_px = places_px, scales, fwhm_px
        self._half = _stamp_half_px(image, fwhm_px)
        self._offset = np.arange(-self._half, self._half + 1)
        self.shape_error = np.zeros(len(places_px))

    def _stamp(self, n: int) -> tuple[int, int] | None:
        """Row and column of a star's middle; None where its stamp reaches beyond the frame."""
        height, width = self._pixels.shape
        half = self._half
        column, row = round(float(self._places[n, 0])), round(float(self._places[n, 1]))
        is_inside = half <= column < width - half and half <= row < height - half
        return (row, column) if is_inside else None

    def _light(self, row: int, column: int) -> FloatArray:
        half = self._half
        box = self._pixels[row - half : row + half + 1, column - half : column + half + 1]
        return np.asarray(box, dtype=np.float64)

    def _of(self, m: int, row: int, column: int) -> FloatArray:
        """Image of star ``m``, of unit light, in a stamp."""
        x, y = self._places[m]
        xs, ys = self._offset[None, :] + column, self._offset[:, None] + row
        return self._image.at(xs - x, ys - y, self._scales[m])

    def _near(self, n: int) -> IndexArray:
        """Numbers of other stars that shine into a star's stamp."""
        reach = 2.2 * self._half + self._image.trail_px
        near = np.flatnonzero(np.abs(self._places - self._places[n]).max(axis=1) < reach)
        return np.asarray(near[near != n])

    def are_above(self, level_adu: float) -> BoolArray:
        """True for each star whose core has a pixel above a level."""
        found = np.zeros(len(self._places), bool)
        for n in range(len(found)):
            at = self._stamp(n)
            if at is not None:
                row, column = at
                core = self._pixels[row - 2 : row + 3, column - 2 : column + 3]
                found[n] = float(core.max()) > level_adu
        return found

    def solve(self) -> tuple[FloatArray, FloatArray]:
        """Light of all stars, and its sigma by the noise of the sky; NaN where not known."""
        count = len(self._places)
        right, sigma = np.full(count, np.nan), np.full(count, np.nan)
        mixing = np.eye(count)
        for n, (x, y) in enumerate(self._places):
            at = self._stamp(n)
            if at is None:
                continue
            own = self._of(n, *at)
            weight = own - own.mean()
            norm = float((weight * own).sum())
            right[n] = float((weight * self._light(*at)).sum()) / norm
            noise = self._sky.at(self._sky.noise, float(x), float(y))
            sigma[n] = noise * math.sqrt(float((weight**2).sum())) / norm
            for m in self._near(n):
                mixing[n, m] = float((weight * self._of(m, *at)).sum()) / norm
        flux = np.full(count, np.nan)
        for group in _groups(mixing, np.isfinite(right)):
            among = mixing[np.ix_(group, group)]
            flux[group] = np.linalg.lstsq(among, right[group], rcond=1e-6)[0]
        return flux, sigma

    def fit_shapes(self, stars: IndexArray, flux_adu: FloatArray) -> _Widths:
        """Fit place and width of bright stars, and how far widths differ from star to star.

        A width is believed as far as widths differ from star to star. A star far narrower than the
        others is believed too; one far wider is a blend, whose light is doubtful by as much. What
        all have in common is left as it is: streaks are measured with that image.
        """
        before = self._scales.copy()
        fits = [self._fit(int(n), flux_adu) for n in stars]
        is_fitted = np.array([each is not None for each in fits], dtype=bool)
        fitted = stars[is_fitted]
        sigma = np.array([each for each in fits if each is not None])
        change = np.log(self._scales[fitted] / before[fitted])
        self._scales = before
        if len(fitted) < _MIN_WIDTHS:
            return _Widths(0.0, 0.0)
        found = _Widths.of(change, sigma)
        own, common = (found.noise_factor * sigma) ** 2, found.scatter**2
        off, limit = change - found.change, _MAX_WIDTH_SIGMAS * np.sqrt(common + own)
        belief = np.where(off < -limit, 1.0, common / (common + own))
        self._scales[fitted] *= np.exp(belief * off)
        self.shape_error[:] = found.scatter
        self.shape_error[fitted] = np.where(off > limit, off, np.sqrt(belief * own))
        return found

    def _fit(self, n: int, flux_adu: FloatArray) -> float | None:
        """Fit a star's place and width; return the sigma of its width by noise, as a share.

        None where it cannot be fitted.
        """
        at = self._stamp(n)
        if at is None:
            return None
        row, column = at
        light = self._light(row, column)
        for m in self._near(n):
            if np.isfinite(flux_adu[m]):
                light = light - flux_adu[m] * self._of(int(m), row, column)
        place, scale = self._places[n].copy(), float(self._scales[n])
        noise = self._sky.at(self._sky.noise, float(place[0]), float(place[1]))
        flux = float(flux_adu[n])
        reach_px = _MAX_MOVE_FWHM * self._fwhm_px
        for _ in range(_FIT_STEPS):
            x, y = self._places[n]
            xs, ys = self._offset[None, :] + column, self._offset[:, None] + row
            here, *slopes = self._image.with_slopes(xs - x, ys - y, float(self._scales[n]))
            design = np.stack([each.ravel() for each in (here, *slopes, np.ones(here.shape))])
            weights = 1.0 / (noise**2 + (_MODEL_ERROR * flux * here.ravel()) ** 2)
            inverse = np.linalg.inv((design * weights) @ design.T)
            found = inverse @ ((design * weights) @ light.ravel())
            flux = float(found[0])
            if flux <= 0.0:
                self._places[n], self._scales[n] = place, scale
                return None
            step = np.clip(found[1:4] / flux, -0.3, 0.3)
            moved = np.clip(self._places[n] + step[:2] - place, -reach_px, reach_px)
            self._places[n] = place + moved
            changed = self._scales[n] * math.exp(float(step[2])) / scale
            self._scales[n] = scale * min(max(changed, 1.0 / _MAX_WIDER), _MAX_WIDER)
        return math.sqrt(max(float(inverse[3, 3]), 0.0)) / flux


def drawn_out_share(
    image: StarImage, fwhm_px: float, scale: float, way_px: tuple[float, float]
) -> float:
    """Share of its light that ``star_fluxes`` finds of a point that moves evenly by ``way_px``.

    The point is in the middle of its way (dx, dy) at its place; ``scale`` is the width there over
    the median ``fwhm_px``.
    """
    half = _stamp_half_px(image, fwhm_px)
    offset = np.arange(-half, half + 1.0)
    xs, ys = offset[None, :], offset[:, None]
    own = image.at(xs, ys, scale)
    weight = own - own.mean()
    steps = np.linspace(-0.5, 0.5, 2 * math.ceil(math.hypot(*way_px)) + 3)
    steps = 0.5 * (steps[1:] + steps[:-1])
    moved = np.mean(
        [image.at(xs - t * way_px[0], ys - t * way_px[1], scale) for t in steps], axis=0
    )
    return float((weight * moved).sum() / (weight * own).sum())


def _stamp_half_px(image: StarImage, fwhm_px: float) -> int:
    """Half the side of a star's stamp, px."""
    return max(math.ceil(_STAMP_FWHM * fwhm_px), _MIN_STAMP_PX) + math.ceil(0.5 * image.trail_px)


def _groups(mixing: FloatArray, is_known: BoolArray) -> list[IndexArray]:
    """Numbers of stars that shine into each other's stamps, group by group."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    known = np.flatnonzero(is_known)
    count, label = connected_components(csr_array(mixing[np.ix_(known, known)]), directed=False)
    order = np.argsort(label, kind="stable")
    ends = np.cumsum(np.bincount(label, minlength=count))[:-1]
    return [known[each] for each in np.split(order, ends)] if count else []
