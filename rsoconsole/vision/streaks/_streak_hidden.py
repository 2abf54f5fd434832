"""Ends of a streak that lie where pixels are masked: behind a star, or mistaken for a star.

The fit does not determine such an end. The light along the line still limits it: the streak reaches
at least to the last light that is no star's, and no further than the last light of all.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from rsoconsole.records import FloatArray
from rsoconsole.vision.arrays import BoolArray
from rsoconsole.vision.lines.streak_search import Cutout
from rsoconsole.vision.streaks._streak_model import LineFit

_LONGEST_PX = 40
_TOUCHES_PX = 2.0
_BEYOND_PX = 4
_LIT = 0.5
"""Share of the streak's level at which an end lies."""
_CLEAR_PX = 1.5
"""Distance beyond a star's own light from which light is the streak's, px."""
_WING = 1
"""Number of bins beside a masked star that its wings light."""
_AT_PX = 0.5
_SURE = 2.0
"""Sigmas of the mean light that separate lit from dark."""
_KNOWN_PX = 0.7
"""One sigma of an end read off the light alone, px."""
_MIN_LEVEL, _SURE_LEVEL = 3.0, 6.0
"""Levels over a bin's noise: least to show anything, and from which one bin is enough."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Profile:
    """Light along the line, masked or not."""

    first: int
    """u of the first bin, px; bins are a pixel long."""
    light: FloatArray
    """Light per pixel of length, ADU."""
    noise: float
    is_hidden: BoolArray
    """True where more than half of the line's core is masked."""


def with_masked_ends_moved(
    cutout: Cutout, axes: tuple[FloatArray, FloatArray], fit: LineFit, is_used: BoolArray
) -> LineFit:
    """Move ends of a fit that lie behind masked pixels to their estimated places.

    - axes: u along and v across for every pixel of the cutout, (h, w) each
    - is_used: pixels that the fit used, (h, w)

    The returned fit has ``hidden_variance`` for the ends that were moved.
    """
    profile = _profile_of(cutout, axes, fit, is_used)
    if profile is None:
        return fit
    line, ends, variance = fit.line, [fit.line.u_a, fit.line.u_b], [0.0, 0.0]
    covariance = fit.covariance
    for side, sense in ((0, -1), (1, 1)):
        end = ends[side]
        if end is None:
            continue
        end_sigma_px = math.sqrt(max(float(covariance[side, side]), 0.0))
        within_px = _TOUCHES_PX + 2.0 * min(end_sigma_px, _TOUCHES_PX)
        stretch = _hidden_about(profile, end, within_px)
        if stretch is None:
            continue
        level = line.amplitudes[0 if side == 0 else -1]
        outward = _outward(stretch, sense, profile.light.size)
        hidden, bin_of_end = stretch[1] - stretch[0], end - profile.first
        if level < _MIN_LEVEL * profile.noise:
            if _lies_open(profile, stretch, sense, bin_of_end, level):
                continue
            # Too faint to be read off: anywhere in what is hidden.
            place, variance[side] = 0.5 * hidden, (0.5 * (hidden + 1)) ** 2
        else:
            read = _end_in(profile.light[outward], level, profile.noise, line.sigma)
            is_before = sense * (outward[0] - bin_of_end) > _AT_PX
            if read is None or (is_before and read[0] < _AT_PX):
                # Lit beyond what is hidden, or dark from there on: the end lies in the open.
                continue
            place, variance[side] = read
        ends[side] = profile.first + outward[0] + sense * place
        covariance = _given(covariance, side)
    moved = replace(line, u_a=ends[0], u_b=ends[1])
    return replace(
        fit, line=moved, covariance=covariance, hidden_variance=(variance[0], variance[1])
    )


def _given(covariance: FloatArray, side: int) -> FloatArray:
    """Covariance that remains when one of its parameters comes from elsewhere.

    What that one's own error means for the rest is left out: an end hardly bears on the others.
    """
    known = covariance[side, side]
    if not known > 0.0:
        return covariance
    # Where the fit knows nothing of it, its square is more than a number holds.
    share = covariance[side] / math.sqrt(known)
    rest = covariance - np.outer(share, share)
    rest[side, :] = rest[:, side] = 0.0
    return np.asarray(rest)


