"""``rso.orbit`` and ``rso.identify``: what the verbs say, with units, times and frames."""

import json
from pathlib import Path

import numpy as np
import pytest
import skyfield_data
from astropy import units as u
from astropy.coordinates import EarthLocation
from astropy.table import QTable
from astropy.time import Time
from sgp4.api import Satrec
from skyfield.api import EarthSatellite, load, load_file, wgs84
from typer.testing import CliRunner

import rsoconsole as rso
from rsoconsole.base import ExportError, InputError, OrbitError, SessionError
from rsoconsole.cli.app import app
from tests.drawn.plate_fields import SHARED
from tests.nights.samples import SAMPLE

ROOT = Path(__file__).parents[2]
CATALOGUE = ROOT / "rsoconsole" / "simulator" / "data" / "belt_20230622.tle"
OBSERVED = SHARED / "observations"
TRIPLE = (29.19, -81.05, 10.0)
SITE = EarthLocation.from_geodetic(lon=-81.05 * u.deg, lat=29.19 * u.deg, height=10 * u.m)
needs_shared = pytest.mark.skipif(not SHARED.exists(), reason="../shared/data is not here")


@pytest.fixture(scope="module")
def night() -> "rso.Session":
    return rso.open_session(SAMPLE)


@pytest.fixture(scope="module")
def found(night) -> "rso.Orbit":
    return rso.orbit(night)


def printed(*words: object) -> dict:
    run = CliRunner().invoke(app, [str(word) for word in words])
    assert run.exit_code == 0, run.output
    return json.loads(run.stdout)


def taken_of(night) -> QTable:
    """The sample's one object, as a table that somebody else might have."""
    measured = night.measurements
    ids = {m.measurement_id for m in night.tracks[1].measurements}
    measured = measured[[each in ids for each in measured["measurement_id"]]]
    table = QTable({"time": measured["t_mid_utc"], "place": measured["direction"]})
    for axes in ("ee", "en", "nn"):
        table[f"cov_{axes}_arcsec2"] = measured[f"cov_{axes}_arcsec2"]
    return table


# -- orbits ------------------------------------------------------------------------------------


def test_an_orbit_is_that_of_the_verb(found):
    said = printed("orbit", SAMPLE, "--json")
    assert found.label == said["label"] == "constrained by prior"
    assert found.a.to_value("km") == said["a_km"]
    assert found.i.to_value("deg") == said["i_deg"]
    assert found.e == said["e"]
    assert found.sigma_a.to_value("km") == said["sigma_a_km"]
    assert found.r.to_value("km").tolist() == said["r_gcrs_km"]
    assert found.covariance.tolist() == said["covariance"]
    assert found.observations == said["observations"]
    assert found.sigmas["raan"].to_value("deg") == said["sigmas"]["raan_deg"]
    report = found.report()
    for key in ("method", "label", "reason", "parts", "epoch_utc", "rms_arcsec"):
        assert report[key] == said[key], key


def test_a_session_its_path_and_a_table_of_its_track_are_one(found, night):
    by_path = rso.orbit(SAMPLE)
    by_table = rso.orbit(taken_of(night), site=SITE)
    for other in (by_path, by_table):
        assert other.a.to_value("km") == pytest.approx(found.a.to_value("km"), rel=1e-9)
        assert np.allclose(other.covariance, found.covariance, rtol=1e-6)


def test_a_sessions_track_is_named_as_the_night_numbers_it(found, night):
    for one in (rso.orbit(night, track=1), rso.orbit(night.tracks[1], site=SITE)):
        assert one.a.to_value("km") == pytest.approx(found.a.to_value("km"), rel=1e-6)
    with pytest.raises(InputError, match="there is no track 3: there are 1"):
        rso.orbit(night, track=3)
    with pytest.raises(InputError, match=r"rso\.orbit\(night, track=1\), or site="):
        rso.orbit(night.tracks[1])
    assert rso.identify(night.tracks, tle=CATALOGUE, site=SITE)[1].norad_id == 36097
    with pytest.raises(InputError, match="2 tracks: an orbit is of one object"):
        rso.orbit({1: night.tracks[1], 2: night.tracks[1]})


def test_places_ahead_are_those_of_the_verb(found):
    said = printed("orbit", SAMPLE, "--json")
    t = Time([each["t_utc"].removesuffix("Z") for each in said["predicted"]], scale="utc")
    ahead = found.predict(t.tai)  # of any scale
    for row, each in zip(ahead, said["predicted"], strict=True):
        assert row["direction"].ra.deg == pytest.approx(each["ra"], abs=1e-6)
        assert row["direction"].dec.deg == pytest.approx(each["dec"], abs=1e-6)
        assert row["sigma"].to_value("arcsec") == pytest.approx(each["sigma_arcsec"], rel=1e-6)
        assert row["range"].to_value("km") == pytest.approx(each["range_km"], rel=1e-9)
        assert row["altitude"].to_value("deg") == pytest.approx(each["alt"], abs=1e-5)
    assert ahead["rate_ra"].unit == u.arcsec / u.s


