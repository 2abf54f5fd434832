"""Observations of others line by line: one that cannot be read costs itself, and is named."""

import gzip
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from rsoconsole.base import ExportError, OrbitError
from rsoconsole.cli.app import app
from rsoconsole.library import ReadOptions, read_observations
from rsoconsole.pipeline import ObservedTrack
from rsoconsole.records import Site
from rsoconsole.sky import icrs_to_altaz, icrs_to_jnow, iso_to_utc_ns
from tests.library.test_export_tdm import WHOLE

HERE = Site(latitude_deg=52.1358, longitude_deg=-2.3264, elevation_m=70.0)
ASK = ReadOptions(site=HERE)
IOD = [
    f"23908 96 029C   4171 E 2020031619{20 + n}05771 17 25 12{10 + n}033+2605{n}0 37 S"
    for n in range(5)
]
LATER = [each.replace("0316192", "0316193") for each in IOD]
UK = [f"9701201201803101520{19 + n}5542  01   121720{n}8  +1558{n}   1  5" for n in range(4)]
TABLE = ["time,ra_deg,dec_deg", *(f"2023-06-22T03:0{n}:00,{10 + n},5" for n in range(5))]
TWO_ARCSEC = 2.0


def read_lines(lines: list[str], tmp_path: Path, ask: ReadOptions = ASK) -> ObservedTrack:
    path = tmp_path / "lines.txt"
    path.write_text("\n".join(lines) + "\n")
    ((found,),) = read_observations(path, ask)
    return found


def expect_used(lines: list[str], bad: int, why: str, tmp_path: Path) -> None:
    """Line ``bad`` (from 1) is named with its reason, and all others are used."""
    read = read_lines(lines, tmp_path)
    (named,) = read.not_used
    assert f"line {bad}" in named
    assert why in named
    lines_in = len(lines) - (1 if lines[0] == TABLE[0] else 0)
    assert len(read.seen) == lines_in - 1


@pytest.mark.parametrize(
    ("bad", "why"),
    [
        ("Good luck with this one, clouds came.", "columns of an IOD line"),
        (IOD[0].replace("+", "*"), "columns of an IOD line"),
        (IOD[0].replace("2020031619", "2020031629"), "not a time"),
        (IOD[0].replace("+2605", "+9605"), "beyond their range"),
        (IOD[0][:40], "states no direction"),
        ("0502402 184800.93 193900+452300 3.1 3.1 0 S", "RDE reports are not read"),
    ],
)
@pytest.mark.parametrize("lines", [IOD, UK], ids=["iod", "uk"])
def test_a_bad_line_among_good_ones_costs_itself(
    bad: str, why: str, lines: list[str], tmp_path: Path
) -> None:
    expect_used([*lines[:2], bad, *lines[2:]], 3, why, tmp_path)


@pytest.mark.parametrize(
    ("bad", "why"),
    [
        ("2023-06-22T03:09:00,12", "2 fields where 3 belong"),
        ("noon,12,5", "not a time"),
        ("2023-06-22T03:09:00,12:30,5", "write it in degrees"),
        ("2023-06-22T03:09:00,12,95", "no direction in degrees"),
        ("2023-06-22T03:09:00,12,", "no direction"),
        ('2023-06-22T03:09:00,"12,5', "line 4"),
        ("2023-06-22T03:09:00,inf,5", "no direction"),
    ],
)
def test_a_bad_row_of_a_table_costs_itself(bad: str, why: str, tmp_path: Path) -> None:
    expect_used([*TABLE[:3], bad, *TABLE[3:]], 4, why, tmp_path)


