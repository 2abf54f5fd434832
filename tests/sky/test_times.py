"""Times: one integer and its faces, against astropy."""

import numpy as np
import pytest
from astropy.time import Time
from hypothesis import given
from hypothesis import strategies as st

from rsoconsole.sky import times
from rsoconsole.words import utc_ns_to_iso

INSTANT_NS = st.integers(0, 4_102_444_800 * 10**9)  # 1970 to 2100


@given(t_utc_ns=INSTANT_NS)
def test_nanoseconds_survive_being_written(t_utc_ns):
    assert times.iso_to_utc_ns(utc_ns_to_iso(t_utc_ns, decimals=9)) == t_utc_ns
    half_ms = 500_000
    assert abs(times.iso_to_utc_ns(utc_ns_to_iso(t_utc_ns)) - t_utc_ns) <= half_ms


@pytest.mark.parametrize(
    ("text", "t_utc_ns"),
    [
        ("1970-01-01T00:00:00Z", 0),
        ("2023-06-22T03:04:05.678Z", 1_687_403_045_678_000_000),
        ("2023-06-22T03:04:05.678", 1_687_403_045_678_000_000),
        ("2023-06-22 05:04:05.678+02:00", 1_687_403_045_678_000_000),
        ("2024-02-29T12:00", 1_709_208_000_000_000_000),
    ],
)
def test_iso_times_are_read(text, t_utc_ns):
    assert times.iso_to_utc_ns(text) == t_utc_ns


@pytest.mark.parametrize(
    "text",
    ["", "now", "2023-06-22", "2023-02-29T00:00:00Z", "2023-06-22T24:00:00Z",
     "2023-06-22T03:04:61Z", "22/06/2023 03:04:05", "2023-06-22T03:04:05,5Z",
     "2023-06-22T03:04:05Zebra", None, 5],
)  # fmt: skip
def test_what_is_no_time_never_becomes_one(text):
    with pytest.raises(ValueError, match=r".+"):
        times.iso_to_utc_ns(text)


def test_a_time_is_rounded_into_the_next_day_as_a_whole():
    last = times.iso_to_utc_ns("2023-12-31T23:59:59.9996Z")
    assert utc_ns_to_iso(last) == "2024-01-01T00:00:00.000Z"
    assert utc_ns_to_iso(last, decimals=0) == "2024-01-01T00:00:00Z"


@pytest.fixture(scope="module")
def astropy_times():
    """Instants of 2012 to 2025 with astropy's reading of them, from the same IERS table."""
    from astropy.time import Time
    from astropy.utils import iers

    rng = np.random.default_rng(5)
    t = rng.integers(1_330_000_000, 1_760_000_000, 40) * times.NS_PER_S + 123_456_789
    with iers.conf.set_temp("auto_download", False):
        theirs = Time(
            [utc_ns_to_iso(int(one), 9).rstrip("Z") for one in t], scale="utc", format="isot"
        )
        yield t, theirs


def test_tt_and_ut1_agree_with_astropy_to_a_millisecond(astropy_times):
    t, theirs = astropy_times
    nanosecond, millisecond = 1e-9 / 86400, 1e-3 / 86400
    for (jd_1, jd_2), scale, tolerance in (
        (times.jd_utc(t), theirs.utc, nanosecond),
        (times.jd_tt(t), theirs.tt, nanosecond),
        (times.jd_ut1(t), theirs.ut1, millisecond),
    ):
        assert np.max(np.abs((jd_1 - scale.jd1) + (jd_2 - scale.jd2))) < tolerance


def test_sidereal_time_agrees_with_astropy_to_a_hundredth_arcsecond(astropy_times):
    t, theirs = astropy_times
    hundredth = 0.02 / 3600
    apparent = theirs.sidereal_time("apparent", -81.05).deg
    assert np.max(np.abs((times.lst_deg(-81.05, t) - apparent + 180) % 360 - 180)) < hundredth


def test_leap_seconds_are_counted_on_their_day():
    before = times.iso_to_utc_ns("2016-12-31T23:59:59Z")
    assert float(times.tai_minus_utc_s(before)) == 36.0
    assert float(times.tai_minus_utc_s(before + 2 * times.NS_PER_S)) == 37.0


def test_earth_orientation_beyond_the_table_holds_its_edge():
    far = times.iso_to_utc_ns("2060-01-01T00:00:00Z")
    orientation = times.earth_orientation(far)
    assert abs(orientation.ut1_minus_utc_s) < 1.0


@pytest.mark.parametrize("scale", ["tai", "tt", "tdb", "ut1"])
@pytest.mark.parametrize(
    "utc", ["1985-03-01T12:00:00", "2016-12-31T23:59:58.5", "2017-01-01T00:00:00.5", "2023-06-23"]
)
def test_time_scales_become_utc_as_in_astropy(scale, utc):
    there = getattr(Time(utc, scale="utc"), scale)
    count_ns = round(((there.jd1 - times.JD_UNIX) + there.jd2) * 86_400e9)
    expected_ns = times.iso_to_utc_ns(utc if "T" in utc else f"{utc}T00:00")
    # UT1 is of Bulletin A here and of B there, which were 0.16 ms apart in 1985.
    half_ms = 500_000
    assert abs(times.utc_ns_of_scale(count_ns, scale.upper()) - expected_ns) < half_ms


def test_gps_time_is_19_s_behind_tai_and_another_scale_is_refused():
    t_ns = 1_687_403_045_000_000_000
    ahead_s = (times.utc_ns_of_scale(t_ns, "GPS") - times.utc_ns_of_scale(t_ns, "TAI")) / 1e9
    assert ahead_s == 19.0
    assert times.utc_ns_of_scale(t_ns, "UTC") == t_ns
    with pytest.raises(ValueError, match="TCB is not converted"):
        times.utc_ns_of_scale(t_ns, "TCB")
