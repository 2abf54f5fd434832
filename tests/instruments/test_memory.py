"""What the processes of a night keep in memory, by its causes; ``bench_memory`` has the figures."""

import ctypes
import json
import mmap
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from rsoconsole.config import IndiConfig, OpticsConfig
from rsoconsole.instruments.camera.camera import IndiCamera
from rsoconsole.instruments.observatory.clock import SimulatedClock
from rsoconsole.instruments.process_memory import discard_pages
from rsoconsole.simulator import start_observatory
from rsoconsole.simulator.launch import Observatory
from tests.children.indi_clients import OTHERS_NIGHTLY

WIDTH_PX, HEIGHT_PX = 640, 480
HEAVY = ("/astropy/", "/scipy/", "/cv2/", "/pydantic_core/")
SECOND_NS = 1_000_000_000


@pytest.fixture(scope="module")
def observatory():
    size = {"width_px": WIDTH_PX, "height_px": HEIGHT_PX}
    with start_observatory("intelsat-14", 1, 0.0, **size) as running:
        yield running


@pytest.fixture(params=OTHERS_NIGHTLY)
def camera(request: pytest.FixtureRequest, observatory: Observatory, tmp_path: Path):
    there = {"host": observatory.host, "port": observatory.port, "simulated": True}
    indi = IndiConfig.model_validate({**there, "client": request.param})
    optics = OpticsConfig(width_px=WIDTH_PX, height_px=HEIGHT_PX)
    made = IndiCamera(indi, optics, tmp_path / "camera.log")
    clock = SimulatedClock(observatory.host, observatory.port)
    made.start()

    def expose(frame_id: int):
        made.start_exposure(1.0, frame_id)
        clock.wait_until(clock.now_utc_ns() + 3 * SECOND_NS)
        return made.wait_frame(60.0)

    yield made, expose
    made.close()
    clock.close()


def maps_of(pid: int) -> str:
    """Every file that a process has mapped, its libraries among them."""
    return Path(f"/proc/{pid}/maps").read_text()


def test_a_camera_process_that_has_read_frames_has_loaded_none_of_the_heavy_libraries(camera):
    made, expose = camera
    frame = expose(1)
    assert frame.header["INSTRUME"] == "CCD Simulator"
    maps = maps_of(made.process.pid)
    assert "/numpy/" in maps
    assert [name for name in HEAVY if name in maps] == []


def test_frames_that_are_let_go_take_turns_in_one_slot_and_held_ones_stay(camera):
    _, expose = camera
    assert not expose(1).pixels.flags.owndata
    held = [expose(number) for number in range(2, 7)]
    copies = [each.pixels.copy() for each in held]
    expose(7)
    assert all(np.array_equal(one.pixels, two) for one, two in zip(held, copies, strict=True))
    assert not np.array_equal(copies[0], copies[1])


@pytest.mark.parametrize("client", OTHERS_NIGHTLY)
def test_the_mirror_keeps_no_blob_and_its_memory_is_given_back(observatory, client):
    command = [sys.executable, "-m", "tests.children.blob_child", observatory.host]
    command += [str(observatory.port), observatory.camera_name, client]
    clock = SimulatedClock(observatory.host, observatory.port)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        while child.poll() is None:
            # The exposure ends as virtual time passes.
            clock.wait_until(clock.now_utc_ns() + SECOND_NS)
            time.sleep(0.1)
        assert child.stdout is not None
        said = child.stdout.read()
    clock.close()
    seen = json.loads(said.splitlines()[-1])
    assert seen["start"] == "SIMPLE"
    assert seen["bytes"] >= WIDTH_PX * HEIGHT_PX * 2
    assert seen["kept"] == 0
    assert seen["middle"] > 0
    assert seen["has_gone"]


def test_only_whole_pages_within_the_range_are_forgotten():
    page = mmap.PAGESIZE
    held = (ctypes.c_ubyte * (64 * page))()
    ctypes.memset(held, 7, len(held))
    start = ctypes.addressof(held)
    inner = -(-start // page) * page - start + page
    if not discard_pages(start + inner - 5, 3 * page + 10):
        pytest.skip("this system gives no pages back")
    assert set(held[inner : inner + 3 * page]) == {0}
    assert set(held[:inner]) == {7}
    assert set(held[inner + 3 * page :]) == {7}
    assert not discard_pages(start + 1, 10)
    assert set(held[:20]) == {7}


FREEING = """
import threading
import numpy as np
from rsoconsole.instruments import return_freed_blocks_at_once
assert return_freed_blocks_at_once()
def resident_kib():
    for line in open("/proc/self/status"):
        if line.startswith("VmRSS"):
            return int(line.split()[1])
before = resident_kib()
def work():
    for size in (12, 20, 30):
        np.ones(size << 20, np.uint8)
for _ in range(3):
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
print(resident_kib() - before)
"""


def test_what_threads_have_freed_is_back_with_the_system():
    if not hasattr(ctypes.CDLL(None), "mallopt"):
        pytest.skip("another C library than glibc")
    done = subprocess.run(
        [sys.executable, "-c", FREEING], capture_output=True, text=True, timeout=60, check=True
    )
    five_mib = 5 << 10
    assert int(done.stdout) < five_mib
