"""What a recorded night would have been: figures, the log retold, branches, and the verb."""

import dataclasses
import itertools
import json
import shutil
import tracemalloc
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner, Result

from rsoconsole.base import ConfigError, SessionError
from rsoconsole.cli.app import app
from rsoconsole.config import Config
from rsoconsole.pipeline import (
    SessionLogCache,
    branches_of,
    drop_branch,
    replay,
    save_branch,
    what_if_session,
)
from rsoconsole.pipeline.replays import branches as branches_module
from rsoconsole.pipeline.replays.what_if_log import rewritten_log, track_figures
from rsoconsole.records import (
    Detections,
    FollowedAgain,
    Measurement,
    Miss,
    ParameterChange,
    Ruling,
    SlewCommand,
    StateChange,
    TrackState,
)
from rsoconsole.session import SessionReader, decode, encode
from tests.nights.made_up_night import begin
from tests.nights.measured_night import record_night
from tests.nights.samples import SAMPLE
from tests.pages.json_page import expect_documented
from tests.pipeline.test_replay import CONFIG, Night, busy_night
from tests.rigs.rewritten import rewrite_log
from tests.tiers import plain_first

__all__ = ["busy_night"]  # a fixture that is asked for by name


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sixty frames of a satellite in one noise; two missed."""
    folder = tmp_path_factory.mktemp("night") / "sixty"
    return record_night(folder, frames=60, seed=3, missed=frozenset({20, 21}))


@pytest.fixture
def mine(session: Path, tmp_path: Path) -> Path:
    """A copy that a test may write beside."""
    return Path(shutil.copytree(session, tmp_path / "mine"))


def log_of(folder: Path) -> list[tuple[int, Any]]:
    return [(t_utc_ns, record) for _, t_utc_ns, record in SessionReader(folder).records()]


def bytes_in(folder: Path) -> dict[str, bytes]:
    """Every file of a session but for its branches."""
    files = (p for p in folder.rglob("*") if p.is_file() and "branches" not in p.parts)
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


# -- figures ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["sample", "sixty"])
def test_with_the_recorded_settings_every_record_comes_again_bit_for_bit(session, name):
    folder = SAMPLE if name == "sample" else session
    found = what_if_session(folder)
    assert found.is_reproduced
    assert found.what_if == found.recorded
    assert list(found.log) == log_of(folder)


def test_the_figures_say_how_the_night_went(session):
    figures = what_if_session(session).recorded
    assert figures.frames == 60
    assert (figures.locked_after_frames, figures.locked_after_s) == (2, 30.0)
    assert figures.misses == 2
    assert figures.lock_held == pytest.approx(56 / 58)
    assert figures.updates == 56
    assert figures.losses == 0
    assert figures.states == {"ACQUIRE": 1, "TRACK": 57, "COAST": 2}
    east, north = figures.residual_east_rms_arcsec, figures.residual_north_rms_arcsec
    assert figures.residual_rms_arcsec == pytest.approx((east**2 + north**2) ** 0.5)
    assert 0.4 < east < 0.8  # measured to 0.4 arcsec
    assert figures.nis_band[0] < figures.nis_mean < figures.nis_band[1]
    assert 0.01 < figures.max_3sigma_arcmin < 1.0


def test_a_night_that_was_lost_says_so(session):
    """Coasting for longer than it may ends a track; what is found again locks again."""
    found = what_if_session(session, {"filter.max_coast_s": 45.0})
    assert found.recorded.losses == 0
    assert found.what_if.losses == 1
    assert found.what_if.states["LOST"] == 1
    assert found.what_if.lock_held < found.recorded.lock_held


def test_nothing_followed_has_no_figures_and_no_nan():
    figures = track_figures([])
    assert (figures.locked_after_frames, figures.lock_held) == (None, None)
    assert (figures.residual_east_rms_arcsec, figures.max_3sigma_arcmin) == (None, None)
    assert figures.states == {}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"filter.sigma": 1.0}, "did you mean"),
        ({"filter.q_multiplier": -1.0}, "must be above 0"),
        ({"mount.type": "fork"}, "no part in what is followed"),
        ({"detector.map_mode": "paper"}, "--detector"),
        ({"solver.radius_deg": 5.0}, "--solver"),
        ({"filter.sigma_arcsec": 2.0}, "belongs to preset paper"),
        ({"filter.q_arcsec2_s3": 1e-6, "filter.preset": "paper"}, "belongs to preset tuned"),
    ],
)
def test_what_cannot_be_tried_is_refused_with_the_reason(session, changes, words):
    with pytest.raises(ConfigError, match=words):
        what_if_session(session, changes)


def test_a_folder_without_a_session_or_without_frames_is_an_error(tmp_path):
    with pytest.raises(SessionError, match="does not exist"):
        what_if_session(tmp_path / "none")
    writer = begin(tmp_path / "empty")
    writer.close()
    with pytest.raises(SessionError, match="no frame that was followed"):
        what_if_session(writer.folder)


def test_a_night_that_is_not_kept_gives_the_same_figures_and_the_same_branch(mine):
    changes = {"filter.r_multiplier": 4.0, "detector.tau": 0.5}
    kept, alone = what_if_session(mine, changes), what_if_session(mine, changes, keep=False)
    assert (alone.frames, alone.log, alone.is_kept) == ((), (), False)
    blank = {"frames": (), "log": (), "is_kept": False}
    assert dataclasses.replace(kept, **blank) == alone
    one, other = save_branch(kept, "kept"), save_branch(alone, "alone")
    assert log_of(one) == log_of(other) == list(kept.log)


@pytest.mark.nightly("measures memory")
def test_of_a_night_that_is_not_kept_little_is_in_memory(tmp_path):
    """A frame takes some 10 kB with its records, and less than 2 kB without."""
    short = record_night(tmp_path / "short", frames=100, seed=3)
    long = record_night(tmp_path / "long", frames=400, seed=3)
    what_if_session(short)  # what is loaded once does not count

    def bytes_a_frame(keep: bool) -> float:
        peaks = []
        for folder in (short, long):
            tracemalloc.start()
            found = what_if_session(folder, keep=keep)
            peaks.append(tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
            assert found.what_if == found.recorded
        return (peaks[1] - peaks[0]) / 300

    assert bytes_a_frame(keep=True) > 8000
    assert bytes_a_frame(keep=False) < 2000


def test_frames_that_were_reduced_again_are_not_reduced_a_second_time_unasked():
    found = what_if_session(SAMPLE, detector=True, keep=False)
    with pytest.raises(ValueError, match="must be kept"):
        list(rewritten_log(found))


@pytest.mark.parametrize("most_kept", [0, 7, 10_000])
def test_the_log_that_is_asked_of_again_and_again_is_the_same_however_much_is_kept(mine, most_kept):
    records, log = [r for _, r in log_of(mine)], SessionLogCache(most_kept)
    for until in (None, 5, 50, None, 3):
        wanted = records if until is None else records[:until]
        assert list(log.records_until(mine, until)) == wanted
    assert list(log.records_until(SAMPLE, 4)) == [r for _, r in log_of(SAMPLE)][:4]


# -- the log retold ---------------------------------------------------------------------------


@pytest.mark.slow("makes the night that its file retells")
def test_a_busy_night_retold_with_nothing_tried_is_itself(busy_night):
    log = [(n, record) for n, record in enumerate(busy_night.records)]
    assert list(rewrite_log(log, CONFIG).log) == log


def retold(night: Night, **changes: Any) -> tuple[list[Any], Config, list[Any]]:
    log = [(n, record) for n, record in enumerate(night.records)]
    found = rewrite_log(
        log, CONFIG, changes={name.replace("__", "."): v for name, v in changes.items()}
    )
    return [record for _, record in found.log], found.config, list(found.frames)


TRIALS: list[dict[str, Any]] = [
    {"filter__r_multiplier": 9.0},
    {"filter__preset": "paper"},
    {"filter__gate_nis": 0.3},
    {"detector__tau": 0.8},
    {"detector__tau": 0.95},
    {"search__follow": "most confident"},
    {"exposure__header_latency_s": 0.25},
    {"filter__max_coast_s": 20.0, "filter__q_multiplier": 100.0},
]


@pytest.mark.parametrize("changes", plain_first(3, TRIALS), ids=str)
def test_a_retold_night_replays_into_itself_bit_for_bit(busy_night, changes):
    """Misses, clouds, moves by hand, STOP, limits, faults and changed settings between them."""
    records, config, frames = retold(busy_night, **changes)
    again = list(replay([decode(*encode(r)[::2]) for r in records], config))
    assert all(frame.is_as_recorded for frame in again)
    assert [frame.records for frame in again] == [frame.records for frame in frames]
    assert [frame.after for frame in again] == [frame.after for frame in frames]


def test_only_the_folds_records_and_what_is_tried_are_other_than_recorded(busy_night):
    records, _, _ = retold(busy_night, filter__r_multiplier=9.0)
    kinds = (Detections, Measurement, SlewCommand)
    for kind in kinds:
        assert [r for r in records if isinstance(r, kind)] == busy_night.of(kind)
    assert [r for r in records if isinstance(r, TrackState)] != busy_night.of(TrackState)
    changes = [r.name for r in records if isinstance(r, ParameterChange)]
    assert changes == [c.name for c in busy_night.of(ParameterChange) if "r_mult" not in c.name]
    assert any("r_multiplier was set" in getattr(r, "text", "") for r in records)


def test_the_states_of_a_retold_night_follow_one_another(busy_night):
    records, _, _ = retold(busy_night, detector__tau=0.95)
    changes = [r for r in records if isinstance(r, StateChange)]
    assert changes
    for before, after in itertools.pairwise(changes):
        assert before.after == after.before


def test_what_another_tau_leaves_out_can_be_let_in_again(busy_night):
    """Nothing is lost by a branch: what lay below its tau is among its candidates."""
    records, config, _ = retold(busy_night, detector__tau=0.8)
    back = list(replay(records, config, changes={"detector.tau": 0.1}))
    plain = list(replay(busy_night.records, CONFIG, changes={"detector.tau": 0.1}))
    assert [len(f.observations.detections.detections) for f in back] == [
        len(f.observations.detections.detections) for f in plain
    ]


@given(
    changes=st.fixed_dictionaries(
        {},
        optional={
            "filter.q_multiplier": st.floats(1e-3, 1e3),
            "filter.r_multiplier": st.floats(1e-3, 1e3),
            "filter.gate_nis": st.floats(0.1, 50.0),
            "filter.preset": st.sampled_from(["tuned", "paper"]),
            "detector.tau": st.floats(0.05, 0.95),
        },
    )
)
@settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck))
def test_whatever_is_tried_the_retold_log_replays_into_itself(session, changes):
    found = rewrite_log(log_of(session), SessionReader(session).config(), changes=changes)
    again = list(replay((record for _, record in found.log), found.config))
    assert [frame.records for frame in again] == [frame.records for frame in found.frames]
    assert all(frame.is_as_recorded for frame in again)


def test_the_operators_word_has_its_frames_followed_again_in_the_retold_night(session):
    """He refuses what frame 30 gave; the ruling and all it leads to are told again."""
    config = SessionReader(session).config()
    log = log_of(session)
    ruled = ruled_log(log, config, 30)
    assert list(rewrite_log(ruled, config).log) == ruled
    found = rewrite_log(ruled, config, changes={"filter.r_multiplier": 4.0})
    told = [record for _, record in found.log]
    assert sum(isinstance(record, FollowedAgain) for record in told) == 3
    again = list(replay(told, found.config))
    assert all(frame.is_as_recorded for frame in again)
    assert [frame.after for frame in again] == [frame.after for frame in found.frames]


def ruled_log(log: list[tuple[int, Any]], config: Config, frame_id: int) -> list[tuple[int, Any]]:
    """The log to two frames after one, and the operator's refusal of that one."""
    from rsoconsole.pipeline.cycle.decisions import decision_records
    from rsoconsole.pipeline.replays.refold import ReplayState

    until = next(
        n for n, (_, record) in enumerate(log) if getattr(record, "frame_id", 0) == frame_id + 3
    )
    walk = ReplayState.begin(config)
    taken = None
    for _, record in log[:until]:
        list(walk.receive(record))
        if isinstance(record, Measurement) and record.frame_id == frame_id:
            taken = record
    assert taken is not None
    decision = Ruling(frame_id=frame_id, refused=(taken,))
    again = [(each.frame_id, each.records) for each in walk.folds.apply(decision)]
    t_utc_ns = log[until - 1][0]
    return [*log[:until], *((t_utc_ns, r) for r in decision_records(decision, again))]


