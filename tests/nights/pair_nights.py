"""Pairs of satellites as frames show them, record by record: SGP4 is the truth, errors are drawn.

Each streak errs by what it states and by what the lens does to it; both of a frame err alike by a
plate that is off and a shutter that is late.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from rsoconsole.orbits import CatalogueEntry, object_places, parse_element_sets, states_gcrs
from rsoconsole.records import FrameTaken, Measurement, Record, Site, TrackState
from rsoconsole.sky import site_gcrs
from tests.truth.regimes import TLES

NS = 1_000_000_000
BEGIN_UTC_NS = 1_687_392_000 * NS
"""Within a day of the elements."""
LENS_ARCSEC, PLATE_ARCSEC, LATE_S = 0.5, 5.0, 0.2
WIDEST_DEG = 1.2
_OF_A_SITE = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class PairNight:
    """Two satellites and the frames that show them."""

    site: Site
    entries: tuple[CatalogueEntry, CatalogueEntry]
    t_utc_ns: np.ndarray
    """(N,) of the frames."""
    records: tuple[Record, ...]


@cache
def geostationary() -> tuple[CatalogueEntry, ...]:
    text = (TLES / "geo_all_20230622.tle").read_text(encoding="utf-8")
    return parse_element_sets(text).entries


def directions(
    entries: Sequence[CatalogueEntry], site: Site, t_utc_ns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """RA and Dec (M, N) as a plate solution measures them."""
    places = [object_places(each, site, t_utc_ns) for each in entries]
    ra_deg = np.stack([each.ra_icrs_deg for each in places])
    return ra_deg, np.stack([each.dec_icrs_deg for each in places])


def near_pairs(
    site: Site, t_utc_ns: int, within_deg: float
) -> list[tuple[CatalogueEntry, CatalogueEntry]]:
    """Those that stand near each other, high enough."""
    entries, t = geostationary(), np.array([t_utc_ns])
    at_km = site_gcrs(site, t)[0]
    line = states_gcrs(entries, t)[0][:, 0] - at_km
    line /= np.linalg.norm(line, axis=-1, keepdims=True)
    up = np.flatnonzero(line @ at_km[0] / np.linalg.norm(at_km) > np.sin(np.radians(25.0)))
    cosine = line[up] @ line[up].T
    one, other = np.nonzero(np.triu(cosine > np.cos(np.radians(within_deg)), 1))
    return [
        (entries[up[i]], entries[up[j]])
        for i, j in zip(one, other, strict=True)
        # Docked, and twice in the file.
        if cosine[i, j] < 1.0 - 1e-12 and entries[up[i]].norad_id != entries[up[j]].norad_id
    ]


def random_nights(
    random: np.random.Generator, count: int, within_deg: float = 0.7
) -> list[PairNight]:
    """Any pairs, some from each site, seen for 10 minutes to 3 hours; a tenth of frames misses."""
    found: list[PairNight] = []
    while len(found) < count:
        site = Site(
            latitude_deg=random.uniform(-50.0, 55.0),
            longitude_deg=random.uniform(-180.0, 180.0),
            elevation_m=0.0,
        )
        t_last = BEGIN_UTC_NS + int(random.uniform(0.0, 86_400.0)) * NS
        pairs = near_pairs(site, t_last, within_deg)
        for number in random.permutation(len(pairs))[:_OF_A_SITE]:
            arc_s = random.choice([600, 1800, 3600, 10_800])
            t = t_last - np.arange(arc_s // 60, -1, -1) * 60 * NS
            night = seen(random, pairs[number], site, t, misses=0.1)
            found += [night] if night is not None else []
    return found[:count]


def seen(
    random: np.random.Generator,
    pair: tuple[CatalogueEntry, CatalogueEntry],
    site: Site,
    t_utc_ns: np.ndarray,
    *,
    misses: float = 0.0,
) -> PairNight | None:
    """The frames of two; None where they do not fit into one field all the time."""
    places = [object_places(each, site, t_utc_ns) for each in pair]
    ra_deg = np.stack([each.ra_icrs_deg for each in places])
    dec_deg = np.stack([each.dec_icrs_deg for each in places])
    ra_rate = np.stack([each.ra_rate_deg_s for each in places])
    dec_rate = np.stack([each.dec_rate_deg_s for each in places])
    level = np.cos(np.radians(dec_deg))
    apart = np.hypot((ra_deg[1] - ra_deg[0]) * level[0], dec_deg[1] - dec_deg[0])
    if not np.all(apart < WIDEST_DEG):
        return None
    rate = 3600.0 * np.stack([ra_rate * level, dec_rate], axis=-1)
    ahead = rate / np.linalg.norm(rate, axis=-1, keepdims=True)
    along = random.uniform(0.3, 3.0)
    across = random.uniform(0.2, 1.0) * along
    aside = np.stack([-ahead[..., 1], ahead[..., 0]], axis=-1)
    count = len(t_utc_ns)
    errors = along * random.standard_normal((2, count, 1)) * ahead
    errors += across * random.standard_normal((2, count, 1)) * aside
    errors += LENS_ARCSEC * random.standard_normal((2, count, 2))
    errors += PLATE_ARCSEC * random.standard_normal((1, count, 2))
    errors += LATE_S * random.standard_normal((1, count, 1)) * rate
    covariance = along**2 * _outer(ahead) + across**2 * _outer(aside)
    is_seen = random.random((2, count)) >= misses
    is_seen[:, -1] = True
    records: list[Record] = []
    for n in range(count):
        records.append(frame_taken(n + 1, int(t_utc_ns[n])))
        for track in (0, 1):
            place = (
                float(ra_deg[track, n] + errors[track, n, 0] / 3600.0 / level[track, n]) % 360.0,
                float(dec_deg[track, n] + errors[track, n, 1] / 3600.0),
            )
            told = track_records(
                n + 1,
                track + 1,
                int(t_utc_ns[n]),
                place,
                (float(ra_rate[track, n]), float(dec_rate[track, n])),
                covariance[track, n],
                is_seen=bool(is_seen[track, n]),
            )
            records += told
    return PairNight(site=site, entries=pair, t_utc_ns=t_utc_ns, records=tuple(records))


def frame_taken(frame_id: int, t_utc_ns: int, **changes) -> FrameTaken:
    values = {
        "frame_id": frame_id,
        "name": f"{frame_id}",
        "t_start_utc_ns": t_utc_ns - 5 * NS,
        "exposure_s": 10.0,
        "width_px": 4656,
        "height_px": 3520,
        "pointing_ra_icrs_deg": None,
        "pointing_dec_icrs_deg": None,
    }
    return FrameTaken(**(values | changes))


def track_records(  # noqa: PLR0917 -- a record's parts, each another thing
    frame_id: int,
    track_id: int,
    t_utc_ns: int,
    place_deg: tuple[float, float],
    rate_deg_s: tuple[float, float],
    covariance: np.ndarray,
    *,
    is_seen: bool = True,
) -> Iterator[Record]:
    """A measurement and the track that took it, or the track alone."""
    named = f"{frame_id}-{track_id}"
    if is_seen:
        yield Measurement(
            measurement_id=named,
            frame_id=frame_id,
            t_mid_utc_ns=t_utc_ns,
            ra_icrs_deg=place_deg[0],
            dec_icrs_deg=place_deg[1],
            cov_sky_arcsec2=(covariance[0, 0], covariance[0, 1], covariance[1, 1]),
            x_px=1000.0 * track_id,
            y_px=1000.0,
            confidence=0.9,
            source="network",
        )
    yield TrackState(
        track_id=track_id,
        kind="updated" if is_seen else "predicted",
        frame_id=frame_id,
        t_utc_ns=t_utc_ns,
        x=(place_deg[0], rate_deg_s[0], place_deg[1], rate_deg_s[1]),
        P=tuple(tuple(1e-8 * (i == j) for j in range(4)) for i in range(4)),
        measurement_id=named if is_seen else None,
        misses=0 if is_seen else 1,
        innovations=frame_id,
        is_lead=track_id == 1,
    )


def _outer(unit: np.ndarray) -> np.ndarray:
    return unit[..., :, None] * unit[..., None, :]