def test_places_are_where_skyfield_sees_its_elements(found):
    """Elements written for SGP4 and carried by another program, seen from the same site."""
    name, *lines = found.tle(norad_id=36097, name="INTELSAT 14").splitlines()
    assert name == "INTELSAT 14"
    ts = load.timescale(builtin=True)
    satellite = EarthSatellite(*lines, name, ts)
    t = found.epoch + np.array([-5.0, 0.0, 5.0]) * u.min
    places = found.predict(t)["direction"]
    site = wgs84.latlon(29.19, -81.05, elevation_m=10.0)
    planets = load_file(str(Path(skyfield_data.__file__).parent / "data" / "de421.bsp"))
    for moment, place in zip(t, places, strict=True):
        at = ts.from_astropy(moment)
        there = (planets["earth"] + site).at(at).observe(planets["earth"] + satellite)
        ra, dec, _ = there.radec()
        off_ra = (ra._degrees - place.ra.deg) * np.cos(place.dec.rad)
        assert np.hypot(off_ra, dec.degrees - place.dec.deg) * 3600.0 < 2.0
    planets.close()


def test_states_are_in_gcrs_and_go_through_time(found):
    at_epoch = found.gcrs(found.epoch)
    assert at_epoch.frame.name == "gcrs"
    assert np.allclose(at_epoch.cartesian.xyz.to_value("km"), found.r.to_value("km"), rtol=1e-12)
    later = found.gcrs(found.epoch + [0, 0.5, 1] * found.period)
    assert later.shape == (3,)
    x, y, _ = later.cartesian.xyz.to_value("km")
    turned = np.degrees(np.arctan2(y, x) - np.arctan2(y[0], x[0])) % 360.0
    assert turned[1] == pytest.approx(180.0, abs=0.5)
    assert (turned[2] + 180.0) % 360.0 == pytest.approx(180.0, abs=0.5)
    speed = later.velocity.norm().to_value("km/s")
    assert np.all((speed > 3.0) & (speed < 3.15))


def test_messages_carry_what_was_asked(found):
    message = found.omm("kvn", norad_id=100_001, name="SOMETHING", cospar="2009-064A")
    assert "NORAD_CAT_ID = 100001" in message
    assert "OBJECT_ID = 2009-064A" in message
    assert json.loads(found.omm("json"))[0]["REF_FRAME"] == "TEME"
    satrec = Satrec.twoline2rv(*found.tle().splitlines()[1:])
    assert satrec.no_kozai * 720.0 / np.pi == pytest.approx(1.0027, abs=1e-3)
    with pytest.raises(OrbitError, match="no elements"):
        found.tle(norad_id=1_000_000)


def test_what_is_too_little_is_told():
    t = Time("2026-01-01T00:00:00", scale="utc") + [0, 60] * u.s
    table = QTable({"time": t, "ra": [10.0, 10.25] * u.deg, "dec": [0.0, 0.0] * u.deg})
    with pytest.raises(OrbitError, match="no orbit: 2 direction"):
        rso.orbit(table, site=TRIPLE)


def _table(**columns) -> QTable:
    t = Time("2026-01-01T00:00:00", scale="utc") + np.arange(4) * 60 * u.s
    plain = {"time": t, "ra": np.arange(4) * 0.25 * u.deg, "dec": np.zeros(4) * u.deg}
    return QTable(plain | columns)


