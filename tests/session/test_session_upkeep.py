"""Archives and pruning lose nothing that was not asked for; the list says what there is."""

import errno
import os
import shutil
import subprocess
import tarfile
from dataclasses import replace
from pathlib import Path

import pytest

from rsoconsole.base import SessionError
from rsoconsole.session import (
    PruningPolicy,
    PruningStep,
    SessionReader,
    archive_session,
    find_cut_off_session,
    list_sessions,
    plan_pruning,
    prune,
    verify_session,
)
from rsoconsole.session.files import upkeep_log as upkeep
from rsoconsole.session.files.session_files import MANIFEST
from rsoconsole.session.log.schema import SCHEMA_VERSION
from rsoconsole.session.upkeep import archive as archive_module
from rsoconsole.session.upkeep.store import finish_removals, list_branch_names
from tests.nights.made_up_night import begin
from tests.rigs.session_rig import NOW_UTC_NS, cut_off, damage, flip, make

DAY_NS = 86_400_000_000_000


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make(tmp_path_factory.mktemp("made") / "night")


@pytest.fixture
def night(made: Path, tmp_path: Path) -> Path:
    shutil.copytree(made, tmp_path / "night")
    return tmp_path / "night"


def test_an_archive_is_the_session_read_back_and_the_session_again_when_unpacked(
    night: Path, tmp_path: Path
) -> None:
    begin(night / "branches" / "narrow", branch_of="../..").close()
    before = {p: p.read_bytes() for p in night.rglob("*") if p.is_file()}
    made = archive_session(night, tmp_path / "out", NOW_UTC_NS)
    assert made.path == tmp_path / "out" / "night.tar"
    assert {p: p.read_bytes() for p in night.rglob("*") if p.is_file()} == before
    assert [p.name for p in made.path.parent.iterdir()] == ["night.tar"]
    found = verify_session(made.path)
    assert (found.state, found.digest, found.files, found.findings) == (
        "closed",
        "confirmed",
        12,
        [],
    )
    subprocess.run(["tar", "xf", "night.tar"], cwd=made.path.parent, check=True)
    unpacked = made.path.parent / "night"
    subprocess.run(
        ["sha256sum", "--check", "--strict", "--quiet", "MANIFEST.sha256"], cwd=unpacked, check=True
    )
    assert verify_session(unpacked).findings == []
    assert list(SessionReader(unpacked).records()) == list(SessionReader(night).records())
    assert list_branch_names(unpacked) == ("narrow",)
    assert [note["verb"] for note in upkeep.read_notes(unpacked)] == ["archive"]


