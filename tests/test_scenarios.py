"""Every scenario is a night that could be: dark, above the horizon, lit, and found by a sweep."""

import numpy as np
import pytest

from rsoconsole.config import OpticsConfig, SearchConfig
from rsoconsole.errors import ConfigError
from rsoconsole.orbit.satellite import Satellite
from rsoconsole.simulator.scenarios import (
    DAYTONA_BEACH,
    DEFAULT_SCENARIO,
    all_scenarios,
    scenario_named,
)
from rsoconsole.sky.angles import separation_deg
from rsoconsole.sky.belt import belt_declination_deg
from rsoconsole.sky.frames import (
    altaz_of_hour_angle,
    hour_angle_icrs_deg,
    icrs_of_hour_angle,
    icrs_to_altaz,
)
from rsoconsole.sky.sun import lit_fraction, sun_altitude_deg

NS = 1_000_000_000
NIGHT_S = np.arange(0, 3601, 600)
WITH_TARGET = [name for name, each in all_scenarios().items() if each.target_norad_id]


def instants(scenario):
    return scenario.t_start_utc_ns + NIGHT_S * NS


def places(scenario, norad_id):
    [one] = [each for each in scenario.satellites if each.element_set.norad_id == norad_id]
    satellite = Satellite(one.element_set, one.standard_magnitude)
    return satellite, satellite.astrometric_place(scenario.site, instants(scenario))


def test_the_four_scenarios_are_there_and_the_default_comes_first():
    assert list(all_scenarios()) == ["intelsat-14", "ses-10", "intelsat-21", "empty"]
    assert next(iter(all_scenarios())) == DEFAULT_SCENARIO
    assert all(name == each.name for name, each in all_scenarios().items())


def test_an_unknown_scenario_is_refused_with_the_names_there_are():
    with pytest.raises(ConfigError, match=r"intelsat-14, ses-10, intelsat-21, empty"):
        scenario_named("intelsat-99")


@pytest.mark.parametrize("scenario", all_scenarios().values(), ids=lambda each: each.name)
def test_the_sky_is_dark_for_an_hour(scenario):
    assert scenario.site == DAYTONA_BEACH
    for t_utc_ns in instants(scenario):
        assert sun_altitude_deg(scenario.site, int(t_utc_ns)) < -12.0


@pytest.mark.parametrize("scenario", all_scenarios().values(), ids=lambda each: each.name)
def test_the_telescope_starts_on_the_belt_above_25_deg_and_within_the_shipped_stars(scenario):
    altitude, _ = altaz_of_hour_angle(
        scenario.site, scenario.start_hour_angle_deg, scenario.start_declination_deg
    )
    assert altitude > 25.0
    belt = belt_declination_deg(scenario.site, scenario.start_hour_angle_deg)
    a_sixth_of_a_field_deg = 0.2
    assert scenario.start_declination_deg == pytest.approx(belt, abs=a_sixth_of_a_field_deg)


@pytest.mark.parametrize("name", WITH_TARGET)
def test_the_target_is_up_lit_and_among_the_shipped_stars(name):
    scenario = scenario_named(name)
    _, place = places(scenario, scenario.target_norad_id)
    altitude, _ = icrs_to_altaz(
        scenario.site, place.ra_icrs_deg, place.dec_icrs_deg, instants(scenario)
    )
    assert np.all(np.asarray(altitude) > 25.0)
    assert np.all(np.abs(place.dec_icrs_deg) < 11.0)
    assert np.all(lit_fraction(place.position_gcrs_km, place.t_utc_ns) == 1.0)


@pytest.mark.parametrize("name", WITH_TARGET)
def test_the_target_is_as_bright_as_large_geostationary_satellites_are(name):
    scenario = scenario_named(name)
    satellite, place = places(scenario, scenario.target_norad_id)
    magnitude = satellite.magnitude(place)
    assert np.all((magnitude > 11.0) & (magnitude < 13.0))


@pytest.mark.parametrize("name", WITH_TARGET)
def test_element_sets_are_fresh(name):
    scenario = scenario_named(name)
    for each in scenario.satellites:
        four_days_ns = 4 * 86_400 * NS
        assert abs(each.element_set.epoch_utc_ns - scenario.t_start_utc_ns) < four_days_ns


