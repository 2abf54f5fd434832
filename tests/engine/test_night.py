"""Dusk and dawn are where others put them, and a night ends for what ends nights."""

from collections.abc import Callable

import numpy as np
import pytest

from rsoconsole.config import Config
from rsoconsole.engine.aim.night import darkness_words, night_end, overrides_still_needed
from rsoconsole.instruments import SkyReport
from rsoconsole.records import Site
from rsoconsole.sky import iso_to_utc_ns, night_span
from rsoconsole.words import NS_PER_DAY, NS_PER_S, utc_ns_to_iso

HOUR_NS = 3600 * NS_PER_S
NOON = iso_to_utc_ns("2023-06-22T17:00:00Z")
MIDNIGHT = iso_to_utc_ns("2023-06-22T05:30:00Z")
"""Both in Daytona Beach, the configuration's default site."""
CLEAR = SkyReport(weather="ok", dome="open")


def site(latitude_deg: float, longitude_deg: float) -> Site:
    return Site(latitude_deg=latitude_deg, longitude_deg=longitude_deg, elevation_m=0.0)


def guarded(**limits: float) -> Config:
    return Config.model_validate(
        {"indi": {"weather": "Vane", "dome": "Roof"}, "limits": dict(limits)}
    )


@pytest.fixture(scope="module")
def sun_altitude_deg() -> Callable[[Site, int], float]:
    """By astropy, from its own ephemeris, without refraction."""
    from astropy import units as u
    from astropy.coordinates import AltAz, EarthLocation, get_sun
    from astropy.time import Time
    from astropy.utils import iers

    iers.conf.auto_download = False

    def altitude(where: Site, t_utc_ns: int) -> float:
        place = EarthLocation(
            lat=where.latitude_deg * u.deg,
            lon=where.longitude_deg * u.deg,
            height=where.elevation_m * u.m,
        )
        seconds, rest = divmod(t_utc_ns, NS_PER_S)
        t = Time(seconds, rest / NS_PER_S, format="unix", scale="utc")
        return float(get_sun(t).transform_to(AltAz(obstime=t, location=place)).alt.deg)

    return altitude


