"""Distance and phase of a measurement, against skyfield's places and astropy's Sun."""

import math
from dataclasses import replace

import numpy as np
import pytest

from rsoconsole.orbits import parse_elements
from rsoconsole.orbits.elements.catalogue import entry_of_lines
from rsoconsole.pipeline.orbits.ranges import ranges_by_elements, ranges_by_orbit
from rsoconsole.records import Site
from rsoconsole.sky import iso_to_utc_ns
from tests.nights.orbit_night import estimate_of

NS = 1_000_000_000
LINES = {
    "geostationary": """1 36097U 09064A   23174.20000000 -.00000278  00000-0  00000-0 0  9991
2 36097   0.0150  90.0000 0002800  45.0000 120.0000  1.00272000 49997""",
    "low": """1 25544U 98067A   23174.20000000  .00010000  00000-0  18000-3 0  9992
2 25544  51.6400 120.0000 0005000  60.0000 300.0000 15.50000000400000""",
}
T = iso_to_utc_ns("2023-06-23T05:00:00Z")
SINCE_S = (0, 60, 300)
SITE = Site(latitude_deg=29.19, longitude_deg=-81.05, elevation_m=10.0)


def truth(kind: str) -> tuple[list[tuple[float, float]], np.ndarray, np.ndarray]:
    """Ranges and phases, and the state at ``T``, km and km/s along GCRS axes."""
    from astropy.coordinates import get_sun
    from astropy.time import Time
    from skyfield.api import EarthSatellite, load, wgs84

    scale = load.timescale(builtin=True)
    satellite = EarthSatellite(*LINES[kind].splitlines(), ts=scale)
    station = wgs84.latlon(SITE.latitude_deg, SITE.longitude_deg, elevation_m=SITE.elevation_m)
    found = []
    for since_s in SINCE_S:
        t = scale.utc(2023, 6, 23, 5, 0, since_s)
        position, seen = satellite.at(t).position.km, (satellite - station).at(t)
        instant = Time(f"2023-06-23T05:{since_s // 60:02d}:00", scale="utc")
        to_sun = get_sun(instant).cartesian.xyz.to_value("km") - position
        cosine = np.dot(to_sun, -seen.position.km) / np.linalg.norm(to_sun) / seen.distance().km
        found.append((seen.distance().km, math.degrees(math.acos(cosine))))
    first = satellite.at(scale.utc(2023, 6, 23, 5, 0, 0))
    return found, first.position.km, first.velocity.km_per_s


@pytest.mark.parametrize(("kind", "off_km"), [("geostationary", 3.0), ("low", 1.0)])
def test_elements_give_distance_and_phase_as_others_compute_them(kind: str, off_km: float):
    # Within a light time the object moves 0.4 km (geostationary), 15 m (low), the Earth 30 km/s.
    expected, _, _ = truth(kind)
    entry = entry_of_lines(parse_elements(LINES[kind])[0])
    found = ranges_by_elements(entry, SITE, [T + s * NS for s in SINCE_S])
    for mine, (range_km, phase_deg) in zip(found, expected, strict=True):
        assert mine is not None
        assert mine.range_km == pytest.approx(range_km, abs=off_km)
        assert mine.phase_deg == pytest.approx(phase_deg, abs=0.03)


@pytest.mark.parametrize("kind", LINES)
def test_an_orbit_on_record_gives_them_for_all_of_its_track(kind: str):
    expected, r_km, v_km_s = truth(kind)
    estimate = estimate_of(
        20,
        epoch_utc_ns=T,
        r_gcrs_km=tuple(map(float, r_km)),
        v_gcrs_km_s=tuple(map(float, v_km_s)),
    )
    found = ranges_by_orbit(estimate, SITE, [T + s * NS for s in SINCE_S])
    for mine, (range_km, phase_deg) in zip(found, expected, strict=True):
        assert mine is not None
        assert mine.range_km == pytest.approx(range_km, abs=5.0)
        assert mine.phase_deg == pytest.approx(phase_deg, abs=0.1)


@pytest.mark.parametrize("label", ["weak geometry", "not observable"])
def test_an_orbit_without_a_sure_distance_gives_none(label: str):
    estimate = replace(estimate_of(20), label=label)
    assert ranges_by_orbit(estimate, SITE, [T, T + NS]) == (None, None)


def test_no_measurement_has_no_range():
    assert ranges_by_orbit(estimate_of(20), SITE, []) == ()