@pytest.mark.parametrize("name", WITH_TARGET)
def test_a_sweep_of_the_belt_meets_the_target_after_a_few_frames_and_no_other_before(name):
    """Sweep order of the search: the start, then one step east, one west, and so on."""
    scenario, search = scenario_named(name), SearchConfig()
    width_deg, height_deg = OpticsConfig().field_deg
    met = []
    for field in (0, 1, -1, 2, -2):
        hour_angle = scenario.start_hour_angle_deg - field * search.belt_step_fields * width_deg
        t = scenario.t_start_utc_ns + 60 * NS
        declination = belt_declination_deg(scenario.site, hour_angle)
        ra, dec = icrs_of_hour_angle(scenario.site, hour_angle, declination, t)
        inside = set()
        for each in scenario.satellites:
            place = Satellite(each.element_set).astrometric_place(scenario.site, np.array([t]))
            east = (place.ra_icrs_deg[0] - ra + 180) % 360 - 180
            # A pointing error of 0.15 deg must not matter.
            if (
                abs(east) < width_deg / 2 + 0.15
                and abs(place.dec_icrs_deg[0] - dec) < height_deg / 2
            ):
                inside.add(each.element_set.norad_id)
        met.append(inside)
    first = next(index for index, inside in enumerate(met) if inside)
    assert 1 <= first <= 3
    assert scenario.target_norad_id in met[first]
    companions = {"ses-10": {49332}}.get(name, set())
    assert met[first] == {scenario.target_norad_id} | companions


def test_intelsat_14_is_alone_within_two_and_a_half_degrees():
    scenario = scenario_named("intelsat-14")
    _, target = places(scenario, 36097)
    for each in scenario.satellites:
        norad_id = each.element_set.norad_id
        if norad_id != 36097:
            _, place = places(scenario, norad_id)
            distance = separation_deg(
                target.ra_icrs_deg, target.dec_icrs_deg, place.ra_icrs_deg, place.dec_icrs_deg
            )
            assert np.min(distance) > 2.5


def test_ses_17_stands_a_fifth_of_a_degree_from_ses_10_and_is_fainter():
    scenario = scenario_named("ses-10")
    ses_10, at_10 = places(scenario, 42432)
    ses_17, at_17 = places(scenario, 49332)
    distance = separation_deg(
        at_10.ra_icrs_deg, at_10.dec_icrs_deg, at_17.ra_icrs_deg, at_17.dec_icrs_deg
    )
    assert np.all(np.abs(distance - 0.18) < 0.02)
    assert np.all(ses_17.magnitude(at_17) > ses_10.magnitude(at_10) + 0.5)


def test_nothing_is_there_in_the_empty_scenario():
    scenario = scenario_named("empty")
    assert scenario.satellites == ()
    assert scenario.target_norad_id is None


def test_geo_satellites_keep_their_hour_angle():
    scenario = scenario_named("intelsat-14")
    _, place = places(scenario, 36097)
    hour_angle = hour_angle_icrs_deg(
        scenario.site, place.ra_icrs_deg, place.dec_icrs_deg, place.t_utc_ns
    )
    # Published for this satellite and site: azimuth 124 deg, altitude 38 deg, hour angle -2.7 h.
    assert np.ptp(np.asarray(hour_angle)) < 0.02
    assert np.mean(hour_angle) / 15.0 == pytest.approx(-2.7, abs=0.05)


@pytest.mark.parametrize("name", WITH_TARGET)
def test_the_target_stands_at_the_hour_angle_that_is_told(name):
    scenario = scenario_named(name)
    _, place = places(scenario, scenario.target_norad_id)
    hour_angle = hour_angle_icrs_deg(
        scenario.site, place.ra_icrs_deg, place.dec_icrs_deg, place.t_utc_ns
    )
    assert np.all(np.abs(np.asarray(hour_angle) - scenario.target_hour_angle_deg) < 0.05)


def test_a_smaller_field_starts_as_many_fields_from_the_target():
    scenario = scenario_named("intelsat-14")
    assert scenario.start_hour_angle_for(OpticsConfig().field_deg[0]) == pytest.approx(
        scenario.start_hour_angle_deg, abs=1e-3
    )
    half = scenario.start_hour_angle_for(1.635 / 2)
    assert half - scenario.target_hour_angle_deg == pytest.approx(1.52 / 2)
    assert scenario_named("empty").start_hour_angle_for(0.5) == -36.0
