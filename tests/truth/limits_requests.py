"""Random slews that look for trouble: each kind crowds around one of the limits."""

import math

import numpy as np

from rsoconsole.config import LimitsConfig, MountConfig
from rsoconsole.records import Site
from rsoconsole.sky import icrs_of_hour_angle, sun_icrs
from rsoconsole.words import NS_PER_S
from tests.truth.limits_by_astropy import Request

KINDS = (
    "anywhere",
    "near the Sun",
    "low",
    "meridian",
    "no number",
    "pole",
    "RA wrap",
    "stale",
)
SHARES = (0.2, 0.28, 0.12, 0.18, 0.04, 0.06, 0.06, 0.06)
NO_NUMBERS = (math.nan, math.inf, -math.inf, 360.0, -1e-9, 1e300, 90.0001, -90.5)

OBSERVATORIES = {
    "Daytona, German": (
        Site(latitude_deg=29.19, longitude_deg=-81.05, elevation_m=10.0),
        LimitsConfig(),
        MountConfig(),
    ),
    "polar fork": (
        Site(latitude_deg=69.6, longitude_deg=19.0, elevation_m=100.0),
        LimitsConfig(min_altitude_deg=5.0, max_hour_angle_deg=180.0, sun_cone_deg=20.0),
        MountConfig(type="fork", slew_rate_deg_s=8.0),
    ),
    "in the south, walled, no grace at the meridian": (
        Site(latitude_deg=-30.2, longitude_deg=-70.8, elevation_m=2200.0),
        LimitsConfig(
            past_meridian_deg=0.0,
            max_hour_angle_deg=90.0,
            horizon=((0.0, 20.0), (90.0, 35.0), (200.0, 10.0), (300.0, 40.0)),
        ),
        MountConfig(slew_rate_deg_s=2.0),
    ),
    "wide grace, wide cone": (
        Site(latitude_deg=45.0, longitude_deg=7.0, elevation_m=300.0),
        LimitsConfig(
            past_meridian_deg=30.0,
            sun_cone_deg=60.0,
            horizon=((10.0, 30.0), (180.0, 5.0), (350.0, 12.0)),
        ),
        MountConfig(flip_hysteresis_deg=5.0),
    ),
    "equatorial fork, narrow cone": (
        Site(latitude_deg=-2.0, longitude_deg=179.5, elevation_m=0.0),
        LimitsConfig(min_altitude_deg=-5.0, max_hour_angle_deg=80.0, sun_cone_deg=10.0),
        MountConfig(type="fork", slew_rate_deg_s=1.0),
    ),
}


def random_requests(name: str, count: int, seed: int) -> list[Request]:
    """``count`` requests for one of the observatories."""
    site, limits, mount = OBSERVATORIES[name]
    rng = np.random.default_rng([seed, len(name)])
    return [_request(rng, site, limits, mount) for _ in range(count)]


def _request(rng, site, limits, mount) -> Request:
    kind = str(rng.choice(KINDS, p=SHARES))
    now_ns = int(rng.integers(1_330_000_000, 1_780_000_000)) * NS_PER_S + int(rng.integers(10**9))
    sun = sun_icrs(now_ns)
    side = str(rng.choice(["west", "east"]))
    past_deg = min(limits.past_meridian_deg, limits.max_hour_angle_deg)

    def place(hour_angle_deg, dec_deg):
        wrapped = (hour_angle_deg + 180.0) % 360.0 - 180.0
        return icrs_of_hour_angle(site, float(wrapped), float(dec_deg), now_ns)

    def anywhere():
        dec_deg = math.degrees(math.asin(rng.uniform(-0.95, 1.0)))
        dec_deg = dec_deg if site.latitude_deg >= 0 else -dec_deg
        reach_deg = limits.max_hour_angle_deg
        ends = (-reach_deg, past_deg) if side == "west" else (-past_deg, reach_deg)
        return place(rng.uniform(*ends), dec_deg)

    def around(centre, least_deg, most_deg):
        away_deg, angle = rng.uniform(least_deg, most_deg), rng.uniform(0.0, 2 * math.pi)
        dec_deg = float(np.clip(centre[1] + away_deg * math.cos(angle), -89.9, 89.9))
        stretch = 1.0 / max(math.cos(math.radians(dec_deg)), 0.2)
        return (centre[0] + away_deg * math.sin(angle) * stretch) % 360.0, dec_deg

    start, target = anywhere(), anywhere()
    aim_s, exposure_s = rng.uniform(0.0, 120.0), rng.uniform(0.1, 60.0)
    lifted = [name for name in ("twilight", "altitude", "horizon") if rng.random() < 0.3]
    if kind == "near the Sun":
        lifted = ["twilight"] if rng.random() < 0.8 else []
        lifted += ["altitude", "horizon"] if rng.random() < 0.6 else []
        target = around(sun, 0.0, 2.0 * limits.sun_cone_deg)
        if rng.random() < 0.5:
            start = around(sun, 0.0, 2.0 * limits.sun_cone_deg)
    elif kind == "low":
        target = place(rng.uniform(-180.0, 180.0), rng.uniform(-90.0, 90.0))
    elif kind == "meridian":
        centre_deg = rng.choice(
            [0.0, past_deg, -past_deg, limits.max_hour_angle_deg, -limits.max_hour_angle_deg]
        )
        hour_angle_deg = centre_deg + rng.normal(0.0, 5.0)
        target = place(hour_angle_deg, site.latitude_deg + rng.uniform(-50.0, 50.0) % 90.0)
        if abs(target[1]) > 89.0:
            target = place(hour_angle_deg, 0.0)
        start = around(target, 0.0, 20.0) if rng.random() < 0.4 else start
        exposure_s = rng.uniform(0.1, 1200.0 if limits.horizon else 5400.0)
    elif kind == "no number":
        wrong = float(rng.choice(NO_NUMBERS))
        four = [*start, *target]
        four[int(rng.integers(4))] = wrong
        start, target = (four[0], four[1]), (four[2], four[3])
    elif kind == "pole":
        pole_deg = math.copysign(90.0 - rng.choice([0.0, rng.exponential(0.4)]), site.latitude_deg)
        at_pole = place(rng.uniform(-180.0, 180.0), float(np.clip(pole_deg, -90.0, 90.0)))
        start, target = (at_pole, target) if rng.random() < 0.5 else (start, at_pole)
    elif kind == "RA wrap":
        start = (float(rng.choice([0.0, 359.9999, 1e-12, 359.0])), start[1])
        target = ((360.0 + rng.uniform(-3.0, 3.0)) % 360.0, target[1])
    elif kind == "stale":
        aim_s = float(rng.choice([-900.0, -301.0, -299.0, 7199.0, 7201.0, 86_400.0, -1.7e9]))
        exposure_s = float(rng.choice([10.0, -400.0, 20_000.0, 1.0]))
    aim_ns = now_ns + round(aim_s * NS_PER_S)
    return Request(
        now_ns=now_ns,
        start=start,
        side=None if mount.type == "fork" or rng.random() < 0.2 else side,
        target=target,
        aim_ns=aim_ns,
        until_ns=aim_ns + round(exposure_s * NS_PER_S),
        lifted=tuple(lifted),
        kind=kind,
    )
