"""Twelve satellites in one slot: real element sets of the belt, each moved along it into one box.

What the elements say of eccentricity, inclination and node stays, so the members swing about each
other as kept satellites do; only the mean anomaly is another. Places are SGP4's.
"""

import functools
import math
from pathlib import Path

import numpy as np

from rsoconsole.orbits import ElementSet, Satellite, parse_elements
from rsoconsole.orbits.elements.elements import checksum
from rsoconsole.records import Measurement, Missed
from rsoconsole.simulator import elements_path
from rsoconsole.sky import SkyPlaces
from rsoconsole.tracking import FrameInput
from rsoconsole.words import NS_PER_S
from tests.truth.seen_satellites import DAYTONA
from tests.truth.sidereal import gmst_deg

MEMBERS = 12
SLOT_DEG = -61.0
HALF_BOX_DEG = 0.1
T0_UTC_NS = 1_687_406_400 * NS_PER_S
CADENCE_S, EXPOSURE_S = 30.0, 10.0


@functools.cache
def members() -> tuple[ElementSet, ...]:
    """The twelve, from west to east."""
    text = Path(elements_path()).read_text(encoding="utf-8")
    wanted_deg = np.linspace(SLOT_DEG - HALF_BOX_DEG, SLOT_DEG + HALF_BOX_DEG, MEMBERS)
    return tuple(
        _moved(_moved(each, float(longitude_deg)), float(longitude_deg))
        for each, longitude_deg in zip(parse_elements(text), wanted_deg, strict=False)
    )


def _moved(elements: ElementSet, longitude_deg: float) -> ElementSet:
    """The same orbit with the satellite over a longitude at the first frame."""
    r, _ = Satellite(elements).position_gcrs(np.array([T0_UTC_NS]))
    stands_deg = math.degrees(math.atan2(r[0, 1], r[0, 0])) - float(gmst_deg(T0_UTC_NS))
    before = elements.line_2
    anomaly_deg = (float(before[43:51]) + longitude_deg - stands_deg) % 360.0
    line = f"{before[:43]}{anomaly_deg:8.4f}{before[51:68]}"
    text = f"{elements.name}\n{elements.line_1}\n{line}{checksum(line + '0')}"
    return parse_elements(text)[0]


@functools.cache
def places(late_s: tuple[float, ...]) -> tuple[SkyPlaces, ...]:
    """Where each was when the shutter really opened."""
    t = T0_UTC_NS + np.arange(len(late_s)) * round(CADENCE_S * NS_PER_S)
    t = t + np.round(np.array(late_s) * NS_PER_S).astype(np.int64)
    return tuple(Satellite(each).astrometric_place(DAYTONA, t) for each in members())


def instant(k: int) -> int:
    """Middle of a frame."""
    return T0_UTC_NS + k * round(CADENCE_S * NS_PER_S)


def streak(
    k: int, name: object, at: SkyPlaces, random: np.random.Generator, *, leads: bool
) -> Measurement:
    """A member's measurement, half an arcsec along and a fifth across."""
    dec = float(at.dec_icrs_deg[k])
    cos_dec = math.cos(math.radians(dec))
    rate = np.array([at.ra_rate_deg_s[k] * cos_dec, at.dec_rate_deg_s[k]]) * 3600.0
    ahead = rate / np.hypot(*rate)
    cov = 0.5**2 * np.outer(ahead, ahead) + 0.2**2 * np.eye(2)
    east, north = random.multivariate_normal(np.zeros(2), cov) / 3600.0
    ra, dec = float(at.ra_icrs_deg[k] + east / cos_dec), dec + float(north)
    half = rate * EXPOSURE_S / 2.0 / 3600.0
    ends = [
        (ra + sign * half[0] / cos_dec, dec + sign * half[1] + random.normal(0.0, 0.5) / 3600.0)
        for sign in (-1.0, 1.0)
    ]
    return Measurement(
        measurement_id=f"{k}-{name}",
        frame_id=k,
        t_mid_utc_ns=instant(k),
        ra_icrs_deg=ra % 360.0,
        dec_icrs_deg=dec,
        cov_sky_arcsec2=(float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1])),
        x_px=0.0,
        y_px=0.0,
        confidence=1.0 if leads else 0.8,
        source="network",
        ends_icrs_deg=(ends[0], ends[1]),
    )


def frames(
    count: int, shown: int = MEMBERS, *, scatter_s: float = 0.05, seed: int = 12
) -> list[FrameInput]:
    """What ``count`` frames show of the first ``shown`` members; nine of ten after the second."""
    random = np.random.default_rng(seed)
    late_s = tuple(random.normal(0.0, scatter_s, count).tolist())
    every = places(late_s)[:shown]
    told = []
    for k in range(count):
        streaks = tuple(
            streak(k, number, at, random, leads=number == 0)
            for number, at in enumerate(every)
            if k < 2 or shown == 1 or random.random() < 0.9
        )
        told.append(
            FrameInput(
                frame_id=k,
                t_mid_utc_ns=instant(k),
                exposure_s=EXPOSURE_S,
                measurements=streaks,
                absence=Missed(kind="no detection"),
            )
        )
    return told
