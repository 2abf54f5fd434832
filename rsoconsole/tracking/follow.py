"""From what each frame showed to what is followed: a fold over recorded inputs.

``follow(before, seen, settings)`` is pure, so the engine, ``process``, what-if and a replay of a
session all get the same track from the same inputs, bit for bit. States and their passages are
those of the architecture page; IDLE, MANUAL and FAULT belong to who holds the mount and are set
from outside.
"""

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

from rsoconsole.config import FilterConfig
from rsoconsole.records import (
    LoopState,
    Measurement,
    Miss,
    NotFollowed,
    StateChange,
    TrackState,
)
from rsoconsole.tracking import lqe
from rsoconsole.tracking.association import Motion, disagreement, pair_disagreement

Record = Any
Choice = Literal["nearest", "most confident"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """What one frame showed."""

    frame_id: int
    t_mid_utc_ns: int
    exposure_s: float
    measurements: tuple[Measurement, ...]
    """Most confident first."""
    absence: str = "no detection"
    """Why there are none, when there are none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowSettings:
    """What the fold depends on beside its inputs."""

    filter: FilterConfig
    half_field_deg: float
    """Distance from the centre to the nearest edge of the usable field."""
    choice: Choice = "nearest"


@dataclass(frozen=True, slots=True, kw_only=True)
class Following:
    """The loop between two frames."""

    state: LoopState = "SEARCH"
    candidates: tuple[Measurement, ...] = ()
    """Measurements of the last frame, one of which may start a track."""
    track: TrackState | None = None
    """Last state of the filter: updated, or predicted to the frame that missed."""
    taken: Measurement | None = None
    """The last measurement the track took."""


def follow(
    before: Following, seen: Seen, settings: FollowSettings
) -> tuple[Following, tuple[Record, ...]]:
    """The next state, and what to put on the record, in order."""
    if before.state in ("TRACK", "COAST") and before.track is not None:
        after, records = _follow_track(before, before.track, seen, settings)
    else:
        after, records = _acquire(before, seen, settings)
    if after.state != before.state:
        change = StateChange(
            frame_id=seen.frame_id,
            before=before.state,
            after=after.state,
            reason=_reason(before, after, records, seen),
        )
        records = (*records, change)
    return after, records


def _reason(before: Following, after: Following, records: tuple[Record, ...], seen: Seen) -> str:
    if after.state == "TRACK":
        return "measured again" if before.state == "COAST" else "two frames agree on one motion"
    if after.state == "ACQUIRE":
        return f"{len(seen.measurements)} detection(s), waiting for a second frame"
    misses = [record for record in records if isinstance(record, Miss)]
    return misses[-1].reason if misses else seen.absence


def _acquire(
    before: Following, seen: Seen, settings: FollowSettings
) -> tuple[Following, tuple[Record, ...]]:
    """Two successive frames whose measurements agree on one motion start a track."""
    usable = tuple(m for m in seen.measurements if not m.is_clipped)
    clipped = tuple(
        NotFollowed(
            frame_id=seen.frame_id, measurement=m, reason="clipped by the frame: starts no track"
        )
        for m in seen.measurements
        if m.is_clipped
    )
    refused: list[Record] = []
    for second in usable:
        for first in before.candidates:
            reason = pair_disagreement(first, second, seen.exposure_s)
            if reason is None:
                track = lqe.initialise(first, second, settings.filter)
                others = tuple(
                    NotFollowed(frame_id=seen.frame_id, measurement=m, reason="another one leads")
                    for m in usable
                    if m is not second
                )
                after = Following(state="TRACK", track=track, taken=second)
                return after, (track, *others, *clipped)
            refused.append(NotFollowed(frame_id=seen.frame_id, measurement=second, reason=reason))
    state: LoopState = "ACQUIRE" if usable else "SEARCH"
    return Following(state=state, candidates=usable), (*refused, *clipped)


def _follow_track(
    before: Following, track: TrackState, seen: Seen, settings: FollowSettings
) -> tuple[Following, tuple[Record, ...]]:
    predicted = lqe.predict(track, seen.t_mid_utc_ns, settings.filter, seen.frame_id)
    expected = expected_motion(predicted, seen.exposure_s)
    refused: list[Record] = []
    fitting: list[tuple[Measurement, TrackState]] = []
    for measurement in seen.measurements:
        updated = lqe.update(predicted, measurement, settings.filter)
        nis = updated.nis or 0.0
        # The paper's rule asks for nothing but confidence.
        reason = None
        if settings.choice == "nearest":
            reason = disagreement(measurement, expected)
            if reason is None and lqe.is_gated_out(nis, settings.filter):
                reason = f"NIS {nis:.1f} above the gate {settings.filter.gate_nis:.1f}"
        if reason is None:
            fitting.append((measurement, updated))
        else:
            refused.append(
                NotFollowed(frame_id=seen.frame_id, measurement=measurement, reason=reason, nis=nis)
            )
    if fitting:
        return _take(fitting, predicted, refused, settings)
    reason = "nothing fits the prediction" if seen.measurements else seen.absence
    return _coast(before, predicted, seen, settings, (predicted, *refused), reason)


def _take(
    fitting: list[tuple[Measurement, TrackState]],
    predicted: TrackState,
    refused: list[Record],
    settings: FollowSettings,
) -> tuple[Following, tuple[Record, ...]]:
    if settings.choice == "nearest":
        chosen, updated = min(fitting, key=lambda pair: pair[1].nis or 0.0)
    else:
        chosen, updated = fitting[0]
    others = [
        NotFollowed(
            frame_id=updated.frame_id, measurement=m, reason="another one is taken", nis=state.nis
        )
        for m, state in fitting
        if m is not chosen
    ]
    after = Following(state="TRACK", track=updated, taken=chosen)
    return after, (predicted, updated, *refused, *others)


def _coast(  # noqa: PLR0917 -- one call, each argument a different thing
    before: Following,
    predicted: TrackState,
    seen: Seen,
    settings: FollowSettings,
    records: tuple[Record, ...],
    reason: str,
) -> tuple[Following, tuple[Record, ...]]:
    miss = Miss(frame_id=seen.frame_id, reason=reason)
    since_ns = predicted.t_utc_ns if before.taken is None else before.taken.t_mid_utc_ns
    coasted_s = (seen.t_mid_utc_ns - since_ns) / 1e9
    lost: str | None = None
    # The paper's bounds are wider than any field from the first prediction on and say nothing.
    bound_deg = three_sigma_deg(predicted)
    if settings.filter.preset == "tuned" and bound_deg > settings.half_field_deg:
        lost = f"3 sigma of {bound_deg * 60:.0f} arcmin no longer fits the field"
    elif coasted_s > settings.filter.max_coast_s:
        lost = f"coasted for {coasted_s / 60:.0f} min"
    if lost is not None:
        return Following(state="LOST"), (*records, replace(miss, reason=f"{reason}; {lost}"))
    after = replace(before, state="COAST", track=predicted, candidates=())
    return after, (*records, miss)


def expected_motion(track: TrackState, exposure_s: float) -> Motion:
    """Motion on the sky during one exposure at the track's rates."""
    east_arcsec_s, north_arcsec_s = lqe.sky_rate_arcsec_s(track)
    return Motion(east_arcsec_s * exposure_s, north_arcsec_s * exposure_s)


def three_sigma_deg(track: TrackState) -> float:
    """Half length of the longer side of the 3-sigma box of the state's position on the sky."""
    cos_dec = math.cos(math.radians(track.x[2]))
    return 3.0 * max(math.sqrt(track.P[0][0]) * cos_dec, math.sqrt(track.P[2][2]))
