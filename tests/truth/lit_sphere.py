"""Magnitude of a diffuse sphere on an orbit: distance, phase and shadow by skyfield alone."""

import math
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import skyfield_data
from sgp4.api import Satrec

from rsoconsole.records import Site


class Sphere(NamedTuple):
    """What the sphere looks like from the site, (N,)."""

    range_km: np.ndarray
    phase_deg: np.ndarray
    is_lit: np.ndarray


def lambert_mag(standard_mag: float, range_km: float, phase_deg: float) -> float:
    """Apparent magnitude by that at 1000 km and a phase angle of 90 deg."""
    phase = math.radians(phase_deg)
    light = math.sin(phase) + (math.pi - phase) * math.cos(phase)
    return standard_mag + 5.0 * math.log10(range_km / 1000.0) - 2.5 * math.log10(light)


def sphere_by_skyfield(record: Satrec, site: Site, t_utc_ns: Any) -> Sphere:
    """Distances, phases and whether it is lit; geometric, without light time."""
    from skyfield.api import EarthSatellite, load, load_file, wgs84

    scale = load.timescale(builtin=True)
    instants = np.atleast_1d(np.asarray(t_utc_ns, np.int64))
    # From the day's beginning on: since 1970 there were leap seconds.
    day = datetime.fromtimestamp(int(instants[0]) // 86_400_000_000_000 * 86_400, tz=UTC)
    seconds = (instants - int(day.timestamp()) * 1_000_000_000) / 1e9
    t = scale.utc(day.year, day.month, day.day, 0, 0, seconds)
    satellite = EarthSatellite.from_satrec(record, scale)
    place = wgs84.latlon(site.latitude_deg, site.longitude_deg, site.elevation_m)
    line = (satellite - place).at(t).position.km
    position = satellite.at(t).position.km
    planets = load_file(str(Path(skyfield_data.__file__).parent / "data" / "de421.bsp"))
    try:
        to_sun = (planets["sun"] - planets["earth"]).at(t).position.km - position
        is_lit = satellite.at(t).is_sunlit(planets)
    finally:
        planets.close()
    range_km = np.linalg.norm(line, axis=0)
    cosine = np.sum(to_sun * -line, axis=0) / np.linalg.norm(to_sun, axis=0) / range_km
    return Sphere(range_km, np.degrees(np.arccos(cosine)), is_lit)
