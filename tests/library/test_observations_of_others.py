"""Files of others: units, instants, stations and errors are what the file says, never guessed."""

import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.base import ExportError, OrbitError
from rsoconsole.library import ReadOptions, read_observations
from rsoconsole.library.formats._iod_reader import is_uk_line, parse_uk_line
from rsoconsole.records import Site
from rsoconsole.sky import iso_to_utc_ns

HERE = Site(latitude_deg=52.1358, longitude_deg=-2.3264, elevation_m=70.0)
ASK = ReadOptions(site=HERE)
ROWS = [("2023-06-22T03:00:00", 10.0, 5.0), ("2023-06-22T03:01:00", 10.3, 5.1)]


def table(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "file.txt"
    path.write_text(text)
    return path


def small(name: str) -> str:
    """Directions near 0 h on the equator, in degrees, as a file of that form."""
    if name == "tdm":
        return tdm([(t, ra / 10, dec / 10) for t, ra, dec in ROWS])
    if name == "udl":
        return json.dumps(
            [{"obTime": t, "ra": ra / 10, "declination": d / 10} for t, ra, d in ROWS]
        )
    if name == "json":
        return json.dumps({"obs": [[t, ra / 10, dec / 10] for t, ra, dec in ROWS]})
    lines = [f"{t},{ra / 10},{dec / 10}" for t, ra, dec in ROWS]
    return "\n".join([f"time,{name}", *lines])


@pytest.mark.parametrize("name", ["tdm", "udl", "json", "ra_deg,dec_deg", "ra_icrs_deg,dec"])
def test_a_form_that_says_its_unit_is_never_asked_nor_converted(name: str, tmp_path: Path) -> None:
    path = table(tmp_path, small(name))
    ((read,),) = read_observations(path, ASK)
    np.testing.assert_allclose(read.seen.ra_icrs_deg, [1.0, 1.03])
    with pytest.raises(OrbitError, match=r"leave --radians out|write them so"):
        read_observations(path, ReadOptions(site=HERE, is_radians=True))


@pytest.mark.parametrize("head", ["ra_rad,dec_rad", "ra_hours,dec_deg"])
def test_what_a_name_says_is_converted_once(head: str, tmp_path: Path) -> None:
    lines = [f"{t},0.01,0.02" for t, _, _ in ROWS]
    path = table(tmp_path, "\n".join([f"time,{head}", *lines]))
    ((read,),) = read_observations(path, ASK)
    wanted = math.degrees(0.01) if head == "ra_rad,dec_rad" else 0.15
    assert read.seen.ra_icrs_deg[0] == pytest.approx(wanted)
    with pytest.raises(OrbitError, match="leave --radians out"):
        read_observations(path, ReadOptions(site=HERE, is_radians=True))


def test_radians_beside_a_name_without_a_unit_are_no_direction(tmp_path: Path) -> None:
    path = table(tmp_path, "time,ra_rad,dec\n2023-06-22T03:00:00,0.1,0.1\n")
    with pytest.raises(ExportError, match="dec has no unit"):
        read_observations(path, ASK)


def test_json_on_one_line_is_json_whatever_its_keys_begin_with(tmp_path: Path) -> None:
    path = table(tmp_path, json.dumps({"range_km": [1], "obs": ROWS}))
    ((read,),) = read_observations(path, ASK)
    np.testing.assert_allclose(read.seen.ra_icrs_deg, [10.0, 10.3])
    row = {"time": ROWS[0][0], "RA (deg)": 10.0, "Dec (deg)": 5.0}
    ((read,),) = read_observations(
        table(tmp_path, "\n".join(json.dumps({**row, "time": t}) for t, _, _ in ROWS)), ASK
    )
    assert len(read.seen) == 2


@pytest.mark.parametrize("column", ["sigma_arcsec", "sigma_ra_arcsec", "sigma_dec_arcsec"])
def test_an_error_of_nothing_is_refused(column: str, tmp_path: Path) -> None:
    path = table(tmp_path, f"time,ra_deg,dec_deg,{column}\n2023-06-22T03:00:00,10,5,0\n")
    with pytest.raises(ExportError, match="must be above 0"):
        read_observations(path, ASK)


# Messages of others


def tdm(rows: Sequence[tuple[str, float, float]], *metadata: str, path: str = "PATH = 2,1") -> str:
    """A message that another program could have written."""
    head = ["CCSDS_TDM_VERS = 2.0", "CREATION_DATE = 2023-06-24T12:00:00", "ORIGINATOR = ME"]
    told = ["TIME_SYSTEM = UTC", "PARTICIPANT_1 = HILL", "PARTICIPANT_2 = THING", path]
    told += ["ANGLE_TYPE = RADEC", "REFERENCE_FRAME = EME2000", *metadata]
    data = [line for t, ra, dec in rows for line in (f"ANGLE_1 = {t} {ra}", f"ANGLE_2 = {t} {dec}")]
    lines = [*head, "META_START", *(each for each in told if each), "META_STOP"]
    return "\n".join([*lines, "DATA_START", *data, "DATA_STOP", ""])


@pytest.mark.parametrize(("reference", "later_s"), [("START", 2.0), ("MIDDLE", 0.0), ("END", -2.0)])
def test_a_time_is_that_of_the_exposures_middle(
    reference: str, later_s: float, tmp_path: Path
) -> None:
    text = tdm(ROWS, "INTEGRATION_INTERVAL = 4.0", f"INTEGRATION_REF = {reference}")
    ((read,),) = read_observations(table(tmp_path, text), ASK)
    written_ns = [iso_to_utc_ns(t + "Z") for t, _, _ in ROWS]
    assert [(t - w) / 1e9 for t, w in zip(read.seen.t_utc_ns, written_ns, strict=True)] == [
        later_s,
        later_s,
    ]


@pytest.mark.parametrize(("applied", "added_deg"), [("NO", 0.25), ("YES", 0.0)])
def test_corrections_that_are_not_in_the_angles_are_added(
    applied: str, added_deg: float, tmp_path: Path
) -> None:
    corrections = ("CORRECTION_ANGLE_1 = 0.25", "CORRECTION_ANGLE_2 = -0.25")
    text = tdm(ROWS, *corrections, f"CORRECTIONS_APPLIED = {applied}")
    ((read,),) = read_observations(table(tmp_path, text), ASK)
    np.testing.assert_allclose(read.seen.ra_icrs_deg, [10.0 + added_deg, 10.3 + added_deg])
    np.testing.assert_allclose(read.seen.dec_icrs_deg, [5.0 - added_deg, 5.1 - added_deg])


@pytest.mark.parametrize(
    ("metadata", "words"),
    [
        (("TIMETAG_REF = TRANSMIT",), "only RECEIVE"),
        (("RECEIVE_DELAY_1 = 0.5",), "take the delay out"),
        (("INTEGRATION_REF = END",), "how long an exposure is"),
        (("CORRECTION_ANGLE_1 = 0.1",), "say YES or NO"),
        (("CORRECTION_ABERRATION_YEARLY = 0.005", "CORRECTIONS_APPLIED = NO"), "aberration"),
    ],
)
def test_a_message_that_means_something_else_is_refused(
    metadata: tuple[str, ...], words: str, tmp_path: Path
) -> None:
    with pytest.raises(ExportError, match=words):
        read_observations(table(tmp_path, tdm(ROWS, *metadata)), ASK)


@pytest.mark.parametrize(
    ("path", "seen", "station"),
    [
        ("", "THING", "HILL"),
        ("PATH = 2,1", "THING", "HILL"),
        ("PATH = 1,2", "HILL", "THING"),
        ("PATH = 1,2,1", "THING", "HILL"),
    ],
)
def test_who_sees_whom_is_said_by_the_path(
    path: str, seen: str, station: str, tmp_path: Path
) -> None:
    text = tdm(ROWS, path=path)
    ((read,),) = read_observations(table(tmp_path, text), ReadOptions(site=HERE, target=seen))
    assert read.name.endswith(f"station {station}")


def test_a_path_by_nobody_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ExportError, match="participant 3"):
        read_observations(table(tmp_path, tdm(ROWS, path="PATH = 3,1")), ASK)


@pytest.mark.parametrize("code", "12367")
@pytest.mark.parametrize("position", ["   5", " 5  ", "5   ", "15 3", " 5 3", "5  5"])
def test_an_error_of_position_in_a_uk_line_is_one_or_a_sentence(code: str, position: str) -> None:
    line = f"9701201201803101520195542  01   1{code}172038  +15585  {position}5"
    digits = position.rstrip()
    if not is_uk_line(line):
        return
    if " " in digits.strip():
        with pytest.raises(ExportError, match="blank inside"):
            parse_uk_line(line)
        return
    seconds, minutes, degrees = (0.5, 5.0, 5.0), (3.0, 300.0, 300.0), (18.0, 1800.0, 18000.0)
    wanted = {"1": seconds, "2": minutes}.get(code, degrees)[
        ["   5", " 5  ", "5   "].index(position)
    ]
    assert parse_uk_line(line).position_sigma_arcsec == pytest.approx(wanted)