@pytest.mark.parametrize(
    ("what", "said", "error", "words"),
    [
        ([], {}, InputError, "the list is empty"),
        (3, {}, InputError, "int is no file, session, track or table"),
        ("nowhere.tdm", {}, OrbitError, "does not exist"),
        (ROOT / "tests", {}, SessionError, r"holds no session\.db"),
        (_table(), {"prior": "heo"}, InputError, "prior: 'heo' is none of auto"),
        (_table(), {"method": "laplace"}, InputError, "neither 'least squares' nor 'gooding'"),
        (_table(), {"sigma": 0}, InputError, "sigma: every one must be above 0"),
        (_table(), {"sigma": 1 * u.km}, InputError, "sigma is in km"),
        (_table(), {"site": (100.0, 8.0, 0.0)}, InputError, "latitude comes first"),
        (_table(object=["a", "b", "a", "b"]), {}, InputError, "holds 2 objects by its column"),
        (_table(ra=np.arange(4) * u.s), {}, InputError, "column 'ra' is in s: give it in deg"),
        (
            _table(time=Time(["2026-01-01T00:00:00"] * 4, scale="utc")),
            {},
            InputError,
            "several directions of one instant",
        ),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(what, said, error, words):
    with pytest.raises(error, match=words) as caught:
        rso.orbit(what, **{"site": TRIPLE, **said})
    assert "\n" not in str(caught.value)


def test_two_places_of_one_object_need_no_column_of_objects(tmp_path, monkeypatch):
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(tmp_path / "none.toml"))
    with pytest.raises(InputError, match="where this was seen from"):
        rso.orbit(_table())


# -- names -------------------------------------------------------------------------------------


def test_a_name_is_that_of_the_verb(found):
    said = printed("identify", SAMPLE, "--tle", CATALOGUE, "--json")
    name = rso.identify(SAMPLE, tle=CATALOGUE)
    assert (name.verdict, name.name) == (said["verdict"], said["matches"][0]["name"])
    assert name.norad_id == 36097
    assert [*name.matches["norad_id"]] == [each["norad_id"] for each in said["matches"]]
    for row, each in zip(name.matches, said["matches"], strict=True):
        assert row["separation"].to_value("arcsec") == each["separation_arcsec"]
        assert row["along_track_time"].to_value("s") == each["along_track_s"]
        assert row["probability"] == each["probability"]
    assert name.not_catalogued == said["not_catalogued"]
    for other in (rso.identify(found, tle=[CATALOGUE]), rso.identify(found, tle=str(CATALOGUE))):
        assert other.norad_id == 36097
    assert "INTELSAT 14" in repr(name)


def test_all_tracks_of_a_session_are_named_together(night):
    named = rso.identify(night, tle=CATALOGUE)
    assert {number: each.norad_id for number, each in named.items()} == {1: 36097}
    tracks = rso.track(night.measurements, site=SITE, exposure=10 * u.s)
    assert rso.identify(tracks, tle=CATALOGUE)[1].norad_id == 36097


def test_elements_may_be_text_and_matches_survive_ecsv(found, tmp_path):
    lines = CATALOGUE.read_text(encoding="utf-8").splitlines()
    at = next(n for n, line in enumerate(lines) if line.startswith("1 36097"))
    name = rso.identify(found, tle="\n".join(lines[at - 1 : at + 2]))
    assert name.verdict == "identified"
    name.matches.write(tmp_path / "matches.ecsv")
    again = QTable.read(tmp_path / "matches.ecsv")
    assert isinstance(again["elements_epoch"], Time)
    assert again["separation"].unit == u.arcsec


def test_what_no_catalogue_knows_is_unknown(found):
    others = [
        line
        for line in CATALOGUE.read_text(encoding="utf-8").splitlines()
        if "36097" not in line.split(" ")[1][:6] and "36097" not in line[:8]
    ]
    name = rso.identify(found, tle="\n".join(others))
    assert name.verdict == "unknown"
    assert (name.name, name.norad_id, name.probability) == (None, None, None)
    assert name.not_catalogued > 0.9


@pytest.mark.parametrize(
    ("said", "error", "words"),
    [
        ({"tle": "nowhere.tle"}, OrbitError, "nowhere.tle does not exist"),
        ({"tle": 3}, InputError, "tle: 3 is no file"),
        ({"tle": []}, OrbitError, "the list of element files is empty"),
        ({"tle": "not\nelements"}, OrbitError, "the text"),
        ({"gate": 0.0}, InputError, "gate: 0 deg must be above 0"),
        ({"gate": 1 * u.s}, InputError, "gate is in s"),
    ],
)
def test_what_names_need_is_asked_for(found, said, error, words):
    with pytest.raises(error, match=words):
        rso.identify(found, **{"tle": CATALOGUE, **said})


def test_without_elements_they_are_asked_for(found, tmp_path, monkeypatch):
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(tmp_path / "none.toml"))
    with pytest.raises(OrbitError, match="name element sets with tle="):
        rso.identify(found)
    with pytest.raises(InputError, match="no tracks"):
        rso.identify({}, tle=CATALOGUE)


# -- what others observed ----------------------------------------------------------------------


@needs_shared
@pytest.mark.shared_data
def test_real_observations_give_the_orbit_of_their_satellite():
    """Kazsat 2: three directions over 11 minutes; its elements of that day have 42,166 km."""
    by_gooding = rso.orbit(OBSERVED / "kazsat2_37749.json", method="gooding")
    assert by_gooding.label == "weak geometry"
    assert abs(by_gooding.a - 42_166 * u.km) < 3 * by_gooding.sigma_a
    navstar = rso.orbit(OBSERVED / "navstar77_43873.json")
    assert navstar.observations > 70
    assert abs(navstar.a - 26_560 * u.km) < 3 * navstar.sigma_a + 30 * u.km


@needs_shared
@pytest.mark.shared_data
def test_several_objects_and_missing_sites_in_files_are_told():
    lines = SHARED / "formats" / "iod"
    several = lines / "IOD_data_compliant.txt"
    with pytest.raises((OrbitError, ExportError)) as caught:
        rso.orbit(several)
    assert "\n" not in str(caught.value)
