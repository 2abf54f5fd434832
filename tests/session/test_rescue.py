"""A log whose place fails under a living engine: said at once, and what comes is on a disk."""

import json
import os
import pwd
import shutil
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from rsoconsole.base import SessionError
from rsoconsole.cli.app import app
from rsoconsole.config import Config
from rsoconsole.records import Event
from rsoconsole.session import (
    SessionReader,
    SessionWriter,
    read_notes,
    repair_session,
    verify_session,
)
from rsoconsole.session.files.digest import mark_closed
from rsoconsole.session.log.database import (
    FILE_ROWS,
    INSERT_FILE,
    connect_to_read,
    connect_to_write,
)
from rsoconsole.session.writing.log_writer import RescueSession, rescue_places

T0_UTC_NS = 1_687_400_000_000_000_000


def said(number: int) -> Event:
    return Event(level="info", text=f"fact {number}")


@pytest.fixture
def session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "sessions" / "night"


def rescued(tmp_path: Path) -> Path:
    return tmp_path / "state" / "rsoconsole" / "rescue" / "night"


def texts(folder: Path) -> list[str]:
    return [r.text for _, _, r in SessionReader(folder).records() if isinstance(r, Event)]


def facts(first: int, last: int) -> list[str]:
    return [f"fact {n}" for n in range(first, last + 1)]


def unlink(folder: Path) -> None:
    for path in folder.glob("session.db*"):
        path.unlink()


def overwrite(folder: Path) -> None:
    with (folder / "session.db").open("r+b") as file:
        file.write(os.urandom(20_000))


def replace(folder: Path) -> None:
    shutil.copy(folder / "config.toml", folder / "other")
    (folder / "other").replace(folder / "session.db")


DAMAGES: dict[str, tuple[Callable[[Path], None], str]] = {
    "log removed": (lambda f: (f / "session.db").unlink(), "has been removed"),
    "both removed": (unlink, "has been removed"),
    "folder deleted": (shutil.rmtree, "has been removed"),
    "cut short": (lambda f: os.truncate(f / "session.db", 4096), "cut short"),
    "written over": (overwrite, "written over"),
    "replaced": (replace, "has been replaced"),
    "write-ahead log emptied": (lambda f: os.truncate(f / "session.db-wal", 0), "cut short"),
}


@pytest.mark.parametrize("name", DAMAGES)
def test_a_lost_log_is_named_within_two_seconds_and_the_night_goes_on_elsewhere(
    session, tmp_path, name
):
    damage, words = DAMAGES[name]
    alarms: list[str] = []
    writer = SessionWriter.create(session, Config(), {"title": "night"}, on_fault=alarms.append)
    for n in range(1, 41):
        writer.append(said(n), T0_UTC_NS + n)
    assert writer.flush()
    damage(session)
    deadline = time.monotonic() + 2.0
    while not any(words in fault for fault in writer.faults):
        assert time.monotonic() < deadline, writer.faults
        time.sleep(0.02)
    assert any("rescue session" in fault for fault in writer.faults)
    for n in range(41, 51):
        writer.append(said(n), T0_UTC_NS + n)
    # What is in the rescue session is no acknowledgement that this session has it.
    assert not writer.flush()
    writer.close()
    assert texts(rescued(tmp_path)) == facts(1, 50)
    assert verify_session(rescued(tmp_path)).is_sound
    assert sum(words in each for each in alarms) == 1


def test_what_a_full_disk_refuses_is_kept_elsewhere_until_it_takes_it(session, tmp_path):
    writer = SessionWriter.create(session, Config(), {"title": "night"})
    writer.append(said(1), T0_UTC_NS)
    assert writer.flush()
    # As full as can be without a file system of one's own: nobody else may write.
    with closing(sqlite3.connect(session / "session.db", isolation_level=None)) as holder:
        holder.execute("BEGIN EXCLUSIVE")
        writer.append(said(2), T0_UTC_NS + 1)
        assert not writer.flush(4.0)
        assert any("rescue session" in fault for fault in writer.faults)
        with closing(sqlite3.connect(rescued(tmp_path) / "session.db")) as kept:
            ((body,),) = kept.execute("SELECT body FROM log")
        assert "fact 2" in body
        holder.execute("ROLLBACK")
    assert writer.flush(5.0)
    assert not writer.faults
    assert not rescued(tmp_path).exists()
    writer.append(said(3), T0_UTC_NS + 2)
    writer.close()
    assert texts(session) == facts(1, 3)
    assert verify_session(session).is_sound


