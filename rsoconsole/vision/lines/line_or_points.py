"""One line or a few stars in a row: which explains the profile of a short line better.

Both models are blurred by the stars' width and fitted to the profile along the line:

- points: as many as the profile needs, up to ``_MAX_POINTS``; each adds to chi-square the price of
  a star that happens to stand there
- line: two ends, and a brightness that changes slowly or in one period; no price

Points closer than about two widths fit a line as well as a line does; their price then decides for
the line, and so it does where a faint star stands on it. Where drift has drawn the stars out, a
point is as long as they are in the line's direction.
"""

import math

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.vision.arrays import BoolArray
from rsoconsole.vision.frame.median import median_of, quantiles_of
from rsoconsole.vision.lines.line_strip import LineProfile, LineStrip, StripLine, light_along
from rsoconsole.vision.stars.star_moments import FWHM_PER_SIGMA

_MAX_PARTS = 48
_ENOUGH, _MIN_SEEN = 8, 0.3
_MIN_PARTS = 3
_MAD_TO_SIGMA = 1.4826
_SMALLEST = 1e-9


def surroundings_scatter_ratio(
    strip: LineStrip, known: BoolArray, course: StripLine, sigma: float
) -> float:
    """Scatter of the sky beside a line over the noise expected of its pixels, at least 1.

    Measured in parts as long as the line's own. Faint stars, glow and a bright star's wings raise
    it. ``known``: columns to use; ``sigma``: of the Gaussian across, px.
    """
    window = max(round(2.0 * FWHM_PER_SIGMA * sigma), 2)
    away = 3.5 * sigma + 2.0
    found: list[float] = []
    further = away + 2.0 * sigma + 1.0
    columns = np.flatnonzero(known)
    paths = course.at(columns).astype(np.float32) + np.array(
        [[-away], [-further], [away], [further]], dtype=np.float32
    )
    beside = light_along(strip.values[:, columns], strip.is_good[:, columns], paths, sigma)
    for light, error in zip(*beside, strict=True):
        used = error < np.inf
        whole = np.count_nonzero(used) // window * window
        if whole:
            sums = light[used][:whole].reshape(-1, window).sum(axis=1)
            variances = (error[used][:whole].reshape(-1, window) ** 2).sum(axis=1)
            found += (sums / np.sqrt(variances)).tolist()
    if len(found) < _ENOUGH:
        return 1.0
    each = np.array(found)
    return max(1.0, _MAD_TO_SIGMA * median_of(np.abs(each - median_of(each))))


def line_texture(
    profile: LineProfile, ends: tuple[float, float], scatter: float
) -> tuple[float, float]:
    """Return two figures of the light along a line: its darker parts, and its roughness.

    - lower quartile of the parts' signal to noise, scaled to the whole line
    - relative scatter of the parts that neither a slow change nor a single period explains

    ``scatter``: noise of a part over that of its pixels (``LineTrace.confusion``).
    """
    length = ends[1] - ends[0]
    count = int(np.clip(length / (2.0 * FWHM_PER_SIGMA * profile.sigma), 3, _MAX_PARTS))
    place, light, sigmas = _parts(profile, ends, count, scatter)
    if place.size < _MIN_PARTS:
        # A star hides a part: finer ones tell what is left.
        place, light, sigmas = _parts(profile, ends, 2 * count, scatter)
    if place.size < _MIN_PARTS:
        return 0.0, 0.0
    (quartile,) = quantiles_of(light / sigmas, (0.25,))
    quartile *= math.sqrt(place.size)
    return quartile, _roughness(place, light, sigmas)


