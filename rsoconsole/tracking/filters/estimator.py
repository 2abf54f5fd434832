"""The filter of a preset: for ``adaptive`` a bank of filters, for ``tuned`` and ``paper`` one.
Pure.

Nights are replayed by the preset that they were recorded with, so no preset ever changes its result
for given measurements.
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from rsoconsole.config import FilterConfig
from rsoconsole.records import FloatArray, Measurement, TrackState
from rsoconsole.tracking.filters import adaptive, lqe
from rsoconsole.tracking.filters.adaptive import Bend
from rsoconsole.tracking.filters.streak_length import NO_ERRORS, StreakErrors


def make_ready(settings: FilterConfig) -> None:
    """Load slow modules in advance: the first slew to a satellite would wait for them."""
    if settings.uses_bank:
        import scipy.optimize  # noqa: F401 - which measurement is of which of several tracks
    else:
        import filterpy.kalman  # noqa: F401


def initialise(
    first: Measurement,
    second: Measurement,
    settings: FilterConfig,
    *,
    track_id: int = 1,
    bend: Bend | None = None,
    along_arcsec: tuple[float, float] = (0.0, 0.0),
    is_shutter_known: bool = False,
) -> TrackState:
    """Initiate a track at the second of two measurements.

    For presets that use them: ``bend``, possible bend of an orbit's path through the first;
    ``along_arcsec``, sigma along the motion that the length of each streak indicates;
    ``is_shutter_known``, whether the shutter's scatter was calibrated. Raises ValueError when the
    second is not the later one.
    """
    if settings.uses_bank:
        return adaptive.initialise(
            first,
            second,
            settings,
            track_id=track_id,
            bend=bend,
            along_arcsec=along_arcsec,
            is_shutter_known=is_shutter_known,
        )
    return lqe.initialise(first, second, settings, track_id=track_id)


def predict(state: TrackState, t_utc_ns: int, settings: FilterConfig, frame_id: int) -> TrackState:
    """Predict the track to another instant, for the frame ``frame_id``."""
    if settings.uses_bank:
        return adaptive.predict(state, t_utc_ns, settings, frame_id)
    return lqe.predict(state, t_utc_ns, settings, frame_id)


@dataclass(frozen=True, kw_only=True, eq=False)
class CandidateUpdate:
    """Possible update of a track with a measurement: its NIS, and the updated track on demand.

    Most pairs of a crowded field need only the NIS; the updated track takes most of the time.
    """

    nis: float | None
    make: Callable[[], TrackState]

    @functools.cached_property
    def state(self) -> TrackState:
        """Track updated with the measurement, computed when first read."""
        return self.make()


def candidate_update(
    predicted: TrackState,
    measurement: Measurement,
    settings: FilterConfig,
    errors: StreakErrors = NO_ERRORS,
) -> CandidateUpdate:
    """Compute the possible update of a track with a measurement.

    ``errors``: those that the streak's shape indicates, for presets that use them. With a rolling
    shutter the measurement may be a little later than the frame: the prediction is carried to its
    instant.
    """
    there = _at(predicted, measurement, settings)
    return _weighed_there(there, ((measurement, errors),), settings)[measurement]


def candidate_updates(
    predicted: TrackState,
    measured: Sequence[tuple[Measurement, StreakErrors]],
    settings: FilterConfig,
) -> dict[Measurement, CandidateUpdate]:
    """``candidate_update`` of several measurements, each with its streak's errors, in less time."""
    if all(m.t_mid_utc_ns == predicted.t_utc_ns for m, _ in measured):
        return _weighed_there(predicted, measured, settings)
    return {m: candidate_update(predicted, m, settings, errors) for m, errors in measured}


def _weighed_there(
    there: TrackState, measured: Sequence[tuple[Measurement, StreakErrors]], settings: FilterConfig
) -> dict[Measurement, CandidateUpdate]:
    if not measured:
        return {}
    if not settings.uses_bank:
        return {m: _made(lqe.update(there, m, settings)) for m, _ in measured}
    innovations = adaptive.innovations(there, measured, settings)
    return {
        m: CandidateUpdate(
            nis=found.nis,
            make=functools.partial(adaptive.taken, there, m, found, errors.along_arcsec),
        )
        for (m, errors), found in zip(measured, innovations, strict=True)
    }


def _made(state: TrackState) -> CandidateUpdate:
    return CandidateUpdate(nis=state.nis, make=lambda: state)


def update(
    predicted: TrackState,
    measurement: Measurement,
    settings: FilterConfig,
    errors: StreakErrors = NO_ERRORS,
) -> TrackState:
    """Update the track with a measurement; arguments as in ``candidate_update``."""
    return candidate_update(predicted, measurement, settings, errors).state


def _at(predicted: TrackState, measurement: Measurement, settings: FilterConfig) -> TrackState:
    t_utc_ns = measurement.t_mid_utc_ns
    if t_utc_ns == predicted.t_utc_ns:
        return predicted
    carried = predict(predicted, t_utc_ns, settings, predicted.frame_id)
    return replace(carried, misses=predicted.misses, foretold_by=predicted.foretold_by)


def restarted_from(  # noqa: PLR0917 -- a direction, its motion and how well both are known
    direction_deg: tuple[float, float],
    rate_arcsec_s: tuple[float, float],
    covariance: FloatArray,
    t_utc_ns: int,
    failed: TrackState,
    settings: FilterConfig,
) -> TrackState:
    """Restart the filter from another prediction, at an instant.

    ``failed``: the track as its own filter predicted it. ``covariance`` (4, 4) of east, its rate,
    north, its rate: arcsec and arcsec/s.
    """
    if settings.uses_bank and failed.t_utc_ns == t_utc_ns:
        return adaptive.restarted_from(
            direction_deg, rate_arcsec_s, covariance, failed.frame_id, failed
        )
    return lqe.restarted_from(
        direction_deg, rate_arcsec_s, covariance, t_utc_ns, failed.frame_id, failed
    )


def log_det_innovation(
    predicted: TrackState, measurement: Measurement, settings: FilterConfig
) -> float:
    """Logarithm of the determinant of the innovation's covariance on the sky, arcsec^2 squared."""
    predicted = _at(predicted, measurement, settings)
    if settings.uses_bank:
        return adaptive.log_det_innovation(predicted, measurement, settings)
    return lqe.log_det_innovation(predicted, measurement, settings)
