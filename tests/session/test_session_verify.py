"""Verify finds what is damaged, repair sets right what was cut off and saves what can be saved."""

import os
import random
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rsoconsole.base import SessionError
from rsoconsole.config import Config
from rsoconsole.records import Miss, Missed
from rsoconsole.session import (
    SessionReader,
    SessionWriter,
    archive_session,
    encode,
    list_sessions,
    repair_session,
    verify_session,
)
from rsoconsole.session.files import upkeep_log as upkeep
from rsoconsole.session.log.pages import DatabasePages
from rsoconsole.session.log.schema import SCHEMA_VERSION
from rsoconsole.session.upkeep._recover import recover_session
from tests.nights.samples import SAMPLE
from tests.rigs.session_rig import NOW_UTC_NS, cut_off, damage, flip, make, run_sql


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make(tmp_path_factory.mktemp("made") / "night")


def missed(frame_id: int) -> Miss:
    return Miss(frame_id=frame_id, reason=Missed(kind="not solved", detail="x" * 20))


@pytest.fixture
def night(made: Path, tmp_path: Path) -> Path:
    shutil.copytree(made, tmp_path / "night")
    return tmp_path / "night"


def test_a_night_as_it_was_written_is_sound_to_the_last_byte(night: Path) -> None:
    found = verify_session(night)
    assert (found.state, found.schema, found.digest) == ("closed", SCHEMA_VERSION, "confirmed")
    assert (found.frames, found.files, found.findings) == (4, 12, [])
    size = sum(p.stat().st_size for p in night.rglob("*") if p.suffix in (".fz", ".png"))
    assert found.bytes == size


