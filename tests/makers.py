"""Small makers of records for tests; every value can be overridden."""

import math
from typing import Any

from rsoconsole.orbits import Identification, MeasuredDirections, identify_jointly
from rsoconsole.records import Detection, Measurement, Site, StreakLight

T0_UTC_NS = 1_687_400_000_000_000_000
NS = 1_000_000_000
GEO_RATE_DEG_S = 15.041 / 3600.0


def geo_measurement(
    frame_id: int,
    *,
    ra_deg: float = 150.0,
    dec_deg: float = -5.0,
    cadence_s: float = 30.0,
    exposure_s: float = 10.0,
    rate_deg_s: float = GEO_RATE_DEG_S,
    rate_dec_deg_s: float = 0.0,
    **other: Any,
) -> Measurement:
    """The n-th frame's measurement of something that drifts like a geostationary satellite."""
    since_s = (frame_id - 1) * cadence_s
    ra = ra_deg + rate_deg_s * since_s
    dec = dec_deg + rate_dec_deg_s * since_s
    half_s = exposure_s / 2.0
    values: dict[str, Any] = {
        "measurement_id": f"{frame_id}-{round((ra + dec) * 36_000.0)}",
        "frame_id": frame_id,
        "t_mid_utc_ns": T0_UTC_NS + round(since_s * NS),
        "ra_icrs_deg": ra % 360.0,
        "dec_icrs_deg": dec,
        "cov_sky_arcsec2": (1.0, 0.0, 1.0),
        "x_px": 2000.0,
        "y_px": 1500.0,
        "confidence": 0.9,
        "source": "network",
        "ends_icrs_deg": (
            ((ra - rate_deg_s * half_s) % 360.0, dec - rate_dec_deg_s * half_s),
            ((ra + rate_deg_s * half_s) % 360.0, dec + rate_dec_deg_s * half_s),
        ),
    }
    return Measurement(**(values | other))


def straight_detection(
    *,
    x_px: float = 300.0,
    y_px: float = 200.0,
    angle_deg: float = 0.0,
    length_px: float = 118.0,
    **other: Any,
) -> Detection:
    """A streak about a midpoint."""
    dx = math.cos(math.radians(angle_deg)) * length_px / 2.0
    dy = math.sin(math.radians(angle_deg)) * length_px / 2.0
    values: dict[str, Any] = {
        "frame_id": 1,
        "confidence": 0.9,
        "x_px": x_px,
        "y_px": y_px,
        "x_a_px": x_px - dx,
        "y_a_px": y_px - dy,
        "x_b_px": x_px + dx,
        "y_b_px": y_px + dy,
        "box_px": (x_px - 60.0, y_px - 60.0, x_px + 60.0, y_px + 60.0),
        "length_px": length_px,
        "width_px": 2.5,
        "snr": 60.0,
        "sigma_along_px": 0.6,
        "sigma_across_px": 0.2,
        "is_clipped": False,
        "method": "line",
    }
    return Detection(**(values | other))


def streak_light(measurement_id: str, mag: float | None = 12.41, **other: Any) -> StreakLight:
    """Brightness of a streak in V, by default at an SNR of 40."""
    rate_adu_s = 100.0 if mag is None else 10.0 ** (0.4 * (22.0 - mag))
    values: dict[str, Any] = {
        "measurement_id": measurement_id,
        "flux_adu": 10.0 * rate_adu_s,
        "flux_sigma_adu": 0.25 * rate_adu_s,
        "rate_adu_s": rate_adu_s,
        "rate_sigma_adu_s": 0.025 * rate_adu_s,
        "band": "V",
        "mag": mag,
        "mag_sigma": None if mag is None else 0.03,
        "mag_sigma_colour": 0.07,
    }
    return StreakLight(**(values | other))


def identify(seen: MeasuredDirections, site: Site, entries: Any, **asked: Any) -> Identification:
    """The name of one track, nothing else being in the field."""
    (answer,) = identify_jointly([seen], site, entries, **asked)
    return answer
