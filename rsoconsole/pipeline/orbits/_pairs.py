"""Records of the relative motion of a field's tracks, made after each frame."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Literal

import numpy as np

from rsoconsole.config import Config
from rsoconsole.records import (
    FOLLOWING,
    Event,
    FloatArray,
    FollowedAgain,
    FrameTaken,
    Measurement,
    Miss,
    PairMotion,
    PairMotions,
    Record,
    StateChange,
    TrackState,
)
from rsoconsole.sky import direction_to_unit
from rsoconsole.tracking import (
    MANY,
    RelativePath,
    TrackDirections,
    pair_motion,
    relative_path,
    relative_positions,
    single_streak_covariance,
)
from rsoconsole.tracking.filters import lqe
from rsoconsole.words import NS_PER_S, approach_words, separation_words, tracks_words, utc_text

Message = tuple[Literal["info", "warning"], str]
LIKELY, UNLIKELY = 0.5, 0.2
CLEAR_SHARE = 1.2
"""Factor on the warning's angle beyond which the warning about a pair ends."""


class ApproachWarnings:
    """Pairs of tracks that are close or approach each other, with a warning about each."""

    def __init__(self) -> None:
        self._open: dict[tuple[int, int], tuple[float, int]] = {}
        """Least separation so far, arcsec, and its instant, by pair."""

    def update(
        self,
        pairs: Sequence[PairMotion],
        alive: Collection[int],
        t_utc_ns: int | None,
        limit_arcsec: float,
    ) -> tuple[Collection[tuple[int, int]], Sequence[Message]]:
        """Update the warnings after a frame; return (pairs with a warning, new messages).

        ``pairs``: motions examined in the frame; ``alive``: ids of the present tracks;
        ``t_utc_ns``: mid-exposure; None: no motion is examined; ``limit_arcsec``: separation below
        which a warning is given. The start and the end of a warning have one message each.
        """
        words: list[Message] = []
        for pair in [each for each in self._open if not set(alive).issuperset(each)]:
            del self._open[pair]
            gone = " and ".join(str(n) for n in pair if n not in alive)
            words.append(("info", f"{tracks_words(pair)}: warning over, track {gone} ended"))
        for each in pairs:
            if t_utc_ns is None:
                break
            pair = (each.track_id, each.other_track_id)
            known = self._open.get(pair)
            if known is None:
                if _is_close(each, limit_arcsec):
                    self._open[pair] = (each.separation_arcsec, t_utc_ns)
                    warning = f"{separation_words(each)} apart, {approach_words(each)}"
                    words.append(("warning", f"{tracks_words(pair)}: {warning}"))
                continue
            known = self._open[pair] = min(known, (each.separation_arcsec, t_utc_ns))
            if _is_clear(each, limit_arcsec):
                del self._open[pair]
                words.append(("info", f"{tracks_words(pair)}: {_end(each, known, limit_arcsec)}"))
        return frozenset(self._open), words


def _is_close(pair: PairMotion, limit_arcsec: float) -> bool:
    is_near = pair.separation_arcsec < limit_arcsec
    return is_near or (limit_arcsec > 0.0 and pair.close_probability >= LIKELY)


def _is_clear(pair: PairMotion, limit_arcsec: float) -> bool:
    is_apart = pair.separation_arcsec > CLEAR_SHARE * limit_arcsec
    return is_apart and (pair.close_probability <= UNLIKELY or limit_arcsec == 0.0)


def _end(pair: PairMotion, nearest: tuple[float, int], limit_arcsec: float) -> str:
    nearest_arcsec, when = nearest[0], utc_text(nearest[1], "minute")
    if limit_arcsec == 0.0:
        return "warning over, alert.separation_arcsec is 0"
    if nearest_arcsec < limit_arcsec:
        return f"passed, nearest {nearest_arcsec:.1f}″ at {when}"
    if pair.closest == "now":
        return f"warning over, they part: nearest {nearest_arcsec:.1f}″ at {when}"
    return f"warning over, closest approach now {pair.closest_arcsec:.0f}″"


