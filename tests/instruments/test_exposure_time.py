"""Start and length of an exposure in the forms that cameras, programs and archives write."""

from typing import Any

import pytest
from astropy.time import Time, TimeDelta

from rsoconsole.instruments import exposure_time
from rsoconsole.sky import iso_to_utc_ns

BEGAN = "2023-06-23T05:31:30.300"
BEGAN_NS = iso_to_utc_ns(BEGAN)
START = Time(BEGAN, scale="utc")
EXPOSED = {"EXPTIME": 10.0}
HALF_MS = 500_000


def began(header: dict[str, Any]) -> int:
    """Start by a header that nothing is said against."""
    exposed = exposure_time(header)
    assert (exposed.fault, exposed.notes) == ("", ())
    assert exposed.exposure_s == 10.0
    assert exposed.start_utc_ns is not None
    return exposed.start_utc_ns


@pytest.mark.parametrize(
    ("value", "seconds"),
    [
        (10, 10.0),
        ("10.0", 10.0),
        ("10,00000", 10.0),
        ("0,500", 0.5),
        ("10.0 s", 10.0),
        ("10.0sec", 10.0),
        ("250 ms", 0.25),
        ("1/4", 0.25),
        ("1.0D1", 10.0),
        ("2 min", 120.0),
    ],
)
def test_exposure_times_are_read_in_the_forms_that_mean_one_thing(value, seconds):
    exposed = exposure_time({"DATE-OBS": BEGAN, "EXPTIME": value})
    assert exposed.exposure_s == pytest.approx(seconds, rel=1e-12)
    assert exposed.notes == ()


@pytest.mark.parametrize(
    "value",
    ["ten", "1.234,5", "1,234,567", "10 parsec", 0, -1.0, True, float("nan"), 10**400, "1/0"],
)
def test_what_is_no_exposure_time_is_named_and_not_used(value):
    exposed = exposure_time({"DATE-OBS": BEGAN, "EXPTIME": value})
    assert exposed.exposure_s is None
    assert exposed.fault.startswith("EXPTIME ")
    assert exposed.notes == (exposed.fault,)


def test_a_comma_that_may_be_of_thousands_is_read_as_decimal_and_said():
    exposed = exposure_time({"DATE-OBS": BEGAN, "EXPTIME": "10,000"})
    assert exposed.exposure_s == 10.0
    assert "read with a decimal comma" in exposed.notes[0]


@pytest.mark.parametrize("key", ["EXPOSURE", "XPOSURE", "TELAPSE", "ITIME", "EXP_TIME", "ELAPTIME"])
def test_other_keys_of_the_exposure_time_are_read(key):
    assert began({"DATE-OBS": BEGAN, key: 10.0}) == BEGAN_NS


def test_only_keys_that_say_so_are_not_in_seconds():
    assert exposure_time({"EXPOINUS": 250_000}).exposure_s == pytest.approx(0.25)
    assert exposure_time({"EXP_MS": 250}).exposure_s == pytest.approx(0.25)
    assert exposure_time({"EXPTIME": 250}).exposure_s == 250.0


def test_exposure_times_that_contradict_each_other_are_named():
    exposed = exposure_time({"DATE-OBS": BEGAN, "EXPTIME": 10.0, "EXPOSURE": 0.01})
    assert exposed.exposure_s == 10.0
    assert exposed.notes == ("EXPOSURE says 0.01 s, EXPTIME 10 s: EXPTIME is used",)