@pytest.mark.parametrize(
    ("bad", "why"),
    [
        ("ANGLE_1 = 2023-06-23T05:32:61 313.5", "05:32:61"),
        ("ANGLE_1 = 2023-06-23T05:32:05", "an epoch and one number"),
        ("ANGLE_7 = 2023-06-23T05:32:05 313.5", "no keyword of data"),
        ("what is this", "KEYWORD = value"),
        ("ANGLE_1 = 2023-06-23T05:31:05.3 313.6", "twice"),
        ("COMMENT SIGMA 2023-06-23T05:31:05.3 a b c", "no number"),
    ],
)
def test_a_bad_line_of_a_message_costs_itself(bad: str, why: str, tmp_path: Path) -> None:
    text = WHOLE.replace("DATA_STOP", f"{bad}\nDATA_STOP")
    read = read_lines(text.splitlines(), tmp_path)
    assert len(read.seen) == 1
    (named,) = read.not_used
    assert why in named
    assert "line " in named


def test_half_a_pair_and_ranges_are_counted(tmp_path: Path) -> None:
    more = "ANGLE_1 = 2023-06-23T05:33:05 313.5\nRANGE = 2023-06-23T05:33:05 40000\n"
    read = read_lines(WHOLE.replace("DATA_STOP", more + "DATA_STOP").splitlines(), tmp_path)
    assert read.not_used == (
        f"{tmp_path / 'lines.txt'}, segment 1: 2 epochs or lines without both angles",
    )


def test_a_message_that_is_cut_off_gives_its_whole_epochs(tmp_path: Path) -> None:
    clock = "2023-06-23T05:3{}:05"
    more = [f"ANGLE_{k} = {clock.format(n)} {10 + n}.5" for n in (5, 6, 7) for k in (1, 2)]
    path = tmp_path / "cut.tdm"
    path.write_text((WHOLE[: WHOLE.index("DATA_STOP")] + "\n".join(more))[:-3])
    ((read,),) = read_observations(path, ASK)
    assert len(read.seen) == WHOLE.count("ANGLE_2 =") + 2
    assert "ends before DATA_STOP" in read.not_used[0]
    assert "1 epoch or line without both angles" in read.not_used[1]


def test_an_epoch_without_a_number_counts_once_and_magnitudes_not_at_all(tmp_path: Path) -> None:
    more = "ANGLE_1 = 2023-06-23T05:33:05 313.5\nANGLE_2 = 2023-06-23T05:33:05 NaN\n"
    text = WHOLE.replace("DATA_STOP", f"{more}MAG = 2023-06-23T05:33:05 9.5\nDATA_STOP")
    (named,) = read_lines(text.splitlines(), tmp_path).not_used
    assert "ANGLE_2 'NaN' is no number" in named


def test_a_line_that_is_there_twice_counts_once(tmp_path: Path) -> None:
    read = read_lines([*IOD, IOD[1]], tmp_path)
    assert len(read.seen) == len(IOD)
    path = tmp_path / "lines.txt"
    assert read.not_used == (f"{path}, line 6: the same observation as {path}, line 2",)


def test_iod_and_uk_lines_of_one_object_are_of_one_object(tmp_path: Path) -> None:
    uk = [each.replace("9701201", "9602903") for each in UK]
    path = tmp_path / "both.txt"
    path.write_text("\n".join([*IOD, *uk]))
    found = read_observations(path, ASK)
    assert sum(len(each.seen) for (each,) in found) == len(IOD) + len(UK)


def test_a_table_without_rows_says_so(tmp_path: Path) -> None:
    with pytest.raises(ExportError, match="no row is below its heading"):
        read_lines(TABLE[:1], tmp_path)


def test_a_bad_row_of_our_json_costs_itself(tmp_path: Path) -> None:
    rows = [[f"2023-06-22T03:0{n}:00Z", 10.0 + n, 5.0] for n in range(5)]
    path = tmp_path / "ours.json"
    site = {"lat_deg": 52.0, "lon_deg": 6.0, "alt_m": 10.0}
    path.write_text(json.dumps({"site": site, "obs": [*rows, rows[-1], ["soon", 1.0, 2.0]]}))
    ((read,),) = read_observations(path, ASK)
    assert len(read.seen) == 5
    assert [each.split(": ")[0] for each in read.not_used] == [
        f"{path}, observation 6",
        f"{path}, observation 7",
    ]


