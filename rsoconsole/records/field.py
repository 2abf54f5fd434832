"""Records of a whole field: the relative motion of its tracks, and the missing objects."""

from dataclasses import dataclass
from typing import Literal

PathKind = Literal["straight", "curved"]
"""Model of the relative motion: a straight line, or a line with a bend."""
ClosestKind = Literal["now", "ahead", "beyond"]
"""Place of the least separation within the horizon: at its beginning, inside, at its end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PairMotion:
    """Motion of one track relative to another, and the closest approach of the two.

    East and north are the components of the vector from ``track_id`` to ``other_track_id``, at the
    middle between the two. Sigmas are of this difference: errors common to all streaks of a frame
    cancel.
    """

    track_id: int
    other_track_id: int
    t_utc_ns: int
    """Instant of separation and rates: mid-exposure of the frame, UTC ns."""
    frames: int
    """Number of frames that show both tracks."""
    east_arcsec: float
    north_arcsec: float
    sigma_east_arcsec: float
    sigma_north_arcsec: float
    separation_arcsec: float
    sigma_separation_arcsec: float
    position_angle_deg: float
    """Direction from ``track_id`` to ``other_track_id``, from north through east, deg."""
    sigma_position_angle_deg: float
    rate_east_arcsec_min: float
    rate_north_arcsec_min: float
    sigma_rate_east_arcsec_min: float
    sigma_rate_north_arcsec_min: float
    separation_rate_arcsec_min: float
    """Rate of the separation, arcsec/min; negative: the two approach."""
    sigma_separation_rate_arcsec_min: float
    closest: ClosestKind
    closest_utc_ns: int
    """Time of the closest approach within ``horizon_s``, UTC ns."""
    sigma_closest_s: float
    closest_arcsec: float
    """Separation at the closest approach, arcsec: the median."""
    closest_low_arcsec: float
    """Lower end of the 68 % interval of ``closest_arcsec``; upper: ``closest_high_arcsec``."""
    closest_high_arcsec: float
    closest_lowest_arcsec: float
    """Lower end of the 95 % interval of ``closest_arcsec``; upper: ``closest_highest_arcsec``."""
    closest_highest_arcsec: float
    horizon_s: float
    """Time after ``t_utc_ns`` in which the closest approach is searched, s."""
    path: PathKind
    close_probability: float
    """Probability that they come nearer than the warning's angle in its horizon; 0 without one."""
    is_close: bool = False
    """True where the operator is warned of this approach."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PairMotions:
    """Relative motion of the tracks of a field, pair by pair."""

    frame_id: int
    pairs: tuple[PairMotion, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class UnseenMember:
    """A catalogued object that should be in the frame and has no track."""

    norad_id: int
    name: str
    ra_icrs_deg: float
    """Right ascension at mid-exposure, predicted from its elements."""
    dec_icrs_deg: float
    x_px: float
    y_px: float
    sigma_arcsec: float
    """One sigma along the motion of the predicted position, arcsec."""
    tle_age_days: float
    is_usable: bool
    """True where the whole predicted streak lies in the frame."""
    is_lit: bool
    """True where it is sunlit; how bright it is, element files do not say."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedMembers:
    """Catalogued objects that should be in a frame and have no track."""

    frame_id: int
    t_utc_ns: int
    """Mid-exposure, UTC ns."""
    compared: int
    """Number of catalogued objects compared with the frame."""
    in_frame: int
    """Number of expected objects predicted to be in the frame."""
    unseen: tuple[UnseenMember, ...]
