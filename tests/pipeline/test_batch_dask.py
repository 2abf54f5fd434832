"""A Dask scheduler with two single-threaded workers: what is killed costs little and is named."""

import contextlib
import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from rsoconsole.config import Config
from rsoconsole.pipeline import WorkerPool, nights_of_folders
from rsoconsole.pipeline.batch.batch_nights import process_night, process_nights
from rsoconsole.session import SessionReader
from tests.pipeline.test_batch import write_night

pytestmark = pytest.mark.skipif(find_spec("distributed") is None, reason="Dask is not installed")
PATIENCE_S = 120.0
DASK = [sys.executable, "-m", "dask"]
PROGRAM = [sys.executable, "-c", "from rsoconsole.cli import main; main()"]


class Cluster:
    """A scheduler and workers, each a process that can be killed."""

    def __init__(self, folder: Path, workers: int = 2) -> None:
        self.file = folder / "scheduler.json"
        self.file.unlink(missing_ok=True)
        self.scheduler = self._started(
            "scheduler", "--port", "0", "--scheduler-file", str(self.file), "--no-dashboard"
        )
        until(self.file.exists)
        self.address = json.loads(self.file.read_text())["address"]
        self.workers = [
            self._started(
                *("worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard"),
                *("--local-directory", str(folder / f"worker-{number}")),
            )
            for number in range(workers)
        ]

    def _started(self, *words: str) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [*DASK, *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    def close(self) -> None:
        for each in (*self.workers, self.scheduler):
            each.kill()
            each.wait()


@contextlib.contextmanager
def cluster(folder: Path, workers: int = 2) -> Iterator[Cluster]:
    folder.mkdir(exist_ok=True)
    running = Cluster(folder, workers)
    try:
        yield running
    finally:
        running.close()


def until(is_so: Any) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not is_so():
        assert time.monotonic() < deadline, "it never came to be"
        time.sleep(0.05)


@pytest.fixture(scope="module")
def nights(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    root = tmp_path_factory.mktemp("nights")
    return [write_night(root / f"night-{n}", n, frames=6) for n in range(6)]


@pytest.fixture(scope="module")
def one_night(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return [write_night(tmp_path_factory.mktemp("nights") / "night", 0, frames=2)]


def begun(nights: list[Path], root: Path, address: str) -> subprocess.Popen[str]:
    words = ["process", *map(str, nights), "--session", str(root), "--scheduler", address]
    return subprocess.Popen(
        [*PROGRAM, *words, "--json"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def is_made(root: Path, name: str) -> bool:
    return (root / name / "session.db").exists()


@pytest.mark.nightly("starts a Dask cluster")
@pytest.mark.timeout(400)
def test_a_killed_worker_costs_its_task_at_most_and_a_rerun_makes_what_is_missing(
    nights: list[Path], tmp_path: Path
) -> None:
    root = tmp_path / "out"
    with cluster(tmp_path / "dask") as running:
        run = begun(nights, root, running.address)
        until(lambda: any(is_made(root, night.name) for night in nights))
        running.workers[0].send_signal(signal.SIGKILL)
        out, err = run.communicate(timeout=PATIENCE_S)
        outcomes = [json.loads(line)["outcome"] for line in out.splitlines()]
        assert outcomes.count("done") >= len(nights) - 1
        assert len(outcomes) == len(nights)
        assert "Traceback" not in err
        assert run.returncode == (0 if "failed" not in outcomes else 1)
        if "failed" in outcomes:
            assert "its worker died" in err
        again = begun(nights, root, running.address)
        out, err = again.communicate(timeout=PATIENCE_S)
        assert again.returncode == 0, err
        expected = ["skipped" if each == "done" else "done" for each in outcomes]
        assert [json.loads(line)["outcome"] for line in out.splitlines()] == expected
    assert sorted(path.name for path in root.glob("[!.]*")) == sorted(n.name for n in nights)
    assert not list(root.glob(".*.part"))


@pytest.mark.nightly("starts a Dask cluster")
@pytest.mark.timeout(400)
def test_a_dead_scheduler_is_named_in_a_line_and_nothing_done_is_lost(
    nights: list[Path], tmp_path: Path
) -> None:
    root = tmp_path / "out"
    with cluster(tmp_path / "dask") as running:
        run = begun(nights, root, running.address)
        until(lambda: any(is_made(root, night.name) for night in nights))
        running.scheduler.send_signal(signal.SIGKILL)
        out, err = run.communicate(timeout=PATIENCE_S)
    assert run.returncode == 1
    (line,) = err.splitlines()
    assert f"the Dask scheduler {running.address} does not answer any more" in line
    assert "give the same command again" in line
    made = {night.name for night in nights if is_made(root, night.name)}
    assert made
    with cluster(tmp_path / "dask") as running:
        again = begun(nights, root, running.address)
        out, err = again.communicate(timeout=PATIENCE_S)
    assert again.returncode == 0, err
    rows = [json.loads(line) for line in out.splitlines()]
    assert {Path(row["night"]).name for row in rows if row["outcome"] == "skipped"} >= made
    assert {row["outcome"] for row in rows} <= {"skipped", "done"}
    assert not list(root.glob(".*.part"))


def test_what_a_worker_made_before_it_died_is_no_error_of_the_next(
    one_night: list[Path], tmp_path: Path
) -> None:
    """The scheduler gives its task to another one, which finds the session there."""
    (task,) = nights_of_folders(one_night, tmp_path, Config())
    first = process_night(task)
    second = process_night(task)
    assert (first.state, second.state, second.error) == ("done", "done", None)
    assert (second.frames, second.detections) == (first.frames, first.detections)
    assert SessionReader(task.session).read_meta()["is_closed"] is True


def test_one_that_was_given_up_and_its_successor_are_in_each_others_way_nowhere(
    one_night: list[Path], tmp_path: Path
) -> None:
    """What lies beside a night that is being made is nobody else's; what was left is removed."""
    left = tmp_path / f".{one_night[0].name}.0a1b2c3d.part"
    left.mkdir()
    (left / "session.db").write_bytes(b"half")
    (task,) = nights_of_folders(one_night, tmp_path, Config())
    process_night(task)
    assert left.exists()
    again = nights_of_folders(one_night, tmp_path, Config(), is_again=True)
    (outcome,) = process_nights(again, lambda _: WorkerPool(kind="serial", workers=1))
    assert outcome.state == "done"
    assert not left.exists()
    assert [path.name for path in tmp_path.iterdir()] == [one_night[0].name]
