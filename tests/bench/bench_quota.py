"""The demo at full size and in real time, with a quarter of one core for everything but the sky.

    python -m tests.bench.bench_quota [--frames 20] [--quota 0.25] [--keep DIR]

Run from the project's root, alone on the machine; 20 frames take eleven minutes. Engine, the
processes of mount, camera and plate solver, and the console in a terminal share the quota; the
simulated observatory has the machine to itself, as the world has. Every frame is kept.

Judged from outside, by the wall clock: when each exposure begins is what a plain INDI client
hears of the camera, how the night ran is read from its session, what was there to see from the
simulation's truth. Afterwards ``rsoconsole detect`` goes through the kept frames without a quota
and must find the recorded detections to the last digit. Exit 1 where something is not so.
"""

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from rsoconsole.base import RsoconsoleError
from rsoconsole.cli.judge.summary import HIDDEN_SNR
from rsoconsole.config import Config
from rsoconsole.instruments import IndiWire, read_frame
from rsoconsole.pipeline.words.reports import detection_report
from rsoconsole.records import CycleTiming, Detections, Event, FrameTaken, Miss
from rsoconsole.session import SessionReader
from rsoconsole.sky import iso_to_utc_ns
from rsoconsole.words import text
from tests.bench.quota import Quota, command_of, cpu_s, exempt, family, open_quota
from tests.rigs.terminal import Terminal

PROGRAM = [sys.executable, "-c", "from rsoconsole.cli import main; main()"]
SIMULATOR = "rsoconsole.simulator.server"
SIZE = (120, 40)
START_S = 600.0
KEY_EVERY_S = 7.0
KEY_S = 30.0
"""A key whose effect is not seen by then counts as not answered."""
SPACING_S = 1.0
"""How far from the plan an exposure may begin, by the wall clock."""
SAME_PX = 10.0
END_PX = 8
BRIGHTER = 5.0
"""A star so many times brighter than the streak hides an end that is so near."""
ROLES = {
    "mount_child": "mount's process",
    "camera_child": "camera's process",
    "solver_process": "plate solver",
    "demo_night": "engine",
}


@dataclass
class Seen:
    """What was seen of the night from outside."""

    starts: list[tuple[float, int]] = field(default_factory=list)
    """Of each exposure that was seen to begin: wall (monotonic) and virtual time."""
    keys_s: list[float] = field(default_factory=list)
    unanswered: int = 0
    cpu_s: dict[str, dict[int, float]] = field(default_factory=dict)
    """By role and process."""

    def spent(self) -> dict[str, float]:
        return {role: sum(each.values()) for role, each in self.cpu_s.items()}