@pytest.mark.parametrize(
    "date",
    [
        "2023-06-23 05:31:30.300",
        "2023-06-23t05:31:30.3",
        "2023-06-23T05:31:30.300Z",
        "2023-06-23T05:31:30.300+00:00",
        "2023-06-23T07:31:30.300+02:00",
        "2023-06-23T05:31:30.300 UTC",
        "2023/06/23 05:31:30.3",
        "2023/06/23T05:31:30.3",
        "2023-06-23T05:31:30,300",
        "20230623T053130.3",
        "23/06/2023 05:31:30.3",
        "23.06.2023 05:31:30.3",
        "06/23/2023 05:31:30.3",
        "23-Jun-2023 05:31:30.300",
        "2023-Jun-23 05:31:30.300",
        "2023:06:23 05:31:30.300",
        "2023-174T05:31:30.300",
        "2023-06-23_05:31:30.3",
        "2023.06.23_05:32:07.30_TAI",
    ],
)
def test_dates_are_read_in_the_forms_that_mean_one_thing(date):
    assert began(EXPOSED | {"DATE-OBS": date}) == BEGAN_NS


@pytest.mark.parametrize("key", ["TIME-OBS", "UT", "UTC", "UTC-OBS", "UTSTART", "TIME-BEG"])
@pytest.mark.parametrize("date", ["2023-06-23", "2023/06/23", "23/06/2023"])
def test_a_time_of_day_may_have_a_card_of_its_own(date, key):
    assert began(EXPOSED | {"DATE-OBS": date, key: "05:31:30.300"}) == BEGAN_NS


def test_cards_with_underscores_are_read():
    assert began(EXPOSED | {"DATE_OBS": "2023-06-23", "TIME_OBS": "05:31:30.3"}) == BEGAN_NS


def test_old_fits_dates_have_the_day_first_and_are_of_the_twentieth_century():
    old = exposure_time(EXPOSED | {"DATE-OBS": "03/12/96", "UT": "02:03:28"})
    assert old.start_utc_ns == iso_to_utc_ns("1996-12-03T02:03:28")
    new = exposure_time(EXPOSED | {"DATE-OBS": "23/06/23", "UT": "02:03:28"})
    assert new.start_utc_ns is None
    assert "would be in the year 1923" in new.fault


def test_a_number_is_a_time_of_day_only_where_it_can_be_nothing_else():
    seconds = EXPOSED | {"DATE-OBS": "2023-06-23", "UTC": 19890.3}
    assert began(seconds) == BEGAN_NS
    either = exposure_time(EXPOSED | {"DATE-OBS": "2023-06-23", "UT": 5.525083})
    assert either.start_utc_ns is None
    assert "UT 5.525083 is not used: it may be hours" in either.fault
    beside = EXPOSED | {"DATE-OBS": BEGAN, "UTC": 19890.3}
    assert began(beside) == BEGAN_NS


