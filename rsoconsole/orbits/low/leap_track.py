"""Track of a low satellite from streak to streak, and the orbit through them. Pure.

One streak does not show in which sense the object moved, so a track begins as two hypotheses, each
with all low orbits through the streak (`low_cloud`). A second streak at a place that one of them
predicts gives an orbit (`low_fit`), which then predicts the next streak and rejects others.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import erf

import numpy as np

from rsoconsole.orbits.low.low_cloud import (
    OrbitCloud,
    cloud_through_streak,
    nearest_state,
    predict_from_cloud,
)
from rsoconsole.orbits.low.low_fit import LowOrbit, StreakEnds, TimingErrors, fit_streaks
from rsoconsole.orbits.motion.ahead import PredictedPosition, PredictedSkyPath, sky_path_through
from rsoconsole.orbits.motion.prediction import KnownOrbit, predict, predict_motion
from rsoconsole.records import FloatArray, Site
from rsoconsole.sky import IntArray, position_angle_deg, separation_deg, wrap_180
from rsoconsole.words import NS_PER_S

GATE = 30.0
"""Largest squared residual of a streak's four numbers for this object: chance of more 5e-6."""
MIN_PROBABILITY = 1e-4
MAX_SCATTER_S = 1.0
"""Largest scatter of the shutter, s, one sigma, where it has not been measured."""
_STRAIGHT_S = 0.1
_OF_MOTION = 4
"""Number of unknowns of an orbit that give the place along its path."""
_SAME_SCATTER = 1.15
_MAX_SHAKE_ARCSEC, _SAME_SHAKE_ARCSEC = 6.0, 0.3
_SHAKE_FRAMES = 3.0
"""Weight of the belief that nothing shakes, in frames."""
_OF_PLANE = 3
"""Number of unknowns that give the place across the path."""
_WHOLE_SIGMAS, _RATE_ERROR = 3.0, 0.01
"""Largest deviation of a trusted length, in sigmas; error of the rate, as a share of it."""
_MAX_MISSING = 0.5
"""Largest share of a streak's length hidden by a mount that goes on before the shutter closes."""
_MAX_FITS = 3
_DETECTED = 0.9
"""Probability of detecting a streak that was in the frame, where nothing else is known."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hypothesis:
    """One sense of the motion along the first streak, with all streaks and the orbit."""

    streaks: tuple[StreakEnds, ...]
    """Streaks in order of time, each with its ends in the sense of this hypothesis."""
    cloud: OrbitCloud
    orbit: LowOrbit | None
    """Orbit through the streaks; None before the second one."""
    probability: float
    scatter_s: float
    """Timing scatter of the shutter, s, one sigma: stated at first, then found from the streaks."""
    shake_arcsec: float = 0.0
    """One sigma of each end's error beyond the stated one, found from the streaks' offsets."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LeapTrack:
    """Track of a low satellite: hypotheses, the likeliest first; probabilities add up to 1."""

    site: Site
    timing: TimingErrors
    hypotheses: tuple[Hypothesis, ...]

    @property
    def best_hypothesis(self) -> Hypothesis:
        """Likeliest hypothesis."""
        return self.hypotheses[0]

    def predicted_position(self, t_utc_ns: int, number: int = 0) -> PredictedPosition | None:
        """Return the position that a hypothesis predicts; None where it predicts none.

        ``number``: index of the hypothesis, 0 the likeliest.
        """
        each = self.hypotheses[number]
        if each.orbit is None:
            return predict_from_cloud(each.cloud, self.site, t_utc_ns, each.scatter_s)
        motion = predict_motion(each.orbit, self.site, t_utc_ns)
        if motion is None:
            return None
        return PredictedPosition(
            t_utc_ns=t_utc_ns,
            ra_icrs_deg=motion.ra_icrs_deg,
            dec_icrs_deg=motion.dec_icrs_deg,
            rate_arcsec_s=np.array(motion.rate_arcsec_s),
            covariance_arcsec2=motion.covariance[np.ix_([0, 2], [0, 2])],
        )

    def predicted_path(
        self, from_utc_ns: int, span_s: float, number: int = 0, step_s: float = 2.0
    ) -> PredictedSkyPath | None:
        """Return the path predicted by a hypothesis for ``span_s`` seconds.

        At steps of ``step_s``. ``number``: index of the hypothesis, 0 the likeliest. None where
        fewer than two places are predicted. Covariances include the shutter's timing scatter.
        """
        each, steps = self.hypotheses[number], int(np.ceil(span_s / step_s)) + 1
        t = from_utc_ns + (np.arange(steps) * step_s * NS_PER_S).astype(np.int64)
        if each.orbit is not None:
            return path_of_orbit(each.orbit, self.site, t, each.scatter_s)
        places = [predict_from_cloud(each.cloud, self.site, int(at), each.scatter_s) for at in t]
        known = [place for place in places if place is not None]
        return sky_path_through(known) if len(known) > 1 else None


