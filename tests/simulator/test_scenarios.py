"""Every scenario is a night that could be: dark, above the horizon, lit, and found at once."""

import numpy as np
import pytest
from typer.testing import CliRunner

from rsoconsole.base import ConfigError
from rsoconsole.cli.app import app
from rsoconsole.config import Config, OpticsConfig, SearchConfig
from rsoconsole.orbits import Satellite, parse_elements
from rsoconsole.simulator import (
    DAYTONA_BEACH,
    DEFAULT_SCENARIO,
    Scene,
    all_scenarios,
    elements_path,
    scenario_named,
)
from rsoconsole.simulator.sky.brightness import BrightnessHistory, PeriodicFading
from rsoconsole.sky import (
    altaz_of_hour_angle,
    geo_belt_declination_deg,
    hour_angle_icrs_deg,
    icrs_of_hour_angle,
    icrs_to_altaz,
    lit_fraction,
    separation_deg,
    sun_altitude_deg,
)

NS = 1_000_000_000
NIGHT_S = np.arange(0, 3601, 600)
ON_THE_BELT = [each for each in all_scenarios().values() if each.name != "low-pass"]
CLUSTER = {39078, 35942, 42934, 36792, 39008, 41592}
WITH_TARGET = [each.name for each in ON_THE_BELT if each.target_norad_id]


def instants(scenario):
    return scenario.t_start_utc_ns + NIGHT_S * NS


def places(scenario, norad_id):
    [one] = [each for each in scenario.satellites if each.element_set.norad_id == norad_id]
    satellite = Satellite(one.element_set, one.standard_magnitude)
    return satellite, satellite.astrometric_place(scenario.site, instants(scenario))


NAMES = ["intelsat-14", "cluster", "low-pass", "ses-10", "intelsat-21", "cloud-bank", "empty"]


def test_the_scenarios_are_there_and_the_default_comes_first():
    assert list(all_scenarios()) == NAMES
    assert next(iter(all_scenarios())) == DEFAULT_SCENARIO
    assert all(name == each.name for name, each in all_scenarios().items())


def test_the_demo_takes_a_scenario_by_its_name_alone():
    found = CliRunner().invoke(app, ["demo", "no-such-night"])
    assert found.exit_code != 0
    assert "there is no scenario 'no-such-night': take one of intelsat-14" in str(found.exception)


def test_an_unknown_scenario_is_refused_with_the_names_there_are():
    with pytest.raises(ConfigError, match=", ".join(NAMES)):
        scenario_named("intelsat-99")


def test_every_night_has_a_line_in_the_list():
    shown = CliRunner().invoke(app, ["demo", "--list"]).stdout.splitlines()
    assert [line.split(" ")[0] for line in shown] == NAMES
    assert all(
        line.endswith(each.description) and len(line) < 100
        for line, each in zip(shown, all_scenarios().values(), strict=True)
    )


@pytest.mark.parametrize("scenario", all_scenarios().values(), ids=lambda each: each.name)
def test_the_sky_is_dark_for_an_hour(scenario):
    for t_utc_ns in instants(scenario):
        assert sun_altitude_deg(scenario.site, int(t_utc_ns)) < -12.0


@pytest.mark.parametrize("scenario", ON_THE_BELT, ids=lambda each: each.name)
def test_the_telescope_starts_on_the_belt_above_25_deg_and_within_the_shipped_stars(scenario):
    assert scenario.site == DAYTONA_BEACH
    altitude, _ = altaz_of_hour_angle(
        scenario.site, scenario.start_hour_angle_deg, scenario.start_declination_deg
    )
    assert altitude > 25.0
    belt = geo_belt_declination_deg(scenario.site, scenario.start_hour_angle_deg)
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
        declination = geo_belt_declination_deg(scenario.site, hour_angle)
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
    companions = {"ses-10": {49332}, "cluster": CLUSTER}.get(name, set())
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


