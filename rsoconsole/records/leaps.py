"""Records of low satellites followed by leaps: one for each leap, one for each pass."""

from dataclasses import dataclass
from typing import Literal

LeapResult = Literal["met", "not in the frame", "another streak", "not solved"]
LeapOrder = Literal["at close", "by a look", "by the frame"]
"""Trigger of a leap's slew order: the last one's shutter, a look at its middle, or its frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeapDone:
    """One leap: the planned place and time, the result, and how long each part took."""

    frame_id: int
    """Number of the leap's own frame."""
    begun_frame_id: int
    """Number of the frame with the track's first streak."""
    number: int
    """Number of the leap in the pass: 1 for the first after the track's first streak."""
    result: LeapResult
    t_order_utc_ns: int
    """Time at which the slew was ordered, UTC ns."""
    ordered: LeapOrder
    t_mid_utc_ns: int
    """Planned mid-exposure, when the satellite should cross the field, UTC ns."""
    ra_icrs_deg: float
    dec_icrs_deg: float
    """Declination of the planned centre of the field."""
    speed_arcsec_s: float
    sigma_along_arcsec: float
    sigma_across_arcsec: float
    within: float
    """Predicted probability that both ends of the streak lie in the field."""
    flips: bool
    """True where the mount changed the side of the pier for this leap."""
    exposure_s: float
    binning: int
    """Pixels joined on each axis, as a multiple of the configured binning."""
    off_along_arcsec: float | None
    """Innovation of the streak's middle along the motion, arcsec; None without a streak."""
    off_across_arcsec: float | None
    """Innovation of the streak's middle to the left of the motion, arcsec; None likewise."""
    total_s: float
    """Time from the order of its slew until the next could be ordered, s: sum of the next six."""
    slew_s: float
    settle_s: float
    shutter_s: float
    """Time until the shutter opens, without the part already counted in ``settle_s``, s."""
    open_s: float
    """Planned exposure time, s."""
    readout_s: float
    """Time of read-out and reduction, s; 0 where the next slew was ordered at shutter close."""
    wait_s: float
    subframe: float
    """Fraction of each side of the sensor that was read out, 0 to 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LowPass:
    """One finished pass of a low satellite, with the orbit from all of its streaks."""

    frame_id: int
    """Number of the frame of the last leap, or of the first streak where there was no leap."""
    begun_frame_id: int
    """Number of the frame with the first streak."""
    name: str
    """Name of the satellite that was awaited; empty: any satellite."""
    ended: str
    """Reason why the pass was not followed further, in words."""
    streaks: int
    planned_leaps: int
    """Number of leaps planned when the first was ordered, as the mount allows; 0: none was."""
    t_first_utc_ns: int
    """Time of the first streak's middle, UTC ns."""
    t_last_utc_ns: int
    probability: float
    """Probability of its sense of motion; as a rule 1 from the second streak on."""
    epoch_utc_ns: int | None
    """Epoch of the orbit, UTC ns; None, like all that follows, with only one streak."""
    r_gcrs_km: tuple[float, float, float] | None
    v_gcrs_km_s: tuple[float, float, float] | None
    covariance: tuple[tuple[float, ...], ...] | None
    """Covariance of r and v, (6, 6): km, km/s."""
    a_km: float | None
    e: float | None
    i_deg: float | None
    believes_round: bool
    """True where a prior on its eccentricity is in it, as the streaks determine it no better."""
    along_rms_arcsec: float | None
    """Root mean square residual of the streaks' ends from the orbit, along the motion, arcsec."""
    across_rms_arcsec: float | None
    t_next_rise_utc_ns: int | None
    """Time of its next rise above the limit of altitude within a day, UTC ns; None: not found."""
    sigma_next_s: float | None
    sigma_next_across_deg: float | None
    scatter_s: float | None
    """Calibrated or measured scatter of the shutter, one sigma, s; None with only one streak."""