@pytest.mark.parametrize(
    ("header", "fault"),
    [
        ({}, "DATE-OBS is missing"),
        ({"DATE-OBS": " "}, "DATE-OBS is missing"),
        ({"DATE-OBS": "2023-06-23"}, "DATE-OBS '2023-06-23' names no time of day"),
        ({"DATE-OBS": "05/06/2023"}, "day and month cannot be told apart"),
        ({"DATE-OBS": "0000-00-00T00:00:00"}, "it would be in the year 0"),
        ({"DATE-OBS": "2023-02-29T00:00:00"}, "there is no such day"),
        ({"DATE-OBS": "2023-06-23T25:00:00"}, "is not between 00:00:00 and 23:59:59"),
        ({"DATE-OBS": "20-JUN-23 05:31:30"}, "day and year cannot be told apart"),
        ({"DATE-OBS": "2023-366T05:31:30"}, "there is no such day"),
        ({"DATE-OBS": "1970-01-01T00:00:00"}, "a clock begins that was never set"),
        ({"DATE-OBS": "2016-12-31T23:59:60.5"}, "it is in a leap second or rounded up"),
        ({"DATE-OBS": "2023-06-23T05:31:60.5"}, "is not between 00:00:00 and 23:59:59"),
        ({"DATE-OBS": f"{BEGAN}_TAI", "TIMESYS": "UTC"}, "TAI by its ending, but TIMESYS is UTC"),
        ({"DATE-OBS": "2023-06-23", "UTC": "05:31:30", "TIMESYS": "LOCAL"}, "TIMESYS 'LOCAL'"),
        ({"MJD": 60118.23, "UT-END": "05:31:40"}, "MJD 60118.23, UT-END '05:31:40'"),
        ({"TIME-OBS": "05:31:30"}, "DATE-OBS is missing; not read, as its date"),
        ({"DATE-OBS": BEGAN, "TIMESYS": -(10**5000)}, "is no time scale that can be converted"),
        ({"DATE-OBS": "2023-06-23", "UT": 10**5000}, "it has no time of day like"),
        ({"DATE-OBS": 2023.47}, "DATE-OBS 2023.47 is not used: it is no date"),
        ({"DATE-OBS": "last night"}, "DATE-OBS 'last night' is not used: it is no date"),
        ({"MJD-OBS": 60118}, "MJD-OBS 60118 names no time of day"),
        ({"MJD-OBS": START.jd}, "is not a modified Julian date"),
        ({"DATE-OBS": BEGAN, "TIMESYS": "LOCAL"}, "TIMESYS 'LOCAL' is no time scale that can be"),
        ({"DATE-OBS": BEGAN, "TREFPOS": "BARYCENTER"}, "refers the time to another place"),
        ({"DATE-OBS": f"{BEGAN}Z", "TIMESYS": "TAI"}, "UTC by its offset, but TIMESYS is TAI"),
    ],
)
def test_the_reason_for_no_time_is_exact(header, fault):
    exposed = exposure_time(EXPOSED | header)
    assert exposed.start_utc_ns is None
    assert fault in exposed.fault


def test_all_that_is_missing_is_named_at_once():
    assert exposure_time({}).fault == "DATE-OBS and EXPTIME are missing"
    assert exposure_time({"DATE-OBS": BEGAN}).fault == "EXPTIME is missing"


ONE_S = TimeDelta(1.0, format="sec")
MIDDLE, END = START + 5 * ONE_S, START + 10 * ONE_S


@pytest.mark.parametrize(
    "header",
    [
        {"DATE-BEG": BEGAN},
        {"DATE-BEG": "2023-06-23", "TIME-OBS": "05:31:30.300"},
        {"DATE-OBS": "2023-06-23", "TIME-OBS": BEGAN},
        {"DATE-OBS": "2023-06-23", "TIME-OBS": "T05:31:30.300"},
        {"DATE-OBS": "2023-06-23", "TIME-OBS": "5h 31m 30.3s"},
        {"DATE-UTC": "2023-06-23", "TIME-UTC": "05:31:30.300"},
        {"UT-DATE": "2023-06-23", "UT-TIME": "05:31:30.300"},
        {"UTC-OBS": BEGAN},
        {"SHUTOPEN": BEGAN},
        {"MJD-STR": START.mjd},
        {"MJD-MID": MIDDLE.mjd},
        {"DATE-MID": MIDDLE.isot},
        {"DATE-AVG": MIDDLE.isot},
        {"DATE-END": END.isot},
        {"MJD-OBS": START.mjd},
        {"MJD-OBS": f"{START.mjd:.11f}"},
        {"MJD-OBS": f"{START.mjd:.11f}".replace(".", ",")},
        {"MJD-BEG": START.mjd},
        {"MJD-AVG": MIDDLE.mjd},
        {"MJD-END": END.mjd},
        {"JD": START.jd},
        {"JD-OBS": str(START.jd)},
        {"DATE-OBS": "not set", "MJD-OBS": START.mjd},
    ],
)
def test_other_cards_of_the_standard_stand_in_for_date_obs(header):
    exposed = exposure_time(EXPOSED | header)
    assert exposed.start_utc_ns is not None
    # A Julian date has 40 us to the last bit of a float.
    assert abs(exposed.start_utc_ns - BEGAN_NS) < HALF_MS
    assert len(exposed.notes) == (
        "not set" in header.values() or bool({"JD", "JD-OBS"} & {*header})
    )


