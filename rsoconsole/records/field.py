"""Records of a field as a whole: the relative motion of its tracks, and who is missing."""

from dataclasses import dataclass
from typing import Literal

PathKind = Literal["straight", "curved"]
"""What a closest approach was found from: how both moved to each other so far, by a straight line
or with its bend."""
ClosestKind = Literal["now", "ahead", "beyond"]
"""Where the least separation of the horizon is: at its beginning, as they part; inside; at its
end, as they still approach."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PairMotion:
    """Where one track stands to another, and how near they come; 1-sigma errors of differences.

    Components are those of the way from ``track_id`` to ``other_track_id``, east and north at the
    middle between them. What all streaks of a frame share cancels.
    """

    track_id: int
    other_track_id: int
    t_utc_ns: int
    """Instant of the separation: mid-exposure of the frame."""
    frames: int
    """Number of frames that have shown both."""
    east_arcsec: float
    north_arcsec: float
    sigma_east_arcsec: float
    sigma_north_arcsec: float
    separation_arcsec: float
    sigma_separation_arcsec: float
    position_angle_deg: float
    """Position angle of the other one, from north through east."""
    sigma_position_angle_deg: float
    rate_east_arcsec_min: float
    rate_north_arcsec_min: float
    sigma_rate_east_arcsec_min: float
    sigma_rate_north_arcsec_min: float
    separation_rate_arcsec_min: float
    """Below 0 while they approach."""
    sigma_separation_rate_arcsec_min: float
    closest: ClosestKind
    closest_utc_ns: int
    """When they are nearest to each other within the horizon."""
    sigma_closest_s: float
    closest_arcsec: float
    """Separation at the closest approach, the median."""
    closest_low_arcsec: float
    """The interval of 68 %."""
    closest_high_arcsec: float
    closest_lowest_arcsec: float
    """The interval of 95 %."""
    closest_highest_arcsec: float
    horizon_s: float
    """Time ahead over which the approach was searched."""
    path: PathKind
    close_probability: float
    """Probability that they come nearer than the angle of the warning within its horizon; 0 without
    one."""
    is_close: bool = False
    """Whether the operator is warned of this approach."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PairMotions:
    """The relative motion of the tracks of a field."""

    frame_id: int
    pairs: tuple[PairMotion, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class UnseenMember:
    """A catalogued object that should be in the frame, and that no track is of."""

    norad_id: int
    name: str
    ra_icrs_deg: float
    """At mid-exposure, by its elements."""
    dec_icrs_deg: float
    x_px: float
    y_px: float
    sigma_arcsec: float
    """One sigma of its elements along its motion."""
    tle_age_days: float
    is_usable: bool
    """True when its whole streak is in the frame."""
    is_lit: bool
    """By the Sun; element files do not say how bright an object is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedMembers:
    """Catalogued objects that should be in a frame and are not followed."""

    frame_id: int
    t_utc_ns: int
    """Middle of the exposure."""
    compared: int
    """Catalogued objects that were looked at."""
    in_frame: int
    """The expected objects that should be in the frame."""
    unseen: tuple[UnseenMember, ...]
