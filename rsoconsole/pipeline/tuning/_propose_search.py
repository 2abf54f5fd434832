"""Search for the most likely settings and for the intervals of their values. Pure."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rsoconsole.records import FloatArray

HALF_WIDTH = 0.5
"""Fall of log L from its maximum to the ends of a parameter's 68 % interval (Wilks 1938)."""
_WORST = -1e12
_FINE = {"xatol": 0.02, "fatol": 0.01}
_COARSE = {"xatol": 0.1, "fatol": 0.05}
_CORNER = 0.5
_STRIDE = 0.2
"""Spacing of a parabola's three points, in natural logarithms."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """Parameter of the search: one setting, or several settings with a common value."""

    label: str
    names: tuple[str, ...]
    recorded: float
    low: float
    high: float
    scan: tuple[float, ...]
    """Factors on the recorded value with which the search begins."""

    def fixed_at(self, value: float) -> "Parameter":
        """Return the parameter with its bounds narrowed to one value."""
        return replace(self, low=value, high=value, scan=())

    def clipped(self, log_value: float) -> float:
        """Return the logarithm of a value, limited to the parameter's bounds."""
        return min(max(log_value, math.log(self.low)), math.log(self.high))


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """Likeliest values of some parameters, while all other settings are as recorded."""

    parameters: tuple[Parameter, ...]
    values: tuple[float, ...]
    log_likelihood: float

    def settings(self) -> dict[str, float]:
        """Return the values of all settings that the fit sets, by dotted name."""
        pairs = zip(self.parameters, self.values, strict=True)
        return {name: value for parameter, value in pairs for name in parameter.names}

    def value(self, parameter: Parameter) -> float:
        """Return the fitted value of a parameter; the recorded one where it was not fitted."""
        pairs = zip(self.parameters, self.values, strict=True)
        found = (value for each, value in pairs if each.names == parameter.names)
        return next(found, parameter.recorded)


