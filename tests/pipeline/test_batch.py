"""Nights made into sessions: by one process, by several, by Dask, after an interruption."""

import json
import os
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from astropy.io import fits
from click.testing import Result
from typer.testing import CliRunner

from rsoconsole.base import BatchError
from rsoconsole.cli.app import app
from rsoconsole.config import Config
from rsoconsole.pipeline import NightOutcome, WorkerPool, choose_pool, nights_of_folders, run_tasks
from rsoconsole.pipeline.batch import batch_nights
from rsoconsole.pipeline.batch.batch_nights import lock_batch_folder, process_nights
from rsoconsole.records import Event
from rsoconsole.session import SessionReader, encode
from tests.cli.test_cli_frames import objects, rsoconsole
from tests.nights.samples import SAMPLE, SESSIONS

HEIGHT, WIDTH = 480, 640
NAMES = ("2023-06-22", "2023-06-23", "2023-06-24")
SERIAL = WorkerPool(kind="serial", workers=1)
needs_dask = pytest.mark.skipif(find_spec("distributed") is None, reason="Dask is not installed")


def write_night(folder: Path, seed: int, frames: int = 3) -> Path:
    """A streak of 118 px that drifts, in noise; no stars, so that nothing is solved."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    for k in range(frames):
        pixels = rng.normal(1000.0, 20.0, (HEIGHT, WIDTH))
        along = np.clip(np.minimum(x - 120.0 - 40.0 * k, 238.0 + 40.0 * k - x), -0.5, 0.5) + 0.5
        pixels += 400.0 * along * np.exp(-0.5 * ((y - 200.0 - seed) / 1.1) ** 2)
        header = fits.Header({"DATE-OBS": f"2023-06-22T05:3{k}:00", "EXPTIME": 10.0})
        # Of one length, and out of order for who sorts letters alone.
        path = folder / f"frame_{k + 9}.fits"
        fits.writeto(path, pixels.astype(np.uint16), header)
    return folder


def same_root(path: Path) -> Path:
    """Settings for a process with another home: where sessions go is among those on record."""
    path.write_text(f"[session]\nroot = '{Config().session.root}'\n", encoding="utf-8")
    return path


def printed(*arguments: str | Path) -> Result:
    """What the program prints, run in this process."""
    return CliRunner().invoke(app, [str(each) for each in arguments])


@pytest.fixture(scope="module")
def nights(tmp_path_factory) -> list[Path]:
    root = tmp_path_factory.mktemp("nights")
    return [write_night(root / name, seed) for seed, name in enumerate(NAMES)]


@pytest.fixture(scope="module")
def serial_root(nights, tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("serial")
    outcomes = made(nights, root)
    assert [outcome.state for outcome in outcomes] == ["done"] * 3, outcomes
    return root


def made(
    folders: list[Path], root: Path, pool: WorkerPool = SERIAL, **more: Any
) -> list[NightOutcome]:
    tasks = nights_of_folders(folders, root, Config(), **more)
    return list(process_nights(tasks, lambda _: pool))


def without_times(value: Any) -> Any:
    """A record's JSON but for how long things took."""
    if isinstance(value, dict):
        return {k: without_times(v) for k, v in value.items() if k not in ("ms", "stage_ms")}
    return [without_times(v) for v in value] if isinstance(value, list) else value


def told(session: Path) -> list[tuple[int, int, str, Any]]:
    """All that a session says, but for how long things took."""
    rows = []
    for seq, t_utc_ns, record in SessionReader(session).records():
        kind, _, body = encode(record)
        rows.append((seq, t_utc_ns, kind, without_times(json.loads(body))))
    return rows


def same_sessions(one: Path, other: Path) -> bool:
    for name in NAMES:
        assert told(one / name) == told(other / name)
        about = [SessionReader(root / name).read_meta() for root in (one, other)]
        for facts in about:
            # Who wrote it; and its digest, which is over the times too.
            assert facts.pop("writer")["pid"]
            assert facts.pop("log_digest")["records"]
        assert about[0] == about[1]
    return True


# -- the same no matter who does it --------------------------------------------------------------


def test_each_folder_becomes_a_session_in_the_order_of_its_frames(nights, serial_root):
    for name in NAMES:
        reader = SessionReader(serial_root / name)
        assert reader.read_meta()["is_closed"] is True
        assert reader.read_meta()["title"] == name
        rows = reader.view_rows("frames")
        assert [row["name"] for row in rows] == [f"frame_{k}.fits" for k in (9, 10, 11)]
        assert [row["frame_id"] for row in rows] == [1, 2, 3]
        assert len(reader.view_rows("detections")) == 3, "or the comparison says little"


