"""Random low satellites over random observatories, as paths that a telescope is to meet ahead."""

from dataclasses import dataclass

import numpy as np

from rsoconsole.orbits import PredictedPosition, PredictedSkyPath, propagate
from rsoconsole.orbits.motion.ahead import sky_path_through
from rsoconsole.pipeline import Leap, LeapParameters, MountMotion, NoLeap, Telescope, next_leap
from rsoconsole.sky import (
    Limits,
    Pose,
    altaz_to_icrs,
    icrs_of_hour_angle,
    line_of_sight_gcrs,
    site_gcrs,
    unit_to_direction,
    wrap_180,
)
from rsoconsole.words import NS_PER_S
from tests.truth.limits_by_astropy import Request
from tests.truth.limits_requests import OBSERVATORIES

MU_KM3_S2 = 398_600.4418
FIELD_DEG = (1.63, 1.24)
STEP_S, STEPS = 4.0, 60
PER_PATH = 4
"""Questions by one path: other places to begin from, other mounts, other cameras."""


@dataclass(frozen=True, eq=False)
class Asked:
    """One question, and its answer."""

    path: PredictedSkyPath
    start: Pose
    telescope: Telescope
    answer: Leap | NoLeap

    def request(self, leap: Leap) -> Request:
        """The same as a slew that ``limits_by_astropy`` judges."""
        return Request(
            now_ns=self.start.t_utc_ns,
            start=(self.start.ra_icrs_deg, self.start.dec_icrs_deg),
            side=self.start.pier_side,
            target=leap.place.direction_deg,
            aim_ns=leap.t_mid_utc_ns,
            until_ns=leap.t_close_utc_ns,
            lifted=tuple(self.telescope.lifted),
            kind="leap",
        )


def random_leaps(observatory: str, count: int, seed: int, judge: Limits | None = None):
    """``count`` questions at one observatory; ``judge``: other limits than its own."""
    random = np.random.default_rng([seed, len(observatory)])
    site, limits, mount = OBSERVATORIES[observatory]
    held = judge or Limits(site, limits, mount)
    for n in range(count):
        if n % PER_PATH == 0:
            now = int(random.integers(1_330_000_000, 1_780_000_000)) * NS_PER_S
            path = _path(site, now, random)
        rate = float(random.uniform(1.0, 8.0))
        telescope = Telescope(
            motion=MountMotion(
                rate_deg_s=rate,
                acceleration_deg_s2=float(rate / random.uniform(0.3, 3.0)),
                fixed_s=float(random.uniform(0.0, 1.0)),
                scatter_s=float(random.uniform(0.0, 0.3)),
                slews=20,
            ),
            terms=LeapParameters(
                field_deg=FIELD_DEG,
                scale_arcsec_px=1.26,
                settle_s=float(random.uniform(0.3, 3.0)),
                latency_s=float(random.uniform(0.0, 0.5)),
                readout_s=float(random.uniform(0.05, 2.0)),
            ),
            limits=held,
            lifted=("twilight", "Sun") if random.random() < 0.6 else (),
        )
        start = _start(site, path, now, random, is_german=mount.type == "german")
        yield Asked(path, start, telescope, next_leap(path, start, now, telescope))


def _path(site, now_ns, random) -> PredictedSkyPath:
    """A circle through a place above the site, some of it below the horizon."""
    altitude, azimuth = float(random.uniform(5.0, 89.0)), float(random.uniform(0.0, 360.0))
    ra, dec = altaz_to_icrs(site, altitude, azimuth, now_ns)
    line = line_of_sight_gcrs(np.array([ra]), np.array([dec]), np.array([now_ns]))[0]
    place = site_gcrs(site, np.array([now_ns]))[0][0]
    radius = 6_378.0 + float(random.uniform(350.0, 1_400.0))
    up = float(place @ line)
    reach = -up + np.sqrt(up * up - place @ place + radius * radius)
    r = place + reach * line
    across = np.cross(r, random.normal(size=3))
    v = across / np.linalg.norm(across) * np.sqrt(MU_KM3_S2 / np.linalg.norm(r))
    t = now_ns + (np.arange(STEPS) * STEP_S * NS_PER_S).astype(np.int64)
    since = np.arange(STEPS) * STEP_S
    sites, drift = site_gcrs(site, t)
    places, speeds = propagate(r, v, since)
    seen = places - sites
    size = np.linalg.norm(seen, axis=-1, keepdims=True)
    lines, turn = seen / size, (speeds - drift) / size
    ra, dec = unit_to_direction(lines)
    east = np.stack([-np.sin(np.radians(ra)), np.cos(np.radians(ra)), 0.0 * ra], axis=-1)
    north = np.cross(lines, east)
    rates = np.degrees(np.stack([np.sum(turn * a, axis=-1) for a in (east, north)], -1)) * 3600.0
    sigma = float(np.exp(random.uniform(0.0, np.log(900.0))))
    return sky_path_through(
        [
            PredictedPosition(
                t_utc_ns=int(t[n]),
                ra_icrs_deg=float(ra[n]),
                dec_icrs_deg=float(dec[n]),
                rate_arcsec_s=rates[n],
                covariance_arcsec2=np.eye(2) * sigma**2,
            )
            for n in range(STEPS)
        ]
    )


def _start(site, path, now_ns, random, *, is_german) -> Pose:
    """Where it was met before, or anywhere; sometimes by the pole, sometimes on no known side."""
    kind = random.random()
    if kind < 0.6:
        first = path.at(path.from_utc_ns)
        ra, dec = first.ra_icrs_deg, first.dec_icrs_deg
    else:
        hour_angle = float(wrap_180(random.uniform(-100.0, 100.0)))
        declination = float(random.uniform(86.0, 89.9) if kind > 0.9 else random.uniform(-40, 85))
        declination *= 1.0 if site.latitude_deg >= 0 or kind <= 0.9 else -1.0
        ra, dec = icrs_of_hour_angle(site, hour_angle, declination, now_ns)
    side = None
    if is_german and random.random() < 0.95:
        side = str(random.choice(["west", "east"]))
    return Pose(t_utc_ns=now_ns, ra_icrs_deg=ra, dec_icrs_deg=dec, pier_side=side)
