"""Period of a light curve, with the probability that noise alone makes one like it. Pure.

Two periodograms (astropy's LombScargle) are searched, for they have different noise and windows:
whole streaks about their slow trend, for periods longer than an exposure, and the changes along
streaks, for periods down to a few steps. All peaks of both, and with them the images that the
cadence makes of one another, are then fitted to all data at once, and the best one is the period.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from rsoconsole.night._light_fit import HarmonicFit, LightData, fit_harmonics, light_data
from rsoconsole.night.light_curve import MAG_PER_E, LightCurve
from rsoconsole.records import FloatArray

MIN_POINTS = 20
"""Smallest number of points in which a period is searched."""
MIN_CYCLES = 4.0
"""Smallest number of periods in the data."""
MIN_STEPS_A_PERIOD = 3.0
"""Smallest number of steps in a period."""
CLAIM_PROBABILITY = 0.01
"""False-alarm probability below which a period is claimed."""
MAX_HARMONICS = 4
SAMPLES_PER_PEAK = 5
MAX_FREQUENCIES = 400_000
_PEAKS = 30
"""Number of peaks of each periodogram that are fitted to all data."""
_LOCAL_PEAKS = 12
"""Reach of the noise level about a frequency, to both sides, in widths of a peak."""
_PER_PARAMETER = 7.0
"""Gain in -2 ln likelihood that a further parameter must bring: about one in a thousand."""
_WINDOW_PEAK = 0.25
"""Power of the spectral window, 1 at most, from which slow changes have an image there."""
_ALIKE = 10.0
"""Difference in -2 ln likelihood below which two periods fit alike."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LightPeriod:
    """A period of a light curve."""

    period_s: float
    sigma_s: float
    """One sigma of the period, s, if it is no multiple of the true one."""
    amplitude_mag: float
    """Faintest minus brightest of the fitted curve, magnitudes."""
    harmonics: int
    """Number of harmonics that the curve's shape needs."""
    cycles: float
    """Number of periods from the first point to the last."""
    aliases_s: tuple[float, ...] = ()
    """Other periods that fit the data as well, s: images by the cadence; longest first."""

    @property
    def half_s(self) -> float:
        """Half of the period, s: the true one where one turn looks like two unequal halves."""
        return self.period_s / 2.0

    @property
    def double_s(self) -> float:
        """Double of the period, s: that of a body whose two sides look alike."""
        return 2.0 * self.period_s


@dataclass(frozen=True, slots=True, kw_only=True)
class PeriodSearch:
    """Result of a search for the period of a light curve."""

    points: int
    """Number of points searched: whole streaks, and steps where there are enough of them."""
    false_alarm_probability: float | None = None
    """Probability that noise makes the highest peak or a higher one; None: nothing was searched."""
    min_period_s: float | None = None
    """Shortest period searched, s; None: nothing was searched."""
    max_period_s: float | None = None
    period: LightPeriod | None = None
    """The period; None where the probability is not below ``CLAIM_PROBABILITY``."""


class _Periodogram(NamedTuple):
    """Frequencies with their power, and the false-alarm probability of the highest."""

    frequencies_hz: FloatArray
    powers: FloatArray
    probability: float


def find_period(curve: LightCurve) -> PeriodSearch:
    """Search a light curve for a period.

    At least ``MIN_POINTS`` whole streaks, or as many steps, are needed.
    """
    data = light_data(curve)
    if data is None:
        return PeriodSearch(points=len(curve.points))
    points = data.t_s.size + data.step_t_s.size
    searched = [each for each in (_of_streaks(data), _of_steps(data)) if each is not None]
    if not searched:
        return PeriodSearch(points=points)
    probability = min(1.0, len(searched) * min(each.probability for each in searched))
    sure = [e for e in searched if len(searched) * e.probability < CLAIM_PROBABILITY]
    period = _best_period(data, sure) if sure else None
    return PeriodSearch(
        points=points,
        false_alarm_probability=probability,
        min_period_s=1.0 / max(float(each.frequencies_hz[-1]) for each in searched),
        max_period_s=1.0 / min(float(each.frequencies_hz[0]) for each in searched),
        period=period,
    )


