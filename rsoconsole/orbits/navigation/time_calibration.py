"""Timing of a shutter, from satellites with precisely known orbits. Pure.

A satellite seen d arcsec ahead of its place along its motion was seen d / rate late. The offset of
a measured direction from the orbit, at the mid-exposure in the frame's header, is

rate x (bias + scatter of the frame + row x line time) + drift of the night + offset of the track +
the measurement's own error,

where drift is the common error of all catalogue stars of a night, and the offset of a track the
error of one orbit and its field's stars. Satellites that move in several directions separate drift
from time. Four kinds of errors have variances found with the unknowns (``_variance_components``):
the scatter, the tracks' offsets, the scale of the measurements' own errors, and errors of streak
ends beyond their sigmas. Wind shifts the two ends of a streak differently and changes its length,
the shutter shifts both alike: so the lengths separate the two.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

from rsoconsole.base import OrbitError
from rsoconsole.orbits.navigation._variance_components import (
    Block,
    PriorKnowledge,
    VarianceFit,
    fit_variances,
)
from rsoconsole.records import FloatArray

Index = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

DRIFT_PRIOR_ARCSEC = 0.5
"""One sigma of the common error of all stars of a night, arcsec, stated."""
LINE_TIME_PRIOR_S = 300e-6
"""Prior sigma of the line time: no camera reads a row in a millisecond."""
LINE_TIME_KNOWN_S = 10e-6
"""Largest sigma of a line time that counts as found; above it the configured one is used."""
PLACE_PRIOR_ARCSEC = 0.05
"""Assumed sigma of a track's own offset, by its orbit and the stars of its field."""
PLACE_WIDTH = 2.0
"""Width of the prior on a track's own offset, as a multiple of the assumed sigma."""
SCALE_PRIOR = 0.5
"""Width of the prior on the scale of the measurements' own errors."""
MIN_MEASUREMENTS = 6
_TOO_FAR = 13.8
"""Largest squared distance, two degrees of freedom; one good measurement in 1000 is farther."""
_TAILS, _AS_GAUSSIAN = 4.0, 7.2
"""Student's degrees of freedom; factor on variances: (first + squared distance) / second."""
_ROUNDS = 10
_ROUGHLY = 4.5 * 1.4826
"""Gate as a multiple of the median deviation: 4.5 sigma."""
_ENDS_UNKNOWN_ARCSEC = 0.1
"""One sigma of the errors of ends beyond their stated sigma, where no lengths give it."""
_MIN_SCATTER_S = 1e-4
_SURELY_SOME = 3.0
"""Ratio of a variance to its sigma below which it may be zero."""
_PARALLEL = 0.5
"""Share of the drift's prior that is left where the satellites hardly determine the drift."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimedDirections:
    """Measured directions of satellites with known orbits; every array starts with N."""

    offset_arcsec: FloatArray
    """Offsets (N, 2), east and north: measured minus predicted for the header's mid-exposure."""
    rate_arcsec_s: FloatArray
    """Rates (N, 2) of the satellite, east and north."""
    covariance_arcsec2: FloatArray
    """Covariances (N, 2, 2) of the measurements, without any error of time."""
    row_px: FloatArray
    """Row (N,) of the streak's middle."""
    mode: Index
    """Index (N,) of the direction's camera mode."""
    frame: Index
    """Number (N,) of the direction's frame, unique over nights."""
    track: Index
    """Number (N,) of the track: one for each satellite and night."""
    night: Index
    length_off_arcsec: FloatArray
    """Length of the streak minus the usual one of its track; NaN where its streaks are too few."""
    length_sigma_arcsec: FloatArray
    """One sigma of the length, as stated."""
    is_by_ends: Mask
    """True where the middle comes from two ends alone, whose errors may exceed their sigmas."""
    tail: FloatArray
    """Factor on the variances of a direction that lies far off; set by the adjustment."""

    @property
    def along_track_unit(self) -> FloatArray:
        """Unit vectors (N, 2) along the satellites' motion."""
        return np.asarray(self.rate_arcsec_s / np.hypot(*self.rate_arcsec_s.T)[:, None])

    def __len__(self) -> int:
        return len(self.row_px)

    def subset(self, chosen: Mask) -> "TimedDirections":
        """Return the directions selected by a mask."""
        return replace(self, **{f.name: getattr(self, f.name)[chosen] for f in fields(self)})


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A value with its error, one sigma."""

    value: float
    sigma: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ShutterTiming:
    """Timing of the shutter in one camera mode; seconds."""

    bias_s: Estimate
    """True mid-exposure of the first row minus the header's."""
    scatter_s: Estimate
    """Timing scatter from frame to frame, one sigma."""
    line_time_s: Estimate
    is_line_time_found: bool
    """True where the line time was found; else the bias holds with the configured one alone."""
    middle_row_px: float
    bias_at_middle_s: Estimate
    """Bias at the row ``middle_row_px``, at which it is known best."""
    measurements: int
    frames: int
    tracks: int
    rejected: int
    night_spread_s: float = 0.0
    """Spread of the nights' biases beyond their errors; included in the bias's sigma."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeCalibration:
    """Result of the calibration of all modes and nights."""

    modes: tuple[ShutterTiming | None, ...]
    """Timing by camera mode; None where a mode has too few measurements."""
    drift_arcsec: tuple[tuple[Estimate, Estimate], ...]
    """Drift of each night, east and north: measured minus orbit."""
    is_separated: tuple[bool, ...]
    """True for each night whose satellites separate drift from time; if False, the prior does."""
    place_arcsec: float
    error_scale: float
    is_used: tuple[bool, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Before:
    """Prior knowledge: (value, sigma) of each mode's line time, and one sigma of a track's own
    offset.
    """

    modes: int
    nights: int
    lines: tuple[tuple[float, float], ...]
    place_arcsec: float

    @property
    def unknowns(self) -> int:
        """Number of unknowns: biases, line times, drifts."""
        return 2 * self.modes + 2 * self.nights


def calibrate_timing(
    seen: TimedDirections,
    *,
    modes: int,
    nights: int,
    line_time_s: Sequence[float],
    place_arcsec: float = PLACE_PRIOR_ARCSEC,
) -> TimeCalibration:
    """Calibrate bias, scatter and line time of each mode, and the drift of each night.

    ``modes``, ``nights``: their numbers. ``line_time_s``: configured line time of each mode, used
    where it cannot be found. ``place_arcsec``: one sigma of a track's offset by its orbit. Raises
    OrbitError where no mode has enough measurements.
    """
    counts = [int(np.sum(seen.mode == mode)) for mode in range(modes)]
    if max(counts, default=0) < MIN_MEASUREMENTS:
        raise OrbitError(
            f"{sum(counts)} streaks of satellites of the file: a camera mode needs"
            f" {MIN_MEASUREMENTS}; follow navigation satellites that go in several directions"
        )
    is_used = np.array([counts[int(mode)] >= MIN_MEASUREMENTS for mode in seen.mode]) & _roughly(
        seen, modes
    )
    before = _Before(
        modes=modes,
        nights=nights,
        lines=((0.0, LINE_TIME_PRIOR_S),) * modes,
        place_arcsec=max(place_arcsec, PLACE_PRIOR_ARCSEC),
    )
    found, is_used = _rounds(seen, is_used, before)
    lines = _lines(found, modes, line_time_s)
    if lines != before.lines:
        before = replace(before, lines=lines)
        found, is_used = _rounds(seen, is_used, before)
    return _calibration(seen, is_used, found, before)


def _lines(
    fit: VarianceFit, modes: int, configured_s: Sequence[float]
) -> tuple[tuple[float, float], ...]:
    """Prior (value, sigma) of each line time: open where it was found, fixed as configured
    elsewhere.
    """
    sigma = np.sqrt(np.diag(fit.covariance))[modes : 2 * modes]
    return tuple(
        (0.0, LINE_TIME_PRIOR_S) if sigma[mode] <= LINE_TIME_KNOWN_S else (configured_s[mode], 1e-9)
        for mode in range(modes)
    )


def _roughly(seen: TimedDirections, modes: int) -> Mask:
    """True for measurements near the middle of their mode, by medians."""
    speed = np.hypot(*seen.rate_arcsec_s.T)
    late_s = np.sum(seen.offset_arcsec * seen.rate_arcsec_s, axis=1) / speed**2
    good = np.ones(len(seen), bool)
    for mode in range(modes):
        of_it = seen.mode == mode
        if not np.any(of_it):
            continue
        off = np.abs(late_s[of_it] - np.median(late_s[of_it]))
        good[of_it] = off <= max(_ROUGHLY * float(np.median(off)), 0.05)
        long = np.abs(np.nan_to_num(seen.length_off_arcsec[of_it]))
        good[of_it] &= long <= max(_ROUGHLY * float(np.median(long)), 1.0)
    return good


def _rounds(seen: TimedDirections, is_used: Mask, before: _Before) -> tuple[VarianceFit, Mask]:
    """Fit, leave out misfits, down-weight doubtful ones, and repeat."""
    could = is_used.copy()
    fit = _fit(seen.subset(is_used), before)
    for _ in range(_ROUNDS):
        far = _distance(seen, fit, before)
        again = could & (far <= _TOO_FAR)
        if int(np.sum(again)) < MIN_MEASUREMENTS:
            break
        is_same, is_used = np.array_equal(again, is_used), again
        # Gusts give errors the tails of Student's distribution (Lange, Little & Taylor 1989).
        less = np.maximum(1.0, (_TAILS + far) / _AS_GAUSSIAN)
        fit = _fit(replace(seen, tail=less).subset(is_used), before)
        if is_same:
            break
    return fit, is_used


def _distance(seen: TimedDirections, fit: VarianceFit, before: _Before) -> FloatArray:
    """Squared distances (N,) of each direction from the fit, in its own sigmas."""
    z, x = _rows(seen, before)
    off = z - np.einsum("nij,j->ni", x, fit.unknowns)
    scale, place = fit.variances[:2]
    ends, scatter = fit.variances[2:].reshape(2, -1)[:, seen.mode]
    own = scale * seen.covariance_arcsec2 + place * np.eye(2)
    speed_2 = np.sum(seen.rate_arcsec_s**2, axis=1)
    ends = ends * seen.is_by_ends
    along = ends + scatter * speed_2
    own = (
        own
        + along[:, None, None]
        * seen.along_track_unit[:, :, None]
        * seen.along_track_unit[:, None, :]
    )
    far = np.einsum("ni,nij,nj->n", off, np.linalg.inv(own), off)
    long = scale * seen.length_sigma_arcsec**2 + 4.0 * ends
    return np.asarray(np.fmax(far, seen.length_off_arcsec**2 / long))


def _rows(seen: TimedDirections, before: _Before) -> tuple[FloatArray, FloatArray]:
    """Offsets (N, 2) without the lines' known times, and their slopes (N, 2, unknowns)."""
    known_s = np.array([value for value, _ in before.lines])[seen.mode]
    z = seen.offset_arcsec - seen.rate_arcsec_s * (known_s * seen.row_px)[:, None]
    x, modes = np.zeros((len(seen), 2, before.unknowns)), before.modes
    number = np.arange(len(seen))
    x[number, :, seen.mode] = seen.rate_arcsec_s
    x[number, :, modes + seen.mode] = seen.rate_arcsec_s * seen.row_px[:, None]
    for axis in (0, 1):
        x[number, axis, 2 * modes + 2 * seen.night + axis] = 1.0
    return z, x