FAULTS: dict[str, tuple[Callable[[Path], object], str, str]] = {
    "a frame changed": (
        lambda n: flip(n / "frames/000002.fits.fz"),
        "frames/000002.fits.fz",
        "its bytes are not those that were written",
    ),
    "a frame cut": (
        lambda n: os.truncate(n / "frames/000002.fits.fz", 2880),
        "frames/000002.fits.fz",
        "2880 bytes, not the",
    ),
    "a frame gone": (
        lambda n: (n / "frames/000001.fits.fz").unlink(),
        "frames/000001.fits.fz",
        "the file is not there",
    ),
    "a picture changed": (
        lambda n: flip(n / "previews/000003.png"),
        "previews/000003.png",
        "its bytes are not",
    ),
    "a record changed": (
        lambda n: run_sql(n, "UPDATE log SET t_utc_ns = t_utc_ns + 1 WHERE seq = 7"),
        "log",
        "it is not the log that was closed",
    ),
    "a record gone": (
        lambda n: run_sql(n, "DELETE FROM log WHERE seq = 7"),
        "record 7",
        "missing in the order of the log",
    ),
    "the last records gone": (
        lambda n: run_sql(n, "DELETE FROM log WHERE seq > 10"),
        "log",
        "10 records with the digest",
    ),
    "a record that is none": (
        lambda n: run_sql(n, "UPDATE log SET body = '{}' WHERE seq = 7"),
        "record 7",
        "of this session is damaged",
    ),
    "a damaged database": (
        lambda n: flip(n / "session.db", 4096 + 1),
        "session.db",
        "",
    ),
    "half a database": (
        lambda n: os.truncate(n / "session.db", (n / "session.db").stat().st_size // 2),
        "session.db",
        "",
    ),
    "no database": (lambda n: (n / "session.db").write_bytes(b"x" * 9000), "session.db", "damaged"),
}


@pytest.mark.parametrize("fault", FAULTS, ids=str)
def test_each_damage_is_found_where_it_is_with_what_to_do(night: Path, fault: str) -> None:
    spoil, place, what = FAULTS[fault]
    spoil(night)
    found = verify_session(night)
    assert not found.is_sound
    assert any(where == place and what in text for where, text in damage(found)), found.findings
    assert all(each.remedy for each in found.findings)


def test_a_file_without_a_hash_on_record_is_damage(tmp_path: Path) -> None:
    folder = tmp_path / "sample"
    shutil.copytree(SAMPLE, folder)
    run_sql(folder, "UPDATE files SET sha256 = NULL WHERE path = 'previews/000005.png'")
    assert damage(verify_session(folder)) == [("previews/000005.png", "no hash of it is on record")]


def test_what_a_cut_leaves_is_no_damage_and_is_told(night: Path) -> None:
    cut_off(night)
    shutil.copy(night / "frames/000001.fits.fz", night / "frames/000077.fits.fz")
    (night / "frames/000078.fits.fz.part").write_bytes(b"half")
    (night / "notes.txt").write_text("mine")
    found = verify_session(night)
    assert found.is_sound
    assert found.state == "cut off"
    assert [(each.severity, each.place) for each in found.findings] == [
        ("leftover", "session.db"),
        ("leftover", "frames/000077.fits.fz"),
        ("leftover", "frames/000078.fits.fz.part"),
        ("leftover", "notes.txt"),
    ]


def test_a_live_session_is_called_live_and_is_left_alone(tmp_path: Path) -> None:
    writer = SessionWriter.create(tmp_path / "night", Config(), {})
    writer.append(Miss(frame_id=1, reason=Missed(kind="no detection")), 1)
    writer.flush()
    (tmp_path / "night/frames/000001.fits.fz.part").write_bytes(b"on its way")
    found = verify_session(tmp_path / "night")
    assert (found.state, found.findings, found.records) == ("live", [], 1)
    with pytest.raises(SessionError, match="is being written, its engine lives"):
        repair_session(tmp_path / "night", NOW_UTC_NS)
    with pytest.raises(SessionError, match="is live: archive it when it is closed"):
        archive_session(tmp_path / "night", tmp_path, NOW_UTC_NS)
    writer.close()


@pytest.mark.parametrize("mark", ["pid", "boot_id", "start_ticks"])
def test_a_process_number_that_now_is_another_s_does_not_make_a_session_live(
    night: Path, mark: str
) -> None:
    other = {"pid": 2**22 - 1, "boot_id": "of another machine", "start_ticks": 1}[mark]
    cut_off(night)
    writer = SessionWriter.create(night.parent / "mine", Config(), {})
    own = SessionReader(night.parent / "mine").read_meta()["writer"]
    writer.close()
    with closing(sqlite3.connect(night / "session.db")) as connection, connection:
        for value, state in (({**own, mark: other}, "cut off"), (own, "live")):
            sql = "INSERT OR REPLACE INTO meta VALUES ('writer', json(?))"
            connection.execute(sql, (str(value).replace("'", '"'),))
            connection.commit()
            assert verify_session(night).state == state


def test_repair_closes_takes_in_what_is_whole_and_removes_what_is_half(night: Path) -> None:
    records = list(SessionReader(night).records())
    cut_off(night)
    run_sql(night, "DELETE FROM files WHERE frame_id = 4")
    (night / "frames/000078.fits.fz.part").write_bytes(b"half")
    (night / "frames/000079.fits.fz").write_bytes(b"never whole")
    done = repair_session(night, NOW_UTC_NS)
    assert done.closed
    assert done.adopted == [
        "closeups/000004.png",
        "frames/000004.fits.fz",
        "previews/000004.png",
    ]
    assert done.removed == ["frames/000078.fits.fz.part"]
    assert list(done.left) == ["frames/000079.fits.fz"]
    assert list(SessionReader(night).records()) == records
    assert SessionReader(night).frame_path(4) == night / "frames/000004.fits.fz"
    found = verify_session(night)
    assert (found.state, found.digest, found.is_sound) == ("closed", "confirmed", True)
    assert [each.place for each in found.findings] == ["frames/000079.fits.fz"]
    (note,) = upkeep.read_notes(night)
    assert (note["verb"], note["t_utc"]) == ("repair", "2030-03-17T17:46:40.000Z")
    assert note["adopted"] == done.adopted
    before = (night / "session.db").read_bytes()
    assert not repair_session(night, NOW_UTC_NS).did_anything
    assert (night / "session.db").read_bytes() == before


def test_a_sample_that_was_cut_off_is_repaired(tmp_path: Path) -> None:
    folder = tmp_path / "sample"
    shutil.copytree(SAMPLE, folder)
    cut_off(folder)
    run_sql(folder, "DELETE FROM files WHERE frame_id = 9 AND role = 'frame'")
    done = repair_session(folder, NOW_UTC_NS)
    assert (done.closed, done.adopted) == (True, ["frames/000009.fits.fz"])
    found = verify_session(folder)
    assert (found.schema, found.digest, found.is_sound) == (SCHEMA_VERSION, "confirmed", True)


@pytest.mark.parametrize(
    ("pages", "least"),
    [
        ("one leaf", 0.95),
        ("the root of the log", 0.99),
        ("the schema", 0.99),
        ("half the file", 0.3),
    ],
)
def test_a_damaged_database_is_saved_beside_and_left_as_it_is(
    tmp_path: Path, pages: str, least: float
) -> None:
    night = make(tmp_path / "night")
    cut_off(night)
    with closing(sqlite3.connect(night / "session.db")) as connection, connection:
        connection.executemany(
            "INSERT INTO log VALUES (?, 1, 'Miss', ?, ?)",
            [(n, n, encode(missed(n))[2]) for n in range(100, 3000)],
        )
    before = {seq: record for seq, _, record in SessionReader(night).records()}
    content = bytearray((night / "session.db").read_bytes())
    with closing(sqlite3.connect(night / "session.db")) as connection:
        ((root,),) = connection.execute("SELECT rootpage FROM sqlite_master WHERE name = 'log'")
    if pages == "one leaf":
        content[40 * 4096 : 41 * 4096] = random.Random(1).randbytes(4096)
    elif pages == "the root of the log":
        content[(root - 1) * 4096 : root * 4096] = bytes(4096)
    elif pages == "the schema":
        content[:4096] = bytes(4096)
    else:
        del content[len(content) // 2 :]
    (night / "session.db").write_bytes(content)
    files = {p: p.read_bytes() for p in night.rglob("*") if p.is_file()}
    assert not verify_session(night).is_sound
    done = repair_session(night, NOW_UTC_NS)
    saved = done.recovered
    assert saved is not None
    assert {p: p.read_bytes() for p in night.rglob("*") if p.is_file()} == files
    after = {seq: record for seq, _, record in SessionReader(saved.folder).records()}
    assert after.items() <= before.items()
    assert len(after) == saved.records
    assert len(after) >= least * len(before)
    found = verify_session(saved.folder)
    assert (found.state, found.digest) == ("closed", "confirmed")
    assert all(each.severity == "remark" for each in found.findings), found.findings
    reader = SessionReader(saved.folder)
    assert reader.config() == Config()
    assert reader.read_meta()["recovered_from"] == "night"
    assert [reader.frame_path(n) is not None for n in range(1, 6)] == [True] * 4 + [False]
    again = repair_session(night, NOW_UTC_NS)
    assert again.recovered == replace(saved, is_new=False)
    assert not again.did_anything
    assert [each.folder.name for each in list_sessions(tmp_path)] == ["night", "night.recovered"]


def test_what_is_no_session_at_all_is_not_repaired(tmp_path: Path, night: Path) -> None:
    with pytest.raises(SessionError, match=r"holds no session\.db"):
        repair_session(tmp_path, NOW_UTC_NS)
    (night / "session.db").write_bytes(random.Random(2).randbytes(50_000))
    with pytest.raises(SessionError, match="nothing could be saved beside it: no record"):
        repair_session(night, NOW_UTC_NS)
    assert not list(tmp_path.glob("*.recovered*"))


VALUES = st.none() | st.integers(-(2**63), 2**63 - 1) | st.text(max_size=40) | st.binary(max_size=9)
LONG = st.integers(0, 9_000).map(lambda n: "a" * n)


@settings(max_examples=25, deadline=None)
@given(
    rows=st.lists(st.tuples(VALUES, VALUES | st.floats(allow_nan=False), LONG), max_size=12),
    page_bytes=st.sampled_from([512, 1024, 4096, 65536]),
)
def test_pages_say_the_same_rows_as_sqlite(rows, page_bytes: int) -> None:
    with TemporaryDirectory() as name:
        path = Path(name) / "rows.db"
        with closing(sqlite3.connect(path, isolation_level=None)) as connection:
            connection.execute(f"PRAGMA page_size={page_bytes}")
            connection.execute("PRAGMA journal_mode=WAL")
            connection.execute("PRAGMA wal_autocheckpoint=3")
            connection.execute("CREATE TABLE by_id (id INTEGER PRIMARY KEY, a, b, c)")
            connection.execute("CREATE TABLE by_key (k TEXT PRIMARY KEY, a, b, c, d) WITHOUT ROWID")
            for number, row in enumerate(rows):
                key = row[2][:200] + str(number)
                connection.execute("INSERT INTO by_id VALUES (?, ?, ?, ?)", (number - 3, *row))
                connection.execute("INSERT INTO by_key VALUES (?, ?, ?, ?, 1)", (key, *row))
            expected = set(connection.execute("SELECT id, NULL, a, b, c FROM by_id"))
            keyed = set(connection.execute("SELECT k, a, b, c, d FROM by_key"))
            found = list(DatabasePages(path, Path(f"{path}-wal")).rows())
    # Older images of a page stay in the log: what is found is what was put in, once or more.
    assert {(rowid, *fields) for rowid, fields in found if len(fields) == 4} == expected
    assert {fields for rowid, fields in found if rowid is None and len(fields) == 5} == keyed


def test_a_session_whose_meta_lost_its_schema_is_saved_with_it(tmp_path: Path) -> None:
    night = tmp_path / "night"
    shutil.copytree(SAMPLE, night)
    with closing(sqlite3.connect(night / "session.db")) as connection, connection:
        connection.execute("DELETE FROM meta WHERE key = 'schema_version'")
    saved = recover_session(night, 0)
    assert SessionReader(saved.folder).read_meta()["schema_version"] == SCHEMA_VERSION
    before = [record for _, _, record in SessionReader(SAMPLE).records()]
    assert [record for _, _, record in SessionReader(saved.folder).records()] == before


def test_of_another_schema_nothing_is_saved(tmp_path: Path) -> None:
    night = tmp_path / "night"
    shutil.copytree(SAMPLE, night)
    run_sql(night, "UPDATE meta SET value = '7' WHERE key = 'schema_version'")
    with pytest.raises(SessionError, match="another version of rsoconsole"):
        recover_session(night, 0)
    assert not night.with_name("night.recovered").exists()


def test_a_record_without_its_id_is_damage_in_a_session_of_today(tmp_path: Path) -> None:
    night = tmp_path / "night"
    shutil.copytree(SAMPLE, night)
    with closing(sqlite3.connect(night / "session.db")) as connection, connection:
        connection.execute(
            "UPDATE log SET body = json_remove(body, '$.measurement_id')"
            " WHERE seq = (SELECT min(seq) FROM log WHERE kind = 'Measurement')"
        )
    assert any("measurement_id" in fault.what for fault in verify_session(night).findings)
