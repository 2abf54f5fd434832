"""How the light of a line lies along it: steadily, in one period, or here and there as stars do."""

import itertools
import math
from dataclasses import replace

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.vision.frame import median_of
from rsoconsole.vision.lines.line_strip import BoolArray, Course, LineProfile, LineStrip, profile_of
from rsoconsole.vision.stars import FWHM_PER_SIGMA

_MOST_PARTS = 48
_ENOUGH, _LEAST_SEEN = 8, 0.3
_FEWEST_PARTS = 3
_MAD_TO_SIGMA = 1.4826
_SMALLEST = 1e-9


def confusion(strip: LineStrip, known: BoolArray, course: Course, sigma: float) -> float:
    """Scatter of what a line's parts would be beside it, over their noise; 1 at least.

    Faint stars, glow and a bright star's wings are part of it: the frame's own yardstick.
    """
    window = max(round(2.0 * FWHM_PER_SIGMA * sigma), 2)
    away = 3.5 * sigma + 2.0
    found: list[float] = []
    for sense in (-1.0, 1.0):
        for further in (0.0, 2.0 * sigma + 1.0):
            offset = course.offset + sense * (away + further)
            beside = profile_of(strip, replace(course, offset=offset), sigma)
            used = known & beside.is_known
            light, error = beside.light[used], beside.error[used]
            whole = light.size // window * window
            if whole:
                means = light[:whole].reshape(-1, window).mean(axis=1)
                errors = np.sqrt((error[:whole].reshape(-1, window) ** 2).mean(axis=1) / window)
                found += (means / errors).tolist()
    if len(found) < _ENOUGH:
        return 1.0
    each = np.array(found)
    return max(1.0, _MAD_TO_SIGMA * median_of(np.abs(each - np.median(each))))


def texture(profile: LineProfile, ends: tuple[float, float], scatter: float) -> tuple[float, float]:
    """(lower quartile of the parts, as sigma of the whole; scatter that nothing explains).

    ``scatter``: noise of a part in units of what its pixels make (``confusion``).
    """
    length = ends[1] - ends[0]
    count = int(np.clip(length / (2.0 * FWHM_PER_SIGMA * profile.sigma), 3, _MOST_PARTS))
    found = _parts(profile, ends, count, scatter)
    if len(found) < _FEWEST_PARTS:
        # A star hides a part: finer ones tell what is left.
        found = _parts(profile, ends, 2 * count, scatter)
    if len(found) < _FEWEST_PARTS:
        return 0.0, 0.0
    place, light, sigmas = (np.array(column) for column in zip(*found, strict=True))
    quartile = float(np.percentile(light / sigmas, 25.0)) * math.sqrt(len(found))
    return quartile, _roughness(place, light, sigmas)


def _parts(
    profile: LineProfile, ends: tuple[float, float], count: int, scatter: float
) -> list[tuple[float, float, float]]:
    """(place, light, one sigma of it) of the parts of which enough is seen."""
    found: list[tuple[float, float, float]] = []
    for low, high in itertools.pairwise(np.linspace(ends[0], ends[1], count + 1).tolist()):
        part = profile.between(low, high)
        known = int(np.count_nonzero(part))
        if known >= max(2.0, _LEAST_SEEN * (high - low)):
            noise = math.sqrt(float((profile.error[part] ** 2).sum())) / known
            found.append((0.5 * (low + high), float(profile.light[part].mean()), scatter * noise))
    return found


def _roughness(place: FloatArray, light: FloatArray, sigmas: FloatArray) -> float:
    """Root of the variance that neither a parabola nor one sine explains, over the mean."""
    n = light.size
    t = (place - place.mean()) / max(float(np.ptp(place)), 1.0) * 2.0
    slow = np.vander(t, 3 if n >= 8 else 2 if n >= 5 else 1, increasing=True)
    basis, _ = np.linalg.qr(slow)
    rest = light - basis @ (basis.T @ light)
    used, left = basis.shape[1], float(rest @ rest)
    if n >= 10:
        phase = np.pi * t[:, None] * np.linspace(1.0, n / 2.5, 4 * n)
        explained = explained_by_a_wave(rest, basis, np.cos(phase), np.sin(phase))
        gained = min(max(explained, 0.0), left)
        # As much as the best of that number of periods takes of mere noise is no period.
        if gained > (2.0 * math.log(4.0 * n) + 4.0) * float(np.mean(sigmas**2)):
            left, used = left - gained, used + 3
    if n <= used:
        return 0.0
    excess = left / (n - used) - float(np.mean(sigmas**2))
    return math.sqrt(max(excess, 0.0)) / max(float(light.mean()), _SMALLEST)


def explained_by_a_wave(
    rest: FloatArray, basis: FloatArray, cosines: FloatArray, sines: FloatArray
) -> float:
    """Of the sum of squares of ``rest`` (n,) what the best of k waves (n, k) takes.

    ``basis`` (n, m), orthonormal: what ``rest`` is free of, and the waves are freed of.
    """
    c = cosines - basis @ (basis.T @ cosines)
    s = sines - basis @ (basis.T @ sines)
    cc, ss, cs = (np.einsum("ij,ij->j", a, b) for a, b in ((c, c), (s, s), (c, s)))
    rc, rs = rest @ c, rest @ s
    det = np.maximum(cc * ss - cs**2, 1e-6 * np.maximum(cc * ss, _SMALLEST))
    return float(((ss * rc**2 - 2.0 * cs * rc * rs + cc * rs**2) / det).max())
