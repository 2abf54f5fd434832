"""Orbits of navigation satellites: published files against one another and against skyfield."""

import gzip
import re
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.base import OrbitError
from rsoconsole.orbits import NavigationFile, parse_rinex_nav, parse_sp3
from rsoconsole.orbits.navigation.sp3 import gps_ns_of_utc, utc_ns_of_gps
from rsoconsole.pipeline import read_rinex, read_sp3
from rsoconsole.records import Site
from rsoconsole.sky import iso_to_utc_ns, itrf_to_gcrs_rotation, separation_deg
from rsoconsole.words import NS_PER_S
from tests.truth.navigation_truth import GPS_MINUS_UTC_S, SITE, constellation

REAL = Path(__file__).parents[1] / "data" / "navigation"
BROADCAST_2, PRECISE = REAL / "brdc1180.21n", REAL / "grg21553.sp3"
BROADCAST_3, RAPID = REAL / "BRDM00DLR_S_20230730000.rnx", REAL / "COD0OPSRAP_20230730000.SP3"
T0 = iso_to_utc_ns("2023-06-22T01:00:00Z") - GPS_MINUS_UTC_S * NS_PER_S


def text_of(path: Path) -> dict[str, str]:
    return {path.name: path.read_text(encoding="latin-1")}


def epochs_of(path: Path) -> dict[str, list[tuple[int, tuple[float, float, float]]]]:
    """(UTC ns, Earth-fixed km) of an SP3 file by its columns alone, for files in GPS time."""
    found: dict[str, list[tuple[int, tuple[float, float, float]]]] = {}
    t = 0
    for line in path.read_text().splitlines():
        if line.startswith("*"):
            y, mo, d, h, mi, s = line[1:].split()
            iso = f"{y}-{int(mo):02d}-{int(d):02d}T{int(h):02d}:{int(mi):02d}:{float(s):06.3f}Z"
            t = iso_to_utc_ns(iso) - GPS_MINUS_UTC_S * NS_PER_S
        elif line.startswith("P"):
            x, y_, z = line[4:46].split()
            found.setdefault(line[1:4], []).append((t, (float(x), float(y_), float(z))))
    return found


def with_x_of_g05(text: str, x: str) -> str:
    return re.sub(r"(?m)^(PG05).{14}", rf"\g<1>{x:>14}", text)


def apart_m(file: NavigationFile, name: str, told: list[tuple[int, tuple[float, ...]]]) -> float:
    """The farthest that a satellite of the file is from places told."""
    satellite = next(each for each in file.satellites if each.name == name)
    t = np.array([instant for instant, _ in told])
    theirs = np.einsum("nij,nj->ni", itrf_to_gcrs_rotation(t), np.array([p for _, p in told]))
    ours, _ = satellite.position_gcrs(t)
    return float(np.max(np.linalg.norm(ours - theirs, axis=1))) * 1000.0


def test_broadcast_gps_is_where_the_precise_orbits_of_the_day_are() -> None:
    found, told = parse_rinex_nav(text_of(BROADCAST_2)), epochs_of(PRECISE)
    six_metres = 6.0
    names = [each.name for each in found.satellites]
    assert len(names) == 10
    for name in names:
        inside = told[name][: 4 * 4]  # four hours, which the messages of the excerpt hold
        assert apart_m(found, name, inside) < six_metres, name


@pytest.mark.parametrize("name", ["G01", "G02", "E01", "E02"])
def test_broadcast_gps_and_galileo_of_rinex_3_agree_with_rapid_orbits(name: str) -> None:
    found, told = parse_rinex_nav(text_of(BROADCAST_3)), epochs_of(RAPID)
    three_metres = 3.0
    assert apart_m(found, name, told[name]) < three_metres


def in_beidou_time(text: str, name: str, as_name: str) -> str:
    """A file with the messages of one GPS satellite alone, told as BeiDou tells its own.

    BDT is 14 s behind GPS time and counts weeks from 2006 (BDS-SIS-ICD-2.1, 3.3).
    """
    lines = text.splitlines()
    head = lines[: next(n for n, line in enumerate(lines) if "END OF HEADER" in line) + 1]
    told = []
    for n, line in enumerate(lines):
        if not line.startswith(f"{name} "):
            continue
        epoch = datetime(*map(int, line[4:23].split()), tzinfo=UTC) - timedelta(seconds=14)
        rows = [f"{as_name} {epoch:%Y %m %d %H %M %S}{line[23:]}", *lines[n + 1 : n + 8]]
        toe_s, node_rad = float(rows[3][4:23]) - 14.0, float(rows[3][42:61])
        # The node is told from Greenwich as it is when the week begins: 14 s later here.
        node_rad -= 14.0 * 7.292115e-5
        rows[3] = f"    {toe_s:19.12e}{rows[3][23:42]}{node_rad:19.12e}{rows[3][61:]}"
        rows[5] = f"{rows[5][:42]}{float(rows[5][42:61]) - 1356.0:19.12e}{rows[5][61:]}"
        told += rows
    return "\n".join([*head, *told]) + "\n"