def _blocks(seen: TimedDirections, before: _Before) -> Iterator[Block]:
    """Yield blocks of correlated rows: directions, two rows each, then lengths of streaks."""
    z, x = _rows(seen, before)
    for members in _connected(seen.frame, seen.track):
        chosen = np.sort(members)
        part = seen.subset(np.isin(np.arange(len(seen)), chosen))
        measured = np.flatnonzero(np.isfinite(part.length_off_arcsec))
        n, lengths = 2 * len(part), len(measured)
        of_ends = {int(mode): 2 + int(mode) for mode in np.unique(part.mode)}
        of_scatter = {mode: before.modes + place for mode, place in of_ends.items()}
        numbers = (0, 1, *of_ends.values(), *of_scatter.values())
        parts = {number: np.zeros((n + lengths, n + lengths)) for number in numbers}
        rate = (part.rate_arcsec_s * np.sqrt(part.tail)[:, None]).ravel()
        same_frame = np.kron(part.frame[:, None] == part.frame, np.ones((2, 2)))
        parts[1][:n, :n] = np.kron(part.track[:, None] == part.track, np.eye(2))
        for k, ahead in enumerate(part.along_track_unit):
            two = slice(2 * k, 2 * k + 2)
            parts[0][two, two] = part.covariance_arcsec2[k] * part.tail[k]
            if part.is_by_ends[k]:
                parts[of_ends[int(part.mode[k])]][two, two] = np.outer(ahead, ahead) * part.tail[k]
        for row, k in enumerate(measured.tolist(), start=n):
            parts[0][row, row] = part.length_sigma_arcsec[k] ** 2 * part.tail[k]
            if part.is_by_ends[k]:
                # The length is off by the difference of two ends, the middle by half their sum.
                parts[of_ends[int(part.mode[k])]][row, row] = 4.0 * part.tail[k]
        for mode, number in of_scatter.items():
            late = rate * np.repeat(part.mode == mode, 2)
            parts[number][:n, :n] = np.outer(late, late) * same_frame
        yield Block(
            z=np.concatenate([z[chosen].ravel(), part.length_off_arcsec[measured]]),
            x=np.concatenate([x[chosen].reshape(n, -1), np.zeros((lengths, before.unknowns))]),
            parts=parts,
        )


