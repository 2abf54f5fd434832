"""The night that is chosen for satellites named by hand: its time, its start, its refusals."""

import json
from itertools import pairwise

import numpy as np
import pytest

from rsoconsole.base import ConfigError, OrbitError, SolverError
from rsoconsole.cli.demo._demo_targets import config_for_plan, plan_targets
from rsoconsole.cli.demo.demo import demo_config
from rsoconsole.cli.words.options import parse_site
from rsoconsole.config import OpticsConfig
from rsoconsole.orbits import Satellite, find_object, parse_element_sets
from rsoconsole.records import Site
from rsoconsole.simulator import (
    DAYTONA_BEACH,
    FieldContent,
    SensorModel,
    Streak,
    elements_path,
    integrated_snr,
    straight_streak,
)
from rsoconsole.simulator.camera.rendering import expected_electrons
from rsoconsole.simulator.camera.sensor import pixel_defects
from rsoconsole.simulator.nights.night_plan import (
    exposure_for_rate_s,
    ground_rate_cadence_s,
    plan_of_table,
    scenario_from_plan,
)
from rsoconsole.simulator.sky.other_objects import NearbySatelliteSearch
from rsoconsole.simulator.sky.passes import ExposureGeometry, satellite_passes
from rsoconsole.sky import (
    hour_angle_icrs_deg,
    icrs_to_altaz,
    lit_fraction,
    sun_altitude_deg,
    tan_wcs,
)
from tests.nights.target_night import centre_offset_deg, first_exposure
from tests.orbits.test_target_places import TRANSCRIBED

NS = 1_000_000_000
BELT = elements_path()
LATENCY_S = 0.3
FIFTH_OF_THE_FIELD_DEG = 0.2 * min(OpticsConfig().field_deg)


@pytest.fixture(scope="module")
def config():
    return demo_config(DAYTONA_BEACH, preset="tuned", keep_frames="none", catalogue=[BELT])


