"""What callers give: units, times and places are understood, or refused in a clear sentence."""

from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import Angle, EarthLocation, SkyCoord
from astropy.time import Time

from rsoconsole.base import ConfigError, InputError, RsoconsoleError
from rsoconsole.config import Config
from rsoconsole.library._given import (
    configured_site,
    direction_deg,
    in_unit,
    instants_utc_ns,
    resolve_config,
    site_of,
)
from rsoconsole.records import Site

MIDNIGHT_NS = 1_767_225_600_000_000_000
"""2026-01-01T00:00:00 UTC, by the Unix clock."""


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        (10.3, "deg", 10.3),
        (1 * u.hourangle, "deg", 15.0),
        (Angle("12h30m"), "deg", 187.5),
        (1 * u.arcmin, "arcsec", 60.0),
        (2 * u.min, "s", 120.0),
        (np.float32(0.5), "s", 0.5),
        (1.5 * u.arcsec / u.pix, "arcsec / pix", 1.5),
    ],
)
def test_numbers_come_in_the_unit_they_are_needed_in(value, unit, expected):
    assert in_unit(value, unit, "x") == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (3 * u.km, "radius is in km: give it in deg"),
        (3 * u.dimensionless_unscaled, "radius is in no unit|radius is in : give it in deg"),
        (float("nan"), "radius is NaN"),
        (np.inf * u.deg, "radius is NaN or infinite"),
        ("3", "radius: '3' is no number of deg"),
        (True, "radius: True is no number"),
        ([1.0, 2.0], "radius: one value is needed, not 2"),
        (None, "radius: None is no number"),
    ],
)
def test_what_is_no_such_number_is_refused_by_name(value, words):
    with pytest.raises(InputError, match=words):
        in_unit(value, "deg", "radius")


@pytest.mark.parametrize(
    "value",
    [
        Time("2026-01-01T00:00:00", scale="utc"),
        Time("2026-01-01T00:00:37", scale="tai"),
        Time(2461041.5, format="jd", scale="utc"),
        datetime(2026, 1, 1, tzinfo=UTC),
        datetime(2026, 1, 1, 3, tzinfo=timezone(timedelta(hours=3))),
    ],
)
def test_times_of_every_scale_are_the_same_instant(value):
    assert int(instants_utc_ns(value, "t")) == MIDNIGHT_NS


def test_times_keep_their_nanoseconds_and_their_shape():
    t = Time(["2026-01-01T00:00:00.123456789", "2026-01-01T00:00:01"], scale="utc", precision=9)
    assert instants_utc_ns(t, "t").tolist() == [MIDNIGHT_NS + 123_456_789, MIDNIGHT_NS + 10**9]
    many = [datetime(2026, 1, 1, tzinfo=UTC), Time("2026-01-01T00:00:01", scale="utc")]
    assert instants_utc_ns(many, "t").tolist() == [MIDNIGHT_NS, MIDNIGHT_NS + 10**9]


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (datetime(2026, 1, 1), "has no time zone"),  # noqa: DTZ001 -- that is the point
        ("2026-01-01T00:00:00", "has no time scale: give an astropy Time"),
        (2461041.5, "has no time scale"),
        (Time(1.0, format="jd", scale="local"), "not tied to UTC"),
        (Time([1.0, 2.0], format="unix", scale="utc")[:0].copy(), None),
    ],
)
def test_naive_times_are_refused(value, words):
    if words is None:
        assert instants_utc_ns(value, "t").shape == (0,)
        return
    with pytest.raises(InputError, match=words):
        instants_utc_ns(value, "t_start")


def test_a_missing_time_is_refused():
    t = Time(["2026-01-01T00:00:00", "2026-01-01T00:00:01"], scale="utc")
    t[1] = np.ma.masked
    with pytest.raises(InputError, match="missing"):
        instants_utc_ns(t, "time")


def test_directions_of_any_frame_are_icrs():
    centre = SkyCoord(0 * u.deg, 0 * u.deg, frame="galactic")
    ra_deg, dec_deg = direction_deg(centre, "center")
    # The galactic centre, by the IAU's definition of 1958.
    assert (ra_deg, dec_deg) == pytest.approx((266.4050, -28.9362), abs=2e-4)
    with pytest.raises(InputError, match="one direction is needed, not 2"):
        direction_deg(SkyCoord([1, 2] * u.deg, [1, 2] * u.deg), "center")


def test_places_are_those_of_an_earth_location():
    known = EarthLocation.from_geodetic(lon=-81.05 * u.deg, lat=29.19 * u.deg, height=10 * u.m)
    for place in (known, (29.19, -81.05, 10.0), (29.19 * u.deg, 278.95 * u.deg, 0.01 * u.km)):
        site = site_of(place)
        assert site.latitude_deg == pytest.approx(29.19, abs=1e-9)
        assert site.longitude_deg == pytest.approx(-81.05, abs=1e-9)
        assert site.elevation_m == pytest.approx(10.0, abs=1e-4)


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ((-110.0, 29.0, 0.0), "latitude comes first"),
        ((29.0, -81.0), "give an EarthLocation"),
        ("Daytona", "give an EarthLocation"),
        ((29.0, -81.0, 6_378_137.0), "metres are meant"),
        ((29.0, -81.0 * u.km, 0.0), "site, longitude is in km"),
        (EarthLocation.from_geodetic([1, 2] * u.deg, [3, 4] * u.deg), "one place is needed, not 2"),
    ],
)
def test_what_is_no_place_is_refused(place, words):
    with pytest.raises(InputError, match=words):
        site_of(place)


def test_a_site_that_nobody_set_is_none(tmp_path, monkeypatch):
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(tmp_path / "none.toml"))
    assert configured_site(None) is None
    assert configured_site(Config()) is None
    path = tmp_path / "own.toml"
    path.write_text("[site]\nlatitude_deg = 47.0\nlongitude_deg = 8.5\n", encoding="utf-8")
    assert configured_site(path) == Site(latitude_deg=47.0, longitude_deg=8.5, elevation_m=10.0)
    assert configured_site(resolve_config(path)) == configured_site(path)


def test_a_configuration_may_be_an_object_with_some_settings_changed(tmp_path):
    config = Config.model_validate({"detector": {"tau": 0.6}})
    assert resolve_config(config) is config
    assert resolve_config(config, {"detector.tau": 0.2}).detector.tau == 0.2
    assert resolve_config(config, {"detector.tau": None}).detector.tau == 0.6
    with pytest.raises(ConfigError, match=r"detector\.tau"):
        resolve_config(config, {"detector.tau": 7.0})
    with pytest.raises(ConfigError):
        resolve_config(tmp_path / "nowhere.toml")


def test_an_input_error_is_a_value_error_and_the_programs_own():
    assert issubclass(InputError, ValueError)
    assert issubclass(InputError, RsoconsoleError)
