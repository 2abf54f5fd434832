"""Linear quadratic estimator: constant rates in right ascension and declination.

x = [alpha, alpha rate, delta, delta rate] in deg and deg/s; alpha stays in 0 to 360 and innovations
are wrapped, so RA 0h needs no special case. Presets: ``paper`` has Q, R and P0 of Jordan et al.
(arXiv 2304.06227) with sigma in degrees, fixed whatever the time between frames; ``tuned`` takes Q
from the true time step (white-noise acceleration on the sky), R from each measurement's own
covariance and P0 from the two points. The operator's multipliers scale the Q and R of either, as a
whole and by the terms of their diagonals; terms off a diagonal scale with the root of both of its
terms, so that correlations stay. Source of the filter: Bar-Shalom, Li & Kirubarajan 2001, chapters
5 and 6.
"""

import math
import threading
from typing import Any

import numpy as np

from rsoconsole.config import FilterConfig
from rsoconsole.records import FloatArray, Measurement, TrackState
from rsoconsole.sky import wrap_180, wrap_360
from rsoconsole.tracking.filters.factors import q_multipliers

ARCSEC_PER_DEG = 3600.0
SIGMA_FLOOR_ARCSEC = 0.10
"""Smallest sigma of a measurement, whatever its own covariance says."""
SIGMA_CEILING_ARCSEC = 36_000.0
"""Largest sigma of a measurement; with larger ones numbers no longer invert."""
_MIN_COS_DEC = 1e-3
ADAPTED_SPAN_S = 120.0
"""Longest time since the last measurement over which the adapted process noise holds."""
NIS_AIM = 1.8
_SAFE_FOR_ARCSEC = 2.0
_SMALLEST_START = 0.1
_FIRST_ADAPT_GAIN = 3.0
_ADAPT_GAIN = 0.5
_LARGEST_STEP_DOWN = 1.5
_LARGEST_NIS = 6.0
Q_SCALE_MIN, Q_SCALE_MAX = 0.001, 100.0

C = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])


def initialise(
    first: Measurement, second: Measurement, settings: FilterConfig, *, track_id: int = 1
) -> TrackState:
    """Initiate a track at the second of two measurements.

    The angles are those of the second, the rates follow from both. Raises ValueError when the
    second is not the later one.
    """
    dt_s = time_between_s(first, second)
    ra_rate = wrap_180(second.ra_icrs_deg - first.ra_icrs_deg) / dt_s
    dec_rate = (second.dec_icrs_deg - first.dec_icrs_deg) / dt_s
    x = np.array([second.ra_icrs_deg, ra_rate, second.dec_icrs_deg, dec_rate])
    return _state(
        second.t_mid_utc_ns,
        x,
        _initial_covariance(first, second, settings),
        **first_state_fields(first, second, track_id),
        q_scale=_first_scale(second, settings),
    )


def time_between_s(first: Measurement, second: Measurement) -> float:
    """Return the seconds from the first to the second measurement of a new track.

    Raises ValueError when the second is not the later one.
    """
    dt_s = (second.t_mid_utc_ns - first.t_mid_utc_ns) / 1e9
    if dt_s <= 0.0:
        raise ValueError(f"a track needs its second measurement after the first, not {dt_s:+.3f} s")
    return dt_s


def first_state_fields(first: Measurement, second: Measurement, track_id: int) -> dict[str, Any]:
    """Fields of a track's first state that are the same for all presets."""
    return {
        "kind": "initial",
        "frame_id": second.frame_id,
        "track_id": track_id,
        "measurement_id": second.measurement_id,
        "begun_with": (first.measurement_id, second.measurement_id),
    }


def next_state_fields(before: TrackState, frame_id: int, **changed: Any) -> dict[str, Any]:
    """Return the fields of a track's next state that are the same for all presets.

    ``changed``: fields that differ from ``before``. The state's ``kind`` is "predicted", unless
    ``changed`` names another.
    """
    return {
        "kind": "predicted",
        "frame_id": frame_id,
        "track_id": before.track_id,
        "is_lead": before.is_lead,
        "misses": before.misses,
        "innovations": before.innovations,
        **changed,
    }


