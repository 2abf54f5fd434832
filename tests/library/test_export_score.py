"""SCORE's table, checked by the rules of the repository that takes it.

The rules are facts of the repository's own code (iausathub/score, commit 9e32931: the checks of an
upload, of its models and of its forms), written down here once more.
"""

import csv
import io
import re
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

import rsoconsole as rso
from rsoconsole.base import ExportError
from rsoconsole.library import ExportOptions, ScoreOptions, Target, export, render
from rsoconsole.library.formats.night import read_exported_night
from rsoconsole.library.formats.rows import MeasuredRow
from tests.nights.export_nights import closed_night
from tests.nights.lit_night import LIMITING_MAG, lit_night

EMAIL, ORCID = "observer@example.org", "0000-0002-1825-0097"
COLUMNS = [
    "satellite_name",
    "norad_cat_id",
    "observation_time_utc",
    "observation_time_uncertainty_sec",
    "apparent_magnitude",
    "apparent_magnitude_uncertainty",
    "observer_latitude_deg",
    "observer_longitude_deg",
    "observer_altitude_m",
    "limiting_magnitude",
    "instrument",
    "observing_mode",
    "observing_filter",
    "observer_email",
    "observer_orcid",
    "satellite_right_ascension_deg",
    "satellite_declination_deg",
    "sigma_2_ra",
    "sigma_ra_sigma_dec",
    "sigma_2_dec",
    "range_to_satellite_km",
    "range_to_satellite_uncertainty_km",
    "range_rate_of_satellite_km_per_sec",
    "range_rate_of_satellite_uncertainty_km_per_sec",
    "comments",
    "data_archive_link",
    "mpc_code",
]
GIVEN = ScoreOptions(email=EMAIL, orcid=ORCID, detector="CMOS", passband="CLEAR")
FULL = ExportOptions(target=Target(norad_id=36097), score=GIVEN)


def uploaded(text: str) -> list[list[str]]:
    """Rows as SCORE takes them: a first line that begins with satellite_name is a heading."""
    lines = io.StringIO(text.encode().decode("utf-8-sig"))
    if not next(lines).startswith("satellite_name"):
        lines.seek(0)
    return list(csv.reader(lines, delimiter=","))


def faults(row: list[str]) -> list[str]:
    """What SCORE refuses in one row."""
    if len(row) != 27:
        return [f"27 fields expected, {len(row)} there"]
    cell = dict(zip(COLUMNS, row, strict=True))
    found = []

    def number(name: str, low: float, high: float, *, may_miss: bool) -> None:
        if cell[name] == "" and may_miss:
            return
        try:
            is_good = low <= float(cell[name]) <= high
        except ValueError:
            is_good = False
        if not is_good:
            found.append(name)

    far = float("1e99")
    number("norad_cat_id", 1, 999_999, may_miss=False)
    number("observation_time_uncertainty_sec", 0, far, may_miss=False)
    number("apparent_magnitude", -far, far, may_miss=True)
    number("apparent_magnitude_uncertainty", 0, far, may_miss=True)
    number("observer_latitude_deg", -90, 90, may_miss=False)
    number("observer_longitude_deg", -180, 180, may_miss=False)
    number("observer_altitude_m", -far, far, may_miss=False)
    number("limiting_magnitude", 1e-9, far, may_miss=False)
    number("satellite_right_ascension_deg", 0, 360, may_miss=True)
    number("satellite_declination_deg", -90, 90, may_miss=True)
    for name in ("sigma_2_ra", "sigma_ra_sigma_dec", "sigma_2_dec"):
        number(name, -far, far, may_miss=True)
    for name in COLUMNS[20:22]:
        number(name, 0, far, may_miss=True)
    if (cell["apparent_magnitude"] == "") != (cell["apparent_magnitude_uncertainty"] == ""):
        found.append("a magnitude and its uncertainty belong together")
    if cell["observing_mode"] not in {"VISUAL", "BINOCULARS", "CCD", "CMOS", "OTHER"}:
        found.append("observing_mode")
    found += [n for n in ("instrument", "observing_filter") if not 0 < len(cell[n]) <= 200]
    if re.fullmatch(r"\d{4}-\d{2}-\d{2}T\d{2}:\d{2}:\d{2}(\.\d+)?Z", row[2]) is None:
        found.append("observation_time_utc")
    else:
        datetime.fromisoformat(row[2])
    if re.fullmatch(r"[^@\s]+@[^@\s]+\.[a-zA-Z]{2,}", cell["observer_email"]) is None:
        found.append("observer_email")
    for each in cell["observer_orcid"].split(","):
        if re.fullmatch(r"\d{4}-\d{4}-\d{4}-\d{3}[0-9Xx]", each.strip()) is None:
            found.append("observer_orcid")
    if len(cell["mpc_code"]) > 10 or "SATHUB-SATELLITE" in cell["satellite_name"]:
        found.append("sample data, or a code")
    return found


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return lit_night(tmp_path_factory.mktemp("lit") / "night")


def measured(session: Path) -> list[MeasuredRow]:
    rows = read_exported_night(session).track_measurements(1)
    return [row for row in rows if row.mag_v is not None]


