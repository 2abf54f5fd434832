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
_FIT_STEPS = 4
_MAX_MOVE_FWHM, _MAX_WIDER = 0.35, 1.6
"""Largest move of a star's place, in widths, and largest change of its width, as a factor."""
_MODEL_ERROR = 0.03
"""Error of the image, as a share of its light, in the fit of width and place."""
_WIDTH_STEP = 0.02
_MIN_WIDTHS = 4
"""Fewest fitted stars by which widths of all others are judged."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StarFluxes:
    """Light of stars, in the order of their places; arrays (n,)."""

    flux_adu: FloatArray
    """Above the sky, ADU; NaN where the stamp reaches beyond the frame."""
    sigma_adu: FloatArray
    """One sigma by the noise of the sky."""
    is_saturated: BoolArray
    is_fitted: BoolArray
    """Stars with a width and place of their own."""
    shape_error: float = 0.0
    """One sigma of the light of a star without a width of its own, as a share of it, by the scatter
    of widths from star to star; 0 where none was fitted."""
    wider: float = 1.0
    """Median width of the fitted stars over the image's."""


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
    is_fitted = np.zeros(len(flux), bool)
    shape_error, wider = 0.0, 1.0
    if fits_shapes:
        with np.errstate(invalid="ignore"):
            is_fitted = (flux > _FIT_SNR * sigma) & ~is_saturated
        wider, shape_error = stars.fit_shapes(np.flatnonzero(is_fitted), flux)
        flux, sigma = stars.solve()
    return StarFluxes(
        flux_adu=flux,
        sigma_adu=sigma,
        is_saturated=is_saturated,
        is_fitted=is_fitted,
        shape_error=shape_error,
        wider=wider,
    )


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

    def fit_shapes(self, stars: IndexArray, flux_adu: FloatArray) -> tuple[float, float]:
        """Fit place and width of bright stars; return the median change of width, and its scatter.

        The other stars take over the median change, a factor.
        """
        before = self._scales.copy()
        for n in stars:
            self._fit(int(n), flux_adu)
        if len(stars) < _MIN_WIDTHS:
            return 1.0, 0.0
        change = np.log(self._scales[stars] / before[stars])
        middle = float(np.median(change))
        is_other = np.ones(len(before), bool)
        is_other[stars] = False
        self._scales[is_other] *= math.exp(middle)
        return math.exp(middle), 1.4826 * float(np.median(np.abs(change - middle)))

    def _fit(self, n: int, flux_adu: FloatArray) -> None:
        at = self._stamp(n)
        if at is None:
            return
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
            here = self._of(n, row, column)
            sides = []
            for axis in (0, 1):
                self._places[n, axis] += _WIDTH_STEP
                sides.append((self._of(n, row, column) - here) / _WIDTH_STEP)
                self._places[n, axis] -= _WIDTH_STEP
            self._scales[n] *= 1.0 + _WIDTH_STEP
            wider = (self._of(n, row, column) - here) / _WIDTH_STEP
            self._scales[n] /= 1.0 + _WIDTH_STEP
            design = np.stack([each.ravel() for each in (here, *sides, wider, np.ones_like(here))])
            weights = 1.0 / (noise**2 + (_MODEL_ERROR * flux * here.ravel()) ** 2)
            found = np.linalg.lstsq(
                (design * weights) @ design.T, (design * weights) @ light.ravel(), rcond=None
            )[0]
            flux = float(found[0])
            if flux <= 0.0:
                self._places[n], self._scales[n] = place, scale
                return
            step = np.clip(found[1:4] / flux, -0.3, 0.3)
            moved = np.clip(self._places[n] + step[:2] - place, -reach_px, reach_px)
            self._places[n] = place + moved
            changed = self._scales[n] * math.exp(float(step[2])) / scale
            self._scales[n] = scale * min(max(changed, 1.0 / _MAX_WIDER), _MAX_WIDER)


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