def updated_state_fields(
    predicted: TrackState,
    measurement: Measurement,
    nis: float,
    innovation_arcsec: FloatArray,
    sigma_arcsec: FloatArray,
) -> dict[str, Any]:
    """Fields of an updated state that are the same for all presets."""
    return next_state_fields(
        predicted,
        measurement.frame_id,
        kind="updated",
        misses=0,
        measurement_id=measurement.measurement_id,
        nis=nis,
        innovation_arcsec=tuple(innovation_arcsec.tolist()),
        sigma_innovation_arcsec=tuple(sigma_arcsec.tolist()),
        innovations=predicted.innovations + 1,
        foretold_by=predicted.foretold_by,
    )


def _first_scale(measurement: Measurement, settings: FilterConfig) -> float:
    """Initial process noise of a new track, in units of the configured q.

    The configured q is safe for measurements of some arcseconds, from which nothing is learnt soon.
    Good measurements show within a few frames when the target turns, so a track of theirs may begin
    with less: at 0.3 arcsec the first twelve NIS are then 1.5 for a calm geostationary satellite,
    2.1 at an inclination of 7 deg and 3.0 at 15 (from the full q: 1.3, 1.4 and 1.9).
    """
    if settings.preset == "paper":
        return 1.0
    ee, _, nn = measurement.cov_sky_arcsec2
    variance = max((ee + nn) / 2.0, SIGMA_FLOOR_ARCSEC**2)
    return min(max(variance / _SAFE_FOR_ARCSEC**2, _SMALLEST_START), 1.0)


def predict(state: TrackState, t_utc_ns: int, settings: FilterConfig, frame_id: int) -> TrackState:
    """Predict the track to another instant, for the frame ``frame_id``.

    The frame counts as a miss in ``misses`` until ``update`` accepts a measurement of it.
    """
    kalman = _kalman(state)
    dt_s = (t_utc_ns - state.t_utc_ns) / 1e9
    # Innovations speak of the frames near to them: over a long coast or look ahead a calm target
    # may turn, and the full noise holds again. A single miss forgets nothing.
    is_near = (state.misses + 1) * abs(dt_s) <= ADAPTED_SPAN_S
    q_scale = state.q_scale if is_near else max(state.q_scale, 1.0)
    kalman.predict(F=transition_matrix(dt_s), Q=q_scale * process_noise(dt_s, state.x[2], settings))
    return _state(
        t_utc_ns,
        kalman.x,
        kalman.P,
        **next_state_fields(state, frame_id, misses=state.misses + 1, q_scale=state.q_scale),
    )


def update(predicted: TrackState, measurement: Measurement, settings: FilterConfig) -> TrackState:
    """Update the track with a measurement at the predicted instant.

    Raises ValueError when the measurement is of another instant: predict to that one first.
    """
    if measurement.t_mid_utc_ns != predicted.t_utc_ns:
        raise ValueError("the measurement and the prediction are of different instants")
    kalman = _kalman(predicted)
    z = np.array([measurement.ra_icrs_deg, measurement.dec_icrs_deg])
    # Measured right ascension on the branch that lies nearest to the prediction.
    z[0] = kalman.x[0] + wrap_180(z[0] - kalman.x[0])
    kalman.update(z, R=measurement_noise(measurement, settings))
    cos_dec = _cos_dec(predicted.x[2])
    to_sky = np.array([cos_dec, 1.0]) * ARCSEC_PER_DEG
    innovation, sigma = kalman.y * to_sky, np.sqrt(np.diag(kalman.S)) * to_sky
    nis = float(kalman.y @ kalman.SI @ kalman.y)
    return _state(
        measurement.t_mid_utc_ns,
        kalman.x,
        kalman.P,
        **updated_state_fields(predicted, measurement, nis, innovation, sigma),
        q_scale=_adapted(predicted, nis, settings),
    )


def restarted_track(  # noqa: PLR0917 -- a direction, its motion and how well both are known
    direction_deg: tuple[float, float],
    rate_arcsec_s: tuple[float, float],
    covariance: FloatArray,
    t_utc_ns: int,
    frame_id: int,
    failed: TrackState,
) -> TrackState:
    """Restart the filter from another prediction, where its own has ``failed``.

    ``covariance`` (4, 4) of east, its rate, north, its rate: arcsec and arcsec/s. The scale of the
    process noise is set to 1 at least, since a smaller one has just failed.
    """
    cos_dec = _cos_dec(direction_deg[1])
    to_deg = np.array([1.0 / cos_dec, 1.0 / cos_dec, 1.0, 1.0]) / ARCSEC_PER_DEG
    x = (
        direction_deg[0],
        rate_arcsec_s[0] * to_deg[1],
        direction_deg[1],
        rate_arcsec_s[1] * to_deg[3],
    )
    return _state(
        t_utc_ns,
        x,
        covariance * np.outer(to_deg, to_deg),
        **next_state_fields(
            failed, frame_id, foretold_by="orbit", q_scale=max(failed.q_scale, 1.0)
        ),
    )


