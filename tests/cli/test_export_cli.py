"""The verb export: files, refusals, and what a shell sees."""

import errno
import os
import shutil
from pathlib import Path

import pytest

from rsoconsole.base import ExportError, SessionError
from rsoconsole.library import ExportOptions, Target, export
from rsoconsole.library.formats._iod_reader import parse_iod_line
from rsoconsole.library.formats.night import read_exported_night
from rsoconsole.session import SessionWriter
from tests.cli.test_cli_frames import objects
from tests.nights.export_nights import T0, closed_night, read_tdm, written_night
from tests.nights.lit_night import lit_night
from tests.nights.orbit_night import identified_of
from tests.nights.samples import SAMPLE
from tests.pages.tables import read_csv
from tests.rigs.in_process import run_here


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return closed_night(tmp_path_factory.mktemp("night") / "verb")


def test_json_says_what_was_written_and_where(session: Path):
    run = run_here("export", session, "--format", "csv", "--json")
    assert run.returncode == 0, run.stderr
    (found,) = objects(run)
    path = session / "branches" / "exports" / "verb.csv"
    assert found["path"] == str(path)
    assert found["format"] == "csv"
    assert found["measurements"] == len(read_csv(path)) == 24
    assert found["tracks"] == 1


def test_a_text_goes_to_stdout_and_what_is_not_in_it_to_stderr():
    run = run_here(
        *("export", SAMPLE, "--format", "iod", "--out", "-"),
        *("--norad", "36097", "--cospar", "2009-064A", "--station", "1234", "--sky", "E"),
    )
    assert run.returncode == 0
    lines = run.stdout.splitlines()
    assert len(lines) == 27
    assert {parse_iod_line(line).norad_id for line in lines} == {36097}
    assert "simulated" in run.stderr


def test_a_message_without_a_number_says_which_the_record_would_give_it(tmp_path: Path):
    writer = written_night(tmp_path / "named")
    writer.append(identified_of(14), T0)
    writer.close()
    night = tmp_path / "named"
    for kind in ("tdm", "iod"):
        run = run_here("export", night, "--format", kind, "--out", "-")
        assert "on record it is INTELSAT 14 (36097): --norad 36097 writes that" in run.stderr
        # A comment says what it was taken for; the object's own field is the operator's word.
        own = [line for line in run.stdout.splitlines() if not line.startswith("COMMENT")]
        assert "36097" not in "".join(own)
        assert ("COMMENT Track 1 identified: INTELSAT 14" in run.stdout) == (kind == "tdm")
    told = run_here("export", night, "--format", "tdm", "--out", "-", "--norad", "36097")
    assert "on record it is" not in told.stderr
    assert "36097" in told.stdout


def test_a_report_is_one_of_the_formats(session: Path, tmp_path: Path):
    path = tmp_path / "deep" / "night.html"
    run = run_here("export", session, "--format", "html", "--out", path, "--json")
    assert run.returncode == 0, run.stderr
    assert objects(run)[0]["path"] == str(path)
    assert path.read_text(encoding="utf-8").startswith("<!doctype html>")
    assert run_here("export", session, "--format", "html", "--out", path).returncode == 1


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--format", "doc"], "doc"),
        (["--format", "csv", "--out", "-", "--json"], "--out -"),
        (["--format", "regions", "--out", "-"], "--out -"),
        (["--format", "fits", "--frames", "9-3"], "9-3"),
        (["--format", "tdm", "--norad", "1000000000"], "nine digits"),
        (["--format", "iod", "--sky", "X"], "no state of the sky"),
        (["--format", "score", "--observer-email", "me"], "no e-mail address"),
        (["--format", "score", "--observer-orcid", "1234"], "no ORCID"),
        (["--format", "score", "--detector", "eye"], "none of CCD, CMOS, OTHER"),
    ],
)
def test_wrong_usage_is_told_from_what_cannot_be_done(arguments, says):
    run = run_here("export", SAMPLE, *arguments)
    assert run.returncode == 2
    assert says in run.stderr
    assert run.stdout == ""


