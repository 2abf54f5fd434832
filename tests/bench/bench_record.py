"""What the record costs: waiting for the disk, hashes, and looking after sessions.

    python -m tests.bench.bench_record [--commits 200] [--frames 1200] [--folder DIR] [--write]

Run from the project's root. Times are medians of single commits of ten records each, with the disk
waited for at every commit (as the engine writes) and only now and then (``synchronous=NORMAL``);
of putting a frame of 8.5 MB in place with and without waiting for it; and of closing, verifying and
listing a made-up night of so many frames with pictures. ``--folder`` names the disk to measure.
Prints; ``--write`` keeps the figures in ``results/record.json``.
"""

import argparse
import json
import platform
import tempfile
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from rsoconsole.base import write_durably
from rsoconsole.config import Config
from rsoconsole.session import SessionReader, SessionWriter, encode, summarise, verify_session
from rsoconsole.session.files.digest import digest_log, sha256_of
from rsoconsole.session.log.database import connect_to_write
from tests.nights import made_up_night as night

RESULTS = Path(__file__).parent / "results" / "record.json"
FRAME_BYTES = 8_500_000
FRAME_REPEATS = 9
RECORDS_A_COMMIT = 10


def timed_s(work: Callable[[], object]) -> float:
    """Seconds that it takes."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def commit_ms(folder: Path, synchronous: str, commits: int) -> float:
    """Median of one commit of ten records into a live session's log."""
    SessionWriter.create(folder, Config(), {}).flush()
    kind, frame_id, body = encode(night.taken(1, 320.0, -4.8))
    with closing(connect_to_write(folder / "session.db")) as connection:
        connection.execute(f"PRAGMA synchronous={synchronous}")

        def commit(first: int) -> None:
            connection.execute("BEGIN IMMEDIATE")
            connection.executemany(
                "INSERT INTO log VALUES (?, 1, ?, ?, ?)",
                [(seq, kind, frame_id, body) for seq in range(first, first + RECORDS_A_COMMIT)],
            )
            connection.execute("COMMIT")

        firsts = range(1, commits * RECORDS_A_COMMIT, RECORDS_A_COMMIT)
        return 1e3 * median(timed_s(lambda first=first: commit(first)) for first in firsts)


def frame_ms(folder: Path) -> dict[str, float]:
    """Medians of a frame's hash, and of putting it in place with and without waiting."""
    folder.mkdir()
    content = np.random.default_rng(1).bytes(FRAME_BYTES)
    durable = [timed_s(lambda: write_durably(folder / "a", content)) for _ in range(FRAME_REPEATS)]
    plain = [timed_s(lambda: (folder / "b").write_bytes(content)) for _ in range(FRAME_REPEATS)]
    hashes = [timed_s(lambda: sha256_of(content)) for _ in range(FRAME_REPEATS)]
    return {
        "frame_durable": 1e3 * median(durable),
        "frame_plain": 1e3 * median(plain),
        "frame_hash": 1e3 * median(hashes),
    }


def night_s(folder: Path, frames: int) -> dict[str, float]:
    """A made-up night: closing it, its digest alone, verifying and listing it."""
    writer = night.begin(folder)
    for first in range(1, frames + 1, 50):
        batch = range(first, min(first + 50, frames + 1))
        night.add_frames(writer, batch)
        for one in batch:
            night.add_previews(writer, range(one, one + 1))
    closing_s = timed_s(writer.close)
    found: list[Any] = []
    verify_s = timed_s(lambda: found.append(verify_session(folder)))
    assert found[0].is_sound
    with closing(SessionReader(folder).connect()) as connection:
        digest_s = min(timed_s(lambda: digest_log(connection)) for _ in range(3))
    list_s = median(timed_s(lambda: summarise(folder)) for _ in range(3))
    return {
        "close_s": closing_s,
        "verify_s": verify_s,
        "digest_s": digest_s,
        "list_s": list_s,
        "records": float(found[0].records),
        "megabytes": found[0].bytes / 1e6,
    }


def main() -> None:
    """Measure, print, keep."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--commits", type=int, default=200)
    parser.add_argument("--frames", type=int, default=1200)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        place = Path(name)
        figures = {
            "commit_full_ms": commit_ms(place / "full", "FULL", options.commits),
            "commit_normal_ms": commit_ms(place / "normal", "NORMAL", options.commits),
            **{f"{key}_ms": value for key, value in frame_ms(place / "frames").items()},
            **night_s(place / "night", options.frames),
        }
    figures = {key: round(value, 3) for key, value in figures.items()}
    for key, value in figures.items():
        print(f"{key:18} {value:10.3f}")
    if options.write:
        about = {"machine": platform.machine(), "python": platform.python_version()}
        kept = {**about, "frames": options.frames, **figures}
        RESULTS.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