# -- branches ---------------------------------------------------------------------------------


def test_a_branch_is_a_session_that_replays_into_itself_and_the_record_stays(mine):
    before = bytes_in(mine)
    changes = {"filter.r_multiplier": 4.0, "detector.tau": 0.5}
    found = what_if_session(mine, changes)
    folder = save_branch(found, "calmer")
    assert folder == mine / "branches" / "calmer"
    assert bytes_in(mine) == before
    reader = SessionReader(folder)
    about = reader.read_meta()
    assert about["branch_of"] == "../.."
    assert about["tried"] == changes
    assert about["is_closed"] is True
    assert about["figures"]["what_if"]["updates"] == found.what_if.updates
    assert reader.config() == found.config
    assert log_of(folder) == list(found.log)
    again = tuple(replay((record for _, record in log_of(folder)), reader.config()))
    assert all(frame.is_as_recorded for frame in again)
    assert [frame.records for frame in again] == [frame.records for frame in found.frames]
    assert what_if_session(folder).recorded == found.what_if


def test_a_name_that_is_taken_is_refused_and_replaced_only_by_force(mine):
    first = what_if_session(mine, {"filter.r_multiplier": 4.0})
    save_branch(first, "one")
    second = what_if_session(mine, {"filter.r_multiplier": 9.0})
    with pytest.raises(SessionError, match="--force"):
        save_branch(second, "one")
    assert branches_of(mine)[0].changes == first.changes
    save_branch(second, "one", force=True)
    (branch,) = branches_of(mine)
    assert branch.changes == second.changes
    assert branch.t_made_utc_ns is not None
    assert sorted(p.name for p in (mine / "branches").iterdir()) == ["one"]