def _adapted(predicted: TrackState, nis: float, settings: FilterConfig) -> float:
    """Process noise moved towards the value at which innovations match their covariance.

    One number q cannot fit a station-keeping satellite measured to 0.2 arcsec and a navigation
    satellite that turns ten times as fast. A stochastic approximation of covariance matching (Mehra
    1972): each NIS moves the logarithm of the scale by its excess over the aim, which lies a little
    below 2 so that bounds rather hold too often.

    The start, a q that is safe for measurements of 4 arcsec, errs on the large side: for 0.2 arcsec
    and a calm satellite it is hundreds of times too large, sqrt(S) is three times what the
    measurement itself claims, and with a steady gain the mean NIS stayed near 0.7 for a quarter of
    an hour. So downwards the gain falls as 1/k from a large first step (Robbins & Monro 1951) to
    the steady one, which follows a target that changes; upwards it is steady from the first, as one
    large NIS in six is chance and would undo the safe start twentyfold.
    """
    if settings.preset == "paper" or settings.is_noise_held:
        return predicted.q_scale
    excess = min(nis, _LARGEST_NIS) / NIS_AIM - 1.0
    gain = _ADAPT_GAIN
    if excess < 0.0:
        gain = max(gain, _FIRST_ADAPT_GAIN / (predicted.innovations + 1))
    step = max(gain * excess, -_LARGEST_STEP_DOWN)
    return float(min(max(predicted.q_scale * np.exp(step), Q_SCALE_MIN), Q_SCALE_MAX))


def log_det_innovation(
    predicted: TrackState, measurement: Measurement, settings: FilterConfig
) -> float:
    """Return the logarithm of the determinant of S = C P- C' + R on the sky, arcsec^4."""
    R, P = measurement_noise(measurement, settings), predicted.P
    ee, en, nn = P[0][0] + R[0, 0], P[0][2] + R[0, 1], P[2][2] + R[1, 1]
    cos_dec = math.cos(math.radians(predicted.x[2]))
    return math.log((ee * nn - en * en) * (cos_dec * ARCSEC_PER_DEG**2) ** 2)


def is_gated_out(nis: float, settings: FilterConfig) -> bool:
    """Return True where an NIS is above the gate: the measurement is not the track's."""
    return nis > settings.gate_nis


def direction_icrs_deg(state: TrackState) -> tuple[float, float]:
    """RA and Dec of the track at its instant."""
    return state.x[0], state.x[2]


def sky_covariance_arcsec2(state: TrackState) -> FloatArray:
    """Return the covariance (2, 2) of the track's direction (east, north), arcsec^2."""
    to_sky = np.array([_cos_dec(state.x[2]), 1.0]) * ARCSEC_PER_DEG
    return np.asarray(C @ np.array(state.P) @ C.T * np.outer(to_sky, to_sky))


def sky_rate_arcsec_s(state: TrackState) -> tuple[float, float]:
    """Return the track's rate on the sky (east, north), arcsec/s."""
    return (state.x[1] * _cos_dec(state.x[2]) * ARCSEC_PER_DEG, state.x[3] * ARCSEC_PER_DEG)


def transition_matrix(dt_s: float) -> FloatArray:
    """Transition matrix F = expm(A dt); A squared is 0: the series ends after its second term."""
    A = np.zeros((4, 4))
    A[0, 1] = A[2, 3] = 1.0
    return np.asarray(np.eye(4) + A * dt_s)