def test_a_folder_that_is_made_is_named(session: Path, tmp_path: Path):
    path = tmp_path / "for" / "others" / "night.csv"
    for expected in (f"created the folder {path.parent}\n", ""):
        run = run_here("export", session, "--format", "csv", "--out", path, "--force")
        assert (run.returncode, run.stderr) == (0, expected)


def test_score_gets_what_it_requires_or_one_line_says_what_is_missing(tmp_path: Path):
    night = lit_night(tmp_path / "lit")
    words = ("export", night, "--format", "score", "--norad", "36097")
    run = run_here(*words)
    assert run.returncode == 1
    assert run.stderr.count("\n") == 1
    assert "--observer-email, --observer-orcid, --detector, --filter" in run.stderr
    run = run_here(
        *(*words, "--observer-email", "me@example.org", "--observer-orcid", "0000-0002-1825-0097"),
        *("--detector", "CMOS", "--filter", "CLEAR", "--json"),
    )
    assert run.returncode == 0, run.stderr
    (found,) = objects(run)
    assert found["path"].endswith("lit.score.csv")
    assert found["measurements"] == 9
    assert "3 without a magnitude in V" in run.stderr


def test_what_cannot_be_done_is_one_line():
    run = run_here("export", SAMPLE, "--format", "iod", "--out", "-", "--track", "3")
    assert run.returncode == 1
    assert run.stderr.count("\n") == 1
    assert "no track 3; it has 1" in run.stderr


def test_a_file_that_is_there_is_left_alone_unless_forced(tmp_path: Path):
    path = tmp_path / "x.csv"
    path.write_text("mine")
    with pytest.raises(ExportError, match="--force"):
        export(SAMPLE, "csv", path)
    assert path.read_text() == "mine"
    export(SAMPLE, "csv", path, ExportOptions(is_forced=True))
    assert len(read_csv(path)) == 28
    with pytest.raises(ExportError, match="is a folder"):
        export(SAMPLE, "csv", tmp_path, ExportOptions(is_forced=True))
    (tmp_path / "file").write_text("")
    with pytest.raises(ExportError, match="folder"):
        export(SAMPLE, "regions", tmp_path / "file")


def test_frames_that_are_there_are_left_alone_too(tmp_path: Path):
    one = ExportOptions(frames=(9,))
    export(SAMPLE, "regions", tmp_path, one)
    with pytest.raises(ExportError, match=r"000009\.reg is there already"):
        export(SAMPLE, "regions", tmp_path)
    assert not (tmp_path / "000001.reg").exists()
    assert len(export(SAMPLE, "regions", tmp_path, ExportOptions(is_forced=True)).files) == 35