def test_where_no_place_can_be_had_it_says_that_too(session, monkeypatch):
    monkeypatch.setattr("rsoconsole.session.writing.log_writer.MIN_BYTES", 10**18)
    writer = SessionWriter.create(session, Config(), {"title": "night"})
    writer.append(said(1), T0_UTC_NS)
    assert writer.flush()
    (session / "session.db").unlink()
    writer.append(said(2), T0_UTC_NS + 1)
    assert not writer.flush(1.0)
    assert any("not on any disk" in fault for fault in writer.faults)
    writer.close(1.0)


def test_a_log_that_somebody_folded_is_no_damage(session):
    writer = SessionWriter.create(session, Config(), {"title": "night"})
    for n in range(1, 200):
        writer.append(said(n), T0_UTC_NS + n)
    assert writer.flush()
    with closing(sqlite3.connect(session / "session.db")) as other:
        ((busy, *_),) = other.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        assert busy == 0
    for n in range(200, 210):
        writer.append(said(n), T0_UTC_NS + n)
        assert writer.flush()
    assert not writer.faults
    writer.close()
    assert texts(session) == facts(1, 209)


READER = """
import sqlite3, sys
with sqlite3.connect(sys.argv[1]) as connection:
    print(connection.execute("SELECT count(*) FROM log").fetchone()[0])
connection.close()
"""


def test_another_programs_glance_leaves_the_live_log_alone(session):
    """The sqlite3 shell opens to write, and folds the log where it believes itself the last one."""
    writer = SessionWriter.create(session, Config(), {"title": "night"})
    for n in range(1, 31):
        writer.append(said(n), T0_UTC_NS + n)
        assert writer.flush()
        if n % 10 == 0:
            time.sleep(0.6)  # the writer has looked after its files meanwhile
            command = [sys.executable, "-c", READER, str(session / "session.db")]
            found = subprocess.run(command, capture_output=True, text=True, check=True)
            assert int(found.stdout) == n
    assert not writer.faults
    writer.close()
    assert texts(session) == facts(1, 30)


def test_a_lost_log_is_saved_as_soon_as_a_place_can_be_had(session, tmp_path, monkeypatch):
    monkeypatch.setattr("rsoconsole.session.writing.log_writer.MIN_BYTES", 10**18)
    writer = SessionWriter.create(session, Config(), {"title": "night"})
    for n in range(1, 21):
        writer.append(said(n), T0_UTC_NS + n)
    assert writer.flush()
    shutil.rmtree(session)
    writer.append(said(21), T0_UTC_NS + 21)
    assert not writer.flush(1.0)
    assert any("not on any disk" in fault for fault in writer.faults)
    monkeypatch.setattr("rsoconsole.session.writing.log_writer.MIN_BYTES", 1)
    writer.append(said(22), T0_UTC_NS + 22)
    writer.flush(3.0)
    writer.close()
    assert any("goes on in the rescue session" in fault for fault in writer.faults)
    assert texts(rescued(tmp_path)) == facts(1, 22)


@pytest.mark.slow("waits until a full disk is given up")
def test_a_session_whose_end_lies_elsewhere_is_not_called_complete(session, tmp_path):
    writer = SessionWriter.create(session, Config(), {"title": "night"})
    writer.append(said(1), T0_UTC_NS)
    assert writer.flush()
    with closing(sqlite3.connect(session / "session.db", isolation_level=None)) as holder:
        holder.execute("BEGIN EXCLUSIVE")
        writer.append(said(2), T0_UTC_NS + 1)
        assert not writer.flush(4.0)
        writer.close(6.0)
        holder.execute("ROLLBACK")
    assert any("rescue session" in fault and "alone" in fault for fault in writer.faults)
    assert SessionReader(session).read_meta()["is_closed"] is False