def _of_streaks(data: LightData) -> _Periodogram | None:
    """Periodogram of whole streaks, down to two exposures; images by the cadence are told later."""
    if data.t_s.size < MIN_POINTS or data.span_s <= 0.0:
        return None
    known_s = data.exposure_s[np.isfinite(data.exposure_s)]
    shortest_s = 2.0 * (float(np.median(known_s)) if known_s.size else data.cadence_s)
    window = MIN_CYCLES / data.span_s, 1.0 / shortest_s
    fit, *_ = np.linalg.lstsq(data.basis / data.sigma[:, None], data.light / data.sigma, rcond=None)
    values = data.light - data.basis @ fit
    return _periodogram((data.t_s, values, data.sigma), window, data.span_s, has_images=True)


def _of_steps(data: LightData) -> _Periodogram | None:
    """Periodogram of the changes along streaks, from four streaks' time to a few steps."""
    if data.step_t_s.size < MIN_POINTS or data.step_s <= 0.0:
        return None
    span_s = float(np.ptp(data.step_t_s))
    slowest = max(MIN_CYCLES / span_s, 0.25 / data.streak_s)
    window = slowest, 1.0 / (MIN_STEPS_A_PERIOD * data.step_s)
    points = data.step_t_s, data.step_light, data.step_sigma
    return _periodogram(points, window, span_s, has_images=False)


def _periodogram(
    points: tuple[FloatArray, FloatArray, FloatArray],
    window_hz: tuple[float, float],
    span_s: float,
    *,
    has_images: bool,
) -> _Periodogram | None:
    from astropy.timeseries import LombScargle

    (t_s, values, sigma), (lowest, highest) = points, window_hz
    step = 1.0 / (SAMPLES_PER_PEAK * span_s)
    count = min(int((highest - lowest) / step) + 1, MAX_FREQUENCIES)
    if count < 2:
        return None
    frequencies = np.asarray(lowest + step * np.arange(count), float)
    found = LombScargle(t_s, values, sigma)
    powers = found.power(frequencies, method="fast", assume_regular_frequency=True)
    powers = np.clip(np.nan_to_num(powers), 0.0, 1.0 - 1e-15)
    if has_images:
        powers[_is_image_of_slow(frequencies, t_s, MIN_CYCLES / span_s)] = 0.0
    # Noise that is not white, and steps that are not independent, raise the power about a
    # frequency: a peak is compared with what surrounds it.
    freedom = (t_s.size - 3) / 2.0
    logs = -freedom * np.log1p(-powers)
    logs /= _level(logs)
    best = float(-np.expm1(-logs.max() / freedom))
    probability = found.false_alarm_probability(
        min(best, 1.0 - 1e-15), method="baluev", maximum_frequency=float(frequencies[-1])
    )
    return _Periodogram(frequencies, powers, float(probability))


def _is_image_of_slow(frequencies: FloatArray, t_s: FloatArray, slow_hz: float) -> Any:
    """True for frequencies at which the cadence shows changes slower than those searched.

    They lie about the peaks of the spectral window: multiples of the cadence's frequency.
    """
    step = frequencies[1] - frequencies[0]
    grid = np.arange(0.0, float(frequencies[-1]) + slow_hz + step, step)
    window = np.zeros(grid.size)
    for at in range(0, grid.size, 4096):
        phase = np.exp(2j * np.pi * np.outer(grid[at : at + 4096], t_s))
        window[at : at + 4096] = np.abs(phase.mean(axis=1)) ** 2
    peaks = grid[(window > _WINDOW_PEAK) & (grid > slow_hz)]
    nearest = np.searchsorted(peaks, frequencies)
    padded = np.concatenate([[-np.inf], peaks, [np.inf]])
    away = np.minimum(frequencies - padded[nearest], padded[nearest + 1] - frequencies)
    return away < slow_hz