@pytest.mark.parametrize("name", ["G01", "G02"])
def test_beidou_counts_its_own_time(name: str) -> None:
    """The same orbit told as BeiDou's is at the same place; 14 s would be 55 km."""
    text, told = BROADCAST_3.read_text(encoding="latin-1"), epochs_of(RAPID)
    found = parse_rinex_nav({"day": in_beidou_time(text, name, "C21")})
    assert [each.name for each in found.satellites] == ["C21"]
    # Of that 7 m are the turn of the Earth since the week began, by either constant.
    ten_metres = 10.0
    assert apart_m(found, "C21", told[name]) < ten_metres


def test_what_cannot_be_used_of_a_mixed_file_is_counted() -> None:
    found = parse_rinex_nav(text_of(BROADCAST_3))
    assert {each.name[0] for each in found.satellites} == {"G", "E", "J"}
    assert found.skipped["messages of R"] == 4
    assert found.skipped["messages of geostationary BeiDou satellites"] == 4


def test_rinex_4_says_the_same_as_rinex_3() -> None:
    lines = BROADCAST_3.read_text().splitlines()
    kinds = {
        "G": "LNAV",
        "E": "INAV",
        "J": "LNAV",
        "C": "D1",
        "R": "FDMA",
        "S": "SBAS",
        "I": "LNAV",
    }
    again = ["     4.00" + lines[0][9:]]
    is_header = True
    for line in lines[1:]:
        if not is_header and line[:1].strip():
            again.append(f"> EPH {line[:3]} {kinds[line[0]]}")
        is_header = is_header and "END OF HEADER" not in line
        again.append(line)
    again += ["> STO G01 LNAV", "    2023 03 14 00 00 00 GPUT", "> EPH G03 CNAV", "G03 2023 x"]
    old, new = parse_rinex_nav(text_of(BROADCAST_3)), parse_rinex_nav({"4": "\n".join(again)})
    assert [each.name for each in new.satellites] == [each.name for each in old.satellites]
    t = np.array([iso_to_utc_ns("2023-03-14T00:20:00Z")])
    for one, other in zip(old.satellites, new.satellites, strict=True):
        assert np.array_equal(one.position_gcrs(t)[0], other.position_gcrs(t)[0])
    assert new.skipped["messages CNAV"] == 1


def test_between_its_epochs_an_sp3_is_where_the_file_of_finer_steps_is() -> None:
    sky = constellation(T0, 6.0)
    coarse = parse_sp3({"15 min": sky.sp3(step_s=900)})
    t = T0 + np.arange(1800, 18_000, 611) * NS_PER_S
    five_centimetres_km = 5e-5
    fine = parse_sp3({"3 min": sky.sp3(step_s=180)})
    for one, other in zip(coarse.satellites[::6], fine.satellites[::6], strict=True):
        apart = np.linalg.norm(one.position_gcrs(t)[0] - other.position_gcrs(t)[0], axis=1)
        assert np.max(apart) < five_centimetres_km


@pytest.mark.parametrize("version", ["c", "d"])
def test_places_by_an_sp3_are_those_that_skyfield_sees(version: str) -> None:
    sky = constellation(T0, 6.0)
    file = parse_sp3({"day": sky.sp3(version=version)})
    t = T0 + np.arange(1800, 18_000, 977) * NS_PER_S
    a_thousandth_arcsec = 1e-3
    for number in range(0, len(sky.names), 8):
        ra, dec, _ = sky.observed(number, t)
        satellite = next(each for each in file.satellites if each.name == sky.names[number])
        places = satellite.places(Site(**SITE), t)
        off = separation_deg(places.ra_icrs_deg, places.dec_icrs_deg, ra, dec) * 3600.0
        assert np.max(off) < a_thousandth_arcsec


def test_a_short_file_is_good_to_a_metre() -> None:
    sky = constellation(T0, 1.5)
    short = parse_sp3({"seven epochs": sky.sp3()})
    fine = parse_sp3({"3 min": sky.sp3(step_s=180)})
    t = T0 + np.arange(1800, 3600, 211) * NS_PER_S
    a_metre_km = 1e-3
    for one, other in zip(short.satellites[::6], fine.satellites[::6], strict=True):
        apart = np.linalg.norm(one.position_gcrs(t)[0] - other.position_gcrs(t)[0], axis=1)
        assert np.max(apart) < a_metre_km