@pytest.fixture
def split(session: Path, tmp_path: Path) -> tuple[Path, Path]:
    """A session that ends early, and the rescue with what came when its disk took nothing."""
    writer = SessionWriter.create(session, Config(), {"title": "night"})
    for n in range(1, 9):
        writer.append(said(n), T0_UTC_NS + n)
    writer.close()
    facts_of = {**SessionReader(session).read_meta(), "is_closed": False}
    del facts_of["writer"], facts_of["log_digest"]
    rescue = RescueSession(session, facts_of, b"")
    with closing(connect_to_write(session / "session.db")) as connection:
        newest = connection.execute("SELECT * FROM log WHERE seq > 3").fetchall()
        connection.execute("DELETE FROM log WHERE seq > 3")
        connection.execute("DELETE FROM meta WHERE key IN ('writer', 'log_digest')")
        connection.execute("UPDATE meta SET value = 'false' WHERE key = 'is_closed'")
    assert rescue.begin()
    assert rescue.write([("INSERT INTO log VALUES (?, ?, ?, ?, ?)", row) for row in newest])
    rescue.close()
    assert (texts(session), texts(rescued(tmp_path))) == (facts(1, 3), facts(4, 8))
    return session, rescued(tmp_path)


@pytest.mark.parametrize("named", ["session", "rescue"])
def test_repair_brings_a_rescue_back_into_its_session(split, named):
    session, rescue = split
    done = repair_session(session if named == "session" else rescue, T0_UTC_NS)
    (merged,) = done.merged
    assert (merged.session, merged.records) == (session, 5)
    assert texts(session) == facts(1, 8)
    assert verify_session(session).is_sound
    assert SessionReader(session).read_meta()["is_closed"] is True
    assert not rescue.exists()
    assert read_notes(session)[-1]["verb"] == "merge"
    assert not repair_session(session, T0_UTC_NS).did_anything


def test_a_session_that_was_closed_without_its_end_takes_it_too(split):
    session, rescue = split
    with closing(connect_to_write(session / "session.db")) as connection:
        mark_closed(connection)
    assert repair_session(session, T0_UTC_NS).merged
    assert texts(session) == facts(1, 8)
    assert verify_session(session).digest == "confirmed"
    assert not rescue.exists()


def test_what_the_rescue_knows_of_a_file_replaces_what_the_session_knew(split):
    """Both have a row of frame 2, and the rescue's was written last."""
    session, rescue = split
    refused = (2, "preview", None, None, None, "the disk is full", None)
    kept = (2, "preview", "previews/000002.png", 90, 1.5, None, "ab" * 32)
    for folder, row in ((session, refused), (rescue, kept)):
        with closing(connect_to_write(folder / "session.db")) as connection:
            connection.execute(INSERT_FILE, row)
    (merged,) = repair_session(session, T0_UTC_NS).merged
    assert merged.files == 1
    with closing(connect_to_read(session / "session.db")) as connection:
        assert connection.execute(FILE_ROWS).fetchall() == [kept]
    assert not rescue.exists()


def test_a_rescue_whose_row_of_a_file_did_not_arrive_is_kept(split, monkeypatch):
    session, rescue = split
    for folder, reason in ((session, "another"), (rescue, "the disk is full")):
        row = (2, "preview", None, None, None, reason, None)
        with closing(connect_to_write(folder / "session.db")) as connection:
            connection.execute(INSERT_FILE, row)
    monkeypatch.setattr("rsoconsole.session.upkeep.merge._take_file", lambda *_: False)
    assert "cannot be read back" in repair_session(session, T0_UTC_NS).unmerged[rescue]
    assert rescue.exists()


def body_of(folder: Path, seq: int, text: str) -> None:
    with closing(sqlite3.connect(folder / "session.db")) as connection:
        sql = "UPDATE log SET body = replace(body, 'fact', ?) WHERE seq = ?"
        assert connection.execute(sql, (text, seq)).rowcount == 1
        connection.commit()


def test_where_both_have_a_record_and_they_differ_nothing_is_merged(split):
    session, rescue = split
    writer = connect_to_write(session / "session.db")
    with closing(writer), closing(sqlite3.connect(rescue / "session.db")) as source:
        (row,) = source.execute("SELECT * FROM log WHERE seq = 6").fetchall()
        writer.execute("INSERT INTO log VALUES (?, ?, ?, ?, ?)", row)
    body_of(session, 6, "lie")
    before = texts(session)
    done = repair_session(session, T0_UTC_NS)
    assert "record 6 is another one" in done.unmerged[rescue]
    assert texts(session) == before
    assert texts(rescue) == facts(4, 8)