def _parts(
    profile: LineProfile, ends: tuple[float, float], count: int, scatter: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Place, light and one sigma of it, each (n,), of the parts of which enough is seen."""
    known = profile.is_known
    of_columns = np.zeros((3, known.size + 1))
    np.cumsum(
        [known, np.where(known, profile.light, 0.0), np.where(known, profile.error, 0.0) ** 2],
        axis=1,
        out=of_columns[:, 1:],
    )
    borders = np.linspace(ends[0], ends[1], count + 1)
    # A column on the border of two parts is of both.
    first = np.clip(np.ceil(borders[:-1]), 0, known.size).astype(np.intp)
    beyond = np.clip(np.floor(borders[1:]) + 1, 0, known.size).astype(np.intp)
    seen, light, variance = of_columns[:, beyond] - of_columns[:, first]
    is_enough = seen >= np.maximum(2.0, _MIN_SEEN * np.diff(borders))
    seen, light, variance = seen[is_enough], light[is_enough], variance[is_enough]
    place = 0.5 * (borders[:-1] + borders[1:])[is_enough]
    return place, light / seen, scatter * np.sqrt(variance) / seen


def _roughness(place: FloatArray, light: FloatArray, sigmas: FloatArray) -> float:
    """Root of the variance that neither a parabola nor one sine explains, over the mean."""
    n = light.size
    t = (place - place.mean()) / max(float(place[-1] - place[0]), 1.0) * 2.0
    terms: list[FloatArray] = []
    for power in range(3 if n >= 8 else 2 if n >= 5 else 1):
        term = t**power
        for each in terms:
            term = term - (each @ term) * each
        terms.append(term / math.sqrt(term @ term))
    basis = np.array(terms).T
    rest = light - basis @ (basis.T @ light)
    used, left = basis.shape[1], float(rest @ rest)
    if n >= 10:
        phase = np.pi * t[:, None] * np.linspace(1.0, n / 2.5, 4 * n)
        explained = best_wave_share(rest, basis, np.cos(phase), np.sin(phase))
        gained = min(max(explained, 0.0), left)
        # As much as the best of that number of periods takes of mere noise is no period.
        if gained > (2.0 * math.log(4.0 * n) + 4.0) * float(np.mean(sigmas**2)):
            left, used = left - gained, used + 3
    if n <= used:
        return 0.0
    excess = left / (n - used) - float(np.mean(sigmas**2))
    return math.sqrt(max(excess, 0.0)) / max(float(light.mean()), _SMALLEST)


def best_wave_share(
    rest: FloatArray, basis: FloatArray, cosines: FloatArray, sines: FloatArray
) -> float:
    """Reduction of the sum of squares of ``rest`` (n,) by the best of k waves.

    ``cosines``, ``sines``: (n, k). ``basis`` (n, m), orthonormal: terms already removed from
    ``rest``, which are removed from the waves too.
    """
    c = cosines - basis @ (basis.T @ cosines)
    s = sines - basis @ (basis.T @ sines)
    cc, ss, cs = (np.einsum("ij,ij->j", a, b) for a, b in ((c, c), (s, s), (c, s)))
    rc, rs = rest @ c, rest @ s
    det = np.maximum(cc * ss - cs**2, 1e-6 * np.maximum(cc * ss, _SMALLEST))
    return float(((ss * rc**2 - 2.0 * cs * rc * rs + cc * rs**2) / det).max())


MAX_FWHM = 30.0
"""Length in star widths up to which a few stars may look like a line."""
_MAX_POINTS = 4
_PRICE_OF_A_POINT, _PRICE_OF_A_PERIOD = 12.0, 16.0
"""Prices in chi-square: of a point (place and light), and of a period (depth and phase)."""
_UNLIKE = 0.12
"""Error of the model profiles of a line and of a star, as a share of the mean light."""
_STEP_SIGMAS, _BEYOND_SIGMAS = 0.4, 4.0
_MIN_PERIOD_SIGMAS, _MAX_PERIODS = 10.0, 8.0
_FEWEST = 5
_MIN_DETERMINED = 1e-3
"""Least determinant of two places, over the product of their own terms."""
_LIT_SHARE = 0.1
"""Share of the highest correlation with a star below which a place is left out."""
_ACROSS_FWHM = 1.5
"""Longest part of a crossing trail that counts in a line's profile, in star widths."""


def line_over_points_chi2(
    profile: LineProfile, ends: tuple[float, float], scatter: float, drawn_px: float = 0.0
) -> float:
    """Return chi-square of the best few points minus that of one line; < 0: points fit better.

    0 where the line is too long to compare or too little of it is seen. ``scatter``: factor by
    which the noise exceeds that of the pixels (``LineTrace.confusion``). ``drawn_px``: length of a
    star's trail along the line; 0: stars are points.
    """
    sigma, length = profile.sigma, ends[1] - ends[0]
    if length > MAX_FWHM * FWHM_PER_SIGMA * sigma:
        return 0.0
    beyond = _BEYOND_SIGMAS * sigma
    used = profile.is_known_between(ends[0] - beyond, ends[1] + beyond)
    inside = profile.is_known_between(*ends)
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
    most = min(_MAX_PERIODS, length / (_MIN_PERIOD_SIGMAS * sigma))
    if most < 1.0:
        return left
    phase = math.pi * t[:, None] * np.linspace(1.0, most, 4 * math.ceil(most))
    cosines, sines = box[:, None] * np.cos(phase), box[:, None] * np.sin(phase)
    explained = best_wave_share(rest, basis, cosines, sines)
    return min(left, left - min(explained, left) + _PRICE_OF_A_PERIOD)


def trail_along_line_px(length_px: float, turn_deg: float, fwhm_px: float) -> float:
    """Length of a star's trail along a line, px, as far as it lies within the line's width.

    ``turn_deg``: angle between trail and line; ``fwhm_px``: width of the trail across.
    """
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
    chosen = best_pair_of_lights(gram, projected)
    for count in range(2, _MAX_POINTS + 1):
        if count > 2:
            chosen.append(_one_more(shapes, value, chosen))
        rest = value - shapes[:, chosen] @ _lights(shapes, value, chosen)
        best = min(best, float(rest @ rest) + count * _PRICE_OF_A_POINT)
    return best


def best_pair_of_lights(gram: FloatArray, projected: FloatArray) -> list[int]:
    """Return the indices of the two places of n whose lights (>= 0) explain the data best.

    The same index twice where one place alone is best. ``gram`` (n, n): products of the places'
    images with each other; ``projected`` (n,): products of the images with the data.
    """
    own = np.maximum(np.diag(gram), _SMALLEST)
    single = np.maximum(projected, 0.0) ** 2 / own
    det = np.maximum(own[:, None] * own - gram**2, _MIN_DETERMINED * own[:, None] * own)
    first = (own[None] * projected[:, None] - gram * projected) / det
    gained = np.where(
        (first > 0.0) & (first.T > 0.0),
        first * projected[:, None] + first.T * projected,
        single[:, None],
    )
    return [int(at) for at in np.unravel_index(int(np.argmax(gained)), gained.shape)]


def _one_more(shapes: FloatArray, value: FloatArray, chosen: list[int]) -> int:
    rest = value - shapes[:, chosen] @ _lights(shapes, value, chosen)
    norm = np.maximum(np.einsum("ij,ij->j", shapes, shapes), _SMALLEST)
    return int(np.argmax(np.maximum(rest @ shapes, 0.0) ** 2 / norm))


def _lights(shapes: FloatArray, value: FloatArray, chosen: list[int]) -> FloatArray:
    """Lights of the chosen points, none of them negative."""
    from scipy.optimize import nnls

    lights, _ = nnls(shapes[:, chosen], value)
    return np.asarray(lights)
