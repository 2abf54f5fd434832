"""Records of low satellites that are followed by leaps: each leap, and each pass."""

from dataclasses import dataclass
from typing import Literal

LeapResult = Literal["met", "not in the frame", "another streak", "not solved"]
LeapOrder = Literal["at close", "by a look", "by the frame"]
"""Trigger of the order of a leap's slew: the shutter of the leap before, a look at the middle of
that one's frame, or the whole of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeapDone:
    """One leap: planned place and time, result, and durations."""

    frame_id: int
    """Frame number of its exposure."""
    begun_frame_id: int
    """Frame number of the track's first streak."""
    number: int
    """Number of the leap: 1 for the first after that streak."""
    result: LeapResult
    t_order_utc_ns: int
    """Time at which its slew was ordered, UTC ns."""
    ordered: LeapOrder
    t_mid_utc_ns: int
    """Mid-exposure of the planned meeting, UTC ns."""
    ra_icrs_deg: float
    dec_icrs_deg: float
    """Declination of the centre of the field."""
    speed_arcsec_s: float
    sigma_along_arcsec: float
    sigma_across_arcsec: float
    within: float
    """Probability that both ends of the streak would be in the field."""
    flips: bool
    """True where the mount changed the side of its pier for it."""
    exposure_s: float
    binning: int
    """Pixels joined on each axis, in units of the configured ones."""
    off_along_arcsec: float | None
    """Innovation along the motion at the streak's middle, arcsec; None where not met."""
    off_across_arcsec: float | None
    """Innovation to the left of the motion, arcsec; None where not met."""
    total_s: float
    """Time from the order of its slew until the next could be ordered, s: the sum of the next
    six."""
    slew_s: float
    settle_s: float
    shutter_s: float
    """Time until the shutter opens, beyond the part of it in which the mount settles, s."""
    open_s: float
    """Exposure as planned, s."""
    readout_s: float
    """Time of read-out and reduction, s; 0 where the next slew was ordered as the shutter
    closed."""
    wait_s: float
    subframe: float
    """Share of each side of the sensor that was read out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LowPass:
    """One finished pass, with its orbit by all of its streaks."""

    frame_id: int
    """Frame number of the last leap, or of the first streak where there was none."""
    begun_frame_id: int
    """Frame number of its first streak."""
    name: str
    """Name of the awaited satellite; empty: any."""
    ended: str
    """Reason why it was not followed further, in words."""
    streaks: int
    planned_leaps: int
    """Number of leaps planned when the first was ordered, as the mount allows; 0: none was."""
    t_first_utc_ns: int
    """Middle of the first streak, UTC ns."""
    t_last_utc_ns: int
    probability: float
    """Probability of its sense of motion; as a rule 1 from the second streak on."""
    epoch_utc_ns: int | None
    """Epoch of the orbit, UTC ns; None, like all below, where there is only one streak."""
    r_gcrs_km: tuple[float, float, float] | None
    v_gcrs_km_s: tuple[float, float, float] | None
    covariance: tuple[tuple[float, ...], ...] | None
    """Covariance of r and v, (6, 6): km, km/s."""
    a_km: float | None
    e: float | None
    i_deg: float | None
    believes_round: bool
    """True where a prior on its eccentricity is in it, because the streaks determine it no
    better."""
    along_rms_arcsec: float | None
    """Root mean square of the ends of its streaks against the orbit, along the motion, arcsec."""
    across_rms_arcsec: float | None
    t_next_rise_utc_ns: int | None
    """Time of its next rise above the limit of altitude within a day, UTC ns; None: not found."""
    sigma_next_s: float | None
    sigma_next_across_deg: float | None
    scatter_s: float | None
    """Scatter of the shutter, one sigma, s: as calibrated, or as these streaks show it; None with
    only one streak."""
