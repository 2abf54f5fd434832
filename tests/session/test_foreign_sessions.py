"""Sessions from strangers: links that lead out, a damaged word about itself, views without end."""

import shutil
import sqlite3
import tarfile
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from rsoconsole.base import SessionError
from rsoconsole.pipeline import replay
from rsoconsole.records import Event
from rsoconsole.session import (
    SessionReader,
    archive_session,
    find_cut_off_session,
    list_sessions,
    repair_session,
    verify_session,
)
from rsoconsole.session.log import database as bounds
from rsoconsole.session.log.database import is_query_limit_error
from rsoconsole.session.log.schema import VIEWS as VIEWS_OF_TODAY

SAMPLE = Path(__file__).resolve().parents[2] / "sessions" / "intelsat-14"
MAX_S = 10.0
NOW_NS = 1_700_000_000_000_000_000
ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i+1 FROM n) SELECT "


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    folder = tmp_path / "sessions" / "foreign"
    shutil.copytree(SAMPLE, folder)
    return folder


def sql(folder: Path, *statements: str) -> None:
    with closing(sqlite3.connect(folder / "session.db")) as connection:
        for each in statements:
            connection.executescript(each)
        connection.commit()


def test_repair_removes_nothing_behind_a_link(foreign, tmp_path):
    mine = tmp_path / "victim" / "mine.part"
    mine.parent.mkdir()
    mine.write_text("precious")
    (foreign / "frames2").symlink_to(mine.parent)
    (foreign / "left.part").write_text("half")
    sql(foreign, "UPDATE meta SET value = 'false' WHERE key = 'is_closed'")
    done = repair_session(foreign, NOW_NS)
    assert mine.read_text() == "precious"
    assert done.removed == ["left.part"]


def test_an_archive_holds_nothing_that_a_link_points_at(foreign, tmp_path):
    (foreign / "stolen").symlink_to("/etc")
    (foreign / "previews" / "secret").symlink_to("/etc/hostname")
    made = archive_session(foreign, tmp_path / "out", NOW_NS)
    with tarfile.open(made.path) as tar:
        names = tar.getnames()
    assert not [name for name in names if "stolen" in name or "secret" in name]


def test_a_schema_that_is_no_text_any_more_is_damage_and_what_it_holds_is_saved(foreign):
    """SQLite's message quotes the bytes: Python fails to decode it."""
    database = foreign / "session.db"
    content = database.read_bytes()
    name, words = b"detectionsdetections", b"CREATE VIEW detections"
    assert name + words in content
    database.write_bytes(content.replace(name + words, b"\xa1" + name[1:] + b"?" + words[1:]))
    with pytest.raises(SessionError, match="schema"):
        SessionReader(foreign).read_meta()
    assert not verify_session(foreign).is_sound
    assert [session.folder for session in list_sessions(foreign.parent)] == [foreign]
    recovered = repair_session(foreign, NOW_NS).recovered
    assert recovered is not None
    assert recovered.records == SessionReader(SAMPLE).counts().records


NOWHERE = "[[314.2, -4.8], [314.1, 1e300]]"


@pytest.mark.parametrize(
    ("kind", "place"),
    [
        ("Measurement", "$.ends_icrs_deg"),
        ("NotFollowed", "$.measurement.ends_icrs_deg"),
        ("Ruling", "$.taken.ends_icrs_deg"),
    ],
)
def test_a_streak_that_ends_nowhere_is_damage_and_breaks_no_replay(foreign, kind, place):
    sql(
        foreign,
        f"UPDATE log SET body = json_set(body, '{place}', json('{NOWHERE}')) WHERE kind = '{kind}'"
        f" AND json_type(body, '{place}') = 'array'",
    )
    reader = SessionReader(foreign)
    records = [record for _, _, record in reader.records()]
    said = [record.text for record in records if isinstance(record, Event)]
    assert any(f"a {kind} of this session is damaged" in text for text in said)
    assert list(replay(records, reader.config()))