def test_jd_utc_is_the_middle_and_that_is_said():
    exposed = exposure_time(EXPOSED | {"JD_UTC": MIDDLE.jd})
    assert exposed.start_utc_ns is not None
    assert abs(exposed.start_utc_ns - BEGAN_NS) < HALF_MS
    assert exposed.notes == (
        "JD_UTC is taken as mid-exposure, as SharpCap and AstroImageJ write it",
    )


def test_a_middle_without_a_length_is_no_start():
    exposed = exposure_time({"DATE-AVG": MIDDLE.isot})
    assert exposed.start_utc_ns is None
    assert "needs an exposure time" in exposed.fault


def test_the_length_may_be_from_start_to_end():
    exposed = exposure_time({"DATE-BEG": BEGAN, "DATE-END": END.isot})
    assert exposed.exposure_s == pytest.approx(10.0)
    assert "from DATE-BEG to DATE-END it is 10 s" in exposed.notes[0]


@pytest.mark.parametrize(
    "name",
    ["UTC(NIST)", "UTC(GPS)", "UT", "GMT", "Z", "utc", " ", "UTC ", "UTC+0", "Universal  time"],
)
def test_utc_has_many_names(name):
    assert began(EXPOSED | {"DATE-OBS": BEGAN, "TIMESYS": name}) == BEGAN_NS


@pytest.mark.parametrize(
    ("name", "scale"),
    [
        ("TAI", "tai"),
        ("IAT", "tai"),
        ("TT", "tt"),
        ("TT(TAI)", "tt"),
        ("TDT", "tt"),
        ("ET", "tt"),
        ("TDB", "tdb"),
        ("UT1", "ut1"),
    ],
)
@pytest.mark.parametrize("key", ["DATE-OBS", "MJD-OBS"])
def test_other_time_scales_are_converted_as_astropy_does(name, scale, key):
    there = getattr(START, scale)
    there.precision = 6
    value = there.isot if key == "DATE-OBS" else there.mjd
    assert abs(began(EXPOSED | {key: value, "TIMESYS": name}) - BEGAN_NS) < HALF_MS


@pytest.mark.parametrize("name", ["GPS", "GPST", "GPS Time"])
def test_gps_time_is_18_s_ahead_in_2023(name):
    ahead = EXPOSED | {"DATE-OBS": "2023-06-23T05:31:48.300", "TIMESYS": name}
    assert began(ahead) == BEGAN_NS


def test_the_sdss_has_its_time_of_day_in_tai():
    header = EXPOSED | {"DATE-OBS": "2009-09-29", "TAIHMS": "20:22:47.41", "TIMESYS": "TAI"}
    assert began(header) == iso_to_utc_ns("2009-09-29T20:22:13.41")


def test_date_obs_left_in_utc_beside_tai_is_found_by_the_cards_that_are_tai():
    """As the LSST pipelines leave frames of DECam."""
    header = {
        "EXPTIME": 120.0,
        "DATE-OBS": "2020-03-06T00:04:15.410235",
        "TIME-OBS": "00:04:15.410235",
        "MJD-OBS": 58914.00295614,
        "DATE-AVG": "2020-03-06T00:05:52.410235000",
        "TIMESYS": "TAI",
    }
    exposed = exposure_time(header)
    assert exposed.start_utc_ns == iso_to_utc_ns("2020-03-06T00:04:15.410235")
    assert exposed.notes == ("DATE-OBS is UTC although TIMESYS is TAI: so it agrees with DATE-AVG",)


def test_programs_that_were_not_ready_for_2000_counted_on():
    exposed = exposure_time(EXPOSED | {"DATE-OBS": "26/07/102", "TIME-OBS": "19:36:37"})
    assert exposed.start_utc_ns == iso_to_utc_ns("2002-07-26T19:36:37")


def test_local_time_with_its_offset_is_no_riddle():
    assert (
        began(EXPOSED | {"DATE-OBS": "2023-06-23T01:31:30.3-04:00", "TIMESYS": "LOCAL"}) == BEGAN_NS
    )