def _level(logs: FloatArray) -> FloatArray:
    """Level of the noise about each frequency, in units of that of white noise; 1 or more."""
    from scipy.ndimage import median_filter, uniform_filter1d

    size = 2 * SAMPLES_PER_PEAK * _LOCAL_PEAKS + 1
    median = median_filter(logs, size=min(size, 2 * (logs.size // 2) + 1), mode="reflect")
    return np.asarray(np.maximum(uniform_filter1d(median, size) / math.log(2.0), 1.0), float)


def _best_period(data: LightData, searched: list[_Periodogram]) -> LightPeriod | None:
    lowest = min(float(each.frequencies_hz[0]) for each in searched)
    highest = max(float(each.frequencies_hz[-1]) for each in searched)
    width = 1.0 / data.span_s
    starts = sorted({frequency for each in searched for frequency in _peaks(each)})
    rough = sorted((fit_harmonics(data, each, 1) for each in starts), key=lambda each: each.cost)
    fine = [_refined(data, each, width) for each in rough[:8]]
    least = min(each.cost for each in fine)
    alike = sorted(
        (each for each in fine if each.cost < least + _ALIKE), key=lambda each: each.frequency_hz
    )
    best = _shaped(data, alike[0], (lowest, highest))
    others = tuple(
        1.0 / each.frequency_hz
        for each in alike[1:]
        if abs(each.frequency_hz - alike[0].frequency_hz) > width
    )
    return _period(data, best, others)


def _peaks(found: _Periodogram) -> list[float]:
    """Frequencies of the highest peaks of a periodogram."""
    padded = np.concatenate([[-1.0], found.powers, [-1.0]])
    is_peak = (padded[1:-1] >= padded[:-2]) & (padded[1:-1] >= padded[2:])
    at = np.flatnonzero(is_peak)
    highest = at[np.argsort(found.powers[at])[::-1][:_PEAKS]]
    return [float(each) for each in found.frequencies_hz[highest]]


def _shaped(data: LightData, one: HarmonicFit, window_hz: tuple[float, float]) -> HarmonicFit:
    """The frequency or a fraction of it, with the harmonics that the shape of the light needs."""
    width, best = 1.0 / data.span_s, one
    for fraction in (1, 2, 3):
        base_hz = one.frequency_hz / fraction
        if base_hz < window_hz[0]:
            break
        for harmonics in range(max(fraction, 2), MAX_HARMONICS + 1):
            if harmonics * base_hz > window_hz[1] * 1.0001:
                break
            found = _refined(data, fit_harmonics(data, base_hz, harmonics), width / fraction)
            more = 2.0 * (harmonics - best.harmonics)
            if found.cost + _PER_PARAMETER * more < best.cost:
                best = found
    return best


def _refined(data: LightData, fit: HarmonicFit, width_hz: float) -> HarmonicFit:
    """The fit at the frequency nearby that fits best: by parabolas through three costs."""
    best = fit
    for reach in (0.15 * width_hz, 0.03 * width_hz):
        low, high = (
            fit_harmonics(data, best.frequency_hz + off, best.harmonics) for off in (-reach, reach)
        )
        bend = low.cost - 2.0 * best.cost + high.cost
        shift = reach * (0.5 * (low.cost - high.cost) / bend if bend > 0.0 else 0.0)
        shift = min(max(shift, -2.0 * reach), 2.0 * reach)
        at = fit_harmonics(data, best.frequency_hz + shift, best.harmonics)
        best = min((best, low, high, at), key=lambda each: each.cost)
    return best


def _period(data: LightData, fit: HarmonicFit, others: tuple[float, ...]) -> LightPeriod:
    frequency = fit.frequency_hz
    step = 0.02 / data.span_s
    beside = [fit_harmonics(data, frequency + off, fit.harmonics).cost for off in (-step, step)]
    rise = max(sum(beside) / 2.0 - fit.cost, 1e-9)
    sigma_hz = step / math.sqrt(rise)
    return LightPeriod(
        period_s=1.0 / frequency,
        sigma_s=sigma_hz / frequency**2,
        amplitude_mag=_amplitude_mag(fit),
        harmonics=fit.harmonics,
        cycles=data.span_s * frequency,
        aliases_s=others,
    )


def _amplitude_mag(fit: HarmonicFit) -> float:
    phase = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    curve: Any = np.ones(phase.size)
    for number in range(fit.harmonics):
        cosine, sine = fit.coefficients[2 * number : 2 * number + 2]
        curve = curve + cosine * np.cos((number + 1) * phase) + sine * np.sin((number + 1) * phase)
    curve = np.maximum(curve, 0.01)
    return float(MAG_PER_E * math.log(curve.max() / curve.min()))