@pytest.mark.parametrize("value", ["{", "x", '"\\ud800', "[" * 100_000])
def test_a_damaged_word_about_itself_breaks_no_listing_and_no_start(foreign, value):
    shutil.copytree(SAMPLE, foreign.with_name("good"))
    with closing(sqlite3.connect(foreign / "session.db")) as connection:
        connection.execute("UPDATE meta SET value = ? WHERE key = 'title'", (value,))
        connection.commit()
    listed = {each.folder.name: each.fault for each in list_sessions(foreign.parent)}
    assert listed["good"] is None
    assert "table meta" in (listed["foreign"] or "")
    assert find_cut_off_session(foreign.parent, is_simulated=True) is None


VIEWS: dict[str, str] = {
    "log": f"{ENDLESS} i AS seq, i AS t_utc_ns, 'Event' AS kind, NULL AS frame_id, '{{}}' AS body",
    "meta": f"{ENDLESS} 'k'||i AS key, '1' AS value",
    "files": f"{ENDLESS} i AS frame_id, 'frame' AS role, 'x' AS path, 1 AS bytes, 1.0 AS ms,"
    " NULL AS reason, NULL AS sha256",
}
READS: dict[str, Callable[[Path], object]] = {
    "about": lambda folder: SessionReader(folder).read_meta(),
    "counts": lambda folder: SessionReader(folder).counts(),
    "records": lambda folder: list(SessionReader(folder).records()),
    "frame": lambda folder: SessionReader(folder).frame_path(1),
}


@pytest.mark.parametrize("read", READS)
@pytest.mark.parametrize("name", VIEWS)
def test_a_view_in_place_of_a_table_is_refused_at_once(foreign, name, read):
    sql(foreign, f"DROP TABLE {name}; CREATE VIEW {name} AS {VIEWS[name]} FROM n;")
    with pytest.raises(SessionError, match=f"{name} is no table"):
        READS[read](foreign)


def test_a_name_in_capitals_is_the_same_name(foreign):
    sql(foreign, f"DROP TABLE log; CREATE VIEW LOG AS {VIEWS['log']} FROM n;")
    with pytest.raises(SessionError, match="LOG is no table"):
        SessionReader(foreign).counts()


@pytest.mark.parametrize("name", VIEWS)
def test_verifying_one_comes_to_an_end(foreign, name):
    sql(foreign, f"DROP TABLE {name}; CREATE VIEW {name} AS {VIEWS[name]} FROM n;")
    try:
        found = verify_session(foreign)
    except SessionError:
        return
    assert not found.is_sound


COMPUTED: dict[str, tuple[str, ...]] = {
    "a trigger": (
        "UPDATE meta SET value = 'false' WHERE key = 'is_closed'",
        "CREATE TRIGGER t AFTER UPDATE ON meta BEGIN DELETE FROM log; END",
    ),
    "a generated column": (
        "ALTER TABLE files ADD COLUMN x AS (hex(zeroblob(50000000)))",
        "UPDATE meta SET value = 'false' WHERE key = 'is_closed'",
    ),
    "an index of an expression": ("CREATE INDEX i ON log (hex(zeroblob(10)))",),
    "a partial index": ("CREATE INDEX i ON log (seq) WHERE seq > 3",),
    "a check": (
        "ALTER TABLE files RENAME TO f",
        "CREATE TABLE files (frame_id, role, path, bytes, ms, reason, sha256 CHECK (sha256 > ''))",
        "INSERT INTO files SELECT * FROM f WHERE sha256 > ''",
    ),
    "a virtual table": (
        "DROP TABLE files",
        "CREATE VIRTUAL TABLE files USING fts5(frame_id, role, path, bytes, ms, reason, sha256)",
    ),
}


