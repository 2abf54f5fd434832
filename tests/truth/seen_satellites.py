"""Directions of made-up satellites. Their places come by SGP4 and ``Satellite``, which agrees with
skyfield (``tests/orbits/test_places.py``); nothing that fits or compares orbits has a part in
them."""

import math
from pathlib import Path

import numpy as np
from sgp4.api import WGS72, Satrec
from sgp4.exporter import export_tle

from rsoconsole.orbits import (
    ElementSet,
    MeasuredDirections,
    Satellite,
    parse_elements,
    reduce_directions,
)
from rsoconsole.records import Site
from rsoconsole.sky import IntArray
from rsoconsole.words import NS_PER_DAY, NS_PER_S
from tests.truth.sidereal import gmst_deg

SHARED = Path(__file__).parents[3] / "shared" / "data"
DAYTONA = Site(latitude_deg=29.19, longitude_deg=-81.05, elevation_m=10.0)
T0_UTC_NS = 1_687_400_000 * NS_PER_S


def geostationary(
    norad_id: int,
    longitude_deg: float,
    *,
    e: float = 2e-4,
    perigee_deg: float = 40.0,
    i_deg: float = 0.05,
    node_deg: float = 80.0,
    epoch_utc_ns: int = T0_UTC_NS,
    name: str = "",
) -> ElementSet:
    """Elements of a satellite that stands over a longitude."""
    record = Satrec()
    mean_deg = longitude_deg + float(gmst_deg(epoch_utc_ns)) - perigee_deg - node_deg
    record.sgp4init(
        WGS72,
        "i",
        norad_id,
        epoch_utc_ns / NS_PER_DAY + 7306,  # days since 1949-12-31
        0.0,
        0.0,
        0.0,
        e,
        math.radians(perigee_deg % 360.0),
        math.radians(i_deg),
        math.radians(mean_deg % 360.0),
        1.00271 * 2.0 * math.pi / 1440.0,
        math.radians(node_deg % 360.0),
    )
    record.intldesg = "23001A"
    lines = "\n".join(export_tle(record))
    return parse_elements(f"{name}\n{lines}" if name else lines)[0]


def instants(since_s: float, count: int = 20, cadence_s: float = 30.0) -> IntArray:
    """When frames are taken."""
    return np.asarray(
        T0_UTC_NS + round(since_s * NS_PER_S) + np.arange(count) * round(cadence_s * NS_PER_S),
        np.int64,
    )


def seen(
    elements: ElementSet,
    t_utc_ns: IntArray,
    *,
    sigma_arcsec: float = 1.0,
    random: np.random.Generator | None = None,
    site: Site = DAYTONA,
) -> MeasuredDirections:
    """Directions with noise; without ``random`` they are exact, and claim the same sigma."""
    places = Satellite(elements).astrometric_place(site, t_utc_ns)
    noise = np.zeros((len(t_utc_ns), 2))
    if random is not None:
        noise = random.normal(0.0, sigma_arcsec / 3600.0, noise.shape)
    ra = places.ra_icrs_deg + noise[:, 0] / np.cos(np.radians(places.dec_icrs_deg))
    cov = np.tile([sigma_arcsec**2, 0.0, sigma_arcsec**2], (len(t_utc_ns), 1))
    return reduce_directions(site, t_utc_ns, ra % 360.0, places.dec_icrs_deg + noise[:, 1], cov)
