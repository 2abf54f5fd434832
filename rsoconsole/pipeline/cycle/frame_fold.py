"""The fold of a frame: tracks after it, from the records alone. Pure, without pixels."""

import functools
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from rsoconsole.base import FrameError
from rsoconsole.config import Config
from rsoconsole.orbits import expected_sky_acceleration, orbit_from_record, predict_motion
from rsoconsole.pipeline.cycle.miss_reasons import (
    StarHistory,
    miss_with_causes,
    star_statistics,
    updated_star_history,
)
from rsoconsole.pipeline.frame.measurement import (
    calibrated_timing,
    frame_timing,
    measure_faint,
    mid_exposure_utc_ns,
    with_row_time,
)
from rsoconsole.pipeline.frame.reduce import miss_from_frame_records
from rsoconsole.records import (
    Detections,
    FoldRecord,
    Frame,
    FrameTaken,
    Measurement,
    Missed,
    NotSolved,
    OrbitEstimate,
    Record,
    Ruling,
    Solution,
    TrackState,
)
from rsoconsole.tracking import (
    ONLY_CROSSING,
    Field,
    Following,
    FollowSettings,
    FrameInput,
    follow,
    three_sigma_deg,
)
from rsoconsole.tracking.filters import estimator


def may_orbit_guide(config: Config) -> bool:
    """Return True if an orbit may set the aim point and continue a track that is lost.

    It may with ``orbit.guide`` "when better", except with preset ``paper``, which uses the filter
    alone.
    """
    return config.orbit.guide == "when better" and config.filter.preset != "paper"


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameObservations:
    """Everything on record that was observed in one frame: the input of the fold."""

    taken: FrameTaken
    detections: Detections
    solution: Solution | NotSolved | None
    measurements: tuple[Measurement, ...]
    decision: Ruling | None = None
    """The operator's decision on the frame; None without one."""
    decisions: int = 0
    orbits: Mapping[int, OrbitEstimate] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReducedFrame:
    """The observations of one frame and the configuration in force for it."""

    observations: FrameObservations
    config: Config

    @property
    def frame_id(self) -> int:
        """Number of the frame, as in the records."""
        return self.observations.taken.frame_id


@dataclass(frozen=True, slots=True, kw_only=True)
class FoldedFrame(ReducedFrame):
    """Frame that was folded into the tracks: the state before it and after it."""

    before: Following
    stars_before: StarHistory
    following: Following
    stars: StarHistory
    records: tuple[Record, ...]


def fold_frame(
    before: Following, stars_before: StarHistory, observed: FrameObservations, config: Config
) -> FoldedFrame:
    """Fold one frame into the tracks. Pure. Raises FrameError for a frame without a time.

    ``before``, ``stars_before``: state and star history before the frame; ``config``: in force for
    it.
    """
    taken = observed.taken
    t_mid_ns, exposure_s = mid_exposure(taken, config)
    stars = star_statistics(taken, observed.detections)
    plain = Missed(kind="nothing fits")
    if not observed.measurements:
        plain = miss_from_frame_records(observed.detections, observed.solution, t_mid_ns)
    elif all(m.is_crossing for m in observed.measurements):
        plain = ONLY_CROSSING
    # Asked for by misses alone: the Sun and the Earth's shadow cost more than all the rest.
    absence = functools.partial(
        miss_with_causes,
        plain,
        stars=stars,
        stars_before=stars_before,
        track=before.track,
        site=config.site.to_site(),
        t_utc_ns=t_mid_ns,
        blocked=taken.blocked,
    )
    decision = observed.decision or Ruling(frame_id=taken.frame_id)
    shutter = frame_timing(taken, config.exposure)
    refused = tuple(with_row_time(m, t_mid_ns, shutter) for m in decision.refused)
    chosen = decision.taken and with_row_time(decision.taken, t_mid_ns, shutter)
    # The decision's own instant is the recorded one: another where its latency is tried.
    measurements = tuple(m for m in observed.measurements if m not in refused)
    if chosen is not None and chosen not in measurements:
        measurements = (*measurements, chosen)
    seen = FrameInput(
        frame_id=taken.frame_id,
        t_mid_utc_ns=t_mid_ns,
        exposure_s=exposure_s,
        measurements=measurements,
        faint=_faint_of(before, observed, config),
        absence=absence,
        field=_field_of(observed),
        star_width_arcsec=_width_arcsec(observed),
        chosen=chosen,
        refused=refused,
        dropped=decision.dropped,
        kept=decision.kept,
        released=decision.released,
        by_orbit=_asks_orbit(before, observed.orbits, config, t_mid_ns),
    )
    after, records = follow(before, seen, follow_settings(config, taken))
    return FoldedFrame(
        observations=observed,
        config=config,
        before=before,
        stars_before=stars_before,
        following=after,
        stars=updated_star_history(stars_before, stars, observed.solution),
        records=(*_faint_taken((*before.faint, *seen.faint), records), *records),
    )