def test_every_row_is_one_that_score_takes(session: Path):
    text, made = render(session, "score", FULL)
    assert text.splitlines()[0].split(",") == COLUMNS
    rows = uploaded(text)
    assert len(rows) == made.measurements == len(measured(session)) == 9
    assert [faults(row) for row in rows] == [[]] * len(rows)
    assert made.left_out["without a magnitude in V"] == 3


def test_a_row_says_what_was_measured(session: Path):
    text, _ = render(session, "score", FULL)
    for line, row in zip(csv.DictReader(io.StringIO(text)), measured(session), strict=True):
        assert line["norad_cat_id"] == "36097"
        assert float(line["apparent_magnitude"]) == pytest.approx(row.mag_v, abs=1e-4)
        # Noise and zero point 0.03, colour 0.04.
        assert float(line["apparent_magnitude_uncertainty"]) == pytest.approx(0.05)
        assert float(line["limiting_magnitude"]) == LIMITING_MAG
        assert float(line["satellite_right_ascension_deg"]) == pytest.approx(row.ra_icrs_deg)
        assert float(line["satellite_declination_deg"]) == pytest.approx(row.dec_icrs_deg)
        cells = [line[name] for name in ("sigma_2_ra", "sigma_ra_sigma_dec", "sigma_2_dec")]
        assert [float(each) for each in cells] == pytest.approx([0.09, 0.006, 0.04])
        assert row.t_mid_utc.startswith(line["observation_time_utc"].removesuffix("Z")[:-1])
        assert (line["observing_mode"], line["observing_filter"]) == ("CMOS", "CLEAR")
        assert (line["observer_email"], line["observer_orcid"]) == (EMAIL, ORCID)
        assert "V by Tycho-2 stars" in line["comments"]
        # Distance was computed, not measured: SCORE's columns are for measured ones.
        assert {line[name] for name in (*COLUMNS[20:24], "satellite_name", "mpc_code")} == {""}


@pytest.mark.parametrize(
    ("column", "value", "fault"),
    [
        (1, "", "norad_cat_id"),
        (2, "2024-01-01 00:00:00", "observation_time_utc"),
        (4, "", "a magnitude and its uncertainty belong together"),
        (7, "181", "observer_longitude_deg"),
        (9, "", "limiting_magnitude"),
        (11, "cmos", "observing_mode"),
        (13, "nobody", "observer_email"),
        (14, "0000", "observer_orcid"),
    ],
)
def test_the_rules_refuse_what_they_should(column, value, fault, session: Path):
    row = uploaded(render(session, "score", FULL)[0])[0]
    row[column] = value
    assert fault in faults(row)
    assert faults(row[:-1]) == ["27 fields expected, 26 there"]


def test_several_observers_are_one_cell(session: Path):
    both = ScoreOptions(
        email=EMAIL, orcid=f"{ORCID}, 0000-0002-1694-233x", detector="CCD", passband="V"
    )
    text, _ = render(session, "score", ExportOptions(target=Target(norad_id=1), score=both))
    rows = uploaded(text)
    assert {row[14] for row in rows} == {f"{ORCID},0000-0002-1694-233X"}
    assert [faults(row) for row in rows] == [[]] * len(rows)


def test_a_simulated_night_says_so(tmp_path: Path):
    session = lit_night(tmp_path / "made", about={"is_simulated": True})
    rows = uploaded(render(session, "score", FULL)[0])
    assert all(row[24].startswith("SIMULATED; ") for row in rows)


def test_what_score_requires_is_asked_for_together(session: Path):
    with pytest.raises(ExportError) as refused:
        render(session, "score", ExportOptions())
    for name in ("--norad", "--observer-email", "--observer-orcid", "--detector", "--filter"):
        assert name in str(refused.value)
    most = ExportOptions(target=Target(norad_id=1), score=ScoreOptions(email=EMAIL, orcid=ORCID))
    with pytest.raises(ExportError, match=r"give --detector, --filter$"):
        render(session, "score", most)
    large = ExportOptions(target=Target(norad_id=1_000_000), score=GIVEN)
    with pytest.raises(ExportError, match="six digits"):
        render(session, "score", large)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"email": "nobody"}, "no e-mail address"),
        ({"orcid": "0000-0002-1825-0098"}, "no ORCID"),
        ({"orcid": f"{ORCID},"}, "no ORCID"),
        ({"detector": "VISUAL"}, "none of CCD, CMOS, OTHER"),
        ({"passband": " "}, "a filter has a name"),
    ],
)
def test_a_wrong_option_is_named(given: dict[str, Any], words: str):
    with pytest.raises(ExportError, match=words):
        ScoreOptions(**given)


def test_a_night_without_magnitudes_is_no_night_of_non_detections(tmp_path: Path):
    with pytest.raises(ExportError, match="non-detection"):
        export(closed_night(tmp_path / "dark"), "score", None, FULL)


def test_python_has_the_verbs_text(session: Path):
    text = rso.to_score(
        session,
        norad=36097,
        observer_email=EMAIL,
        observer_orcid=ORCID,
        detector="CMOS",
        filter="CLEAR",
    )
    assert text == render(session, "score", FULL)[0]
    known = ExportOptions(target=Target(norad_id=36097))
    night = rso.open_session(session)
    assert rso.to_udl(night, norad=36097) == render(session, "udl", known)[0]
    assert night.export("udl").name == "night.udl.json"