def _connected(frame: Index, track: Index) -> Iterator[Index]:
    """Yield the indices of directions connected by shared frames or tracks, however indirectly."""
    import scipy.sparse
    from scipy.sparse.csgraph import connected_components

    frames, tracks = (np.unique(each, return_inverse=True)[1] for each in (frame, track))
    size, ends = len(frames), (frames, tracks + len(frames))
    graph = scipy.sparse.coo_array((np.ones(size), ends), shape=(2 * size, 2 * size))
    group = connected_components(graph, directed=False)[1][frames]
    for each in dict.fromkeys(group.tolist()):
        yield np.flatnonzero(group == each)


def _fit(seen: TimedDirections, before: _Before) -> VarianceFit:
    modes = before.modes
    has_ends = np.array(
        [
            np.sum((seen.mode == m) & seen.is_by_ends & np.isfinite(seen.length_off_arcsec))
            >= MIN_MEASUREMENTS
            for m in range(modes)
        ]
    )
    place = before.place_arcsec**2
    scatter = np.full(modes, 0.02**2)
    known = PriorKnowledge(
        precisions=np.concatenate(
            [
                np.full(modes, 1e-6),
                [sigma**-2.0 for _, sigma in before.lines],
                np.full(2 * before.nights, DRIFT_PRIOR_ARCSEC**-2.0),
            ]
        ),
        start=np.concatenate([[1.0, place], np.full(modes, 0.05), scatter]),
        least=np.concatenate(
            [[0.05, 1e-6], np.full(modes, 1e-6), np.full(modes, _MIN_SCATTER_S**2)]
        ),
        means=np.concatenate([[1.0, place], np.zeros(2 * modes)]),
        sigmas=np.concatenate(
            [
                [2.0 * SCALE_PRIOR, PLACE_WIDTH**2 * place],
                np.where(has_ends, np.inf, _ENDS_UNKNOWN_ARCSEC**2),
                np.full(modes, np.inf),
            ]
        ),
        is_widened=np.concatenate([[0.0, 1.0], np.zeros(2 * modes)]),
    )
    return fit_variances(list(_blocks(seen, before)), known)