@pytest.mark.parametrize(
    ("other", "off"),
    [
        (
            {"MJD-OBS": (START + 3600 * ONE_S).mjd},
            "MJD-OBS 2023-06-23T06:31:30.300Z, 3600.0 s later",
        ),
        ({"MJD-OBS": 60118.3}, "6029.7 s later"),
        ({"DATE-BEG": "2023-06-23T05:31:29.300"}, "1.0 s earlier"),
        ({"DATE-AVG": BEGAN}, "DATE-AVG less half of the exposure"),
        ({"DATE-END": (END + 3 * ONE_S).isot}, "3.0 s later"),
        ({"TIME-OBS": "06:31:30"}, "TIME-OBS '06:31:30' is not used"),
        ({"UT": 6.525}, "UT 6.525 is not used"),
        ({"TIME-OBS": "2023-06-23T06:31:30"}, "is not used: it is not the time of day"),
    ],
)
def test_times_that_contradict_each_other_are_named_and_the_first_is_used(other, off):
    exposed = exposure_time(EXPOSED | {"DATE-OBS": BEGAN} | other)
    assert exposed.start_utc_ns == BEGAN_NS
    (note,) = exposed.notes
    assert off in note


@pytest.mark.parametrize(
    "other",
    [
        {"MJD-OBS": round(START.mjd, 5)},
        {"MJD-AVG": round(MIDDLE.mjd, 6)},
        {"DATE-AVG": "2023-06-23T05:31:35"},
        {"DATE-END": "2023-06-23T05:31:40.35"},
        {"TIME-OBS": "05:31:30"},
        {"TIME-OBS": BEGAN},
        {"UT": 5.525},
        {"JD": round(START.jd, 5)},
    ],
)
def test_rounding_is_no_contradiction(other):
    assert began(EXPOSED | {"DATE-OBS": BEGAN} | other) == BEGAN_NS


def test_of_times_that_agree_the_one_written_most_finely_is_used():
    assert began(EXPOSED | {"DATE-OBS": BEGAN[:19], "DATE-BEG": BEGAN}) == BEGAN_NS
    # To the millisecond is fine enough, and what is 50 ms away is another stamp.
    assert (
        began(EXPOSED | {"DATE-OBS": BEGAN, "DATE-BEG": "2023-06-23T05:31:30.350000"}) == BEGAN_NS
    )


def test_a_time_of_few_digits_is_said_to_be_coarse():
    exposed = exposure_time(EXPOSED | {"MJD-OBS": 60118.2302})
    assert exposed.notes == ("the time of exposure by MJD-OBS is known to 8.64 s only",)


def test_a_date_alone_is_held_against_the_time_that_is_used():
    same = EXPOSED | {"DATE-OBS": "2023-06-23", "MJD-OBS": START.mjd}
    assert abs(began(same) - BEGAN_NS) < HALF_MS
    other = exposure_time(same | {"DATE-OBS": "2023-05-23"})
    assert "MJD-OBS is of another day, and is used" in other.notes[0]


@pytest.mark.parametrize("key", ["UTC", "UT", "UTC-OBS", "UTSTART"])
@pytest.mark.parametrize("scale", ["TAI", "GPS", "TT"])
def test_a_card_named_utc_is_utc_in_any_time_scale(key, scale):
    header = EXPOSED | {"TIMESYS": scale, key: "05:31:30.300"}
    exposed = exposure_time(header | {"DATE-OBS": "2023-06-23"})
    assert exposed.start_utc_ns == BEGAN_NS
    assert exposed.notes == (f"{key} is UTC by its name, although TIMESYS is {scale}",)
    exposed = exposure_time(header | {"DATE-OBS": BEGAN})
    assert exposed.start_utc_ns == BEGAN_NS
    assert f"DATE-OBS is UTC although TIMESYS is {scale}" in exposed.notes[0]