def test_beyond_a_file_and_in_its_gaps_nothing_is_known() -> None:
    sky = constellation(T0, 6.0)
    lines = sky.sp3().splitlines()
    gone = next(n for n, line in enumerate(lines) if line.startswith("*") and " 3 45 " in line)
    rest = lines[:gone] + lines[gone + len(sky.names) + 1 :]
    satellite = parse_sp3({"gap": "\n".join(rest)}).satellites[0]
    hours = np.array([-0.1, 2.0, 2.8, 4.5, 6.1])
    r, _ = satellite.position_gcrs(T0 + np.rint(hours * 3600).astype(np.int64) * NS_PER_S)
    assert list(np.isfinite(r[:, 0])) == [False, False, False, True, False]
    whole = parse_sp3({"whole": sky.sp3()}).satellites[0]
    r, _ = whole.position_gcrs(T0 + np.rint(hours * 3600).astype(np.int64) * NS_PER_S)
    assert list(np.isfinite(r[:, 0])) == [False, True, True, True, False]


def test_a_message_holds_for_two_hours() -> None:
    found = parse_rinex_nav(text_of(BROADCAST_3))
    satellite = next(each for each in found.satellites if each.name == "G01")
    t = iso_to_utc_ns("2023-03-14T00:00:00Z") + np.array([-3, 0, 3, 5]) * 3600 * NS_PER_S
    assert list(np.isfinite(satellite.position_gcrs(t)[0][:, 0])) == [False, True, True, False]


def test_gps_time_has_no_leap_seconds() -> None:
    before, after = (iso_to_utc_ns(f"20{day}T12:00:00Z") for day in ("16-12-31", "17-01-01"))
    assert (int(gps_ns_of_utc(before)) - before, int(gps_ns_of_utc(after)) - after) == (
        17 * NS_PER_S,
        18 * NS_PER_S,
    )
    for t in (before, after):
        assert int(utc_ns_of_gps(gps_ns_of_utc(t))) == t


def test_gzipped_files_are_read(tmp_path: Path) -> None:
    packed = tmp_path / "brdc.gz"
    packed.write_bytes(gzip.compress(BROADCAST_2.read_bytes()))
    assert len(read_rinex([packed]).satellites) == 10
    packed.write_bytes(gzip.compress(BROADCAST_2.read_bytes())[:-200])
    with pytest.raises(OrbitError, match="cannot be read"):
        read_rinex([packed])


def test_a_file_that_is_still_being_written_is_read_to_its_last_whole_message(
    tmp_path: Path,
) -> None:
    text = BROADCAST_2.read_text()
    half = tmp_path / "half.21n"
    half.write_text(text[: len(text) - 300])
    found = read_rinex([half])
    assert found.skipped["a message that breaks off"] == 1


@pytest.mark.parametrize(
    ("of", "change", "complaint"),
    [
        ("rinex", lambda t: t[:0], "is no RINEX navigation file"),
        ("rinex", lambda t: t.replace("NAVIGATION DATA", "OBSERVATION DATA", 1), "is no RINEX nav"),
        ("rinex", lambda t: t.replace("     2  ", "     5  ", 1), "is RINEX 5"),
        ("rinex", lambda t: t.replace("END OF HEADER", "END OF NOTHING"), "no END OF HEADER"),
        ("rinex", lambda t: t.replace("0.515", "0.x15", 1), r"line \d+: the message of G\d\d"),
        ("rinex", lambda t: t.replace("D+04", "D+09", 40), r"the message of G\d\d is damaged"),
        ("rinex", lambda t: t[: t.index("END OF HEADER") + 14], "no message of GPS, Galileo"),
        ("sp3", lambda t: t[:1], "is no SP3-c or SP3-d"),
        ("sp3", lambda t: t.replace("#c", "#a", 1), "is no SP3-c or SP3-d"),
        ("sp3", lambda t: with_x_of_g05(t, "2xx31.572967"), r"line \d+: could not"),
        ("sp3", lambda t: with_x_of_g05(t, "99999.000000"), "from the Earth"),
        ("sp3", lambda t: t.replace("%c M  cc GPS", "%c M  cc XYZ"), "time system 'XYZ'"),
        ("sp3", lambda t: "\n".join(t.splitlines()[:60]), "no satellite has 6 epochs"),
    ],
)  # fmt: skip
def test_a_wrong_or_damaged_file_is_said_in_one_line(tmp_path, of, change, complaint) -> None:
    path = tmp_path / "orbits"
    text = (BROADCAST_2 if of == "rinex" else PRECISE).read_text()
    assert change(text) != text
    path.write_text(change(text))
    with pytest.raises(OrbitError, match=complaint) as caught:
        (read_rinex if of == "rinex" else read_sp3)([path])
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_is_said() -> None:
    with pytest.raises(OrbitError, match="does not exist"):
        read_sp3([Path("nowhere.sp3")])
