"""Width of the stars over the field: curved focal surface, tilt, soft corners.

The logarithm of the width is a polynomial of low order in the position: a slope in x and y, a bowl
in the distance from the middle (slope and bowl together are a bowl about another place), and a
steeper rim where the stars show one. The fit is robust, since the blend of two stars is too wide at
any place. It is used only where it is significant and large enough to matter; in other frames one
width holds everywhere.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from rsoconsole.records import FloatArray

WidthSource: TypeAlias = Literal["measured", "remembered", "guessed"]
"""Where the width of a frame's stars comes from: its own stars, earlier frames, or a guess."""

MIN_STARS = 40
"""Fewest stars for a fit: with fewer, scatter alone makes changes as large."""
_MIN_CHANGE = 0.08
"""Least change of width among the stars' places, largest over smallest less 1, that counts."""
_MIN_F = 12.0
"""Least F value of the change, per term: 1e-7 by chance; blends are more than chance."""
_MAX_SCATTER = 0.2
"""Largest relative scatter of single stars about the surface: beyond it no width follows."""
_BISQUARE = 4.685
"""Residual over its scatter from which a star counts nothing (Maronna et al. 2006, ch. 2)."""
_SIGMA_PER_MAD = 1.4826
_STEPS = 4
_SLOPE_AND_BOWL = 4
"""Number of coefficients, the constant among them, without the steeper rim's."""
_BEYOND = 0.25
"""Share of the range of widths at the stars by which the field may go beyond it elsewhere."""
_SMALLEST = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class PsfField:
    """Width of a star at any place of a frame, where it changes over the frame."""

    middle_px: tuple[float, float]
    """Column and row of the frame's middle; 0 is the centre of the first pixel."""
    half_diagonal_px: float
    """Half the frame's diagonal, px: the unit of distances from the middle."""
    log_fwhm: tuple[float, ...]
    """Natural logarithm of the width in px: constant, x, y, r^2 and, where needed, r^4."""
    log_range: tuple[float, float]
    """Smallest and largest natural logarithm of the width; beyond, the polynomial is clipped."""

    def at(self, x_px: float, y_px: float) -> float:
        """Full width at half maximum at one place, px."""
        return math.exp(float(self._log_at(np.array(x_px), np.array(y_px))))

    def all_at(self, x_px: FloatArray, y_px: FloatArray) -> FloatArray:
        """Full width at half maximum at many places, px, (n,) each."""
        return np.asarray(np.exp(self._log_at(x_px, y_px)))

    def _log_at(self, x_px: FloatArray, y_px: FloatArray) -> FloatArray:
        design = _design(x_px, y_px, self.middle_px, self.half_diagonal_px)
        value = design[..., : len(self.log_fwhm)] @ np.array(self.log_fwhm)
        return np.asarray(np.clip(value, *self.log_range))

    def in_binned_pixels(self, side: float) -> "PsfField":
        """Return the field in the pixels of a frame binned by ``side``.

        ``side`` below 1 goes from a binned frame back to a finer one.
        """
        x, y = ((place + 0.5) / side - 0.5 for place in self.middle_px)
        return replace(
            self._times(1.0 / side), middle_px=(x, y), half_diagonal_px=self.half_diagonal_px / side
        )

    def through(self, x_px: FloatArray, y_px: FloatArray, fwhm_px: FloatArray) -> "PsfField":
        """Scale the field by one factor to fit the widths of other stars; return the new field.

        Places and widths (n,), n at least 1; the factor is the median of measured over expected
        width.
        """
        factor = np.median(fwhm_px / self.all_at(x_px, y_px))
        return self._times(float(factor))

    def _times(self, factor: float) -> "PsfField":
        more = math.log(factor)
        low, high = self.log_range
        return replace(
            self,
            log_fwhm=(self.log_fwhm[0] + more, *self.log_fwhm[1:]),
            log_range=(low + more, high + more),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Psf:
    """Width of a frame's stars, the only property of a point-spread function needed here."""

    fwhm_px: float
    """Median over the frame, px."""
    field: PsfField | None = None
    """Width over the frame; None: the same everywhere."""

    def in_binned_pixels(self, side: float) -> "Psf":
        """Return the width in the pixels of a frame binned by ``side``."""
        if side == 1:
            return self
        field = None if self.field is None else self.field.in_binned_pixels(side)
        return Psf(fwhm_px=self.fwhm_px / side, field=field)


def fit_psf_field(
    x_px: FloatArray, y_px: FloatArray, fwhm_px: FloatArray, shape: tuple[int, int]
) -> PsfField | None:
    """Fit how the width of stars changes over a frame of ``shape`` (height, width).

    Places and widths of unsaturated stars, (n,) each. None where there are fewer than
    ``MIN_STARS``, where their widths follow no surface, and where the change is no more than their
    scatter explains or too small to matter.
    """
    if x_px.size < MIN_STARS:
        return None
    height, width = shape
    middle_px = 0.5 * (width - 1), 0.5 * (height - 1)
    half_diagonal_px = 0.5 * math.hypot(width, height)
    design = _design(x_px, y_px, middle_px, half_diagonal_px)
    log_fwhm = np.log(np.maximum(fwhm_px, _SMALLEST))
    bowl = design[:, :_SLOPE_AND_BOWL]
    found = _robust(bowl, log_fwhm)
    is_wild = _scatter(log_fwhm - bowl @ found) > _MAX_SCATTER
    if is_wild or _f_value(bowl, log_fwhm, found, 1) < _MIN_F:
        return None
    steeper = _robust(design, log_fwhm, np.append(found, 0.0))
    if _f_value(design, log_fwhm, steeper, _SLOPE_AND_BOWL) > _MIN_F:
        found = steeper
    at_stars = design[:, : found.size] @ found
    low, high = float(at_stars.min()), float(at_stars.max())
    more = _BEYOND * (high - low)
    field = PsfField(
        middle_px=middle_px,
        half_diagonal_px=half_diagonal_px,
        log_fwhm=tuple(found.tolist()),
        log_range=(low - more, high + more),
    )
    return field if high - low > math.log1p(_MIN_CHANGE) else None


def _design(
    x_px: FloatArray, y_px: FloatArray, middle_px: tuple[float, float], unit_px: float
) -> FloatArray:
    """Terms 1, x, y, r^2, r^4 of each place, (..., 5)."""
    x, y = (x_px - middle_px[0]) / unit_px, (y_px - middle_px[1]) / unit_px
    r2 = x * x + y * y
    return np.stack([np.ones_like(x), x, y, r2, r2 * r2], axis=-1)


def _robust(design: FloatArray, values: FloatArray, start: FloatArray | None = None) -> FloatArray:
    """Coefficients by Tukey's bisquare, from least absolute residuals where there is no start."""
    solution = start
    if solution is None:
        solution = np.zeros(design.shape[1])
        solution[0] = np.median(values)
        for _ in range(_STEPS):
            residual = values - design @ solution
            ratio = np.abs(residual) / _scatter(residual)
            solution = _weighted(design, values, 1.0 / np.maximum(ratio, 0.1))
    for _ in range(_STEPS):
        residual = values - design @ solution
        ratio = np.abs(residual) / _scatter(residual)
        weight = (1.0 - np.minimum(ratio / _BISQUARE, 1.0) ** 2) ** 2
        solution = _weighted(design, values, weight)
    return solution


def _weighted(design: FloatArray, values: FloatArray, weight: FloatArray) -> FloatArray:
    """Weighted least squares, with a tiny weight on terms that stars in a row leave open."""
    normal = design.T @ (weight[:, None] * design)
    normal.flat[:: design.shape[1] + 1] += _SMALLEST * values.size
    return np.asarray(np.linalg.solve(normal, design.T @ (weight * values)))


def _f_value(design: FloatArray, values: FloatArray, found: FloatArray, first: int) -> float:
    """F value of the coefficients from ``first`` on against 0.

    Wald's statistic over their number: an F value where there are no outliers.
    """
    tested = found[first:]
    covariance = _covariance(design, values - design @ found)[first:, first:]
    return float(tested @ np.linalg.pinv(covariance) @ tested) / tested.size


def _scatter(residual: FloatArray) -> float:
    """One sigma of residuals by their median size."""
    middle = residual.size // 2
    return max(_SIGMA_PER_MAD * float(np.partition(np.abs(residual), middle)[middle]), _SMALLEST)


def _covariance(design: FloatArray, residual: FloatArray) -> FloatArray:
    """Covariance of coefficients by Tukey's bisquare.

    Source: Huber, Robust Statistics, 1981, eq. 7.6.6.
    """
    count, terms = design.shape
    u2 = np.minimum((residual / _scatter(residual) / _BISQUARE) ** 2, 1.0)
    psi = residual * (1.0 - u2) ** 2
    slope = max(float(np.mean((1.0 - u2) * (1.0 - 5.0 * u2))), 0.1)
    variance = float(psi @ psi) / (count - terms) / slope**2
    return np.asarray(variance * np.linalg.pinv(design.T @ design))