def test_a_packed_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "lines.txt.gz"
    path.write_bytes(gzip.compress("\n".join(IOD).encode()))
    ((read,),) = read_observations(path, ASK)
    assert len(read.seen) == len(IOD)


def test_the_columns_that_are_wrong_are_named_and_a_blank_error_is_none(tmp_path: Path) -> None:
    lines = [each.replace(" 17 25", "    25") for each in IOD]
    assert len(read_lines(lines, tmp_path).seen) == len(IOD)
    expect_used([*IOD, LATER[0].replace(" 25 ", " 85 ")], 6, "columns 45-46: '85'", tmp_path)


def said(*words: object) -> Any:
    return CliRunner().invoke(app, [str(each) for each in words])


def test_what_is_not_used_is_in_text_and_json(tmp_path: Path) -> None:
    path = tmp_path / "mail.txt"
    path.write_text("\n".join(["Hello all,", *IOD[:2], IOD[2].replace("+", " "), *IOD[3:], *LATER]))
    words = ("orbit", path, "--site", "52.8,6.4,10")
    text = said(*words)
    assert text.exit_code == 0, text.output
    assert "not used: 2 lines" in text.stdout
    report = json.loads(said(*words, "--json").stdout.splitlines()[0])
    assert [each.split(": ", 1)[0] for each in report["lines_not_used"]] == [
        f"{path}, line 1",
        f"{path}, line 4",
    ]


def test_an_rde_report_is_refused_by_its_name(tmp_path: Path) -> None:
    path = tmp_path / "rde.txt"
    lines = ["SATOBS", "", "9999 1909 0.211 1204", "28"]
    lines += [f"0502402 1848{n}0.93 193900+452300 3.1 3.1 0 S" for n in range(3)]
    path.write_text("\n".join([*lines, "999"]))
    with pytest.raises(ExportError, match="RDE reports are not read: give IOD or UK lines, TDM"):
        read_observations(path, ASK)


def test_a_quoted_mail_and_tabs_are_read(tmp_path: Path) -> None:
    quoted = [f"> {each}" for each in IOD]
    assert len(read_lines(quoted, tmp_path).seen) == len(IOD)
    # A mail program made a tab of the blanks up to column 16.
    tabbed = [each.replace("29C   4171", "29C\t4171") for each in IOD]
    assert read_lines(tabbed, tmp_path).not_used == ()


@pytest.mark.parametrize(
    "encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"]
)
@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("lines", [IOD, TABLE, WHOLE.splitlines()], ids=["iod", "csv", "tdm"])
def test_a_file_is_read_in_every_encoding(
    encoding: str, newline: str, lines: list[str], tmp_path: Path
) -> None:
    path = tmp_path / "lines.txt"
    accents = lines if lines is not IOD else ["# Ångström", *lines]
    path.write_bytes(newline.join(accents).encode(encoding))
    ((read,),) = read_observations(path, ASK)
    plain = read_lines(lines, tmp_path)
    np.testing.assert_array_equal(read.seen.t_utc_ns, plain.seen.t_utc_ns)
    assert read.not_used == ()


def test_what_is_no_text_is_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "frame.fits"
    path.write_bytes(b"SIMPLE  =" + bytes(64))
    with pytest.raises(OrbitError, match="it is no text"):
        read_observations(path, ASK)


# All forms of angles, and azimuth and elevation


def line_of(code: int, epoch: int, ra_deg: float, dec_deg: float, second: int) -> str:
    """An IOD line whose angles are a catalogue direction in one of the seven formats."""
    t_utc_ns = iso_to_utc_ns(f"2020-03-16T19:22:{second:02d}Z")
    one, other = ra_deg, dec_deg
    if code in {4, 5, 6}:
        altitude, azimuth = icrs_to_altaz(HERE, ra_deg, dec_deg, t_utc_ns, is_refracted=True)
        one, other = float(azimuth), float(altitude)
    sign = "-" if other < 0.0 else "+"
    wholes = 15.0 if code in {1, 2, 3, 7} else 1.0
    first, second_angle = one / wholes, abs(other)
    forms = {
        1: (sexagesimal(first, 2, 1), sexagesimal(second_angle, 2, 0)),
        2: (minutes(first, 2, 3), minutes(second_angle, 2, 2)),
        3: (minutes(first, 2, 3), degrees(second_angle, 2)),
        4: (sexagesimal(first, 3, 0), sexagesimal(second_angle, 2, 0)),
        5: (minutes(first, 3, 2), minutes(second_angle, 2, 2)),
        6: (degrees(first, 3), degrees(second_angle, 2)),
        7: (sexagesimal(first, 2, 1), degrees(second_angle, 2)),
    }
    text = sign.join(forms[code])
    return f"23908 96 029C   4171 E 202003161922{second:02d}000 17 {code}{epoch} {text} 37 S"


