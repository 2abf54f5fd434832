"""What each INDI client costs: orders, STOP, frames, memory, coming back to a server.

    python -m tests.bench.bench_indi_clients [--rounds N] [--frames N]

Run from the project's root. The server (``indi_bench_server``) answers at once, so that the times
are those of client, process and pipe. The clients take turns, round by round, each round with
processes of its own; printed are the medians over all rounds and the largest.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rsoconsole.base import InstrumentError
from rsoconsole.config import Config
from rsoconsole.instruments.camera.camera import IndiCamera
from rsoconsole.instruments.indi.client_choice import LIBRARIES
from rsoconsole.instruments.indi.wire_stop import stop_mount
from rsoconsole.instruments.mount.mount import IndiMount

WIDTH_PX, HEIGHT_PX = 4656, 3520
ORDERS = 20
IDLE_S = 10.0
TICKS = os.sysconf("SC_CLK_TCK")
PATIENCE_S = 60.0
MOVES_DEG = (200.0, 240.0)


class Server:
    """The server, in a process of its own."""

    def __init__(self, port: int = 0) -> None:
        command = [sys.executable, "-m", "tests.bench.indi_bench_server"]
        command += [str(port), str(WIDTH_PX), str(HEIGHT_PX)]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE)
        self.port = int(self._line())

    def sent(self) -> dict[str, float]:
        """When the next frame was handed to the system."""
        return dict(json.loads(self._line()))

    def _line(self) -> bytes:
        assert self.process.stdout is not None
        return self.process.stdout.readline()

    def kill(self) -> None:
        """As the system kills it."""
        self.process.kill()
        self.process.communicate()


def cpu_s(pid: int) -> float:
    """Processor's time of a process, all threads."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def memory_mib(pid: int, line: str) -> float:
    """VmHWM (the largest until now) or VmRSS of a process."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    return int(status.partition(f"{line}:")[2].split()[0]) / 1024


def ms_of(act: Callable[[], object]) -> float:
    """Wall milliseconds of one call."""
    begun_s = time.perf_counter()
    act()
    return (time.perf_counter() - begun_s) * 1e3


@contextmanager
def opened(server: Server, client: str, folder: Path) -> Iterator[tuple[IndiMount, IndiCamera]]:
    """Mount and camera, not started."""
    config = Config.model_validate({"indi": {"port": server.port, "client": client}})
    mount = IndiMount(config.indi, folder / "mount.log", config.mount)
    camera = IndiCamera(config.indi, config.optics, folder / "camera.log")
    try:
        yield mount, camera
    finally:
        mount.close()
        camera.close()


def measure(client: str, frames: int, folder: Path) -> dict[str, list[float]]:
    """One round of one client."""
    found: dict[str, list[float]] = {}

    def note(what: str, value: float) -> None:
        found.setdefault(what, []).append(value)

    server = Server()
    try:
        with opened(server, client, folder) as (mount, camera):
            note("mount's process to ready (ms)", ms_of(mount.start))
            note("camera's process to ready (ms)", ms_of(camera.start))
            _orders(mount, note)
            _frames(camera, server, frames, note)
            server.kill()
            server = Server(server.port)
            back_s = time.monotonic()
            while True:
                try:
                    mount.report()
                    break
                except InstrumentError:
                    continue
            note("server back to the mount's report (ms)", (time.monotonic() - back_s) * 1e3)
    finally:
        server.kill()
    return found


def _orders(mount: IndiMount, note: Callable[[str, float], None]) -> None:
    pid = mount.process.pid
    assert pid is not None
    before_s = cpu_s(pid)
    for number in range(ORDERS):
        ra_deg = MOVES_DEG[number % 2]
        note("order a slew (ms)", ms_of(lambda r=ra_deg: mount.slew(r, 40.0, time.time_ns())))
        note("STOP (ms)", mount.abort().ms)
    note("mount's processor for a slew and a STOP (ms)", (cpu_s(pid) - before_s) / ORDERS * 1e3)
    before_s = cpu_s(pid)
    time.sleep(IDLE_S)
    note("mount's processor in ten idle seconds (ms)", (cpu_s(pid) - before_s) * 1e3)
    note("mount's memory (MiB)", memory_mib(pid, "VmRSS"))


def _frames(
    camera: IndiCamera, server: Server, frames: int, note: Callable[[str, float], None]
) -> None:
    pid = camera.process.pid
    assert pid is not None
    for frame_id in range(1, frames + 1):
        before_s = cpu_s(pid)
        note("order an exposure (ms)", ms_of(lambda n=frame_id: camera.start_exposure(1.0, n)))
        frame = camera.wait_frame(PATIENCE_S)
        come_s = time.monotonic()
        sent = server.sent()
        assert frame.pixels.shape == (HEIGHT_PX, WIDTH_PX)
        note("frame: last byte sent to array (ms)", (come_s - sent["last_s"]) * 1e3)
        note("frame: first byte sent to array (ms)", (come_s - sent["first_s"]) * 1e3)
        note("frame: camera's processor (ms)", (cpu_s(pid) - before_s) * 1e3)
    note("camera's memory, at its peak (MiB)", memory_mib(pid, "VmHWM"))
    note("camera's memory, between frames (MiB)", memory_mib(pid, "VmRSS"))


def past_the_process(server: Server) -> float:
    """STOP by a connection of its own, which is no client's."""
    return stop_mount("127.0.0.1", server.port, "Telescope Simulator", measures=False).ms


def main() -> None:
    """Measure by turns and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--frames", type=int, default=8)
    asked = parser.parse_args()
    libraries = [each for each in LIBRARIES if each.is_installed]
    found: dict[str, dict[str, list[float]]] = {each.name: {} for each in libraries}
    with tempfile.TemporaryDirectory() as folder:
        for number in range(asked.rounds):
            for library in libraries:
                for what, values in measure(library.name, asked.frames, Path(folder)).items():
                    found[library.name].setdefault(what, []).extend(values)
            print(f"round {number + 1} of {asked.rounds}", file=sys.stderr)
        server = Server()
        direct: list[Any] = [past_the_process(server) for _ in range(ORDERS)]
        server.kill()
    print(f"{'median, largest':48}" + "".join(f"{each.title:>26}" for each in libraries))
    for what in found[libraries[0].name]:
        cells = [found[each.name][what] for each in libraries]
        print(f"{what:48}" + "".join(f"{statistics.median(v):15.1f}{max(v):11.1f}" for v in cells))
    print(f"STOP past the process (ms) {statistics.median(direct):.1f}, {max(direct):.1f}")


if __name__ == "__main__":
    main()
