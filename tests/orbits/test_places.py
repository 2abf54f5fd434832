"""The place of a satellite among catalogue stars, against skyfield with the same inputs.

Inputs, not code, are shared: the element sets, UT1-UTC and the pole's position.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.orbits import ElementSet, Orbit, Satellite, parse_elements, predict
from rsoconsole.orbits.determination.fit import OrbitFit
from rsoconsole.records import Site
from rsoconsole.sky import direction_to_unit, places, separation_deg, times, wrap_180

PAIRS_AN_EPOCH = 25
HUNDREDTH_ARCSEC = 0.01
DAYTONA = Site(latitude_deg=29.19, longitude_deg=-81.05, elevation_m=10.0)


def element_set(rng: np.random.Generator, t_utc_ns: int, regime: str) -> ElementSet:
    """A random orbit whose epoch lies within a day of the instant."""
    from sgp4.api import WGS72, Satrec
    from sgp4.exporter import export_tle

    is_geo = regime == "GEO"
    revolutions_a_day = rng.uniform(0.99, 1.015) if is_geo else rng.uniform(14.0, 15.7)
    record = Satrec()
    record.sgp4init(
        WGS72,
        "i",
        90000,
        t_utc_ns / times.NS_PER_DAY + 7306 + rng.uniform(-1, 1),  # days since 1949-12-31
        0.0 if is_geo else rng.uniform(0, 1e-4),
        0.0,
        0.0,
        rng.uniform(1e-5, 5e-3),
        rng.uniform(0, 2 * math.pi),
        math.radians(rng.uniform(0.01, 15) if is_geo else rng.uniform(20, 100)),
        rng.uniform(0, 2 * math.pi),
        revolutions_a_day * 2 * math.pi / 1440,
        rng.uniform(0, 2 * math.pi),
    )
    return parse_elements("\n".join(export_tle(record)))[0]


def site_below(rng: np.random.Generator, satellite: Satellite, t_utc_ns: int) -> Site:
    """A site from which the satellite stands above the horizon or nearly."""
    position, _ = satellite.position_gcrs(np.array([t_utc_ns]))
    x, y, z = position[0]
    spread_deg = 60 if np.linalg.norm(position) > 20000 else 12
    longitude = math.degrees(math.atan2(y, x)) - float(times.gast_deg(t_utc_ns))
    latitude = math.degrees(math.asin(z / np.linalg.norm(position)))
    return Site(
        latitude_deg=float(np.clip(latitude + rng.uniform(-1, 1) * spread_deg, -85, 85)),
        longitude_deg=(longitude + rng.uniform(-1, 1) * spread_deg + 180) % 360 - 180,
        elevation_m=rng.uniform(0, 4000),
    )


@pytest.fixture(scope="module")
def earth():
    """The Earth of JPL's DE421, from the package that carries it."""
    import skyfield_data
    from skyfield.api import load_file

    ephemeris = load_file(str(Path(skyfield_data.__file__).parent / "data" / "de421.bsp"))
    yield ephemeris["earth"]
    ephemeris.close()


@dataclass(frozen=True)
class BySgp4:
    """A motion that heeds no state."""

    satellite: Satellite
    epoch_utc_ns: int

    def states(self, r_km, v_km_s, t_s):
        since_ns = np.rint(np.asarray(t_s) * times.NS_PER_S).astype(np.int64)
        return self.satellite.position_gcrs(self.epoch_utc_ns + since_ns)


def moved_by(satellite: Satellite, t_utc_ns: int) -> Orbit:
    """An orbit with its epoch ten minutes earlier."""
    epoch = t_utc_ns - 600 * times.NS_PER_S
    r, v = satellite.position_gcrs(np.array([epoch]))
    fit = OrbitFit(
        r_km=r[0],
        v_km_s=v[0],
        covariance=np.eye(6),
        residuals_arcsec=np.zeros((3, 2)),
        is_used=np.ones(3, bool),
        cost=0.0,
        chi2=0.0,
        prior_chi2=0.0,
        degrees_of_freedom=0,
        is_converged=True,
    )
    return Orbit(
        label="free",
        prior="none",
        reason="",
        epoch_utc_ns=epoch,
        r_km=r[0],
        v_km_s=v[0],
        covariance=np.eye(6),
        sigma_a_km=1.0,
        rms_arcsec=0.0,
        observations=3,
        outlier_utc_ns=(),
        fit=fit,
        rivals=0,
        forces=BySgp4(satellite, epoch),
    )


