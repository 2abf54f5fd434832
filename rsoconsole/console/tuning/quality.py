"""How good the lead's track is over its last frames, by the tuning pane's figures. Pure."""

import math
from dataclasses import asdict, dataclass

from rsoconsole.console.tuning.tuning_pane import LAST_FRAMES, NAMES
from rsoconsole.night import FrameRow, NightView, Quality, Update, quality_of
from rsoconsole.tracking.filters import lag_one


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackQuality(Quality):
    """Of the frames in which it was looked for."""

    frames: int
    misses: int
    lag_one: float | None
    """Correlation of each residual, in its sigmas, with the next: None where there are too few."""

    @property
    def lag_one_bound(self) -> float:
        """Within which that lies for a sound filter, 95 times in 100."""
        return 2.0 / math.sqrt(self.updates)


def track_quality(night: NightView, last: int = LAST_FRAMES) -> TrackQuality | None:
    """Of the lead's last frames; None before it has been measured against a prediction."""
    rows = frames_of_track(night, last)
    updates = [
        Update(row.residual_arcsec, row.sigma_arcsec, row.nis)
        for row in rows
        if row.residual_arcsec is not None and row.nis is not None
    ]
    if night.track is None or not updates:
        return None
    in_sigmas = [
        (each.residual_arcsec[0] / sigma[0], each.residual_arcsec[1] / sigma[1])
        for each in updates
        if (sigma := each.sigma_arcsec) is not None and min(sigma) > 0.0
    ]
    return TrackQuality(
        **asdict(quality_of(updates)),
        frames=len(rows),
        misses=sum(row.miss is not None for row in rows),
        lag_one=lag_one(in_sigmas),
    )


def frames_of_track(night: NightView, last: int = LAST_FRAMES) -> list[FrameRow]:
    """The lead's last frames: processed, and pointed at it. The tuning pane shows these."""
    first = night.track_frame_id if night.track is not None else 0
    own = (row for row in night.rows if row.frame_id >= first)
    return [row for row in own if row.was_sought and row.is_reduced][-last:]


def of_settings_now(night: NightView, last: int) -> int:
    """How many of those frames were processed with what is in force now, whenever that was."""
    now = {name: night.setting(name) for name in NAMES}
    return sum(
        all(night.setting(name, row.settings) == value for name, value in now.items())
        for row in frames_of_track(night, last)
    )