def sexagesimal(value: float, wholes: int, decimals: int) -> str:
    seconds = round(value * 3600.0 * 10**decimals)
    whole, rest = divmod(seconds, 3600 * 10**decimals)
    minute, rest = divmod(rest, 60 * 10**decimals)
    return f"{whole:0{wholes}d}{minute:02d}{rest:0{2 + decimals}d}"


def minutes(value: float, wholes: int, decimals: int) -> str:
    whole, rest = divmod(round(value * 60.0 * 10**decimals), 60 * 10**decimals)
    return f"{whole:0{wholes}d}{rest:0{2 + decimals}d}"


def degrees(value: float, wholes: int) -> str:
    return f"{round(value * 10_000):0{wholes + 4}d}"


STEP_ARCSEC = {1: 1.5, 2: 0.9, 3: 0.9, 4: 1.0, 5: 0.6, 6: 0.4, 7: 1.5}


@pytest.mark.parametrize("code", range(1, 8))
def test_every_format_of_angles_gives_the_direction(code: int, tmp_path: Path) -> None:
    wanted = [(187.3 + 0.4 * n, 26.1 - 0.3 * n) for n in range(4)]
    lines = [line_of(code, 5, *each, 10 * n) for n, each in enumerate(wanted)]
    read = read_lines(lines, tmp_path)
    assert read.not_used == ()
    ra, dec = np.array(wanted).T
    off_ra = (read.seen.ra_icrs_deg - ra) * np.cos(np.radians(dec)) * 3600.0
    off_dec = (read.seen.dec_icrs_deg - dec) * 3600.0
    assert max(abs(off_ra).max(), abs(off_dec).max()) < STEP_ARCSEC[code]


@pytest.mark.parametrize("epoch", [0, 1, 2, 3, 4, 5, 6])
def test_every_code_of_the_equinox_turns_the_angles(epoch: int, tmp_path: Path) -> None:
    """Of date by the sky's own apparent places; of 1950, 1900 by the precession of a century."""
    wanted = (187.3, 26.1)
    read = read_lines([line_of(2, epoch, *wanted, 10 * n) for n in range(3)], tmp_path)
    moved_deg = (float(read.seen.ra_icrs_deg[0]) - wanted[0]) % 360.0
    years = {0: 20.2, 1: -145.0, 2: -125.0, 3: -100.0, 4: -50.0, 5: 0.0, 6: 50.0}[epoch]
    # General precession in RA there: m + n sin(ra) tan(dec), 46.1 and 20.0 arcsec a year.
    rate = (46.1 + 20.0 * np.sin(np.radians(wanted[0])) * np.tan(np.radians(wanted[1]))) / 3600.0
    off = (moved_deg + years * rate + 180.0) % 360.0 - 180.0
    assert abs(off) < 0.03
    if epoch == 0:
        t = iso_to_utc_ns("2020-03-16T19:22:00Z")
        ra, dec = icrs_to_jnow(float(read.seen.ra_icrs_deg[0]), float(read.seen.dec_icrs_deg[0]), t)
        assert abs(ra - wanted[0]) * 3600.0 < 30.0
        assert abs(dec - wanted[1]) * 3600.0 < 30.0


