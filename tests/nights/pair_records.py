"""Records of a field as a whole, made up."""

from typing import Any

from rsoconsole.records import ExpectedMembers, PairMotion, PairMotions, UnseenMember
from tests.nights.made_up_night import t_of

NS_PER_MIN = 60_000_000_000


def pair_of(n: int, one: int, other: int, **changes: Any) -> PairMotion:
    values: dict[str, Any] = {
        "track_id": one,
        "other_track_id": other,
        "t_utc_ns": t_of(n),
        "frames": n,
        "east_arcsec": 250.0 * (other - one),
        "north_arcsec": 40.0,
        "sigma_east_arcsec": 0.5,
        "sigma_north_arcsec": 0.25,
        "separation_arcsec": 253.2 * (other - one),
        "sigma_separation_arcsec": 0.5,
        "position_angle_deg": 80.9,
        "sigma_position_angle_deg": 0.1,
        "rate_east_arcsec_min": -1.5,
        "rate_north_arcsec_min": 0.25,
        "sigma_rate_east_arcsec_min": 0.03,
        "sigma_rate_north_arcsec_min": 0.02,
        "separation_rate_arcsec_min": -1.44,
        "sigma_separation_rate_arcsec_min": 0.03,
        "closest": "ahead",
        "closest_utc_ns": t_of(n) + 95 * NS_PER_MIN,
        "sigma_closest_s": 540.0,
        "closest_arcsec": 61.0 * (other - one),
        "closest_low_arcsec": 52.0,
        "closest_high_arcsec": 73.0,
        "closest_lowest_arcsec": 41.0,
        "closest_highest_arcsec": 90.0,
        "horizon_s": 21_600.0,
        "path": "curved",
        "close_probability": 0.0,
    }
    return PairMotion(**(values | changes))


def pairs_of(n: int, *pairs: PairMotion) -> PairMotions:
    return PairMotions(frame_id=n, pairs=pairs)


def unseen_of(name: str = "ASTRA 1H", **changes: Any) -> UnseenMember:
    values: dict[str, Any] = {
        "norad_id": 25785,
        "name": name,
        "ra_icrs_deg": 150.25,
        "dec_icrs_deg": -5.5,
        "x_px": 3120.4,
        "y_px": 911.5,
        "sigma_arcsec": 45.0,
        "tle_age_days": 1.25,
        "is_usable": True,
        "is_lit": True,
    }
    return UnseenMember(**(values | changes))


def expected_of(n: int, *unseen: UnseenMember) -> ExpectedMembers:
    return ExpectedMembers(
        frame_id=n, t_utc_ns=t_of(n), compared=1665, in_frame=8 + len(unseen), unseen=unseen
    )
