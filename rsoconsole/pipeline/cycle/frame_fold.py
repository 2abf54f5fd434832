"""What is followed after a frame, from what is on record alone. Pure: no pixels, no memory."""

import functools
import math
import statistics
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from statistics import fmean
from typing import Any

from rsoconsole.base import FrameError
from rsoconsole.config import Config
from rsoconsole.orbits import bending, orbit_from_record, predict_motion
from rsoconsole.pipeline.cycle.miss_reasons import (
    StarHistory,
    explain_absence,
    stars_of,
    updated_star_history,
)
from rsoconsole.pipeline.frame.measurement import (
    at_its_row,
    calibrated_for,
    shutter_mid_utc_ns,
    shutter_time,
)
from rsoconsole.pipeline.frame.reduce import plain_absence
from rsoconsole.records import (
    Detections,
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

ROUNDING = 1e-7
"""Relative; a fold's own digits agree to 1e-12 after a night, a setting changes the third."""
_DIRECTION_DEG = 1e-9
"""Four millionths of an arcsecond, below what any record can mean."""


def are_alike(ours: Sequence[Any], theirs: Sequence[Any]) -> bool:
    """Whether two lists of records agree, but for what a processor's rounding may change."""
    return len(ours) == len(theirs) and all(map(is_alike, ours, theirs))


def is_alike(one: Any, other: Any) -> bool:
    """Whether two records, or values within them, agree but for rounding."""
    if one == other:
        return True
    if type(one) is not type(other):
        return False
    if isinstance(one, TrackState):
        return _is_same_track(one, other)
    if is_dataclass(one):
        names = (field.name for field in fields(one))
        return all(is_alike(getattr(one, name), getattr(other, name)) for name in names)
    if isinstance(one, tuple):
        return are_alike(one, other)
    return isinstance(one, float) and math.isclose(one, other, rel_tol=ROUNDING)


def _is_same_track(one: TrackState, other: TrackState) -> bool:
    """Places to less than anybody can measure, covariances in units of their own diagonal."""
    plain = (f.name for f in fields(one) if f.name not in {"x", "P", "innovation_arcsec"})
    if not all(is_alike(getattr(one, name), getattr(other, name)) for name in plain):
        return False
    sigma = [math.sqrt(one.P[n][n]) for n in range(4)]
    largest = max(_DIRECTION_DEG, ROUNDING * max(sigma))
    if any(abs(a - b) > largest for a, b in zip(one.x, other.x, strict=True)):
        return False
    if (one.innovation_arcsec is None) != (other.innovation_arcsec is None):
        return False
    innovations = zip(one.innovation_arcsec or (), other.innovation_arcsec or (), strict=True)
    if any(abs(a - b) > largest * 3600.0 for a, b in innovations):
        return False
    return all(
        abs(one.P[i][j] - other.P[i][j]) <= ROUNDING * sigma[i] * sigma[j]
        for i in range(4)
        for j in range(4)
    )


WINDOW = 8
_LEAST = 5
"""Measurements that both must have predicted."""
_AHEAD = 0.5
"""By so much better on the mean before the guide changes, so that it does not change for chance."""
_CLOSE = 0.1
"""A turn between two that promise the same but for such a share is no news."""
_BELIEVED = 0.999
"""An orbit whose NIS are this unlikely is not believed, however the filter fares."""


def may_guide(config: Config) -> bool:
    """Whether an orbit may say where the telescope goes, and carry on a track.

    Preset ``paper`` is the paper's whole loop: its filter alone leads it.
    """
    return config.orbit.guide == "when better" and config.filter.preset != "paper"


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """What one of them said of one measurement."""

    nis: float
    log_size: float
    """Logarithm of the determinant of the innovation's covariance, arcsec."""

    @property
    def width_arcsec(self) -> float:
        """One sigma that it had stated: the geometric mean of both axes."""
        return math.exp(self.log_size / 4.0)

    @property
    def score(self) -> float:
        """Smaller is better: minus twice the logarithm of the density, but for a constant."""
        return self.nis + self.log_size


class Rivals:
    """The last answers of both."""

    def __init__(self) -> None:
        self._scores: deque[tuple[Score, Score]] = deque(maxlen=WINDOW)
        self.is_orbit_ahead = False
        """Whether the orbit predicts better."""
        self._failed = ""
        """By how much the filter failed last; empty: not known."""

    def compare(self, by_orbit: Score, by_filter: Score) -> None:
        """One measurement that both predicted."""
        self._scores.append((by_orbit, by_filter))
        if len(self._scores) >= _LEAST:
            lead = fmean(theirs.score - ours.score for ours, theirs in self._scores)
            is_better = lead > (0.0 if self.is_orbit_ahead else _AHEAD)
            self.is_orbit_ahead = is_better and self._is_believed()

    def filter_failed(self, nis: float | None = None, gate_nis: float | None = None) -> None:
        """The orbit predicted what the filter did not: the NIS of the measurement by the latter."""
        self._scores.clear()
        self.is_orbit_ahead = True
        known = nis is not None and gate_nis is not None
        self._failed = f": NIS {nis:.1f} by that, gate {gate_nis:.1f}" if known else ""

    @property
    def is_close(self) -> bool:
        """Whether the widths that both promise come to the same: within a tenth, or as written."""
        if not self._scores:
            return False
        ours, theirs = (fmean(each[n].width_arcsec for each in self._scores) for n in (0, 1))
        return abs(ours - theirs) < _CLOSE * max(ours, theirs) or f"{ours:.1f}" == f"{theirs:.1f}"

    @property
    def words(self) -> str:
        """How both have predicted the last measurements."""
        if not self._scores:
            return f"what was seen does not fit the filter's prediction{self._failed}"
        ours, theirs = zip(*self._scores, strict=True)
        which = "it has predicted better" if self.is_orbit_ahead else "the orbit predicts no better"
        return f"{which} (orbit {_fared(ours)}, filter {_fared(theirs)})"

    def _is_believed(self) -> bool:
        from scipy.special import chdtr

        total = sum(ours.nis for ours, _ in self._scores)
        return bool(chdtr(2 * len(self._scores), total) < _BELIEVED)


def _fared(scores: Sequence[Score]) -> str:
    width = fmean(each.width_arcsec for each in scores)
    return f"±{width:.1f}″, NIS {fmean(each.nis for each in scores):.1f}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """What a frame showed, as the record has it."""

    taken: FrameTaken
    detections: Detections
    solution: Solution | NotSolved | None
    measurements: tuple[Measurement, ...]
    decision: Ruling | None = None
    """The operator's word on them."""
    decisions: int = 0
    """How many words have been said on them."""
    orbits: Mapping[int, OrbitEstimate] = field(default_factory=dict)
    """The last orbit of each track on record when the frame came, by track id."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Folded:
    """What is known after a frame."""

    following: Following
    stars: StarHistory
    records: tuple[Record, ...]
    """What the fold puts on record, in order."""


def fold(before: Following, stars_before: StarHistory, shown: Shown, config: Config) -> Folded:
    """What is followed after a frame. Pure. Raises FrameError for a frame without a time."""
    taken = shown.taken
    t_mid_ns, exposure_s = mid_exposure(taken, config)
    stars = stars_of(taken, shown.detections)
    plain = Missed(kind="nothing fits")
    if not shown.measurements:
        plain = plain_absence(shown.detections, shown.solution, t_mid_ns)
    elif all(m.is_crossing for m in shown.measurements):
        plain = ONLY_CROSSING
    # Asked for by misses alone: the Sun and the Earth's shadow cost more than all the rest.
    absence = functools.partial(
        explain_absence,
        plain,
        stars=stars,
        stars_before=stars_before,
        track=before.track,
        site=config.site.to_site(),
        t_utc_ns=t_mid_ns,
        blocked=taken.blocked,
    )
    decision = shown.decision or Ruling(frame_id=taken.frame_id)
    shutter = shutter_time(taken, config.exposure)
    refused = tuple(at_its_row(m, t_mid_ns, shutter) for m in decision.refused)
    chosen = decision.taken and at_its_row(decision.taken, t_mid_ns, shutter)
    # The decision's own instant is the recorded one: another where its latency is tried.
    measurements = tuple(m for m in shown.measurements if m not in refused)
    if chosen is not None and chosen not in measurements:
        measurements = (*measurements, chosen)
    seen = FrameInput(
        frame_id=taken.frame_id,
        t_mid_utc_ns=t_mid_ns,
        exposure_s=exposure_s,
        measurements=measurements,
        absence=absence,
        field=_field_of(shown),
        star_width_arcsec=_width_arcsec(shown),
        chosen=chosen,
        refused=refused,
        dropped=decision.dropped,
        kept=decision.kept,
        released=decision.released,
        by_orbit=_asks_orbit(before, shown.orbits, config, t_mid_ns),
    )
    after, records = follow(before, seen, follow_settings(config, taken))
    return Folded(
        following=after,
        stars=updated_star_history(stars_before, stars, shown.solution),
        records=records,
    )


def _width_arcsec(shown: Shown) -> float | None:
    """Of the frame's stars, where they and its scale are known; of its streaks, if narrower.

    Stars that drift while the shutter is open are wider than what shows two satellites apart.
    """
    width_px = None if shown.detections is None else shown.detections.star_fwhm_px
    if width_px is None or not isinstance(shown.solution, Solution):
        return None
    streaks_px = [d.width_px for d in shown.detections.detections if d.kind == "streak"]
    if streaks_px:
        width_px = min(width_px, statistics.median(streaks_px))
    return width_px * shown.solution.scale_arcsec_px


def _asks_orbit(
    before: Following, orbits: Mapping[int, OrbitEstimate], config: Config, t_mid_ns: int
) -> Callable[[TrackState], TrackState | None] | None:
    """Where the orbit of this very track may speak for a filter that fails."""
    if not may_guide(config):
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
    """What the track's orbit predicts, if it is surer than the field is wide."""
    orbit = orbits.get(failed.track_id)
    if orbit is None:
        return None
    motion = predict_motion(orbit_from_record(orbit), config.site.to_site(), t_mid_ns)
    if motion is None:
        return None
    state = estimator.restarted_from(
        (motion.ra_icrs_deg, motion.dec_icrs_deg),
        motion.rate_arcsec_s,
        motion.covariance,
        t_mid_ns,
        failed,
        config.filter,
    )
    widest_deg = min(min(config.optics.field_deg) / 2.0, config.filter.max_3sigma_arcmin / 60.0)
    return state if three_sigma_deg(state) <= widest_deg else None


def _field_of(shown: Shown) -> Field | None:
    if not isinstance(shown.solution, Solution):
        return None
    size = (shown.taken.width_px, shown.taken.height_px)
    return Field(wcs=shown.solution.wcs, width_px=size[0], height_px=size[1])


def mid_exposure(taken: FrameTaken, config: Config) -> tuple[int, float]:
    """Mid-exposure by the shutter, and the exposure's length. Raises FrameError without a time."""
    t_mid_ns = shutter_mid_utc_ns(taken, config.exposure)
    if t_mid_ns is None or taken.exposure_s is None:
        raise FrameError(
            f"{taken.name} has no DATE-OBS or EXPTIME: it can be detected and solved,"
            " not followed; have the camera's driver write them"
        )
    return t_mid_ns, taken.exposure_s


def star_history_without_fold(stars_before: StarHistory, shown: Shown) -> StarHistory:
    """The stars known after a frame that is not followed."""
    if shown.taken.exposure_s is None:
        return stars_before
    return updated_star_history(
        stars_before, stars_of(shown.taken, shown.detections), shown.solution
    )


def follow_settings(config: Config, frame: Frame | FrameTaken) -> FollowSettings:
    """The fold's settings for a frame of this size."""
    half_field_px = min(frame.width_px, frame.height_px) / 2.0
    return FollowSettings(
        filter=config.filter,
        half_field_deg=half_field_px * config.optics.scale_arcsec_px / 3600.0,
        choice=config.search.follow,
        bend=functools.partial(bending, config.site.to_site()),
        is_shutter_known=calibrated_for(frame, config.exposure) is not None,
    )