def main() -> int:
    """Run the night, judge it, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--quota", type=float, default=0.25)
    parser.add_argument("--keep", type=Path, help="where the session is left")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        place = options.keep or Path(scratch)
        place.mkdir(parents=True, exist_ok=True)
        return _judge(place, *_run(place, options.frames, options.quota), options.frames)


def _run(place: Path, frames: int, share: float) -> tuple[Seen, list[dict[str, Any]], Terminal]:
    environment = _environment(place)
    night = ["demo", "--speed", "1", "--frames", str(frames), "--keep-frames", "all"]
    seen, truth_file = Seen(), None
    quota = open_quota(share)
    print(f"quota: {quota.means}; {frames} frames of intelsat-14 at full size, real time")
    try:
        command = quota.command([*PROGRAM, *night, "--session", str(place / "night")])
        with Terminal(command, environment, SIZE) as terminal:
            root = terminal.process.pid
            quota.began(root)
            with exempt(quota, root, SIMULATOR), _counting(seen, root, quota):
                reader = _session(place / "night", terminal)
                truth_file = _truth(place)
                print(f"engine's session after {time.monotonic() - terminal.begun_s:.1f} s")
                with _listening(seen, reader.config()):
                    _sit(seen, terminal, reader, frames)
            text = terminal.text
    finally:
        quota.close()
    truth = [json.loads(line) for line in truth_file.read().splitlines() if line]
    (place / "truth.jsonl").write_text("\n".join(json.dumps(t) for t in truth), encoding="utf-8")
    (place / "terminal.txt").write_text(text, encoding="utf-8")
    return seen, truth, terminal


def _environment(place: Path) -> dict[str, str]:
    names = ("RUNTIME_DIR", "STATE_HOME", "DATA_HOME", "CONFIG_HOME", "CACHE_HOME")
    own = {f"XDG_{name}": str(place / name.lower()) for name in names} | {"TMPDIR": str(place)}
    for path in own.values():
        Path(path).mkdir(mode=0o700, exist_ok=True)
    return {**os.environ, **own}


def _session(folder: Path, terminal: Terminal) -> SessionReader:
    """The night's record, as soon as there is one."""

    def reader() -> SessionReader | None:
        if terminal.process.poll() is not None:
            sys.exit(f"the demo ended before its night began:\n{terminal.text[-2000:]}")
        with contextlib.suppress(RsoconsoleError):
            found = SessionReader(folder)
            found.config()
            return found
        return None

    ends_s = time.monotonic() + START_S
    while time.monotonic() < ends_s:
        if (found := reader()) is not None:
            return found
        time.sleep(0.05)
    sys.exit(f"no session after {START_S:.0f} s; the terminal says:\n{terminal.text[-2000:]}")


def _truth(place: Path) -> IO[str]:
    """Held open: the demo takes it away with its other temporary files."""
    ends_s = time.monotonic() + START_S
    while time.monotonic() < ends_s:
        for path in place.glob("rsoconsole-*/truth.jsonl"):
            return path.open(encoding="utf-8")
        time.sleep(0.05)
    sys.exit("the simulated observatory writes no truth")


def _sit(seen: Seen, terminal: Terminal, reader: SessionReader, frames: int) -> None:
    """Press a key now and then until the last frame is on record."""
    timings = (CycleTiming,)
    ends_s = time.monotonic() + START_S + frames * 120.0
    while sum(1 for _ in reader.records(kinds=timings)) < frames:
        if time.monotonic() > ends_s:
            print("the night does not come to its end")
            return
        known, began_s = len(terminal.text), time.monotonic()
        terminal.press("z")
        while not terminal.shows("picture: ", since=known):
            if time.monotonic() - began_s > KEY_S:
                seen.unanswered += 1
                break
            time.sleep(0.005)
        else:
            seen.keys_s.append(time.monotonic() - began_s)
        time.sleep(max(0.0, KEY_EVERY_S - (time.monotonic() - began_s)))
    # The last frame is still being written.
    time.sleep(20.0)


@contextlib.contextmanager
def _listening(seen: Seen, config: Config) -> Iterator[None]:
    """A plain INDI client that notes when exposures begin."""
    is_over = threading.Event()

    def listen() -> None:
        wire = IndiWire(config.indi.host, config.indi.port)
        wire.ask(config.indi.camera, "CCD_EXPOSURE")
        is_open = False
        with contextlib.suppress(RsoconsoleError):
            while not is_over.is_set():
                vector = wire.wait(lambda each: each.name == "CCD_EXPOSURE", 0.2)
                if vector is None:
                    continue
                if vector.state == "Busy" and not is_open and not vector.is_definition:
                    seen.starts.append((time.monotonic(), iso_to_utc_ns(vector.timestamp)))
                is_open = vector.state == "Busy"
        wire.close()

    thread = threading.Thread(target=listen, daemon=True)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()


@contextlib.contextmanager
def _counting(seen: Seen, root: int, quota: Quota) -> Iterator[None]:
    """Processor seconds by role, looked at each second."""
    is_over = threading.Event()

    def look() -> None:
        roles: dict[int, str] = {}
        while not is_over.wait(1.0):
            for pid in family({root}, set()):
                words = " ".join(command_of(pid))
                if SIMULATOR in words:
                    continue
                role = next((name for key, name in ROLES.items() if key in words), "console")
                used_s = cpu_s(pid)
                if used_s is not None:
                    if roles.setdefault(pid, role) != role:
                        roles[pid] = role
                    seen.cpu_s.setdefault(role, {})[pid] = used_s

    thread = threading.Thread(target=look, daemon=True)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()


