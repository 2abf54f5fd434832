"""Nights of real slots for several trackers: SGP4's directions of catalogued satellites, spoilt.

Truth is SGP4's of published element sets that the project did not make. What a tracker gets of a
frame: streaks with own noise, all late or early by what the shutter errs, a tenth of them gone,
and false ones beside them that move as the slot does. Places are arcsec east and north of a point
that turns with the Earth, in which a slot all but stands still.
"""

import functools
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rsoconsole.orbits import Satellite, parse_elements
from rsoconsole.records import FloatArray, Measurement, Site
from rsoconsole.sky import IntArray, SkyPlaces, wrap_180
from rsoconsole.words import NS_PER_S
from tests.truth.seen_satellites import SHARED

ELEMENTS = SHARED / "tles" / "geo_all_20230622.tle"
SITE = Site(latitude_deg=45.0, longitude_deg=10.0, elevation_m=200.0)
FRAMES, CADENCE_S, EXPOSURE_S = 30, 30.0, 10.0
SHUTTER_S = 0.2
"""Scatter of a frame's time: one error for all streaks of the frame, 3 arcsec along the motion."""
SHUTTERS_S = (0.015, 0.5)
"""Of nights whose scatter nobody knows: evenly in its logarithm."""
ALONG_ARCSEC, ACROSS_ARCSEC = 0.5, 0.2
"""Sigma of a streak's middle, its own."""
DETECTED, FALSE, BOX_ARCSEC = 0.9, 2.0, 1080.0
"""Chance of each streak; false ones a frame (Poisson), in a square about the slot."""
DAY_RATE_DEG_S = 15.041068639 / 3600.0
_DAY_UTC_NS = 1_687_400_000 * NS_PER_S

_TIMING_S = 0.015


@dataclass(frozen=True, slots=True, kw_only=True)
class Slot:
    """Satellites of one field, and when they are looked at."""

    title: str
    norad_ids: tuple[int, ...]
    middle_h: float
    """After 2023-06-22T02:13:20Z."""
    spread_h: float
    """Nights lie so far about it, evenly."""
    is_shutter_known: bool = True
    """Whether every night has the scatter that the peers are told."""


