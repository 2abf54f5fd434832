"""Orbits of all tracks, refined with each track's measurements.

Everything comes from the records of the log: the same log gives the same orbits. Successive tracks
belong to one object where one orbit through both is likely enough, so that a satellite that was
lost and found again keeps its orbit.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from operator import is_

import numpy as np

from rsoconsole.config import Config
from rsoconsole.orbits import (
    MeasuredDirections,
    Orbit,
    State,
    TrackletOrbit,
    determine_orbit,
    log_odds_of_joining,
    merged_tracklets,
    probability_from_log_odds,
    tracklet_orbit,
)
from rsoconsole.pipeline.cycle.frame_fold import may_orbit_guide
from rsoconsole.pipeline.cycle.predictor_scores import PredictorScores, Score
from rsoconsole.pipeline.cycle.track_assignment import Track, TrackAssignment
from rsoconsole.pipeline.orbits._orbit_turns import (
    OrbitInnovation,
    orbit_innovation,
    refinement_order,
)
from rsoconsole.pipeline.orbits.orbit_determination import orbit_record_fields
from rsoconsole.pipeline.orbits.track_measurements import (
    PartialStreakErrors,
    directions_from_measurements,
)
from rsoconsole.pipeline.orbits.unassigned_measurements import UnassignedMeasurements
from rsoconsole.records import (
    Event,
    FrameTaken,
    Measurement,
    OrbitEstimate,
    Record,
    Topic,
    TrackState,
)
from rsoconsole.tracking.filters import adaptive, estimator
from rsoconsole.words import duration_words, semi_major_axis_words

ASKED_AT = (6, 12, 24, 48, 96)
"""Measurement counts at which a track is compared with earlier objects and unassigned ones."""
JOINED_FROM, PARTED_BELOW = 0.99, 0.5
"""Probabilities above which a track joins an earlier object, and below which it is parted again."""
_MAX_EARLIER = 4
_MORE_TO_SEEK = 1.2
"""Growth of the number of directions after which a failed search uses all starts again."""
_LEARNT = 0.2
"""Share by which the learned errors must have changed before all is computed again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RefinedOrbit:
    """Orbit of one track, refined after a frame."""

    estimate: OrbitEstimate
    seen: MeasuredDirections
    """Directions of the track alone, without earlier tracks of the same object."""
    events: tuple[Event, ...]


@dataclass(slots=True, eq=False)
class _Target:
    """Object, by its present track and earlier ones."""

    taken: tuple[Measurement, ...] = ()
    """Measurements accepted by the present track."""
    part_errors: PartialStreakErrors = field(default_factory=PartialStreakErrors)
    own: MeasuredDirections | None = None
    """Directions of the present track's measurements."""
    more: tuple[Measurement, ...] = ()
    """Measurements that no track accepted and the orbit claims."""
    seen: MeasuredDirections | None = None
    """Directions of both."""
    before: tuple[MeasuredDirections, ...] = ()
    orbit: Orbit | None = None
    sought_from: int = 0
    """Number of directions with which every start is used again; 0: none has failed."""
    asked: set[int] = field(default_factory=set)
    scores: PredictorScores = field(default_factory=PredictorScores)
    label: str = ""
    first: TrackletOrbit | None = None
    joined: "_Target | None" = None
    """Earlier object with which it was joined; None where it is new."""
    learnt: tuple[float, float] = (0.0, 1.0)
    """Scatter (s) and variance_scale of its measurements' errors."""
    is_none_reported: bool = False
    words: list[str] = field(default_factory=list)

    @property
    def parts(self) -> tuple[MeasuredDirections, ...]:
        return self.before if self.seen is None else (*self.before, self.seen)