def test_all_catalogued_satellites_of_the_belt_are_in_every_sky_above_it():
    sets = parse_elements(elements_path().read_text(encoding="ascii"))
    belt = {each.norad_id for each in sets} - {12}
    assert len(belt) == 16
    for scenario in ON_THE_BELT:
        if scenario.name != "empty":
            there = {each.element_set.norad_id for each in scenario.satellites}
            assert there == belt
            assert len({each.standard_magnitude for each in scenario.satellites}) > 6


def test_a_go_to_along_the_belt_finds_another_satellite():
    """The default night's sky where SES 10 stands, half the sky west of its target."""
    scenario = scenario_named("intelsat-14")
    _, place = places(scenario, 42432)
    optics = OpticsConfig(width_px=900, height_px=700)
    _, truth = Scene(scenario, 1, optics=optics).expose(
        float(place.ra_icrs_deg[0]),
        float(place.dec_icrs_deg[0]),
        *(1.7, False, scenario.t_start_utc_ns, EXPOSURE_S),
    )
    seen = {each.name: each.snr_integrated for each in truth.satellites if each.is_in_frame}
    assert list(seen) == ["SES 10", "SES 17"]
    assert seen["SES 10"] > 3.0 * seen["SES 17"] > 0.0


def test_six_satellites_of_the_cluster_fit_one_field_all_night():
    scenario = scenario_named("cluster")
    found = [places(scenario, each)[1] for each in CLUSTER]
    width_deg, height_deg = OpticsConfig().field_deg
    assert np.ptp([each.ra_icrs_deg for each in found], axis=0).max() < 0.6 * width_deg
    assert np.ptp([each.dec_icrs_deg for each in found], axis=0).max() < 0.6 * height_deg


def test_the_low_pass_goes_by_in_the_sun_within_the_shipped_stars_and_the_limits():
    scenario, limits = scenario_named("low-pass"), Config().limits
    one = scenario.target
    t = scenario.t_start_utc_ns + np.arange(10, 1200, 10) * NS
    place = Satellite(one.element_set).astrometric_place(scenario.site, t)
    altitude, _ = icrs_to_altaz(scenario.site, place.ra_icrs_deg, place.dec_icrs_deg, t)
    assert np.min(altitude) > limits.min_altitude_deg
    assert np.all(np.abs(place.dec_icrs_deg) < 11.0)
    assert np.all(lit_fraction(place.position_gcrs_km, t) == 1.0)


def test_ses_17_stands_a_fifth_of_a_degree_from_ses_10_and_is_fainter():
    scenario = scenario_named("ses-10")
    ses_10, at_10 = places(scenario, 42432)
    ses_17, at_17 = places(scenario, 49332)
    distance = separation_deg(
        at_10.ra_icrs_deg, at_10.dec_icrs_deg, at_17.ra_icrs_deg, at_17.dec_icrs_deg
    )
    assert np.all(np.abs(distance - 0.18) < 0.02)
    # Fainter than any two satellites' confidences scatter, and yet to be seen.
    fainter_mag = ses_17.magnitude(at_17) - ses_10.magnitude(at_10)
    assert np.all((fainter_mag > 2.0) & (fainter_mag < 3.0))


CADENCE_S, EXPOSURE_S = 30.0, 10.0
SEEN_MAG = 1.5
"""A loss that leaves Intelsat 14 and Intelsat 21 far above tau."""
HIDDEN_MAG = 2.1
"""One that surely hides them."""


def extra_mag(scenario, seed, begin_s, count=None):
    """Own fading and clouds of the target in its night's exposures, mean over each."""
    [target] = [
        each
        for each in scenario.satellites
        if each.element_set.norad_id == scenario.target_norad_id
    ]
    starts_s = begin_s + CADENCE_S * np.arange(count or scenario.frames)
    within_s = np.linspace(0.0, EXPOSURE_S, 5)
    own = [target.brightness.extra_mag(t + within_s, seed).mean() for t in starts_s]
    west, north = np.array([scenario.target_hour_angle_deg]), np.array([-4.8])
    cloud = [
        -2.5 * np.log10(scenario.clouds.transmission(west, north, (t, t + EXPOSURE_S), seed)[0])
        for t in starts_s
    ]
    return np.array(own) + np.array(cloud)


