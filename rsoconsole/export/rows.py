"""One measurement with what the track made of it: a line of every table, and its columns."""

import math
from dataclasses import dataclass
from typing import Any

from rsoconsole.night import FRAME_FACTS, NightFrame, facts_of
from rsoconsole.records import (
    TABLES,
    Column,
    Measurement,
    TrackState,
    columns_of,
    member,
)
from rsoconsole.sky import utc_ns_to_iso, wrap_360
from rsoconsole.tracking.filters import sky_covariance_arcsec2, sky_rate_arcsec_s


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredRow:
    """One measurement of one frame; what the track says of it is None where it was not taken.

    Directions ICRS, astrometric, in degrees; errors and residuals on the sky in arcsec, those in
    right ascension times cos Dec; pixels 0-based.
    """

    frame_id: int
    track: int | None
    """Number of the track that took it, from 1 in order of time."""
    t_mid_utc_ns: int
    exposure_s: float | None
    ra_icrs_deg: float
    dec_icrs_deg: float
    sigma_ra_arcsec: float
    """On the sky."""
    sigma_dec_arcsec: float
    correlation: float
    """Of the errors in right ascension and declination, -1 to 1."""
    x_px: float
    y_px: float
    confidence: float
    source: str
    """``network`` or ``operator``."""
    is_clipped: bool
    """The frame cuts the streak: only the position across it holds."""
    is_taken: bool
    not_taken_because: str | None
    """Of a superseded one that was taken: why it no longer counts, where somebody refused it."""
    ra_a_icrs_deg: float | None
    """One end of the streak, then the other; which came first in time is not known."""
    dec_a_icrs_deg: float | None
    ra_b_icrs_deg: float | None
    dec_b_icrs_deg: float | None
    predicted_ra_icrs_deg: float | None = None
    """Where the track expected its object in this frame."""
    predicted_dec_icrs_deg: float | None = None
    predicted_sigma_ra_arcsec: float | None = None
    predicted_sigma_dec_arcsec: float | None = None
    residual_ra_arcsec: float | None = None
    """Measured minus predicted."""
    residual_dec_arcsec: float | None = None
    sigma_residual_ra_arcsec: float | None = None
    """sqrt of the diagonal of S."""
    sigma_residual_dec_arcsec: float | None = None
    nis: float | None = None
    """Normalised innovation squared; 2 on average for a sound filter."""
    updated_ra_icrs_deg: float | None = None
    """The track's place after this measurement."""
    updated_dec_icrs_deg: float | None = None
    rate_ra_arcsec_s: float | None = None
    """The track's motion on the sky after it."""
    rate_dec_arcsec_s: float | None = None
    is_superseded: bool
    """By the operator's word it counts no more; only there when all was asked for."""

    beside: tuple[tuple[str, Any], ...] = ()
    """Column and value of what measurement and frame have on record beside all that."""

    def value(self, name: str) -> Any:
        """What it has in a column; None for nothing."""
        found = dict(self.beside)
        return found[name] if name in found else getattr(self, name, None)

    @property
    def t_mid_utc(self) -> str:
        """Mid-exposure, ISO 8601 to the nanosecond."""
        return utc_ns_to_iso(self.t_mid_utc_ns, decimals=9)

    @property
    def cov_sky_arcsec2(self) -> tuple[float, float, float]:
        """East-east, east-north, north-north."""
        east, north = self.sigma_ra_arcsec, self.sigma_dec_arcsec
        return east**2, self.correlation * east * north, north**2