@pytest.fixture
def mixed_config(tmp_path, monkeypatch):
    """One object of each kind of orbit, and no whole sky."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    path = tmp_path / "mixed.tle"
    path.write_text(TRANSCRIBED)
    config = demo_config(DAYTONA_BEACH, preset="tuned", keep_frames="none", catalogue=[path])
    monkeypatch.setattr(
        "rsoconsole.cli.demo._demo_targets.whole_sky_index_file", lambda _config: None
    )
    return config


def satellite(number: str) -> Satellite:
    return Satellite(find_object(parse_element_sets(BELT.read_text()).entries, number)[0], 12.0)


def test_the_time_that_is_picked_is_dark_and_the_satellite_up_and_lit_for_all_frames(config):
    plan = plan_targets(["36097"], config, at=None, seed=1, frames=40)
    assert plan.t_start_utc_ns >= satellite("36097").element_set.epoch_utc_ns
    assert plan.visible_s >= 40 * plan.cadence_s
    t = plan.t_start_utc_ns + np.arange(0, int(40 * plan.cadence_s), 60) * NS
    place = satellite("36097").astrometric_place(DAYTONA_BEACH, t)
    altitude, _ = icrs_to_altaz(DAYTONA_BEACH, place.ra_icrs_deg, place.dec_icrs_deg, t)
    assert np.all(np.asarray(altitude) > config.limits.min_altitude_deg)
    assert np.all(lit_fraction(place.position_gcrs_km, t) == 1.0)
    assert all(sun_altitude_deg(DAYTONA_BEACH, int(each)) < -12.0 for each in t)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_first_frame_has_the_satellite_within_a_fifth_of_the_field_of_its_middle(config, seed):
    plan = plan_targets(["intelsat 14"], config, at=None, seed=seed, frames=5)
    exposure = first_exposure(plan, LATENCY_S, seed)
    [true] = [each for each in exposure["satellites"] if each["norad_id"] == 36097]
    assert true["is_in_frame"]
    assert true["is_whole"]
    random_error_deg = 60 / 3600
    assert centre_offset_deg(exposure, true) <= FIFTH_OF_THE_FIELD_DEG + random_error_deg


def test_seeds_begin_elsewhere_and_one_seed_begins_where_it_did(config):
    plans = [plan_targets(["36097"], config, at=None, seed=s, frames=5) for s in (1, 2, 1)]
    assert plans[0] == plans[2]
    assert plans[0].start_hour_angle_deg != plans[1].start_hour_angle_deg
    assert plans[0].t_start_utc_ns == plans[1].t_start_utc_ns


def test_several_targets_are_all_in_the_first_frame_and_the_others_of_the_file_too(config):
    plan = plan_targets(["SES 17", "SES 10"], config, at=None, seed=3, frames=5)
    assert (plan.targets, plan.title) == ((49332, 42432), "SES 17, SES 10")
    exposure = first_exposure(plan, LATENCY_S, 3)
    seen = {each["norad_id"] for each in exposure["satellites"] if each["is_in_frame"]}
    assert {49332, 42432} <= seen
    assert len(scenario_from_plan(plan).satellites) == 17, "every object of the file is there"


def test_a_plan_crosses_to_another_process(config):
    plan = plan_targets(["36097"], config, at=None, seed=1, frames=5)
    assert plan_of_table(json.loads(json.dumps(plan.to_table()))) == plan


def test_a_given_time_is_used_as_it_is(config):
    at = "2023-06-23T05:30:00Z"
    plan = plan_targets(["36097"], config, at=at, seed=1, frames=5)
    assert plan.t_start_utc_ns == 1_687_498_200 * NS
    settings = config_for_plan(config, plan)
    assert (settings.exposure.exposure_s, settings.exposure.cadence_s) == (10.0, 30.0)
    assert settings.search.pattern == "stay"


@pytest.mark.parametrize(
    ("wanted", "at", "site", "words"),
    [
        (["36097"], "2023-06-23T17:30:00Z", None, r"the Sun stands at \+8\d"),
        (["36097"], "2023-06-22T20:00:00Z", "-31.3,149.1,0", r"INTELSAT 14 stands at an altitude"),
        (["36097", "38749"], "2023-06-23T05:30:00Z", None, r"1\d\.\d deg apart"),
        pytest.param(
            ["36097", "38749"],
            None,
            None,
            r"never within 0\.74 deg .*the closest: 1\d\.\d.*fewer",
            marks=pytest.mark.nightly("looks through a year"),
        ),
        (["36097"], None, "-31.3,149.1,0", r"never above 16 deg.*try another --site"),
        (["36097", "intelsat 14"], None, None, "named twice"),
        (["36097"], "yesterday", None, "--at: 'yesterday' is not a time"),
    ],
)
@pytest.mark.slow("looks through nights for a time")
def test_what_cannot_be_seen_is_refused_with_the_condition_that_fails(
    config, wanted, at, site, words
):
    if site is not None:
        there = demo_config(parse_site(site), preset="tuned", keep_frames="none", catalogue=[BELT])
        config = there
    with pytest.raises(ConfigError, match=words):
        plan_targets(wanted, config, at=at, seed=1, frames=5)


def test_an_eclipsed_satellite_is_refused_as_such(config):
    """At the equinox a geostationary satellite passes through the shadow about midnight."""
    t = 1_695_444_000 * NS + np.arange(0, 86_400, 120) * NS
    place = satellite("36097").astrometric_place(DAYTONA_BEACH, t)
    dark = t[lit_fraction(place.position_gcrs_km, t) == 0.0]
    from rsoconsole.words import utc_ns_to_iso

    with pytest.raises(ConfigError, match="in the Earth's shadow"):
        plan_targets(["36097"], config, at=utc_ns_to_iso(int(dark[3])), seed=1, frames=5)


def test_a_sky_without_stars_says_how_to_get_them(mixed_config):
    with pytest.raises(SolverError, match=r"ends? at 12: 'rsoconsole index install'"):
        plan_targets(["26407"], mixed_config, at=None, seed=1, frames=3)


def test_an_unclear_name_lists_the_candidates(config):
    with pytest.raises(OrbitError, match=r"4 objects: .*INTELSAT 14 \(36097\)"):
        plan_targets(["intelsat"], config, at=None, seed=1, frames=3)


@pytest.mark.parametrize(
    ("text", "site"),
    [
        ("52.2,21.0,110", Site(latitude_deg=52.2, longitude_deg=21.0, elevation_m=110.0)),
        ("-30.2, 289.3", Site(latitude_deg=-30.2, longitude_deg=289.3 - 360, elevation_m=0.0)),
    ],
)
def test_a_site_is_read_as_it_is_written(text, site):
    found = parse_site(text)
    assert found.longitude_deg == pytest.approx(site.longitude_deg)
    assert (found.latitude_deg, found.elevation_m) == (site.latitude_deg, site.elevation_m)


@pytest.mark.parametrize("text", ["here", "95,0,0", "10,400,0", "10,20,30,40", "10,20,99999"])
def test_what_is_no_site_is_refused(text):
    with pytest.raises(ConfigError, match="--site"):
        parse_site(text)


def test_exposures_keep_streaks_short_and_the_target_in_the_field():
    scale, short_deg = OpticsConfig().scale_arcsec_px, min(OpticsConfig().field_deg)
    rates = [6.5, 15.0, 37.0, 167.0, 2000.0]
    exposures = [exposure_for_rate_s(rate, scale) for rate in rates]
    assert exposures[:3] == [11.0, 10.0, 10.0]
    assert exposure_for_rate_s(1.0, scale) == 30.0, "slower ones make no streak at all"
    assert ground_rate_cadence_s(1.0, short_deg, 30.0) == 35.0
    for rate, exposure_s in zip(rates, exposures, strict=True):
        assert rate * exposure_s <= 300.0 * scale
    assert all(a >= b for a, b in pairwise(exposures))
    assert ground_rate_cadence_s(0.01, short_deg) == 30.0
    for rate in (50.0, 100.0):
        assert ground_rate_cadence_s(rate, short_deg) * rate / 3600 <= 0.25 * short_deg
    assert ground_rate_cadence_s(2000.0, short_deg) == 6.0


def test_nobody_who_crosses_a_frame_is_passed_over():
    """The quick choice against the exact places of everybody, also of the fast."""
    everybody = [Satellite(each) for each in parse_element_sets(TRANSCRIBED).entries]
    nearby, sensor = NearbySatelliteSearch(everybody), SensorModel()
    rng = np.random.default_rng(8)
    crossed = chosen = 0
    for _ in range(60):
        one = everybody[rng.integers(len(everybody))]
        t = one.element_set.epoch_utc_ns + int(rng.uniform(0, 86_400)) * NS
        exposure_s = float(rng.choice([0.2, 10.0]))
        at = one.astrometric_place(DAYTONA_BEACH, np.array([t + int(exposure_s * NS / 2)]))
        # Beside it by up to three quarters of a field: some cross a corner, some do not.
        ra = float(at.ra_icrs_deg[0] + rng.uniform(-1.2, 1.2))
        dec = float(np.clip(at.dec_icrs_deg[0] + rng.uniform(-1.0, 1.0), -89.0, 89.0))
        wcs = tan_wcs(
            ra,
            dec,
            scale_arcsec_px=sensor.scale_arcsec_px,
            rotation_deg=30.0,
            is_flipped=False,
            width_px=sensor.width_px,
            height_px=sensor.height_px,
        )
        passes = satellite_passes(
            [(each, lambda at: np.zeros(len(at))) for each in everybody],
            ExposureGeometry(
                site=DAYTONA_BEACH,
                sensor=sensor,
                wcs=wcs,
                t_start_utc_ns=t,
                exposure_s=exposure_s,
            ),
        )
        mid = t + int(exposure_s * NS / 2)
        near = nearby.indices(DAYTONA_BEACH, mid, exposure_s, (ra, dec), 1.2)
        numbers = {everybody[i].element_set.norad_id for i in near}
        assert {each.norad_id for each in passes} <= numbers
        crossed += len(passes)
        chosen += len(near)
    assert crossed >= 20
    assert chosen < 2.5 * 60, "and not everybody is computed every time"


@pytest.mark.parametrize("brightness", [None, np.array([0.2, 1.8])])
def test_the_integrated_snr_is_that_of_the_rendered_pixels(brightness):
    sensor = SensorModel(width_px=400, height_px=300)
    streak = straight_streak((100.0, 90.0), (220.0, 130.0), 60_000.0, brightness)
    star = {
        "star_x_px": np.array([150.0]),
        "star_y_px": np.array([108.0]),
        "star_electrons": np.array([40_000.0]),
    }
    for content in (FieldContent(), FieldContent(**star), FieldContent(defocus_px=4.0)):
        with_it = FieldContent(
            star_x_px=content.star_x_px,
            star_y_px=content.star_y_px,
            star_electrons=content.star_electrons,
            defocus_px=content.defocus_px,
            streaks=(streak,),
        )
        all_e = expected_electrons(sensor, with_it).astype(np.float64)
        model_e = all_e - expected_electrons(sensor, content)
        variance = all_e + sensor.read_noise_e**2 + sensor.e_per_adu12**2 / 12.0
        good = np.ones(sensor.width_px * sensor.height_px, bool)
        good[pixel_defects(sensor).index] = False
        weight = (model_e**2 / variance).ravel()[good]
        expected = np.sqrt(weight.sum())
        assert integrated_snr(sensor, content, streak) == pytest.approx(expected, rel=0.01)
    hidden_by_star = integrated_snr(sensor, FieldContent(**star), streak)
    assert hidden_by_star < integrated_snr(sensor, FieldContent(), streak)


def test_only_light_on_the_sensor_counts():
    sensor = SensorModel(width_px=400, height_px=300)
    inside = straight_streak((100.0, 100.0), (220.0, 100.0), 30_000.0)
    half = straight_streak((-60.0, 100.0), (60.0, 100.0), 30_000.0)
    beside = straight_streak((-400.0, 100.0), (-280.0, 100.0), 30_000.0)
    unlit: Streak = straight_streak((100.0, 100.0), (220.0, 100.0), 0.0)
    whole, cut, none, dark = (
        integrated_snr(sensor, FieldContent(), each) for each in (inside, half, beside, unlit)
    )
    assert cut == pytest.approx(whole * np.sqrt(0.5), rel=0.02)
    assert none == dark == 0.0


def test_a_mounts_hour_angle_is_within_its_reach(config):
    plan = plan_targets(["36097"], config, at=None, seed=1, frames=5)
    t = plan.t_start_utc_ns
    place = satellite("36097").astrometric_place(DAYTONA_BEACH, np.array([t]))
    hour_angle = hour_angle_icrs_deg(
        DAYTONA_BEACH, float(place.ra_icrs_deg[0]), float(place.dec_icrs_deg[0]), t
    )
    assert abs(hour_angle) < config.limits.max_hour_angle_deg
    assert plan.start_hour_angle_deg == pytest.approx(hour_angle, abs=0.5)
