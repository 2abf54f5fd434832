"""A camera mode's measured shutter as the configuration carries it."""

from datetime import date
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

TimeSource = Literal["header", "gps"]


class CalibratedTiming(BaseModel):
    """What a calibration found of one camera mode; a trait that is left out was not told."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    exposure_s: float | None = Field(None, gt=0, le=1e6)
    """None: of whatever length."""
    binning: str | None = Field(None, pattern=r"^\d{1,2}x\d{1,2}$")
    width_px: int | None = Field(None, ge=1, le=100_000)
    height_px: int | None = Field(None, ge=1, le=100_000)
    x0_px: int | None = Field(None, ge=0, le=100_000)
    """Where a subframe begins on the sensor."""
    y0_px: int | None = Field(None, ge=0, le=100_000)
    gain: float | None = None
    time_by: TimeSource = "header"
    bias_s: float = Field(ge=-10, le=10)
    """True mid-exposure of the first row minus the header's."""
    bias_sigma_s: float = Field(ge=0, le=10)
    scatter_s: float = Field(ge=0, le=10)
    scatter_sigma_s: float = Field(ge=0, le=10)
    line_time_us: float = Field(0.0, ge=-1000, le=1000)
    line_time_sigma_us: float | None = Field(None, ge=0, le=1000)
    """None: it was not measured, and the bias holds with this one."""
    measured_on: date
    """Day of its last night (UTC)."""
    source: Literal["broadcast", "sp3"]
    tracks: int = Field(ge=1, le=1_000_000)
    measurements: int = Field(ge=1, le=100_000_000)

    @property
    def mode(self) -> tuple[object, ...]:
        """What tells it from other modes."""
        return (self.exposure_s, *self.read_out)

    @property
    def read_out(self) -> tuple[object, ...]:
        """The mode but for the length of its exposure."""
        sides = (self.width_px, self.height_px, self.x0_px, self.y0_px)
        return (self.binning, *sides, self.gain, self.time_by)