def path_of_orbit(
    orbit: KnownOrbit, site: Site, t_utc_ns: IntArray, scatter_s: float = 0.0
) -> PredictedSkyPath | None:
    """Path of an orbit on the sky, at instants in order; None where the object has decayed.

    ``scatter_s``: timing scatter of the shutter, added to the covariances along the path.
    """
    found = predict(orbit, site, t_utc_ns)
    places = found.places
    east = places.ra_rate_deg_s * np.cos(np.radians(places.dec_icrs_deg))
    rates = 3600.0 * np.stack([east, places.dec_rate_deg_s], axis=-1)
    if not (np.all(np.isfinite(rates)) and np.all(np.isfinite(found.cov_sky_arcsec2))):
        return None
    return sky_path_through(
        [
            PredictedPosition(
                t_utc_ns=int(t),
                ra_icrs_deg=float(ra),
                dec_icrs_deg=float(dec),
                rate_arcsec_s=rate,
                covariance_arcsec2=np.array([[ee, en], [en, nn]])
                + scatter_s**2 * np.outer(rate, rate),
            )
            for t, ra, dec, rate, (ee, en, nn) in zip(
                places.t_utc_ns,
                places.ra_icrs_deg,
                places.dec_icrs_deg,
                rates,
                found.cov_sky_arcsec2,
                strict=True,
            )
        ]
    )


def begin_leap_track(
    site: Site, streak: StreakEnds, timing: TimingErrors, *, is_turned: bool = False
) -> LeapTrack | None:
    """Begin a track from one streak with both ends; None where no low orbit passes through it.

    ``is_turned``: the ends of the streak are known to be in order of time; if False, both senses
    become hypotheses.
    """
    if not streak.is_whole:
        return None
    senses = (streak,) if is_turned else (streak, streak.reversed)
    found = [(each, cloud_through_streak(site, each)) for each in senses]
    likely = [(each, cloud) for each, cloud in found if cloud is not None]
    if not likely:
        return None
    top = max(cloud.log_evidence for _, cloud in likely)
    return _track(
        site,
        timing,
        [
            Hypothesis(
                streaks=(each,),
                cloud=cloud,
                orbit=None,
                probability=float(np.exp(cloud.log_evidence - top)),
                scatter_s=timing.scatter_s,
            )
            for each, cloud in likely
        ],
    )


def update_leap_track(track: LeapTrack, streak: StreakEnds) -> LeapTrack | None:
    """Update the track with one more streak, a later one; None where it fits no hypothesis.

    The shaking of the image is estimated from the streaks, and so is the shutter's timing scatter
    where it has not been measured.
    """
    found = []
    for number, each in enumerate(track.hypotheses):
        place = track.predicted_position(streak.t_mid_utc_ns, number)
        if place is None:
            continue
        turned = streak_along_motion(streak, place)
        late_s = _late_s(place, turned)
        if abs(late_s) > _STRAIGHT_S:
            # Its path bends: it is held against where it was then.
            place = track.predicted_position(streak.t_mid_utc_ns + round(late_s * NS_PER_S), number)
            if place is None:
                continue
        fitting = _as_it_fits(track.timing, each, place, turned)
        if fitting is None:
            continue
        fitted, log_likelihood = fitting
        amiss_arcsec = float(np.max(fitted.sigma_along_arcsec - turned.sigma_along_arcsec))
        if each.orbit is None and amiss_arcsec > 0.0:
            # Of two streaks that differ in their rate either may have shown a part.
            first = each.streaks[0].with_length_error(amiss_arcsec)
            each = replace(each, streaks=(first,))  # noqa: PLW2901
        after = _with_streak(track, each, fitted)
        if after is not None:
            found.append((log_likelihood + np.log(each.probability), after))
    if not found:
        return None
    top = max(log for log, _ in found)
    return _track(
        track.site,
        track.timing,
        [replace(each, probability=float(np.exp(log - top))) for log, each in found],
    )


def leap_track_after_miss(
    track: LeapTrack, t_utc_ns: int, centre_deg: tuple[float, float], radius_deg: float
) -> LeapTrack:
    """Return the track with its probabilities updated by a frame without a streak.

    ``centre_deg``: right ascension and declination of the frame's centre; ``radius_deg``: radius
    around it without a streak.
    """
    changed = []
    for number, each in enumerate(track.hypotheses):
        place = track.predicted_position(t_utc_ns, number)
        within = 0.0 if place is None else _share_within(place, centre_deg, radius_deg)
        changed.append(replace(each, probability=each.probability * (1.0 - _DETECTED * within)))
    return _track(track.site, track.timing, changed)


