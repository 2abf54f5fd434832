"""Files of text from strangers: too deep, too large, no plain file; each is one clear line."""

import json
import os
import sqlite3
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from rsoconsole.base import (
    ConfigError,
    ControlError,
    OrbitError,
    RsoconsoleError,
    SessionError,
    read_foreign_text,
)
from rsoconsole.base.foreign_text import MAX_BYTES
from rsoconsole.config import config_faults, load_config
from rsoconsole.console.commands.keymap import load_keymap
from rsoconsole.console.tuning.tuning_pane import load_presets
from rsoconsole.control.wire import read_outcome
from rsoconsole.library import ReadOptions, read_observations
from rsoconsole.orbits import parse_element_sets
from rsoconsole.orbits.elements import element_sets
from rsoconsole.pipeline import read_catalogue, read_observed_tracks
from rsoconsole.records import Event, FrameTaken
from rsoconsole.session import SessionReader
from rsoconsole.session.files.upkeep_log import parse_notes
from rsoconsole.session.upkeep._recover import recover_session
from rsoconsole.simulator import load_world
from tests.nights.made_up_night import add_frames, armed, begin

DEEP_JSON = "[" * 200_000
DEEP_TOML = "a = " + DEEP_JSON
NOW_UTC_NS = 1_700_000_000 * 10**9
QUICK_S = 4.0
"""A FIFO that nobody writes to would be waited for without end."""

READERS: dict[str, Callable[[Path], object]] = {
    "configuration": load_config,
    "keymap": load_keymap,
    "presets": load_presets,
    "world": load_world,
    "elements": lambda path: read_catalogue([path]),
    "tdm": lambda path: read_observations(path, ReadOptions()),
}


@pytest.mark.parametrize("name", ["configuration", "keymap", "presets", "world"])
def test_toml_nested_too_deeply_is_one_line(name: str, tmp_path: Path):
    path = tmp_path / "deep.toml"
    path.write_text(DEEP_TOML, encoding="utf-8")
    with pytest.raises(ConfigError, match="nested too deeply") as caught:
        READERS[name](path)
    assert "\n" not in str(caught.value)


def test_config_check_names_a_deep_file_as_a_fault(tmp_path: Path):
    path = tmp_path / "deep.toml"
    path.write_text(DEEP_TOML, encoding="utf-8")
    (fault,) = config_faults(path)
    assert "nested too deeply" in fault.problem
    assert fault.remedy


@pytest.mark.parametrize("name", READERS)
def test_what_is_no_plain_file_is_refused_at_once(name: str, tmp_path: Path):
    fifo, endless = tmp_path / "fifo", tmp_path / "endless"
    os.mkfifo(fifo)
    endless.symlink_to("/dev/zero")
    for path in (fifo, endless):
        began_s = time.monotonic()
        with pytest.raises(RsoconsoleError, match="it is no plain file"):
            READERS[name](path)
        assert time.monotonic() - began_s < QUICK_S


def test_a_configuration_larger_than_any_is_refused(tmp_path: Path):
    path = tmp_path / "huge.toml"
    with path.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(ConfigError, match="larger than 8 MB"):
        load_config(path)


def test_line_ends_of_every_kind_are_read_as_one(tmp_path: Path):
    path = tmp_path / "text"
    path.write_bytes(b"one\r\ntwo\rthree\n")
    assert read_foreign_text(path) == "one\ntwo\nthree\n"


# ---- elements and observations -------------------------------------------------------------


def test_elements_nested_too_deeply_are_one_line():
    with pytest.raises(OrbitError, match="nested too deeply"):
        parse_element_sets(DEEP_JSON, "e.json")


def test_observations_nested_too_deeply_are_one_line(tmp_path: Path):
    path = tmp_path / "seen.json"
    path.write_text(DEEP_JSON, encoding="utf-8")
    with pytest.raises(OrbitError, match="nested too deeply"):
        read_observed_tracks(path)


@pytest.mark.parametrize(
    "one",
    [
        "name\n1 x\n2 x\n",
        '{"NORAD_CAT_ID": 1},\n',
        "<omm><NORAD_CAT_ID>1</NORAD_CAT_ID></omm>\n",
        "1,2,3\n",
    ],
)
def test_a_million_element_sets_are_refused_before_the_work(one: str):
    heads = {"{": "[", "1": "OBJECT_NAME,NORAD_CAT_ID,EPOCH\n"}
    text = heads.get(one[0], "") + one * 1_000_000
    began_s = time.thread_time()
    with pytest.raises(OrbitError, match="1,000,000 element sets, 200,000 at most") as caught:
        parse_element_sets(text, "all.tle")
    assert time.thread_time() - began_s < QUICK_S
    assert "keep those of the last days" in str(caught.value)


def test_as_many_sets_as_are_allowed_are_read(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(element_sets, "MAX_SETS", 2)
    line_1 = "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927"
    line_2 = "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537"
    one = f"{line_1}\n{line_2}\n"
    assert len(parse_element_sets(one * 2).entries) == 2
    with pytest.raises(OrbitError, match="3 element sets, 2 at most"):
        parse_element_sets(one * 3)


# ---- sessions and the wire -----------------------------------------------------------------


@pytest.fixture
def night(tmp_path: Path) -> Path:
    """Three frames, closed."""
    writer = begin(tmp_path / "night")
    armed(writer)
    add_frames(writer, range(1, 4))
    writer.close()
    return tmp_path / "night"


def write(night: Path, statement: str, *values: object) -> None:
    with closing(sqlite3.connect(night / "session.db")) as connection:
        connection.execute(statement, values)
        connection.commit()


def test_a_deep_fact_of_a_session_is_a_damage_in_one_line(night: Path):
    write(night, "UPDATE meta SET value = ? WHERE key = 'config'", DEEP_JSON)
    with pytest.raises(SessionError, match="nested too deeply"):
        SessionReader(night).read_meta()


def test_a_deep_name_of_a_parent_is_none(night: Path):
    write(night, "INSERT OR REPLACE INTO meta VALUES ('branch_of', ?)", DEEP_JSON)
    assert SessionReader(night).original_folder is None


def test_in_the_place_of_a_deep_record_stands_one_line_that_says_so(night: Path):
    write(night, "UPDATE log SET body = ? WHERE kind = 'FrameTaken' AND frame_id = 2", DEEP_JSON)
    alarms = [
        each.text
        for _, _, each in SessionReader(night).records()
        if isinstance(each, Event) and each.level == "alarm"
    ]
    assert alarms == ["a FrameTaken of this session is damaged: its brackets are nested too deeply"]


def test_what_is_nested_too_deeply_is_not_recovered_and_the_rest_is(night: Path):
    write(night, "UPDATE log SET body = ? WHERE kind = 'FrameTaken' AND frame_id = 2", DEEP_JSON)
    write(night, "UPDATE meta SET value = ? WHERE key = 'title'", DEEP_JSON)
    found = SessionReader(recover_session(night, NOW_UTC_NS).folder)
    assert [each.frame_id for _, _, each in found.records(kinds=(FrameTaken,))] == [1, 3]
    assert found.read_meta()["title"] == "night"


def test_a_deep_note_of_upkeep_is_passed_over():
    content = DEEP_JSON.encode() + b"\n" + json.dumps({"verb": "prune"}).encode() + b"\n"
    assert parse_notes(content) == [{"verb": "prune"}]


def test_a_deep_answer_of_an_engine_is_one_line():
    with pytest.raises(ControlError, match="nested too deeply"):
        read_outcome(DEEP_JSON.encode())
