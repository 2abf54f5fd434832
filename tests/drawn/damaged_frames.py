"""Damaged frames by their seeds, and ``rsoconsole process`` over thousands of them.

    nice python -m tests.drawn.damaged_frames 10000

One run of the program over all of them; the table says what became of them, how long the slowest
took and what all processes together kept in memory. 10,000 take some ten minutes.
"""

import argparse
import bz2
import gzip
import io
import json
import os
import random
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from astropy.io import fits

PROCESS = (sys.executable, "-c", "from rsoconsole.cli import main; main()", "process")
_SAMPLE_S = 0.1


HEADER = {
    "EXPTIME": 10.0,
    "DATE-OBS": "2023-06-22T04:00:00.5",
    "RA": 303.2,
    "DEC": -6.5,
    "PIXSCALE": 5.0,
}
"""With a direction, so that the plate is searched for in each frame that is read."""
STARS, STREAK = 30, ((30.0, 40.0), (52.0, 55.0))


def pixels() -> np.ndarray:
    """Sky, stars where none are, and a streak: all that a frame is searched for."""
    draw = np.random.default_rng(1)
    sky = draw.normal(800.0, 20.0, (96, 128))
    y, x = np.mgrid[:96, :128]
    for _ in range(STARS):
        x0, y0, peak = draw.uniform(4, 124), draw.uniform(4, 92), 10 ** draw.uniform(2.3, 3.8)
        sky += peak * np.exp(-((x - x0) ** 2 + (y - y0) ** 2) / (2 * 1.1**2))
    (xa, ya), (xb, yb) = STREAK
    along = np.clip(
        ((x - xa) * (xb - xa) + (y - ya) * (yb - ya)) / np.hypot(xb - xa, yb - ya) ** 2, 0, 1
    )
    away = np.hypot(x - xa - along * (xb - xa), y - ya - along * (yb - ya))
    sky += 400.0 * np.exp(-(away**2) / (2 * 1.1**2))
    return np.clip(sky, 0, 65535).astype(np.uint16)


def _fits(*units: fits.hdu.base._BaseHDU) -> bytes:
    file = io.BytesIO()
    fits.HDUList(list(units)).writeto(file)
    return file.getvalue()


def _plain() -> bytes:
    unit = fits.PrimaryHDU(pixels())
    unit.header.update(HEADER)
    return _fits(unit)


def _packed(kind: str) -> bytes:
    return _fits(
        fits.PrimaryHDU(),
        fits.CompImageHDU(pixels(), fits.Header(HEADER.items()), compression_type=kind),
    )


def _picture(ending: str) -> bytes:
    return bytes(cv2.imencode(ending, pixels())[1])


WHOLE: dict[str, bytes] = {
    "plain": _plain(),
    "gzip": gzip.compress(_plain()),
    "bzip2": bz2.compress(_plain()),
    "Rice": _packed("RICE_1"),
    "HCOMPRESS": _packed("HCOMPRESS_1"),
    "gzip tiles": _packed("GZIP_1"),
    "extensions": _fits(fits.PrimaryHDU(), fits.ImageHDU(pixels()), fits.ImageHDU(pixels())),
    "PNG": _picture(".png"),
    "TIFF": _picture(".tiff"),
}


def _flipped(content: bytearray, draw: random.Random) -> None:
    for _ in range(draw.randint(1, 40)):
        content[draw.randrange(len(content))] = draw.randrange(256)


def _digits(content: bytearray, draw: random.Random) -> None:
    """Other figures in the header."""
    places = [n for n in range(min(len(content), 8640)) if chr(content[n]) in "0123456789T-"]
    for place in draw.sample(places, min(len(places), draw.randint(1, 6))):
        content[place] = ord(draw.choice("0123456789-TF. E"))


def _cut(content: bytearray, draw: random.Random) -> None:
    del content[draw.randrange(len(content)) :]


def _torn(content: bytearray, draw: random.Random) -> None:
    at = draw.randrange(len(content))
    del content[at : at + draw.randint(1, 4000)]


def _stuffed(content: bytearray, draw: random.Random) -> None:
    at = draw.randrange(len(content))
    content[at:at] = draw.randbytes(draw.randint(1, 4000))


DAMAGES: tuple[Callable[[bytearray, random.Random], None], ...] = (
    _flipped,
    _digits,
    _digits,
    _cut,
    _torn,
    _stuffed,
)


def damaged(seed: int) -> tuple[bytes, str]:
    """(the file, what was damaged and how)."""
    draw = random.Random(seed)
    kind = draw.choice(list(WHOLE))
    content, damage = bytearray(WHOLE[kind]), draw.choice(DAMAGES)
    damage(content, draw)
    return bytes(content), f"{kind}, {damage.__name__.strip('_')}"


