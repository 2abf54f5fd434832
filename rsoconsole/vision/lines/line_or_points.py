"""Whether the light along a short line is one line's or that of a few stars in a row.

Both are put through the stars' own width and fitted to the profile along the line: points, as many
as it takes up to ``_MOST_POINTS``, each for the price of a star that happens to stand there,
against a line with two ends, for nothing, whose brightness changes slowly or in one period. Points
closer than about two widths explain a line as well as a line does: it is ahead by their price then,
as it is in front of a faint star. Where drift has drawn the stars out, a point is as long as they
are in the line's direction.
"""

import math

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.vision.frame import best_pair
from rsoconsole.vision.lines.line_strip import LineProfile
from rsoconsole.vision.lines.line_texture import explained_by_a_wave
from rsoconsole.vision.stars import FWHM_PER_SIGMA

MOST_FWHM = 30.0
"""Length in widths of a star up to which a few stars may look like a line."""
_MOST_POINTS = 4
_PRICE_OF_A_POINT, _PRICE_OF_A_PERIOD = 12.0, 16.0
"""Chi-square: place and light of a star in the field's own density; period, depth and phase of a
tumbling body."""
_UNLIKE = 0.12
"""What the profile of a line and of a star differ from ours by, as a share of the mean light."""
_STEP_SIGMAS, _BEYOND_SIGMAS = 0.4, 4.0
_LEAST_PERIOD_SIGMAS, _MOST_PERIODS = 10.0, 8.0
_FEWEST = 5
_LIT_SHARE = 0.1
"""Of the highest correlation with a star anywhere: where there is less none is tried."""
_ACROSS_FWHM = 1.5
"""What of a trail that crosses a line is seen in its profile."""
_SMALLEST = 1e-9


def line_over_points(
    profile: LineProfile, ends: tuple[float, float], scatter: float, drawn_px: float = 0.0
) -> float:
    """By how much chi-square prefers one line to the best few points; negative: points it is.

    0 where it is too long for the question or too little of it is seen. ``scatter``: noise in units
    of what the pixels make (``line_texture.confusion``). ``drawn_px``: length of a drawn-out star
    along the line.
    """
    sigma, length = profile.sigma, ends[1] - ends[0]
    if length > MOST_FWHM * FWHM_PER_SIGMA * sigma:
        return 0.0
    beyond = _BEYOND_SIGMAS * sigma
    used = profile.between(ends[0] - beyond, ends[1] + beyond)
    inside = profile.between(*ends)
    if np.count_nonzero(inside) < _FEWEST:
        return 0.0
    u, light = profile.columns[used].astype(np.float64), profile.light[used]
    mean = max(float(profile.light[inside].mean()), 0.0)
    error = np.hypot(scatter * profile.error[used], _UNLIKE * mean)
    value = light / error
    left_by_line = _left_by_line(u, value, error, ends, sigma)
    left_by_points = _left_by_points(u, value, error, sigma, drawn_px)
    return left_by_points - left_by_line


def _left_by_line(
    u: FloatArray, value: FloatArray, error: FloatArray, ends: tuple[float, float], sigma: float
) -> float:
    """Chi-square of the best line, with the price of a period where it has one."""
    from scipy.special import erf

    def inside(place: FloatArray) -> FloatArray:
        return np.asarray(0.5 * (1.0 + erf(place / (math.sqrt(2.0) * sigma))))

    length, middle = max(ends[1] - ends[0], 1.0), 0.5 * (ends[0] + ends[1])
    box = inside(u - ends[0]) * inside(ends[1] - u) / error
    t = 2.0 * (u - middle) / length
    basis, _ = np.linalg.qr(np.stack([box, box * t], axis=1))
    rest = value - basis @ (basis.T @ value)
    left = float(rest @ rest)
    most = min(_MOST_PERIODS, length / (_LEAST_PERIOD_SIGMAS * sigma))
    if most < 1.0:
        return left
    phase = math.pi * t[:, None] * np.linspace(1.0, most, 4 * math.ceil(most))
    cosines, sines = box[:, None] * np.cos(phase), box[:, None] * np.sin(phase)
    explained = explained_by_a_wave(rest, basis, cosines, sines)
    return min(left, left - min(explained, left) + _PRICE_OF_A_PERIOD)


def drawn_along(length_px: float, turn_deg: float, fwhm_px: float) -> float:
    """How long a star's trail is along a line turned against it, within the line's width."""
    turn = math.radians(turn_deg)
    along = length_px * abs(math.cos(turn))
    return min(along, _ACROSS_FWHM * fwhm_px / max(abs(math.sin(turn)), 1e-3))


def _left_by_points(
    u: FloatArray, value: FloatArray, error: FloatArray, sigma: float, drawn_px: float
) -> float:
    """Chi-square of the best few points, with their price: the best pair, then one more each."""
    places = np.arange(u[0], u[-1] + 1e-6, _STEP_SIGMAS * sigma)
    away = u[:, None] - places
    if drawn_px > sigma:
        from scipy.special import erf

        half, blur = 0.5 * drawn_px, math.sqrt(2.0) * sigma
        shapes = 0.5 * (erf((away + half) / blur) - erf((away - half) / blur)) / error[:, None]
    else:
        shapes = np.exp(-0.5 * (away / sigma) ** 2) / error[:, None]
    projected = shapes.T @ value
    is_lit = projected > _LIT_SHARE * float(projected.max())
    if not is_lit.any():
        return float(value @ value)
    shapes, projected = shapes[:, is_lit], projected[is_lit]
    gram = shapes.T @ shapes
    own = np.maximum(np.diag(gram), _SMALLEST)
    total = float(value @ value)
    single = np.maximum(projected, 0.0) ** 2 / own
    best = total - float(single.max()) + _PRICE_OF_A_POINT
    chosen = best_pair(gram, projected)
    for count in range(2, _MOST_POINTS + 1):
        if count > 2:
            chosen.append(_one_more(shapes, value, chosen))
        rest = value - shapes[:, chosen] @ _lights(shapes, value, chosen)
        best = min(best, float(rest @ rest) + count * _PRICE_OF_A_POINT)
    return best


def _one_more(shapes: FloatArray, value: FloatArray, chosen: list[int]) -> int:
    rest = value - shapes[:, chosen] @ _lights(shapes, value, chosen)
    norm = np.maximum(np.einsum("ij,ij->j", shapes, shapes), _SMALLEST)
    return int(np.argmax(np.maximum(rest @ shapes, 0.0) ** 2 / norm))


def _lights(shapes: FloatArray, value: FloatArray, chosen: list[int]) -> FloatArray:
    """Of a number of points, none of them dark."""
    from scipy.optimize import nnls

    lights, _ = nnls(shapes[:, chosen], value)
    return np.asarray(lights)
