"""Where the time goes from the end of an exposure to the frame, and how fast a STOP is.

Run from the project's root: ``python -m tests.bench.bench_transfer [frames]``. Prints medians of
wall milliseconds; the pixels are noise (tests/rigs/stub_stage.py), so that drawing them
costs little.
"""

import statistics
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rsoconsole.config import Config
from rsoconsole.instruments import Instruments, connect_instruments, frame_from_bytes
from rsoconsole.instruments.indi.wire_stop import stop_mount
from rsoconsole.simulator import fits_bytes, start_observatory

WIDTH_PX, HEIGHT_PX = 4656, 3520
NS = 1_000_000_000


def ms_of(act: Callable[[], object]) -> float:
    """Wall milliseconds of one call."""
    begun_s = time.perf_counter()
    act()
    return (time.perf_counter() - begun_s) * 1e3


def show(what: str, values_ms: list[float]) -> None:
    """One line: median and worst."""
    print(f"{what:<52} {statistics.median(values_ms):8.1f} {max(values_ms):8.1f}")


def measure(instruments: Instruments, frames: int) -> None:
    """Frames, orders and stops of one observatory."""
    clock, mount, camera = instruments.clock, instruments.mount, instruments.camera
    here = mount.report()
    figures: dict[str, list[float]] = {}

    def note(what: str, value_ms: float) -> None:
        figures.setdefault(what, []).append(value_ms)

    def slew(offset_deg: float) -> None:
        mount.slew(here.ra_icrs_deg + offset_deg, here.dec_icrs_deg, clock.now_utc_ns())

    for frame_id in range(1, frames + 1):
        note("order an exposure", ms_of(lambda n=frame_id: camera.start_exposure(10.0, n)))
        end_utc_ns = clock.now_utc_ns() + 11 * NS
        note("let 11 s pass at once", ms_of(lambda t=end_utc_ns: clock.wait_until(t)))
        note("end of exposure to frame (draw, send, unpack)", ms_of(lambda: camera.wait_frame(60)))
        note("order a slew", ms_of(lambda: slew(20.0)))
        note("STOP, mount's process", mount.abort().ms)
        slew(-20.0)
        wire = stop_mount(
            instruments.host, instruments.port, instruments.mount_name, measures=False
        )
        note("STOP, connection of its own", wire.ms)
        camera.start_exposure(10.0, frame_id)
        clock.wait_until(clock.now_utc_ns() + 11 * NS)
        waiting = threading.Thread(target=camera.wait_frame, args=(60.0,))
        waiting.start()
        time.sleep(0.35)
        note("STOP while a frame is on its way", mount.abort().ms)
        waiting.join()
    for what, values_ms in figures.items():
        show(what, values_ms)


def main() -> None:
    """Print the table."""
    frames = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    print(f"{'wall time, ms':<52} {'median':>8} {'worst':>8}")
    rng = np.random.default_rng(1)
    shape = (HEIGHT_PX, WIDTH_PX)
    pixels = rng.integers(0, 65536, shape, dtype=np.uint16)
    file = bytes(fits_bytes(pixels, {}))
    show(
        "draw the noise",
        [ms_of(lambda: rng.integers(0, 65536, shape, dtype=np.uint16)) for _ in range(frames)],
    )
    show("write FITS", [ms_of(lambda: bytes(fits_bytes(pixels, {}))) for _ in range(frames)])
    show("read FITS", [ms_of(lambda: frame_from_bytes(file, 1, "x")) for _ in range(frames)])
    with (
        tempfile.TemporaryDirectory() as folder,
        start_observatory(
            "plain",
            1,
            0,
            width_px=WIDTH_PX,
            height_px=HEIGHT_PX,
            stage="tests.rigs.stub_stage:open_plain",
        ) as observatory,
    ):
        config = Config.model_validate({"indi": {"port": observatory.port, "simulated": True}})
        with connect_instruments(config, log_dir=Path(folder)) as instruments:
            measure(instruments, frames)


if __name__ == "__main__":
    main()