def skyfield_timescale(t_utc_ns: int):
    from skyfield.api import load

    orientation = times.earth_orientation(t_utc_ns)
    tt_minus_ut1_s = (
        times.tai_minus_utc_s(t_utc_ns) + times.TT_MINUS_TAI_S - orientation.ut1_minus_utc_s
    )
    timescale = load.timescale(builtin=True, delta_t=float(tt_minus_ut1_s))
    all_time = np.array([0.0, 1e8])
    timescale.polar_motion_table = (
        all_time,
        np.repeat(orientation.pole_x_arcsec, 2),
        np.repeat(orientation.pole_y_arcsec, 2),
    )
    return timescale


def skyfield_site(site: Site):
    from skyfield.api import wgs84

    return wgs84.latlon(site.latitude_deg, site.longitude_deg, site.elevation_m)


@pytest.fixture(
    scope="module", params=[4, pytest.param(20, marks=pytest.mark.nightly("a thousand cases"))]
)
def cases(request, earth):
    """Per case: regime, separation of ours and of the naive place from skyfield's, range error,
    separation of what an orbit predicts that SGP4 moves."""
    from skyfield.api import EarthSatellite

    rng = np.random.default_rng(20261120)
    rows = []
    for _ in range(request.param):
        t = int(rng.integers(1_546_300_800, 1_790_000_000)) * times.NS_PER_S + 250_000_000
        timescale = skyfield_timescale(t)
        instant = timescale.tt_jd(*(float(part) for part in times.jd_tt(t)))
        for regime in ("GEO", "LEO") * PAIRS_AN_EPOCH:
            elements = element_set(rng, t, regime)
            satellite = Satellite(elements)
            site = site_below(rng, satellite, t)
            ours = satellite.astrometric_place(site, np.array([t]))
            predicted = predict(moved_by(satellite, t), site, np.array([t])).places
            theirs = EarthSatellite(elements.line_1, elements.line_2, "", timescale)
            ground = skyfield_site(site)
            ra, dec, distance = (earth + ground).at(instant).observe(earth + theirs).radec()
            naive_ra, naive_dec, _ = (theirs - ground).at(instant).radec()
            truth = (ra._degrees, dec.degrees)
            rows.append(
                (
                    regime,
                    separation_deg(ours.ra_icrs_deg[0], ours.dec_icrs_deg[0], *truth) * 3600,
                    separation_deg(naive_ra._degrees, naive_dec.degrees, *truth) * 3600,
                    ours.range_km[0] - distance.km,
                    separation_deg(predicted.ra_icrs_deg[0], predicted.dec_icrs_deg[0], *truth)
                    * 3600,
                )
            )
    return rows


def test_place_agrees_with_skyfield_on_geo_and_leo_cases(cases):
    assert len(cases) >= 200
    for regime in ("GEO", "LEO"):
        ours = np.array([row[1] for row in cases if row[0] == regime])
        assert len(ours) == len(cases) / 2
        assert ours.max() < HUNDREDTH_ARCSEC
    one_metre_km = 1e-3
    assert max(abs(row[3]) for row in cases) < one_metre_km


def test_an_orbits_prediction_agrees_with_skyfield_as_well(cases):
    assert max(row[4] for row in cases) < HUNDREDTH_ARCSEC


def test_the_plain_difference_of_positions_would_fail_that_test(cases):
    naive = np.array([row[2] for row in cases])
    assert np.median(naive) > 10.0
    assert np.mean(naive < HUNDREDTH_ARCSEC) < 0.01


def test_a_millisecond_of_clock_error_would_fail_it_in_low_orbit():
    rng = np.random.default_rng(2)
    t = times.iso_to_utc_ns("2023-06-22T03:00:00Z")
    satellite = Satellite(element_set(rng, t, "LEO"))
    site = site_below(rng, satellite, t)
    place = satellite.astrometric_place(site, np.array([t, t + 1_000_000]))
    moved = separation_deg(*place.ra_icrs_deg[:1], *place.dec_icrs_deg[:1],
                           *place.ra_icrs_deg[1:], *place.dec_icrs_deg[1:])  # fmt: skip
    assert moved * 3600 > 0.1


