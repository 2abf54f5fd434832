"""The sample session as one of the user's own: from an installation, into the user's folder."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from rsoconsole.base import SessionError, resources
from rsoconsole.cli.app import app
from rsoconsole.session import (
    SessionReader,
    get_or_copy_sample_session,
    list_sessions,
    verify_session,
)
from rsoconsole.session.upkeep.store import SAMPLE_NAME
from tests.nights.samples import SAMPLE


def test_it_is_copied_once_whole_and_can_be_written(tmp_path: Path) -> None:
    root = tmp_path / "sessions"
    folder = get_or_copy_sample_session(root)
    assert folder == root / SAMPLE_NAME
    assert SessionReader(folder).counts() == SessionReader(SAMPLE).counts()
    assert verify_session(folder).state == "closed"
    # Of most frames the pixels were pruned before it was shipped.
    assert {each.severity for each in verify_session(folder).findings} == {"remark"}
    assert [path.name for path in root.iterdir()] == [SAMPLE_NAME]
    assert [each.folder for each in list_sessions(root)] == [folder]
    (folder / "mine.txt").write_text("kept")
    assert get_or_copy_sample_session(root) == folder
    assert (folder / "mine.txt").exists()


def test_that_of_a_wheel_which_nobody_may_write_is_the_user_s_afterwards(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import shutil

    package = tmp_path / "site-packages" / "rsoconsole"
    shutil.copytree(SAMPLE, package / "_sessions" / "intelsat-14")
    for path in package.rglob("*"):
        path.chmod(0o555 if path.is_dir() else 0o444)
    monkeypatch.setattr(resources, "_PACKAGE", package)
    folder = get_or_copy_sample_session(tmp_path / "sessions")
    assert all(path.stat().st_mode & 0o200 for path in (folder, *folder.rglob("*")))
    for path in package.rglob("*"):
        path.chmod(0o755 if path.is_dir() else 0o644)


def test_a_folder_that_takes_nothing_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SessionError, match=r"set session\.root"):
        get_or_copy_sample_session(tmp_path / "file")


def test_review_opens_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[object] = []
    monkeypatch.setattr(
        "rsoconsole.console.run_review", lambda session, **_: opened.append(session)
    )
    config = tmp_path / "config.toml"
    config.write_text(f'[session]\nroot = "{tmp_path / "nights"}"\n')
    monkeypatch.setenv("RSOCONSOLE_CONFIG", str(config))
    done = CliRunner().invoke(app, ["review", "--sample"])
    assert done.exit_code == 0, done.output
    assert opened == [tmp_path / "nights" / SAMPLE_NAME]
    done = CliRunner().invoke(app, ["review", str(SAMPLE), "--sample"])
    assert done.exit_code == 2
    assert len(opened) == 1
