"""The ledger of uncorrelated tracks: nothing in it is lost, whatever befalls it."""

import fcntl
import json
import multiprocessing
from pathlib import Path

import pytest

from rsoconsole.base import SessionError
from rsoconsole.session import (
    Change,
    Ledger,
    LedgerOrbit,
    LedgerTrack,
    change_ledger,
    damage_words,
    forget_change,
    keep_change,
    read_ledger,
    rename_change,
    withdraw_change,
)
from rsoconsole.session.log import line_file

ORBIT = LedgerOrbit(
    label="constrained by prior",
    prior="slot",
    epoch_utc_ns=1_700_000_000_000_000_000,
    r_gcrs_km=(42_164.0, 0.0, 1.0),
    v_gcrs_km_s=(0.0, 3.0746, 0.0),
    covariance=tuple(tuple(float(a == b) for a in range(6)) for b in range(6)),
    a_km=42_164.1,
    e=2e-4,
    i_deg=0.05,
    sigma_a_km=1.2,
    rms_arcsec=0.7,
)


def track(session: str, track_id: int = 1, orbit: LedgerOrbit | None = ORBIT) -> LedgerTrack:
    return LedgerTrack(
        session=session,
        folder=f"/nights/{session}",
        track_id=track_id,
        latitude_deg=29.19,
        longitude_deg=-81.05,
        elevation_m=10.0,
        t_first_utc_ns=1_700_000_000_000_000_000,
        t_last_utc_ns=1_700_000_600_000_000_000,
        observations=20,
        t_utc_ns=1_700_000_300_000_000_000 + track_id,
        ra_icrs_deg=12.5,
        dec_icrs_deg=-4.75,
        rate_east_arcsec_s=14.98,
        rate_north_arcsec_s=0.01,
        covariance=tuple(tuple(float(a == b) for a in range(4)) for b in range(4)),
        orbit=orbit,
        directions=((-300.0, 11.2, -4.75, 1.0, 0.0, 1.0), (300.0, 13.8, -4.75, 1.0, 0.0, 1.0)),
    )


def add(path: Path, *changes: Change) -> Ledger:
    return change_ledger(lambda _: changes, path)[0]


def next_kept(path: Path, session: str) -> None:
    change_ledger(lambda before: [keep_change(before.next_number, track(session))], path)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "state" / "ledger.jsonl"


def test_what_is_kept_comes_back_as_it_was(path: Path) -> None:
    assert read_ledger(path) == Ledger()
    add(path, keep_change(1, track("monday")), keep_change(2, track("monday", 2, orbit=None)))
    found = read_ledger(path)
    assert [each.number for each in found.objects] == [1, 2]
    assert found.objects[0].tracks == (track("monday"),)
    assert found.objects[1].tracks == (track("monday", 2, orbit=None),)
    assert found.objects[1].called == "UCT 2"
    assert found.number_of_track("monday", 2) == 2


def test_a_track_that_is_kept_again_takes_its_own_place(path: Path) -> None:
    add(path, keep_change(1, track("monday")))
    add(path, keep_change(1, track("monday", orbit=None)), keep_change(1, track("tuesday", 3)))
    (only,) = read_ledger(path).objects
    assert only.tracks == (track("monday", orbit=None), track("tuesday", 3))
    add(path, withdraw_change("tuesday", 3))
    assert read_ledger(path).objects[0].tracks == (track("monday", orbit=None),)


def test_a_number_is_never_given_twice(path: Path) -> None:
    add(path, keep_change(1, track("monday")), keep_change(2, track("monday", 2)))
    add(path, rename_change(1, "the drifter"), forget_change(2))
    found = read_ledger(path)
    assert [each.called for each in found.objects] == ["the drifter"]
    assert found.next_number == 3
    with pytest.raises(SessionError, match="no UCT 2; there are: 1"):
        found.object_by_number(2)


@pytest.mark.parametrize("name", ["x" * 41, "a\nb", "\x1b[31m"])
def test_a_name_that_cannot_be_shown_is_refused(name: str) -> None:
    with pytest.raises(SessionError, match="40 characters"):
        rename_change(1, name)