MAX_FRAMES = 400
"""Largest number of a track's measurements that are compared, the latest."""
MAX_PAIRS, PAIRS_OF_MANY = 6, 3
"""Most pairs examined in each frame: at first, and with more than ``MANY`` tracks."""
_NEAR_SOONER = 4.0
"""Factor by which a near pair comes round sooner than others."""
_RECENT_FRAMES = 40
"""Number of frames whose measurements are kept by id: a track may begin with an earlier one."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Sight:
    """Direction of a track in one frame."""

    t_utc_ns: int
    unit: FloatArray
    cov_sky_arcsec2: tuple[float, float, float]
    rate_arcsec_s: tuple[float, float]


@dataclass(slots=True)
class _TrackSights:
    """Directions of one track."""

    sights: dict[int, _Sight] = field(default_factory=dict)
    together: TrackDirections | None = None
    """Directions as arrays, made when first needed."""

    def put(self, frame_id: int, sight: _Sight) -> None:
        self.sights[frame_id] = sight
        if len(self.sights) > MAX_FRAMES:
            del self.sights[min(self.sights)]
        self.together = None

    def as_sights(self) -> TrackDirections:
        if self.together is None:
            frames = sorted(self.sights)
            each = [self.sights[number] for number in frames]
            self.together = TrackDirections(
                frame_id=np.array(frames, np.int64),
                t_utc_ns=np.array([one.t_utc_ns for one in each], np.int64),
                units=np.array([one.unit for one in each]).reshape(-1, 3),
                cov_sky_arcsec2=np.array([one.cov_sky_arcsec2 for one in each]).reshape(-1, 3),
                rate_arcsec_s=np.array([one.rate_arcsec_s for one in each]).reshape(-1, 2),
            )
        return self.together


class TrackPairs:
    """Relative motion of the tracks, from the records alone: the same log gives the same pairs."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._tracks: dict[int, _TrackSights] = {}
        self._measured: dict[str, Measurement] = {}
        self._frame_id = 0
        self._t_utc_ns: int | None = None
        self._alive: list[int] = []
        self._paths: dict[tuple[int, int], tuple[int, RelativePath]] = {}
        """Relative path of each pair, with the last frame that showed both."""
        self._approaches = ApproachWarnings()
        self._known: dict[tuple[int, int], PairMotion] = {}
        self.last: tuple[PairMotion, ...] = ()
        """Motions of ``_known`` in order; replaced, never changed, as other threads read it."""

    def configure(self, config: Config) -> None:
        """Use the settings of ``config`` from now on."""
        self._config = config

    def forget(self) -> None:
        """Forget all directions and warnings: the clock was wrong until now."""
        self._tracks, self._measured, self._paths, self._known = {}, {}, {}, {}
        self.last = ()
        self._alive, self._t_utc_ns = [], None
        self._approaches = ApproachWarnings()

    def receive(self, record: Record) -> None:
        """Process the next record of the log."""
        if isinstance(record, FrameTaken):
            self._begin(record.frame_id)
        elif isinstance(record, FollowedAgain):
            self._begin(record.frame_id)
            for seen in self._tracks.values():
                if seen.sights.pop(record.frame_id, None) is not None:
                    seen.together = None
            self._paths.clear()
        elif isinstance(record, Measurement):
            self._measured[record.measurement_id] = record
        elif isinstance(record, TrackState):
            self._receive_state(record)
        elif isinstance(record, StateChange):
            if record.after not in FOLLOWING:
                self._alive, self.last = [], ()
        elif isinstance(record, Miss) and record.reason.lost is not None:
            self._alive = [each for each in self._alive if each != record.track_id]

    def _begin(self, frame_id: int) -> None:
        self._frame_id, self._alive, self._t_utc_ns = frame_id, [], None
        oldest = frame_id - _RECENT_FRAMES
        if any(m.frame_id < oldest for m in self._measured.values()):
            recent = {n: m for n, m in self._measured.items() if m.frame_id >= oldest}
            self._measured = recent

    def _receive_state(self, state: TrackState) -> None:
        number = state.track_id
        if state.kind == "initial" and state.is_lead:
            # A lead that was only predicted where another begins has been given up for it.
            self._alive = [each for each in self._alive if self._is_seen(each)]
        if number not in self._alive:
            self._alive.append(number)
        if self._t_utc_ns is None or state.is_lead:
            self._t_utc_ns = state.t_utc_ns
        taken = [*(state.begun_with or ())[:1], state.measurement_id]
        for m in (self._measured.get(each) for each in taken if each is not None):
            if m is not None and not m.is_crossing and not m.is_clipped:
                self._tracks.setdefault(number, _TrackSights()).put(m.frame_id, _sight(m, state))

    def _is_seen(self, track_id: int) -> bool:
        seen = self._tracks.get(track_id)
        return seen is not None and self._frame_id in seen.sights

    def derive_frame_records(self) -> tuple[Record, ...]:
        """Return the new records after a frame: PairMotions, and events about approaches."""
        alive = set(self._alive)
        self._tracks = {n: each for n, each in self._tracks.items() if n in alive}
        self._paths = {pair: each for pair, each in self._paths.items() if alive.issuperset(pair)}
        known = {pair: each for pair, each in self._known.items() if alive.issuperset(pair)}
        pairs, t_utc_ns = self._looked_at(known), self._t_utc_ns
        limit = self._config.alert.separation_arcsec
        close, words = self._approaches.update(pairs, self._alive, t_utc_ns, limit)
        marked = tuple(replace(each, is_close=_ids(each) in close) for each in pairs)
        self._known = known | {_ids(each): each for each in marked}
        self.last = tuple(self._known[pair] for pair in sorted(self._known))
        frame_id = self._frame_id
        events = tuple(
            Event(level=level, text=text, frame_id=frame_id, topic="approach")
            for level, text in words
        )
        return (PairMotions(frame_id=frame_id, pairs=marked), *events) if marked else events

    @property
    def _most(self) -> int:
        return MAX_PAIRS if len(self._alive) <= MANY else PAIRS_OF_MANY

    def _looked_at(self, known: Mapping[tuple[int, int], PairMotion]) -> Sequence[PairMotion]:
        """Motions of the pairs examined in this frame: those of a warning, the others in turn."""
        if self._t_utc_ns is None:
            return ()
        alert = self._config.alert
        found: list[PairMotion] = []
        most = self._most
        for one, other in self._in_turn(known):
            path = self._path(one, other, self._tracks)
            if path is None or self._t_utc_ns - path.t_utc_ns > path.horizon_s * 0.5e9:
                continue  # nothing that showed both is recent enough
            found.append(
                pair_motion(
                    (one, other),
                    path,
                    self._t_utc_ns,
                    warned_arcsec=alert.separation_arcsec,
                    warned_ahead_s=60.0 * alert.ahead_min,
                )
            )
            if len(found) == most:
                break
        return sorted(found, key=_ids)

    def _in_turn(self, known: Mapping[tuple[int, int], PairMotion]) -> list[tuple[int, int]]:
        """All pairs in order: some with a warning, half at most, then by time since examined.

        Each track's nearest pairs come round sooner than the others.
        """
        last = self._t_utc_ns or 0
        warned = [each for each in known.values() if each.is_close]
        warned = sorted(warned, key=lambda each: each.t_utc_ns)[: self._most // 2]
        first = {_ids(each) for each in warned}
        near: set[tuple[int, int]] = set()
        for number in self._alive:
            own = (each for pair, each in known.items() if number in pair)
            nearest = min(own, key=lambda each: each.separation_arcsec, default=None)
            near |= set() if nearest is None else {_ids(nearest)}

        def due(pair: tuple[int, int]) -> tuple[bool, float, tuple[int, int]]:
            seen = known.get(pair)
            age_s = math.inf if seen is None else (last - seen.t_utc_ns) / NS_PER_S
            return pair not in first, -age_s * (_NEAR_SOONER if pair in near else 1.0), pair

        return sorted(combinations(sorted(self._alive), 2), key=due)

    def _path(
        self, one: int, other: int, tracks: Mapping[int, _TrackSights]
    ) -> RelativePath | None:
        if one not in tracks or other not in tracks:
            return None
        last = max(tracks[one].sights.keys() & tracks[other].sights.keys(), default=None)
        known = self._paths.get((one, other))
        if known is not None and known[0] == last:
            return known[1]
        ways = relative_positions(tracks[one].as_sights(), tracks[other].as_sights())
        if ways is None or last is None:
            return None
        path = relative_path(ways)
        self._paths[one, other] = (last, path)
        return path


def _ids(pair: PairMotion) -> tuple[int, int]:
    return pair.track_id, pair.other_track_id


def _sight(m: Measurement, state: TrackState) -> _Sight:
    (ee, en), (_, nn) = single_streak_covariance(m, state)
    return _Sight(
        t_utc_ns=m.t_mid_utc_ns,
        unit=direction_to_unit(m.ra_icrs_deg, m.dec_icrs_deg),
        cov_sky_arcsec2=(float(ee), float(en), float(nn)),
        rate_arcsec_s=lqe.sky_rate_arcsec_s(state),
    )