@pytest.mark.parametrize("begin_s", [0.0, 10.0, 20.0])
@pytest.mark.parametrize("seed", range(1, 6))
def test_intelsat_14_fades_a_handful_of_times_and_is_gone_after_forty_frames(seed, begin_s):
    lost_mag = extra_mag(scenario_named("intelsat-14"), seed, begin_s)
    before, end = lost_mag[:34], lost_mag[-3:]
    assert 2 <= np.sum(before > HIDDEN_MAG) <= 5
    assert np.sum(before < SEEN_MAG) >= 24
    assert np.all(end > HIDDEN_MAG)
    two_frames_for_a_track = lost_mag[:7]
    assert np.all(two_frames_for_a_track < SEEN_MAG)


HOURS_TO_DAWN = 3.9


@pytest.mark.parametrize("seed", range(1, 6))
def test_intelsat_14_comes_back_each_time_until_dawn(seed):
    """Gone for less than ten minutes each time, and longer there than gone."""
    count = round(HOURS_TO_DAWN * 3600.0 / CADENCE_S)
    is_gone = extra_mag(scenario_named("intelsat-14"), seed, 0.0, count) > SEEN_MAG
    ends = np.flatnonzero(np.diff(np.concatenate([[0], is_gone.astype(int), [0]])))
    gone_s = np.diff(ends)[::2] * CADENCE_S
    assert np.sum(gone_s > 240.0) == 6
    assert np.max(gone_s) < 600.0
    assert np.mean(is_gone) < 0.3
    assert not np.any(is_gone[-5:])


@pytest.mark.parametrize("begin_s", [0.0, 5.0, 10.0])
@pytest.mark.parametrize("seed", range(1, 6))
def test_clouds_hide_intelsat_21_once_and_dim_it_to_the_edge_of_tau(seed, begin_s):
    lost_mag = extra_mag(scenario_named("intelsat-21"), seed, begin_s)
    [hidden] = np.flatnonzero(lost_mag > 3.0)
    some_150_s_after_lock = 250.0 <= begin_s + CADENCE_S * hidden <= 300.0
    assert some_150_s_after_lock
    near_tau = np.delete(lost_mag, hidden) > 2.1
    assert 3 <= np.sum(near_tau) <= 7


@pytest.mark.parametrize("seed", range(1, 6))
def test_the_bank_of_clouds_hides_everything_for_ten_minutes(seed):
    scenario = scenario_named("cloud-bank")
    lost_mag = extra_mag(scenario, seed, 5.0)
    hidden = np.flatnonzero(lost_mag > 4.0)
    assert len(hidden) * CADENCE_S >= 570.0
    assert np.all(np.diff(hidden) == 1)
    assert np.all(lost_mag[: hidden[0]] < SEEN_MAG)
    frames_to_settle = 6
    assert np.all(lost_mag[-frames_to_settle:] < SEEN_MAG)


def test_a_seed_moves_the_fades_and_nothing_before_the_first_one():
    turning = PeriodicFading(
        period_s=300.0, first_s=290.0, depth_mag=3.0, jitter_s=20.0, last_s=700.0
    )
    t_s = np.linspace(0.0, 1200.0, 2401)
    middles = []
    for seed in range(1, 20):
        lost_mag = turning.extra_mag(t_s, seed)
        assert lost_mag.max() == pytest.approx(3.0, abs=1e-3)
        assert np.all(lost_mag[t_s < 100.0] < 0.01)
        assert np.all(lost_mag[t_s > 790.0] < 0.01)
        middles.append(t_s[:900][np.argmax(lost_mag[:900])])
    assert np.ptp(middles) > 20.0
    assert np.all(np.abs(np.array(middles) - 290.0) <= 20.5)
    assert np.array_equal(turning.extra_mag(t_s, 3), turning.extra_mag(t_s, 3))


def test_a_steady_satellite_loses_nothing():
    assert np.all(BrightnessHistory().extra_mag(NIGHT_S.astype(float), 1) == 0.0)


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
