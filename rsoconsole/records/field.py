"""Records of a field as a whole: the relative motion of its tracks, and the missing objects."""

from dataclasses import dataclass
from typing import Literal

PathKind = Literal["straight", "curved"]
"""Model of the relative motion behind a closest approach: a straight line, or with its bend."""
ClosestKind = Literal["now", "ahead", "beyond"]
"""Place of the least separation within the horizon: at its beginning, as they part; inside; at its
end, as they still approach."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PairMotion:
    """Position and motion of one track relative to another, and their closest approach; 1-sigma
    errors of differences.

    Components are those of the way from ``track_id`` to ``other_track_id``, east and north at the
    middle between them. Errors common to all streaks of a frame cancel.
    """

    track_id: int
    other_track_id: int
    t_utc_ns: int
    """Instant of the separation: mid-exposure of the frame, UTC ns."""
    frames: int
    """Number of frames with both tracks."""
    east_arcsec: float
    north_arcsec: float
    sigma_east_arcsec: float
    sigma_north_arcsec: float
    separation_arcsec: float
    sigma_separation_arcsec: float
    position_angle_deg: float
    """Position angle of the other one, from north through east, deg."""
    sigma_position_angle_deg: float
    rate_east_arcsec_min: float
    rate_north_arcsec_min: float
    sigma_rate_east_arcsec_min: float
    sigma_rate_north_arcsec_min: float
    separation_rate_arcsec_min: float
    """Rate of the separation, arcsec/min: below 0 while they approach."""
    sigma_separation_rate_arcsec_min: float
    closest: ClosestKind
    closest_utc_ns: int
    """Time of the closest approach within the horizon, UTC ns."""
    sigma_closest_s: float
    closest_arcsec: float
    """Median separation at the closest approach, arcsec."""
    closest_low_arcsec: float
    """Lower end of the interval of 68 %, arcsec; the upper one is ``closest_high_arcsec``."""
    closest_high_arcsec: float
    closest_lowest_arcsec: float
    """Lower end of the interval of 95 %, arcsec; the upper one is ``closest_highest_arcsec``."""
    closest_highest_arcsec: float
    horizon_s: float
    """Time ahead over which the approach was searched, s."""
    path: PathKind
    close_probability: float
    """Probability that they come nearer than the angle of the warning within its horizon; 0 without
    one."""
    is_close: bool = False
    """True where the operator is warned of this approach."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PairMotions:
    """The relative motion of the tracks of a field."""

    frame_id: int
    pairs: tuple[PairMotion, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class UnseenMember:
    """A catalogued object that should be in the frame and has no track."""

    norad_id: int
    name: str
    ra_icrs_deg: float
    """Right ascension at mid-exposure, by its elements."""
    dec_icrs_deg: float
    x_px: float
    y_px: float
    sigma_arcsec: float
    """One sigma of its elements along its motion, arcsec."""
    tle_age_days: float
    is_usable: bool
    """True where its whole streak is in the frame."""
    is_lit: bool
    """True where the Sun lights it; element files do not say how bright an object is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedMembers:
    """Catalogued objects that should be in a frame and have no track."""

    frame_id: int
    t_utc_ns: int
    """Mid-exposure, UTC ns."""
    compared: int
    """Number of catalogued objects compared."""
    in_frame: int
    """Number of expected objects that should be in the frame."""
    unseen: tuple[UnseenMember, ...]