def test_a_full_disk_leaves_nothing_half(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "x.csv"
    path.write_text("the last one")

    def full(_descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ExportError, match=r"No space left on device.*--out"):
        export(SAMPLE, "csv", path, ExportOptions(is_forced=True))
    assert path.read_text() == "the last one"
    assert [each.name for each in tmp_path.iterdir()] == ["x.csv"]


def test_a_session_is_never_written_to(session: Path, tmp_path: Path):
    copy = tmp_path / "copy"
    shutil.copytree(session, copy, ignore=shutil.ignore_patterns("branches"))
    before = (copy / "session.db").read_bytes()
    export(copy, "tdm")
    export(copy, "regions")
    assert (copy / "session.db").read_bytes() == before
    known = {"session.db", "config.toml", "frames", "previews", "closeups"}
    assert {each.name for each in copy.iterdir()} - known == {"branches"}
    assert sorted(each.name for each in (copy / "branches" / "exports").iterdir()) == [
        "copy-frames",
        "copy.tdm",
    ]


def test_a_night_that_goes_on_is_exported_as_far_as_it_is(tmp_path: Path):
    writer = written_night(tmp_path / "live", frames=6)
    try:
        made = export(writer.folder, "tdm", tmp_path / "live.tdm")
        assert made.measurements == 6
        assert not read_exported_night(writer.folder).table_metadata()["is_closed"]
    finally:
        writer.close()


def test_a_branch_is_exported_like_a_session(session: Path):
    branch = session / "branches" / "q2"
    closed_night(branch, about={"branch_of": "../..", "tried": {"filter.q_multiplier": 2.0}})
    made = export(branch, "ecsv")
    assert made.path == branch / "branches" / "exports" / "q2.ecsv"
    facts = read_exported_night(branch).table_metadata()
    assert facts["branch_of"] == "../.."
    assert facts["tried"] == {"filter.q_multiplier": 2.0}


def test_a_night_without_a_track_has_tables_and_nothing_to_report(tmp_path: Path):
    session = closed_night(tmp_path / "short", frames=1)
    assert export(session, "csv", tmp_path / "x.csv").measurements == 2
    for kind in ("tdm", "iod"):
        with pytest.raises(ExportError, match="no track took anything"):
            export(session, kind, tmp_path / "x")
    empty = closed_night(tmp_path / "empty", frames=0)
    for kind in ("csv", "ecsv", "jsonl"):
        assert export(empty, kind, tmp_path / f"empty.{kind}").measurements == 0
    with pytest.raises(ExportError, match="no frame to export"):
        export(empty, "fits", tmp_path / "frames")


def test_several_tracks_are_several_segments_and_a_name_needs_one(tmp_path: Path):
    """Two nights' records in one log: the second begins a track of its own."""
    from dataclasses import replace

    from rsoconsole.session import SessionReader

    first = closed_night(tmp_path / "first")
    writer = SessionWriter.create(tmp_path / "both", SessionReader(first).config(), {})
    later_ns = 3600 * 1_000_000_000
    for shift, by in ((0, 0), (100, later_ns)):
        for _, t_utc_ns, record in SessionReader(first).records():
            writer.append(_later(record, shift, by, replace), t_utc_ns + by)
    writer.close()
    path = tmp_path / "both.tdm"
    made = export(writer.folder, "tdm", path)
    assert made.tracks == 2
    names = [segment.metadata["PARTICIPANT_2"] for segment in read_tdm(path).segments]
    assert names == ["UNKNOWN-1", "UNKNOWN-2"]
    named = ExportOptions(target=Target(norad_id=36097), is_forced=True)
    with pytest.raises(ExportError, match="2 tracks: --track says which"):
        export(writer.folder, "tdm", path, named)
    only = ExportOptions(target=Target(norad_id=36097), track=2, is_forced=True)
    made = export(writer.folder, "tdm", path, only)
    assert made.left_out["of other tracks"] == 12
    (segment,) = read_tdm(path).segments
    assert segment.metadata["PARTICIPANT_2"] == "36097"


def _later(record, shift, by, replace):
    """The same, some frames and nanoseconds later."""
    changes = {"frame_id": record.frame_id + shift}
    for name in ("t_start_utc_ns", "t_mid_utc_ns", "t_utc_ns"):
        if hasattr(record, name) and name in record.__slots__:
            changes[name] = getattr(record, name) + by
    if hasattr(record, "measurement"):
        changes["measurement"] = _later(record.measurement, shift, by, replace)
    for name in ("measurement_id", "track_id"):
        if (named := getattr(record, name, None)) is not None and shift:
            changes[name] = f"{named} later" if name == "measurement_id" else named + 1
    if getattr(record, "begun_with", None) is not None and shift:
        changes["begun_with"] = tuple(f"{named} later" for named in record.begun_with)
    return replace(record, **changes)


def test_what_is_no_session_and_what_is_no_format_is_refused(tmp_path: Path):
    with pytest.raises(ExportError, match="none of csv"):
        export(SAMPLE, "html", tmp_path / "x")
    with pytest.raises(SessionError, match="does not exist"):
        export(tmp_path / "none", "csv")


def test_the_help_has_an_example():
    run = run_here("export", "--help")
    assert "Example: rsoconsole export" in " ".join(run.stdout.split())