def test_a_card_named_utc_agrees_with_a_date_in_tai():
    header = {"TIMESYS": "TAI", "DATE-OBS": "2023-06-23T05:32:07.300", "UTC": "05:31:30.3"}
    assert began(EXPOSED | header) == BEGAN_NS


@pytest.mark.parametrize(
    "other", [{"TIME-OBS": "05:31:30.3"}, {"UT": "05:31:30.3"}, {"MJD-OBS": START.mjd}]
)
def test_a_date_at_midnight_beside_a_time_is_a_date(other):
    exposed = exposure_time(EXPOSED | {"DATE-OBS": "2023-06-23T00:00:00.000"} | other)
    assert exposed.start_utc_ns is not None
    assert abs(exposed.start_utc_ns - BEGAN_NS) < HALF_MS
    (note,) = exposed.notes
    assert "DATE-OBS is exactly midnight, and taken as a date: the time is by" in note


@pytest.mark.parametrize("other", [{"UT": "00:00:00"}, {"DATE-END": "2023-06-23T00:00:10"}])
def test_midnight_is_a_time_where_another_card_has_it_too(other):
    header = EXPOSED | {"DATE-OBS": "2023-06-23T00:00:00"}
    assert began(header | other) == iso_to_utc_ns("2023-06-23T00:00:00")
    assert "is exactly midnight" in exposure_time(header).notes[0]


def test_seconds_that_were_rounded_up_are_of_the_next_minute():
    assert began(EXPOSED | {"DATE-OBS": "2023-06-23T05:31:60.0"}) == iso_to_utc_ns(
        "2023-06-23T05:32:00"
    )
    assert began(EXPOSED | {"DATE-OBS": "20230623053160"}) == iso_to_utc_ns("2023-06-23T05:32:00")


def test_the_start_by_name_goes_before_other_times_of_day():
    header = {"DATE-OBS": "2023-06-23", "UT": "05:31:35.3", "UT-STR": "05:31:30.3"}
    exposed = exposure_time(EXPOSED | header)
    assert exposed.start_utc_ns == BEGAN_NS
    assert exposed.notes == (
        "UT '05:31:35.3' is not used: it is not the time of day of DATE-OBS and UT-STR",
    )


def test_exposures_that_are_added_up_or_paused_are_named():
    added = exposure_time({"DATE-OBS": BEGAN, "ITIME": 1.0, "COADDS": 10, "ELAPTIME": 10.0})
    assert added.exposure_s == 10.0
    assert added.notes == ("ITIME 1 s is that of each of 10 COADDS: the exposure time is 10 s",)
    paused = exposure_time(EXPOSED | {"DATE-OBS": BEGAN, "TELAPSE": 15.0})
    assert paused.exposure_s == 10.0
    assert "TELAPSE says 15 s from start to end" in paused.notes[0]


def test_the_length_may_be_twice_that_to_the_middle():
    exposed = exposure_time({"DATE-OBS": BEGAN, "DATE-AVG": MIDDLE.isot})
    assert exposed.exposure_s == pytest.approx(10.0)
    assert "to DATE-AVG, the middle, it is 5 s, 10 s in all" in exposed.notes[0]


def test_the_length_may_be_to_the_time_of_day_of_the_end():
    midnight = {"DATE-OBS": "2023-06-23", "UT-STR": "23:59:55.0", "UT-END": "00:00:05.0"}
    exposed = exposure_time(midnight)
    assert exposed.exposure_s == pytest.approx(10.0)
    assert "to UT-END it is 10 s" in exposed.notes[0]
    assert exposure_time(midnight | {"UT-END": "soon"}).exposure_s is None


def test_a_card_named_utc_is_held_against_a_time_with_an_offset():
    header = {"DATE-OBS": "2023-06-23T07:31:30.300+02:00", "UTC": "05:31:30.3"}
    assert began(EXPOSED | header) == BEGAN_NS
