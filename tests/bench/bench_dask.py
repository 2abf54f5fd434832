"""Nights over Dask with one worker and with two, on this machine's own cores.

    .venv/bin/python -m tests.bench.bench_dask [NIGHTS] [FRAMES]

A scheduler and single-threaded workers as processes of their own, as on other machines; nights
of small frames with pixels, by ``rsoconsole process --scheduler``. Prints the wall clock of each
and their ratio: what the program takes to begin is in it. It wants an idle machine.
"""

import json
import sys
import tempfile
import time
from pathlib import Path

from distributed import Client

from tests.pipeline.test_batch import write_night
from tests.pipeline.test_batch_dask import begun, cluster


def wall_s(nights: list[Path], root: Path, workers: int) -> float:
    """Of all nights, by so many workers."""
    with cluster(root / f"dask-{workers}", workers) as running:
        with Client(running.address) as client:
            client.wait_for_workers(workers)
        begun_s = time.monotonic()
        out, err = begun(nights, root / f"out-{workers}", running.address).communicate()
        took_s = time.monotonic() - begun_s
    outcomes = [json.loads(line)["outcome"] for line in out.splitlines()]
    assert outcomes == ["done"] * len(nights), err
    return took_s


def main() -> None:
    """One worker, then two."""
    given = [int(word) for word in sys.argv[1:3]]
    count, frames = [*given, *(20, 60)[len(given) :]]
    with tempfile.TemporaryDirectory(prefix="bench-dask-") as folder:
        root = Path(folder)
        nights = [write_night(root / f"night-{n:02d}", n, frames=frames) for n in range(count)]
        one, two = (wall_s(nights, root, workers) for workers in (1, 2))
    print(f"{count} nights of {frames} frames: {one:.1f} s, with two workers {two:.1f} s", end="")
    print(f", ratio {two / one:.2f}")


if __name__ == "__main__":
    main()