def _profile_of(
    cutout: Cutout, axes: tuple[FloatArray, FloatArray], fit: LineFit, is_used: BoolArray
) -> _Profile | None:
    (u, v), line = axes, fit.line
    off = v - line.offset - line.slope * u
    core = np.abs(off) < max(line.sigma, 0.8)
    near = np.abs(off) < 2.5 * line.sigma + 0.5
    if not core.any():
        return None
    first = int(np.rint(u[near].min()))
    count = int(np.rint(u[near].max())) - first + 1
    bins = np.rint(u[near]).astype(int) - first
    weight = np.exp(-0.5 * (off[near] / line.sigma) ** 2) / (np.sqrt(2.0 * np.pi) * line.sigma)
    squared = np.maximum(np.bincount(bins, weight**2, count), 1e-9)
    light = np.bincount(bins, weight * (cutout.values[near] - line.sky), count) / squared
    in_core = np.rint(u[core]).astype(int) - first
    inside = np.bincount(in_core, minlength=count)
    used = np.bincount(in_core, is_used[core], count)
    return _Profile(
        first=first,
        light=light,
        noise=float(cutout.noise / np.sqrt(np.median(squared))),
        is_hidden=(2 * used < inside) & (inside > 0),
    )


def _hidden_about(profile: _Profile, end: float, within_px: float) -> tuple[int, int] | None:
    """First and last hidden bin about an end; None where it lies open, or too much is hidden."""
    places = np.arange(profile.is_hidden.size) + profile.first
    hidden = np.flatnonzero(profile.is_hidden)
    if hidden.size == 0:
        return None
    low = high = int(hidden[np.argmin(np.abs(places[hidden] - end))])
    if abs(places[low] - end) > within_px:
        return None
    while low > 0 and profile.is_hidden[low - 1]:
        low -= 1
    while high < profile.is_hidden.size - 1 and profile.is_hidden[high + 1]:
        high += 1
    return (low, high) if 2 <= high - low < _LONGEST_PX else None


def _outward(stretch: tuple[int, int], sense: int, bins: int) -> list[int]:
    """Bins of a hidden stretch and a few more, from the streak's side on."""
    low, high = stretch
    if sense > 0:
        return list(range(low, min(high + _BEYOND_PX, bins - 1) + 1))
    return list(range(high, max(low - _BEYOND_PX, 0) - 1, -1))


def _lies_open(
    profile: _Profile, stretch: tuple[int, int], sense: int, bin_of_end: float, level: float
) -> bool:
    """True where the light between an end and a hidden stretch shows that the streak ends there.

    Dark on its outer side where it ends before what is hidden, lit on its inner side where it comes
    out behind.
    """
    near, far = stretch if sense > 0 else stretch[::-1]
    at = round(bin_of_end)
    # The bins next to a star's mask still have light of the star's.
    if sense * (near - at) > 0:
        open_bins = range(at + sense, near - _WING * sense, sense)
    else:
        open_bins = range(far + (1 + _WING) * sense, at + sense, sense)
    inside = [place for place in open_bins if 0 <= place < profile.light.size]
    if not inside:
        return False
    light = profile.light[inside]
    mean, error = float(light.mean()), profile.noise / math.sqrt(light.size)
    if sense * (near - at) > 0:
        return mean < level - _SURE * error
    return mean > _SURE * error


def _end_in(
    light: FloatArray, level: float, noise: float, sigma: float
) -> tuple[float, float] | None:
    """Place of the streak's end in bins from the first, and its variance; None: not in them."""
    # One bin of a faint streak is dark or lit by chance now and then, two together are not.
    span = 1 if level > _SURE_LEVEL * noise else 2
    is_lit = np.convolve(light, np.full(span, 1.0 / span), mode="valid") > _LIT * level
    dark = np.flatnonzero(~is_lit)
    if dark.size == 0:
        return None
    if dark[0] == 0:
        return 0.0, _KNOWN_PX**2
    # Lit again after a gap is another star.
    last = float(dark[0]) - 1.0 + 0.5 * (span - 1)
    run = light[: math.ceil(last) + 1]
    star = int(np.argmax(run))
    # As far as a star so bright alone would be taken for the streak.
    reach = sigma * math.sqrt(2.0 * math.log(max(float(run[star]) / (_LIT * level), 1.0)))
    if last > star + reach + _CLEAR_PX:
        return last + 0.5, _KNOWN_PX**2
    nearest = max(star - reach, 0.0)
    return 0.5 * (nearest + last), (last - nearest + 1.0) ** 2 / 12.0