def test_site_position_and_velocity_agree_with_skyfield():
    t = times.iso_to_utc_ns("2024-03-10T05:06:07Z")
    timescale = skyfield_timescale(t)
    theirs = skyfield_site(DAYTONA).at(timescale.tt_jd(*(float(p) for p in times.jd_tt(t))))
    position_km, velocity_km_s = places.site_gcrs(DAYTONA, t)
    ten_centimetres_km, centimetre_a_second_km = 1e-4, 1e-5
    assert position_km == pytest.approx(theirs.position.km, abs=ten_centimetres_km)
    assert velocity_km_s == pytest.approx(theirs.velocity.km_per_s, abs=centimetre_a_second_km)


def test_interpolated_rotation_is_the_full_one_between_the_hours():
    import erfa

    start = times.iso_to_utc_ns("2023-06-22T00:00:00Z")
    t = start + np.arange(0, 86400, 997) * times.NS_PER_S
    full = np.swapaxes(erfa.c2i06a(*times.jd_tt(t)), -1, -2)
    ten_microarcsec_rad = 1e-5 * times.ARCSEC_RAD
    assert np.max(np.abs(places.cirs_to_gcrs(t) - full)) < ten_microarcsec_rad


@pytest.mark.parametrize("regime", ["GEO", "LEO"])
def test_rates_are_the_slope_of_the_places(regime):
    rng = np.random.default_rng(7)
    t = times.iso_to_utc_ns("2025-01-01T00:00:00Z")
    satellite = Satellite(element_set(rng, t, regime))
    site = site_below(rng, satellite, t)
    tenth_s = times.NS_PER_S // 10
    place = satellite.astrometric_place(site, np.array([t - tenth_s, t, t + tenth_s]))
    slope_ra = wrap_180(place.ra_icrs_deg[2] - place.ra_icrs_deg[0]) / 0.2
    slope_dec = (place.dec_icrs_deg[2] - place.dec_icrs_deg[0]) / 0.2
    assert place.ra_rate_deg_s[1] == pytest.approx(slope_ra, abs=5e-6, rel=1e-4)
    assert place.dec_rate_deg_s[1] == pytest.approx(slope_dec, abs=5e-6, rel=1e-4)


@pytest.mark.parametrize("regime", ["GEO", "LEO"])
def test_line_of_sight_undoes_the_aberration_of_a_place(regime):
    rng = np.random.default_rng(11)
    t = times.iso_to_utc_ns("2022-09-01T00:00:00Z")
    satellite = Satellite(element_set(rng, t, regime))
    site = site_below(rng, satellite, t)
    place = satellite.astrometric_place(site, np.array([t]))
    line = places.line_of_sight_gcrs(place.ra_icrs_deg, place.dec_icrs_deg, place.t_utc_ns)[0]
    truth = (place.position_gcrs_km - place.site_gcrs_km)[0]
    off = np.linalg.norm(np.cross(line, truth)) / np.linalg.norm(truth)
    assert math.degrees(off) * 3600 < HUNDREDTH_ARCSEC
    plain = direction_to_unit(place.ra_icrs_deg, place.dec_icrs_deg)[0]
    assert math.degrees(np.linalg.norm(np.cross(plain, line))) * 3600 > 5


def test_places_of_many_instants_are_the_places_of_each():
    rng = np.random.default_rng(3)
    t0 = times.iso_to_utc_ns("2023-06-22T00:59:50Z")
    satellite = Satellite(element_set(rng, t0, "LEO"))
    t = t0 + np.arange(20) * times.NS_PER_S
    together = satellite.astrometric_place(DAYTONA, t)
    for k in (0, 9, 10, 19):
        alone = satellite.astrometric_place(DAYTONA, t[k : k + 1])
        assert alone.ra_icrs_deg[0] == together.ra_icrs_deg[k]
        assert alone.range_km[0] == together.range_km[k]