def test_an_elevation_below_the_horizon_is_named(tmp_path: Path) -> None:
    low = line_of(6, 5, 187.3, 26.1, 50).split(" 17 ")[0] + " 17 65 1203000-050000 37 S"
    lines = [*(line_of(6, 5, 187.3, 26.1, 10 * n) for n in range(3)), low]
    expect_used(lines, 4, "below the horizon", tmp_path)


def test_azimuth_and_elevation_of_a_uk_line(tmp_path: Path) -> None:
    """Format 5: degrees and minutes; the column of the equinox does not matter."""
    lines = [f"97012012018031015201{n}5542  01   151720{n}0  +45585   1  5" for n in range(4)]
    read = read_lines(lines, tmp_path)
    altitude, azimuth = icrs_to_altaz(
        HERE, read.seen.ra_icrs_deg, read.seen.dec_icrs_deg, read.seen.t_utc_ns, is_refracted=True
    )
    assert azimuth == pytest.approx(np.full(4, 172.0), abs=0.1)
    assert altitude == pytest.approx(np.full(4, 45.0 + 58.5 / 60.0), abs=TWO_ARCSEC / 3600.0)


# Lists of stations


@pytest.mark.parametrize(
    "text",
    [
        "# comment\nNo   ID  Latitude Longitude   Elev    Observer\n4171 AA   52.8  6.4  10  A\n",
        "4171 AA 52.8 6.4 10 Observer A\n",
        "4171 52.8 6.4 10\n",
        "4171,AA,52.8,6.4,10,Observer A\n",
        "4171;AA;52,8;6,4;10;Observer A\n",
        "4171\tAA\t52.8\t6.4\t10\tObserver A\n",
        "station,name,lon,lat,elev\n4171,Observer A,6.4,52.8,10\n",
        "4171 AA 52.8N 6.4E 10 Observer A\n",
        "4171 AA N52.8 E6.4 10\n",
        "4171 AA 52.8 N 6.4 E 10\n",
        "! list\n// more\n4171 AA 52.8 6.4 10.0m A\n",
        "No;Code;Latitude;Longitude;Height\n4171;AA;52.8;6.4;10\n",
        "\ufeffStation ID Lat Lon Alt\n\n4171  AA  +52.8  +6.4  10\n",
    ],
)
def test_stations_are_read_in_the_forms_that_others_write(text: str, tmp_path: Path) -> None:
    stations = tmp_path / "stations.txt"
    stations.write_text(text)
    read = read_lines(IOD, tmp_path, ReadOptions(stations=stations))
    assert read.site == Site(latitude_deg=52.8, longitude_deg=6.4, elevation_m=10.0)
    assert read.not_used == ()


@pytest.mark.parametrize(
    ("text", "site"),
    [
        ("4171 AA 33.9S 18.5E 10\n", (-33.9, 18.5)),
        ("4171 AA -33.9 70.7W 10\n", (-33.9, -70.7)),
        ("4171 AA 33.9 S 70.7 W 10\n", (-33.9, -70.7)),
        ("4171 AA -33.9 289.3 10\n", (-33.9, 289.3)),
        ("4171 AA 52 48 00 N 006 24 00 E 10 Obs\n", (52.8, 6.4)),
        ("4171 AA 52 48.0 N 6 24.0 W 10 Obs\n", (52.8, -6.4)),
        ("4171 AA N 52 48 00 W 006 24 00 10 Obs\n", (52.8, -6.4)),
        ("4171 AA 52:48:00 -6:24:00 10 Obs\n", (52.8, -6.4)),
        ("No,Code,Lat,Lon(W),Elev\n4171,AA,52.8,6.4,10\n", (52.8, -6.4)),
        ("Station\tLatitude\tLongitude (W)\tHeight\n4171\t52.8\t-6.4\t10\n", (52.8, 6.4)),
        ("No ID Latitude WestLongitude Elev\n4171 AA 52.8 6.4 10\n", (52.8, -6.4)),
        ("Station West longitude Latitude Height\n4171 6.4 52.8 10\n", (52.8, -6.4)),
        ("No,Lat,Lon (W is negative),Elev\n4171,52.8,6.4,10\n", (52.8, 6.4)),
        ("No ID Lon (deg) Lat (deg) Elev\n4171 AA 6.4 52.8 10\n", (52.8, 6.4)),
        ("Code Longitude Latitude Height WGS84\n4171 6.4 52.8 10\n", (52.8, 6.4)),
    ],
)
def test_hemispheres_have_their_signs(text: str, site: tuple[float, float], tmp_path: Path) -> None:
    stations = tmp_path / "stations.txt"
    stations.write_text(text)
    read = read_lines(IOD, tmp_path, ReadOptions(stations=stations))
    assert (read.site.latitude_deg, read.site.longitude_deg) == site


