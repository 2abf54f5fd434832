"""Close approaches of real pairs, seen by a camera that blends what it cannot resolve.

Directions are SGP4's, of public element sets of 22 June 2023. What the camera makes of two streaks
is after the product's detector on rendered pairs (120 px long, FWHM 3.3 px, SNR 6): one where they
overlap and lie less than some two FWHM beside each other, in their middle by light across and as
long as both together; two from there on.
"""

import functools
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rsoconsole.config import Config
from rsoconsole.orbits import Satellite, parse_elements
from rsoconsole.pipeline.cycle.frame_fold import follow_settings
from rsoconsole.records import FloatArray, FrameTaken, Measurement, Missed, Site
from rsoconsole.sky import iso_to_utc_ns
from rsoconsole.tracking import (
    Following,
    FollowSettings,
    FrameInput,
    TangentPlane,
    follow,
    sky_covariance_arcsec2,
)
from rsoconsole.words import NS_PER_S

CADENCE_S, EXPOSURE_S = 30.0, 10.0
BLEND_ARCSEC = 8.0
"""Two FWHM of that camera."""
UNSEEN = 0.05


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two satellites that come close above a site."""

    elements: str
    site: Site
    start: str
    """UTC; closest half way through 240 frames."""


PAIRS = {
    "30.5E": Pair(
        elements="""
1 36745U 10032B   23173.09836576  .00000160  00000-0  00000+0 0  9997
2 36745   0.0542  37.3882 0005435  57.0109 241.5441  1.00274812 47689
1 44186U 19021A   23172.93444042  .00000160  00000-0  00000+0 0  9997
2 44186   0.0478 344.2687 0003590 161.4412 131.0342  1.00272666 15206
""",
        site=Site(latitude_deg=45.0, longitude_deg=30.0, elevation_m=200.0),
        start="2023-06-22T21:10:00Z",
    ),
    "30W": Pair(
        elements="""
1 37264U 10070A   23172.79960229 -.00000210  00000-0  00000+0 0  9992
2 37264   0.0493 108.8217 0005146   4.2938  54.4698  1.00272563 45729
1 43228U 18023A   23172.65628597 -.00000210  00000-0  00000+0 0  9999
2 43228   0.0458  46.1691 0005423  27.4817  42.1955  1.00271243 19554
""",
        site=Site(latitude_deg=10.0, longitude_deg=20.0, elevation_m=300.0),
        start="2023-06-23T18:15:00Z",
    ),
}


@dataclass(kw_only=True)
class Told:
    """What a night came to, in track-frames after both had a track."""

    counts: Counter[str] = field(default_factory=Counter)
    """``own``, ``other``'s or ``none`` of two streaks; ``blended``, or ``apart`` from it."""
    ended: int = 0
    """Tracks that ended."""
    off_sigmas: list[float] = field(default_factory=list)
    """Squared distance of the prediction from the truth in its covariance."""
    off_arcsec: list[float] = field(default_factory=list)


@functools.cache
def truth(name: str, frames: int) -> tuple[tuple[FloatArray, FloatArray], ...]:
    """Of each satellite directions (n, 2), deg, and rates on the sky (n, 2), arcsec/s."""
    pair = PAIRS[name]
    t = iso_to_utc_ns(pair.start) + np.arange(frames) * round(CADENCE_S * NS_PER_S)
    told = []
    for each in parse_elements(pair.elements.strip()):
        p = Satellite(each).astrometric_place(pair.site, t)
        cos_dec = np.cos(np.radians(p.dec_icrs_deg))
        rates = 3600.0 * np.stack([p.ra_rate_deg_s * cos_dec, p.dec_rate_deg_s], -1)
        told.append((np.stack([p.ra_icrs_deg, p.dec_icrs_deg], -1), rates))
    return tuple(told)


@functools.cache
def settings_of(name: str) -> FollowSettings:
    pair = PAIRS[name]
    site = {
        "latitude_deg": pair.site.latitude_deg,
        "longitude_deg": pair.site.longitude_deg,
        "elevation_m": pair.site.elevation_m,
    }
    frame = FrameTaken(
        frame_id=0,
        name="",
        t_start_utc_ns=iso_to_utc_ns(pair.start),
        exposure_s=EXPOSURE_S,
        width_px=4656,
        height_px=3520,
        pointing_ra_icrs_deg=None,
        pointing_dec_icrs_deg=None,
    )
    return follow_settings(Config.model_validate({"site": site}), frame)


