"""How the light varies along a line, and how restless the sky is beside it."""

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
