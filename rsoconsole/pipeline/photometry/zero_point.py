"""Zero point of a frame from its catalogue stars, with their colour, and with cloud that varies.

The magnitude of a star that gives 1 ADU a second is the same over a clear frame and a slow function
of place under cloud: a Gaussian process over the field, whose height and length the stars
themselves decide by their likelihood (Rasmussen & Williams 2006, ch. 5). Its error at a streak is
larger where stars are far.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from rsoconsole.records import FloatArray

SUN_COLOUR_MAG = 0.73
"""BT - VT of the Sun, of whose light satellites shine."""
OBJECT_COLOUR_SIGMA_MAG = 0.25
"""One sigma of a satellite's BT - VT about the Sun's."""
MIN_STARS = 5
MAX_STARS = 60
_COLOUR_PRIOR_SIGMA = 0.5
"""One sigma of a colour term before a star is seen: 0.2 to 0.4 without a filter or in red, more in
blue."""
_HEIGHTS_MAG = (0.01, 0.03, 0.08, 0.2, 0.5)
_LENGTHS = (0.12, 0.25, 0.6)
"""Lengths over which cloud changes, in units of the frame's diagonal."""
_SCATTERS_MAG = (0.003, 0.008, 0.015, 0.025, 0.04, 0.06, 0.1, 0.15, 0.25)
_SCATTER_PRIOR_MAG = 0.06
"""Mean scatter of stars beyond noise and catalogue beforehand, of an exponential prior."""
_HEIGHT_PRIOR_MAG = 0.2
"""Mean height of cloud beforehand, likewise."""
_CUT_SIGMAS, _ROUNDS = 3.5, 3
_STRANGE_SIGMAS, _MAX_STRANGE_SHARE = 1.8, 0.25
"""Residual from which a star may be left out for another reason, and largest share of those."""
_STRANGE_COST = 3.4
"""Gain in the others' log likelihood from which a star is variable, a blend or another one: one in
twenty is, anywhere within 2 mag."""
_FLAT_MAG = 3.0
"""One sigma of the level of the zero point beforehand: none of it is known."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ZeroPointStars:
    """Measured catalogue stars; arrays (n,)."""

    places_px: FloatArray
    """(n, 2)."""
    zero_mag: FloatArray
    """Catalogue magnitude less instrumental one: the zero point by each star alone."""
    sigma_mag: FloatArray
    """One sigma of that by noise and catalogue."""
    colour_mag: FloatArray
    """BT - VT; NaN where it is not known."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ZeroPoint:
    """Zero point over a frame at the Sun's colour."""

    stars: int
    mag: float
    """Mean over the frame."""
    sigma_mag: float
    scatter_mag: float
    """Root mean square of the stars about one zero point and colour term."""
    star_scatter_mag: float
    """One sigma of a star beyond noise, catalogue and cloud, as of a point's light."""
    colour_term: float
    """Change of the zero point per magnitude of BT - VT."""
    colour_term_sigma: float
    _places_px: FloatArray
    _solved: FloatArray
    _inverse: FloatArray
    _height_mag: float
    _length_px: float
    _level_mag: float

    @property
    def colour_sigma_mag(self) -> float:
        """One sigma of a magnitude by the object's unknown colour."""
        term = math.hypot(self.colour_term, self.colour_term_sigma)
        return term * OBJECT_COLOUR_SIGMA_MAG

    def along(self, places_px: FloatArray) -> tuple[float, float]:
        """Return (zero point, its sigma), mag, in the mean over places (n, 2) in the frame."""
        between = _kernel(places_px, self._places_px, self._height_mag, self._length_px)
        own = _kernel(places_px, places_px, self._height_mag, self._length_px)
        mean = between.mean(axis=0)
        variance = float(own.mean()) - float(mean @ self._inverse @ mean)
        level = self._level_mag + float(mean @ self._solved)
        return level, math.sqrt(max(variance, 1e-8))


def fit_zero_point(stars: ZeroPointStars, size_px: tuple[int, int]) -> ZeroPoint | None:
    """Fit zero point and colour term to a frame of ``size_px`` (width, height).

    None with fewer than ``MIN_STARS`` stars. Stars far off, as variable ones and blends, are left
    out.
    """
    kept = np.isfinite(stars.zero_mag) & np.isfinite(stars.sigma_mag)
    diagonal_px = math.hypot(*size_px)
    if int(kept.sum()) < MIN_STARS:
        return None
    fit = _Fit(stars, kept, diagonal_px)
    for _ in range(_ROUNDS):
        left = np.abs(fit.leave_one_out()) > _CUT_SIGMAS
        if not left.any():
            break
        kept[np.flatnonzero(kept)[left]] = False
        if int(kept.sum()) < MIN_STARS:
            return None
        fit = _Fit(stars, kept, diagonal_px)
    return _without_strange(stars, kept, fit).zero_point(size_px)


def _without_strange(stars: ZeroPointStars, kept: npt.NDArray[np.bool_], fit: "_Fit") -> "_Fit":
    """Leave out stars without which the others agree better than chance has it.

    A few that are far off widen the scatter until none of them is beyond its sigmas; so the worst
    are left out one after the other, and the likeliest of these choices is taken.
    """
    count = int(kept.sum())
    best, best_score = fit, fit.log_likelihood
    kept = kept.copy()
    for left_out in range(1, min(int(_MAX_STRANGE_SHARE * count), count - MIN_STARS) + 1):
        off = np.abs(fit.leave_one_out())
        worst = int(np.argmax(off))
        if off[worst] < _STRANGE_SIGMAS:
            break
        kept[np.flatnonzero(kept)[worst]] = False
        fit = _Fit(stars, kept, fit.diagonal_px)
        score = fit.log_likelihood - _STRANGE_COST * left_out
        if score > best_score:
            best, best_score = fit, score
    return best


