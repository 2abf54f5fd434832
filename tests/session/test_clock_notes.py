"""A night whose clock was set, ran wrong or slept says so wherever its times are used."""

import shutil
from pathlib import Path

import pytest

from rsoconsole.library import Target, render_report, write_figures
from rsoconsole.library.formats.api import to_ecsv
from rsoconsole.library.formats.night import read_exported_night
from rsoconsole.library.formats.tdm import to_tdm
from rsoconsole.records import Event
from rsoconsole.session import SessionReader, clock_fault_lines, encode
from tests.cli.test_damaged_rows import SAMPLE, change

FAULT = Event(
    level="alarm",
    text="a time service or somebody has set the clock by +1.0 s: what was under way is given up",
    topic="clock",
)
NOTE = "2023-06-22T03:04:05Z a time service or somebody has set the clock by +1.0 s"
T_UTC_NS = 1_687_403_045_000_000_000


@pytest.fixture
def night(tmp_path: Path) -> Path:
    folder = tmp_path / "night"
    shutil.copytree(SAMPLE, folder)
    kind, _, body = encode(FAULT)
    _, _, calm = encode(Event(level="info", text="the mount tracks: as it was left", topic="clock"))
    for seq, words in ((900_001, body), (900_002, calm)):
        change(folder, "INSERT INTO log VALUES (?, ?, ?, NULL, ?)", seq, T_UTC_NS, kind, words)
    return folder


def test_a_steady_night_has_nothing_to_say_of_its_clock():
    assert clock_fault_lines(SessionReader(SAMPLE)) == ()
    assert read_exported_night(SAMPLE).table_metadata()["clock_faults"] == []


def test_what_happened_to_the_clock_is_told_in_figures_tables_report_and_messages(night: Path):
    assert clock_fault_lines(SessionReader(night)) == (NOTE,)
    exported = read_exported_night(night)
    assert exported.table_metadata()["clock_faults"] == [NOTE]
    assert NOTE in to_ecsv(exported)
    (track, *_) = exported.tracks
    tdm = to_tdm(exported, (track,), target=Target(), created_utc_ns=T_UTC_NS)
    assert f"COMMENT CLOCK {NOTE}" in tdm
    assert NOTE in render_report(night).html
    drawn = write_figures(night, night.parent / "figures", file_format="svg")
    assert all("CLOCK" in each.read_text(encoding="utf-8") for each in drawn)