def test_the_original_goes_only_when_the_archive_has_been_read_back(
    night: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    packed = archive_module._pack

    def pack_and_spoil(name, beside, sources, told) -> None:
        packed(name, beside, sources, told)
        flip(beside, beside.stat().st_size // 2)

    monkeypatch.setattr(archive_module, "_pack", pack_and_spoil)
    with pytest.raises(SessionError, match=r"is not what was packed|no whole archive"):
        archive_session(night, tmp_path / "out", NOW_UTC_NS, remove=True)
    assert verify_session(night).findings == []
    assert list((tmp_path / "out").iterdir()) == []
    monkeypatch.setattr(archive_module, "_pack", packed)
    assert archive_session(night, tmp_path / "out", NOW_UTC_NS, remove=True).is_removed
    assert not night.exists()
    assert not list(tmp_path.glob(".removed*"))
    assert verify_session(tmp_path / "out" / "night.tar").is_sound


def test_a_disk_that_fills_leaves_no_half_archive(
    night: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(archive_module, "_add", full)
    with pytest.raises(SessionError, match=r"No space left.*free some disk"):
        archive_session(night, tmp_path / "out", NOW_UTC_NS, remove=True)
    assert list((tmp_path / "out").iterdir()) == []
    assert verify_session(night).findings == []
    monkeypatch.setattr(archive_module, "ROOM", 1e12)
    with pytest.raises(SessionError, match="GB are needed"):
        archive_session(night, tmp_path / "out", NOW_UTC_NS)


def test_what_is_damaged_or_cut_off_or_there_already_is_not_archived(
    night: Path, tmp_path: Path
) -> None:
    archive_session(night, tmp_path, NOW_UTC_NS)
    with pytest.raises(SessionError, match="is there already"):
        archive_session(night, tmp_path, NOW_UTC_NS)
    cut_off(night)
    with pytest.raises(SessionError, match=r"is cut off.*repair' closes it"):
        archive_session(night, tmp_path / "out", NOW_UTC_NS)
    flip(night / "previews/000001.png")
    with pytest.raises(SessionError, match=r"is damaged \(previews/000001.png"):
        archive_session(night, tmp_path / "out", NOW_UTC_NS)


def is_sound_or_none(path: Path) -> bool:
    """Whether it is a whole archive and sound."""
    try:
        return verify_session(path).is_sound
    except SessionError:
        return False


@pytest.mark.parametrize("place", [0.3, 0.6, "between two files"])
def test_an_archive_that_was_spoilt_or_cut_is_not_sound(
    night: Path, tmp_path: Path, place: float | str
) -> None:
    path = archive_session(night, tmp_path, NOW_UTC_NS).path
    whole = path.read_bytes()
    with tarfile.open(path) as tar:
        frame = tar.getmember("night/frames/000003.fits.fz")
        seam = tar.getmember(f"night/{MANIFEST}").offset
    flip(path, frame.offset_data + 3000)
    assert [where for where, _ in damage(verify_session(path))] == ["frames/000003.fits.fz"]
    path.write_bytes(whole[: seam if isinstance(place, str) else int(len(whole) * place)])
    assert not is_sound_or_none(path)
    path.write_bytes(b"not a tar at all")
    with pytest.raises(SessionError, match="no whole archive"):
        verify_session(path)


@pytest.fixture
def nights(made: Path, tmp_path: Path) -> Path:
    """Six nights, 1 to 6 days old as their files say; their clocks stood still."""
    root = tmp_path / "root"
    for age_days in range(1, 7):
        folder = root / f"age{age_days}"
        shutil.copytree(made, folder)
        written_ns = NOW_UTC_NS - age_days * DAY_NS
        os.utime(folder / "session.db", ns=(written_ns, written_ns))
    return root


def going(steps: tuple[PruningStep, ...]) -> list[str]:
    return [step.session.name for step in steps if step.goes]


@pytest.mark.parametrize(
    ("policy", "names"),
    [
        (PruningPolicy(keep_days=3.5), ["age6", "age5", "age4"]),
        (PruningPolicy(keep_last=4), ["age6", "age5"]),
        (PruningPolicy(keep_last=4, keep_days=5.5), ["age6"]),
        (PruningPolicy(keep_last=0), ["age6", "age5", "age4", "age3", "age2", "age1"]),
        (PruningPolicy(keep_last=9), []),
        (PruningPolicy(free_bytes=0), []),
        (PruningPolicy(free_bytes=10**18, keep_last=4), ["age6", "age5"]),
    ],
)
def test_a_policy_names_the_oldest_that_every_rule_lets_go(nights, policy, names) -> None:
    before = sorted(nights.rglob("*"))
    steps = plan_pruning(nights, policy, NOW_UTC_NS)
    assert going(steps) == names
    assert [step.session.name for step in steps] == [f"age{n}" for n in range(6, 0, -1)]
    assert all(step.why for step in steps)
    assert sorted(nights.rglob("*")) == before


def test_no_more_goes_than_it_takes_until_so_much_is_free(nights, monkeypatch) -> None:
    monkeypatch.setattr("rsoconsole.session.upkeep.store._free_bytes", lambda _root: 1_000_000)
    (one,) = plan_pruning(nights, PruningPolicy(keep_last=5), NOW_UTC_NS)[:1]
    for wanted, number in ((1, 1), (one.bytes, 1), (one.bytes + 1, 2), (10**9, 6)):
        policy = PruningPolicy(free_bytes=1_000_000 + wanted)
        assert len(going(plan_pruning(nights, policy, NOW_UTC_NS))) == number


def test_what_is_kept_live_cut_off_damaged_or_branched_from_is_never_touched(nights) -> None:
    upkeep.protect_from_pruning(nights / "age6", "first light")
    cut_off(nights / "age5")
    (nights / "age4" / "session.db").write_bytes(b"x" * 5000)
    begin(nights / "age3" / "branches" / "narrow", branch_of="../..").close()
    live = begin(nights / "live")
    policy = PruningPolicy(keep_last=0, what="all")
    steps = plan_pruning(nights, policy, NOW_UTC_NS)
    assert sorted(going(steps)) == ["age1", "age2"]
    why = {step.session.name: step.why for step in steps}
    assert why["age6"] == "marked KEEP"
    assert why["age5"] == "cut off: repair it first"
    assert "cannot be read" in why["age4"]
    assert why["age3"] == "a branch stands on it (narrow)"
    assert why["live"] == "live"
    with_branches = replace(policy, with_branches=True)
    assert "age3" in going(plan_pruning(nights, with_branches, NOW_UTC_NS))
    prune(steps, policy, NOW_UTC_NS)
    live.close()
    assert sorted(p.name for p in nights.iterdir()) == ["age3", "age4", "age5", "age6", "live"]
    upkeep.allow_pruning(nights / "age6")
    assert "age6" in going(plan_pruning(nights, policy, NOW_UTC_NS))


def test_pruned_frames_are_on_record_and_the_log_stays(nights) -> None:
    policy = PruningPolicy(keep_last=5)
    records = list(SessionReader(nights / "age6").records())
    database = (nights / "age6" / "session.db").read_bytes()
    prune(plan_pruning(nights, policy, NOW_UTC_NS), policy, NOW_UTC_NS)
    folder = nights / "age6"
    assert list((folder / "frames").iterdir()) == []
    assert len(list((folder / "previews").iterdir())) == 4
    assert (folder / "session.db").read_bytes() == database
    assert list(SessionReader(folder).records()) == records
    assert SessionReader(folder).frame_path(1) is None
    found = verify_session(folder)
    assert found.is_sound
    assert [each.what for each in found.findings] == ["4 were pruned on 2030-03-17T17:46:40.000Z"]
    assert going(plan_pruning(nights, policy, NOW_UTC_NS)) == []
    # What goes missing by itself is still damage.
    (folder / "previews" / "000001.png").unlink()
    assert damage(verify_session(folder)) == [("previews/000001.png", "the file is not there")]
    assert archive_session(nights / "age5", nights, NOW_UTC_NS).files > 0


def test_pruning_that_is_cut_after_its_note_is_finished_the_next_time(nights, monkeypatch) -> None:
    policy = PruningPolicy(keep_last=5)
    steps = plan_pruning(nights, policy, NOW_UTC_NS)
    unlink, gone = Path.unlink, []

    def unlink_two(path: Path, missing_ok: bool = False) -> None:
        if path.suffix == ".fz" and len(gone) == 2:
            raise OSError(errno.EIO, "the power went")
        gone.append(path)
        unlink(path, missing_ok=missing_ok)

    monkeypatch.setattr(Path, "unlink", unlink_two)
    with pytest.raises(SessionError, match="prune again"):
        prune(steps, policy, NOW_UTC_NS)
    monkeypatch.undo()
    assert verify_session(nights / "age6").is_sound
    again = plan_pruning(nights, policy, NOW_UTC_NS)
    assert len(again[0].files) == 2
    prune(again, policy, NOW_UTC_NS)
    assert verify_session(nights / "age6").is_sound
    assert list((nights / "age6" / "frames").iterdir()) == []


def test_a_removal_that_was_cut_is_no_session_any_more_and_is_swept(nights) -> None:
    (nights / "age6").rename(nights / ".removed-age6")
    assert len(list_sessions(nights)) == 5
    finish_removals(nights)
    assert not (nights / ".removed-age6").exists()


def test_the_list_says_what_a_night_was_and_what_became_of_it(nights) -> None:
    upkeep.protect_from_pruning(nights / "age1", "")
    begin(nights / "age2" / "branches" / "wide", branch_of="../..").close()
    first, second, *_ = list_sessions(nights)
    assert (first.frames, first.state, first.is_kept, first.schema) == (
        4,
        "closed",
        True,
        SCHEMA_VERSION,
    )
    # Of four frames two were empty, a track begins with its second measurement.
    tracked = {row["frame_id"] for row in SessionReader(nights / "age1").view_rows("track")}
    assert first.followed_frames == len(tracked) > 0
    assert first.followed_share == len(tracked) / 4
    assert first.duration_s == pytest.approx(120.0, abs=35.0)
    assert (second.branches, second.is_kept) == (("wide",), False)


def test_the_newest_session_whose_engine_did_not_close_it_is_what_the_next_one_continues(
    night: Path, tmp_path: Path
) -> None:
    assert find_cut_off_session(tmp_path / "nowhere", is_simulated=True) is None
    assert find_cut_off_session(tmp_path, is_simulated=True) is None
    left = tmp_path / "left"
    shutil.copytree(night, left)
    cut_off(left)

    def written_at(folder: Path, seconds: int) -> None:
        os.utime(folder / "session.db", (seconds, seconds))

    written_at(night, 1000)
    written_at(left, 2000)
    assert find_cut_off_session(tmp_path, is_simulated=True) == left
    assert find_cut_off_session(tmp_path, is_simulated=False) is None
    # A later one was closed.
    written_at(night, 3000)
    assert find_cut_off_session(tmp_path, is_simulated=True) is None