def _judge(
    place: Path, seen: Seen, truth: list[dict[str, Any]], terminal: Terminal, frames: int
) -> int:
    reader = SessionReader(place / "night")
    config = reader.config()
    records = [record for _, _, record in reader.records()]
    taken = {r.frame_id: r for r in records if isinstance(r, FrameTaken)}
    found = {r.frame_id: r for r in records if isinstance(r, Detections)}
    timings = {r.frame_id: r.stage_ms for r in records if isinstance(r, CycleTiming)}
    late_s = _print_frames(seen, taken, found, timings)
    visible, missed, covered = _visible(reader, truth, taken, found)
    exposure = config.exposure
    room_s = exposure.cadence_s - exposure.start_latency_s - exposure.exposure_s
    busy_s = [(ms["total"] + ms.get("orbit", 0.0)) / 1e3 for ms in timings.values()]
    bad_words = [
        r.text for r in records if isinstance(r, Event) and r.level in ("warning", "alarm")
    ]
    # A miss in a frame that went through the whole cycle is judged by the truth instead.
    bad = (r for r in records if isinstance(r, Miss) and r.frame_id not in timings)
    bad_words += [text(r.reason) for r in bad]
    blames = [w for w in ("set indi.", "did not start", "has no device") if w in terminal.text]
    differing = _detect_again(place, reader, found)
    spent = seen.spent()
    print(
        f"\nprocessor a cadence (s): {sum(spent.values()) / frames:.2f} of which "
        + ", ".join(f"{role} {s / frames:.2f}" for role, s in sorted(spent.items()))
    )
    keys = sorted(seen.keys_s)
    if keys:
        print(
            f"key to screen (s): {len(keys)} keys, median {keys[len(keys) // 2]:.2f}, "
            f"largest {keys[-1]:.2f}"
        )
    checks = {
        f"{frames} frames taken, {len(timings)} through the whole cycle": len(timings) == frames,
        f"begun {exposure.cadence_s:g} s apart by the wall clock, at most {late_s:+.2f} s late": (
            len(seen.starts) >= frames - 1 and late_s <= SPACING_S
        ),
        f"last byte to the end of the work: at most {max(busy_s, default=0):.1f} s of the "
        f"{room_s:.1f} s that the exposure leaves": max(busy_s, default=1e9) < room_s,
        f"visible satellites detected: {visible - len(missed)} of {visible} {missed or ''}"
        f" (an end behind a star: {len(covered)} {covered or ''})": visible > 0 and not missed,
        f"every key answered ({seen.unanswered} not)": bool(keys) and not seen.unanswered,
        f"nothing went wrong {bad_words or ''}": not bad_words,
        f"no configuration blamed {blames or ''}": not blames,
        f"the same detections without a quota {differing or ''}": not differing,
    }
    for words, is_so in checks.items():
        print(f"{'yes' if is_so else 'NO '}  {words}")
    return 0 if all(checks.values()) else 1


