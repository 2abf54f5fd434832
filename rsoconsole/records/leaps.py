"""Records of low satellites that are followed by leaps: each leap, and each pass."""

from dataclasses import dataclass
from typing import Literal

LeapResult = Literal["met", "not in the frame", "another streak", "not solved"]
LeapOrder = Literal["at close", "by a look", "by the frame"]
"""What the order of its slew waited for: the shutter of the leap before, a look at the middle of
that one's frame, or the whole of it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeapDone:
    """One leap: where and when it was to be met, what came of it, and what it took."""

    frame_id: int
    """Number of its exposure."""
    begun_frame_id: int
    """Frame of the first streak of what is followed."""
    number: int
    """1 for the first after that streak."""
    result: LeapResult
    t_order_utc_ns: int
    """When its slew was ordered."""
    ordered: LeapOrder
    t_mid_utc_ns: int
    """When it was to be met: the middle of the exposure."""
    ra_icrs_deg: float
    dec_icrs_deg: float
    """Where: the middle of the field."""
    speed_arcsec_s: float
    sigma_along_arcsec: float
    sigma_across_arcsec: float
    within: float
    """Probability that both ends of the streak would be in the field."""
    flips: bool
    """Whether the mount changed the side of its pier for it."""
    exposure_s: float
    binning: int
    """Pixels joined on each axis, of the configured ones."""
    off_along_arcsec: float | None
    """Measured minus predicted at the streak's middle, before the update; None where not met."""
    off_across_arcsec: float | None
    """To the left of the motion."""
    total_s: float
    """From the order of its slew until the next could be ordered, which the next six add up to."""
    slew_s: float
    settle_s: float
    shutter_s: float
    """Until it opens, beyond what of that the mount settles in."""
    open_s: float
    """The exposure, as planned."""
    readout_s: float
    """With what came of the frame; 0 where the next slew was ordered as the shutter closed."""
    wait_s: float
    subframe: float
    """Share of each side of the sensor that was read out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LowPass:
    """One pass that was followed, when it is over; its orbit by all of its streaks."""

    frame_id: int
    """The last one."""
    begun_frame_id: int
    """Frame of its first streak."""
    name: str
    """Name of what was waited for; empty: whatever came."""
    ended: str
    """Why it was not followed further, in words."""
    streaks: int
    planned_leaps: int
    """As many as the mount would have allowed, when the first was ordered; 0: none was."""
    t_first_utc_ns: int
    """Middle of the first streak."""
    t_last_utc_ns: int
    probability: float
    """Of its sense; 1 from the second streak on, as a rule."""
    epoch_utc_ns: int | None
    """Of the orbit, as all below; None where one streak was all."""
    r_gcrs_km: tuple[float, float, float] | None
    v_gcrs_km_s: tuple[float, float, float] | None
    covariance: tuple[tuple[float, ...], ...] | None
    """(6, 6) of r and v: km, km/s."""
    a_km: float | None
    e: float | None
    i_deg: float | None
    believes_round: bool
    """Whether a prior on its eccentricity is in it, because the streaks tell it no better."""
    along_rms_arcsec: float | None
    """Of the ends of its streaks against the orbit."""
    across_rms_arcsec: float | None
    t_next_rise_utc_ns: int | None
    """When it comes again within a day, above the limit of altitude; None: not found."""
    sigma_next_s: float | None
    sigma_next_across_deg: float | None
    scatter_s: float | None
    """Of the shutter, one sigma: as calibrated, or as these streaks told; None of one streak."""
