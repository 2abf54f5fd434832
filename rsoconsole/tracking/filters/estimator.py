"""Estimator of a preset: a bank of filters for ``adaptive``, else one filter. Pure.

Nights are replayed with the preset that they were recorded with: a preset's result for given
measurements must never change.
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from rsoconsole.config import FilterConfig
from rsoconsole.records import FloatArray, Measurement, TrackState
from rsoconsole.tracking.filters import adaptive, lqe
from rsoconsole.tracking.filters.adaptive import Bend
from rsoconsole.tracking.filters.streak_length import NO_ERRORS, StreakErrors


def preload_modules(settings: FilterConfig) -> None:
    """Load slow modules in advance, so that the first slew need not wait for them."""
    if settings.uses_filter_bank:
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

    The preset ``adaptive`` also uses ``bend`` (possible bend of an orbit's path through the first),
    ``along_arcsec`` (sigma along the motion that the length of each streak indicates) and
    ``is_shutter_known`` (whether the shutter's scatter was calibrated). Raises ValueError when the
    second is not the later one.
    """
    if settings.uses_filter_bank:
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
    if settings.uses_filter_bank:
        return adaptive.predict(state, t_utc_ns, settings, frame_id)
    return lqe.predict(state, t_utc_ns, settings, frame_id)


def predict_motion(
    state: TrackState, t_utc_ns: int, settings: FilterConfig
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Predict a track's direction (ICRS, deg) and rate east and north (arcsec/s), not their errors.

    As by `predict`, in less time.
    """
    if settings.uses_filter_bank:
        return adaptive.predict_motion(state, t_utc_ns)
    ahead = lqe.predict(state, t_utc_ns, settings, state.frame_id)
    return lqe.direction_icrs_deg(ahead), lqe.sky_rate_arcsec_s(ahead)


@dataclass(frozen=True, kw_only=True, eq=False)
class CandidateUpdate:
    """Possible update of a track with a measurement: its NIS, and the updated track on demand.

    Most pairs in a crowded field need only the NIS, and computing the track takes most of the
    time.
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

    ``errors``: extra errors that the streak's shape indicates; used by ``adaptive`` alone. With a
    rolling shutter a measurement may be a little later than its frame: the track is first predicted
    to the instant of the measurement.
    """
    there = _at(predicted, measurement, settings)
    return _weighed_there(there, ((measurement, errors),), settings)[measurement]


def candidate_updates(
    predicted: TrackState,
    measured: Sequence[tuple[Measurement, StreakErrors]],
    settings: FilterConfig,
) -> dict[Measurement, CandidateUpdate]:
    """Compute the possible updates with several measurements, each with its streak's errors.

    As ``candidate_update`` for each, in less time.
    """
    if all(m.t_mid_utc_ns == predicted.t_utc_ns for m, _ in measured):
        return _weighed_there(predicted, measured, settings)
    return {m: candidate_update(predicted, m, settings, errors) for m, errors in measured}


def _weighed_there(
    there: TrackState, measured: Sequence[tuple[Measurement, StreakErrors]], settings: FilterConfig
) -> dict[Measurement, CandidateUpdate]:
    if not measured:
        return {}
    if not settings.uses_filter_bank:
        return {m: _made(lqe.update(there, m, settings)) for m, _ in measured}
    innovations = adaptive.innovations(there, measured, settings)
    return {
        m: CandidateUpdate(
            nis=found.nis,
            make=functools.partial(
                adaptive.update_with_innovation, there, m, found, errors.along_arcsec
            ),
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


def restarted_track(  # noqa: PLR0917 -- a direction, its motion and how well both are known
    direction_deg: tuple[float, float],
    rate_arcsec_s: tuple[float, float],
    covariance: FloatArray,
    t_utc_ns: int,
    failed: TrackState,
    settings: FilterConfig,
) -> TrackState:
    """Restart the filter at an instant from another prediction, for example the orbit's.

    ``failed``: the track as its own filter predicted it. ``covariance`` (4, 4) of east, its rate,
    north, its rate: arcsec and arcsec/s.
    """
    if settings.uses_filter_bank and failed.t_utc_ns == t_utc_ns:
        return adaptive.restart_from_prediction(
            direction_deg, rate_arcsec_s, covariance, failed.frame_id, failed
        )
    return lqe.restarted_track(
        direction_deg, rate_arcsec_s, covariance, t_utc_ns, failed.frame_id, failed
    )


def log_det_innovation(
    predicted: TrackState, measurement: Measurement, settings: FilterConfig
) -> float:
    """Return the log determinant of the innovation's covariance on the sky, arcsec^4."""
    predicted = _at(predicted, measurement, settings)
    if settings.uses_filter_bank:
        return adaptive.log_det_innovation(predicted, measurement, settings)
    return lqe.log_det_innovation(predicted, measurement, settings)