_RECORDED = {
    column.name: column
    for name in ("image_quality", "frames", "measurements")
    for column in TABLES[name].columns
}
_OWN_LINES = """
frame_id
track integer track that took it, from 1 in order of time
t_mid_utc text mid-exposure by the shutter, UTC
t_mid_utc_ns integer the same since 1970-01-01, POSIX count
exposure_s
ra_icrs_deg real measured right ascension, astrometric
dec_icrs_deg real measured declination, astrometric
sigma_ra_arcsec real one sigma in right ascension times cos Dec
sigma_dec_arcsec real one sigma in declination
correlation real of both errors
x_px real column of the streak's midpoint, 0-based
y_px real row of it
confidence
source
is_clipped
is_taken truth a track took it
not_taken_because text why none did
ra_a_icrs_deg real one end of the streak
dec_a_icrs_deg real one end of the streak
ra_b_icrs_deg real its other end
dec_b_icrs_deg real its other end
predicted_ra_icrs_deg real where the track expected it
predicted_dec_icrs_deg real where the track expected it
predicted_sigma_ra_arcsec real one sigma of that, times cos Dec
predicted_sigma_dec_arcsec real one sigma of that
residual_ra_arcsec real measured minus predicted, times cos Dec
residual_dec_arcsec real measured minus predicted
sigma_residual_ra_arcsec real sqrt(S) of the innovation
sigma_residual_dec_arcsec real sqrt(S) of the innovation
nis real normalised innovation squared
updated_ra_icrs_deg real the track after it
updated_dec_icrs_deg real the track after it
rate_ra_arcsec_s real motion of the track, times cos Dec
rate_dec_arcsec_s real motion of the track
is_superseded truth counts no more, by the operator's word
"""
"""A name alone: the column as it is on record."""
_OWN: tuple[Column, ...] = tuple(
    _RECORDED.get(line) or columns_of(line)[0] for line in _OWN_LINES.strip().splitlines()
)
_IN_OTHER_COLUMNS = frozenset(
    (
        *("cov_ee_arcsec2", "cov_en_arcsec2", "cov_nn_arcsec2"),
        *("ends_icrs_deg", "measurement_id"),
    )
)
"""Columns of measurements on record that are in others here, or, as the id, in none."""
_BESIDE: tuple[Column, ...] = tuple(
    column
    for column in TABLES["measurements"].own
    if column.name not in {*_IN_OTHER_COLUMNS, *(own.name for own in _OWN)}
    and column.type != "json"
    and not (column.shape or column.is_worded)
)
"""Whatever else a measurement has on record that a cell of a table holds."""
_OF_FRAME: tuple[Column, ...] = tuple(
    _RECORDED[fact.name] for fact in FRAME_FACTS if fact.name in _RECORDED
)
"""What its frame says of image and sky."""
COLUMNS: tuple[Column, ...] = (*_OWN, *_BESIDE, *_OF_FRAME)
_SAME = MeasuredRow.__dataclass_fields__.keys() & Measurement.__dataclass_fields__.keys()
"""What a row has as the measurement has it."""


def row_of(
    measurement: Measurement,
    frame: NightFrame,
    *,
    track: int | None,
    is_taken: bool,
    reason: str | None,
    nis: float | None,
    predicted: TrackState | None,
    corrected: TrackState | None,
    is_superseded: bool,
) -> MeasuredRow:
    """A row from what is on record; ``corrected`` is given for what the track took alone."""
    east2, cross, north2 = measurement.cov_sky_arcsec2
    sigma_east, sigma_north = math.sqrt(max(east2, 0.0)), math.sqrt(max(north2, 0.0))
    both = sigma_east * sigma_north
    end_a, end_b = measurement.ends_icrs_deg or ((None, None), (None, None))
    return MeasuredRow(
        **{name: getattr(measurement, name) for name in _SAME},
        track=track,
        exposure_s=None if frame.taken is None else frame.taken.exposure_s,
        sigma_ra_arcsec=sigma_east,
        sigma_dec_arcsec=sigma_north,
        correlation=min(max(cross / both, -1.0), 1.0) if both > 0.0 else 0.0,
        is_taken=is_taken,
        not_taken_because=reason,
        ra_a_icrs_deg=end_a[0],
        dec_a_icrs_deg=end_a[1],
        ra_b_icrs_deg=end_b[0],
        dec_b_icrs_deg=end_b[1],
        **_predicted(predicted),
        **_corrected(corrected, nis),
        is_superseded=is_superseded,
        beside=(
            *((column.name, member(measurement, column)) for column in _BESIDE),
            *facts_of(frame.detections).items(),
        ),
    )


def _predicted(state: TrackState | None) -> dict[str, Any]:
    if state is None:
        return {}
    covariance = sky_covariance_arcsec2(state)
    return {
        "predicted_ra_icrs_deg": wrap_360(state.x[0]),
        "predicted_dec_icrs_deg": state.x[2],
        "predicted_sigma_ra_arcsec": math.sqrt(float(covariance[0, 0])),
        "predicted_sigma_dec_arcsec": math.sqrt(float(covariance[1, 1])),
    }


def _corrected(state: TrackState | None, nis: float | None) -> dict[str, Any]:
    if state is None:
        return {"nis": nis}
    residual = state.innovation_arcsec or (None, None)
    sigma = state.sigma_innovation_arcsec or (None, None)
    rate = sky_rate_arcsec_s(state)
    return {
        "residual_ra_arcsec": residual[0],
        "residual_dec_arcsec": residual[1],
        "sigma_residual_ra_arcsec": sigma[0],
        "sigma_residual_dec_arcsec": sigma[1],
        "nis": state.nis,
        "updated_ra_icrs_deg": wrap_360(state.x[0]),
        "updated_dec_icrs_deg": state.x[2],
        "rate_ra_arcsec_s": rate[0],
        "rate_dec_arcsec_s": rate[1],
    }