@pytest.mark.parametrize(
    ("text", "height_m"),
    [
        ("No ID Lat Lon Alt_km\n4171 AA 52.8 6.4 0.010\n", 10.0),
        ("No,Lat,Lon,Height (ft)\n4171,52.8,6.4,100\n", 30.48),
        ("4171 AA 52.8 6.4 100ft\n", 30.48),
    ],
)
def test_heights_have_their_units(text: str, height_m: float, tmp_path: Path) -> None:
    stations = tmp_path / "stations.txt"
    stations.write_text(text)
    read = read_lines(IOD, tmp_path, ReadOptions(stations=stations))
    assert read.site.elevation_m == pytest.approx(height_m)


def test_parallax_constants_are_a_place(tmp_path: Path) -> None:
    stations = tmp_path / "stations.txt"
    row = "{} 289.5959  0.909943-0.414336 Paranal\n"
    stations.write_text("Code  Long.   cos      sin    Name\n" + row.format("4171"))
    site = read_lines(IOD, tmp_path, ReadOptions(stations=stations)).site
    found = (site.latitude_deg, site.longitude_deg, site.elevation_m / 1e3)
    assert found == pytest.approx((-24.627, -70.404, 2.64), abs=0.002)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("4171 AA 52 48 00 6 24 00 10 Obs\n", "minutes in fields of their own"),
        ("No ID Lat Lon Elev\n4171 AA 52 48 6 24 10\n", "minutes in fields of their own"),
        ("4171 0.1542 0.62992 +0.77411 Crowborough\n", "parallax constants"),
        ("Code Long Elev\n4171 6.4 52.8 10\n", "the heading has no column of latitude"),
        ("No,Lat_deg,Lat_min,Lon\n4171,52,48,6.4\n", "the heading has 2 columns of latitude"),
        ("No,Lat (rad),Lon (rad)\n4171,0.9,0.1\n", "geodetic degrees"),
    ],
)
def test_a_place_in_doubt_is_refused(text: str, words: str, tmp_path: Path) -> None:
    stations = tmp_path / "stations.txt"
    stations.write_text(text)
    with pytest.raises(ExportError, match=words):
        read_lines(IOD, tmp_path, ReadOptions(stations=stations))


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("4172 AA 95.0 6.4 10", "no place on Earth"),
        ("4172 AA somewhere 10", "a station is"),
        ("4172 AA 52.8 6.4 99999", "stands 99999 m high"),
        ("4172 AA 52.8E 6.4N 10", "a station is"),
        ("4171 AA 12.0 6.4 10", "stands elsewhere before"),
    ],
)
def test_a_bad_station_costs_itself(line: str, words: str, tmp_path: Path) -> None:
    stations = tmp_path / "stations.txt"
    stations.write_text(f"4171 AA 52.8 6.4 10\n{line}\n")
    read = read_lines(IOD, tmp_path, ReadOptions(stations=stations))
    assert read.site.latitude_deg == 52.8
    (named,) = read.not_used
    assert "line 2" in named
    assert words in named


def test_a_list_without_any_station_says_what_one_is(tmp_path: Path) -> None:
    stations = tmp_path / "stations.txt"
    stations.write_text("4171 somewhere\n")
    with pytest.raises(ExportError, match=r"line 1: a station is '2701 ME"):
        read_lines(IOD, tmp_path, ReadOptions(stations=stations))