def streak_along_motion(streak: StreakEnds, place: PredictedPosition) -> StreakEnds:
    """Streak with its ends in the order of the motion predicted at ``place``."""
    s = np.radians(wrap_180(float(streak.ra_icrs_deg[1] - streak.ra_icrs_deg[0])))
    east = s * np.cos(np.radians(float(np.mean(streak.dec_icrs_deg))))
    north = np.radians(float(streak.dec_icrs_deg[1] - streak.dec_icrs_deg[0]))
    is_along = east * place.rate_arcsec_s[0] + north * place.rate_arcsec_s[1] >= 0.0
    return streak if is_along else streak.reversed


def _track(site: Site, timing: TimingErrors, hypotheses: Sequence[Hypothesis]) -> LeapTrack:
    total = sum(each.probability for each in hypotheses)
    scaled = [replace(each, probability=each.probability / total) for each in hypotheses]
    scaled.sort(key=lambda each: -each.probability)
    kept = [each for each in scaled if each.probability > MIN_PROBABILITY]
    return LeapTrack(site=site, timing=timing, hypotheses=tuple(kept))


def _with_streak(track: LeapTrack, each: Hypothesis, streak: StreakEnds) -> Hypothesis | None:
    """Hypothesis with the orbit through all streaks.

    They are weighed by the shutter's scatter that the orbit shows.
    """
    streaks, scatter_s = (*each.streaks, streak), each.scatter_s
    shake_arcsec = each.shake_arcsec
    if each.orbit is None:
        state, epoch = nearest_state(each.cloud, track.site, streak), each.cloud.epoch_utc_ns
    else:
        state, epoch = (each.orbit.r_km, each.orbit.v_km_s), each.orbit.epoch_utc_ns
    for _ in range(_MAX_FITS):
        timing = replace(track.timing, scatter_s=scatter_s)
        shaken = [one.with_end_error(shake_arcsec) for one in streaks]
        orbit = fit_streaks(track.site, shaken, state, epoch, timing)
        if orbit is None or not orbit.is_converged:
            return None
        before_s, scatter_s = scatter_s, _scatter_s(track.timing, streaks, orbit)
        before_arcsec, shake_arcsec = shake_arcsec, _shake_arcsec(streaks, orbit)
        is_steady = abs(shake_arcsec - before_arcsec) < _SAME_SHAKE_ARCSEC
        if is_steady and 1.0 / _SAME_SCATTER < scatter_s / before_s < _SAME_SCATTER:
            break
        state, epoch = (orbit.r_km, orbit.v_km_s), orbit.epoch_utc_ns
    return replace(
        each, streaks=streaks, orbit=orbit, scatter_s=scatter_s, shake_arcsec=shake_arcsec
    )


def _scatter_s(timing: TimingErrors, streaks: Sequence[StreakEnds], orbit: LowOrbit) -> float:
    """Timing scatter of the shutter: as stated, and as the streaks lie early and late on their
    orbit.

    Scale of a scaled inverse chi-square law (Gelman et al. 2013, 2.6), less the degrees of freedom
    of the motion along the path.
    """
    if not np.isfinite(timing.scatter_frames):
        return timing.scatter_s
    late_s = [
        float(np.mean(off[:, 0])) / each.speed_arcsec_s
        for each, off in zip(streaks, orbit.residuals_arcsec, strict=True)
        if each.is_whole
    ]
    frames = timing.scatter_frames
    square = frames * timing.scatter_s**2 + float(np.sum(np.square(late_s)))
    return float(np.sqrt(square / (frames + max(len(late_s) - _OF_MOTION, 0))))


def _shake_arcsec(streaks: Sequence[StreakEnds], orbit: LowOrbit) -> float:
    """Error of each end beyond its stated sigma, from how far the streaks lie beside the orbit."""
    off = orbit.residuals_arcsec[..., 1]
    own = np.stack([each.sigma_across_arcsec for each in streaks])
    spare = max(off.size - _OF_PLANE, 0)
    square = float(np.sum(np.square(off / own))) + _SHAKE_FRAMES
    times = square / (spare + _SHAKE_FRAMES)
    return float(np.sqrt(max(times - 1.0, 0.0) * np.mean(np.square(own))))