def process_noise(dt_s: float, dec_deg: float, settings: FilterConfig) -> FloatArray:
    """Process noise Q (4, 4) in deg and deg/s; a negative dt is for prediction back in time."""
    if settings.preset == "paper":
        sigma = settings.sigma_arcsec / ARCSEC_PER_DEG
        diagonal = np.array([500.0 * sigma, sigma / 100.0, sigma / 5.0, sigma / 100.0])
        return _scaled(np.diag(diagonal) * settings.q_multiplier, q_multipliers(settings))
    q = settings.q_arcsec2_s3 * settings.q_multiplier / ARCSEC_PER_DEG**2
    span = abs(dt_s)
    block = q * np.array([[span**3 / 3.0, dt_s * span / 2.0], [dt_s * span / 2.0, span]])
    Q = np.zeros((4, 4))
    Q[:2, :2] = block / _cos_dec(dec_deg) ** 2
    Q[2:, 2:] = block
    return _scaled(Q, q_multipliers(settings))


def _scaled(covariance: FloatArray, terms: tuple[float, ...]) -> FloatArray:
    """Scale each term of the diagonal by its factor; correlations stay as they are."""
    roots = np.sqrt(np.array(terms))
    return np.asarray(covariance * np.outer(roots, roots))


def measurement_noise(measurement: Measurement, settings: FilterConfig) -> FloatArray:
    """Measurement noise R (2, 2) of (alpha, delta), deg^2; alpha's grows towards the pole."""
    terms = settings.r_ra_multiplier, settings.r_dec_multiplier
    if settings.preset == "paper":
        sigma = settings.sigma_arcsec / ARCSEC_PER_DEG
        return _scaled(np.diag([2.0 * sigma**2, sigma**2]) * settings.r_multiplier, terms)
    return _scaled(own_noise(measurement) * settings.r_multiplier, terms)


def own_noise(measurement: Measurement) -> FloatArray:
    """Return a measurement's own covariance (2, 2) of (alpha, delta), deg^2, within bounds."""
    east, cross, north = measurement.cov_sky_arcsec2
    floor = SIGMA_FLOOR_ARCSEC**2
    on_sky = np.array([[max(east, floor), cross], [cross, max(north, floor)]])
    if not math.hypot(east, north) < SIGMA_CEILING_ARCSEC**2:
        on_sky = np.eye(2) * SIGMA_CEILING_ARCSEC**2
    to_deg = np.array([1.0 / _cos_dec(measurement.dec_icrs_deg), 1.0]) / ARCSEC_PER_DEG
    return np.asarray(on_sky * np.outer(to_deg, to_deg))


def _initial_covariance(
    first: Measurement, second: Measurement, settings: FilterConfig
) -> FloatArray:
    """Two-point covariance [[R2, R2/dt], [R2/dt, (R1 + R2)/dt^2 + q dt/3]]; I for the paper."""
    if settings.preset == "paper":
        return np.eye(4)
    dt_s = (second.t_mid_utc_ns - first.t_mid_utc_ns) / 1e9
    R1, R2 = measurement_noise(first, settings), measurement_noise(second, settings)
    slopes = C @ process_noise(dt_s, second.dec_icrs_deg, settings) @ C.T / dt_s**2
    angles, rates = [0, 2], [1, 3]
    P = np.zeros((4, 4))
    P[np.ix_(angles, angles)] = R2
    P[np.ix_(angles, rates)] = P[np.ix_(rates, angles)] = R2 / dt_s
    P[np.ix_(rates, rates)] = (R1 + R2) / dt_s**2 + slopes
    return P


_own = threading.local()
"""Filter object of each thread: making one takes as long as a step with it."""


def _kalman(state: TrackState) -> Any:
    kalman = getattr(_own, "kalman", None)
    if kalman is None:
        # filterpy pulls in most of scipy, a second: only these presets pay for it.
        from filterpy.kalman import KalmanFilter

        kalman = _own.kalman = KalmanFilter(dim_x=4, dim_z=2)
        kalman.H = C
    kalman.x, kalman.P = np.array(state.x), np.array(state.P)
    return kalman


def _cos_dec(dec_deg: float) -> float:
    return max(math.cos(math.radians(dec_deg)), _MIN_COS_DEC)


def _state(t_utc_ns: int, x: Any, P: Any, **more: Any) -> TrackState:
    return TrackState(
        t_utc_ns=t_utc_ns,
        x=(wrap_360(float(x[0])), float(x[1]), float(x[2]), float(x[3])),
        P=tuple(map(tuple, ((P + P.T) / 2.0).tolist())),
        **more,
    )