@pytest.mark.parametrize(
    "name", ["", ".", "..", "../x", "a/b", "a b", ".hidden", "figures", "exports", "ü", "x" * 65]
)
def test_names_that_cannot_be_a_branchs_are_refused(mine, name):
    with pytest.raises(SessionError):
        save_branch(what_if_session(mine), name)
    assert branches_of(mine) == ()


def test_a_branch_is_whole_or_not_there(mine, monkeypatch):
    found = what_if_session(mine)
    save_branch(found, "old")

    def broken(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(branches_module, "replace_folder", broken)
    for name, force in (("new", False), ("old", True)):
        with pytest.raises(SessionError, match="No space left"):
            save_branch(found, name, force=force)
    assert [p.name for p in (mine / "branches").iterdir()] == ["old"]
    assert log_of(mine / "branches" / "old") == list(found.log)


def test_a_disk_that_takes_less_than_the_whole_log_leaves_no_branch(mine):
    found = what_if_session(mine)
    unwritable = dataclasses.replace(found, log=(*found.log, (0, Miss(frame_id=1, reason=b""))))
    with pytest.raises(SessionError, match="cannot be written"):
        save_branch(unwritable, "half")
    assert branches_of(mine) == ()
    assert list((mine / "branches").iterdir()) == []


def test_branches_are_listed_and_dropped(mine):
    found = what_if_session(mine, {"filter.q_multiplier": 2.0})
    for name in ("b", "a.1"):
        save_branch(found, name)
    (mine / "branches" / "figures").mkdir()
    assert [branch.name for branch in branches_of(mine)] == ["a.1", "b"]
    drop_branch(mine, "b")
    assert [branch.name for branch in branches_of(mine)] == ["a.1"]
    with pytest.raises(SessionError, match=r"has no branch 'b'; it has: a\.1"):
        drop_branch(mine, "b")
    with pytest.raises(SessionError):
        drop_branch(mine, "..")
    assert SessionReader(mine).counts().frames == 60


# -- frames reduced again ----------------------------------------------------------------------


def test_detector_and_solver_run_again_over_what_was_kept_and_say_of_how_much(tmp_path):
    """The sample has kept two of its frames; with the recorded settings it shows the same."""
    seen: list[int] = []
    found = what_if_session(SAMPLE, detector=True, solver=True, on_frame=lambda: seen.append(1))
    assert found.rerun is not None
    assert (found.rerun.rerun, found.rerun.not_kept, found.rerun.unreadable) == (2, 34, 0)
    assert len(seen) == 36
    recorded = [r for _, r in log_of(SAMPLE) if isinstance(r, Measurement)]
    again = [r for _, r in found.log if isinstance(r, Measurement)]
    assert len(again) == len(recorded)
    for one, other in zip(recorded, again, strict=True):
        half_an_arcsec = 0.5 / 3600
        assert other.ra_icrs_deg == pytest.approx(one.ra_icrs_deg, abs=half_an_arcsec)
        assert other.dec_icrs_deg == pytest.approx(one.dec_icrs_deg, abs=half_an_arcsec)
        assert (other == one) or one.frame_id in {9, 11}


def test_another_detector_is_tried_with_the_recorded_plate_where_the_solver_is_not():
    """Centroid box: the paper's midpoint, whose ends are not known."""
    found = what_if_session(SAMPLE, {"detector.centroid": "box"}, detector=True)
    assert found.rerun is not None
    assert found.rerun.rerun == 2
    ninth = next(frame for frame in found.frames if frame.taken.frame_id == 9)
    eighth = next(frame for frame in found.frames if frame.taken.frame_id == 8)
    (measured,) = ninth.observations.measurements
    assert measured.ends_icrs_deg is None
    assert eighth.observations.measurements[0].ends_icrs_deg is not None
    records = [record for _, record in log_of(SAMPLE)]
    as_it_was = replay(records, SessionReader(SAMPLE).config())
    recorded = next(frame for frame in as_it_was if frame.taken.frame_id == 9)
    assert ninth.observations.solution == recorded.observations.solution


# -- the verb ---------------------------------------------------------------------------------


def verb(*arguments: str | Path) -> Result:
    """The verb in this process; what it refuses is in ``exception``."""
    return CliRunner().invoke(app, ["what-if", *map(str, arguments)])


def test_the_verb_prints_both_nights_as_json(mine):
    run = verb(mine, "--q", "4", "--set", "filter.r_multiplier", "0.8", "--json")
    assert run.exit_code == 0
    (answer,) = [json.loads(line) for line in run.stdout.splitlines()]
    expect_documented("what-if", answer)
    assert answer["changes"] == {"filter.q_multiplier": 4.0, "filter.r_multiplier": 0.8}
    assert answer["before"] == {"filter.q_multiplier": 1.0, "filter.r_multiplier": 1.0}
    assert answer["is_reproduced"] is True
    assert answer["recorded"]["updates"] == 56
    assert answer["what_if"]["nis_mean"] != answer["recorded"]["nis_mean"]
    assert answer["branch"] is None


def test_the_verb_keeps_lists_and_drops_branches(mine):
    run = verb(mine, "--r", "4", "--save", "calm")
    assert run.exit_code == 0
    assert "filter.r_multiplier: 1 → 4" in run.stdout
    assert all(len(line) <= 80 for line in run.stdout.splitlines()[1:-1])
    taken = verb(mine, "--r", "9", "--save", "calm")
    assert (taken.exit_code, taken.stdout) == (1, "")
    assert "--force" in taken.stderr
    listed = json.loads(verb(mine, "--list", "--json").stdout)
    expect_documented("what-if --list", listed)
    assert (listed["name"], listed["changes"]) == ("calm", {"filter.r_multiplier": 4.0})
    assert verb(mine, "--drop", "calm").exit_code == 0
    assert verb(mine, "--list").stdout == ""


def test_wrong_usage_is_exit_2(mine):
    for arguments in ((), (mine, "--list", "--propose"), (mine, "--set", "filter.q_multiplier")):
        assert verb(*arguments).exit_code == 2


def test_a_session_that_cannot_be_read_is_told_and_the_others_go_on(mine, tmp_path):
    run = verb(mine, tmp_path / "none", "--q", "2", "--json")
    assert run.exit_code == 1
    fine, broken = map(json.loads, run.stdout.splitlines())
    assert fine["what_if"]["frames"] == 60
    assert set(broken) == {"schema", "session", "error"}
    assert "Traceback" not in run.stderr


def test_help_teaches():
    run = verb("--help")
    assert run.exit_code == 0
    assert "Example" in run.stdout