class OnlineOrbit:
    """Orbits of the tracked objects, and of a few objects tracked before them."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._site = config.site.to_site()
        self._tracks = TrackAssignment()
        self._unassigned = UnassignedMeasurements()
        self._exposures_s: dict[int, float] = {}
        self._targets: dict[str, _Target] = {}
        """Object of each track, by the id of the track's first measurement."""
        self._lead: _Target | None = None
        """Object of the lead; read it once, as other threads replace it."""
        self._earlier: list[_Target] = []
        self._is_begun = False
        """True where a new lead has begun that has no orbit yet."""

    def configure(self, config: Config) -> None:
        """Use the settings of ``config`` from now on."""
        self._config = config

    def receive(self, record: Record) -> None:
        """Process the next record of the log."""
        self._tracks.receive(record)
        self._unassigned.receive(record)
        if isinstance(record, FrameTaken) and record.exposure_s is not None:
            self._exposures_s[record.frame_id] = record.exposure_s
        if isinstance(record, TrackState) and record.kind == "initial" and record.is_lead:
            self._is_begun = True

    def forget(self) -> None:
        """Forget all measurements: the clock was wrong until now."""
        self._tracks, self._targets, self._lead, self._earlier = TrackAssignment(), {}, None, []
        self._unassigned = UnassignedMeasurements()

    @property
    def track_ids(self) -> frozenset[int]:
        """Ids of the tracks that have a measurement, as the operator's decisions have left them."""
        return frozenset(each.track_id for each in self._tracks.tracks())

    @property
    def lead_directions(self) -> MeasuredDirections | None:
        """Directions of the lead, else of the last lead; None before the first."""
        target = self._lead
        return None if target is None else target.seen

    @property
    def lead_orbit(self) -> Orbit | None:
        """Orbit of the lead, else of the last lead; None before the first."""
        target = self._lead
        return None if target is None else target.orbit

    @property
    def is_lead_orbit_preferred(self) -> bool:
        """True where the telescope may be aimed by the lead's orbit, as it predicts better."""
        target = self._lead
        # The next order goes out before the orbit hears of the frame that began another track.
        if target is None or self._is_begun:
            return False
        return self._guides(target)

    def _guides(self, target: _Target) -> bool:
        return may_orbit_guide(self._config) and target.scores.is_orbit_ahead

    def refine(self) -> tuple[RefinedOrbit, ...]:
        """Refine the orbits of tracks with new measurements, each through all its measurements.

        A track is left out where no orbit can be determined, or its turn has not come
        (``_orbit_turns``). The frame of an estimate is that of the last accepted measurement.
        Directions that cannot be fitted raise no error.
        """
        if not self._config.orbit.online:
            return ()
        tracks = [each for each in self._tracks.live_tracks() if each.measurements]
        if not tracks:
            return ()
        self._is_begun = False
        targets = self._aimed_at(tracks)
        known = [target.taken for target in targets]
        now = refinement_order(tracks, known, self._tracks.newest_frame_id)
        found = [self._refined(targets[n], tracks[n]) for n in now]
        return tuple(each for each in found if each is not None)

    def _refined(self, target: _Target, track: Track) -> RefinedOrbit | None:
        count, learnt = len(target.taken), target.learnt
        if not self._take(target, track) or target.seen is None:
            return None
        predicted = None
        if len(target.taken) == count + 1 and target.orbit is not None:
            # By what was learnt before it, as the filter's own answer is.
            last = adaptive.with_learned_errors(target.taken[-2:], *learnt)[-1]
            predicted = orbit_innovation(
                target.orbit, self._site, target.part_errors.with_last_widening(last)
            )
        self._ask_earlier(target)
        self._claim_unassigned(target, count)
        seen, _ = merged_tracklets(target.parts)
        orbit = target.orbit = self._determined(target, seen)
        if orbit is None:
            return None
        was_guide = self._guides(target)
        if track.last.foretold_by == "orbit":
            target.scores.add_filter_failure(track.last.filter_nis, self._config.filter.gate_nis)
        elif predicted is not None and (by_filter := self._by_filter(track)) is not None:
            target.scores.add_scores(predicted.score, by_filter)
        estimate = self._estimate(target, track, orbit, seen, predicted)
        words, target.words = [*target.words, *_news(target, estimate)], []
        if not track.last.is_lead:
            words = [f"track {track.track_id}: {each}" for each in words]
        events = [Event(level="info", text=each, frame_id=estimate.frame_id) for each in words]
        # The telescope goes by the lead's alone.
        if track.last.is_lead and estimate.is_guide != was_guide:
            which = "orbit from now on" if estimate.is_guide else "filter again"
            text = f"aims by the {which}: {target.scores.words}"
            topic: Topic = "close predictor" if target.scores.has_similar_sigmas else "predictor"
            turn = Event(level="info", text=text, frame_id=estimate.frame_id, topic=topic)
            events.append(turn)
        return RefinedOrbit(estimate=estimate, seen=target.seen, events=tuple(events))

    def _aimed_at(self, tracks: Sequence[Track]) -> list[_Target]:
        """Return the object of each track, a known one or a new one until it is joined.

        The first of them is the lead's.
        """
        begun_with = [track.measurements[0].measurement_id for track in tracks]
        for ended in [each for each in self._targets if each not in begun_with]:
            before = self._targets.pop(ended)
            if before.orbit is not None:
                before.joined = None  # its parts are in it for good
                self._earlier = [*self._earlier, before][-_MAX_EARLIER:]
        targets = [self._targets.setdefault(each, _Target()) for each in begun_with]
        self._lead = targets[0]
        return targets

    def _take(self, target: _Target, track: Track) -> bool:
        """Take the track's measurements, reduced; False where none is new or a direction."""
        taken, known = tuple(track.measurements), target.taken
        if len(taken) == len(known) and all(map(is_, taken, known)):
            return False
        is_longer = len(taken) > len(known) and all(map(is_, taken, known))
        learnt = _learnt(track.last)
        if any(
            abs(a - b) > _LEARNT * max(a, b) for a, b in zip(learnt, target.learnt, strict=True)
        ):
            target.learnt, is_longer = learnt, False
        # The first new one is measured against the last known one.
        start = len(known) if is_longer else 0
        back = min(start, 1)
        fresh = adaptive.with_learned_errors(taken[start - back :], *target.learnt)[back:]
        target.part_errors = target.part_errors if is_longer else PartialStreakErrors()
        fresh = target.part_errors.with_widened_covariances(
            fresh, taken, track.last, self._exposures_s
        )
        seen = self._reduced(fresh)
        if (seen is None or len(seen) < len(fresh)) and not target.is_none_reported:
            target.is_none_reported = True
            target.words.append("a measurement that is no direction was left out of the orbit")
        known_seen = target.own if is_longer else None
        parts = [each for each in (known_seen, seen) if each is not None]
        target.taken = taken
        frames = {m.frame_id for m in taken}
        target.more = tuple(m for m in target.more if m.frame_id not in frames)
        target.own = merged_tracklets(parts)[0] if parts else None
        self._put_together(target)
        return seen is not None

    def _put_together(self, target: _Target) -> None:
        """Merge the track's own directions with those that its orbit has claimed."""
        more = self._reduced(_with_errors_of(target)) if target.more else None
        parts = [each for each in (target.own, more) if each is not None]
        target.seen = merged_tracklets(parts)[0] if parts else None

    def _claim_unassigned(self, target: _Target, before: int) -> None:
        """Claim unassigned measurements that fit the orbit, now that it is known better.

        ``before``: the number of the track's measurements when it was last refined.
        """
        now = len(target.taken)
        if target.orbit is None or not any(n == now or before < n < now for n in ASKED_AT):
            return
        # By the orbit of the frame before: all that it claims is asked for again each time.
        frames = {m.frame_id for m in target.taken}
        more = self._unassigned.measurements_of_orbit(
            target.orbit, self._site, frames, target.learnt
        )
        if len(more) > len(target.more):
            new = len(more) - len(target.more)
            target.words.append(f"{new} more of the streaks that no track took belong to it")
        if more != target.more:
            target.more = more
            self._put_together(target)

    def _reduced(self, taken: Sequence[Measurement]) -> MeasuredDirections | None:
        """Return the directions of measurements, without those that are no directions."""
        try:
            return directions_from_measurements(self._site, taken)
        except ValueError:
            if len(taken) == 1:
                return None
        parts = [each for one in taken if (each := self._reduced((one,))) is not None]
        return merged_tracklets(parts)[0] if parts else None

    def _ask_earlier(self, target: _Target) -> None:
        """Compare the object with earlier ones, and again as its measurements grow."""
        assert target.seen is not None
        due = max((n for n in ASKED_AT if n <= len(target.taken)), default=0)
        if not due or due in target.asked or not (self._earlier or target.joined):
            return
        target.asked.add(due)
        now = tracklet_orbit(target.seen, self._config.orbit.prior)
        if now is None:
            return
        if target.joined is not None:
            if self._same(target.joined, now) < PARTED_BELOW:
                self._earlier.append(target.joined)
                target.before, target.joined, target.orbit = (), None, None
                target.sought_from = 0
                target.words.append("it is not what was followed before, after all")
            return
        for earlier in reversed(self._earlier):
            probability = self._same(earlier, now)
            if probability >= JOINED_FROM:
                self._earlier.remove(earlier)
                target.joined, target.before, target.orbit = earlier, earlier.parts, earlier.orbit
                target.sought_from = 0
                share = "more than 99.9" if probability > 0.999 else f"{100.0 * probability:.1f}"
                target.words.append(f"it is what was followed before: probability {share} %")
                return

    def _same(self, earlier: _Target, now: TrackletOrbit) -> float:
        """Return the probability that both are the same object."""
        parts = earlier.parts
        if earlier.first is None:
            earlier.first = tracklet_orbit(parts[0], self._config.orbit.prior)
        if earlier.first is None:
            return 0.0
        return probability_from_log_odds(log_odds_of_joining(earlier.first, parts[1:], now))

    def _determined(self, target: _Target, seen: MeasuredDirections) -> Orbit | None:
        start: State | None = None
        if target.orbit is not None:
            r, v = target.orbit.states(np.array([seen.epoch_utc_ns]))
            start = (r[0], v[0]) if np.all(np.isfinite(r)) else None
        is_sought = len(seen) >= target.sought_from
        if start is None and not is_sought:
            return None
        with np.errstate(all="ignore"):
            found = determine_orbit(
                seen, prior=self._config.orbit.prior, start=start, tries_seeds=is_sought
            )
        if found is not None and not found.is_astray:
            target.sought_from = 0
        elif is_sought:
            target.sought_from = math.ceil(_MORE_TO_SEEK * len(seen))
        if found is None:
            return None
        numbers = (found.r_km, found.v_km_s, found.covariance, found.sigma_a_km, found.rms_arcsec)
        return found if all(np.all(np.isfinite(each)) for each in numbers) else None

    def _by_filter(self, track: Track) -> Score | None:
        """Return the filter's score for the last measurement; None where it has none."""
        if track.last.nis is None or track.predicted is None:
            return None
        settings, measured = self._config.filter, track.measurements[-1]
        try:
            log_size = estimator.log_det_innovation(track.predicted, measured, settings)
        except ValueError:
            return None
        return Score(nis=track.last.nis, log_size=log_size)

    def _estimate(
        self,
        target: _Target,
        track: Track,
        orbit: Orbit,
        seen: MeasuredDirections,
        predicted: OrbitInnovation | None,
    ) -> OrbitEstimate:
        return OrbitEstimate(
            **orbit_record_fields(orbit),
            frame_id=track.last.frame_id,
            track_id=track.track_id,
            reason=orbit.reason,
            observations=orbit.observations,
            arc_s=float(seen.t_s[-1] - seen.t_s[0]),
            outliers=orbit.outliers,
            nis=None if predicted is None else predicted.score.nis,
            innovation_arcsec=None if predicted is None else predicted.innovation_arcsec,
            sigma_innovation_arcsec=None if predicted is None else predicted.sigma_arcsec,
            is_guide=self._guides(target),
        )


def _with_errors_of(target: _Target) -> tuple[Measurement, ...]:
    """Return the claimed measurements with the errors that the track has learned."""
    alike = adaptive.with_learned_errors
    # Each moves as to the track's first measurement that is of another instant.
    first = target.taken[0]
    return tuple(alike((m, first), *target.learnt)[0] for m in target.more)


def _learnt(state: TrackState) -> tuple[float, float]:
    """Return scatter (s) and variance_scale, as preset ``adaptive`` has learned them."""
    said = state.mixture
    return (0.0, 1.0) if said is None else (said.scatter_s, said.variance_scale)


def _news(target: _Target, estimate: OrbitEstimate) -> Sequence[str]:
    if estimate.label == target.label:
        return ()
    target.label = estimate.label
    return (
        f"orbit: {estimate.label}, {semi_major_axis_words(estimate.a_km, estimate.sigma_a_km)},"
        f" {estimate.observations} in {duration_words(estimate.arc_s)}",
    )