@dataclass(slots=True)
class LikelihoodSearch:
    """Maximises a likelihood over the logarithms of parameters."""

    log_likelihood: Callable[[Mapping[str, float]], float]
    """Log-likelihood of settings by dotted name; not finite where the filter fails."""
    on_evaluation: Callable[[], None] = lambda: None
    evaluations: int = 0
    _known: dict[tuple[tuple[str, float], ...], float] = field(default_factory=dict)

    def log_likelihood_at(self, parameters: Sequence[Parameter], logs: Iterable[float]) -> float:
        """Return the log-likelihood with parameters at values given by their natural logarithms."""
        pairs = zip(parameters, logs, strict=True)
        settings = {
            name: parameter.low
            if parameter.low == parameter.high
            else math.exp(parameter.clipped(float(log)))
            for parameter, log in pairs
            for name in parameter.names
        }
        key = tuple(sorted(settings.items()))
        if key not in self._known:
            self.evaluations += 1
            self.on_evaluation()
            value = self.log_likelihood(settings)
            self._known[key] = value if math.isfinite(value) else _WORST
        return self._known[key]

    def fit(
        self,
        parameters: tuple[Parameter, ...],
        start: Fit | None = None,
        *,
        is_coarse: bool = False,
    ) -> Fit:
        """Return the likeliest values of the parameters.

        ``start``: fit with values near them; None: a scan finds the start. ``is_coarse``: stop with
        a lower accuracy.
        """
        if not parameters:
            return Fit(parameters=(), values=(), log_likelihood=self.log_likelihood_at((), ()))
        if start is None:
            logs = self._scanned(parameters)
        else:
            logs = np.log([start.value(parameter) for parameter in parameters])
        return self._refined(parameters, logs, _COARSE if is_coarse else _FINE)

    def interval(
        self, parameter: Parameter, best: Fit, fall: float = HALF_WIDTH
    ) -> tuple[float, float]:
        """Return the profile interval (lower, upper) of a parameter of the fit ``best``.

        ``fall``: decrease of log L from its maximum to each end; the default gives a 68 % interval.
        Where log L decreases less, the end is the parameter's bound.
        """
        place = best.parameters.index(parameter)
        ends = tuple(self._end(place, best, sense, fall) for sense in (-1.0, 1.0))
        return math.exp(ends[0]), math.exp(ends[1])

    def gain_lower_bound(self, parameter: Parameter, best: Fit) -> float:
        """Return a lower bound of the gain in log L by one more parameter in the fit ``best``.

        The parameter alone is scanned, while the fitted values stay as they are.
        """
        logs = [math.log(parameter.recorded), *np.log(best.values)]
        heights = [best.log_likelihood]
        for factor in parameter.scan:
            logs[0] = parameter.clipped(math.log(parameter.recorded * factor))
            heights.append(self.log_likelihood_at((parameter, *best.parameters), logs))
        return max(heights) - best.log_likelihood

    def unbounded_sides(self, parameter: Parameter, best: Fit) -> tuple[bool, bool]:
        """Return (lower, upper): True where the data do not exclude that bound of the parameter.

        There the profile of log L is less than ``HALF_WIDTH`` below its maximum.
        """
        place = next(n for n, p in enumerate(best.parameters) if p.names == parameter.names)
        others = [each for each in best.parameters if each.names != parameter.names]
        logs = np.log([value for n, value in enumerate(best.values) if n != place])
        falls = (
            self._fall(parameter, math.log(edge), others, logs, best)[0]
            for edge in (parameter.low, parameter.high)
        )
        is_open_below, is_open_above = (fall < HALF_WIDTH for fall in falls)
        return is_open_below, is_open_above

    def _scanned(self, parameters: tuple[Parameter, ...]) -> FloatArray:
        """Best of a grid: one parameter after another, each with the best of those before."""
        logs = np.log([parameter.recorded for parameter in parameters])
        for _ in range(2 if len(parameters) > 1 else 1):
            for place, parameter in enumerate(parameters):
                trials = [logs.copy() for _ in parameter.scan]
                for trial, factor in zip(trials, parameter.scan, strict=True):
                    trial[place] = parameter.clipped(math.log(parameter.recorded * factor))
                logs = max(
                    [logs, *trials], key=lambda each: self.log_likelihood_at(parameters, each)
                )
        return np.asarray(logs)

    def _refined(
        self, parameters: tuple[Parameter, ...], logs: FloatArray, options: Mapping[str, float]
    ) -> Fit:
        from scipy.optimize import minimize

        held = tuple(each for each in parameters if each.low == each.high)
        sought = tuple(each for each in parameters if each.low < each.high)
        if not sought:
            values = tuple(each.low for each in held)
            log_likelihood = self.log_likelihood_at(held, np.log(values))
            return Fit(parameters=held, values=values, log_likelihood=log_likelihood)
        at_held = [math.log(each.low) for each in held]
        logs = np.array(
            [log for each, log in zip(parameters, logs, strict=True) if each not in held]
        )
        bounds = [(math.log(each.low), math.log(each.high)) for each in sought]
        start = np.array([each.clipped(log) for each, log in zip(sought, logs, strict=True)])
        found = minimize(
            lambda x: -self.log_likelihood_at((*sought, *held), (*x, *at_held)),
            start,
            method="Nelder-Mead",
            bounds=bounds,
            options={**options, "initial_simplex": _simplex(start, bounds), "maxfev": 120},
        )
        return Fit(
            parameters=(*sought, *held),
            values=(*(math.exp(value) for value in found.x), *(each.low for each in held)),
            log_likelihood=-float(found.fun),
        )

    def _end(self, place: int, best: Fit, sense: float, most: float) -> float:
        """Logarithm at which the profile has fallen by ``most``, or the bound before that."""
        parameter = best.parameters[place]
        at = math.log(best.values[place])
        bound = math.log(parameter.high if sense > 0.0 else parameter.low)
        others = [each for each in best.parameters if each is not parameter]
        logs = np.log([value for n, value in enumerate(best.values) if n != place])
        inside, outside, step = (0.0, 0.0), None, 0.25
        for _ in range(12):
            width = min(step, abs(bound - at))
            fall, logs = self._fall(parameter, at + sense * width, others, logs, best)
            if fall >= most:
                outside = (width, fall)
                break
            inside = (width, fall)
            if width == abs(bound - at):
                return bound
            step *= 2.0
        if outside is None:
            return bound
        for _ in range(2):
            width = _between(inside, outside, most)
            fall, _ = self._fall(parameter, at + sense * width, others, logs, best)
            inside, outside = (inside, (width, fall)) if fall >= most else ((width, fall), outside)
        return at + sense * _between(inside, outside, most)

    def _fall(
        self,
        parameter: Parameter,
        log_value: float,
        others: Sequence[Parameter],
        logs: FloatArray,
        best: Fit,
    ) -> tuple[float, FloatArray]:
        """Return (fall of the profile below the best, logarithms of the other parameters there)."""
        together = (parameter, *others)
        logs, height = np.array(logs, float), self.log_likelihood_at(together, (log_value, *logs))
        for place in [*range(len(others))] * min(len(others), 2):
            logs, height = self._climbed(together, log_value, logs, height, place)
        return best.log_likelihood - height, logs

    def _climbed(
        self,
        together: Sequence[Parameter],
        log_value: float,
        logs: FloatArray,
        height: float,
        place: int,
    ) -> tuple[FloatArray, float]:
        """Move to the top of the parabola through three points along one of the others."""
        heights = []
        for side in (-_STRIDE, _STRIDE):
            beside = logs.copy()
            beside[place] = together[place + 1].clipped(logs[place] + side)
            heights.append(self.log_likelihood_at(together, (log_value, *beside)))
        bend = heights[0] - 2.0 * height + heights[1]
        step = math.copysign(3.0 * _STRIDE, heights[1] - heights[0])
        if bend < 0.0:
            step = _STRIDE * (heights[0] - heights[1]) / (2.0 * bend)
            step = min(max(step, -6.0 * _STRIDE), 6.0 * _STRIDE)
        there = logs.copy()
        there[place] = together[place + 1].clipped(logs[place] + step)
        above = self.log_likelihood_at(together, (log_value, *there))
        return (there, above) if above > height else (logs, height)


def _simplex(start: FloatArray, bounds: Sequence[tuple[float, float]]) -> FloatArray:
    """Return corners about a start, inside the bounds."""
    corners = [start]
    for place, (_, high) in enumerate(bounds):
        corner = start.copy()
        corner[place] += _CORNER if corner[place] + _CORNER <= high else -_CORNER
        corners.append(corner)
    return np.array(corners)


def _between(inside: tuple[float, float], outside: tuple[float, float], fall: float) -> float:
    """Return the distance at which a parabola through both has fallen by ``fall``."""
    (w0, f0), (w1, f1) = inside, outside
    r0, r1 = math.sqrt(max(f0, 0.0)), math.sqrt(f1)
    share = (math.sqrt(fall) - r0) / max(r1 - r0, 1e-9)
    return w0 + min(max(share, 0.05), 0.95) * (w1 - w0)