def test_processes_make_what_one_after_another_makes(nights, serial_root, tmp_path):
    outcomes = made(nights, tmp_path, WorkerPool(kind="processes", workers=2))
    assert [outcome.session.name for outcome in outcomes] == list(NAMES)
    assert same_sessions(serial_root, tmp_path)


@needs_dask
@pytest.mark.nightly("starts a Dask cluster")
def test_dask_makes_what_one_after_another_makes(nights, serial_root, tmp_path):
    """By the command itself: on Dask where it is installed."""
    config = same_root(tmp_path / "config.toml")
    root = tmp_path / "out"
    run = rsoconsole(
        "process", *nights, "--session", root, "--config", config, "--workers", "2", "--json"
    )
    assert run.returncode == 0, run.stderr
    assert [Path(answer["night"]).name for answer in objects(run)] == list(NAMES)
    assert {answer["outcome"] for answer in objects(run)} == {"done"}
    assert run.stderr == ""
    assert same_sessions(serial_root, root)


def test_who_does_the_work(monkeypatch):
    assert choose_pool(1).kind == "serial"
    assert choose_pool(3, is_serial=True).kind == "serial"
    assert choose_pool(3, workers=2, is_dask_wanted=False) == WorkerPool(
        kind="processes", workers=2
    )
    assert choose_pool(2, workers=8, is_dask_wanted=False).workers == 2
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    assert choose_pool(3, workers=2).kind == "processes"
    with pytest.raises(BatchError, match="needs Dask"):
        choose_pool(3, scheduler="tcp://127.0.0.1:1")


@needs_dask
def test_a_scheduler_that_is_not_there_is_said(nights, tmp_path):
    run = printed(
        "process", *nights, "--session", tmp_path, "--scheduler", "nonsense://here", "--json"
    )
    assert isinstance(run.exception, BatchError)
    assert "no Dask scheduler answers at nonsense://here" in str(run.exception)


def _double(number: int) -> int:
    if number == 13:
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * number


@pytest.mark.slow("a pool of processes is started again")
def test_a_worker_that_is_killed_costs_its_own_task_alone():
    tasks = [1, 13, 3, 4]
    results = run_tasks(
        _double,
        tasks,
        WorkerPool(kind="processes", workers=2),
        failed=lambda task, reason: (task, reason),
    )
    first, killed, *others = list(results)
    assert (first, others) == (2, [6, 8])
    assert killed[0] == 13
    assert "died" in killed[1]


def test_news_of_an_orbit_is_no_fault_of_a_frame(tmp_path):
    (outcome,) = made([SESSIONS / "frames"], tmp_path)
    said = [record.text for _, _, record in SessionReader(outcome.session).records(kinds=(Event,))]
    assert any(text.startswith("orbit: ") for text in said), "a night that tells an orbit"
    assert (outcome.error, outcome.unreadable) == (None, ())
    assert outcome.locked_after_frames == 2
    (again,) = made([SESSIONS / "frames"], tmp_path)
    assert (again.state, again.unreadable) == ("skipped", ())


# -- what goes wrong --------------------------------------------------------------------------


def test_a_bad_night_is_told_and_the_others_go_on(nights, tmp_path):
    empty, broken = tmp_path / "in" / "empty", tmp_path / "in" / "broken"
    empty.mkdir(parents=True)
    broken.mkdir()
    (broken / "a.fits").write_bytes(b"no frame")
    some = write_night(tmp_path / "in" / "some", 5, frames=2)
    (some / "frame_12.fits").write_bytes(b"SIMPLE  = nothing more")
    root = tmp_path / "out"
    run = printed(
        "process", nights[0], empty, broken, some, "--session", root, "--serial", "--json"
    )
    assert run.exit_code == 1
    assert "Traceback" not in run.stderr
    answers = {
        Path(answer["night"]).name: answer for answer in map(json.loads, run.stdout.splitlines())
    }
    assert list(answers) == [NAMES[0], "empty", "broken", "some"]
    assert [a["outcome"] for a in answers.values()] == ["done", "failed", "failed", "done"]
    assert "holds no frame" in answers["empty"]["error"]
    assert "none of its 1 frames can be used" in answers["broken"]["error"]
    assert (answers["some"]["frames"], len(answers["some"]["unreadable"])) == (2, 1)
    assert sorted(p.name for p in root.iterdir() if p.is_dir()) == [NAMES[0], "some"]