@dataclass(slots=True, kw_only=True)
class Run:
    """What one run of ``process`` came to."""

    outcomes: dict[str, str] = field(default_factory=dict)
    """Of each file the kind of its line: solved, not solved, or refused."""
    lines: int = 0
    said: list[str] = field(default_factory=list)
    """Lines for people."""
    start_s: float = 0.0
    """Until the first line."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Of each file but the first."""
    peak_bytes: int = 0
    """Of all its processes together, each at its own highest."""
    status: int = -1


def process(paths: Sequence[Path], folder: Path) -> Run:
    """Run ``rsoconsole process --json`` over the files, with ``folder`` for what it keeps."""
    found = Run()
    environment = {**os.environ} | {
        f"XDG_{kind}_HOME": str(folder / kind.lower()) for kind in ("CONFIG", "STATE", "CACHE")
    }
    with (folder / "said").open("w") as said:
        began_s = before_s = time.monotonic()
        running = subprocess.Popen(
            [*PROCESS, "--json", *map(str, paths)],
            stdout=subprocess.PIPE,
            stderr=said,
            env=environment,
            text=True,
        )
        assert running.stdout is not None
        watch = threading.Thread(target=_watch_memory, args=(running, found), daemon=True)
        watch.start()
        for line in running.stdout:
            now_s = time.monotonic()
            row = json.loads(line)
            name = Path(row["frame"]).name
            if found.lines == 0:
                found.start_s = now_s - began_s
            else:
                found.seconds[name] = now_s - before_s
            found.lines, before_s = found.lines + 1, now_s
            found.outcomes[name] = _kind_of(row)
        found.status = running.wait()
        running.stdout.close()
        watch.join()
    found.said = (folder / "said").read_text(errors="replace").splitlines()
    return found


def _kind_of(row: dict[str, object]) -> str:
    if "error" in row:
        return "refused"
    solution = row["solution"]
    return "solved" if isinstance(solution, dict) and solution["solved"] else "not solved"


def _watch_memory(running: subprocess.Popen[str], found: Run) -> None:
    while running.poll() is None:
        found.peak_bytes = max(found.peak_bytes, sum(map(_highest_bytes, _family(running.pid))))
        time.sleep(_SAMPLE_S)


def _family(pid: int) -> set[int]:
    """A process and all below it."""
    parents: dict[int, int] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                parents[int(entry.name)] = int(
                    (entry / "stat").read_text().rpartition(")")[2].split()[1]
                )
            except OSError:
                continue
    family = {pid}
    while more := {child for child, parent in parents.items() if parent in family} - family:
        family |= more
    return family


def _highest_bytes(pid: int) -> int:
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return 0
    lines = [line for line in status.splitlines() if line.startswith("VmHWM:")]
    return 1024 * int(lines[0].split()[1]) if lines else 0


def table(found: Run, damages: dict[str, str]) -> str:
    """What became of each kind of damage, and the figures that are promised."""
    tally = Counter((damages[name], outcome) for name, outcome in found.outcomes.items())
    columns = ("solved", "not solved", "refused")
    lines = [f"{'damage':22}" + "".join(f"{name:>12}" for name in columns)]
    for damage in sorted({damage for damage, _ in tally}):
        lines.append(f"{damage:22}" + "".join(f"{tally[damage, name]:12d}" for name in columns))
    slowest = max(found.seconds, key=found.seconds.__getitem__)
    lines += [
        f"files {len(damages)}, lines {found.lines}, exit status {found.status}",
        f"slowest {found.seconds[slowest]:.2f} s ({slowest}), over 1 s:"
        f" {sum(s > 1.0 for s in found.seconds.values())}; the first after {found.start_s:.1f} s",
        f"peak memory of all processes {found.peak_bytes / 1e6:.0f} MB",
    ]
    return "\n".join(lines)


def write(seeds: range, folder: Path) -> dict[str, str]:
    """Write a file a seed; what was damaged, by the file's name in order."""
    found: dict[str, str] = {}
    for seed in seeds:
        content, damage = damaged(seed)
        name = f"{seed:05d}.fits"
        (folder / name).write_bytes(content)
        found[name] = damage
    return found


def main() -> int:
    """Exit status 0 when what is promised held."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("number", type=int, help="how many files")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / "frames").mkdir()
        seeds = range(asked.first, asked.first + asked.number)
        damages = write(seeds, folder / "frames")
        found = process([folder / "frames" / name for name in damages], folder)
    print(f"seeds {seeds.start} to {seeds.stop - 1}")
    print(table(found, damages))
    return 0 if holds(found, damages) else 1


MAX_S, MAX_BYTES = 5.0, 1_000_000_000


def holds(found: Run, damages: dict[str, str]) -> bool:
    """One line a file in their order, none slow, memory bounded."""
    return (
        list(found.outcomes) == list(damages)
        and found.lines == len(damages)
        and max(found.seconds.values()) < MAX_S
        and found.peak_bytes < MAX_BYTES
    )


if __name__ == "__main__":
    sys.exit(main())