def streaks(
    name: str, k: int, frames: int, random: np.random.Generator, *, scatter_s: float, light: float
) -> Mapping[str, Measurement]:
    """What a frame shows: ``a`` and ``b``, or both as ``ab``; ``light``: the share of ``a``."""
    both = truth(name, frames)
    plane = TangentPlane.at(*both[0][0][k])
    late_s = random.normal(0.0, scatter_s)
    places = [plane.project_arcsec(*place[k]) + rate[k] * late_s for place, rate in both]
    rate = both[0][1][k]
    along = rate / np.linalg.norm(rate)
    across = np.array([-along[1], along[0]])
    length = EXPOSURE_S * float(np.linalg.norm(rate))
    way = places[1] - places[0]
    is_blended = abs(way @ across) < BLEND_ARCSEC and abs(way @ along) < length
    shown: dict[str, tuple[FloatArray, float]] = {
        "a": (places[0], length),
        "b": (places[1], length),
    }
    if is_blended:
        middle = places[0] + along * (way @ along) / 2.0 + across * (way @ across) * (1.0 - light)
        shown = {"ab": (middle, length + abs(float(way @ along)))}
    cov = 0.6**2 * np.outer(along, along) + 0.2**2 * np.eye(2)
    found = {}
    for who, (place, long) in shown.items():
        if random.uniform() < UNSEEN:
            continue
        at = place + random.multivariate_normal(np.zeros(2), cov)
        half = 0.5 * long * along
        ra_deg, dec_deg = plane.direction_of(*at)
        found[who] = Measurement(
            measurement_id=f"{k}-{who}",
            frame_id=k,
            t_mid_utc_ns=iso_to_utc_ns(PAIRS[name].start) + round(k * CADENCE_S * NS_PER_S),
            ra_icrs_deg=ra_deg,
            dec_icrs_deg=dec_deg,
            cov_sky_arcsec2=(float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1])),
            x_px=0.0,
            y_px=0.0,
            confidence=0.99,
            source="network",
            ends_icrs_deg=(plane.direction_of(*(at - half)), plane.direction_of(*(at + half))),
        )
    return found


def night(name: str, frames: int, seed: int, scatter_s: float = 0.015, light: float = 0.5) -> Told:
    """One approach from search on."""
    random, told = np.random.default_rng(seed), Told()
    following, settings, whose = Following(state="SEARCH"), settings_of(name), dict[int, str]()
    both = truth(name, frames)
    for k in range(frames):
        shown = streaks(name, k, frames, random, scatter_s=scatter_s, light=light)
        t_utc_ns = iso_to_utc_ns(PAIRS[name].start) + round(k * CADENCE_S * NS_PER_S)
        seen = FrameInput(
            frame_id=k,
            t_mid_utc_ns=t_utc_ns,
            exposure_s=EXPOSURE_S,
            measurements=tuple(shown.values()),
            absence=Missed(kind="no detection"),
        )
        before = {each.track.track_id for each in following.tracks}
        following, records = follow(following, seen, settings)
        alive = {each.track.track_id for each in following.tracks}
        told.ended += len(before & set(whose) - alive)
        for each in following.tracks:
            taken = each.taken if each.taken and each.taken.frame_id == k else None
            said = None if taken is None else taken.measurement_id.split("-")[1]
            own = whose.get(each.track.track_id)
            if own is None:
                if said in {"a", "b"}:
                    whose[each.track.track_id] = said
                continue
            if own in shown:
                told.counts["own" if said == own else "none" if said is None else "other"] += 1
            elif "ab" in shown:
                told.counts["blended" if said == "ab" else "apart"] += 1
        for state in records:
            own = whose.get(getattr(state, "track_id", -1))
            if own is None or getattr(state, "kind", "") != "predicted" or k < 10:
                continue
            place = both["ab".index(own)][0][k]
            off = TangentPlane.at(*place).project_arcsec(state.x[0], state.x[2])
            told.off_arcsec.append(float(np.hypot(*off)))
            spread = sky_covariance_arcsec2(state)
            told.off_sigmas.append(float(off @ np.linalg.solve(spread, off)))
    return told