@pytest.mark.parametrize(
    ("latitude_deg", "longitude_deg", "now", "twilight_deg"),
    [
        (29.19, -81.05, "2023-06-22T17:00:00Z", -12.0),  # Daytona Beach, from noon
        (29.19, -81.05, "2023-06-22T05:30:00Z", -12.0),  # and from midnight
        (-33.5, -70.5, "2024-12-21T16:00:00Z", -18.0),  # the Andes in summer
        (0.0, 179.9, "2026-03-20T00:00:00Z", -6.0),  # equator, beside the date line
        (64.1, -21.9, "2025-10-01T12:00:00Z", -12.0),  # Reykjavik in autumn
        (69.65, 18.96, "2025-03-20T12:00:00Z", -12.0),  # Tromso at the equinox
        (69.65, 18.96, "2025-12-21T11:00:00Z", 0.0),  # and in its polar night by day
        (51.48, 0.0, "2025-06-21T12:00:00Z", -12.0),  # Greenwich's shortest night
    ],
)
def test_the_sun_stands_at_the_limit_at_dusk_and_dawn(
    sun_altitude_deg: Callable[[Site, int], float],
    latitude_deg: float,
    longitude_deg: float,
    now: str,
    twilight_deg: float,
) -> None:
    where, now_ns = site(latitude_deg, longitude_deg), iso_to_utc_ns(now)
    span = night_span(where, now_ns, twilight_deg)
    assert span is not None
    dusk_ns, dawn_ns = span
    half_an_arcminute = 0.5 / 60
    if now_ns - NS_PER_DAY < dusk_ns:
        assert sun_altitude_deg(where, dusk_ns) == pytest.approx(
            twilight_deg, abs=half_an_arcminute
        )
    if dawn_ns < now_ns + NS_PER_DAY:
        assert sun_altitude_deg(where, dawn_ns) == pytest.approx(
            twilight_deg, abs=half_an_arcminute
        )
    assert sun_altitude_deg(where, (dusk_ns + dawn_ns) // 2) < twilight_deg
    assert dawn_ns > now_ns
    for t_ns in range(max(now_ns, dusk_ns) + HOUR_NS // 4, dawn_ns - HOUR_NS // 4, HOUR_NS):
        assert sun_altitude_deg(where, t_ns) < twilight_deg
    for t_ns in range(now_ns, dusk_ns, HOUR_NS):
        assert sun_altitude_deg(where, t_ns) > twilight_deg


@pytest.mark.parametrize("now", ["2025-06-21T00:00:00Z", "2025-06-21T12:00:00Z"])
@pytest.mark.parametrize("latitude_deg", [60.5, 69.65, 90.0])
def test_in_a_polar_summer_it_never_gets_dark(latitude_deg: float, now: str) -> None:
    # Midnight Sun at latitude 60.5: 23.4 - (90 - 60.5) = -6.1 deg.
    assert night_span(site(latitude_deg, 18.96), iso_to_utc_ns(now), -12.0) is None


@pytest.mark.parametrize(("latitude_deg", "month"), [(90.0, 12), (-90.0, 6), (-89.0, 6)])
def test_in_a_polar_night_the_span_is_cut_a_day_before_and_after(
    latitude_deg: float, month: int
) -> None:
    now_ns = iso_to_utc_ns(f"2025-{month:02d}-21T12:00:00Z")
    assert night_span(site(latitude_deg, 0.0), now_ns, -12.0) == (
        now_ns - NS_PER_DAY,
        now_ns + NS_PER_DAY,
    )


def test_the_night_is_the_same_from_noon_before_and_from_within() -> None:
    where = site(29.19, -81.05)
    from_within = night_span(where, MIDNIGHT, -12.0)
    from_noon = night_span(where, iso_to_utc_ns("2023-06-21T17:00:00Z"), -12.0)
    assert from_within is not None
    assert from_noon is not None
    assert np.abs(np.subtract(from_within, from_noon)).max() < NS_PER_S


def test_night_goes_on_in_the_dark_and_ends_at_dawn() -> None:
    config = Config()
    assert night_end(config, MIDNIGHT, None) is None
    end = night_end(config, NOON, None)
    assert end is not None
    assert end.cause == "dawn"
    # The Sun culminates at 90 - 29.19 + 23.44 deg, some 30 minutes later.
    assert "above the limit of -12.0" in end.detail
    assert night_end(config, NOON, None, {"sun"}) is None
    assert night_end(config, NOON, None, {"weather", "dome", "clock"}) == end


def test_the_last_second_before_dawn_is_night_and_the_next_is_not() -> None:
    config = Config()
    span = night_span(config.site.to_site(), MIDNIGHT, config.limits.twilight_deg)
    assert span is not None
    dusk_ns, dawn_ns = span
    assert night_end(config, dawn_ns - NS_PER_S, None) is None
    assert night_end(config, dawn_ns + NS_PER_S, None) is not None
    assert night_end(config, dusk_ns + NS_PER_S, None) is None
    assert night_end(config, dusk_ns - NS_PER_S, None) is not None


@pytest.mark.parametrize(
    ("weather", "dome", "cause"),
    [
        ("ok", "open", None),
        ("warning", "open", None),
        ("alert", "open", "weather"),
        ("silent", "open", "weather"),
        (None, "open", "weather"),
        ("ok", "closed", "dome"),
        ("ok", "moving", "dome"),
        ("ok", "silent", "dome"),
        ("ok", None, "dome"),
        ("alert", "closed", "dome"),
    ],
)
def test_weather_and_dome_end_a_night(weather, dome, cause) -> None:
    sky = SkyReport(weather=weather, dome=dome, detail="the driver's words")
    end = night_end(guarded(), MIDNIGHT, sky)
    assert (end.cause if end else None) == cause
    if end is not None:
        assert "the driver's words" in end.detail
        overridden = {"weather", "dome"}
        assert night_end(guarded(), MIDNIGHT, sky, overridden) is None
        assert night_end(guarded(), MIDNIGHT, sky, overridden - {cause}) is not None


def test_what_is_not_configured_ends_nothing() -> None:
    storm = SkyReport(weather="alert", dome="closed")
    assert night_end(Config(), MIDNIGHT, storm) is None


def test_a_configured_station_that_nobody_asks_ends_the_night() -> None:
    end = night_end(guarded(), MIDNIGHT, None, {"dome"})
    assert end is not None
    assert end.cause == "weather"
    assert "Vane is silent" in end.detail


def test_an_override_falls_when_its_reason_is_gone() -> None:
    given = {"sun", "weather", "dome", "clock"}
    storm = SkyReport(weather="alert", dome="closed")
    assert overrides_still_needed(guarded(), NOON, storm, given) == given
    assert overrides_still_needed(guarded(), MIDNIGHT, storm, given) == given - {"sun"}
    assert overrides_still_needed(guarded(), MIDNIGHT, CLEAR, given) == {"clock"}
    # So a Sun let pass at dusk ends the night at dawn.
    kept = overrides_still_needed(guarded(), MIDNIGHT, CLEAR, {"sun"})
    assert night_end(guarded(), NOON, CLEAR, kept) is not None


def test_an_operator_is_told_how_long_to_wait() -> None:
    assert darkness_words(Config(), NOON).startswith("wait until 2023-06-23T01:2")
    assert darkness_words(Config(), MIDNIGHT).startswith("it is dark until 2023-06-22T09:2")
    north = Config.model_validate({"site": {"latitude_deg": 80.0}})
    assert "does not sink to -12.0 deg" in darkness_words(north, NOON)


def test_times_are_told_to_the_second() -> None:
    span = night_span(site(29.19, -81.05), MIDNIGHT, -12.0)
    assert span is not None
    assert utc_ns_to_iso(span[1], 0) in darkness_words(Config(), MIDNIGHT)