def test_a_log_that_is_not_what_was_closed_is_not_continued(split):
    session, rescue = split
    with closing(connect_to_write(session / "session.db")) as connection:
        mark_closed(connection)
    body_of(session, 2, "lie")
    done = repair_session(session, T0_UTC_NS)
    assert "not the log that was closed" in done.unmerged[rescue]
    assert texts(rescue) == facts(4, 8)


DESTROYED: dict[str, tuple[Callable[[Path], None], str]] = {
    "gone": (shutil.rmtree, "is gone or cannot be read"),
    "without its log": (unlink, "is gone or cannot be read"),
    "written over": (overwrite, "is gone or cannot be read"),
}


@pytest.mark.parametrize("name", DESTROYED)
def test_where_the_session_cannot_take_it_the_rescue_is_kept_and_sound(split, name):
    session, rescue = split
    destroy, words = DESTROYED[name]
    destroy(session)
    done = repair_session(rescue, T0_UTC_NS)
    assert not done.merged
    assert words in done.unmerged[rescue]
    assert texts(rescue) == facts(4, 8)
    assert verify_session(rescue).is_sound


def fail(*_: object) -> None:
    raise SessionError("record 5 cannot be read back")


@pytest.mark.parametrize(
    ("name", "stand_in", "words"),
    [
        ("_expect_all", fail, "cannot be read back"),
        ("is_being_written", lambda _: True, "is being written"),
        ("shutil.disk_usage", lambda _: SimpleNamespace(free=10), "left on its disk"),
    ],
)
def test_the_rescue_is_kept_until_all_of_it_has_been_read_back(
    split, monkeypatch, name, stand_in, words
):
    session, rescue = split
    monkeypatch.setattr(f"rsoconsole.session.upkeep.merge.{name}", stand_in)
    assert words in repair_session(session, T0_UTC_NS).unmerged[rescue]
    assert texts(rescue) == facts(4, 8)
    monkeypatch.undo()
    monkeypatch.setenv("XDG_STATE_HOME", str(rescue.parents[2]))
    assert repair_session(session, T0_UTC_NS).merged
    assert texts(session) == facts(1, 8)


def test_the_list_names_a_rescue_and_whose_it_is(split, tmp_path):
    session, _ = split
    for words in (["list"], []):
        done = CliRunner().invoke(app, ["sessions", *words, "--root", str(session.parent)])
        assert done.exit_code == 0, done.output
        *_, last = done.stdout.splitlines()
        assert f"rescue of {session}" in last
        assert len(done.stdout.splitlines()) == 3
    done = CliRunner().invoke(app, ["sessions", "list", "--root", str(tmp_path), "--json"])
    assert done.stdout == ""
    done = CliRunner().invoke(app, ["sessions", "repair", str(session)])
    assert "5 records" in done.stdout
    assert "the rescue session is removed" in done.stdout
    done = CliRunner().invoke(app, ["sessions", "list", "--root", str(session.parent), "--json"])
    (row,) = [json.loads(line) for line in done.stdout.splitlines()]
    assert row["rescues"] is None
    assert row["records"] == 8


def test_no_empty_folder_stays_where_a_rescue_could_not_be_or_is_needed_no_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    home = tmp_path / "home"
    home.mkdir()
    rescue = RescueSession(tmp_path / "night", {}, b"", lambda: [home / "rescue"])
    monkeypatch.setattr("rsoconsole.session.writing.log_writer.MIN_BYTES", 10**18)
    assert not rescue.begin()
    assert list(home.iterdir()) == []
    monkeypatch.setattr("rsoconsole.session.writing.log_writer.MIN_BYTES", 0)
    assert rescue.begin()
    rescue.discard()
    assert list(home.iterdir()) == []


def test_tests_leave_nothing_in_the_state_folder_of_who_runs_them():
    places = list(rescue_places())
    assert not places[0].is_relative_to(pwd.getpwuid(os.getuid()).pw_dir)