@pytest.mark.parametrize("name", COMPUTED)
def test_a_database_that_computes_is_refused_and_its_records_are_saved(foreign, name):
    records = SessionReader(foreign).counts().records
    sql(foreign, *(f"{each};" for each in COMPUTED[name]))
    began_s = time.monotonic()
    with pytest.raises(SessionError, match="is no session of this program"):
        SessionReader(foreign)
    assert not verify_session(foreign).is_sound
    saved = repair_session(foreign, NOW_NS).recovered
    assert saved is not None
    assert SessionReader(saved.folder).counts().records == records
    assert verify_session(saved.folder).is_sound
    with closing(sqlite3.connect(foreign / "session.db")) as connection:
        assert connection.execute("SELECT count(*) FROM log").fetchone() == (records,)
    assert time.monotonic() - began_s < MAX_S


def test_a_query_without_end_is_ended(foreign):
    began_s = time.monotonic()
    with closing(SessionReader(foreign).connect()) as connection:
        with pytest.raises(sqlite3.OperationalError, match="interrupted") as error:
            connection.execute(f"{ENDLESS} count(*) FROM n").fetchall()
        assert is_query_limit_error(error.value)
    assert time.monotonic() - began_s < MAX_S


def test_reading_that_does_not_end_is_said_so(foreign, monkeypatch):
    monkeypatch.setattr(bounds, "MIN_CALLS", 0)
    monkeypatch.setattr(bounds, "STEPS_A_CALL", 10)
    monkeypatch.setattr(bounds, "BYTES_A_CALL", 10**9)
    with pytest.raises(SessionError, match="does not come to an end"):
        SessionReader(foreign).counts()


def test_what_the_program_asks_of_a_session_takes_a_hundredth_of_what_it_may(foreign):
    size = (foreign / "session.db").stat().st_size
    steps = 0

    def count() -> int:
        nonlocal steps
        steps += 100
        return 0

    for name in VIEWS_OF_TODAY:
        with closing(SessionReader(foreign).connect()) as connection:
            connection.set_progress_handler(count, 100)
            connection.execute(f"SELECT * FROM {name}").fetchall()
    assert steps
    assert steps < 0.01 * len(VIEWS_OF_TODAY) * size * bounds.STEPS_A_CALL / bounds.BYTES_A_CALL


@pytest.mark.parametrize("size", [70_000_000, 300_000_000])
def test_a_record_that_no_session_has_is_damage_and_the_others_are_saved(foreign, size):
    records = SessionReader(foreign).counts().records
    with closing(sqlite3.connect(foreign / "session.db")) as connection:
        values = (99999, NOW_NS, "Event", None)
        connection.execute("INSERT INTO log VALUES (?, ?, ?, ?, zeroblob(?))", (*values, size))
        connection.commit()
    began_s = time.monotonic()
    with pytest.raises(SessionError, match="damaged"):
        list(SessionReader(foreign).records())
    assert not verify_session(foreign).is_sound
    saved = repair_session(foreign, NOW_NS).recovered
    assert saved is None or SessionReader(saved.folder).counts().records == records
    assert time.monotonic() - began_s < MAX_S


@pytest.mark.parametrize(
    "path", [b"\x00\xff", 7, "", ".", "frames", "a\0b", "/etc/passwd", "../x", "frames/../../x"]
)
def test_a_row_that_names_no_file_of_the_session_names_none(foreign, path):
    with closing(sqlite3.connect(foreign / "session.db")) as connection:
        connection.execute("UPDATE files SET path = ?", (path,))
        connection.commit()
    reader = SessionReader(foreign)
    for place in (reader.frame_path(9), reader.preview_path(9), reader.closeup_path(9)):
        assert place is None
    reader.missing_pixels_reason(9)
    assert not verify_session(foreign).is_sound


def test_a_frame_behind_a_link_is_none_of_the_session(foreign, tmp_path):
    assert SessionReader(foreign).frame_path(9) is not None
    (foreign / "frames").rename(tmp_path / "elsewhere")
    (foreign / "frames").symlink_to(tmp_path / "elsewhere")
    assert SessionReader(foreign).frame_path(9) is None
