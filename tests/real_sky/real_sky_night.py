"""A night on Debian's own indiserver and simulators, in real time, under a sky of ours.

    python -m tests.real_sky.real_sky_night [--frames N] [--seed N] [--scatter-s S]
        [--standard-mag M] [--cadence-s S] [--keep-frames all] [--folder DIR]

Neither mount, camera nor the light in the frames is drawn by this project: INDI's simulators do
that, and ``gsc_sky`` only tells them what is above. Prints the figures as JSON.
"""

import argparse
import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from rsoconsole.cli.judge.summary import read_truth
from rsoconsole.session import SessionReader
from tests.real_sky.real_sky_judge import judge
from tests.real_sky.real_sky_rig import STANDARD_MAG

ROOT = Path(__file__).resolve().parents[2]
NEEDED = ("indiserver", "indi_simulator_telescope", "indi_simulator_ccd", "unshare", "ip", "bash")
NAMESPACE = ["unshare", "--user", "--map-root-user", "--net"]
EXPOSURE_S, CADENCE_S = 10.0, 30.0
START_S, SLOW = 180.0, 2.0
"""Of a night's time limit: to begin, and how much longer than its exposures a night may take."""


def lacks() -> str | None:
    """Why no night can be had here, and the remedy; None where it can."""
    missing = [program for program in NEEDED if shutil.which(program) is None]
    if missing:
        return f"needs {', '.join(missing)}: apt install indi-bin util-linux iproute2"
    if subprocess.run([*NAMESPACE, "true"], capture_output=True, check=False).returncode:
        return "this system does not let users make a network namespace"
    return None


def run_night(
    frames: int,
    seed: int,
    scatter_s: float,
    *,
    cadence_s: float = CADENCE_S,
    standard_mag: float = STANDARD_MAG,
    keep_frames: str = "none",
    folder: Path | None = None,
    settings: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """The figures of one night; ``settings``: more of the configuration, section by section.

    The folder keeps session, truth and logs where one is given. A night that ends in FAULT has its
    figures too: ``engine_status`` is then not 0, ``last_words`` say why. Raises RuntimeError where
    it did not come to its end, with the last words of its logs.
    """
    with contextlib.ExitStack() as stack:
        # Sockets have short names: a folder of the system's own for what is thrown away.
        if folder is None:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="sky")))
        folder = folder.resolve()
        wanted = {
            "frames": frames,
            "seed": seed,
            "scatter_s": scatter_s,
            "exposure_s": EXPOSURE_S,
            "cadence_s": cadence_s,
            "standard_mag": standard_mag,
            "keep_frames": keep_frames,
            "settings": settings or {},
        }
        (folder / "night.json").write_text(json.dumps(wanted), encoding="utf-8")
        began_s = time.monotonic()
        _run(folder, START_S + SLOW * frames * cadence_s)
        records = [each for _, _, each in SessionReader(folder / "session").records()]
        names = ("seed", "scatter_s", "exposure_s", "cadence_s", "standard_mag")
        status = int((folder / "engine_status").read_text(encoding="ascii"))
        return {
            **{name: wanted[name] for name in names},
            "engine_status": status,
            "last_words": _last_words(folder) if status else "",
            "wall_s": round(time.monotonic() - began_s, 1),
            **judge(records, read_truth(folder / "truth.jsonl")),
        }


def _run(folder: Path, limit_s: float) -> None:
    command = [*NAMESPACE, sys.executable, "-m", "tests.real_sky.real_sky_rig", str(folder)]
    with (folder / "rig.log").open("wb") as log:
        night = subprocess.Popen(command, cwd=ROOT, stdout=log, stderr=log)
        try:
            status = night.wait(limit_s)
        except subprocess.TimeoutExpired:
            status = None
        finally:
            _end(night, folder)
    if status != 0:
        how = f"did not end in {limit_s:.0f} s" if status is None else f"ended with {status}"
        raise RuntimeError(f"the night {how}:\n{_last_words(folder)}")


def _end(night: subprocess.Popen[bytes], folder: Path) -> None:
    """Nothing of the night outlives it: all its processes name the folder."""
    night.kill()
    night.wait()
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit() or int(entry.name) == os.getpid():
            continue
        with contextlib.suppress(OSError):
            environment = (entry / "environ").read_bytes().split(b"\0")
            if {f"HOME={folder}".encode(), f"XDG_RUNTIME_DIR={folder}/run".encode()} & {
                *environment
            }:
                os.kill(int(entry.name), signal.SIGKILL)


def _last_words(folder: Path) -> str:
    logs = (folder / name for name in ("rig.log", "engine.log", "indiserver.log"))
    kept = (each.read_text(errors="replace").splitlines()[-12:] for each in logs if each.exists())
    return "\n".join(line for lines in kept for line in lines)


def main() -> None:
    """Print one night's figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=27)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--scatter-s", type=float, default=0.0)
    parser.add_argument("--cadence-s", type=float, default=CADENCE_S)
    parser.add_argument("--standard-mag", type=float, default=STANDARD_MAG)
    parser.add_argument("--keep-frames", default="none")
    parser.add_argument("--folder", type=Path, help="empty; keeps session, truth and logs")
    asked = parser.parse_args()
    fault = lacks()
    if fault is not None:
        sys.exit(fault)
    found = run_night(
        asked.frames,
        asked.seed,
        asked.scatter_s,
        cadence_s=asked.cadence_s,
        standard_mag=asked.standard_mag,
        keep_frames=asked.keep_frames,
        folder=asked.folder,
    )
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
