"""Fits of harmonics to a light curve: whole streaks and steps within them, each with its noise.

The light of a streak as a whole and the changes within it are fitted together, but each level has
a noise of its own, taken from the fit: transparency changes from frame to frame and leaves the
steps within a frame alone. Light of a whole streak is compared with the mean of the model over it.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from rsoconsole.night.light_curve import LightCurve
from rsoconsole.records import FloatArray

TREND_ORDER = 3
"""Order of the polynomial in time that stands for phase angle, range and air mass."""
MIN_STEPS = 5
"""Smallest number of steps of a streak that are used as such."""
SHARED_NOISE = 2.0
"""Number of steps with the information of an independent one: neighbours share a star's width."""
_FITS = 4
"""Number of fits in which the noise of the two levels settles."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LightData:
    """A light curve ready for the search: relative to its slow trend, times in seconds."""

    t_s: FloatArray
    """Times of whole streaks since the first, s, (streaks,)."""
    light: FloatArray
    """Light of whole streaks by its trend, minus 1."""
    sigma: FloatArray
    exposure_s: FloatArray
    basis: FloatArray
    """Polynomials of the trend, (streaks, order + 1)."""
    step_t_s: FloatArray
    """Times of steps, s, (steps,), streak by streak."""
    step_light: FloatArray
    """Light of steps by the trend, minus its mean over the streak."""
    step_sigma: FloatArray
    starts: Any
    """Index of the first step of each streak with steps, (streaks with steps,)."""
    streak_of_step: Any
    """Index among the streaks with steps, (steps,)."""
    stepped: Any
    """Index among all streaks of each streak with steps, (streaks with steps,)."""

    @property
    def span_s(self) -> float:
        """Time from the first point to the last, s."""
        times = np.concatenate([self.t_s, self.step_t_s])
        return float(np.ptp(times)) if times.size else 0.0

    @property
    def step_s(self) -> float:
        """Median time from one step to the next within a streak, s; 0 without steps."""
        inner = np.diff(self.step_t_s)[np.diff(self.streak_of_step) == 0]
        return float(np.median(inner)) if inner.size else 0.0

    @property
    def streak_s(self) -> float:
        """Median time that the steps of a streak cover, s; 0 without steps."""
        if not self.starts.size:
            return 0.0
        last = np.append(self.starts[1:], self.step_t_s.size) - 1
        return float(np.median(self.step_t_s[last] - self.step_t_s[self.starts])) + self.step_s

    @property
    def cadence_s(self) -> float:
        """Median time from one streak to the next, s; 0 for a single one."""
        return float(np.median(np.diff(self.t_s))) if self.t_s.size > 1 else 0.0


def light_data(curve: LightCurve) -> LightData | None:
    """Prepare a curve for the search; None without any light.

    Saturated streaks are left out. The trend is a polynomial through the whole streaks.
    """
    points, steps = curve.points, curve.steps
    is_good = ~points.is_saturated & (points.light_sigma > 0.0)
    if not is_good.any():
        return None
    t_0_ns = int(points.t_utc_ns[is_good][0])
    t_s = (points.t_utc_ns[is_good] - t_0_ns) / 1e9
    frame_ids = points.frame_ids[is_good]
    light, sigma = points.light[is_good], points.light_sigma[is_good]
    reach_s = max(float(np.ptp(t_s)), 1.0)
    order = min(TREND_ORDER, max(t_s.size // 5 - 1, 0))
    basis = _basis(t_s, reach_s, order)
    trend, *_ = np.linalg.lstsq(basis / sigma[:, None], light / sigma, rcond=None)
    scale = _positive(basis @ trend, light)

    parts: list[tuple[int, FloatArray, FloatArray, FloatArray]] = []
    for number, frame_id in enumerate(frame_ids):
        own = (steps.frame_ids == frame_id) & (steps.light_sigma > 0.0)
        if own.sum() < MIN_STEPS:
            continue
        at_s = (steps.t_utc_ns[own] - t_0_ns) / 1e9
        along = _positive(_basis(at_s, reach_s, order) @ trend, light)
        relative = steps.light[own] / along
        noise = steps.light_sigma[own] / along
        parts.append((number, at_s, relative - relative.mean(), noise))
    sizes = [each[1].size for each in parts]
    return LightData(
        t_s=t_s,
        light=light / scale - 1.0,
        sigma=sigma / scale,
        exposure_s=points.exposure_s[is_good],
        basis=basis,
        step_t_s=_joined([each[1] for each in parts]),
        step_light=_joined([each[2] for each in parts]),
        step_sigma=_joined([each[3] for each in parts]),
        starts=np.cumsum([0, *sizes[:-1]]) if sizes else np.zeros(0, int),
        streak_of_step=np.repeat(np.arange(len(sizes)), sizes),
        stepped=np.array([each[0] for each in parts], int),
    )


def _basis(t_s: FloatArray, reach_s: float, order: int) -> FloatArray:
    return np.asarray(np.polynomial.legendre.legvander(2.0 * t_s / reach_s - 1.0, order), float)


def _positive(trend: FloatArray, light: FloatArray) -> FloatArray:
    """The trend, nowhere below a tenth of the median light."""
    return np.maximum(trend, 0.1 * max(float(np.median(light)), 1e-9))


def _joined(parts: list[FloatArray]) -> FloatArray:
    return np.concatenate(parts) if parts else np.zeros(0)


class HarmonicFit(NamedTuple):
    """Fit of a number of harmonics of one frequency."""

    frequency_hz: float
    harmonics: int
    cost: float
    """-2 ln of the likelihood, up to a constant, with the noise of both levels from the fit."""
    coefficients: FloatArray
    """Cosine and sine of each harmonic in turn, (2 x harmonics,), of light by its trend."""


class _Level(NamedTuple):
    """Normal equations of one level: whole streaks, or steps."""

    gram: FloatArray
    right: FloatArray
    square: float
    freedom: float

    def chi2(self, solution: FloatArray) -> float:
        value = self.square - 2.0 * solution @ self.right + solution @ self.gram @ solution
        return max(float(value), 1e-9 * self.square, 1e-12)


def fit_harmonics(data: LightData, frequency_hz: float, harmonics: int) -> HarmonicFit:
    """Fit harmonics of a frequency, and the trend, to whole streaks and steps together."""
    order = data.basis.shape[1]
    of_steps = _waves(data.step_t_s, frequency_hz, harmonics)
    of_streaks = _waves(data.t_s, frequency_hz, harmonics)
    # The light of a streak is the mean over its exposure.
    exposure_s = np.nan_to_num(data.exposure_s)[:, None]
    number = np.repeat(np.arange(1, harmonics + 1), 2)
    of_streaks *= np.sinc(frequency_hz * number * exposure_s)
    if data.starts.size:
        sizes = np.diff(np.append(data.starts, data.step_t_s.size))[:, None]
        means = np.add.reduceat(of_steps, data.starts, axis=0) / sizes
        of_steps -= means[data.streak_of_step]
        of_streaks[data.stepped] = means
    levels = [
        _level(np.hstack([data.basis, of_streaks]), data.light, data.sigma, order),
        _level(
            np.hstack([np.zeros((of_steps.shape[0], order)), of_steps]),
            data.step_light,
            data.step_sigma,
            data.starts.size,
        ),
    ]
    levels[1] = levels[1]._replace(freedom=levels[1].freedom / SHARED_NOISE)
    used = [each for each in levels if each.freedom > 2 * harmonics]
    if not used:
        return HarmonicFit(frequency_hz, harmonics, np.inf, np.zeros(2 * harmonics))
    scales = [1.0] * len(used)
    solution = np.zeros(order + 2 * harmonics)
    for _ in range(_FITS):
        gram = sum((each.gram / s for each, s in zip(used, scales, strict=True)), np.zeros(1))
        right = sum((each.right / s for each, s in zip(used, scales, strict=True)), np.zeros(1))
        solution = np.asarray(np.linalg.lstsq(gram, right, rcond=1e-10)[0], float)
        scales = [each.chi2(solution) / each.freedom for each in used]
    cost = sum(each.freedom * np.log(s) for each, s in zip(used, scales, strict=True))
    return HarmonicFit(frequency_hz, harmonics, float(cost), solution[order:])


def _level(columns: FloatArray, values: FloatArray, sigma: FloatArray, fixed: int) -> _Level:
    columns, values = columns / sigma[:, None], values / sigma
    return _Level(
        columns.T @ columns, columns.T @ values, float(values @ values), len(values) - fixed
    )


def _waves(t_s: FloatArray, frequency_hz: float, harmonics: int) -> FloatArray:
    phase = 2.0 * np.pi * frequency_hz * t_s[:, None] * np.arange(1, harmonics + 1)
    return np.stack([np.cos(phase), np.sin(phase)], axis=2).reshape(t_s.size, 2 * harmonics)
