"""IOD lines: what observers' own samples say is one, and what is written comes back."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rsoconsole.base import ExportError
from rsoconsole.library import ExportOptions, ReadOptions, Target, read_observations, render
from rsoconsole.library.formats._iod_reader import parse_iod_line
from rsoconsole.library.formats.iod import (
    mantissa_exponent_code,
    position_sigma_arcsec,
    round_to_ms_utc_ns,
    to_iod,
)
from rsoconsole.library.formats.night import read_exported_night
from rsoconsole.records import Site
from rsoconsole.sky import iso_to_utc_ns, wrap_180
from tests.nights.export_nights import LEAP, NS, closed_night, night_of, read_iod, taken_rows
from tests.nights.samples import SAMPLE

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data" / "formats" / "iod"
ANSWERED_BOTH_WAYS = {
    # The compliant samples hold this very line, under "including blank".
    "12345 98 123A   2007   20081122112233444 56 14 1122334+112233 39 S",
    # The format's own example has a flash period in these columns: "P-010 05  10000".
    "23794 96 010A   2701 G 20040506012614270 17 25 1100114-184298 38 I-020 10  12345",
}
ARCSEC = 1 / 3600


def is_iod(line: str) -> bool:
    try:
        parse_iod_line(line)
    except ExportError:
        return False
    return True


def answered() -> list[tuple[str, bool]]:
    """Lines of observers' samples with TruSat's answers."""
    if not SHARED.exists():
        return []
    good = (SHARED / "IOD_data_compliant.txt").read_text().split("\n")
    answers = (SHARED / "IOD_data_compliant_answers.txt").read_text().split("\n")
    pairs = [(line, say.startswith("True")) for line, say in zip(good, answers, strict=False)]
    for text in (SHARED / "IOD_data_noncompliant_answers.txt").read_text().split("\n"):
        say, _, line = text.partition(",")
        if line and line not in ANSWERED_BOTH_WAYS:
            pairs.append((line, say == "True"))
    return pairs


@pytest.mark.shared_data
@pytest.mark.skipif(not SHARED.exists(), reason=f"{SHARED} is not here")
def test_every_sample_is_answered_as_trusat_answers_it():
    pairs = answered()
    assert sum(is_good for _, is_good in pairs) == 51
    assert sum(not is_good for _, is_good in pairs) > 120
    wrong = [(line, is_good) for line, is_good in pairs if is_iod(line) != is_good]
    assert wrong == []


@pytest.mark.shared_data
@pytest.mark.skipif(not SHARED.exists(), reason=f"{SHARED} is not here")
def test_a_line_that_the_samples_answer_both_ways_is_read():
    assert all(is_iod(line) for line in ANSWERED_BOTH_WAYS)
    assert len(read_iod(SHARED / "IOD_data_compliant.txt")) == 51


HEAD = "12345 98 123A   2007 G 20081122112233444 56"


@pytest.mark.parametrize(
    ("code", "angles", "first_deg", "second_deg"),
    [
        # Values by astropy's Angle, as TruSat's own tests have them.
        (1, "0047196+603829", 15 * (47 / 60 + 19.6 / 3600), 60 + 38 / 60 + 29 / 3600),
        (2, "1256405+515478", 15 * (12 + 56.405 / 60), 51 + 54.78 / 60),
        (3, "0859511+119509", 15 * (8 + 59.511 / 60), 11.9509),
        (4, "1835301+603829", 183 + 53 / 60 + 1 / 3600, 60 + 38 / 60 + 29 / 3600),
        (5, "1835170-081148", 183 + 51.70 / 60, -(8 + 11.48 / 60)),
        (6, "0214030+732900", 21.4030, 73.29),
        (7, "2047449+293762", 15 * (20 + 47 / 60 + 44.9 / 3600), 29.3762),
        (1, "1322   -0030  ", 15 * (13 + 22 / 60), -0.5),
        (2, "183    -081   ", 277.5, -(8 + 10 / 60)),
        (2, "0000000-000001", 0.0, -0.01 / 60),
    ],
)
def test_all_angle_formats_are_read(code, angles, first_deg, second_deg):
    found = parse_iod_line(f"{HEAD} {code}5 {angles} 39")
    assert found.angle_format == code
    assert found.first_deg == pytest.approx(first_deg, abs=1e-9)
    assert found.second_deg == pytest.approx(second_deg, abs=1e-9)


def test_all_else_in_a_line_is_read_too():
    found = parse_iod_line(
        "12345 98 123LEO 2007 B 20081122112233    18 75 1122334+112222 36 V+110 1"
    )
    assert (found.norad_id, found.cospar) == (12345, "1998-123LEO")
    assert found.station == "2007"
    assert found.t_utc_ns == iso_to_utc_ns("2008-11-22T11:22:33Z")
    assert found.t_step_ns == NS
    assert found.time_sigma_s == 1.0
    assert found.epoch_year == 2000
    assert found.position_sigma_arcsec == pytest.approx(3 * 0.01 * 3600)
    flash = parse_iod_line(
        "12345 98 123UNK 2007 F 200811221123400   27                      P-010 05  10000"
    )
    assert (flash.first_deg, flash.time_sigma_s) == (None, 0.2)
    absent = parse_iod_line("                2007 O 20081122")
    assert (absent.norad_id, absent.t_step_ns) == (None, 86_400 * NS)
    assert parse_iod_line(f"{HEAD} 2  1256405+515478 39").epoch_year is None


@pytest.mark.parametrize(
    ("angles", "says"),
    [
        ("25 2460000+515478", "beyond their range"),
        ("25 1256405+905478", "beyond their range"),
        ("65 3600000+100000", "azimuth and elevation"),
    ],
)
def test_angles_beyond_the_sky_are_refused(angles, says):
    with pytest.raises(ExportError, match=says):
        parse_iod_line(f"{HEAD} {angles} 39")


@pytest.mark.parametrize("day", ["20081322", "20080230", "20081122240000000", "20081122116000000"])
def test_days_and_hours_that_there_are_not_are_refused(day):
    with pytest.raises(ExportError, match="not a"):
        parse_iod_line(f"12345 98 123A   2007 G {day}")


@settings(max_examples=80, suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(rows=taken_rows())
def test_what_is_written_is_read_to_the_formats_precision(rows):
    night = night_of(rows)
    lines = to_iod(night, (1,), target=Target()).splitlines()
    assert len(lines) == len(rows)
    for row, line in zip(rows, lines, strict=True):
        assert len(line) == 64
        read = parse_iod_line(line)
        assert read.angle_format == 2
        assert read.epoch_year == 2000
        assert read.first_deg is not None
        assert read.second_deg is not None
        off_deg = abs(wrap_180(read.first_deg - row.ra_icrs_deg))
        assert off_deg <= 0.5 / 4000 + 1e-9
        assert abs(read.second_deg - row.dec_icrs_deg) <= 0.5 / 6000 + 1e-9
        assert abs(read.t_utc_ns - row.t_mid_utc_ns) <= 1_000_000
        is_beside_leap = -1_000_000 <= row.t_mid_utc_ns - LEAP <= 0
        assert is_beside_leap or abs(read.t_utc_ns - row.t_mid_utc_ns) <= 500_000
        # One digit: half a step of the smallest, 1, at most.
        written = position_sigma_arcsec(row, night.shutter_sigma_s(row))
        assert written <= position_sigma_arcsec(row) * (1.0 + 1e-9)
        expected = min(written, 90.0 * 60.0)
        assert read.position_sigma_arcsec == pytest.approx(expected, rel=0.34)
        assert (read.norad_id, read.station) == (99901, "9999")


@pytest.mark.parametrize(
    ("dec_deg", "written"),
    [
        (-0.5, "-003000"),
        (-0.5 / 60, "-000050"),
        (-0.0, "+000000"),
        (-1e-9, "+000000"),
        (89.99999, "+900000"),
        (-59.99 / 60, "-005999"),
        (-59.999 / 60, "-010000"),
    ],
)
def test_small_and_large_declinations_keep_their_sign(dec_deg, written):
    row = replace(read_exported_night(SAMPLE).rows[0], dec_icrs_deg=dec_deg)
    line = to_iod(night_of([row]), (1,), target=Target())
    assert line[54:61] == written


@pytest.mark.parametrize(
    ("ra_deg", "written"),
    [(359.9999, "0000000"), (359.9998, "2359999"), (0.0, "0000000"), (14.99999, "0100000")],
)
def test_right_ascension_goes_round_and_no_minute_is_60(ra_deg, written):
    row = replace(read_exported_night(SAMPLE).rows[0], ra_icrs_deg=ra_deg)
    assert to_iod(night_of([row]), (1,), target=Target())[47:54] == written


@pytest.mark.parametrize(
    ("iso", "written"),
    [
        ("2023-06-23T05:30:59.999600Z", "20230623053100000"),
        ("2023-06-23T05:30:59.999400Z", "20230623053059999"),
        ("2023-12-31T23:59:59.999600Z", "20240101000000000"),
        # That second is followed by 23:59:60: the next day is a second away.
        ("2016-12-31T23:59:59.999600Z", "20161231235959999"),
        ("2017-01-01T00:00:00.000400Z", "20170101000000000"),
    ],
)
def test_seconds_are_rounded_as_time_goes(iso, written):
    row = replace(read_exported_night(SAMPLE).rows[0], t_mid_utc_ns=iso_to_utc_ns(iso))
    assert to_iod(night_of([row]), (1,), target=Target())[23:40] == written


@settings(deadline=None)
@given(st.integers(LEAP - 3 * NS, LEAP + 3 * NS))
def test_no_rounding_is_wrong_by_a_second(t_utc_ns):
    assert abs(round_to_ms_utc_ns(t_utc_ns) - t_utc_ns) <= 1_000_000
    assert round_to_ms_utc_ns(t_utc_ns) % 1_000_000 == 0
    assert (round_to_ms_utc_ns(t_utc_ns) >= LEAP) == (t_utc_ns >= LEAP)


@settings(deadline=None)
@given(st.floats(1e-8, 90.0))
def test_an_uncertainty_is_written_to_one_digit(value):
    text = mantissa_exponent_code(value)
    assert int(text[0]) * 10.0 ** (int(text[1]) - 8) == pytest.approx(value, rel=0.34)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "10"),
        (1e-12, "10"),
        (0.015, "26"),
        (0.096, "17"),
        (94.0, "99"),
        (1e9, "99"),
        (1, "18"),
    ],
)
def test_uncertainties_beyond_the_field_are_its_ends(value, text):
    assert mantissa_exponent_code(value) == text


def test_the_position_is_as_sure_as_in_its_worst_direction():
    row = read_exported_night(SAMPLE).rows[0]
    along = replace(row, sigma_ra_arcsec=10.0, sigma_dec_arcsec=10.0, correlation=0.99)
    # The rounding adds 0.26 arcsec times cos Dec and 0.17; of 14 it makes nothing.
    assert position_sigma_arcsec(along) == pytest.approx(10.0 * math.sqrt(1.99), rel=1e-3)
    sharp = replace(row, sigma_ra_arcsec=0.0, sigma_dec_arcsec=0.0, dec_icrs_deg=0.0)
    assert position_sigma_arcsec(sharp) == pytest.approx(0.9 / math.sqrt(12))


def test_the_shutters_error_is_read_back_once(tmp_path: Path):
    """A low satellite, 3,000 arcsec/s to the east: 15 ms of shutter are 45 arcsec of its place."""
    night = read_exported_night(SAMPLE)
    begin = night.rows[0]
    rate, own, shutter_s, exposure_s = 3000.0, 2.0, 0.015, 0.2
    rows = []
    for n in range(3):
        ra = 10.0 + n * rate * 5.0 / 3600.0
        half = rate * exposure_s / 2.0 / 3600.0
        rows.append(
            replace(
                begin,
                t_mid_utc_ns=begin.t_mid_utc_ns + n * 5_000_000_000,
                frame_id=1000 + n,
                exposure_s=exposure_s,
                ra_icrs_deg=ra,
                dec_icrs_deg=0.0,
                sigma_ra_arcsec=math.hypot(own, rate * shutter_s),
                sigma_dec_arcsec=own,
                correlation=0.0,
                ra_a_icrs_deg=ra - half,
                ra_b_icrs_deg=ra + half,
                dec_a_icrs_deg=0.0,
                dec_b_icrs_deg=0.0,
            )
        )
    path = tmp_path / "low.iod"
    path.write_text(to_iod(night_of(rows), (1,), target=Target()))
    assert all(1.7 < each.position_sigma_arcsec < 2.5 for each in read_iod(path))
    site = Site(latitude_deg=29.19, longitude_deg=-81.05, elevation_m=10.0)
    ((read,),) = read_observations(path, ReadOptions(site=site))
    whitening = read.seen.whitening
    cov = np.linalg.inv(np.swapaxes(whitening, 1, 2) @ whitening)
    # The time's field has one digit: 0.01 or 0.02 s for 0.015. Counted twice it would be 64.
    sigma_east = np.sqrt(cov[:, 0, 0])
    assert np.all((sigma_east > 25.0) & (sigma_east < 61.0))
    assert np.all(np.sqrt(cov[:, 1, 1]) < 3.0)


def test_the_clocks_offset_is_part_of_the_times_error():
    rows = read_exported_night(SAMPLE).rows[:1]
    assert to_iod(night_of(rows), (1,), target=Target())[41:43] == "26"
    late = to_iod(night_of(rows, clock_offset_s=-0.3), (1,), target=Target())
    assert late[41:43] == "37"


def test_names_of_known_and_of_unknown_objects(tmp_path: Path):
    text, made = render(SAMPLE, "iod", ExportOptions())
    assert text.startswith("99901 23 999A   9999   ")
    known = ExportOptions(
        target=Target(norad_id=36097, cospar="2009-064A"), station="TRU7", sky="G"
    )
    text, _ = render(SAMPLE, "iod", known)
    assert all(line.startswith("36097 09 064A   TRU7 G ") for line in text.splitlines())
    assert made.measurements == len(text.splitlines()) == 27
    path = tmp_path / "night.iod"
    path.write_text(text)
    assert {each.cospar for each in read_iod(path)} == {"2009-064A"}


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"station": "99"}, "no station"),
        ({"station": "TRIO"}, "no station"),
        ({"sky": "Z"}, "no state of the sky"),
        ({"sky": ""}, "no state of the sky"),
        ({"track": 2}, "no track 2; it has 1"),
    ],
)
def test_what_cannot_be_written_is_refused(options, says):
    with pytest.raises(ExportError, match=says):
        render(SAMPLE, "iod", ExportOptions(**options))


@pytest.mark.parametrize(
    "numbers", [{"norad_id": 0}, {"norad_id": 1_000_000_000}, {"cospar": "09-064A"}]
)
def test_numbers_that_no_catalogue_has_are_refused(numbers):
    with pytest.raises(ExportError, match="no "):
        Target(**numbers)


def test_a_damaged_file_names_its_line(tmp_path: Path):
    path = tmp_path / "x.iod"
    path.write_text(f"# a word before\n\n{HEAD} 25 0000000 000000 39\n{HEAD} 25 000000 000000 39\n")
    with pytest.raises(ExportError, match=r"line 3: .*columns"):
        read_observations(path, ReadOptions())


def test_a_cut_streak_is_not_reported(tmp_path: Path):
    session = closed_night(tmp_path / "clipped", clipped=(5,))
    text, made = render(session, "iod", ExportOptions())
    assert made.left_out["cut by the frame's edge"] == 1
    assert len(text.splitlines()) == len(read_exported_night(session).track_measurements(1)) - 1


def test_blanks_at_the_end_of_a_line_change_nothing():
    flash = "12345 98 123UNK 2007 F 200811221123400   27                      P-010 05  10000"
    for line in (flash, f"{HEAD} 25 1256405+515478 39", "                2007 O 20081122"):
        assert parse_iod_line(line + "   \r\n") == parse_iod_line(line)
    assert parse_iod_line(HEAD + 21 * " ").first_deg is None