def test_nothing_that_a_batch_did_not_make_is_written_over(nights, serial_root, tmp_path):
    root = tmp_path / "sessions"
    run = printed("process", *sorted(nights[0].iterdir()), "--session", root / NAMES[0])
    assert run.exit_code == 0
    before = told(root / NAMES[0])
    (root / NAMES[1]).mkdir()
    for is_again in (False, True):
        outcomes = made(nights[:2], root, is_again=is_again)
        assert [outcome.state for outcome in outcomes] == ["failed", "failed"]
        assert "no batch has made" in str(outcomes[0].error)
    assert told(root / NAMES[0]) == before


def test_two_nights_of_one_name_and_two_batches_in_one_folder_are_refused(nights, tmp_path):
    other = write_night(tmp_path / "elsewhere" / NAMES[0], 1)
    with pytest.raises(BatchError, match="two nights"):
        nights_of_folders([nights[0], other], tmp_path, Config())
    with (
        lock_batch_folder(tmp_path / "out"),
        pytest.raises(BatchError, match="another batch"),
        lock_batch_folder(tmp_path / "out"),
    ):
        pytest.fail("both work there")


def test_a_folder_needs_a_place_for_its_session(nights):
    assert printed("process", nights[0]).exit_code == 2


# -- what is done is not done again -----------------------------------------------------------


def test_nights_that_are_done_are_skipped_until_something_differs(nights, tmp_path, monkeypatch):
    root = tmp_path / "out"
    mine = write_night(tmp_path / "mine", 4)
    assert [o.state for o in made([mine], root)] == ["done"]
    first = told(root / "mine")
    with monkeypatch.context() as patch:
        patch.setattr(batch_nights, "open_reducer", None)
        (skipped,) = made([mine], root)
        assert (skipped.state, skipped.frames, skipped.detections) == ("skipped", 3, 3)
    tasks = nights_of_folders([mine], root, Config.model_validate({"detector": {"tau": 0.3}}))
    (outcome,) = process_nights(tasks, lambda _: SERIAL)
    assert outcome.state == "failed"
    assert "--again" in str(outcome.error)
    os.utime(mine / "frame_9.fits")
    assert "--again" in str(made([mine], root)[0].error)
    assert told(root / "mine") == first
    assert [o.state for o in made([mine], root, is_again=True)] == ["done"]
    assert told(root / "mine") == first
    assert sorted(p.name for p in root.iterdir()) == ["mine"]


def test_the_kept_frames_of_a_session_are_a_night_too(tmp_path):
    """The shipped sample has kept its frames 9 and 11: they stay the ninth and the eleventh."""
    sample = SAMPLE
    (night,) = nights_of_folders([sample], tmp_path, Config())
    assert [(number, path.name) for number, path in night.frames] == [
        (9, "000009.fits.fz"),
        (13, "000013.fits.fz"),
    ]
    (outcome,) = process_nights([night], lambda _: SERIAL)
    assert (outcome.frames, outcome.measurements) == (2, 2)


@pytest.mark.slow("starts the program twice")
def test_work_that_is_killed_goes_on_where_it_was(nights, serial_root, tmp_path):
    """kill -9 in the middle; the same command again finishes what is left, and is the same."""
    root = tmp_path / "out"
    config = same_root(tmp_path / "config.toml")
    arguments = ["process", *map(str, nights), "--session", str(root), "--config", str(config)]
    arguments += ["--no-dask", "--workers"]
    batch = subprocess.Popen(
        [sys.executable, "-c", "from rsoconsole.cli import main; main()", *arguments, "2"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert batch.stdout is not None
    assert batch.stdout.readline().startswith(NAMES[0])
    batch.kill()
    batch.wait()
    batch.stdout.close()
    finished = [name for name in NAMES if (root / name).exists()]
    assert NAMES[0] in finished
    began = SessionReader(root / NAMES[0]).folder.stat().st_mtime_ns
    give_up_s = time.monotonic() + 20.0
    while time.monotonic() < give_up_s:  # its workers end with it
        again = rsoconsole(*arguments, "1", "--json")
        if "another batch" not in again.stderr:
            break
    assert again.returncode == 0, again.stderr
    outcomes = {Path(a["night"]).name: a["outcome"] for a in objects(again)}
    assert outcomes[NAMES[0]] == "skipped"
    assert set(outcomes.values()) <= {"skipped", "done"}
    assert SessionReader(root / NAMES[0]).folder.stat().st_mtime_ns == began
    assert same_sessions(serial_root, root)
    assert not list(root.glob(".*.part"))
