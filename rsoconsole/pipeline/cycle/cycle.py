"""One cycle: a frame, its reduction, the tracks after it, and its records.

The engine, ``process`` and every replay run this, so that the same frames give the same track;
``cycle.frame_fold`` is the half of it that needs no pixels.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from rsoconsole.config import Config
from rsoconsole.pipeline.cycle.decisions import FollowedFrames, UntrackedFrames, decision_records
from rsoconsole.pipeline.cycle.frame_fold import (
    FrameObservations,
    fold_frame,
    mid_exposure,
    star_history_without_fold,
)
from rsoconsole.pipeline.cycle.miss_reasons import StarHistory, cloud_cause, star_statistics
from rsoconsole.pipeline.frame.reduce import FrameReducer, Glance, Reduction
from rsoconsole.pipeline.photometry.frame_photometry import photometry_of
from rsoconsole.records import (
    Event,
    Frame,
    FrameTaken,
    HiddenBy,
    OrbitEstimate,
    Photometry,
    Record,
    Ruling,
    SlewRefusal,
    Solution,
    TrackState,
)
from rsoconsole.tracking import Following


@dataclass(frozen=True, slots=True, kw_only=True)
class CycleResult:
    """Result of one cycle: the reduction, the state after the frame, and the frame's records."""

    reduction: Reduction
    after: Following
    records: tuple[Record, ...]