_KNOWN = {
    "19.2E": Slot(
        title="Astra 19.2 E",
        norad_ids=(29055, 31306, 33436, 37775),
        middle_h=21.0,
        spread_h=3.0,
    ),
    "26E": Slot(
        title="Badr 5 to 7, Es'hail 2, 26 E",
        norad_ids=(33154, 36592, 41029, 43700),
        middle_h=21.0,
        spread_h=3.0,
    ),
    "13E": Slot(
        title="Hot Bird 13 E", norad_ids=(28946, 29270, 54225), middle_h=21.0, spread_h=3.0
    ),
    "30W": Slot(
        title="Hispasat 30 W, two within 8 arcsec",
        norad_ids=(28945, 37264, 43228),
        middle_h=17.33,
        spread_h=0.1,
    ),
    "30.5E": Slot(
        title="Arabsat 30.5 E, two within 11 arcsec",
        norad_ids=(36745, 44186),
        middle_h=19.83,
        spread_h=0.1,
    ),
}
SLOTS = _KNOWN | {
    f"{name}-any": replace(each, title=f"{each.title}; any shutter", is_shutter_known=False)
    for name, each in _KNOWN.items()
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Sight:
    """What one frame showed."""

    t_utc_ns: int
    measurements: tuple[Measurement, ...]
    places: FloatArray
    """(streaks, 2) arcsec."""
    rate: FloatArray
    """(2,) of the slot against the stars, arcsec/s: along it the shutter errs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Night:
    """Frames, and the truth that only the judge may see."""

    frames: tuple[Sight, ...]
    truth: FloatArray
    """(frames, satellites, 2) arcsec."""
    owner: dict[str, int]
    """Satellite of each true streak, by its measurement's id."""
    origin_deg: tuple[float, float]

    def project_arcsec(self, ra_icrs_deg: float, dec_icrs_deg: float, t_utc_ns: int) -> FloatArray:
        """A direction as arcsec east and north."""
        return _place(self.origin_deg, self.frames[0].t_utc_ns, ra_icrs_deg, dec_icrs_deg, t_utc_ns)


def drawn(name: str, seed: int, frames: int = FRAMES) -> Night:
    """One night of a slot."""
    random = np.random.default_rng([seed, list(SLOTS).index(name)])
    slot = SLOTS[name]
    shutter_s = SHUTTER_S
    if not slot.is_shutter_known:
        shutter_s = math.exp(random.uniform(*np.log(SHUTTERS_S)))
    middle_s = 3600.0 * (slot.middle_h + random.uniform(-slot.spread_h, slot.spread_h))
    t = _DAY_UTC_NS + round((middle_s - frames * CADENCE_S / 2.0) * NS_PER_S)
    t = t + np.arange(frames, dtype=np.int64) * round(CADENCE_S * NS_PER_S)
    late_s = random.normal(0.0, shutter_s, frames)
    true, shown = _places(slot.norad_ids, t), _places(slot.norad_ids, t + _ns(late_s))
    first = true[0]
    origin = float(first.ra_icrs_deg[0]), float(first.dec_icrs_deg[0])
    truth = np.stack(
        [_place(origin, int(t[0]), p.ra_icrs_deg, p.dec_icrs_deg, t) for p in true], axis=1
    )
    seen, owner = [], dict[str, int]()
    for k in range(frames):
        streaks = [(n, *_at(p, k)) for n, p in enumerate(shown) if random.random() < DETECTED]
        middle = np.mean([_at(p, k)[0] for p in shown], axis=0)
        rate = np.mean([_at(p, k)[1] for p in shown], axis=0)
        for _ in range(random.poisson(FALSE)):
            away = random.uniform(-BOX_ARCSEC / 2.0, BOX_ARCSEC / 2.0, 2) / 3600.0
            where = middle + away / np.array([math.cos(math.radians(origin[1])), 1.0])
            streaks.append((-1, where, rate))
        measurements = []
        for number, place in enumerate(random.permutation(len(streaks))):
            whose, where, moves = streaks[place]
            m = _streak(k, number, int(t[k]), where, moves, random)
            measurements.append(m)
            if whose >= 0:
                owner[m.measurement_id] = whose
        seen.append(
            Sight(
                t_utc_ns=int(t[k]),
                measurements=tuple(measurements),
                places=np.array(
                    [
                        _place(origin, int(t[0]), m.ra_icrs_deg, m.dec_icrs_deg, int(t[k]))
                        for m in measurements
                    ]
                ).reshape(-1, 2),
                rate=rate,
            )
        )
    return Night(frames=tuple(seen), truth=truth, owner=owner, origin_deg=origin)


def shared_covariance(rate: FloatArray, shutter_s: float) -> FloatArray:
    """(2, 2) arcsec^2 of what a shutter's scatter adds to every streak of a frame."""
    return np.asarray(shutter_s**2 * np.outer(rate, rate))


@functools.cache
def _satellites() -> dict[int, Satellite]:
    wanted = {norad for slot in SLOTS.values() for norad in slot.norad_ids}
    text = Path(ELEMENTS).read_text(encoding="utf-8")
    return {e.norad_id: Satellite(e) for e in parse_elements(text) if e.norad_id in wanted}


def _places(norad_ids: tuple[int, ...], t_utc_ns: IntArray) -> list[SkyPlaces]:
    return [_satellites()[norad].astrometric_place(SITE, t_utc_ns) for norad in norad_ids]


def _ns(seconds: FloatArray) -> IntArray:
    return np.round(seconds * NS_PER_S).astype(np.int64)


def _place(origin_deg, t0_utc_ns, ra_deg, dec_deg, t_utc_ns) -> FloatArray:  # type: ignore[no-untyped-def]
    turned = DAY_RATE_DEG_S * (t_utc_ns - t0_utc_ns) / NS_PER_S
    east = wrap_180(ra_deg - turned - origin_deg[0]) * math.cos(math.radians(origin_deg[1]))
    return 3600.0 * np.stack([east, dec_deg - origin_deg[1]], axis=-1)


def _at(places: SkyPlaces, k: int) -> tuple[FloatArray, FloatArray]:
    """Direction, deg, and rate, arcsec/s east and north."""
    dec = float(places.dec_icrs_deg[k])
    rate = [places.ra_rate_deg_s[k] * math.cos(math.radians(dec)), places.dec_rate_deg_s[k]]
    return np.array([float(places.ra_icrs_deg[k]), dec]), 3600.0 * np.array(rate)


def _streak(  # noqa: PLR0917 -- which, when, where, how it moves
    k: int,
    number: int,
    t_utc_ns: int,
    where_deg: FloatArray,
    rate: FloatArray,
    random: np.random.Generator,
) -> Measurement:
    ahead = rate / np.hypot(*rate)
    across = np.array([-ahead[1], ahead[0]])
    own = ALONG_ARCSEC**2 * np.outer(ahead, ahead) + ACROSS_ARCSEC**2 * np.outer(across, across)
    stated = own + _TIMING_S**2 * np.outer(rate, rate)
    to_deg = np.array([1.0 / math.cos(math.radians(where_deg[1])), 1.0]) / 3600.0
    at = where_deg + random.multivariate_normal(np.zeros(2), own) * to_deg
    half = rate * EXPOSURE_S / 2.0
    ends = [at + (sign * half + random.normal(0.0, 0.5, 2)) * to_deg for sign in (-1.0, 1.0)]
    return Measurement(
        measurement_id=f"{k + 1}-{number}",
        frame_id=k + 1,
        t_mid_utc_ns=t_utc_ns,
        ra_icrs_deg=float(at[0]) % 360.0,
        dec_icrs_deg=float(at[1]),
        cov_sky_arcsec2=(float(stated[0, 0]), float(stated[0, 1]), float(stated[1, 1])),
        x_px=0.0,
        y_px=0.0,
        confidence=float(random.uniform(0.5, 0.99)),
        source="network",
        ends_icrs_deg=tuple((float(e[0]) % 360.0, float(e[1])) for e in ends),  # type: ignore[arg-type]
    )
