"""How well a night was followed, in figures: as recorded, and as with other settings. Pure."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from rsoconsole.config import Config
from rsoconsole.pipeline.replay import ReplayedFrame, replay
from rsoconsole.records import Miss, TrackState
from rsoconsole.tracking.consistency import mean_band


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackFigures:
    """Of the frames looked at; None where there is nothing to reckon with."""

    frames: int
    updates: int
    misses: int
    residual_rms_arcsec: float | None
    """Of measured minus predicted, both axes together."""
    nis_mean: float | None
    """2 for a sound filter."""
    nis_band: tuple[float, float] | None
    """Within which that mean lies for a sound filter, 95 times in 100."""
    inside_3sigma: float | None
    """Share of updates whose residual lies within 3 sigma on both axes; 0.995 for a sound one."""
    state: str
    """After the last frame."""

    @property
    def is_nis_sound(self) -> bool | None:
        """Whether the mean NIS lies in its band."""
        if self.nis_mean is None or self.nis_band is None:
            return None
        return self.nis_band[0] <= self.nis_mean <= self.nis_band[1]


def figures_of(frames: Iterable[ReplayedFrame], last: int | None = None) -> TrackFigures:
    """Figures of the last so many frames, of all with None; a frame followed again counts once."""
    by_number: dict[int, ReplayedFrame] = {}
    for each in frames:
        by_number.pop(each.taken.frame_id, None)
        by_number[each.taken.frame_id] = each
    chosen = [by_number[number] for number in sorted(by_number)]
    chosen = chosen if last is None else chosen[-last:]
    records = [record for each in chosen for record in each.records]
    updates = [r for r in records if isinstance(r, TrackState) and r.innovation_arcsec is not None]
    squares = [e**2 + n**2 for e, n in (u.innovation_arcsec or (0.0, 0.0) for u in updates)]
    nis = [u.nis for u in updates if u.nis is not None]
    inside = [_is_inside(u) for u in updates]
    return TrackFigures(
        frames=len(chosen),
        updates=len(updates),
        misses=sum(isinstance(record, Miss) for record in records),
        residual_rms_arcsec=math.sqrt(sum(squares) / len(squares)) if squares else None,
        nis_mean=sum(nis) / len(nis) if nis else None,
        nis_band=mean_band(len(nis)) if nis else None,
        inside_3sigma=sum(inside) / len(inside) if inside else None,
        state=chosen[-1].after.state if chosen else "",
    )


def what_if(
    records: Iterable[Any],
    config: Config,
    tried: Mapping[str, float | str],
    last: int | None = None,
) -> TrackFigures:
    """The same night with other settings. Raises ConfigError for one that cannot be."""
    return figures_of(replay(records, config, tried=tried), last)


def _is_inside(update: TrackState) -> bool:
    residual, sigma = update.innovation_arcsec, update.sigma_innovation_arcsec
    assert residual is not None
    if sigma is None:
        return False
    return all(abs(r) <= 3.0 * s for r, s in zip(residual, sigma, strict=True))
