"""The lit stretch along a guessed line: roughly where a streak begins and ends."""

from dataclasses import dataclass

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.vision.streak_model import BoolArray
from rsoconsole.vision.streak_search import Cutout, Guess

_WINDOW = 5
_PARTS = 6
_MOST_BINS = 100
_CAP, _HALF = 1.3, 0.45
"""Of the typical level: no brighter part counts more, and what is darker counts against."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ends:
    """A lit stretch along a guess."""

    u_a: float
    u_b: float
    amplitudes: tuple[float, ...]
    """ADU per pixel of length in equal parts of the stretch, first to last, calmed."""
    matched_snr: float
    """Of the stretch, roughly."""
    lit_share: float
    """Of the stretch's length, lit at more than a quarter of the amplitude."""
    reaches_rim: bool
    """True when the stretch runs into the cutout's edge, not the frame's: look further out."""


def find_ends(cutout: Cutout, guess: Guess, psf_sigma: float) -> Ends | None:
    """The lit stretch along a guess: where the light above half of its level adds up to most.

    Never weighted by flux: a bright part counts hardly more than the level.
    """
    profile, is_known, noise, first = _profile(cutout, guess, psf_sigma)
    if np.count_nonzero(is_known) < 5:
        return None
    level = _typical_level(profile, is_known, noise)
    if level is None:
        return None
    capped = np.where(is_known, np.minimum(profile, _CAP * level) - _HALF * level, 0.0)
    smooth = _smoothed(np.where(is_known, profile, 0.0), is_known)
    a, b = _largest_sum(capped)
    a, b = _extended(smooth > max(0.1 * level, 2.0 * noise / np.sqrt(_WINDOW)), a, b)
    if np.count_nonzero(is_known[a : b + 1]) < 3:
        return None
    inside = smooth[a : b + 1]
    known = np.flatnonzero(is_known)
    parts = np.array_split(inside, min(_PARTS, inside.size))
    return Ends(
        u_a=float(first + a) - 0.5,
        u_b=float(first + b) + 0.5,
        amplitudes=_calm(tuple(max(float(np.median(part)), 0.05 * level) for part in parts)),
        matched_snr=float(np.sqrt(inside.size) * np.mean(np.minimum(inside, 3.0 * level)) / noise),
        lit_share=float(np.mean(inside > 0.25 * level)),
        reaches_rim=bool(a <= known[0] + 4 or b >= known[-1] - 4),
    )


def _calm(amplitudes: tuple[float, ...]) -> tuple[float, ...]:
    """Running median of three: one part brightened by a star does not count."""
    padded = np.array([amplitudes[0], *amplitudes, amplitudes[-1]])
    return tuple(float(a) for a in np.median([padded[:-2], padded[1:-1], padded[2:]], axis=0))


def _smoothed(profile: FloatArray, is_known: BoolArray) -> FloatArray:
    """Running mean over the known bins of a few pixels; 0 where none is known."""
    window = np.ones(_WINDOW)
    count = np.convolve(is_known.astype(np.float64), window, mode="same")
    return np.asarray(np.convolve(profile, window, mode="same") / np.maximum(count, 1.0))


def _extended(is_lit: BoolArray, a: int, b: int) -> tuple[int, int]:
    """The stretch a..b and what is lit without a gap on either side: a fading end belongs to it."""
    while a > 0 and is_lit[a - 1]:
        a -= 1
    while b < is_lit.size - 1 and is_lit[b + 1]:
        b += 1
    # The running mean is lit half a window beyond the light itself.
    trim = _WINDOW // 2
    return (a + trim, b - trim) if b - a > 4 * trim else (a, b)


def _profile(
    cutout: Cutout, guess: Guess, psf_sigma: float
) -> tuple[FloatArray, BoolArray, float, int]:
    """Light per pixel of length, where it is known, its typical noise, u of the first bin."""
    yy, xx = np.mgrid[0 : cutout.values.shape[0], 0 : cutout.values.shape[1]]
    x, y = xx + (cutout.x0 - guess.x_px), yy + (cutout.y0 - guess.y_px)
    u, v = x * guess.dx + y * guess.dy, y * guess.dx - x * guess.dy
    near = np.abs(v) < 3.0 * psf_sigma + 0.5
    if not near.any():
        return np.zeros(0), np.zeros(0, dtype=bool), cutout.noise, 0
    bins = np.rint(u[near]).astype(int)
    first = int(bins.min())
    across = np.exp(-0.5 * (v[near] / psf_sigma) ** 2) / (np.sqrt(2 * np.pi) * psf_sigma)
    good = cutout.is_good[near]
    count = int(bins.max()) - first + 1
    nominal = 1.0 / (2.0 * np.sqrt(np.pi) * psf_sigma)
    total = np.bincount(bins - first, across * cutout.values[near] * good, count)
    share = np.bincount(bins - first, across**2 * good, count)
    is_known = share > 0.4 * nominal
    profile = np.where(is_known, total / np.maximum(share, 1e-9), 0.0)
    return profile, is_known, float(cutout.noise / np.sqrt(nominal)), first


def _typical_level(profile: FloatArray, is_known: BoolArray, noise: float) -> float | None:
    """Mean of the stretch that is least likely to be plain sky; None when none stands out."""
    group = -(-profile.size // _MOST_BINS)
    if group > 1:
        size = profile.size // group * group
        count = is_known[:size].reshape(-1, group).sum(axis=1)
        total = np.where(is_known, profile, 0.0)[:size].reshape(-1, group).sum(axis=1)
        profile, is_known = total / np.maximum(count, 1), 2 * count > group
        noise /= float(np.sqrt(group))
    level: float | None = None
    for _ in range(2):
        cap = 6.0 * noise if level is None else 1.5 * level
        capped = np.where(is_known, np.clip(profile, -3.0 * noise, max(cap, noise)), 0.0)
        total = np.concatenate([[0.0], np.cumsum(capped)])
        known = np.concatenate([[0.0], np.cumsum(is_known.astype(np.float64))])
        sums = total[None, :] - total[:, None]
        counts = np.maximum(known[None, :] - known[:, None], 1.0)
        gain = np.where(sums > 0, sums**2 / counts, 0.0)
        gain[np.tril_indices(gain.shape[0], 3)] = 0.0
        a, b = np.unravel_index(int(np.argmax(gain)), gain.shape)
        if gain[a, b] < (4.0 * noise) ** 2:
            return None
        values = profile[a:b][is_known[a:b]]
        level = float(np.median(values)) if values.size else None
        if level is None or level <= 0:
            return None
    return level


def _largest_sum(values: FloatArray) -> tuple[int, int]:
    """First and last index of the stretch with the largest sum (Kadane)."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    lowest = np.minimum.accumulate(total)
    end = int(np.argmax(total[1:] - lowest[:-1]))
    start = int(np.argmin(total[: end + 1]))
    return start, end