@pytest.mark.parametrize(
    "damage",
    [
        b'{"did": "kept", "number": 3, "tra',
        b"\x00\xff\xfe garbage",
        b'{"did": "kept", "number": 3, "track": {"session": "x"}}',
        b'{"did": "eaten", "number": 3}',
        b"[" * 100_000,
    ],
)
def test_damage_costs_only_its_own_line_and_the_file_is_moved_aside(
    path: Path, damage: bytes
) -> None:
    add(path, keep_change(1, track("monday")))
    path.write_bytes(path.read_bytes() + damage + b"\n")
    path.write_bytes(
        path.read_bytes() + json.dumps(keep_change(2, track("tuesday"))).encode() + b"\n"
    )
    broken = path.read_bytes()
    found = read_ledger(path)
    assert [each.number for each in found.objects] == [1, 2]
    assert "line 3 cannot be read; all others hold" in damage_words(found.unreadable, path)
    assert path.read_bytes() == broken  # who only reads changes nothing
    after, aside = change_ledger(lambda _: [keep_change(3, track("wednesday"))], path)
    assert aside is not None
    assert aside.read_bytes() == broken
    assert [each.number for each in after.objects] == [1, 2, 3]
    assert read_ledger(path) == after
    assert after.unreadable == ()


def test_numbers_that_are_none_are_damage(path: Path) -> None:
    add(path, keep_change(1, track("monday")))
    path.write_text(path.read_text().replace("12.5", "NaN"))
    assert read_ledger(path).objects == ()
    assert read_ledger(path).unreadable == (2,)


def test_a_line_that_was_cut_off_does_not_swallow_the_next(path: Path) -> None:
    add(path, keep_change(1, track("monday")))
    path.write_bytes(path.read_bytes()[:-40])
    after = add(path, keep_change(2, track("tuesday")))
    assert [each.number for each in after.objects] == [2]
    assert len(list(path.parent.glob("*.damaged-*"))) == 1


def test_a_file_that_is_no_ledger_at_all_is_kept_aside(path: Path) -> None:
    path.parent.mkdir()
    path.write_bytes(bytes(range(256)) * 20)
    whole = path.read_bytes()
    after, aside = change_ledger(lambda _: [keep_change(1, track("monday"))], path)
    assert aside is not None
    assert aside.read_bytes() == whole
    assert [each.number for each in after.objects] == [1]


def test_a_later_versions_ledger_is_left_alone(path: Path) -> None:
    path.parent.mkdir()
    path.write_text('{"did": "begun", "format": 2}\n')
    with pytest.raises(SessionError, match="later rsoconsole"):
        add(path, keep_change(1, track("monday")))
    assert path.read_text() == '{"did": "begun", "format": 2}\n'


def test_two_writers_lose_nothing_of_each_other(path: Path) -> None:
    sessions = [f"night {n}" for n in range(12)]
    with multiprocessing.get_context("fork").Pool(4) as pool:
        pool.starmap(next_kept, [(path, each) for each in sessions], chunksize=1)
    found = read_ledger(path)
    assert [each.number for each in found.objects] == list(range(1, 13))
    assert {each.last.session for each in found.objects} == set(sessions)


def test_a_writer_that_never_ends_is_not_waited_for_forever(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(line_file, "_WAIT_S", 0.2)
    add(path, keep_change(1, track("monday")))
    with path.with_suffix(".lock").open("a") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(SessionError, match="another process"):
            add(path, keep_change(2, track("tuesday")))
    assert len(add(path, keep_change(2, track("tuesday"))).objects) == 2


def test_a_folder_that_takes_no_file_is_said(tmp_path: Path) -> None:
    (tmp_path / "state").write_text("a file where the folder should be")
    with pytest.raises(SessionError, match="cannot be"):
        add(tmp_path / "state" / "ledger.jsonl", keep_change(1, track("monday")))


def test_lines_of_another_shape_are_told_by_their_number_and_cost_no_other(tmp_path: Path) -> None:
    path = tmp_path / "ledger.jsonl"
    odd = ('{"did": "kept", "number": 1, "track": [1]}', '{"did": "kept", "number": 1, "track": 3}')
    huge = f'{{"did": "renamed", "number": 1{"0" * 400}, "name": "x"}}'
    lines = ('{"did": "begun", "format": 1}', *odd, huge)
    path.write_text("\n".join(lines) + "\n", encoding="ascii")
    assert set(read_ledger(path).unreadable) >= {2, 3}
