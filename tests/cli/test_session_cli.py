"""The verb sessions: words for people, JSON for scripts, exits as documented."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result
from typer.testing import CliRunner

from rsoconsole.cli.app import app
from rsoconsole.session import verify_session
from tests.nights.made_up_night import begin
from tests.nights.samples import SAMPLE
from tests.pages.json_page import expect_documented
from tests.rigs.session_rig import cut_off, flip, make


@pytest.fixture
def night(tmp_path: Path) -> Path:
    return make(tmp_path / "root" / "night")


def run(*words: object, code: int = 0) -> Result:
    """The verb with these words; it ends as expected."""
    done = CliRunner().invoke(app, ["sessions", *map(str, words)])
    assert done.exit_code == code, (done.output, done.exception)
    return done


def told(*words: object, code: int = 0) -> list[dict[str, Any]]:
    """What --json prints: one object a line and nothing else."""
    return [json.loads(line) for line in run(*words, "--json", code=code).stdout.splitlines()]


def test_the_list_is_one_line_a_session_and_one_object_with_json(night: Path) -> None:
    root = night.parent
    cut_off(make(root / "later"))
    (root / "broken").mkdir()
    (root / "broken" / "session.db").write_bytes(b"x" * 5000)
    lines = run("--root", root).stdout.splitlines()
    assert lines[0].startswith("begin, UTC")
    assert [line.split()[-1] for line in lines[2:]] == ["later", "night"]
    assert "unreadable  broken: " in lines[1]
    assert " 4 " in lines[3]
    assert "closed" in lines[3]
    assert "cut off" in lines[2]
    broken, later, last = told("--root", root)
    assert set(broken) == set(later) == set(last)
    expect_documented("sessions", last)
    assert (last["schema"], last["session_schema"], last["json_schema"]) == (1, 1, 1)
    assert (later["state"], last["state"], broken["state"]) == ("cut off", "closed", "unreadable")
    assert last["folder"] == str(night)
    assert last["t_first_utc"].endswith("Z")
    assert (last["frames"], last["is_simulated"], last["is_kept"]) == (4, True, False)
    assert 0 < last["followed_share"] < 1
    assert broken["frames"] == 0
    assert broken["followed_share"] is None
    assert "damaged" in broken["fault"]


def test_an_empty_place_is_said_and_is_no_failure(tmp_path: Path) -> None:
    done = run("--root", tmp_path / "nowhere")
    assert done.stdout == ""
    assert "no session is kept in" in done.stderr
    assert told("--root", tmp_path) == []


def test_verify_ends_with_1_where_anything_is_damaged_and_looks_at_all(night: Path) -> None:
    assert "sound, closed" in run("verify", night, SAMPLE).stdout
    shutil.copytree(night, night.parent / "bad")
    flip(night.parent / "bad" / "frames" / "000001.fits.fz")
    cut_off(night)
    bad, missing, cut = told("verify", night.parent / "bad", night.parent / "no", night, code=1)
    assert (bad["is_sound"], cut["is_sound"], cut["state"]) == (False, True, "cut off")
    assert bad["findings"][0]["place"] == "frames/000001.fits.fz"
    assert set(missing) == {"schema", "session", "error"}
    done = run("verify", night.parent / "bad", code=1)
    assert "DAMAGED, closed" in done.stdout
    assert "1 not sound" in done.stderr
    run("verify", night)


def test_of_many_findings_alike_the_first_are_told_and_the_rest_counted(night: Path) -> None:
    for path in (night / "previews").iterdir():
        path.unlink()
    lines = run("verify", night, code=1).stdout.splitlines()
    assert sum("the file is not there" in line for line in lines) == 4
    assert lines[-1].strip() == "damage   and 1 more: the file is not there"
    assert len(told("verify", night, code=1)[0]["findings"]) == 4


def test_repair_says_what_it_did_and_then_that_there_is_nothing_to_do(night: Path) -> None:
    cut_off(night)
    (night / "frames" / "000009.fits.fz.part").write_bytes(b"half")
    (done,) = told("repair", night)
    assert (done["did_anything"], done["closed"], done["adopted"]) == (True, True, [])
    assert done["removed"] == ["frames/000009.fits.fz.part"]
    assert "nothing to do" in run("repair", night).stdout
    live = begin(night.parent / "live")
    assert "its engine lives" in run("repair", night.parent / "live", night, code=1).stderr
    live.close()


def test_repair_names_the_session_that_it_saved_a_damaged_one_into(night: Path) -> None:
    database = night / "session.db"
    database.write_bytes(database.read_bytes()[:-4096])
    (done,) = told("repair", night)
    assert done["recovered"]["folder"] == str(night.resolve()) + ".recovered"
    assert done["recovered"]["is_new"] is True
    assert "are saved already in" in run("repair", night).stdout
    run("verify", str(night) + ".recovered")


def test_archive_and_remove(night: Path, tmp_path: Path) -> None:
    (made,) = told("archive", night, "--out", tmp_path / "usb", "--remove")
    assert made["path"] == str(tmp_path / "usb" / "night.tar")
    assert made["is_removed"] is True
    assert not night.exists()
    assert "read back" not in run("verify", made["path"]).stdout
    assert verify_session(Path(made["path"])).is_sound
    assert "does not exist" in run("archive", night, code=1).stderr


def test_prune_shows_first_and_acts_only_with_yes(night: Path) -> None:
    root = night.parent
    usage = run("prune", "--root", root, code=2)
    assert "say what may go" in usage.stderr
    words = run("prune", "--keep-last", 0, "--root", root).stdout
    assert "nothing is done without --yes" in words
    assert len(list((night / "frames").iterdir())) == 4
    (step,) = told("prune", "--keep-last", 0, "--root", root)
    assert (step["goes"], step["is_done"], step["what"]) == (True, False, "frames")
    assert len(step["files"]) == 4
    run("keep", night, "--why", "first light")
    assert (night / "KEEP").read_text() == "first light\n"
    assert "marked KEEP" in run("prune", "--keep-last", 0, "--root", root, "--yes").stdout
    assert "KEEP" in run("--root", root).stdout
    run("keep", night, "--release")
    (step,) = told("prune", "--keep-last", 0, "--root", root, "--yes")
    assert (step["goes"], step["is_done"]) == (True, True)
    assert list((night / "frames").iterdir()) == []
    assert "were pruned on" in run("verify", night).stdout
    run("prune", "--keep-last", 0, "--what", "all", "--root", root, "--yes")
    assert not night.exists()


def test_options_before_the_verb_are_refused_and_not_passed_over(night: Path) -> None:
    usage = run("--root", night.parent, "prune", "--keep-last", 0, code=2)
    assert "give options behind the verb" in usage.stderr


@pytest.mark.parametrize("verb", ["", "verify", "repair", "archive", "prune", "keep"])
def test_every_verb_explains_itself_with_an_example(verb: str) -> None:
    assert "Example: rsoconsole sessions" in run(*filter(None, [verb]), "--help").stdout
