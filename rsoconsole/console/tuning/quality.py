"""How good the lead's track is over its last frames, by the tuning pane's figures. Pure."""

import math
from dataclasses import dataclass

from rsoconsole.console.tuning.tuning_pane import LAST_FRAMES, NAMES
from rsoconsole.night import FrameRow, NightView
from rsoconsole.tracking.filters import lag_one, mean_band


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackQuality:
    """Of the frames in which it was looked for."""

    frames: int
    misses: int
    residual_rms_arcsec: float
    """Both axes together."""
    nis_mean: float
    """2 for a sound filter."""
    nis_band: tuple[float, float]
    """Within which that mean lies for a sound filter, 95 times in 100."""
    inside_3sigma: float
    """Share of the residuals that lie within 3 sigma on both axes."""
    measured: int
    """Of the frames those that have a residual and a NIS."""
    lag_one: float | None
    """Correlation of each residual, in its sigmas, with the next: None where there are too few."""

    @property
    def lag_one_bound(self) -> float:
        """Within which that lies for a sound filter, 95 times in 100."""
        return 2.0 / math.sqrt(self.measured)

    @property
    def is_sound(self) -> bool:
        """Whether the mean NIS lies in its band."""
        return self.nis_band[0] <= self.nis_mean <= self.nis_band[1]


def track_quality(night: NightView, last: int = LAST_FRAMES) -> TrackQuality | None:
    """Of the lead's last frames; None before it has been measured against a prediction."""
    rows = frames_of_track(night, last)
    measured = [
        (row.residual_arcsec, row.sigma_arcsec, row.nis)
        for row in rows
        if row.residual_arcsec is not None and row.nis is not None
    ]
    if night.track is None or not measured:
        return None
    nis = [value for _, _, value in measured]
    squares = [east**2 + north**2 for (east, north), _, _ in measured]
    inside = [
        sigma is not None and all(abs(r) <= 3.0 * s for r, s in zip(residual, sigma, strict=True))
        for residual, sigma, _ in measured
    ]
    return TrackQuality(
        frames=len(rows),
        misses=sum(row.miss is not None for row in rows),
        residual_rms_arcsec=math.sqrt(sum(squares) / len(squares)),
        nis_mean=sum(nis) / len(nis),
        nis_band=mean_band(len(nis)),
        inside_3sigma=sum(inside) / len(inside),
        measured=len(measured),
        lag_one=lag_one(
            [
                (residual[0] / sigma[0], residual[1] / sigma[1])
                for residual, sigma, _ in measured
                if sigma is not None and min(sigma) > 0.0
            ]
        ),
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
