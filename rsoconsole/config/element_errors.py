"""What one's own nights say of how elements err, as the configuration carries it."""

from datetime import date
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class MeasuredErrors(BaseModel):
    """Factors on the assumed errors of one kind of orbit, each with its one-sigma error."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    regime: Literal["GEO", "MEO", "LEO", "HEO"]
    along_at_epoch: float = Field(ge=0.01, le=100)
    along_at_epoch_sigma: float = Field(ge=0, le=1000)
    along_by_age: float = Field(ge=0.01, le=100)
    along_by_age_sigma: float = Field(ge=0, le=1000)
    across: float = Field(ge=0.01, le=100)
    across_sigma: float = Field(ge=0, le=1000)
    tracks: int = Field(ge=1, le=100_000_000)
    """Rows of the ledger that they were found from."""
    objects: int = Field(ge=1, le=100_000_000)
    oldest_days: float = Field(ge=0, le=1e5)
    """Of their elements."""
    measured_on: date
    """Day of the last row (UTC)."""