def _as_it_fits(
    timing: TimingErrors, each: Hypothesis, place: PredictedPosition, streak: StreakEnds
) -> tuple[StreakEnds, float] | None:
    """Streak with its trusted ends, and its log likelihood; None where it is another object's.

    First with the errors estimated so far, then as late as a frame may be, last in a gust.
    """
    streak = _of_sure_length(place, streak, each.shake_arcsec)
    is_measured = not np.isfinite(timing.scatter_frames)
    latest_s = each.scatter_s if is_measured else max(MAX_SCATTER_S, each.scatter_s)
    gust_arcsec = max(_MAX_SHAKE_ARCSEC, each.shake_arcsec)
    for shake_arcsec, late_s in (
        (each.shake_arcsec, each.scatter_s),
        (each.shake_arcsec, latest_s),
        (gust_arcsec, latest_s),
    ):
        found = _log_likelihood(place, streak.with_end_error(shake_arcsec), late_s)
        if found is not None:
            return streak, found
    return None


def _of_sure_length(
    place: PredictedPosition, streak: StreakEnds, shake_arcsec: float
) -> StreakEnds:
    """Streak whose ends along it are no surer than its length agrees with the rate.

    A mount that slews on before the shutter has closed hides one of them.
    """
    if not streak.is_whole:
        return streak
    expected_arcsec = place.speed_arcsec_s * float(np.diff(streak.ends_utc_ns)[0]) / NS_PER_S
    missing_arcsec = abs(expected_arcsec - streak.length_arcsec)
    rate_error_arcsec = _RATE_ERROR * expected_arcsec
    sigma_arcsec = np.sqrt(
        float(np.sum(np.square(streak.with_end_error(shake_arcsec).sigma_along_arcsec)))
        + rate_error_arcsec**2
    )
    is_whole = missing_arcsec < _WHOLE_SIGMAS * sigma_arcsec
    if is_whole or missing_arcsec > _MAX_MISSING * expected_arcsec:
        return streak
    return streak.with_length_error(missing_arcsec)


def _log_likelihood(place: PredictedPosition, streak: StreakEnds, scatter_s: float) -> float | None:
    """Log likelihood of the middle of a streak by place, and of its rate; None beyond the gate.

    ``place`` at the middle of the frame, or when the light seems to have been there.
    """
    cov = streak.covariances_arcsec2
    rate = place.rate_arcsec_s
    # Each end against where the rate puts it: the place's error and the time's are common.
    since_s = (streak.ends_utc_ns - place.t_utc_ns) / NS_PER_S
    off = np.concatenate([_offset(place, streak, n) - rate * since_s[n] for n in range(2)])
    common = place.covariance_arcsec2 + scatter_s**2 * np.outer(rate, rate)
    total = np.kron(np.ones((2, 2)), common)
    total[:2, :2] += cov[0]
    total[2:, 2:] += cov[1]
    # What is known of the rate: by a hundredth or so, and the path bends.
    lever = np.array([[since_s[0]], [since_s[1]]]) * 0.03 * place.speed_arcsec_s
    total += np.kron(lever @ lever.T, np.eye(2))
    chi2 = float(off @ np.linalg.solve(total, off))
    if not chi2 <= GATE:
        return None
    return -0.5 * (chi2 + float(np.linalg.slogdet(total)[1]))


def _late_s(place: PredictedPosition, streak: StreakEnds) -> float:
    """Delay of the light after the frame's time, along the motion, seconds."""
    off = 0.5 * (_offset(place, streak, 0) + _offset(place, streak, 1))
    since_s = float(np.mean(streak.ends_utc_ns - place.t_utc_ns)) / NS_PER_S
    return float(off @ place.rate_arcsec_s) / place.speed_arcsec_s**2 - since_s


def _offset(place: PredictedPosition, streak: StreakEnds, end: int) -> FloatArray:
    """Offset (2,) in arcsec east and north of the place; for less than a few degrees."""
    ra, dec = float(streak.ra_icrs_deg[end]), float(streak.dec_icrs_deg[end])
    away = 3600.0 * separation_deg(place.ra_icrs_deg, place.dec_icrs_deg, ra, dec)
    towards = np.radians(position_angle_deg(place.ra_icrs_deg, place.dec_icrs_deg, ra, dec))
    return away * np.array([np.sin(towards), np.cos(towards)])


def _share_within(
    place: PredictedPosition, centre_deg: tuple[float, float], radius_deg: float
) -> float:
    """Probability of lying within a radius of a direction: by the distance along the line to it."""
    away = separation_deg(place.ra_icrs_deg, place.dec_icrs_deg, *centre_deg)
    sigma = max(place.sigma_arcsec / 3600.0, 1e-6)
    near, far = (side / sigma / np.sqrt(2.0) for side in (radius_deg - away, -radius_deg - away))
    return 0.5 * (erf(near) - erf(far))