def _faint_of(
    before: Following, observed: FrameObservations, config: Config
) -> tuple[Measurement, ...]:
    """Measurements of candidates below tau, where they may initiate a track or be of one."""
    is_enough = before.tracks and len(observed.measurements) >= len(before.tracks)
    if is_enough or not isinstance(observed.solution, Solution):
        return ()
    decision = observed.decision or Ruling(frame_id=observed.taken.frame_id)
    decided = (*decision.refused, *filter(None, (decision.taken,)))
    known = {m.measurement_id for m in (*observed.measurements, *decided)}
    found = measure_faint(observed.detections, observed.solution, observed.taken, config.exposure)
    return tuple(m for m in found if m.measurement_id not in known)


def _faint_taken(
    faint: Sequence[Measurement], records: Sequence[FoldRecord]
) -> tuple[Measurement, ...]:
    """Those of the faint measurements that a track has taken: only they go on record."""
    taken = {
        name
        for each in records
        if isinstance(each, TrackState)
        for name in (each.measurement_id, *(each.begun_with or ()), *each.begun_through)
    }
    return tuple(m for m in faint if m.measurement_id in taken)


def _width_arcsec(observed: FrameObservations) -> float | None:
    """Width of the frame's stars, or of its streaks if narrower, arcsec; None where unknown.

    Stars that drift during the exposure are wider than the resolution that separates two
    satellites.
    """
    width_px = None if observed.detections is None else observed.detections.star_fwhm_px
    if width_px is None or not isinstance(observed.solution, Solution):
        return None
    streaks_px = [d.width_px for d in observed.detections.detections if d.kind == "streak"]
    if streaks_px:
        width_px = min(width_px, statistics.median(streaks_px))
    return width_px * observed.solution.scale_arcsec_px


def _asks_orbit(
    before: Following, orbits: Mapping[int, OrbitEstimate], config: Config, t_mid_ns: int
) -> Callable[[TrackState], TrackState | None] | None:
    """Predictor by orbits for a filter that fails; None where no track's orbit may be used."""
    if not may_orbit_guide(config):
        return None
    known_of = {
        each.track.track_id: orbit
        for each in before.tracks
        if (orbit := orbits.get(each.track.track_id)) is not None
        # With other settings the track may be another one than that which the orbit is of.
        and each.taken is not None
        and each.taken.frame_id == orbit.frame_id
        and orbit.label != "not observable"
    }
    return functools.partial(_by_orbit, known_of, config, t_mid_ns) if known_of else None


def _by_orbit(
    orbits: Mapping[int, OrbitEstimate], config: Config, t_mid_ns: int, failed: TrackState
) -> TrackState | None:
    """State predicted by the track's orbit, if its bounds are narrower than the field."""
    orbit = orbits.get(failed.track_id)
    if orbit is None:
        return None
    motion = predict_motion(orbit_from_record(orbit), config.site.to_site(), t_mid_ns)
    if motion is None:
        return None
    state = estimator.restarted_track(
        (motion.ra_icrs_deg, motion.dec_icrs_deg),
        motion.rate_arcsec_s,
        motion.covariance,
        t_mid_ns,
        failed,
        config.filter,
    )
    widest_deg = min(min(config.optics.field_deg) / 2.0, config.filter.max_3sigma_arcmin / 60.0)
    return state if three_sigma_deg(state) <= widest_deg else None


def _field_of(observed: FrameObservations) -> Field | None:
    if not isinstance(observed.solution, Solution):
        return None
    taken = observed.taken
    return Field(wcs=observed.solution.wcs, width_px=taken.width_px, height_px=taken.height_px)


def mid_exposure(taken: FrameTaken, config: Config) -> tuple[int, float]:
    """Return the mid-exposure, UTC ns, and the exposure, s. Raises FrameError without a time.

    The mid-exposure is the header's, corrected for the shutter's known delay.
    """
    t_mid_ns = mid_exposure_utc_ns(taken, config.exposure)
    if t_mid_ns is None or taken.exposure_s is None:
        raise FrameError(
            f"{taken.name} has no DATE-OBS or EXPTIME: it can be detected and solved,"
            " not followed; have the camera's driver write them"
        )
    return t_mid_ns, taken.exposure_s


def star_history_without_fold(
    stars_before: StarHistory, observed: FrameObservations
) -> StarHistory:
    """Return the star history after a frame that is not folded."""
    if observed.taken.exposure_s is None:
        return stars_before
    return updated_star_history(
        stars_before, star_statistics(observed.taken, observed.detections), observed.solution
    )


def follow_settings(config: Config, frame: Frame | FrameTaken) -> FollowSettings:
    """Return the settings that the fold needs, for a frame of this size."""
    half_field_px = min(frame.width_px, frame.height_px) / 2.0
    return FollowSettings(
        filter=config.filter,
        half_field_deg=half_field_px * config.optics.scale_arcsec_px / 3600.0,
        choice=config.search.follow,
        bend=functools.partial(expected_sky_acceleration, config.site.to_site()),
        is_shutter_known=calibrated_timing(frame, config.exposure) is not None,
    )
