"""Likelihood of a filter's settings, given the measurements of a session's tracks. Pure.

Prediction-error decomposition: the density of a night's measurements is the product of the
densities of its innovations, each given the earlier ones, so

log L = sum over k of -1/2 (log det(2 pi S_k) + nu_k' S_k^-1 nu_k).

It remains a proper likelihood where the filter adapts its process noise to its own innovations
(preset ``tuned``): S_k depends on earlier innovations alone. Preset ``adaptive`` learns the noise
of a track's first updates without factors, then holds it, whatever Q and R are: its likelihood is
that of the mixture's moments. Which measurements belong to which track is fixed, so that every
setting is judged by the same data.
Source: Bar-Shalom, Li & Kirubarajan 2001, Estimation with Applications, 5.4; Schweppe 1965.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rsoconsole.config import FilterConfig
from rsoconsole.pipeline.replays.refold import ReplayedFrame
from rsoconsole.pipeline.replays.what_if_log import last_version_of_each
from rsoconsole.records import FloatArray, Measurement, TrackState
from rsoconsole.tracking.filters import adaptive, estimator, lqe, streak_length

LOG_2PI = math.log(2.0 * math.pi)


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterStep:
    """One frame of a track: its measurement, if any, and the filter's settings."""

    frame_id: int
    t_utc_ns: int
    measurement: Measurement | None
    """Accepted measurement; None for a miss, in which the filter only predicts."""
    settings: FilterConfig
    along_arcsec: float = 0.0
    """Error along the streak that its length indicates."""
    by_orbit: TrackState | None = None
    """Prediction by the orbit that restarted the filter; the filter's own is no evidence then."""


@dataclass(slots=True, kw_only=True)
class ReplayedTrack:
    """One track: the two measurements that began it, and its later frames."""

    first: Measurement
    second: Measurement
    settings: FilterConfig
    steps: list[FilterStep] = field(default_factory=list)

    @property
    def measurements(self) -> tuple[Measurement, ...]:
        """Measurements with which the filter was updated from its own prediction, in order."""
        steps = (s for s in self.steps if s.by_orbit is None)
        return tuple(s.measurement for s in steps if s.measurement is not None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Innovations:
    """Innovations of the arcs' measurements by one filter, in order; arrays (N,)."""

    log_likelihood: FloatArray
    """Natural logarithm of each innovation's likelihood, with innovations in arcsec."""
    nis: FloatArray
    east: FloatArray
    """Innovation east in units of its own sigma, as ``north``."""
    north: FloatArray
    follows: FloatArray
    """1 where the track was also measured in the frame before, 0 elsewhere."""

    @property
    def total(self) -> float:
        """Log-likelihood of all measurements together."""
        return float(np.sum(self.log_likelihood))

    @property
    def autocorrelation(self) -> tuple[float, float]:
        """Lag-1 autocorrelation (east, north), assuming zero mean; near 0 for a tuned filter."""
        return self._lag_1(self.east), self._lag_1(self.north)

    def _lag_1(self, values: FloatArray) -> float:
        power = float(np.sum(values**2))
        pairs = values[1:] * values[:-1] * self.follows[1:]
        return float(np.sum(pairs)) / power if power > 0.0 else 0.0


def replayed_tracks(frames: Iterable[ReplayedFrame]) -> list[ReplayedTrack]:
    """Return the tracks of a replayed session with their measurements."""
    arcs: list[ReplayedTrack] = []
    candidates: tuple[Measurement, ...] = ()
    for each in last_version_of_each(frames):
        states = [record for record in each.records if isinstance(record, TrackState)]
        settings = each.config.filter
        for state in states:
            if state.kind == "initial" and each.after.lead_measured is not None:
                second = each.after.lead_measured
                first = _first_of(state, candidates)
                if first is not None and state.is_lead:
                    arcs.append(ReplayedTrack(first=first, second=second, settings=settings))
            elif state.kind == "predicted" and state.is_lead and arcs:
                updated = next((s for s in states if s.kind == "updated" and s.is_lead), None)
                taken = None if updated is None else each.after.lead_measured
                said = None if updated is None else updated.mixture
                step = FilterStep(
                    frame_id=state.frame_id,
                    t_utc_ns=state.t_utc_ns,
                    measurement=taken,
                    settings=settings,
                    along_arcsec=0.0 if said is None else said.along_arcsec,
                    by_orbit=state if state.foretold_by == "orbit" else None,
                )
                arcs[-1].steps.append(step)
        candidates = each.after.candidates
    return [arc for arc in arcs if arc.measurements]


def _first_of(state: TrackState, candidates: Sequence[Measurement]) -> Measurement | None:
    """Return the candidate with which, beside the second measurement, the track was begun."""
    first = None if state.begun_with is None else state.begun_with[0]
    return next((m for m in candidates if m.measurement_id == first), None)


def innovations(
    arcs: Sequence[ReplayedTrack], settings: Mapping[str, float | str]
) -> Innovations | None:
    """Run the filter over the arcs; None where its matrices become singular.

    ``settings``: fields of FilterConfig with values that replace the recorded ones throughout.
    """
    try:
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            rows = [row for arc in arcs for row in _of_arc(arc, settings)]
    except (np.linalg.LinAlgError, FloatingPointError, ValueError, OverflowError):
        return None
    columns = np.array(rows, dtype=float).reshape(-1, 5).T
    if not np.all(np.isfinite(columns)):
        return None
    return Innovations(
        log_likelihood=columns[0],
        nis=columns[1],
        east=columns[2],
        north=columns[3],
        follows=columns[4],
    )


def _of_arc(arc: ReplayedTrack, settings: Mapping[str, float | str]) -> Iterator[tuple[float, ...]]:
    changed: dict[int, FilterConfig] = {}

    def in_place_of(config: FilterConfig) -> FilterConfig:
        if id(config) not in changed:
            changed[id(config)] = config.model_copy(update=dict(settings))
        return changed[id(config)]

    config = in_place_of(arc.settings)
    state = estimator.initialise(arc.first, arc.second, config)
    if config.uses_filter_bank:
        state = adaptive.with_coarse_bank(state)
    was_measured = False
    for step in arc.steps:
        config, errors = in_place_of(step.settings), streak_length.StreakErrors(step.along_arcsec)
        if step.by_orbit is not None and step.measurement is not None:
            state = estimator.update(step.by_orbit, step.measurement, config, errors)
            was_measured = False
            continue
        predicted = estimator.predict(state, step.t_utc_ns, config, step.frame_id)
        if step.measurement is None:
            state, was_measured = predicted, False
            continue
        state = estimator.update(predicted, step.measurement, config, errors)
        nis, residual, sigma = state.nis, state.innovation_arcsec, state.sigma_innovation_arcsec
        assert nis is not None
        assert residual is not None
        assert sigma is not None
        if config.uses_filter_bank:
            log_det = float(np.linalg.slogdet(adaptive.innovation_covariance(state))[1])
        else:
            log_det = lqe.log_det_innovation(predicted, step.measurement, config)
        yield (
            -0.5 * (2.0 * LOG_2PI + log_det + nis),
            nis,
            residual[0] / sigma[0],
            residual[1] / sigma[1],
            float(was_measured),
        )
        was_measured = True