def _print_frames(
    seen: Seen,
    taken: dict[int, FrameTaken],
    found: dict[int, Detections],
    timings: dict[int, Any],
) -> float:
    """A line a frame; how late the latest exposure began, against the virtual clock's plan.

    On time is the one that was least late: the clocks have no common beginning.
    """
    print(
        f"\n{'frame':>5} {'start s':>8} {'late s':>7} {'read':>6} {'detect':>7} {'solve':>6} "
        f"{'order':>6} {'total':>6} {'orbit':>6} {'streaks':>7}"
    )
    apart_s = {t: wall - t / 1e9 for wall, t in seen.starts}
    first_s = min((wall for wall, _ in seen.starts), default=0.0)
    for number in sorted(taken):
        ms = timings.get(number, {})
        begun_ns = (taken[number].t_start_utc_ns or 0) - 300_000_000
        start = next((each for each in seen.starts if abs(each[1] - begun_ns) < 1e9), None)
        at_s = late_s = float("nan")
        if start is not None:
            at_s = start[0] - first_s
            late_s = apart_s[start[1]] - min(apart_s.values())
        total = ms.get("total", float("nan")) / 1e3
        read, solve, order, orbit = (
            ms.get(stage, 0.0) / 1e3 for stage in ("read", "solve", "order", "orbit")
        )
        streaks = len(found[number].detections) if number in found else 0
        print(
            f"{number:5} {at_s:8.2f} {late_s:+7.2f} {read:6.2f} "
            f"{total - read - solve - order:7.2f} {solve:6.2f} {order:6.2f} {total:6.2f} "
            f"{orbit:6.2f} {streaks:7}"
        )
    return max(apart_s.values()) - min(apart_s.values()) if apart_s else float("inf")


def _visible(
    reader: SessionReader,
    truth: list[dict[str, Any]],
    taken: dict[int, FrameTaken],
    found: dict[int, Detections],
) -> tuple[int, list[str], list[str]]:
    """How many satellites could be seen; those not detected; those not detected behind a star."""
    count, missed, covered = 0, list[str](), list[str]()
    for number, frame in taken.items():
        exposure = next(
            (t for t in truth if abs(t["t_start_utc_ns"] - (frame.t_start_utc_ns or 0)) < 1e9), None
        )
        for satellite in [] if exposure is None else exposure["satellites"]:
            if not satellite["is_whole"] or satellite["snr_matched"] < HIDDEN_SNR:
                continue
            detections = found[number].detections if number in found else ()
            words = f"{number}: {satellite['name']} SNR {satellite['snr_matched']:.0f}"
            is_found = any(
                abs(d.x_px - satellite["x_px"]) < SAME_PX
                and abs(d.y_px - satellite["y_px"]) < SAME_PX
                for d in detections
            )
            if not is_found and _has_a_covered_end(reader.frame_path(number), satellite):
                covered.append(words)
                continue
            count += 1
            if not is_found:
                missed.append(words)
    return count, missed, covered


def _has_a_covered_end(path: Path | None, satellite: dict[str, Any]) -> bool:
    """Whether a star that is many times brighter than the streak lies on one of its ends."""
    if path is None:
        return False
    pixels = read_frame(path, 1).pixels
    thin = pixels[::16, ::16].astype(float)
    sky = float(np.median(thin))
    noise = 1.4826 * float(np.median(np.abs(thin - sky)))
    bright = sky + BRIGHTER * satellite["snr_peak_pixel"] * noise
    for end in ("start", "end"):
        x, y = round(satellite[f"x_{end}_px"]), round(satellite[f"y_{end}_px"])
        near = pixels[max(0, y - END_PX) : y + END_PX + 1, max(0, x - END_PX) : x + END_PX + 1]
        if near.size and float(near.max()) > bright:
            return True
    return False


def _detect_again(place: Path, reader: SessionReader, found: dict[int, Detections]) -> list[str]:
    """The kept frames through ``rsoconsole detect``: what comes out otherwise than recorded."""
    differing = []
    for number, recorded in sorted(found.items()):
        path = reader.frame_path(number)
        if path is None:
            differing.append(f"{number}: not kept")
            continue
        done = subprocess.run(
            [*PROGRAM, "detect", str(path), "--json"],
            env=_environment(place),
            capture_output=True,
            text=True,
            check=False,
        )
        again = json.loads(done.stdout)["detections"] if done.returncode == 0 else []
        before = json.loads(json.dumps([detection_report(d) for d in recorded.detections]))
        for each in (*again, *before):
            # The night has compared each frame with the one before it.
            each.pop("class_probability", None)
        if again != before:
            differing.append(str(number))
    return differing


if __name__ == "__main__":
    sys.exit(main())
