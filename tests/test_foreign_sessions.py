"""Sessions from strangers: links that lead out, a damaged word about itself, views without end."""

import shutil
import sqlite3
import tarfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from rsoconsole.errors import SessionError
from rsoconsole.session.archive import archive_session
from rsoconsole.session.reader import SessionReader
from rsoconsole.session.repair import repair_session
from rsoconsole.session.store import cut_off_session, list_sessions
from rsoconsole.session.verify import verify_session

SAMPLE = Path(__file__).resolve().parents[1] / "sessions" / "intelsat-14"
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


@pytest.mark.parametrize("value", ["{", "x", '"\\ud800', "[" * 100_000])
def test_a_damaged_word_about_itself_breaks_no_listing_and_no_start(foreign, value):
    shutil.copytree(SAMPLE, foreign.with_name("good"))
    with closing(sqlite3.connect(foreign / "session.db")) as connection:
        connection.execute("UPDATE meta SET value = ? WHERE key = 'title'", (value,))
        connection.commit()
    listed = {each.folder.name: each.fault for each in list_sessions(foreign.parent)}
    assert listed["good"] is None
    assert "table meta" in (listed["foreign"] or "")
    assert cut_off_session(foreign.parent, is_simulated=True) is None


VIEWS: dict[str, str] = {
    "log": f"{ENDLESS} i AS seq, i AS t_utc_ns, 'Event' AS kind, NULL AS frame_id, '{{}}' AS body",
    "meta": f"{ENDLESS} 'k'||i AS key, '1' AS value",
    "files": f"{ENDLESS} i AS frame_id, 'frame' AS role, 'x' AS path, 1 AS bytes, 1.0 AS ms,"
    " NULL AS reason, NULL AS sha256",
}
READS: dict[str, Callable[[Path], object]] = {
    "about": lambda folder: SessionReader(folder).about(),
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
