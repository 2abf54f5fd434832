"""Rows of analysed frames on disk: each frame once per network and state of the code.

    models/runs/<name>/<fingerprint>/<kind>.jsonl

One line of JSON per frame, appended when the frame is done, so that interrupted work is resumed.
The fingerprint covers the network, the code that analyses and the code that draws. It leaves out
the curve of confidence, since rows keep measured values and not the confidence computed from them.
"""

import hashlib
import json
import multiprocessing
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

from models.altered import draw_altered
from models.frames import KINDS, Kind, Split, TrueFrame, draw
from models.judging import FrameRow, Judge
from rsoconsole.simulator import SensorModel
from rsoconsole.vision import MODEL_NAME, VERIFIER_NAME

HERE = Path(__file__).parent
RUNS = HERE / "runs"
_LOOKING = ("rsoconsole/vision/**/*.py", "rsoconsole/simulator/**/*.py")
_ALL: tuple[Kind, ...] = (*KINDS, "altered")
_DRAWING = tuple(
    f"models/{name}.py" for name in ("frames", "altered", "telescopes", "nuisances", "judging")
)
_NOT_LOOKING = ("rsoconsole/vision/detector/confidence.py",)

Task = tuple[Split, Kind, int]


def fingerprint() -> str:
    """Fingerprint of both networks and of all source files on which a row depends."""
    digest = hashlib.sha256((HERE / MODEL_NAME).read_bytes())
    digest.update((HERE / VERIFIER_NAME).read_bytes())
    card = json.loads((HERE / MODEL_NAME).with_suffix(".json").read_text(encoding="utf-8"))
    digest.update(json.dumps(card["calibration"], sort_keys=True).encode())
    root = HERE.parent
    paths = {path for pattern in _LOOKING + _DRAWING for path in root.glob(pattern)}
    for path in sorted(paths - {root / name for name in _NOT_LOOKING}):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def folder_of(name: str) -> Path:
    """Folder of the rows of the run ``name`` for the present network and code."""
    return RUNS / name / fingerprint()


def read(folder: Path) -> list[FrameRow]:
    """All rows of a folder on disk, in order of kind and number."""
    rows: dict[tuple[Kind, int], FrameRow] = {}
    for kind in _ALL:
        path = folder / f"{kind}.jsonl"
        if path.exists():
            for line in path.read_text(encoding="utf-8").splitlines():
                row = _row_of(line)
                if row is not None:
                    rows[kind, row["number"]] = row
    return [rows[key] for key in sorted(rows, key=lambda key: (_ALL.index(key[0]), key[1]))]


def complete(
    folder: Path, split: Split, counts: Mapping[Kind, int], workers: int, *, again: bool = False
) -> list[FrameRow]:
    """The rows of the first ``counts`` frames of each kind; missing ones are made and stored.

    ``again``: make all of them.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if again:
        for kind in counts:
            (folder / f"{kind}.jsonl").unlink(missing_ok=True)
    for path in folder.glob("*.jsonl"):
        # A line that a crash left unfinished must not swallow the next one.
        if not path.read_bytes().endswith(b"\n"):
            with path.open("ab") as lines:
                lines.write(b"\n")
    known = {(row["kind"], row["number"]) for row in read(folder)}
    wanted = [(split, kind, n) for kind, count in counts.items() for n in range(count)]
    missing = [task for task in wanted if task[1:] not in known]
    # Kinds mixed evenly: what is on disk serves at any time, and the time left is predicted well.
    missing.sort(key=lambda task: (task[2] + 0.5) / counts[task[1]])
    for row in _looked_at(missing, workers):
        with (folder / f"{row['kind']}.jsonl").open("a", encoding="utf-8") as lines:
            lines.write(json.dumps(row) + "\n")
    asked = {task[1:] for task in wanted}
    return [row for row in read(folder) if (row["kind"], row["number"]) in asked]


def _row_of(line: str) -> FrameRow | None:
    """Row of a line; None for a line that a crash left unfinished."""
    try:
        row: FrameRow = json.loads(line)
    except ValueError:
        return None
    return row


def _looked_at(tasks: list[Task], workers: int) -> Iterator[FrameRow]:
    if not tasks:
        return
    bar = Progress(len(tasks))
    if workers <= 1:
        _begin(None)
        for task in tasks:
            yield _look(task)
            bar.step()
        return
    with multiprocessing.get_context("spawn").Pool(workers, _begin, (None,)) as pool:
        for row in pool.imap_unordered(_look, tasks, chunksize=2):
            yield row
            bar.step()


_state: dict[str, Judge | SensorModel | None] = {}


def _begin(sensor: SensorModel | None) -> None:
    """Set up one worker: its own detector, one thread each."""
    import cv2

    cv2.setNumThreads(1)
    _state["judge"] = Judge()
    _state["sensor"] = sensor


def _look(task: Task) -> FrameRow:
    judge, sensor = _state["judge"], _state["sensor"]
    assert isinstance(judge, Judge)
    return judge.row(_drawn(task, sensor if isinstance(sensor, SensorModel) else None))


def _drawn(task: Task, sensor: SensorModel | None) -> TrueFrame:
    split, kind, number = task
    return draw_altered(split, number) if kind == "altered" else draw(split, kind, number, sensor)


class Progress:
    """Progress line on the terminal: number done, number in all, and time left."""

    def __init__(self, total: int) -> None:
        self._total, self._done, self._began = total, 0, time.monotonic()
        self._is_shown = sys.stderr.isatty()

    def step(self) -> None:
        """Count one more frame as done."""
        self._done += 1
        if not self._is_shown and self._done % 100 and self._done != self._total:
            return
        left_s = (time.monotonic() - self._began) / self._done * (self._total - self._done)
        share = self._done / self._total
        text = f"[{'#' * int(30 * share):<30}] {self._done} of {self._total} frames"
        text += f", {int(left_s // 60)} min {int(left_s % 60):02d} s left"
        print(f"\r{text}  " if self._is_shown else text, end="", file=sys.stderr)
        if not self._is_shown or self._done == self._total:
            print(file=sys.stderr, flush=True)
