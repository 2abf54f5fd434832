"""Views, hashes and digests of sessions, branches and their files, other schemas."""

import hashlib
import json
import shutil
import sqlite3
import subprocess
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsoconsole.base import SessionError
from rsoconsole.config import Config
from rsoconsole.records import Frame, Miss, Missed
from rsoconsole.session import (
    SessionReader,
    SessionWriter,
    list_sessions,
    repair_session,
    verify_session,
)
from rsoconsole.session.files.digest import LogDigest, digest_rows
from rsoconsole.session.log.schema import SCHEMA_VERSION, VIEWS
from tests.nights.made_up_night import add_frames, add_previews, armed, begin
from tests.nights.samples import SAMPLE

README = Path(__file__).parents[2] / "sessions" / "README.md"


@pytest.fixture
def night(tmp_path: Path) -> Path:
    """Six frames with pictures, one with its pixels; closed."""
    writer = begin(tmp_path / "night")
    armed(writer)
    add_frames(writer, range(1, 7))
    add_previews(writer, range(1, 7))
    writer.save_frame(Frame(frame_id=3, name="", pixels=np.full((64, 64), 7, np.uint16)))
    writer.close()
    assert writer.faults == ()
    return tmp_path / "night"


def test_a_reader_of_sql_cannot_write(night: Path) -> None:
    with (
        closing(SessionReader(night).connect()) as connection,
        pytest.raises(sqlite3.OperationalError, match="readonly"),
    ):
        connection.execute("DELETE FROM log")


def test_the_views_of_the_file_are_what_the_reader_gives(night: Path) -> None:
    reader = SessionReader(night)
    with closing(reader.connect()) as connection:
        connection.row_factory = sqlite3.Row
        for name in VIEWS:
            rows = connection.execute(f"SELECT * FROM {name} ORDER BY seq").fetchall()
            assert [dict(row) for row in rows] == reader.view_rows(name)


