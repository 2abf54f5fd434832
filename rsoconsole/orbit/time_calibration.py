"""What a shutter does, from satellites whose orbits are known better than any clock here. Pure.

A satellite seen d arcsec ahead of its place along its motion was seen d / rate late. Each measured
direction minus its orbit, at the instant that the frame's header names, is

    rate x (bias + scatter of the frame + row x line time) + drift of the night + place of the track
    + the measurement's own error,

where drift is what all catalogue stars of a night are off together, and the place of a track what
one orbit and its field's stars are off. Drift is told from time by satellites that go in several
directions. Scatter, the places and the scale of the measurements' own errors are variances, found
by restricted maximum likelihood (Patterson & Thompson 1971) with Fisher's scoring; what lies along
and across the motion tells them apart.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from rsoconsole.errors import OrbitError
from rsoconsole.records import FloatArray

Index = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

DRIFT_PRIOR_ARCSEC = 0.5
"""One sigma of what all stars of a night may be off together, stated: proper motions that are old
or not known."""
LINE_TIME_PRIOR_S = 300e-6
"""One sigma: no camera reads a row in a millisecond."""
LINE_TIME_KNOWN_S = 10e-6
"""A line time less sure than that is not found: the configured one stands."""
PLACE_PRIOR_ARCSEC = 0.05
"""What a track is off by itself, stated: its orbit and the stars of its field."""
PLACE_WIDTH = 2.0
"""How many times as far off it may be, one sigma."""
SCALE_PRIOR = 0.5
"""One sigma of how far off the scale of the measurements' own variances may be."""
FEWEST = 6
"""Measurements of a mode without which nothing is told of it."""
_TOO_FAR = 20.0
"""Of a measurement with two degrees of freedom: 4.5 sigma."""
_ROUNDS, _STEPS = 6, 40
_CLOSE = 1e-4
_LEAST_SCATTER_S = 1e-4
_SURELY_SOME = 3.0
"""Sigma of a variance below which there may be none."""
_PARALLEL = 0.5
"""Of the drift's prior: what is left of it where the satellites tell hardly anything of it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimedDirections:
    """N measured directions of satellites with known orbits; every array starts with N."""

    offset_arcsec: FloatArray
    """(N, 2) measured minus predicted for the header's mid-exposure, east and north."""
    rate_arcsec_s: FloatArray
    """(N, 2) of the satellite, east and north."""
    covariance_arcsec2: FloatArray
    """(N, 2, 2) of the measurement, without any error of its time."""
    row_px: FloatArray
    """The streak's middle row."""
    mode: Index
    """Place of its camera mode."""
    frame: Index
    """Number of its frame, unique over nights."""
    track: Index
    """Number of satellite and night together."""
    night: Index

    def __len__(self) -> int:
        return len(self.row_px)

    def of(self, chosen: Mask) -> "TimedDirections":
        """Some of them."""
        return TimedDirections(
            **{name: getattr(self, name)[chosen] for name in self.__dataclass_fields__}
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimated:
    """A value with its error, one sigma."""

    value: float
    sigma: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ShutterTiming:
    """What was found of one camera mode; seconds."""

    bias_s: Estimated
    """True mid-exposure of the first row minus the header's."""
    scatter_s: Estimated
    """From frame to frame, one sigma."""
    line_time_s: Estimated
    is_line_time_found: bool
    """Else it is what was configured, and the bias holds with that alone."""
    middle_row_px: float
    bias_at_middle_s: Estimated
    """At the rows where the streaks lie, where it is known best."""
    measurements: int
    frames: int
    tracks: int
    rejected: int
    night_spread_s: float = 0.0
    """By which the nights' biases differ more than their errors explain; in the bias's sigma."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeCalibration:
    """The whole adjustment."""

    modes: tuple[ShutterTiming | None, ...]
    """None where a mode has too few measurements."""
    drift_arcsec: tuple[tuple[Estimated, Estimated], ...]
    """Of each night, east and north: measured minus orbit."""
    is_told_apart: tuple[bool, ...]
    """Of each night: whether its satellites tell drift from time; else the prior does."""
    place_arcsec: float
    """One sigma of what a track is off by itself."""
    error_scale: float
    """Of the measurements' own sigmas."""
    is_used: tuple[bool, ...]
    """Of each direction; False: it does not fit."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Block:
    """Directions whose errors hang together."""

    z: FloatArray
    """(2n,)"""
    x: FloatArray
    """(2n, unknowns)"""
    parts: tuple[FloatArray, ...]
    """(2n, 2n) by which each variance contributes: scale, place, scatter of each mode."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Before:
    """What is known before: (value, sigma) of each mode's line time, and of a track's place."""

    modes: int
    nights: int
    lines: tuple[tuple[float, float], ...]
    place_arcsec: float

    @property
    def unknowns(self) -> int:
        """How many there are: biases, line times, drifts."""
        return 2 * self.modes + 2 * self.nights


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Fit:
    unknowns: FloatArray
    covariance: FloatArray
    variances: FloatArray
    variance_sigmas: FloatArray


def calibrate(
    seen: TimedDirections,
    *,
    modes: int,
    nights: int,
    line_time_s: Sequence[float],
    place_arcsec: float = PLACE_PRIOR_ARCSEC,
) -> TimeCalibration:
    """Bias, scatter and line time of each mode, and the drift of each night.

    ``line_time_s``: of each mode as configured, for where it cannot be found. ``place_arcsec``:
    what the orbits are good to, one sigma. Raises OrbitError where no mode has enough measurements.
    """
    counts = [int(np.sum(seen.mode == mode)) for mode in range(modes)]
    if max(counts, default=0) < FEWEST:
        raise OrbitError(
            f"{sum(counts)} streaks of satellites of the file: a camera mode needs {FEWEST};"
            " follow navigation satellites that go in several directions"
        )
    is_used = np.array([counts[int(mode)] >= FEWEST for mode in seen.mode]) & _roughly(seen, modes)
    before = _Before(
        modes=modes,
        nights=nights,
        lines=((0.0, LINE_TIME_PRIOR_S),) * modes,
        place_arcsec=max(place_arcsec, PLACE_PRIOR_ARCSEC),
    )
    fit, is_used = _rounds(seen, is_used, before)
    lines = _lines(fit, modes, line_time_s)
    if lines != before.lines:
        before = replace(before, lines=lines)
        fit, is_used = _rounds(seen, is_used, before)
    return _told(seen, is_used, fit, before)


def _lines(fit: _Fit, modes: int, configured_s: Sequence[float]) -> tuple[tuple[float, float], ...]:
    """Those that are found stay open, the others are as configured."""
    sigma = np.sqrt(np.diag(fit.covariance))[modes : 2 * modes]
    return tuple(
        (0.0, LINE_TIME_PRIOR_S) if sigma[mode] <= LINE_TIME_KNOWN_S else (configured_s[mode], 1e-9)
        for mode in range(modes)
    )


def _roughly(seen: TimedDirections, modes: int) -> Mask:
    """What is not far off the middle of its mode, by medians."""
    speed = np.hypot(*seen.rate_arcsec_s.T)
    late_s = np.sum(seen.offset_arcsec * seen.rate_arcsec_s, axis=1) / speed**2
    good = np.ones(len(seen), bool)
    for mode in range(modes):
        of_it = seen.mode == mode
        if not np.any(of_it):
            continue
        off = np.abs(late_s[of_it] - np.median(late_s[of_it]))
        good[of_it] = off <= max(6.0 * 1.4826 * float(np.median(off)), 0.05)
    return good


def _rounds(seen: TimedDirections, is_used: Mask, before: _Before) -> tuple[_Fit, Mask]:
    """Fit, leave out what does not fit, and again."""
    could = is_used.copy()
    fit = _fit(seen.of(is_used), before)
    for _ in range(_ROUNDS):
        again = could & (_distance(seen, fit, before) <= _TOO_FAR)
        if np.array_equal(again, is_used) or int(np.sum(again)) < FEWEST:
            break
        is_used = again
        fit = _fit(seen.of(is_used), before)
    return fit, is_used


def _distance(seen: TimedDirections, fit: _Fit, before: _Before) -> FloatArray:
    """(N,) squared, of each direction from the fit, in its own sigmas."""
    z, x = _rows(seen, before)
    off = z - np.einsum("nij,j->ni", x, fit.unknowns)
    scale, place, *scatter = fit.variances
    own = scale * seen.covariance_arcsec2 + place * np.eye(2)
    rate = seen.rate_arcsec_s
    own = own + np.array(scatter)[seen.mode][:, None, None] * rate[:, :, None] * rate[:, None, :]
    return np.asarray(np.einsum("ni,nij,nj->n", off, np.linalg.inv(own), off))


def _rows(seen: TimedDirections, before: _Before) -> tuple[FloatArray, FloatArray]:
    """(N, 2) offsets without the lines' known times, and (N, 2, unknowns) their slopes."""
    known_s = np.array([value for value, _ in before.lines])[seen.mode]
    z = seen.offset_arcsec - seen.rate_arcsec_s * (known_s * seen.row_px)[:, None]
    x, modes = np.zeros((len(seen), 2, before.unknowns)), before.modes
    number = np.arange(len(seen))
    x[number, :, seen.mode] = seen.rate_arcsec_s
    x[number, :, modes + seen.mode] = seen.rate_arcsec_s * seen.row_px[:, None]
    for axis in (0, 1):
        x[number, axis, 2 * modes + 2 * seen.night + axis] = 1.0
    return z, x


def _blocks(seen: TimedDirections, before: _Before) -> Iterator[_Block]:
    z, x = _rows(seen, before)
    for members in _connected(seen.frame, seen.track):
        part = seen.of(np.isin(np.arange(len(seen)), members))
        n = len(part)
        own = np.zeros((2 * n, 2 * n))
        for k in range(n):
            own[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = part.covariance_arcsec2[k]
        same_track = part.track[:, None] == part.track
        parts = [own, np.kron(same_track, np.eye(2))]
        rate = part.rate_arcsec_s.ravel()
        same_frame = np.kron(part.frame[:, None] == part.frame, np.ones((2, 2)))
        for mode in range(before.modes):
            of_it = np.repeat(part.mode == mode, 2)
            parts.append(np.outer(rate * of_it, rate * of_it) * same_frame)
        chosen = np.sort(members)
        yield _Block(z=z[chosen].ravel(), x=x[chosen].reshape(2 * n, -1), parts=tuple(parts))


def _connected(frame: Index, track: Index) -> Iterator[Index]:
    """Numbers of directions that share frames or tracks, by whatever way."""
    parent: dict[tuple[str, int], tuple[str, int]] = {}

    def root(of: tuple[str, int]) -> tuple[str, int]:
        while parent.setdefault(of, of) != of:
            parent[of] = parent[parent[of]]
            of = parent[of]
        return of

    for f, t in zip(frame, track, strict=True):
        parent[root(("frame", int(f)))] = root(("track", int(t)))
    groups: dict[tuple[str, int], list[int]] = {}
    for number, t in enumerate(track):
        groups.setdefault(root(("track", int(t))), []).append(number)
    for group in groups.values():
        yield np.array(group, np.int64)


def _fit(seen: TimedDirections, before: _Before) -> _Fit:
    blocks, modes = list(_blocks(seen, before)), before.modes
    prior = np.concatenate(
        [
            np.full(modes, 1e-6),
            [sigma**-2.0 for _, sigma in before.lines],
            np.full(2 * before.nights, DRIFT_PRIOR_ARCSEC**-2.0),
        ]
    )
    means = np.array([1.0, before.place_arcsec**2])
    widths = np.array([2.0 * SCALE_PRIOR, (PLACE_WIDTH * before.place_arcsec) ** 2])
    variances = np.concatenate([means, np.full(modes, 0.02**2)])
    least = np.concatenate([[0.05, 1e-6], np.full(modes, _LEAST_SCATTER_S**2)])
    for _ in range(_STEPS):
        unknowns, covariance, score, information = _scored(blocks, variances, prior)
        score[:2] -= (variances[:2] - means) / widths**2
        information[:2, :2] += np.diag(widths**-2.0)
        step = np.linalg.solve(information, score)
        after = np.clip(variances + step, np.maximum(least, variances / 5.0), variances * 5.0)
        is_close = np.all(np.abs(after - variances) <= _CLOSE * variances + 1e-12)
        variances = after
        if is_close:
            break
    unknowns, _, _, information = _scored(blocks, variances, prior)
    information[:2, :2] += np.diag(widths**-2.0)
    variance_sigmas = np.sqrt(np.diag(np.linalg.inv(information)))
    # Few tracks tell their own variance badly, and the errors hang on it: one sigma more of it.
    wide = variances + np.array([0.0, 1.0, *np.zeros(modes)]) * variance_sigmas
    _, covariance, _, _ = _scored(blocks, wide, prior)
    return _Fit(
        unknowns=unknowns,
        covariance=covariance,
        variances=variances,
        variance_sigmas=variance_sigmas,
    )


def _scored(
    blocks: Sequence[_Block], variances: FloatArray, prior: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Unknowns and their covariance; score and information of the variances."""
    normal, right = np.diag(prior), np.zeros(len(prior))
    inverses = []
    for block in blocks:
        total = sum(v * part for v, part in zip(variances, block.parts, strict=True))
        inverse = np.linalg.inv(total)
        inverses.append(inverse)
        normal = normal + block.x.T @ inverse @ block.x
        right = right + block.x.T @ inverse @ block.z
    covariance = np.linalg.inv(normal)
    unknowns = covariance @ right
    count = len(variances)
    score, information = np.zeros(count), np.zeros((count, count))
    for block, inverse in zip(blocks, inverses, strict=True):
        left = inverse @ (block.z - block.x @ unknowns)
        through = inverse @ block.x
        turned = [inverse @ part for part in block.parts]
        for j, part in enumerate(block.parts):
            lost = np.trace(covariance @ (through.T @ part @ through))
            score[j] += 0.5 * (left @ part @ left - np.trace(turned[j]) + lost)
            for k in range(j + 1):
                information[j, k] += 0.5 * np.sum(turned[j] * turned[k].T)
    information = np.tril(information) + np.tril(information, -1).T
    # A mode without directions has neither.
    information += np.diag(np.where(np.diag(information) == 0.0, 1.0, 0.0))
    return np.asarray(unknowns), np.asarray(covariance), score, information


def _told(
    seen: TimedDirections,
    is_used: Mask,
    fit: _Fit,
    before: _Before,
) -> TimeCalibration:
    nights, drift = before.nights, 2 * before.modes
    found = tuple(_mode(seen, is_used, fit, mode, before) for mode in range(before.modes))
    sigma = np.sqrt(np.diag(fit.covariance))
    apart = []
    for night in range(nights):
        at = slice(drift + 2 * night, drift + 2 * night + 2)
        widest = float(np.sqrt(np.linalg.eigvalsh(fit.covariance[at, at])[-1]))
        apart.append(widest <= _PARALLEL * DRIFT_PRIOR_ARCSEC)
    return TimeCalibration(
        modes=found,
        drift_arcsec=tuple(
            (
                Estimated(value=float(fit.unknowns[at]), sigma=float(sigma[at])),
                Estimated(value=float(fit.unknowns[at + 1]), sigma=float(sigma[at + 1])),
            )
            for at in range(drift, drift + 2 * nights, 2)
        ),
        is_told_apart=tuple(apart),
        place_arcsec=math.sqrt(float(fit.variances[1])),
        error_scale=math.sqrt(float(fit.variances[0])),
        is_used=tuple(bool(each) for each in is_used),
    )


def _mode(
    seen: TimedDirections,
    is_used: Mask,
    fit: _Fit,
    mode: int,
    before: _Before,
) -> ShutterTiming | None:
    line = before.lines[mode]
    taken = is_used & (seen.mode == mode)
    if int(np.sum(taken)) < FEWEST:
        return None
    at = np.array([mode, before.modes + mode])
    bias_s, line_s = fit.unknowns[at]
    both = fit.covariance[np.ix_(at, at)]
    row = float(-both[0, 1] / both[1, 1]) if both[1, 1] > 0.0 else 0.0
    row = float(np.clip(row, np.min(seen.row_px[taken]), np.max(seen.row_px[taken])))
    ahead = np.array([1.0, row])
    is_found = line[1] == LINE_TIME_PRIOR_S
    line_value_s = float(line_s) + line[0]
    return ShutterTiming(
        bias_s=Estimated(value=float(bias_s), sigma=math.sqrt(float(both[0, 0]))),
        scatter_s=_root(float(fit.variances[2 + mode]), float(fit.variance_sigmas[2 + mode])),
        line_time_s=Estimated(
            value=line_value_s, sigma=math.sqrt(float(both[1, 1])) if is_found else 0.0
        ),
        is_line_time_found=is_found,
        middle_row_px=row,
        bias_at_middle_s=Estimated(
            value=float(bias_s) + line_value_s * row, sigma=math.sqrt(float(ahead @ both @ ahead))
        ),
        measurements=int(np.sum(taken)),
        frames=len(np.unique(seen.frame[taken])),
        tracks=len(np.unique(seen.track[taken])),
        rejected=int(np.sum(~is_used & (seen.mode == mode))),
    )


def _root(variance: float, sigma: float) -> Estimated:
    """The root of a variance and its error; as many sigma from nothing as the variance is."""
    value = math.sqrt(variance)
    error = sigma / (2.0 * max(value, math.sqrt(sigma)))
    if variance < _SURELY_SOME * sigma:
        error = max(error, value * min(1.0, sigma / variance))
    return Estimated(value=value, sigma=error)
