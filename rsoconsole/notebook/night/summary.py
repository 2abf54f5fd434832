"""How a session went, in a handful of figures: for its card, beside what-if."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rsoconsole.notebook.night.night import Night, NightFrame
from rsoconsole.records import StateChange
from rsoconsole.tracking.filters import mean_band


@dataclass(frozen=True, slots=True, kw_only=True)
class Spell:
    """For how long the loop was in one state."""

    state: str
    t_from_utc_ns: int
    t_to_utc_ns: int

    @property
    def seconds(self) -> float:
        """Its length."""
        return (self.t_to_utc_ns - self.t_from_utc_ns) / 1e9


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """A night at a glance; None where there is nothing to go by."""

    frames: int
    followed: int
    """Frames in which the track took a measurement."""
    missed: int
    locked_after_frames: int | None
    """How many frames it took to TRACK; None where it never came to that."""
    residual_rms_arcsec: float | None
    """Of measured minus predicted, both axes together."""
    nis_mean: float | None
    """2 for a sound filter."""
    nis_band: tuple[float, float] | None
    """Within which that mean lies for a sound filter, 95 times in 100."""
    inside_3sigma: float | None
    """Share of updates with both residuals within 3 sigma."""

    @property
    def is_nis_sound(self) -> bool | None:
        """Whether the mean NIS lies in its band."""
        if self.nis_mean is None or self.nis_band is None:
            return None
        return self.nis_band[0] <= self.nis_mean <= self.nis_band[1]


def summary_of(night: Night, changes: Iterable[StateChange]) -> Summary:
    """The figures of a night, frames without a time left out."""
    frames = night.frames
    squares = [e**2 + n**2 for e, n in _residuals(frames)]
    nis = [f.corrected.nis for f in frames if f.corrected and f.corrected.nis is not None]
    inside = [_is_inside(f) for f in frames if f.corrected and f.corrected.innovation_arcsec]
    first = next((c.frame_id for c in changes if c.after == "TRACK"), None)
    return Summary(
        frames=len(frames),
        followed=sum(f.corrected is not None for f in frames),
        missed=sum(f.missed is not None for f in frames),
        locked_after_frames=None if first is None else sum(f.frame_id <= first for f in frames),
        residual_rms_arcsec=math.sqrt(math.fsum(squares) / len(squares)) if squares else None,
        nis_mean=math.fsum(nis) / len(nis) if nis else None,
        nis_band=mean_band(len(nis)) if nis else None,
        inside_3sigma=sum(inside) / len(inside) if inside else None,
    )


def spells_of(log: Sequence[tuple[int, int, Any]]) -> tuple[Spell, ...]:
    """The states one after another, from the first record to the last."""
    if not log:
        return ()
    t_last = max(t for _, t, _ in log)
    spells: list[Spell] = []
    for _, t_utc_ns, record in log:
        if not isinstance(record, StateChange):
            continue
        if spells:
            spells[-1] = replace(spells[-1], t_to_utc_ns=t_utc_ns)
        elif t_utc_ns > log[0][1]:
            before = Spell(state=record.before, t_from_utc_ns=log[0][1], t_to_utc_ns=t_utc_ns)
            spells.append(before)
        spells.append(Spell(state=record.after, t_from_utc_ns=t_utc_ns, t_to_utc_ns=t_last))
    return tuple(spells)


def _residuals(frames: Iterable[NightFrame]) -> list[tuple[float, float]]:
    states = (frame.corrected for frame in frames)
    return [s.innovation_arcsec for s in states if s is not None and s.innovation_arcsec]


def _is_inside(frame: NightFrame) -> bool:
    state = frame.corrected
    assert state is not None
    if state.innovation_arcsec is None or state.sigma_innovation_arcsec is None:
        return False
    pairs = zip(state.innovation_arcsec, state.sigma_innovation_arcsec, strict=True)
    return all(abs(residual) <= 3.0 * sigma for residual, sigma in pairs)