def test_reading_a_session_changes_no_byte_of_it(tmp_path: Path) -> None:
    folder = tmp_path / "sample"
    shutil.copytree(SAMPLE, folder)
    before = {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    reader = SessionReader(folder)
    for name in VIEWS:
        reader.view_rows(name)
    assert {p.name: p.read_bytes() for p in folder.rglob("*") if p.is_file()} == before


def test_every_file_carries_the_hash_of_its_bytes(night: Path) -> None:
    with closing(SessionReader(night).connect()) as connection:
        rows = connection.execute("SELECT path, bytes, sha256 FROM files").fetchall()
    assert len(rows) == 13
    for path, size, sha256 in rows:
        content = (night / path).read_bytes()
        assert (len(content), hashlib.sha256(content).hexdigest()) == (size, sha256)
    (kept,) = [row for row in SessionReader(night).view_rows("frames") if row["file"]]
    assert kept["file_sha256"] == hashlib.sha256((night / kept["file"]).read_bytes()).hexdigest()


def test_a_closed_session_carries_the_digest_of_its_log(night: Path) -> None:
    reader = SessionReader(night)
    with closing(reader.connect()) as connection:
        rows = connection.execute("SELECT seq, t_utc_ns, kind, frame_id, body FROM log").fetchall()
    # As the documentation defines it, by hand.
    lines = [f"{s}|{t}|{k}|{'' if f is None else f}|{b}\n" for s, t, k, f, b in sorted(rows)]
    expected = hashlib.sha256("".join(lines).encode()).hexdigest()
    assert reader.read_meta()["log_digest"] == {"sha256": expected, "records": len(rows)}


@pytest.mark.skipif(shutil.which("sqlite3") is None, reason="sqlite3's shell is not installed")
def test_the_documented_commands_give_the_same_digest_and_hashes(night: Path) -> None:
    blocks = README.read_text(encoding="utf-8").split("```sh\n")[1:]
    by_hand = next(block.split("```")[0] for block in blocks if "log_digest" in block)
    done = subprocess.run(
        ["sh", "-eu", "-c", by_hand], cwd=night, capture_output=True, text=True, check=True
    )
    said = done.stdout.splitlines()
    digest = SessionReader(night).read_meta()["log_digest"]["sha256"]
    assert json.loads(said[0])["sha256"] == digest
    assert said[1].split() == [digest, "-"]
    assert len(said) == 2 + 13
    assert all(line.endswith(": OK") for line in said[2:])


ROWS = st.tuples(
    st.integers(0, 2**63 - 1),
    st.sampled_from(["Miss", "Event"]),
    st.none() | st.integers(0, 10**6),
    st.text(st.characters(codec="utf-8", exclude_characters="\n\0"), max_size=20),
)


@given(st.lists(ROWS, max_size=5), st.lists(ROWS, max_size=5))
def test_logs_that_differ_have_digests_that_differ(one, other) -> None:
    digests = [
        digest_rows((seq, *row) for seq, row in enumerate(rows, start=1)) for rows in (one, other)
    ]
    assert (digests[0] == digests[1]) == (one == other)
    assert LogDigest.from_meta({"log_digest": json.loads(digests[0].to_json())}) == digests[0]


def test_a_session_that_is_not_closed_has_no_digest(tmp_path: Path) -> None:
    writer = SessionWriter.create(tmp_path / "night", Config(), {})
    writer.append(Miss(frame_id=1, reason=Missed(kind="no detection")), 1)
    writer.flush()
    assert "log_digest" not in SessionReader(tmp_path / "night").read_meta()
    writer.close()


def test_a_branch_shows_the_files_of_its_session_and_its_own_before_them(night: Path) -> None:
    branch = night / "branches" / "narrow"
    writer = begin(branch, branch_of="../..", changes={"filter.q": 0.1})
    add_frames(writer, range(1, 7))
    writer.save_preview(2, np.zeros((4, 5), np.uint8))
    writer.close()
    reader = SessionReader(branch)
    assert reader.original_folder == night.resolve()
    assert reader.frame_path(3) == night.resolve() / "frames" / "000003.fits.fz"
    assert reader.frame_path(4) is None
    assert reader.closeup_path(1) == night.resolve() / "closeups" / "000001.png"
    assert reader.preview_path(1) == night.resolve() / "previews" / "000001.png"
    assert reader.preview_path(2) == branch / "previews" / "000002.png"
    assert SessionReader(night).original_folder is None


@pytest.mark.parametrize("origin", [".", "nowhere", "../../../..", "/", "", 7, "../ring"])
def test_a_branch_of_nothing_or_of_itself_has_no_files_and_no_trouble(
    tmp_path: Path, origin: object
) -> None:
    for name, of in (("branch", origin), ("ring", "../branch")):
        begin(tmp_path / name, branch_of=of).close()
    assert SessionReader(tmp_path / "branch").frame_path(1) is None
    assert SessionReader(tmp_path / "ring").preview_path(1) is None


@pytest.mark.parametrize("path", ["../secret", "/etc/hostname", "frames/../../secret"])
def test_a_row_never_leads_out_of_the_session(night: Path, path: str) -> None:
    (night.parent / "secret").write_text("no")
    with closing(sqlite3.connect(night / "session.db")) as connection, connection:
        connection.execute("UPDATE files SET path = ? WHERE role = 'frame'", (path,))
    assert SessionReader(night).frame_path(3) is None


def test_a_medium_that_cannot_be_written_shows_a_session_that_was_cut_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    live, medium = tmp_path / "live", tmp_path / "medium"
    writer = SessionWriter.create(live, Config(), {})
    writer.append(Miss(frame_id=1, reason=Missed(kind="not solved", detail="cloud")), 1)
    assert writer.flush()
    shutil.copytree(live, medium, ignore=shutil.ignore_patterns("*-shm"))
    writer.close()
    # Rights do not bind root: SQLite is refused its index file by a folder in that file's place.
    (medium / "session.db-shm").mkdir()
    monkeypatch.setattr("os.access", lambda *_: False)
    reader = SessionReader(medium)
    assert [record for _, _, record in reader.records()] == [
        Miss(frame_id=1, reason=Missed(kind="not solved", detail="cloud"))
    ]
    assert sorted(p.name for p in medium.iterdir() if p.is_file()) == [
        "config.toml",
        "session.db",
        "session.db-wal",
    ]


@pytest.mark.parametrize("schema", [0, SCHEMA_VERSION + 1])
def test_another_schema_is_refused_with_what_to_do(night: Path, schema: int) -> None:
    with closing(sqlite3.connect(night / "session.db")) as connection:
        connection.execute(f"PRAGMA user_version={schema}")
    for refuses in (SessionReader, verify_session, lambda folder: repair_session(folder, 1)):
        with pytest.raises(SessionError, match=r"another version of rsoconsole.*(that one|update)"):
            refuses(night)
    (listed,) = list_sessions(night.parent)
    assert "another version" in (listed.fault or "")
    assert listed.state == "other version"