class Cycle:
    """Cycle under one configuration: it reduces frames and folds them into the tracks."""

    def __init__(self, reducer: FrameReducer, config: Config) -> None:
        self._reducer = reducer
        self._config = config
        self._stars = StarHistory()
        self.folds = FollowedFrames()
        """Last tracked frames, on which the operator may decide."""
        self.hand = UntrackedFrames()
        """Last frames that belong to no track, on which the operator may also decide."""
        self.cloud: HiddenBy | None = None
        """Cloud by the last frame's stars; None for a clear sky."""
        self.star_count: int | None = None
        """Number of stars of the last frame; None where they were not counted."""
        self._said: set[str] = set()

    def configure(self, config: Config) -> None:
        """Use the settings of ``config`` from the next frame on."""
        self._config = config
        self._reducer.configure(config)

    def forget_plate(self) -> None:
        """Forget the last plate solution, because the camera has turned."""
        self._reducer.forget_plate()

    def _observed(
        self,
        taken: FrameTaken,
        reduction: Reduction,
        orbits: Mapping[int, OrbitEstimate] | None = None,
    ) -> FrameObservations:
        self.star_count = reduction.detections.star_count
        if taken.exposure_s is not None:
            self.cloud = cloud_cause(star_statistics(taken, reduction.detections), self._stars)
        return FrameObservations(
            taken=taken,
            detections=reduction.detections,
            solution=reduction.solution,
            measurements=reduction.measurements,
            orbits=orbits or {},
        )

    def _on_record(self, reduction: Reduction, frame_id: int) -> tuple[Record, ...]:
        """Return the records of a frame, with each kind of caution when it first occurs."""
        solution = () if reduction.solution is None else (reduction.solution,)
        fresh = [each for each in reduction.cautions if each.kind not in self._said]
        self._said |= {each.kind for each in fresh}
        events = (Event(level=each.level, text=each.words, frame_id=frame_id) for each in fresh)
        return (reduction.detections, *solution, *reduction.measurements, *events)

    def apply_hand_decision(
        self, decision: Ruling, kept: Following | None, last_track_id: int
    ) -> tuple[Following | None, tuple[Record, ...]]:
        """Apply the operator's decision on a frame that belongs to no track.

        Returns the track kept after the decision, and the records. ``kept``: track kept before the
        first such decision; ``last_track_id``: last id given in the session. Raises ValueError
        where a decision on the frame is no longer possible.
        """
        after, again = self.hand.apply(decision, kept, last_track_id)
        return after, decision_records(decision, again)

    def apply_decision(self, decision: Ruling) -> tuple[Following, tuple[Record, ...]]:
        """Apply the operator's decision on a tracked frame: fold it and all later frames again.

        Returns the state after the last frame, and the records. Raises ValueError where a decision
        on the frame is no longer possible.
        """
        again = self.folds.apply(decision)
        return again[-1].following, decision_records(
            decision, [(each.frame_id, each.records) for each in again]
        )

    def photometry(self, reduction: Reduction, records: Iterable[Record] = ()) -> Photometry:
        """Measure the brightness of a frame's streaks, once its order is given; raise nothing.

        ``records``: the frame's own; those of its tracks tell the speed of streaks that it cuts.
        """
        light, solution = reduction.light, reduction.solution
        if light is None:
            return Photometry(frame_id=reduction.detections.frame_id)
        speeds: dict[str, float] = {}
        for each in records:
            if isinstance(each, TrackState) and isinstance(solution, Solution):
                _, ra_rate, dec_deg, dec_rate = each.x
                rate_deg_s = math.hypot(ra_rate * math.cos(math.radians(dec_deg)), dec_rate)
                scale_deg_px = solution.scale_arcsec_px / 3600.0
                speeds[each.measurement_id or ""] = rate_deg_s / scale_deg_px
        return photometry_of(light, speeds)

    def glance(self, frame: Frame, reach_px: float) -> Glance | None:
        """Return streaks and plate solution from the middle of a frame alone, before ``run``.

        The middle reaches ``reach_px`` from the centre. None as in ``FrameReducer.glance``: no
        smaller middle, no streak in it, or stars that do not fit the last plate solution.
        """
        return self._reducer.glance(frame, reach_px)

    def reduce_only(self, frame: Frame) -> tuple[Reduction, tuple[Record, ...]]:
        """Reduce a frame without folding it into the tracks; return (reduction, records)."""
        reduction = self._reducer.reduce(frame)
        observed = self._observed(frame_taken_record(frame), reduction)
        self._stars = star_history_without_fold(self._stars, observed)
        self.hand.add(observed, self._config)
        return reduction, self._on_record(reduction, frame.frame_id)

    def run(
        self,
        frame: Frame,
        before: Following,
        blocked: SlewRefusal | None = None,
        orbits: Mapping[int, OrbitEstimate] | None = None,
    ) -> CycleResult:
        """Reduce one frame and fold it. Raises FrameError for a frame without a time.

        ``before``: state before the frame; ``blocked``: reason why the slew to the track was
        refused before this frame, as in ``FrameTaken``; ``orbits``: last orbit of each track on
        record, by track id.
        """
        taken = frame_taken_record(frame, blocked)
        mid_exposure(taken, self._config)  # before the work: such a frame cannot be folded
        reduction = self._reducer.reduce(frame)
        observed = self._observed(taken, reduction, orbits)
        folded = fold_frame(before, self._stars, observed, self._config)
        self.folds.add(folded)
        self._stars = folded.stars
        if folded.following.track is None:
            self.hand.add(observed, self._config)
        return CycleResult(
            reduction=reduction,
            after=folded.following,
            records=(*self._on_record(reduction, frame.frame_id), *folded.records),
        )


def frame_taken_record(frame: Frame, blocked: SlewRefusal | None = None) -> FrameTaken:
    """Return the record of a frame without its pixels; ``blocked`` as in ``Cycle.run``."""
    return FrameTaken(
        frame_id=frame.frame_id,
        name=frame.name,
        t_start_utc_ns=frame.t_start_utc_ns,
        exposure_s=frame.exposure_s,
        width_px=frame.width_px,
        height_px=frame.height_px,
        pointing_ra_icrs_deg=frame.pointing_ra_icrs_deg,
        pointing_dec_icrs_deg=frame.pointing_dec_icrs_deg,
        blocked=blocked,
        camera=frame.camera,
    )