def _kernel(one: FloatArray, other: FloatArray, height: float, length_px: float) -> FloatArray:
    """Covariance of the zero point between places: the frame's level, and cloud."""
    apart = np.hypot(one[:, None, 0] - other[None, :, 0], one[:, None, 1] - other[None, :, 1])
    return np.asarray(_FLAT_MAG**2 + height**2 * np.exp(-0.5 * (apart / length_px) ** 2))


class _Fit:
    """Gaussian process over some stars, with the likeliest height, length and scatter."""

    def __init__(
        self, stars: ZeroPointStars, kept: npt.NDArray[np.bool_], diagonal_px: float
    ) -> None:
        self.places = stars.places_px[kept]
        colour = stars.colour_mag[kept]
        is_known = np.isfinite(colour)
        typical = float(np.median(colour[is_known])) if is_known.any() else SUN_COLOUR_MAG
        self.colour = np.where(is_known, colour, typical) - SUN_COLOUR_MAG
        unknown = np.where(is_known, 0.0, 0.4 * _COLOUR_PRIOR_SIGMA)
        self.level = float(np.median(stars.zero_mag[kept]))
        self.left = stars.zero_mag[kept] - self.level
        self.variance = stars.sigma_mag[kept] ** 2 + unknown**2
        self.diagonal_px = diagonal_px
        best = -math.inf
        apart = np.hypot(*(self.places[:, None, :] - self.places[None, :, :]).transpose(2, 0, 1))
        common = _FLAT_MAG**2 + _COLOUR_PRIOR_SIGMA**2 * np.outer(self.colour, self.colour)
        for scatter in _SCATTERS_MAG:
            score = self._log_likelihood(common, scatter)
            if score > best:
                best, self.height, self.scatter = score, 0.0, scatter
        self.length_px = _LENGTHS[-1] * diagonal_px
        widest = _SCATTERS_MAG.index(self.scatter)
        scatters = _SCATTERS_MAG[max(widest - 4, 0) : widest + 1]
        # A look with one length; the other two where that says that there is cloud.
        for lengths in (_LENGTHS[1:2], (_LENGTHS[0], _LENGTHS[2])):
            for height in _HEIGHTS_MAG:
                for share in lengths:
                    cloud = height**2 * np.exp(-0.5 * (apart / (share * diagonal_px)) ** 2)
                    for scatter in scatters[::-2]:
                        # Cloud is believed where the stars show it, not by a hair.
                        score = self._log_likelihood(common + cloud, scatter)
                        score -= 1.0 + height / _HEIGHT_PRIOR_MAG
                        if score > best:
                            best, self.height, self.scatter = score, height, scatter
                            self.length_px = share * diagonal_px
            if self.height == 0.0:
                break
        self.log_likelihood = best
        self.inverse, self.solved = self._solve()

    def _covariance(self) -> FloatArray:
        shape = _kernel(self.places, self.places, self.height, self.length_px)
        shape = shape + _COLOUR_PRIOR_SIGMA**2 * np.outer(self.colour, self.colour)
        return np.asarray(shape + np.diag(self.variance + self.scatter**2))

    def _log_likelihood(self, shape: FloatArray, scatter: float) -> float:
        factor = np.linalg.cholesky(shape + np.diag(self.variance + scatter**2))
        solved = np.linalg.solve(factor, self.left)
        by_stars = -0.5 * float(solved @ solved) - float(np.log(np.diag(factor)).sum())
        return by_stars - scatter / _SCATTER_PRIOR_MAG

    def _solve(self) -> tuple[FloatArray, FloatArray]:
        inverse = np.asarray(np.linalg.inv(self._covariance()), dtype=np.float64)
        return inverse, inverse @ self.left

    def leave_one_out(self) -> FloatArray:
        """Residual of each star against all others, in its sigmas (Rasmussen & Williams, 5.4.2)."""
        diagonal = np.diag(self.inverse)
        return np.asarray(self.solved / diagonal * np.sqrt(diagonal))

    def zero_point(self, size_px: tuple[int, int]) -> ZeroPoint:
        """Return the zero point over a frame of ``size_px``."""
        prior = _COLOUR_PRIOR_SIGMA**2
        term = prior * float(self.colour @ self.solved)
        term_variance = prior - prior**2 * float(self.colour @ self.inverse @ self.colour)
        rest = self.left - term * self.colour
        width, height = size_px
        grid = np.stack(
            np.meshgrid(np.linspace(0, width, 4), np.linspace(0, height, 4)), axis=-1
        ).reshape(-1, 2)
        found = ZeroPoint(
            stars=len(self.left),
            mag=self.level,
            sigma_mag=self.scatter,
            scatter_mag=float(np.std(rest)),
            star_scatter_mag=self.scatter,
            colour_term=term,
            colour_term_sigma=math.sqrt(max(term_variance, 0.0)),
            _places_px=self.places,
            _solved=self.solved,
            _inverse=self.inverse,
            _height_mag=self.height,
            _length_px=self.length_px,
            _level_mag=self.level,
        )
        mag, sigma = found.along(grid)
        return replace(found, mag=mag, sigma_mag=sigma)
