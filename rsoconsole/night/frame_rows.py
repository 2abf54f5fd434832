"""One exposure of the night: as the plots show it, and as its picture does."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from rsoconsole.night.track_fold import FrameTrack
from rsoconsole.records import (
    Closeup,
    Detections,
    FrameTaken,
    Measurement,
    NotFollowed,
    NotSolved,
    Ruling,
    Solution,
    TrackState,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameRow:
    """One exposure, as the plots show it."""

    frame_id: int
    is_reduced: bool = False
    """False while it is not known yet what the frame shows."""
    confidence: float | None = None
    """Of the best detection above tau; None without one."""
    miss: str | None = None
    refused: tuple[float, str] | None = None
    """The likeliest streak that was not taken: its confidence, and why; None without one."""
    is_followed: bool = False
    """Whether the track took something of it."""
    residual_arcsec: tuple[float, float] | None = None
    """(d alpha cos delta, d delta), measured minus predicted; None when nothing was taken."""
    sigma_arcsec: tuple[float, float] | None = None
    """One sigma of the residual; of the prediction where nothing was taken."""
    nis: float | None = None
    fwhm_px: float | None = None
    """Of its stars."""
    star_count: int | None = None
    background_adu: float | None = None
    zero_point_mag: float | None = None
    t_utc_ns: int | None = None
    """When it began."""
    mount_icrs_deg: tuple[float, float] | None = None
    """Where the mount said it looked."""
    plate_icrs_deg: tuple[float, float] | None = None
    """Where its stars say that."""
    rotation_deg: float | None = None
    """Of its plate."""
    was_sought: bool = True
    """False where nobody looked for anything, or not there: what it does not show is no miss."""
    settings: Mapping[str, float | int | str] = field(default_factory=dict)
    """What had been changed since the session began when it was processed."""
    is_solved: bool | None = None
    """Whether its stars gave its place; None while that is not known."""
    is_cloudy: bool = False
    """Whether the lead's miss in it is put down to cloud."""
    is_by_orbit: bool = False
    """Whether its residual is from the orbit's prediction: the filter's own had failed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameDetail:
    """What one of the last frames showed."""

    taken: FrameTaken | None = None
    detections: Detections | None = None
    solution: Solution | NotSolved | None = None
    predicted: TrackState | None = None
    updated: TrackState | None = None
    measurements: tuple[Measurement, ...] = ()
    not_followed: tuple[NotFollowed, ...] = ()
    closeup: Closeup | None = None
    """Where the piece at full resolution lies."""
    decision: Ruling | None = None
    """The operator's last word on it."""
    tracks: tuple[FrameTrack, ...] = ()
    """What it made of each track."""

    @property
    def all_measured(self) -> tuple[Measurement, ...]:
        """All that was measured in it, by the operator's word too."""
        taken = None if self.decision is None else self.decision.taken
        return self.measurements if taken is None else (*self.measurements, taken)

    def track_of(self, measured: Measurement) -> FrameTrack | None:
        """The track that took a measurement; None where none did."""
        return next(
            (
                each
                for each in self.tracks
                if each.updated is not None
                and each.updated.measurement_id == measured.measurement_id
            ),
            None,
        )

    @property
    def followed(self) -> Measurement | None:
        """The measurement the track took."""
        if self.decision is not None and self.decision.taken is not None:
            return self.decision.taken
        named = None if self.updated is None else self.updated.measurement_id
        return next((m for m in self.measurements if m.measurement_id == named), None)
