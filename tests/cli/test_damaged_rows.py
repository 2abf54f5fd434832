"""Rows of a session that no writer of ours makes: times that are none, paths and names that lie."""

import json
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from rsoconsole.cli.app import app
from rsoconsole.records import Event, FrameTaken
from rsoconsole.session import SessionReader

SAMPLE = Path(__file__).resolve().parents[2] / "sessions" / "intelsat-14"
FAR = 253_402_300_800 * 10**9
"""The year 10000; more than SQLite's integers hold."""
VERBS = {
    "html": ("export", "--format", "html", "--out"),
    "figures": ("figures", "--out"),
    "what-if": ("what-if", "--q", "4", "--save"),
    "regions": ("export", "--format", "regions", "--out"),
}


@pytest.fixture
def night(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "sessions" / "foreign"
    shutil.copytree(SAMPLE, folder)
    config = tmp_path / "config.toml"
    config.write_text(f'[session]\nroot = "{folder.parent}"\n', encoding="utf-8")
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(config))
    return folder


def change(folder: Path, statement: str, *values: Any) -> None:
    with closing(sqlite3.connect(folder / "session.db")) as connection:
        connection.execute(statement, values)
        connection.commit()


def run(night: Path, name: str) -> None:
    """Raises whatever the verb raises beside a line of its own."""
    verb, *options = VERBS[name]
    out = "tried" if name == "what-if" else str(night.parents[1] / "out")
    found = CliRunner().invoke(app, [verb, str(night), *options, out], catch_exceptions=True)
    if found.exception is not None and not isinstance(found.exception, SystemExit):
        assert type(found.exception).__module__ == "rsoconsole.base.errors", repr(found.exception)


@pytest.mark.parametrize("t", [FAR, 1.5e300, "yesterday", b"\xff", -1, 2**63 - 1])
def test_a_record_whose_time_is_none_says_so_in_its_place(night: Path, t: Any):
    value = str(t) if isinstance(t, int) and t > 2**63 - 1 else t
    sql = f"UPDATE log SET t_utc_ns = {value} WHERE seq = 20" if isinstance(value, str) else ""
    if isinstance(t, str):
        sql = "UPDATE log SET t_utc_ns = 'yesterday' WHERE seq = 20"
    if sql:
        change(night, sql)
    else:
        change(night, "UPDATE log SET t_utc_ns = ? WHERE seq = 20", value)
    reader = SessionReader(night)
    found = {seq: record for seq, _, record in reader.records()}
    damaged = found[20]
    assert isinstance(damaged, Event)
    assert damaged.text.startswith("the time of a ")
    assert len(found) > 100
    counts = reader.counts()
    assert counts.t_first_utc_ns is not None
    assert counts.t_last_utc_ns is not None
    assert counts.t_last_utc_ns - counts.t_first_utc_ns < 86_400 * 10**9


@pytest.mark.parametrize("t", [FAR, "'yesterday'", 1.5e300])
def test_a_night_without_any_time_is_told_in_words(night: Path, t: Any):
    change(night, f"UPDATE log SET t_utc_ns = {t}")
    run(night, "html")
    found = CliRunner().invoke(app, ["sessions", "prune", "--keep-days", "0"])
    assert found.exit_code == 0


@pytest.mark.parametrize("path", [b"\x00\xff", 7, "a" * 5000, "frames/\x00"])
def test_a_path_that_is_none_is_no_file(night: Path, path: Any):
    change(night, "UPDATE files SET path = ? WHERE role = 'frame'", path)
    assert SessionReader(night).frame_path(9) is None
    run(night, "regions")


@pytest.mark.parametrize("name", ["\x00", "a" * 5000, "b/" * 3000])
def test_a_parent_that_no_folder_can_be_called_is_none(night: Path, name: str):
    change(night, "INSERT OR REPLACE INTO meta VALUES ('branch_of', ?)", json.dumps(name))
    assert SessionReader(night).original_folder is None
    run(night, "regions")


def every(night: Path, kind: type, value: Any) -> None:
    """Every number of a kind in every record becomes another."""

    def walked(part: Any) -> Any:
        if isinstance(part, dict):
            return {key: walked(each) for key, each in part.items()}
        if isinstance(part, list):
            return [walked(each) for each in part]
        return value if isinstance(part, kind) and not isinstance(part, bool) else part

    with closing(sqlite3.connect(night / "session.db")) as connection:
        rows = connection.execute("SELECT seq, body FROM log").fetchall()
        for seq, body in rows:
            text = json.dumps(walked(json.loads(body)))
            connection.execute("UPDATE log SET body = ? WHERE seq = ?", (text, seq))
        connection.commit()


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize(("kind", "value"), [(int, 0), (int, -1), (int, 2**70), (float, 0.0)])
def test_a_night_of_nothing_but_one_number_breaks_no_verb(
    night: Path, verb: str, kind: type, value: Any
):
    every(night, kind, value)
    run(night, verb)


IMPLAUSIBLE = {
    "Measurement": {"t_mid_utc_ns": 2**70, "dec_icrs_deg": 1e308, "cov_sky_arcsec2": [-1, 0, 1]},
    "TrackState": {"t_utc_ns": -1, "x": [1e308] * 4, "P": [[1.0], [1.0, 2.0], [1.0], [1.0]]},
    "FrameTaken": {"t_start_utc_ns": 2**70, "exposure_s": 1e308},
}


@pytest.mark.parametrize(
    ("kind", "name"), [(kind, name) for kind, names in IMPLAUSIBLE.items() for name in names]
)
def test_a_record_with_numbers_that_are_none_is_damaged(night: Path, kind: str, name: str):
    with closing(sqlite3.connect(night / "session.db")) as connection:
        seq, body = connection.execute(
            "SELECT seq, body FROM log WHERE kind = ? ORDER BY seq", (kind,)
        ).fetchone()
    change(
        night,
        "UPDATE log SET body = ? WHERE seq = ?",
        json.dumps({**json.loads(body), name: IMPLAUSIBLE[kind][name]}),
        seq,
    )
    found = {at: record for at, _, record in SessionReader(night).records()}[seq]
    assert isinstance(found, Event)
    assert found.text.startswith(f"a {kind} of this session is damaged: ")


def test_an_offset_of_the_clock_that_is_no_number_is_not_recorded(night: Path):
    change(night, "INSERT OR REPLACE INTO meta VALUES ('clock_offset_s', '\"soon\"')")
    run(night, "html")
    frames = [each for _, _, each in SessionReader(night).records(kinds=(FrameTaken,))]
    assert frames