def _calibration(
    seen: TimedDirections, is_used: Mask, fit: VarianceFit, before: _Before
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
                Estimate(value=float(fit.unknowns[at]), sigma=float(sigma[at])),
                Estimate(value=float(fit.unknowns[at + 1]), sigma=float(sigma[at + 1])),
            )
            for at in range(drift, drift + 2 * nights, 2)
        ),
        is_separated=tuple(apart),
        place_arcsec=math.sqrt(float(fit.variances[1])),
        error_scale=math.sqrt(float(fit.variances[0])),
        is_used=tuple(bool(each) for each in is_used),
    )


def _mode(
    seen: TimedDirections, is_used: Mask, fit: VarianceFit, mode: int, before: _Before
) -> ShutterTiming | None:
    line, scatter = before.lines[mode], 2 + before.modes + mode
    taken = is_used & (seen.mode == mode)
    if int(np.sum(taken)) < MIN_MEASUREMENTS:
        return None
    at = np.array([mode, before.modes + mode])
    bias_s, line_s = fit.unknowns[at]
    both = _larger(fit, at)
    row = float(-both[0, 1] / both[1, 1]) if both[1, 1] > 0.0 else 0.0
    row = float(np.clip(row, np.min(seen.row_px[taken]), np.max(seen.row_px[taken])))
    ahead = np.array([1.0, row])
    is_found = line[1] == LINE_TIME_PRIOR_S
    line_value_s = float(line_s) + line[0]
    return ShutterTiming(
        bias_s=Estimate(value=float(bias_s), sigma=math.sqrt(float(both[0, 0]))),
        scatter_s=_root(float(fit.variances[scatter]), float(fit.variance_sigmas[scatter])),
        line_time_s=Estimate(
            value=line_value_s, sigma=math.sqrt(float(both[1, 1])) if is_found else 0.0
        ),
        is_line_time_found=is_found,
        middle_row_px=row,
        bias_at_middle_s=Estimate(
            value=float(bias_s) + line_value_s * row, sigma=math.sqrt(float(ahead @ both @ ahead))
        ),
        measurements=int(np.sum(taken)),
        frames=len(np.unique(seen.frame[taken])),
        tracks=len(np.unique(seen.track[taken])),
        rejected=int(np.sum(~is_used & (seen.mode == mode))),
    )


def _larger(fit: VarianceFit, at: Index) -> FloatArray:
    """Covariance of a mode's unknowns: by their errors, or by how tracks differ, if that is
    larger.
    """
    stated = fit.covariance[np.ix_(at, at)]
    if fit.covariance_by_blocks is None:
        return stated
    seen = fit.covariance_by_blocks[np.ix_(at, at)]
    widened = max(1.0, float(np.max(np.diag(seen) / np.diag(stated))))
    return stated * widened


def _root(variance: float, sigma: float) -> Estimate:
    """Root of a variance and its error; as many sigma from zero as the variance is."""
    value = math.sqrt(variance)
    error = sigma / (2.0 * max(value, math.sqrt(sigma)))
    if variance < _SURELY_SOME * sigma:
        error = max(error, value * min(1.0, sigma / variance))
    return Estimate(value=value, sigma=error)
